"""/measurements: measured depth errors beside the predicted ones, and what they imply about the camera."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from typing import Any, Final

import numpy as np
import xarray as xr

from tradestudy.calibration.measured_fits import (
    MEAN_OF_NORMAL,
    UNKNOWN,
    Fitted,
    Ripple,
    disparity_errors,
    exponent,
    noise_and_floor,
    offset_and_scale,
    ripple,
)
from tradestudy.calibration.measured_table import QUANTITIES, MeasuredTable, read_measurements
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.depth.evaluation import distribution, imaged
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.results import dataset
from tradestudy.study.document import MappingEntry
from tradestudy.study.prepared import PreparedStudy
from tradestudy.study.schema.questions import MeasurementPart
from tradestudy.study.writing import standalone, yaml_of

_STEP_PX: Final = 1e-3
_SAME: Final = 1e-3  # difference of disparity noise that rounded tables, or linear propagation, may cause
_DENSE: Final = 401  # points of a curve
_CALIBRATED: Final = 2.0  # declared standard deviations that contain 95 % of the errors of a calibration
_TRIALS: Final[Mapping[str, float]] = {"yaw": 1e-6, "baseline": 1e-7}  # rad, m: small errors, to find what they do
FITS: Final = (
    "exponent",
    "exponent_predicted",
    "noise_px",
    "floor",
    "offset_px",
    "yaw",
    "scale",
    "baseline_shift",
    "zero_shift",
    "ripple_scale",
    "ripple_product",
    "ripple_amplitude_px",
    "ripple_mean_px",
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Predicted:
    """What a camera predicts at the distances of a table, arrays (N,); NaN where it measures nothing.

    Parameters
    ----------
    sigma, bias, rms, absolute_error
        Depth uncertainty from noise; radius from calibration errors, one standard deviation of the bias; both in
        quadrature; and the mean magnitude of normal errors of that size [m].
    valid
        Share of measurements that do not fail [1].
    disparity_px, px_per_m
        Disparity relative to infinity [px], and magnitude of its change with depth [px/m].
    noise_px
        Disparity error [px].
    """

    sigma: FloatArray
    bias: FloatArray
    rms: FloatArray
    absolute_error: FloatArray
    valid: FloatArray
    disparity_px: FloatArray
    px_per_m: FloatArray
    noise_px: FloatArray


def predict(camera: DepthCamera, distance: FloatArray) -> Predicted:
    """Predict the depth errors of a camera on its axis at distances [m]."""
    seen = imaged(camera, distance)
    noise, calibration, both = (distribution(camera, seen, source) for source in ("noise", "calibration", "both"))
    measured = np.isfinite(noise.half_width)
    bias = np.where(measured, calibration.error_radius, np.nan)
    rms = np.hypot(noise.half_width, bias)
    step, disparity = _STEP_PX * camera.sample_pitch, camera.disparity(seen)
    with np.errstate(divide="ignore", invalid="ignore"):
        near, far = (camera.depth_of_disparity(disparity + sign * step, seen) for sign in (1.0, -1.0))
        slope = 2.0 * _STEP_PX / (far - near)
    infinity = camera.disparity_of_infinity(seen)
    return Predicted(
        sigma=np.where(measured, noise.half_width, np.nan),
        bias=bias,
        rms=np.where(measured, rms, np.nan),
        absolute_error=np.where(measured, MEAN_OF_NORMAL * rms, np.nan),
        valid=np.where(measured, 1.0 - both.failed_fraction, np.nan),
        disparity_px=np.where(measured, (disparity - infinity) / camera.sample_pitch, np.nan),
        px_per_m=np.where(measured, slope, np.nan),
        noise_px=np.where(measured, camera.noise(seen) / camera.sample_pitch, np.nan),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Implied:
    """What a table implies about a camera.

    Parameters
    ----------
    fits
        Each of `FITS`.
    ripple
        Sub-pixel locking.
    declared_noise_px
        Median predicted disparity error [px].
    of_noise, of_calibration, of_scale
        Whether the declared disparity error, calibration errors, and focal length times baseline are consistent with
        the points: "consistent", "inconsistent", or why that is unknown.
    errors_px : array (N,)
        Mean disparity errors or, where the table has no bias, magnitudes of disparity errors [px].
    """

    fits: Mapping[str, Fitted]
    ripple: Ripple
    declared_noise_px: float
    of_noise: str
    of_calibration: str
    of_scale: str
    errors_px: FloatArray


def implied(camera: DepthCamera, table: MeasuredTable, predicted: Predicted, *, zero_fitted: bool = False) -> Implied:
    """Fit a table with a camera's change of disparity with depth; rows where it measures nothing are left out."""
    used, z, slope = np.isfinite(predicted.px_per_m), table.distance, predicted.px_per_m
    fits = dict.fromkeys(FITS, UNKNOWN)
    spread, size = table.spread, np.full(z.size, np.nan)
    if spread:
        size = getattr(table, spread) / (MEAN_OF_NORMAL if spread == "absolute_error" else 1.0)
        known = used & (size > 0.0)
        fits["exponent"] = exponent(z[known], size[known])
        fits["exponent_predicted"] = exponent(z[known], getattr(predicted, spread)[known])
        fits["noise_px"], fits["floor"] = noise_and_floor(size[known], slope[known])
    deviation = np.where(np.isfinite(table.sigma), table.sigma, predicted.sigma)
    errors = disparity_errors(table.bias, deviation, z, slope)
    known = used & np.isfinite(errors)
    if known.any():
        offset, scale, shift = offset_and_scale(
            errors[known],
            predicted.disparity_px[known],
            (deviation * slope)[known],
            slope[known] if zero_fitted else None,
        )
        fits |= {"offset_px": offset, "scale": scale, "zero_shift": shift}
        fits |= _as_errors(camera, z[known], predicted.disparity_px[known], slope[known], offset, scale)
    wave, shown = _locking(table, predicted, errors, size)
    product = float(np.median((predicted.disparity_px * z)[used])) if used.any() else math.nan
    fits |= {
        "ripple_scale": wave.scale,
        "ripple_product": wave.scale.times(product),
        "ripple_amplitude_px": wave.amplitude,
        "ripple_mean_px": wave.mean,
    }
    noise = float(np.median(predicted.noise_px[used])) if used.any() else math.nan
    return Implied(
        fits=fits,
        ripple=wave,
        declared_noise_px=noise,
        of_noise=_of_noise(fits["noise_px"], noise, spread),
        of_calibration=_of_calibration(table.bias[known], predicted.bias[known], fits),
        of_scale=_of_scale(wave, predicted.bias[used] / z[used]),
        errors_px=shown,
    )


def _as_errors(
    camera: DepthCamera, distance: FloatArray, disparity: FloatArray, slope: FloatArray, offset: Fitted, scale: Fitted
) -> dict[str, Fitted]:
    """The yaw [rad] and the error of the baseline [m] that cause an offset and a scale, by the camera's own model."""
    fits = {}
    for parameter, trial in _TRIALS.items():
        if parameter not in camera.error_vocabulary or camera.calibration.vocabulary is not None:
            continue
        inverse = camera.read(distance, 0.0, {parameter: np.full((1, 1), trial)}).inverse_depth[0]
        px = (inverse - 1.0 / distance) * distance**2 * slope / trial
        if parameter == "yaw":
            fits["yaw"] = offset.times(1.0 / float(np.median(px)))
        else:
            fits["baseline_shift"] = scale.times(1.0 / float(np.median(px / disparity)))
    return fits


def _locking(
    table: MeasuredTable, predicted: Predicted, errors: FloatArray, size: FloatArray
) -> tuple[Ripple, FloatArray]:
    """Sub-pixel locking in the column that shows the bias best, and the disparity errors [px] in it."""
    signed = bool(np.isfinite(errors).any())
    magnitude = table.absolute_error if np.isfinite(table.absolute_error).any() else size
    values = errors if signed else magnitude * predicted.px_per_m
    if not signed and np.isfinite(table.sigma).any() and np.isnan(table.absolute_error).all():
        return Ripple(reason="the table has neither a bias nor absolute errors"), np.full(size.shape, np.nan)
    known = np.isfinite(values) & np.isfinite(predicted.disparity_px)
    return ripple(values[known], predicted.disparity_px[known], signed=signed), values


CONSISTENT, INCONSISTENT = "consistent", "inconsistent"


def _of_noise(noise: Fitted, declared: float, spread: str) -> str:
    if math.isnan(noise.low):
        return "unknown: the table does not determine the disparity noise"
    if spread == "sigma":
        return INCONSISTENT if noise.excludes(declared, _SAME) else CONSISTENT
    # Other columns contain the bias too, which can only add to the noise.
    if noise.high < declared * (1.0 - _SAME):
        return INCONSISTENT
    return CONSISTENT if not noise.excludes(declared, _SAME) else "unknown: the table contains noise and bias together"


def _of_calibration(bias: FloatArray, declared: FloatArray, fits: Mapping[str, Fitted]) -> str:
    if not bias.size:
        return "unknown: the table has no bias"
    if (declared > 0.0).all():
        return CONSISTENT if np.median(np.abs(bias) / declared) <= _CALIBRATED else INCONSISTENT
    # Biases that are all zero are fitted by rounding errors alone, which would exclude 0.
    shown = bias.any() and any(fits[parameter].excludes(0.0) for parameter in ("offset_px", "scale"))
    return INCONSISTENT if shown else CONSISTENT


def _of_scale(wave: Ripple, declared: FloatArray) -> str:
    if not wave.found:
        return "unknown: the points show no sub-pixel locking"
    allowed = _CALIBRATED * float(np.nanmedian(declared))
    low, high = wave.scale.low - allowed, wave.scale.high + allowed
    return CONSISTENT if low <= 1.0 <= high else INCONSISTENT


def measurements_group(study: PreparedStudy) -> xr.Dataset:
    """/measurements over the rows of all tables, and what each table implies."""
    by_name = {table_name: _Table.of(study, table_name, part) for table_name, part in study.file.measurements.items()}
    tables = list(by_name.values())
    values: dict[str, Any] = {
        "table_of": [name for name, table in by_name.items() for _ in table.measured.lines],
        "line": [line for table in tables for line in table.measured.lines],
        "distance_of_row": np.concatenate([table.measured.distance for table in tables]),
        "used": np.concatenate([table.used.astype(float) for table in tables]),
    }
    for quantity in QUANTITIES:
        values[quantity] = np.concatenate([getattr(table.measured, quantity) for table in tables])
    for variable in (field.name for field in fields(Predicted)):
        values[f"predicted_{variable}"] = np.concatenate([getattr(table.predicted, variable) for table in tables])
    values["error_px"] = np.concatenate([table.implied.errors_px for table in tables])
    values |= {
        "camera_of": [table.part.camera for table in tables],
        "source": [table.part.source for table in tables],
        "spread_from": [table.measured.spread for table in tables],
        "ratio": [table.ratios for table in tables],
        "declared_noise_px": [table.implied.declared_noise_px for table in tables],
        "ripple_phase": [table.implied.ripple.phase for table in tables],
        "ripple_share": [table.implied.ripple.share for table in tables],
        "ripple_probability": [table.implied.ripple.probability for table in tables],
        "ripple_points": [table.implied.ripple.points for table in tables],
        "ripple_reason": [table.implied.ripple.reason for table in tables],
        "noise_verdict": [table.implied.of_noise for table in tables],
        "calibration_verdict": [table.implied.of_calibration for table in tables],
        "scale_verdict": [table.implied.of_scale for table in tables],
        "fitted_camera": [table.fitted_camera(study) for table in tables],
    }
    curves = [table.curve(study) for table in tables]
    values |= {f"curve_{variable}": [curve[variable] for curve in curves] for variable in curves[0]}
    for variable in FITS:
        fits = [table.implied.fits[variable] for table in tables]
        values[variable] = [fit.value for fit in fits]
        values[f"{variable}_error"] = [fit.error for fit in fits]
        values[f"{variable}_interval"] = [(fit.low, fit.high) for fit in fits]
    labels = {"table": list(by_name), "quantity": list(QUANTITIES), "statistic": ["median", "smallest", "largest"]}
    return dataset("measurements", values, {**labels, "end": ["low", "high"]})


@dataclass(frozen=True, kw_only=True, eq=False)
class _Table:
    """One table of a study, its prediction, and what it implies."""

    name: str
    part: MeasurementPart
    measured: MeasuredTable
    predicted: Predicted
    implied: Implied

    @classmethod
    def of(cls, study: PreparedStudy, name: str, part: MeasurementPart) -> _Table:
        path = ("measurements", name, "file")
        camera, measured = (
            study.case.cameras[part.camera],
            read_measurements(study.document.folder_of(path) / part.file),
        )
        predicted = predict(camera, measured.distance)
        fitted = implied(camera, measured, predicted, zero_fitted=part.zero == "fitted")
        return cls(name=name, part=part, measured=measured, predicted=predicted, implied=fitted)

    @property
    def used(self) -> BoolArray:
        return np.isfinite(self.predicted.px_per_m)

    @property
    def ratios(self) -> FloatArray:
        """Median, smallest and largest ratio of measured to predicted, for each quantity; NaN where there is none."""
        rows = []
        for quantity in QUANTITIES:
            with np.errstate(divide="ignore", invalid="ignore"):
                ratio = np.abs(getattr(self.measured, quantity)) / getattr(self.predicted, quantity)
            known = ratio[np.isfinite(ratio)]
            rows.append([np.median(known), known.min(), known.max()] if known.size else [np.nan] * 3)
        return np.array(rows)

    def curve(self, study: PreparedStudy) -> dict[str, FloatArray]:
        """The predicted error of the spread column over a dense grid, or of the bias without one, for figures."""
        z = self.measured.distance
        dense = np.geomspace(z.min(), z.max(), _DENSE)
        prediction = predict(study.case.cameras[self.part.camera], dense)
        predicted = getattr(prediction, self.measured.spread or "bias")
        return {
            "distance": dense,
            "predicted": predicted,
            "disparity_px": prediction.disparity_px,
            "px_per_m": prediction.px_per_m,
        }

    def fitted_camera(self, study: PreparedStudy) -> str:
        """The camera with the fitted values, as YAML for ``from:``; empty if none was fitted."""
        values = dict(self._fitted_values(study))
        if not values:
            return ""
        above = f"cameras.{self.part.camera}"
        changed = standalone(study.definition).with_values({f"{above}.{path}": value for path, value in values.items()})
        entry = changed.document.entry(above)
        assert isinstance(entry, MappingEntry)
        heading = f"# Fitted to the measurements {self.name} of the study {study.file.study}; other values as declared."
        return f"{heading}\n{yaml_of(entry)}"

    def _fitted_values(self, study: PreparedStudy) -> Iterator[tuple[str, Any]]:
        """Paths below the camera and their values, each with what it was fitted to."""
        fits, note, factor = self.implied.fits, f"fitted to {self.part.file}", 1.0
        baseline = study.file.cameras[self.part.camera].model_dump().get("baseline")
        # A scale fitted to the bias becomes a calibration error of the baseline below, which must not count twice.
        if self.implied.of_scale == INCONSISTENT and isinstance(baseline, float) and math.isnan(fits["scale"].error):
            factor = fits["ripple_scale"].value
            remark = f"{note}: focal length times baseline from sub-pixel locking, with the declared focal length"
            yield "baseline", {"value": f"{baseline * factor:.6g} m", "basis": "derived", "note": remark}
        # Disparity is proportional to the baseline, and so is the disparity noise that explains the same depth noise.
        noise = fits["noise_px"].times(factor)
        if noise.low > 0.0:
            column = self.measured.spread
            also = {"sigma": "", "rms": ", bias included", "absolute_error": ", as if normal and without bias"}[column]
            remark = f"{note}: 95 % interval {noise.low:.3g} to {noise.high:.3g} px{also}"
            yield "depth.disparity_error", {"value": f"{noise.value:.4g} px", "basis": "derived", "note": remark}
            yield "depth.error_of", {"value": "disparity", "basis": "derived", "note": note}
        for parameter, fit, unit in (("yaw", "yaw", "rad"), ("baseline", "baseline_shift", "m")):
            fitted = fits[fit]
            if math.isfinite(fitted.error):
                yield (
                    f"calibration.errors.{parameter}",
                    {
                        key: {"value": f"{value:.6g} {unit}", "basis": "derived", "note": note}
                        for key, value in (("mean", fitted.value), ("standard_deviation", fitted.error))
                    },
                )

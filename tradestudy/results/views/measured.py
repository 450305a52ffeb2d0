"""Facts about measured depth errors: how they compare with the prediction, and what they imply about the camera."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import xarray as xr

from tradestudy.results.views.groups import FloatArray, camera_titles, group, has
from tradestudy.units import ANGLE, FRACTION, LENGTH, NUMBER, PIXELS, Dimension, pretty, significant
from tradestudy.wording import counted, range_words, with_article

NAMES: Final = {
    "sigma": "standard deviation",
    "rms": "RMS error",
    "absolute_error": "mean absolute error",
    "bias": "bias",
    "valid": "valid share",
}
MEAN_OF_NORMAL: Final = math.sqrt(2.0 / math.pi)
_SIGNIFICANT: Final = 0.01


@dataclass(frozen=True, kw_only=True)
class ImpliedValue:
    """One value that the points imply: its name, the value, its 95 % interval, the declared value, and the verdict."""

    name: str
    value: str
    interval: str
    declared: str
    verdict: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Measured:
    """One table of measurements and what it implies.

    Parameters
    ----------
    name, title
        Its name, and the title of the camera.
    table, rows
        The variables of the table, and those of its rows.
    """

    name: str
    title: str
    table: xr.Dataset
    rows: xr.Dataset

    def number(self, name: str) -> float:
        """A value of the table."""
        return float(self.table[name].item())

    def interval(self, name: str) -> tuple[float, float]:
        """Ends of the 95 % interval of a fitted value."""
        low, high = self.table[f"{name}_interval"].values
        return float(low), float(high)

    def values(self, name: str) -> FloatArray:
        """A variable of the rows."""
        return np.asarray(self.rows[name].values, dtype=np.float64)

    @property
    def spread(self) -> str:
        """The column from which exponent, noise and floor are fitted; empty if there is none."""
        return str(self.table["spread_from"].item())

    @property
    def locked(self) -> bool:
        """Whether the points show sub-pixel locking."""
        return self.number("ripple_probability") < _SIGNIFICANT

    def fitted(self) -> FloatArray:
        """The fitted error of the column `spread` [m] along the curve; NaN without a fit."""
        with np.errstate(divide="ignore", invalid="ignore"):
            noise = self.number("noise_px") / self.table["curve_px_per_m"].values
        size = np.hypot(noise, self.number("floor"))
        return np.asarray(size * (MEAN_OF_NORMAL if self.spread == "absolute_error" else 1.0))

    def fitted_px(self) -> FloatArray:
        """The fitted disparity error [px] along the curve: the ripple, or offset and scale; NaN without a fit."""
        d, n = np.asarray(self.table["curve_disparity_px"].values), self.number
        if self.locked:
            phase = 2.0 * np.pi * n("ripple_scale") * d + n("ripple_phase")
            wave = n("ripple_mean_px") + n("ripple_amplitude_px") * np.sin(phase)
            # Without a column of biases, the points are magnitudes.
            return np.asarray(wave if np.isfinite(self.values("bias")).any() else np.abs(wave))
        shift = np.nan_to_num(n("zero_shift")) * np.asarray(self.table["curve_px_per_m"].values)
        return np.asarray(n("offset_px") + n("scale") * d - shift)

    def ratio_words(self, quantity: str) -> str:
        """The median ratio of measured to predicted, with their range if it shows; empty where there is none."""
        ratios = [float(ratio) for ratio in self.table["ratio"].sel(quantity=quantity).values]
        if math.isnan(ratios[0]):
            return ""
        median, low, high = (significant(ratio, 2) for ratio in ratios)
        return median if low == high else f"{median} ({low} to {high})"

    def finding(self, camera: str = "") -> str:
        """How the points compare with the prediction, in one sentence without a full stop; may name the camera."""
        camera = camera or with_article(self.title)
        used = self.values("used") > 0.0
        if not used.any():
            return f"{camera} measures nothing at the distances of {self.name}, as declared"
        quantity = next(
            (candidate for candidate in (self.spread, "bias", "valid") if candidate and self.ratio_words(candidate)), ""
        )
        if quantity:
            used &= np.isfinite(self.values(quantity))
        z = np.unique(self.values("distance_of_row")[used])
        where = f"at {counted(z.size, 'distance')} " * (z.size > 1) + range_words(float(z[0]), float(z[-1]))
        if not quantity:
            return f"{camera} was measured {where}, without a prediction to compare with"
        median, parenthesis, spread = self.ratio_words(quantity).partition(" (")
        words = f"{median} times the predicted one" + f" in the median ({spread}" * bool(parenthesis)
        comparison = f"the measured {NAMES[quantity]} of {camera} is {words} {where}"
        wrong = [declared for declared, key in _VERDICTS.items() if str(self.table[key].item()) == "inconsistent"]
        return f"{comparison}; the points contradict the declared {' and '.join(wrong)}" if wrong else comparison


_VERDICTS: Final = {
    "disparity error": "noise_verdict",
    "calibration errors": "calibration_verdict",
    "focal length times baseline": "scale_verdict",
}


def measured_tables(tree: xr.DataTree) -> list[Measured]:
    """Every table of measurements, in the order of the study."""
    if not has(tree, "measurements", "camera_of"):
        return []
    data, titles = group(tree, "measurements"), camera_titles(tree)
    row_names = [variable for variable, array in data.data_vars.items() if array.dims == ("row",)]
    tables = []
    for name in map(str, data["table"].values):
        of_table = np.flatnonzero(data["table_of"].values == name)
        table = data.drop_vars(row_names).sel(table=name)
        title = titles[str(table["camera_of"].item())]
        tables.append(Measured(name=name, title=title, table=table, rows=data[row_names].isel(row=of_table)))
    return tables


def implied_values(measured: Measured) -> Iterator[ImpliedValue]:
    """What the points of a table imply, with 95 % intervals; values that cannot be fitted are left out."""
    verdicts = {declared: str(measured.table[key].item()) for declared, key in _VERDICTS.items()}
    of_noise = {"rms": ", with the bias", "absolute_error": ", if normal and without bias"}.get(measured.spread, "")
    declared_noise = pretty(measured.number("declared_noise_px"), PIXELS)
    candidates: tuple[tuple[str, str, Dimension, str, str], ...] = (
        ("exponent", "Exponent in distance", NUMBER, significant(measured.number("exponent_predicted")), ""),
        ("noise_px", f"Disparity noise{of_noise}", PIXELS, declared_noise, verdicts["disparity error"]),
        ("floor", "Floor of the depth error", LENGTH, "0", ""),
        ("offset_px", "Disparity offset", PIXELS, "0", verdicts["calibration errors"]),
        ("yaw", "… as a yaw error", ANGLE, "", ""),
        ("scale", "Error of focal length times baseline", FRACTION, "0", verdicts["calibration errors"]),
        ("baseline_shift", "… as an error of the declared baseline", LENGTH, "", ""),
        ("zero_shift", "Shift of the tape", LENGTH, "", ""),
    )
    for key, name, dimension, declared, verdict in candidates:
        if math.isfinite(measured.number(key)):
            yield _implied(measured, key, name, dimension, declared, verdict)
    if measured.locked:
        yield _implied(measured, "ripple_amplitude_px", "Amplitude of sub-pixel locking", PIXELS, "", "")
        product, scale = measured.number("ripple_product"), measured.number("ripple_scale")
        low, high = (significant(end, 4) for end in measured.interval("ripple_product"))
        yield ImpliedValue(
            name="Disparity times distance, from its period",
            value=f"{significant(product, 4)} px m",
            interval=f"{low} to {high} px m",
            declared=f"{significant(product / scale, 4)} px m",
            verdict=verdicts["focal length times baseline"],
        )


def _implied(
    measured: Measured, key: str, name: str, dimension: Dimension, declared: str, verdict: str
) -> ImpliedValue:
    ends = " to ".join(pretty(end, dimension) for end in measured.interval(key))
    value = pretty(measured.number(key), dimension)
    return ImpliedValue(name=name, value=value, interval=ends, declared=declared, verdict=verdict)


def locking_words(measured: Measured) -> str:
    """Whether sub-pixel locking explains the points, in one sentence without a full stop."""
    if reason := str(measured.table["ripple_reason"].item()):
        return f"Whether sub-pixel locking explains the points is unknown: {reason}"
    share = pretty(measured.number("ripple_share"), FRACTION, digits=2)
    points = counted(int(measured.number("ripple_points")), "point")
    if measured.locked:
        return f"Sub-pixel locking explains {share} of the variance of the disparity errors at {points}"
    return f"The disparity errors at {points} show no sub-pixel locking beyond their scatter"

"""Results of the fits to the corners of a real rig, in words and numbers for /calibration."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np

from tradestudy.calibration.corners.real_rig import RigFit
from tradestudy.calibration.corners.trust import CalibrationTrust, ComparedLens
from tradestudy.calibration.corners.view_blocks import TRANSLATION, cameras_of
from tradestudy.calibration.posteriors import InferredCalibration
from tradestudy.calibration.projection import intrinsic_names
from tradestudy.optics.arrays import FloatArray
from tradestudy.units import ANGLE, LENGTH, PIXELS, pretty, significant


def rig_rows(inferred: Mapping[str, InferredCalibration]) -> dict[str, list[str]]:
    """Camera, quantity and value for the cameras calibrated from corners; empty if there are none."""
    rows = [
        (name, *row)
        for name, one in inferred.items()
        if one.fit is not None and one.trust is not None
        for row in (*_rows(one.fit), *_trust_rows(one.fit, one.trust))
    ]
    if not rows:
        return {}
    cameras, quantities, values = (list(column) for column in zip(*rows, strict=True))
    return {"rig_camera": cameras, "rig_quantity": quantities, "rig_value": values}


def rig_trust(inferred: Mapping[str, InferredCalibration]) -> dict[str, FloatArray]:
    """Cross-checks by halves of the views, and residual maps; NaN for cameras without corners, empty if all are."""
    known = {name: one.trust for name, one in inferred.items() if one.trust is not None}
    if not known:
        return {}

    def of_each(get: Callable[[CalibrationTrust], FloatArray]) -> FloatArray:
        nothing = np.full_like(get(next(iter(known.values()))), np.nan)
        return np.stack([get(known[name]) if name in known else nothing for name in inferred])

    return {
        "rig_claimed": of_each(lambda one: one.claimed),
        "rig_halves_difference": of_each(lambda one: one.halves_difference),
        "rig_halves_claim": of_each(lambda one: one.halves_claim),
        "rig_residual": of_each(lambda one: one.residual_map),
    }


def rig_lenses(inferred: Mapping[str, InferredCalibration]) -> tuple[dict[str, FloatArray], list[str]]:
    """Changes that other lens models would make, over calibrations and lens models; NaN where none was compared."""
    known = [one.trust.lenses if one.trust is not None else {} for one in inferred.values()]
    names = list(dict.fromkeys(name for lenses in known for name in lenses))
    if not names:
        return {}, []

    def of_each(get: Callable[[ComparedLens], FloatArray | float]) -> FloatArray:
        nothing = np.full_like(get(next(lenses[names[0]] for lenses in known if names[0] in lenses)), np.nan)
        return np.array([[get(lenses[name]) if name in lenses else nothing for name in names] for lenses in known])

    return {
        "rig_lens_support": of_each(lambda one: one.support),
        "rig_lens_support_deviation": of_each(lambda one: one.support_deviation),
        "rig_lens_change": of_each(lambda one: one.depth_change),
        "rig_lens_change_deviation": of_each(lambda one: one.depth_change_deviation),
    }, names


def _rows(fit: RigFit) -> Iterator[tuple[str, str]]:
    yield "views and corners", f"{len(fit.corners.views)} views, {fit.corners.corner_count} corners"
    for side, camera in (("left", fit.left), ("right", fit.right)):
        yield f"residual of the {side} camera alone", pretty(camera.corner_rms_px, PIXELS)
        for k, name in enumerate(intrinsic_names(fit.corners.lens.free)):
            deviation = float(np.sqrt(camera.covariance[k, k]))
            unit = " px" if name.endswith("_px") else ""
            words = name.removesuffix("_px").replace("_", " ")
            yield f"{side} {words}", f"{_digits(float(camera.intrinsics[k]), deviation)}{unit}"
    lens, cameras = fit.corners.lens, cameras_of(fit.explained.shared)
    for side, values in zip(("left", "right"), cameras, strict=True):
        yield (
            f"field angle up to which the {side} lens model is valid",
            pretty(float(lens.at(values[4:]).valid_field), ANGLE),
        )
    yield "residual of the pair with one relative pose", pretty(fit.pair.corner_rms_px, PIXELS)
    yield "correlation of the views' mean residuals, left with right", f"{fit.means.correlation:.4f}".replace("-", "−")
    yield "motion of the board that explains this correlation", pretty(fit.explained.motion_scale, LENGTH)
    yield (
        "residual with this motion, left and right",
        f"{pretty(fit.explained.left_rms_px, PIXELS)}, {pretty(fit.explained.right_rms_px, PIXELS)}",
    )
    yield "noise of one corner coordinate, root mean square over views", pretty(fit.explained.noise_px, PIXELS)
    yield "gain in log likelihood from this motion", significant(fit.explained.log_likelihood_gain)
    shared, covariance = fit.explained.shared, fit.covariance
    baseline = float(np.linalg.norm(shared[TRANSLATION]))
    direction = shared[TRANSLATION] / baseline
    deviation = float(np.sqrt(direction @ covariance[TRANSLATION, TRANSLATION] @ direction))
    yield "baseline", f"{_digits(1e3 * baseline, 1e3 * deviation)} mm"
    for name, k in (("pitch", -6), ("yaw", -5), ("roll", -4)):
        spread = float(np.sqrt(covariance[k, k]))
        yield f"relative {name}", f"{_digits(float(np.degrees(shared[k])), float(np.degrees(spread)))}°"


def _trust_rows(fit: RigFit, trust: CalibrationTrust) -> Iterator[tuple[str, str]]:
    for z, good, claimed in zip(trust.distances, trust.good_to, trust.claimed, strict=True):
        where, to, says = (pretty(float(length), LENGTH, digits=3) for length in (z, good, claimed))
        yield f"accuracy of this calibration at {where}", f"{to} (claimed: {says})"
    for name, other in trust.lenses.items():
        if other.failure:
            yield f"lens model {name}", f"cannot be fitted: {other.failure}"
    yield (
        f"difference between random halves of the views, divided by the claimed difference ({trust.halves} splits)",
        ", ".join(
            f"{ratio:.2f} at {pretty(float(z), LENGTH)}" for z, ratio in zip(trust.distances, trust.ratio, strict=True)
        ),
    )
    rms = trust.view_rms
    yield "smallest and largest residual of a view", f"{pretty(rms.min(), PIXELS)}, {pretty(rms.max(), PIXELS)}"
    along = trust.neighbour_correlation.mean(axis=0)
    yield "correlation of neighbouring residuals, along rows and columns", f"{along[0]:.2f}, {along[1]:.2f}"
    noise = fit.corners.noise
    assert noise is not None
    yield (
        "share of the noise variance that neighbours have in common, and its correlation length",
        f"{100.0 * noise.share:.0f} %, {pretty(noise.length, LENGTH)}",
    )
    yield "ratio of the largest to the smallest noise of a view", f"{noise.deviation.max() / noise.deviation.min():.2g}"
    yield from _outlier_rows(fit)
    names = ("bowl", "saddle along the edges", "saddle along the diagonals")
    for name, value, deviation in zip(names, fit.warp, fit.warp_deviation, strict=True):
        yield f"warp of the board, {name}", f"{_digits(1e6 * float(value), 1e6 * float(deviation))} µm"


def _outlier_rows(fit: RigFit) -> Iterator[tuple[str, str]]:
    """Corners excluded as outliers, and the number of corners with reduced weight."""
    there = fit.present
    low = (fit.weights < 1.0) & there[:, None]
    yield (
        "corners with a weight below 1, in the left and right pictures together",
        f"{int(low.sum())} of {2 * int(there.sum())}",
    )
    for view, side, corner in zip(*np.nonzero((fit.weights == 0.0) & there[:, None]), strict=True):
        yield f"excluded outlier: view {fit.corners.views[view]}, {('left', 'right')[side]}", f"corner {corner + 1}"


def _digits(value: float, deviation: float) -> str:
    """A value with its standard deviation, both rounded to two digits of the deviation."""
    decimals = max(0, 1 - int(np.floor(np.log10(deviation))))
    return f"{value:.{decimals}f} ± {deviation:.{decimals}f}".replace("-", "−")

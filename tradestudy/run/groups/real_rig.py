"""What the fits to the corners of a real rig found, in words and numbers for /calibration."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from tradestudy.calibration.corners.real_rig import RigFit
from tradestudy.calibration.posteriors import InferredCalibration
from tradestudy.calibration.projection import INTRINSIC_NAMES
from tradestudy.units import ANGLE, LENGTH, PIXELS, pretty, significant


def rig_rows(inferred: Mapping[str, InferredCalibration]) -> dict[str, list[str]]:
    """Rows of camera, quantity and value of those that were calibrated from corners; none without."""
    rows = [(name, *row) for name, one in inferred.items() if one.fit is not None for row in _rows(one.fit)]
    if not rows:
        return {}
    cameras, quantities, values = (list(column) for column in zip(*rows, strict=True))
    return {"rig_camera": cameras, "rig_quantity": quantities, "rig_value": values}


def _rows(fit: RigFit) -> Iterator[tuple[str, str]]:
    yield "views and corners", f"{len(fit.corners.views)} views, {fit.corners.corner_count} corners"
    for side, camera in (("left", fit.left), ("right", fit.right)):
        yield f"residual of the {side} camera alone", pretty(camera.corner_rms_px, PIXELS)
        for k, name in enumerate(INTRINSIC_NAMES):
            deviation = float(np.sqrt(camera.covariance[k, k]))
            unit = " px" if name.endswith("_px") else ""
            words = name.removesuffix("_px").replace("_", " ")
            yield f"{side} {words}", f"{_digits(float(camera.intrinsics[k]), deviation)}{unit}"
    yield "residual of the pair with one relative pose", pretty(fit.pair.corner_rms_px, PIXELS)
    yield "correlation of the view means, left with right", f"{fit.means.correlation:.4f}"
    yield "left–right motion of the board that explains it", pretty(fit.explained.motion_scale, LENGTH)
    yield (
        "residual left by it, left and right",
        f"{pretty(fit.explained.left_rms_px, PIXELS)}, {pretty(fit.explained.right_rms_px, PIXELS)}",
    )
    yield "noise of one corner coordinate", pretty(fit.explained.noise_px, PIXELS)
    yield "gain in log likelihood by it", significant(fit.explained.log_likelihood_gain)
    shared, covariance = fit.explained.shared, fit.explained.covariance
    baseline = float(np.linalg.norm(shared[15:18]))
    direction = shared[15:18] / baseline
    deviation = float(np.sqrt(direction @ covariance[15:18, 15:18] @ direction))
    yield "baseline", f"{pretty(baseline, LENGTH, digits=5)} ± {pretty(deviation, LENGTH)}"
    for name, k in (("pitch", 12), ("yaw", 13), ("roll", 14)):
        spread = float(np.sqrt(covariance[k, k]))
        yield f"relative {name}", f"{pretty(float(shared[k]), ANGLE)} ± {pretty(spread, ANGLE)}"


def _digits(value: float, deviation: float) -> str:
    """A value with its standard deviation, both to two digits of the latter."""
    decimals = max(0, 1 - int(np.floor(np.log10(deviation))))
    return f"{value:.{decimals}f} ± {deviation:.{decimals}f}"

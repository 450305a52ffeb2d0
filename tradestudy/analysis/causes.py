"""The largest cause of a depth uncertainty: the one input whose spread contributes most of its variance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from tradestudy.analysis.linear_depth import linear_reading
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray

NOISE: Final = "noise"


@dataclass(frozen=True, kw_only=True)
class Cause:
    """An uncertain parameter of a camera, or the noise of a measurement, and its share of the variance."""

    parameter: str
    share: float


def largest_cause(camera: DepthCamera, distance: FloatArray) -> Cause | None:
    """The parameter that contributes most of the depth uncertainty, on average over distances [m].

    Each parameter is judged by the variance that it contributes alone, with inverse depth linear in the errors; None
    if an uncertain parameter has no variance, or nothing is measured.
    """
    seen = distance[camera.images(distance)]
    try:
        line = linear_reading(camera, seen, 0.0, "noise" if camera.propagation.model == "off" else "both")
    except OutOfRangeError:
        return None
    alone = np.square(line.sensitivity) * np.diag(line.covariance)[:, np.newaxis]
    with np.errstate(invalid="ignore", divide="ignore"):
        shares = alone / alone.sum(axis=0)
    known = np.isfinite(shares).all(axis=0)
    if not known.any():
        return None
    mean = shares[:, known].mean(axis=1)
    declared = {name for group in camera.calibration.groups for name in group.parameters}
    by_noise = float(sum(share for name, share in zip(line.parameters, mean, strict=True) if name not in declared))
    named = {name: float(share) for name, share in zip(line.parameters, mean, strict=True) if name in declared} | {
        NOISE: by_noise
    }
    largest = max(named, key=lambda name: named[name])
    return Cause(parameter=largest, share=named[largest])

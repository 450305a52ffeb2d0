"""The largest cause of a depth uncertainty: the input that contributes most to its variance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from tradestudy.analysis.linear_depth import linearised_depth
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cameras.depth_measurement import FieldPosition
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray

NOISE: Final = "noise"


@dataclass(frozen=True, kw_only=True)
class Cause:
    """An uncertain parameter of a camera, or the noise of a measurement, and its share of the variance of depth."""

    parameter: str
    share: float


def largest_cause(camera: DepthCamera, distance: FloatArray, field: FieldPosition = 0.0) -> Cause | None:
    """The parameter that contributes most to the depth uncertainty, on average over distances [m].

    If inverse depth is linear in the errors, with sensitivities s and covariance C, its variance is Σ sᵢ (C s)ᵢ. Each
    term, divided by that sum, is the share of one parameter with its correlations; noise accounts for the rest.
    None if an uncertain parameter has no variance, or if nothing is measured.
    """
    seen = distance[camera.images(distance)]
    try:
        line = linearised_depth(camera, seen, field, "noise" if camera.propagation.model == "off" else "both")
    except OutOfRangeError:
        return None
    contributed = line.sensitivity * (line.covariance @ line.sensitivity)
    with np.errstate(invalid="ignore", divide="ignore"):
        shares = contributed / contributed.sum(axis=0)
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

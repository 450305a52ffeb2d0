"""Refuse errors so large that no camera is left, such as focal lengths in pixels that are read as metres."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.uncertainty.sources import Group
from tradestudy.units import LENGTH, pretty


def impossible_errors(camera: DepthCamera, distance: FloatArray) -> Iterator[str]:
    """Parameters of which a deviation by one standard deviation leaves no camera that measures depth, in words.

    Parameters
    ----------
    camera
        The camera with its calibration.
    distance
        Distances [m] at which it is tried.
    """
    means = camera.calibration.means
    if not _measures(camera, distance, means):
        return
    for group in camera.calibration.groups:
        for name, size in zip(group.parameters, _deviations(group), strict=True):
            if not all(_measures(camera, distance, {**means, name: means[name] + by}) for by in (-size, size)):
                unit = camera.parameter(name).unit
                words = pretty(size, LENGTH) if unit == "m" else f"{size:g} {unit}"
                yield (
                    f"a deviation of {name} by one standard deviation, {words}, leaves no camera that measures depth; "
                    "check its unit"
                )


def _deviations(group: Group) -> FloatArray:
    """Standard deviation of each parameter; 0 where it does not exist or cannot be computed."""
    try:
        covariance = group.covariance
    except OutOfRangeError:
        covariance = None
    return np.zeros(len(group.parameters)) if covariance is None else np.sqrt(np.diag(covariance))


def _measures(camera: DepthCamera, distance: FloatArray, values: Mapping[str, float]) -> bool:
    """Whether the camera measures a depth at any of the distances [m]."""
    drawn = {name: np.full((1, 1), value) for name, value in values.items()}
    found = camera.measured_depth(distance, 0.0, drawn)
    return bool(np.any(np.isfinite(found.inverse_depth) & ~found.no_overlap & ~found.out_of_range))

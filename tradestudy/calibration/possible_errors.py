"""Refuse errors so large that no camera is left, such as focal lengths in pixels that are read as metres."""

from __future__ import annotations

from collections.abc import Iterator

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
    calibration = camera.calibration
    sizes = {
        name: size
        for group in calibration.groups
        for name, size in zip(group.parameters, _deviations(group), strict=True)
    }
    if not sizes:
        return
    # The first row has no deviation; each other row has that of one parameter, down or up.
    moved = np.concatenate([np.zeros((1, len(sizes))), *(sign * np.diag([*sizes.values()]) for sign in (-1.0, 1.0))])
    drawn = {name: calibration.means[name] + moved[:, k : k + 1] for k, name in enumerate(sizes)}
    found = camera.measured_depth(distance, 0.0, drawn)
    measures = np.isfinite(found.inverse_depth) & ~found.no_overlap & ~found.out_of_range
    known = np.any(np.broadcast_to(measures, (len(moved), distance.size)), axis=1)
    if not known[0]:
        return
    for number, (name, size) in enumerate(sizes.items(), start=1):
        if not (known[number] and known[number + len(sizes)]):
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

"""The usable range of a camera: where every limit of the study holds, and which one binds at each end."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from tradestudy.cameras.depth_camera import DepthCamera, Limit, UsableCriteria
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.study.depth import closed_form_error, depth_uncertainty, failed_fraction

LIMIT_NAMES: Final = (
    "real_image",
    "overlap",
    "total_covering_plane",
    "availability",
    "focus",
    "saturation",
    "matching",
    "last_disparity_step",
    "failed_fraction",
    "relative_uncertainty",
    "closed_form",
)
# An uncertainty that may be off by more than this share of itself must not name a usable distance.
_LARGEST_ERROR: Final = 0.1
END_OF_STUDY: Final = "range of the study"

# Each round divides the bracket of every boundary by this number; ten rounds reach the last digits.
_SUBDIVISIONS: Final = 32
_ROUNDS: Final = 10


@dataclass(frozen=True, kw_only=True)
class Interval:
    """One usable interval of distance [m] and the limit that ends it on either side."""

    near: float
    far: float
    near_limit: str
    far_limit: str


@dataclass(frozen=True, kw_only=True)
class Boundary:
    """A distance [m] where a condition begins to hold, or ceases to."""

    distance: float
    begins: bool


def evaluate_limits(camera: DepthCamera, criteria: UsableCriteria, distance: FloatArray) -> Mapping[str, Limit]:
    """All limits that the study declares and the camera knows, at distances [m]; none holds where it forms no image.

    ``saturation`` and ``matching`` are among them for a camera whose disparity error is derived: where the brightest
    pixels are full, or no matcher reaches that error, the camera measures nothing that is known. ``closed_form`` is
    always among them: where the uncertainty is not known to a tenth of itself, it decides nothing.
    """
    distance = np.where(camera.images(distance), distance, np.nan)
    limits = dict(camera.limits(distance, criteria))
    if not isinstance(camera.disparity_error_px, float | int):
        limits["saturation"] = camera.disparity_error_px.saturation(camera, distance)
        limits["matching"] = camera.disparity_error_px.limit(camera, distance)
    error = closed_form_error(camera, distance)
    limits["closed_form"] = Limit(value=error, bound=_LARGEST_ERROR, met=~(error > _LARGEST_ERROR))
    if criteria.failed_fraction is not None:
        value = failed_fraction(camera, distance)
        limits["failed_fraction"] = Limit(
            value=value, bound=criteria.failed_fraction, met=value <= criteria.failed_fraction
        )
    if criteria.relative_uncertainty is not None:
        value = depth_uncertainty(camera, distance) / distance
        limits["relative_uncertainty"] = Limit(
            value=value, bound=criteria.relative_uncertainty, met=value <= criteria.relative_uncertainty
        )
    return {name: limits[name] for name in LIMIT_NAMES if name in limits}


def all_met(limits: Mapping[str, Limit], shape: tuple[int, ...]) -> BoolArray:
    """Where every limit holds."""
    met = np.ones(shape, dtype=bool)
    for limit in limits.values():
        met &= limit.met
    return met


def boundaries(condition: Callable[[FloatArray], BoolArray], distance: FloatArray) -> tuple[Boundary, ...]:
    """Every distance where a condition changes between neighbouring grid points, to the last digits of a float.

    Parameters
    ----------
    condition
        Vectorised over distance [m].
    distance
        Increasing grid [m]; a condition that changes twice between two points is not seen.
    """
    held = condition(distance)
    change = np.flatnonzero(held[1:] != held[:-1])
    low, high, begins = distance[change], distance[change + 1], held[change + 1]
    if change.size == 0:
        return ()
    shares = np.linspace(0.0, 1.0, _SUBDIVISIONS + 1)[:, np.newaxis]
    for _ in range(_ROUNDS):
        points = low + shares * (high - low)
        new = condition(points.ravel()).reshape(points.shape) == begins
        first = np.argmax(new[1:], axis=0)  # the upper end is new by construction
        columns = np.arange(change.size)
        low, high = points[first, columns], points[first + 1, columns]
    return tuple(
        Boundary(distance=float(where), begins=bool(begin))
        for where, begin in zip(np.where(begins, high, low), begins, strict=True)
    )


def usable_intervals(camera: DepthCamera, criteria: UsableCriteria, distance: FloatArray) -> tuple[Interval, ...]:
    """The usable intervals within a grid of distances [m], from near to far, each end with the limit that sets it.

    Ends are found to the last digits between grid points; an end at the edge of the grid is named so.
    """

    def usable(points: FloatArray) -> BoolArray:
        return all_met(evaluate_limits(camera, criteria, points), points.shape)

    held = usable(distance)
    ends = boundaries(usable, distance)
    near = [(end.distance, _binding(camera, criteria, end)) for end in ends if end.begins]
    far = [(end.distance, _binding(camera, criteria, end)) for end in ends if not end.begins]
    if held[0]:
        near.insert(0, (float(distance[0]), END_OF_STUDY))
    if held[-1]:
        far.append((float(distance[-1]), END_OF_STUDY))
    return tuple(
        Interval(near=start, far=stop, near_limit=near_limit, far_limit=far_limit)
        for (start, near_limit), (stop, far_limit) in zip(near, far, strict=True)
    )


def _binding(camera: DepthCamera, criteria: UsableCriteria, end: Boundary) -> str:
    """The limits that are broken just outside an end."""
    outside = end.distance * (1.0 - 1e-9 if end.begins else 1.0 + 1e-9)
    limits = evaluate_limits(camera, criteria, np.array([outside]))
    broken = [name for name, limit in limits.items() if not limit.met[0]]
    return ", ".join(broken)

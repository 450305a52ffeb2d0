"""The usable range of a camera: where it meets every limit of the study, and which limit binds at each end."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np

from tradestudy.cameras.depth_camera import DepthCamera, Limit, UsableCriteria
from tradestudy.depth.brackets import between, stencil
from tradestudy.depth.evaluation import Reading
from tradestudy.depth.remembered import remembered
from tradestudy.depth.table import NODES_PER_FACTOR, distribution_between, narrow_features
from tradestudy.optics.arrays import BoolArray, FloatArray

LIMIT_NAMES: Final = (
    "real_image",
    "overlap",
    "total_covering_plane",
    "availability",
    "focus",
    "saturation",
    "matching",
    "last_disparity_step",
    "disparity_range",
    "failed_fraction",
    "relative_uncertainty",
)
_OF_DEPTH: Final = frozenset(("failed_fraction", "relative_uncertainty"))
_OF_ERRORS: Final = _OF_DEPTH | {"saturation", "matching"}  # the others follow from geometry and are computed jointly
_ENDS_TO: Final = 1e-13  # relative accuracy of an end of a usable range
_REACH: Final = 1.2  # factor of a distance within which each scramble's root is sought
_AROUND: Final = 33  # places
END_OF_STUDY: Final = "range of the study"

# Each round divides the bracket of every boundary by at least this number, until the last digits are reached.
SUBDIVISIONS: Final = 16


@dataclass(frozen=True, kw_only=True)
class Interval:
    """One usable interval of distance [m], with the limits at its ends.

    The errors are standard errors of the ends over the scrambles of the draws; 0 for ends that draws do not decide.
    """

    near: float
    far: float
    near_limit: str
    far_limit: str
    near_error: float = 0.0
    far_error: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Boundary:
    """A distance [m] where a condition begins or ceases to hold."""

    distance: float
    begins: bool


def evaluate_limits(
    camera: DepthCamera,
    criteria: UsableCriteria,
    distance: FloatArray,
    names: Collection[str] = LIMIT_NAMES,
    *,
    depth: Reading = distribution_between,
) -> Mapping[str, Limit]:
    """Evaluate, at distances [m], all declared limits that apply to the camera; none holds without an image.

    ``saturation`` and ``matching`` apply to a camera whose disparity error is derived: where the brightest pixels are
    saturated, or no matcher reaches that error, the error of its measurements is unknown.

    Only limits among the given ``names`` are evaluated; ``depth`` gives the distribution of depth.
    """
    distance = np.where(camera.images(distance), distance, np.nan)
    law = camera.disparity_error_px
    limits: dict[str, Limit] = {}
    if not _OF_ERRORS.issuperset(names):
        limits |= camera.limits(distance, criteria)
    if "saturation" in names and not isinstance(law, float | int):
        limits["saturation"] = law.saturation(camera, distance)
    if "matching" in names and not isinstance(law, float | int):
        limits["matching"] = law.limit(camera, distance)
    bounds = {name: getattr(criteria, name) for name in _OF_DEPTH.intersection(names)}
    if any(bound is not None for bound in bounds.values()):
        errors = depth(camera, distance, "both", 0.0)
    for name, bound in bounds.items():
        if bound is not None:
            value = errors.failed_fraction if name == "failed_fraction" else errors.judged / distance
            limits[name] = Limit(value=value, bound=bound, met=value <= bound)
    return {name: limits[name] for name in LIMIT_NAMES if name in limits and name in names}


def all_met(limits: Mapping[str, Limit], shape: tuple[int, ...]) -> BoolArray:
    """Where every limit holds."""
    met = np.ones(shape, dtype=bool)
    for limit in limits.values():
        met &= limit.met
    return met


def boundaries(
    condition: Callable[[FloatArray], BoolArray] | Callable[[FloatArray], FloatArray],
    distance: FloatArray,
    known: BoolArray | FloatArray | None = None,
    *,
    to: float = 0.0,
) -> tuple[Boundary, ...]:
    """Every distance where a condition changes between neighbouring grid points, to the last digits of a float.

    Parameters
    ----------
    condition
        Vectorised over distance [m]: either whether it holds, or its margin, negative where it is violated, which
        needs fewer evaluations.
    distance
        Increasing grid [m]; a condition that changes twice between two points is not seen.
    known
        What it gives on the grid, if that is known.
    to
        Relative accuracy that suffices, if the last digits do not matter.
    """
    known = _margins(condition(distance) if known is None else known)
    held = known >= 0.0  # an unknown margin, NaN, counts as violated
    change = np.flatnonzero(held[1:] != held[:-1])
    low, high, begins = distance[change], distance[change + 1], held[change + 1]
    ends, previous = np.stack([known[change], known[change + 1]]), np.full(change.size, np.inf)
    four = stencil(change, distance.size)
    around = np.stack([distance[four], known[four]])
    # Brackets that are narrow enough stay as they are, so that every boundary is the one found alone.
    while (wide := np.flatnonzero(high - low > np.maximum(2.0 * np.spacing(high), to * high))).size:
        columns, kept, least = np.arange(wide.size), ends[:, wide], to * high[wide]
        inner = between((low[wide], high[wide]), around[..., wide], previous[wide], SUBDIVISIONS, least)
        points = np.vstack([low[wide], inner, high[wide]])
        margins = np.vstack([kept[0], _margins(condition(inner.ravel())).reshape(inner.shape), kept[1]])
        first = np.argmax((margins[1:] >= 0.0) == begins[wide], axis=0)
        previous[wide] = high[wide] - low[wide]
        low[wide], high[wide] = points[first, columns], points[first + 1, columns]
        ends[:, wide] = margins[first, columns], margins[first + 1, columns]
        four = stencil(first, len(points))
        around[..., wide] = points[four, columns], margins[four, columns]
    # Of the two ends of a bracket, the boundary is the one where the condition holds.
    return tuple(
        Boundary(distance=float(where), begins=bool(begin))
        for where, begin in zip(np.where(begins, high, low), begins, strict=True)
    )


def margin(met: BoolArray, difference: FloatArray) -> FloatArray:
    """Margin of a condition, negative where it is violated, from the difference of its value and its bound."""
    size = np.maximum(np.abs(difference), np.finfo(np.float64).tiny)  # 0 has no sign to show a violation
    return np.where(met, size, -size)


def _margins(values: BoolArray | FloatArray) -> FloatArray:
    return np.where(values, 1.0, -1.0) if values.dtype == np.bool_ else np.asarray(values, dtype=np.float64)


def usable_ends(
    camera: DepthCamera,
    criteria: UsableCriteria,
    distance: FloatArray,
    limits: Mapping[str, Limit],
    *,
    to: float = _ENDS_TO,
    depth: Reading = distribution_between,
) -> tuple[Boundary, ...]:
    """Where a camera becomes usable or ceases to be, on a grid whose limits are known; ``to`` as in `boundaries`.

    Between two grid points only the limits violated on one side are followed, and then any others that turn out to be
    violated at an end found that way.
    """
    held = all_met(limits, distance.shape)
    change = np.flatnonzero(held[1:] != held[:-1])
    outside = np.where(held[change], change + 1, change)
    names = [name for name, limit in limits.items() if not np.all(limit.met[outside])]
    ends: tuple[Boundary, ...] = ()
    broken = names
    while broken:
        ends = boundaries(partial(kept_by, camera, criteria, names=tuple(names), depth=depth), distance, held, to=to)
        at_ends = evaluate_limits(camera, criteria, np.array([end.distance for end in ends]), depth=depth)
        broken = [name for name, limit in at_ends.items() if name not in names and not limit.met.all()]
        names = [*names, *broken]
    return ends


def usable_stretches(ends: Sequence[Boundary], distance: FloatArray, held: BoolArray) -> list[tuple[float, float]]:
    """Nearest and farthest distance [m] of each usable interval of a grid, from the boundaries within the grid."""
    near = [end.distance for end in ends if end.begins]
    far = [end.distance for end in ends if not end.begins]
    if held[0]:
        near.insert(0, float(distance[0]))
    if held[-1]:
        far.append(float(distance[-1]))
    return list(zip(near, far, strict=True))


def kept_by(
    camera: DepthCamera,
    criteria: UsableCriteria,
    distance: FloatArray,
    names: Collection[str],
    depth: Reading = distribution_between,
) -> FloatArray:
    """Smallest margin of some limits; negative where one is violated, NaN where its value is unknown."""
    law = camera.disparity_error_px
    kept = []
    if "matching" in names and not isinstance(law, float | int):
        kept.append(law.margin(camera, distance))  # of all its conditions; its limit states only one value
    others = [name for name in names if name != "matching"]
    if others:
        limits = evaluate_limits(camera, criteria, distance, others, depth=depth).values()
        kept += [margin(limit.met, limit.value - limit.bound) for limit in limits]
    return np.asarray(np.min(kept, axis=0))


def usable_intervals(camera: DepthCamera, criteria: UsableCriteria, distance: FloatArray) -> tuple[Interval, ...]:
    """The usable intervals within a range of distances [m], from near to far, with the limit that sets each end.

    Intervals and gaps are sought at the distances, at the nodes of a table and where the depth error changes fast, so
    that a few distances hide none. Ends are found to twelve digits, and those that depend on draws also in each
    scramble. An end at the edge of the range is marked as such.
    """
    return _intervals(camera, distance, criteria)


@remembered(1024)  # tables, data sheets, requirements and verdicts ask for them
def _intervals(camera: DepthCamera, distance: FloatArray, criteria: UsableCriteria) -> tuple[Interval, ...]:
    distance = sought(camera, distance)
    limits = evaluate_limits(camera, criteria, distance)
    ends = usable_ends(camera, criteria, distance, limits)
    at_ends = {
        (end.begins, end.distance): (binding, _end_error(camera, criteria, end, binding))
        for end, binding in zip(ends, _binding(camera, criteria, ends), strict=True)
    }
    intervals = []
    for near, far in usable_stretches(ends, distance, all_met(limits, distance.shape)):
        (near_limit, near_error), (far_limit, far_error) = (
            at_ends.get(end, (END_OF_STUDY, 0.0)) for end in ((True, near), (False, far))
        )
        intervals.append(
            Interval(
                near=near,
                far=far,
                near_limit=near_limit,
                far_limit=far_limit,
                near_error=near_error,
                far_error=far_error,
            )
        )
    return tuple(intervals)


def sought(camera: DepthCamera, distance: FloatArray) -> FloatArray:
    """The given distances [m] and those between them at which ends of the usable range are bracketed, increasing."""
    first, last = distance[0], distance[-1]
    if not first < last:
        return distance
    more = [*narrow_features(camera), *camera.propagation.judged]
    nodes = np.geomspace(first, last, 2 + math.ceil(NODES_PER_FACTOR * math.log(last / first)))[1:-1]
    inside = [place for place in more if first < place < last]
    return np.unique(np.concatenate([distance, nodes, inside]))


def _end_error(camera: DepthCamera, criteria: UsableCriteria, end: Boundary, binding: str) -> float:
    """Standard error [m] of an end set by a limit on drawn depths; 0 for other ends."""
    names = [limit for limit in binding.split(", ") if limit in _OF_DEPTH]
    if camera.propagation.model != "exact" or not names:
        return 0.0
    grid = places_around(end.distance)
    depth = distribution_between(camera, grid)
    kept = []
    if "failed_fraction" in names:
        kept.append((criteria.failed_fraction or 0.0) - depth.failed)
    if "relative_uncertainty" in names:
        kept.append((criteria.relative_uncertainty or 0.0) - depth.judged_widths / grid)
    return scramble_error(np.min(kept, axis=0), end.distance)


def places_around(distance: float) -> FloatArray:
    """Distances [m] around a root, at which each scramble is evaluated to find its own."""
    return np.asarray(distance * np.geomspace(1.0 / _REACH, _REACH, _AROUND))


def scramble_error(values: FloatArray, distance: float) -> float:
    """Standard error [m] of a distance where a value changes its sign, from the root in each scramble.

    Parameters
    ----------
    values
        Values of each scramble at `places_around` that distance, shape (scrambles, places).
    distance
        [m].

    Returns
    -------
    float
        0 for one scramble; infinite if a scramble has no change of sign there.
    """
    if len(values) < 2:
        return 0.0
    logs, nearest = np.log(places_around(distance)), []
    for row in values:
        with np.errstate(invalid="ignore"):  # an infinite value has a sign
            turns = np.flatnonzero(np.sign(row[1:]) * np.sign(row[:-1]) <= 0.0)
            shares = row[turns] / (row[turns] - row[turns + 1])  # zeros of lines; halfway where a value is infinite
        if not turns.size:
            return float("inf")
        roots = logs[turns] + np.where(np.isfinite(shares), shares, 0.5) * (logs[turns + 1] - logs[turns])
        nearest.append(float(roots[np.argmin(np.abs(roots - np.log(distance)))]))
    return float(distance * np.std(nearest, ddof=1) / np.sqrt(len(nearest)))


def _binding(camera: DepthCamera, criteria: UsableCriteria, ends: Sequence[Boundary]) -> list[str]:
    """The limits violated just outside each end; for matching, with the condition."""
    # All limits hold at an end itself; just outside, but well beyond its accuracy, only those that set it are violated.
    outside = np.array([end.distance * (1.0 - 1e-9 if end.begins else 1.0 + 1e-9) for end in ends])
    limits = evaluate_limits(camera, criteria, outside) if ends else {}
    law, binding = camera.disparity_error_px, []
    for number, distance in enumerate(outside.tolist()):
        broken = [name for name, limit in limits.items() if not limit.met[number]]
        if "matching" in broken and not isinstance(law, float | int):
            conditions = " and ".join(law.broken_conditions(camera, distance))
            broken[broken.index("matching")] = f"matching: {conditions}"
        binding.append(", ".join(broken))
    return binding

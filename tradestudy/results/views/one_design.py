"""The answers for one design: its best cameras, what explains them, and its requirements.

The designs of a sweep are read together, as plain arrays; reading them one by one with xarray would take most of the
time of a report.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import xarray as xr

from tradestudy.results import judged_uncertainty
from tradestudy.results.views.decision import candidates, merged_ranges, winners, worth_reporting
from tradestudy.results.views.depth import by_design, largest_parts, nominal, nominal_is_declared, swept
from tradestudy.results.views.groups import FloatArray, camera_titles, group, has, ranges_of

Ranges = tuple[tuple[float, float, str], ...]
_OF_DESIGNS: Final = {
    "met": "design_met",
    "camera_deciding": "design_camera",
    "margin_percent": "design_margin_percent",
    "margin_sigma": "design_margin_sigma",
    "within_tolerance": "design_within_tolerance",
    "reason": "design_reason",
    "limited_by": "design_limited_by",
}
_OF_ALL: Final = ("says", "priority", "quantity", "of", "bound_text", "over_near", "over_far")
_UNKNOWN: Final = {"place": np.nan, "conformity": np.nan, "rests_on": "", "rests_on_share": np.nan}


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraDepth:
    """One camera of one design, over the computed distances.

    Parameters
    ----------
    uncertainty
        The depth uncertainty that judges it [m]; see `judged_uncertainty`.
    parts, largest_shares
        The part with the largest share of its variance, if known, and this share.
    broken
        Which limits of the usable range it violates, shape (distance, limit).
    usable
        Usable ranges, as (near, far) [m].
    worst
        The largest depth uncertainty [m] at the places computed off the axis; None without such places.
    """

    uncertainty: FloatArray
    parts: tuple[str | None, ...]
    largest_shares: FloatArray
    broken: npt.NDArray[np.bool_]
    usable: tuple[tuple[float, float], ...]
    worst: FloatArray | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class BestCameras:
    """The best camera along the distance in one design.

    Parameters
    ----------
    ranges
        As given by `winners`.
    titles
        Titles of all cameras.
    candidates
        As given by `candidates`.
    distance
        The computed distances [m].
    limits
        Names of the limits of the usable range.
    cameras
        The cameras that measure depth; none where the results contain no depth of the design that the ranges describe.
    """

    ranges: Ranges
    titles: Mapping[str, str]
    candidates: tuple[str, ...]
    distance: FloatArray
    limits: tuple[str, ...]
    cameras: Mapping[str, CameraDepth]

    @property
    def reported(self) -> Ranges:
        """The ranges that are worth reporting."""
        return tuple(worth_reporting(self.ranges))

    def nearest(self, place: float) -> int:
        """Index of the computed distance nearest to a place [m]."""
        return int(np.argmin(np.abs(self.distance - place)))


def best_cameras(tree: xr.DataTree) -> BestCameras:
    """The best camera along the distance in the study as declared."""
    depth = nominal(tree)
    cameras = camera_depths(depth)[0] if nominal_is_declared(tree) else {}
    if cameras and has(tree, "depth_field", "depth_uncertainty"):
        off = judged_uncertainty(group(tree, "depth_field")).max(("field", "corner"))
        cameras = {key: replace(one, worst=off.sel(camera=key).values) for key, one in cameras.items()}
    return BestCameras(ranges=tuple(winners(tree)), cameras=cameras, **_shared(tree, depth))


def best_cameras_of_designs(tree: xr.DataTree) -> Sequence[BestCameras | None]:
    """`best_cameras` of every design, the last parameter varying fastest; None where the run did not ask for it."""
    if not has(tree, "decision", "design_best_camera_along"):
        return [None for _ in design_places(tree)]
    depth, decision = group(tree, "depth"), group(tree, "decision")
    best = by_design(depth, decision["design_best_camera_along"], "distance")
    ends = [by_design(depth, depth[name], "camera", "interval") for name in ("usable_near", "usable_far")]
    if "design_crossover_distance" in decision:
        ends.append(by_design(depth, decision["design_crossover_distance"], "design_crossing"))
    every = np.concatenate([one.reshape(len(best), -1) for one in ends], axis=1)
    shared = _shared(tree, depth)
    return [
        BestCameras(
            ranges=tuple(merged_ranges(names, shared["distance"], changes[np.isfinite(changes)])),
            cameras=cameras,
            **shared,
        )
        for names, changes, cameras in zip(best.tolist(), every, camera_depths(depth), strict=True)
    ]


def _shared(tree: xr.DataTree, depth: xr.Dataset) -> dict[str, Any]:
    return {
        "titles": camera_titles(tree),
        "candidates": candidates(tree),
        "distance": np.asarray(depth["distance"].values, dtype=np.float64),
        "limits": tuple(map(str, depth["limit"].values)),
    }


def camera_depths(depth: xr.Dataset) -> list[dict[str, CameraDepth]]:
    """The cameras of every design of ``/depth``, by key."""
    uncertainty = by_design(depth, judged_uncertainty(depth), "camera", "distance")
    broken = by_design(depth, depth["limit_met"], "camera", "distance", "limit") == 0
    near, far = (by_design(depth, depth[name], "camera", "interval") for name in ("usable_near", "usable_far"))
    parts, shares = largest_parts(depth)
    return [
        {
            str(key): CameraDepth(
                uncertainty=uncertainty[design, k],
                parts=tuple(parts[design, k].tolist()),
                largest_shares=shares[design, k],
                broken=broken[design, k],
                usable=ranges_of(near[design, k], far[design, k]),
            )
            for k, key in enumerate(depth["camera"].values)
        }
        for design in range(len(uncertainty))
    ]


def requirements_of_designs(tree: xr.DataTree) -> Sequence[Sequence[Mapping[str, Any]]]:
    """The rows of ``/requirements`` of every design; what decides a worst value is known only for the declared one."""
    if not has(tree, "requirements", "design_reason"):
        return [[] for _ in design_places(tree)]
    depth, data = group(tree, "depth"), group(tree, "requirements")
    of_all = {name: data[name].values for name in ("requirement", *_OF_ALL)}
    own = {name: by_design(depth, data[variable], "requirement") for name, variable in _OF_DESIGNS.items()}
    return [
        [
            {name: values[k] for name, values in of_all.items()}
            | {name: values[design, k] for name, values in own.items()}
            | _UNKNOWN
            for k in range(data.sizes["requirement"])
        ]
        for design in range(len(own["met"]))
    ]


def design_places(tree: xr.DataTree) -> Iterator[dict[str, int]]:
    """Position of every design along the swept parameters, the last one varying fastest; none without a sweep."""
    if not has(tree, "depth") or not (names := swept(depth := group(tree, "depth"))):
        return
    for places in itertools.product(*(range(depth.sizes[name]) for name in names)):
        yield dict(zip(names, places, strict=True))


def shown_place(tree: xr.DataTree) -> dict[str, int]:
    """Position of the design that figures show: the declared one, if it is among those swept."""
    depth, one = group(tree, "depth"), nominal(tree)
    return {name: int(np.flatnonzero(depth[name].values == one[name].values)[0]) for name in swept(depth)}

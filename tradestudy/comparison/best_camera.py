"""Compare which camera is best at which distances."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from tradestudy.comparison.difference import Difference, Run, titles_of
from tradestudy.comparison.stated_errors import SURE, left_out_share
from tradestudy.results import judged_uncertainty
from tradestudy.results.views.decision import answer_title, reported_winners, tied
from tradestudy.results.views.depth import nominal, nominal_is_declared, of_camera, swept
from tradestudy.results.views.groups import group, has
from tradestudy.wording import distance, span

NOBODY = "no usable camera"
_SAME = 1e-9
Winner = tuple[float, float, str]


@dataclass(frozen=True, kw_only=True)
class BestBetween:
    """Distances [m] between which no run switches its best camera, and the best cameras there in each run."""

    near: float
    far: float
    names: tuple[str, ...]

    @property
    def differs(self) -> bool:
        """Whether the runs name different cameras."""
        return len({frozenset(tied(name)) for name in self.names}) > 1


@dataclass(frozen=True, kw_only=True)
class Edge:
    """A distance where the best camera switches [m], its error [m], and the best cameras before and beyond it."""

    place: float
    error: float
    between: tuple[frozenset[str], frozenset[str]]


def best_is_compared(runs: Sequence[Run]) -> bool:
    """Whether every run names a best camera, and their distances overlap."""
    if not all(has(run.tree, "decision", "best_camera") and has(run.tree, "depth") for run in runs):
        return False
    near, far = common_range(runs)
    return near < far


@dataclass(frozen=True, kw_only=True)
class Best:
    """Where the runs name different best cameras, and whether errors of the switches explain further differences."""

    changed: tuple[Difference, ...]
    has_explained: bool


def compare_best(runs: Sequence[Run]) -> Best:
    """Where the runs name different best cameras, except where errors of the switch distances explain it."""
    winners = [list(reported_winners(run.tree)) for run in runs]
    ranges = list(_ranges(winners, common_range(runs)))
    edges = [edge for run, found in zip(runs, winners, strict=True) for edge in _edges(run.tree, found)]
    differing = [one for one in ranges if one.differs]
    changed = [one for one in differing if not _is_explained(one, edges)]
    titles = titles_of(runs)
    what = "Best camera, as declared" if any(swept(group(run.tree, "depth")) for run in runs) else "Best camera"
    rest = "; otherwise unchanged" if len(changed) < len(ranges) else ""
    found = tuple(
        Difference(
            what=what,
            values=tuple(answer_title(titles, name, NOBODY) for name in one.names),
            where=f"from {span(one.near, one.far)}{rest if one is changed[-1] else ''}",
        )
        for one in changed
    )
    return Best(changed=found, has_explained=len(changed) < len(differing))


def common_range(runs: Sequence[Run]) -> tuple[float, float]:
    """The distances [m] between which every run names a best camera."""
    ends = [group(run.tree, "decision")["distance"].values[[0, -1]] for run in runs]
    return float(max(near for near, _ in ends)), float(min(far for _, far in ends))


def _ranges(winners: Sequence[Sequence[Winner]], ends: tuple[float, float]) -> Iterator[BestBetween]:
    """The common distances, split wherever any run switches its best camera; equal neighbours are joined."""
    edges = {at for found in winners for start, stop, _ in found for at in (start, stop) if ends[0] < at < ends[1]}
    cuts = sorted({*ends, *edges})
    ranges = [
        BestBetween(near=a, far=b, names=tuple(_best_at(found, float(np.sqrt(a * b))) for found in winners))
        for a, b in itertools.pairwise(cuts)
    ]
    for names, members in itertools.groupby(ranges, key=lambda one: one.names if one.differs else None):
        stretch = list(members)
        yield BestBetween(near=stretch[0].near, far=stretch[-1].far, names=stretch[0].names if names is None else names)


def _best_at(found: Sequence[Winner], place: float) -> str:
    """The best camera of the range that contains the place, or of the nearest one where a sliver is not reported."""
    return min(found, key=lambda one: max(one[0] - place, place - one[1]))[2]


def _is_explained(differing: BestBetween, edges: Sequence[Edge]) -> bool:
    """Whether both ends read the same in words, or are the same switch within its errors."""
    return distance(differing.near) == distance(differing.far) or any(
        one.between == other.between and differing.far - differing.near <= one.error + other.error
        for one in edges
        for other in edges
        if _is_same(one.place, differing.near) and _is_same(other.place, differing.far)
    )


def _is_same(one: float, other: float) -> bool:
    return abs(one - other) <= _SAME * other


def _edges(tree: xr.DataTree, found: Sequence[Winner]) -> Iterator[Edge]:
    """Where the best camera switches; the error is that of the root or, without one, the gap between two distances."""
    depth = nominal(tree)
    every = np.asarray(depth["distance"].values, dtype=np.float64)
    is_declared = nominal_is_declared(tree)  # else the curves belong to another design than the decision
    exact = [*_crossovers(tree), *(_ends_of_use(tree, depth) if is_declared else ())]
    for (_, place, before), (_, _, after) in itertools.pairwise(found):
        index = int(np.clip(np.searchsorted(every, place), 1, every.size - 1))
        gap = float(every[index] - every[index - 1])
        error = next((error for at, error in exact if _is_same(at, place) and np.isfinite(error)), gap)
        yield Edge(
            place=place,
            error=error + (_moved_by_models(tree, depth, place, {*tied(before), *tied(after)}) if is_declared else 0.0),
            between=(frozenset(tied(before)), frozenset(tied(after))),
        )


def _crossovers(tree: xr.DataTree) -> Iterator[tuple[float, float]]:
    decision = group(tree, "decision")
    if "crossover_distance" in decision:
        own = decision.isel(reading=0).sel(error_source="both")
        yield from zip(own["crossover_distance"].values, SURE * own["crossover_error"].values, strict=True)


def _ends_of_use(tree: xr.DataTree, depth: xr.Dataset) -> Iterator[tuple[float, float]]:
    for end in ("near", "far"):
        for camera in depth["camera"].values:
            share = left_out_share(tree, str(camera), "usable_range")
            ends, errors = (of_camera(depth, f"usable_{end}{more}", str(camera)) for more in ("", "_error"))
            yield from zip(ends, SURE * errors + share * np.where(np.isfinite(ends), ends, 0.0), strict=True)


def _moved_by_models(tree: xr.DataTree, depth: xr.Dataset, place: float, cameras: set[str]) -> float:
    """How far the crossover of two curves moves [m] if each shifts by what its models leave out."""
    shares = [left_out_share(tree, camera, "depth_uncertainty") for camera in cameras]
    if len(cameras) != 2 or not any(shares):
        return 0.0
    judged = judged_uncertainty(depth)
    first, second = (judged.sel(camera=camera).values for camera in sorted(cameras))
    known = np.isfinite(first) & np.isfinite(second)
    if np.count_nonzero(known) < 2:
        return 0.0
    log_distance = np.log(np.asarray(depth["distance"].values, dtype=np.float64)[known])
    slopes = np.gradient(np.log(first[known] / second[known]), log_distance)
    slope = abs(float(np.interp(np.log(place), log_distance, slopes)))
    return place * math.hypot(*shares) / slope if slope else math.inf

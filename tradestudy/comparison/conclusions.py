"""Conclusions that changed: answers to the questions of a study, best cameras, and the ranges where cameras serve."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import xarray as xr

from tradestudy.comparison.comparison import (
    ARROW,
    Difference,
    Run,
    are_alike,
    common_cameras,
    same_or_each,
    titles_of,
)
from tradestudy.comparison.results import ROUNDING, SURE, left_out_share
from tradestudy.results import judged_uncertainty
from tradestudy.results.views.decision import TIED, answer_title, reported_winners, shown_ends, tied
from tradestudy.results.views.depth import (
    by_first_criterion,
    nominal,
    nominal_is_declared,
    of_camera,
    sharp_ranges,
    swept,
)
from tradestudy.results.views.groups import group, has, records
from tradestudy.results.views.measured import measured_tables
from tradestudy.results.views.requirement_conclusions import (
    MetRange,
    RequirementConclusion,
    decided_by,
    requirement_conclusions,
)
from tradestudy.results.views.trade_off import candidates_by_rank
from tradestudy.units import FRACTION, pretty
from tradestudy.wording import counted, distance, listed, span, within

NOT_ASKED = "not asked"
_NOWHERE = "at no value that was tried"
_WORST = "worst "


@dataclass(frozen=True, kw_only=True)
class Answers:
    """The answers of one kind that changed, and the number of those that did not."""

    changed: tuple[Difference, ...]
    unchanged: int

    @classmethod
    def of(cls, found: Sequence[Difference | None]) -> Answers:
        """The differences, one for each answer; None where it did not change."""
        changed = tuple(one for one in found if one is not None)
        return cls(changed=changed, unchanged=len(found) - len(changed))


def compare_requirements(runs: Sequence[Run]) -> Answers:
    """Compare verdicts on requirements, the cameras that decide them, and, in sweeps, the designs that meet them."""
    found = [{one.name: one for one in requirement_conclusions(run.tree)} for run in runs]
    bounds = [
        {row["requirement"]: row["bound"] for row in records(run.tree, "requirements", "requirement")} for run in runs
    ]
    changed: list[Difference] = []
    names = list(dict.fromkeys(name for one in found for name in one))
    unchanged = 0
    for name in names:
        ones = [one.get(name) for one in found]
        same_bound = len({one[name] for one in bounds if name in one}) == 1
        differences = list(_of_requirement(ones, same_bound=same_bound))
        changed += differences
        unchanged += not differences
    return Answers(changed=tuple(changed), unchanged=unchanged)


def _of_requirement(ones: Sequence[RequirementConclusion | None], *, same_bound: bool) -> Iterator[Difference]:
    there = [one for one in ones if one is not None]
    what = f'Requirement "{same_or_each([one.says for one in there])}"'
    verdicts = tuple(NOT_ASKED if one is None else one.verdict for one in ones)
    deciding = [decided_by(one) for one in there]
    if len(set(verdicts)) > 1:
        details = [_reasons(there), "" if same_bound else "its bound differs"]
        yield Difference(what=what, values=verdicts, where=f"({'; '.join(filter(None, details))})")
    elif len(set(deciding)) > 1:
        yield Difference(
            what=what, values=tuple(f"{one.verdict}, {by}" for one, by in zip(there, deciding, strict=True))
        )
    if len(there) == len(ones):
        yield from _of_designs(what, there)


def _reasons(ones: Sequence[RequirementConclusion]) -> str:
    """The worst value in each run, with its camera and distance; what the runs share is stated once."""
    cameras = [one.camera for one in ones]
    if len(set(cameras)) > 1:
        return ARROW.join(f"{one.camera}: {one.reason}" for one in ones)
    reasons = list(dict.fromkeys(one.reason for one in ones))
    heads, places = zip(*(one.rpartition(" at ")[::2] for one in reasons), strict=True)
    if len(reasons) > 1 and len(set(places)) == 1 and all(head.startswith(_WORST) for head in heads):
        values = ARROW.join(head.removeprefix(_WORST) for head in heads)
        return f"{cameras[0]}: {_WORST}{values} at {places[0]}"
    return f"{cameras[0]}: {ARROW.join(reasons)}"


def _of_designs(what: str, ones: Sequence[RequirementConclusion]) -> Iterator[Difference]:
    """The ranges of a single swept number in which the requirement is met; else the number of designs."""
    ranges = [one.met_ranges for one in ones if one.met_ranges is not None]
    parameters = {one.parameter for found in ranges for one in found}
    designs = [one.designs for one in ones if one.designs is not None]
    if len(ranges) == len(ones):
        if len(parameters) == 1 and any(_moved(ranges[0], other) for other in ranges[1:]):
            values = tuple("met " + (" and ".join(_range_words(found)) or _NOWHERE) for found in ranges)
            yield Difference(what=f"{what}, over the {parameters.pop()}", values=values)
    elif len(designs) == len(ones) and len(set(designs)) > 1:
        yield Difference(
            what=f"{what}, over all designs",
            values=tuple(f"met by {met} of {counted(every, 'design')}" for met, every in designs),
        )


def _range_words(found: Sequence[MetRange]) -> list[str]:
    several = len({one.camera for one in found}) > 1
    return [one.words + (f" by {one.camera}" if several else "") for one in found]


def _moved(first: Sequence[MetRange], other: Sequence[MetRange]) -> bool:
    """Whether ranges differ in number, in their cameras, or in an end by more than both errors."""
    return [one.camera for one in first] != [one.camera for one in other] or any(
        abs(a - b) > one.error + two.error
        for one, two in zip(first, other, strict=True)
        for a, b in ((one.low, two.low), (one.high, two.high))
    )


def compare_measurements(runs: Sequence[Run]) -> Answers:
    """Compare how measured depth errors compare with the predicted ones, for tables of the same name in every run."""
    tables = [{one.name: one.finding("the camera") for one in measured_tables(run.tree)} for run in runs]
    shared = [name for name in tables[0] if all(name in one for one in tables)]
    found = [(name, tuple(one[name] for one in tables)) for name in shared]
    return Answers.of(
        [
            Difference(what=f"Measurements {name}", values=values) if len({*values}) > 1 else None
            for name, values in found
        ]
    )


def compare_ranks(runs: Sequence[Run]) -> Answers:
    """Compare the candidates that rank first for most of the possible weights."""
    first = [next(iter(candidates_by_rank(run.tree)), None) for run in runs]
    there = [one for one in first if one is not None]
    if len(there) < len(runs):
        return Answers.of([])
    values = tuple(f"{one.title} (for {pretty(one.ranks[0], FRACTION, digits=2)} of the weights)" for one in there)
    is_same = len({one.title for one in there}) == 1
    return Answers.of([None if is_same else Difference(what="Ranked first by all criteria", values=values)])


def compare_claims(runs: Sequence[Run]) -> Answers:
    """Compare verdicts on the claims that every run tests."""
    verdicts = [
        {str(row["claim"]): (str(row["says"]), str(row["verdict"])) for row in records(run.tree, "claims", "claim")}
        for run in runs
    ]
    shared = [name for name in verdicts[0] if all(name in one for one in verdicts)]
    return Answers.of(
        [
            Difference(what=f'Claim "{verdicts[0][name][0]}"', values=tuple(one[name][1] for one in verdicts))
            if len({one[name][1] for one in verdicts}) > 1
            else None
            for name in shared
        ]
    )


def compare_questions(runs: Sequence[Run]) -> Answers:
    """Compare answers to inverse questions that every run asks; only shifts beyond their errors count as changes."""
    if not all(has(run.tree, "decision", "solved_says", "solved_answer", "solved_value") for run in runs):
        return Answers.of([])
    rows = [{str(row["solved_says"]): row for row in records(run.tree, "decision", "question")} for run in runs]
    shared = [says for says in rows[0] if all(says in one for one in rows)]
    changed = []
    for says in shared:
        ones = [one[says] for one in rows]
        values = [float(one["solved_value"]) for one in ones]
        errors = [SURE * float(np.nan_to_num(one["solved_error"])) for one in ones]
        if any(
            value != values[0] and not abs(value - values[0]) <= np.hypot(error, errors[0])
            for value, error in zip(values[1:], errors[1:], strict=True)
            if not (np.isnan(value) and np.isnan(values[0]))
        ):
            answers = _changed_clauses([str(one["solved_answer"]) for one in ones])
            changed.append(Difference(what=f'Question "{says}"', values=answers))
    return Answers(changed=tuple(changed), unchanged=len(shared) - len(changed))


def _changed_clauses(answers: Sequence[str]) -> tuple[str, ...]:
    """Answers to one question without the clauses, such as those of one camera, that are alike in all of them."""
    clauses = [one.split("; ") for one in answers]
    if len({len(one) for one in clauses}) > 1:
        return tuple(answers)
    changed = [k for k, first in enumerate(clauses[0]) if not all(are_alike(first, one[k]) for one in clauses)]
    return tuple("; ".join(one[k] for k in changed) or "; ".join(one) for one in clauses)


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


def compare_best(runs: Sequence[Run]) -> tuple[tuple[Difference, ...], bool]:
    """Where the runs name different best cameras, and whether errors of the switches explain further differences."""
    winners = [list(reported_winners(run.tree)) for run in runs]
    ranges = list(_ranges(winners, common_range(runs)))
    edges = [edge for run, found in zip(runs, winners, strict=True) for edge in _edges(run.tree, found)]
    # An end is that of a usable range where any run has no usable camera beyond it.
    shown = shown_ends([(one.near, one.far, TIED.join(one.names) if all(one.names) else "") for one in ranges])
    differing = [one for one in ranges if one.differs]
    changed = [one for one in differing if not _is_explained(one, edges)]
    titles = titles_of(runs)
    what = "Best camera, as declared" if any(swept(group(run.tree, "depth")) for run in runs) else "Best camera"
    rest = "; otherwise unchanged" if len(changed) < len(ranges) else ""
    unexplained = tuple(
        Difference(
            what=what,
            values=tuple(answer_title(titles, name, NOBODY) for name in one.names),
            where=f"from {span(*ends)}{rest if one is changed[-1] else ''}",
        )
        for one, ends in zip(ranges, shown, strict=True)
        if one in changed
    )
    return unexplained, len(changed) < len(differing)


def common_range(runs: Sequence[Run], of: str = "decision") -> tuple[float, float]:
    """The distances [m] between which every run has the results of a group."""
    ends = [group(run.tree, of)["distance"].values[[0, -1]] for run in runs]
    return float(max(near for near, _ in ends)), float(min(far for _, far in ends))


def _ranges(winners: Sequence[Sequence[Winner]], ends: tuple[float, float]) -> Iterator[BestBetween]:
    """The common distances, split wherever any run switches its best camera; equal neighbours are joined."""
    edges = {at for found in winners for start, stop, _ in found for at in (start, stop) if ends[0] < at < ends[1]}
    cuts = sorted({*ends, *edges})
    ranges = []
    for near, far in itertools.pairwise(cuts):
        middle = float(np.sqrt(near * far))
        # The range that contains the middle, or the nearest one where a sliver is not reported.
        nearest = [min(found, key=lambda one: max(one[0] - middle, middle - one[1])) for found in winners]
        ranges.append(BestBetween(near=near, far=far, names=tuple(names for _, _, names in nearest)))
    for names, members in itertools.groupby(ranges, key=lambda one: one.names if one.differs else None):
        stretch = list(members)
        yield BestBetween(near=stretch[0].near, far=stretch[-1].far, names=stretch[0].names if names is None else names)


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
    every = np.asarray(group(tree, "decision")["distance"].values, dtype=np.float64)
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


NOWHERE: Final = "nowhere"


@dataclass(frozen=True, kw_only=True)
class UsableStretch:
    """Distances [m] between which a camera is usable, the errors of these ends, and the limits that set them."""

    ends: tuple[float, float]
    errors: tuple[float, float]
    limits: tuple[str, str]


def compare_usable(runs: Sequence[Run]) -> Answers:
    """Compare usable ranges in the declared design."""
    keys, titles = common_cameras(runs, "depth"), titles_of(runs)
    if not keys or not all(nominal_is_declared(run.tree) for run in runs):
        return Answers.of([])
    low, high = common_range(runs, "depth")
    found = []
    for key in keys:
        shares = [left_out_share(run.tree, key, "usable_range") for run in runs]
        usable = [_usable(nominal(run.tree), key, share) for run, share in zip(runs, shares, strict=True)]
        shared = [
            [
                replace(one, ends=(max(one.ends[0], low), min(one.ends[1], high)))
                for one in stretches
                if one.ends[0] < high and one.ends[1] > low
            ]
            for stretches in usable
        ]
        found.append(_compared(f"Usable range of {titles[key]}", shared))
    return Answers.of(found)


def compare_sharp(runs: Sequence[Run]) -> Answers:
    """Compare the ranges where cameras are sharp by the first blur criterion."""
    keys, titles = common_cameras(runs, "depth_of_field"), titles_of(runs)
    return Answers.of(
        [_compared(f"Sharp range of {titles[key]}", [_sharp(run.tree, key) for run in runs]) for key in keys]
    )


def _sharp(tree: xr.DataTree, key: str) -> list[UsableStretch]:
    share = left_out_share(tree, key, "depth_of_field")
    return [
        UsableStretch(ends=(near, far), errors=(_error(near, 0.0, share), _error(far, 0.0, share)), limits=("", ""))
        for near, far in sharp_ranges(by_first_criterion(tree).sel(camera=key), "sharp")
    ]


def _usable(depth: xr.Dataset, key: str, share: float) -> list[UsableStretch]:
    one = depth.sel(camera=key)
    columns = ("usable_near", "usable_far", "usable_near_error", "usable_far_error", "near_limit", "far_limit")
    return [
        UsableStretch(
            ends=(float(near), float(far)),
            errors=(_error(near, near_error, share), _error(far, far_error, share)),
            limits=(str(begins), str(ends)),
        )
        for near, far, near_error, far_error, begins, ends in zip(*(one[name].values for name in columns), strict=True)
        if np.isfinite(near)
    ]


def _error(end: float, error: float, share: float) -> float:
    """Error of an end [m]; an unknown error counts as zero."""
    return SURE * float(np.nan_to_num(error, posinf=np.inf)) + (share + ROUNDING) * (end if np.isfinite(end) else 0.0)


def _moved_ends(first: Sequence[UsableStretch], other: Sequence[UsableStretch]) -> list[int]:
    """Which ends differ by more than both errors, 0 near and 1 far; both where the number of stretches differs."""
    if len(first) != len(other):
        return [0, 1]
    return [
        end
        for end in (0, 1)
        if any(
            a.ends[end] != b.ends[end] and abs(a.ends[end] - b.ends[end]) > np.hypot(a.errors[end], b.errors[end])
            for a, b in zip(first, other, strict=True)
        )
    ]


def _compared(what: str, found: Sequence[Sequence[UsableStretch]]) -> Difference | None:
    moved = sorted({end for other in found[1:] for end in _moved_ends(found[0], other)})
    if not moved:
        return None
    values = tuple(listed([span(*within(*one.ends)) for one in stretches]) or NOWHERE for stretches in found)
    limits = [
        f"{name} end set by {limit}"
        for end, name in enumerate(("near", "far"))
        if end in moved and (limit := _limit_words(found, end))
    ]
    return Difference(what=what, values=values, where=f"({'; '.join(limits)})" if limits else "")


def _limit_words(found: Sequence[Sequence[UsableStretch]], end: int) -> str:
    """The limit that sets an end in every run, if each run has a single range."""
    if any(len(stretches) != 1 for stretches in found):
        return ""
    limits = dict.fromkeys(stretches[0].limits[end].replace("_", " ") for stretches in found)
    return ARROW.join(f"the {one}" for one in limits if one)

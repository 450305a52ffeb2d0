"""Conclusions that changed: answers to the questions of a study, best cameras, and the ranges where cameras serve."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
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
from tradestudy.results.views.depth import by_first_criterion, nominal, nominal_is_declared, sharp_ranges, swept
from tradestudy.results.views.groups import group, has, records
from tradestudy.results.views.headline import headline
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


Changes = list[Difference | None]
"""The differences of the answers of one kind; None for each that did not change."""


@dataclass(frozen=True, kw_only=True)
class Answer:
    """One answer of a run: what it is about, what it says, and what has to be the same or within the errors of both."""

    what: str
    says: str
    decides: str = ""
    value: float = math.nan
    error: float = 0.0

    def is_same(self, other: Answer) -> bool:
        """Whether both decide the same, with values that are equal, unknown, or within their errors."""
        are_unknown = math.isnan(self.value) and math.isnan(other.value)
        is_near = self.value == other.value or abs(self.value - other.value) <= math.hypot(self.error, other.error)
        return self.decides == other.decides and (are_unknown or is_near)


def _measurements(tree: xr.DataTree) -> dict[str, Answer]:
    """How measured depth errors compare with the predicted ones, by table."""
    findings = {table.name: table.finding("the camera") for table in measured_tables(tree)}
    return {name: Answer(what=f"Measurements {name}", says=says, decides=says) for name, says in findings.items()}


def ranks(tree: xr.DataTree) -> dict[str, Answer]:
    """The candidate that ranks first for most of the possible weights."""
    return {
        what: Answer(
            what=what,
            says=f"{candidate.title} (for {pretty(candidate.ranks[0], FRACTION, digits=2)} of the weights)",
            decides=candidate.title,
        )
        for what, candidate in zip(["Ranked first by all criteria"], candidates_by_rank(tree), strict=False)
    }


def _claims(tree: xr.DataTree) -> dict[str, Answer]:
    """The verdicts on claims."""
    return {
        str(row["claim"]): Answer(what=f'Claim "{row["says"]}"', says=str(row["verdict"]), decides=str(row["verdict"]))
        for row in records(tree, "claims", "claim")
    }


def _questions(tree: xr.DataTree) -> dict[str, Answer]:
    """The answers to inverse questions, with their standard errors."""
    if not has(tree, "decision", "solved_says", "solved_answer", "solved_value"):
        return {}
    return {
        str(row["solved_says"]): Answer(
            what=f'Question "{row["solved_says"]}"',
            says=str(row["solved_answer"]),
            value=float(row["solved_value"]),
            error=SURE * float(np.nan_to_num(row["solved_error"])),
        )
        for row in records(tree, "decision", "question")
    }


KINDS: Final = (
    (_measurements, "measured table", "measured tables"),
    (ranks, "ranking by criteria", "rankings by criteria"),
    (_claims, "claim", "claims"),
    (_questions, "answer to a question", "answers to questions"),
)
"""Kinds of answers: how a run gives them, and the words for one and for several."""


def compare_answers(by_run: Sequence[Mapping[str, Answer]]) -> Changes:
    """Compare the answers of one kind that every run gives, by their names."""
    shared = [[answers[name] for answers in by_run] for name in by_run[0] if all(name in answers for answers in by_run)]
    return [
        None
        if all(first.is_same(other) for other in others)
        else Difference(what=first.what, values=changed_clauses([first.says, *(other.says for other in others)]))
        for first, *others in shared
    ]


def compared_headline(trees: Sequence[xr.DataTree], changed: int) -> str:
    """How the answer differs between runs of which so many conclusions differ; empty where no run has an answer."""
    answers = [headline(tree).removesuffix(".") for tree in trees]
    if len(set(answers)) > 1 and changed:
        quoted = (f"“{answer}”" if answer else "none" for answer in changed_clauses(answers))
        return f"The answer changes from {' to '.join(quoted)}."
    others = f", but {counted(changed, 'conclusion')} changed" if changed else ""
    return f"The answer stays “{answers[0]}”{others}." if any(answers) else ""


def changed_clauses(answers: Sequence[str]) -> tuple[str, ...]:
    """Answers without the clauses, such as those of one camera, that are alike in all of them."""
    clauses = [answer.split("; ") for answer in answers]
    if len({len(parts) for parts in clauses}) > 1:
        return tuple(answers)
    changed = [k for k, first in enumerate(clauses[0]) if not all(are_alike(first, parts[k]) for parts in clauses)]
    return tuple("; ".join(parts[k] for k in changed) or "; ".join(parts) for parts in clauses)


def compare_requirements(runs: Sequence[Run]) -> Changes:
    """Compare verdicts on requirements, the cameras that decide them, and, in sweeps, the designs that meet them."""
    by_run = [{conclusion.name: conclusion for conclusion in requirement_conclusions(run.tree)} for run in runs]
    names = dict.fromkeys(name for conclusions in by_run for name in conclusions)
    each: list[Changes] = [list(_of_requirement([conclusions.get(name) for conclusions in by_run])) for name in names]
    return [difference for differences in each for difference in differences or [None]]


def _of_requirement(conclusions: Sequence[RequirementConclusion | None]) -> Iterator[Difference]:
    asked = [conclusion for conclusion in conclusions if conclusion is not None]
    what = f'Requirement "{same_or_each([conclusion.says for conclusion in asked])}"'
    verdicts = tuple(NOT_ASKED if conclusion is None else conclusion.verdict for conclusion in conclusions)
    deciding = [decided_by(conclusion) for conclusion in asked]
    if len(set(verdicts)) > 1:
        bound = "; its bound differs" if len({conclusion.bound for conclusion in asked}) > 1 else ""
        yield Difference(what=what, values=verdicts, where=f"({_reasons(asked)}{bound})")
    elif len(set(deciding)) > 1:
        yield Difference(
            what=what,
            values=tuple(f"{conclusion.verdict}, {by}" for conclusion, by in zip(asked, deciding, strict=True)),
        )
    if len(asked) == len(conclusions):
        yield from _of_designs(what, asked)


def _reasons(conclusions: Sequence[RequirementConclusion]) -> str:
    """The worst value in each run, with its camera and distance; what the runs share is stated once."""
    cameras = [conclusion.camera for conclusion in conclusions]
    if len(set(cameras)) > 1:
        return ARROW.join(f"{conclusion.camera}: {conclusion.reason}" for conclusion in conclusions)
    reasons = list(dict.fromkeys(conclusion.reason for conclusion in conclusions))
    heads, places = zip(*(reason.rpartition(" at ")[::2] for reason in reasons), strict=True)
    if len(reasons) > 1 and len(set(places)) == 1 and all(head.startswith(_WORST) for head in heads):
        values = ARROW.join(head.removeprefix(_WORST) for head in heads)
        return f"{cameras[0]}: {_WORST}{values} at {places[0]}"
    return f"{cameras[0]}: {ARROW.join(reasons)}"


def _of_designs(what: str, conclusions: Sequence[RequirementConclusion]) -> Iterator[Difference]:
    """The ranges of a single swept number in which the requirement is met; else the number of designs."""
    ranges = [conclusion.met_ranges for conclusion in conclusions if conclusion.met_ranges is not None]
    parameters = {met_range.parameter for met_ranges in ranges for met_range in met_ranges}
    designs = [conclusion.designs for conclusion in conclusions if conclusion.designs is not None]
    if len(ranges) == len(conclusions):
        if len(parameters) == 1 and _moved([list(map(_met_stretch, met_ranges)) for met_ranges in ranges]):
            values = tuple("met " + (" and ".join(_range_words(met_ranges)) or _NOWHERE) for met_ranges in ranges)
            yield Difference(what=f"{what}, over the {parameters.pop()}", values=values)
    elif len(designs) == len(conclusions) and len(set(designs)) > 1:
        yield Difference(
            what=f"{what}, over all designs",
            values=tuple(f"met by {met} of {counted(count, 'design')}" for met, count in designs),
        )


def _met_stretch(met_range: MetRange) -> Stretch:
    return Stretch(
        ends=(met_range.low, met_range.high), errors=(met_range.error, met_range.error), camera=met_range.camera
    )


def _range_words(met_ranges: Sequence[MetRange]) -> list[str]:
    several = len({met_range.camera for met_range in met_ranges}) > 1
    return [met_range.words + (f" by {met_range.camera}" if several else "") for met_range in met_ranges]


NOBODY = "no usable camera"
Winner = tuple[float, float, str]
Between = tuple[float, float, tuple[str, ...]]
"""Distances [m] between which no run switches its best camera, and the best cameras there in each run."""


def compare_best(runs: Sequence[Run]) -> tuple[tuple[Difference, ...], str]:
    """Where the runs name different best cameras; else, in words, that they do not, where any names one.

    Differences that the errors of the switches explain do not count.
    """
    if not all(has(run.tree, "decision", "best_camera") and has(run.tree, "depth") for run in runs):
        return (), ""
    near, far = common_range(runs)
    if near >= far:
        return (), ""
    winners = [list(reported_winners(run.tree)) for run in runs]
    ranges = list(_ranges(winners, (near, far)))
    errors = {place: error for run, won in zip(runs, winners, strict=True) for place, error in _switches(run.tree, won)}
    # An end is that of a usable range where any run has no usable camera beyond it.
    shown = list(shown_ends([(near, far, TIED.join(names) if all(names) else "") for near, far, names in ranges]))
    differing = [k for k, (_, _, names) in enumerate(ranges) if _differ(names)]
    changed = [k for k in differing if not _is_explained(*ranges[k][:2], errors)]
    titles = titles_of(runs)
    what = "Best camera, as declared" if any(swept(group(run.tree, "depth")) for run in runs) else "Best camera"
    rest = "; otherwise unchanged" if len(changed) < len(ranges) else ""
    unexplained = tuple(
        Difference(
            what=what,
            values=tuple(answer_title(titles, answer, NOBODY) for answer in ranges[k][2]),
            where=f"from {span(*shown[k])}{rest if k == changed[-1] else ''}",
        )
        for k in changed
    )
    close = ", within the error of its switch distances" if differing else ""
    return unexplained, "" if changed else f"the best camera from {span(near, far)}{close}"


def common_range(runs: Sequence[Run], group_name: str = "decision") -> tuple[float, float]:
    """The distances [m] between which every run has the results of a group."""
    ends = [group(run.tree, group_name)["distance"].values[[0, -1]] for run in runs]
    return float(max(near for near, _ in ends)), float(min(far for _, far in ends))


def _differ(answers: Sequence[str]) -> bool:
    return len({frozenset(tied(answer)) for answer in answers}) > 1


def _ranges(winners: Sequence[Sequence[Winner]], ends: tuple[float, float]) -> Iterator[Between]:
    """The common distances, split wherever any run switches its best camera; equal neighbours are joined."""
    edges = {edge for won in winners for start, stop, _ in won for edge in (start, stop) if ends[0] < edge < ends[1]}
    ranges = []
    for near, far in itertools.pairwise(sorted({*ends, *edges})):
        middle = math.sqrt(near * far)
        # The range that contains the middle, or the nearest one where a sliver is not reported.
        nearest = [min(won, key=lambda stretch: max(stretch[0] - middle, middle - stretch[1])) for won in winners]
        ranges.append((near, far, tuple(names for _, _, names in nearest)))
    # Where all runs agree, a switch that all of them make divides nothing.
    for _, members in itertools.groupby(ranges, key=lambda between: between[2] if _differ(between[2]) else None):
        stretch = list(members)
        yield stretch[0][0], stretch[-1][1], stretch[0][2]


def _is_explained(near: float, far: float, errors: Mapping[float, float]) -> bool:
    """Whether both ends read the same in words, or are apart by no more than the errors of switches there."""
    return distance(near) == distance(far) or far - near <= errors.get(near, 0.0) + errors.get(far, 0.0)


def _switches(tree: xr.DataTree, won: Sequence[Winner]) -> Iterator[tuple[float, float]]:
    """Where the best camera switches [m]; the error is that of the root or, without one, the gap of two distances."""
    decision, depth, exact = group(tree, "decision"), nominal(tree), {}
    distances = np.asarray(decision["distance"].values, dtype=np.float64)
    is_declared = nominal_is_declared(tree)  # else the curves belong to another design than the decision
    if "crossover_distance" in decision:
        declared = decision.isel(reading=0).sel(error_source="both")
        exact = dict(zip(declared["crossover_distance"].values, SURE * declared["crossover_error"].values, strict=True))
    for camera in map(str, depth["camera"].values) if is_declared else ():
        for stretch in _usable(depth, camera, left_out_share(tree, camera, "usable_range")):
            exact |= dict(zip(stretch.ends, stretch.errors, strict=True))
    for (_, place, before), (_, _, after) in itertools.pairwise(won):
        # A switch without a root lies somewhere between two computed distances.
        index = int(np.clip(np.searchsorted(distances, place), 1, distances.size - 1))
        exact_error = exact.get(place, math.nan)
        error = exact_error if math.isfinite(exact_error) else float(distances[index] - distances[index - 1])
        cameras = {*tied(before), *tied(after)}
        yield place, error + (_moved_by_models(tree, depth, place, cameras) if is_declared else 0.0)


def _moved_by_models(tree: xr.DataTree, depth: xr.Dataset, place: float, cameras: set[str]) -> float:
    """How far the crossover of two curves moves [m] if each shifts by what its models leave out."""
    shares = [left_out_share(tree, camera, "depth_uncertainty") for camera in cameras]
    if len(cameras) != 2 or not any(shares):
        return 0.0
    first, second = (judged_uncertainty(depth).sel(camera=camera).values for camera in sorted(cameras))
    bounded = np.isfinite(first) & np.isfinite(second)
    if np.count_nonzero(bounded) < 2:
        return 0.0
    log_distance = np.log(np.asarray(depth["distance"].values, dtype=np.float64)[bounded])
    # The curves cross where their ratio is 1; on logarithmic scales, a shift moves that by the shift over the slope.
    slopes = np.gradient(np.log(first[bounded] / second[bounded]), log_distance)
    slope = abs(float(np.interp(np.log(place), log_distance, slopes)))
    return place * math.hypot(*shares) / slope if slope else math.inf


NOWHERE: Final = "nowhere"


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """A range of distances [m] or of a swept number, the errors of its ends, the limits that set them, its camera."""

    ends: tuple[float, float]
    errors: tuple[float, float]
    limits: tuple[str, str] = ("", "")
    camera: str = ""


def compare_usable(runs: Sequence[Run]) -> Changes:
    """Compare usable ranges in the declared design."""
    keys, titles = common_cameras(runs, "depth"), titles_of(runs)
    if not keys or not all(nominal_is_declared(run.tree) for run in runs):
        return []
    ends = common_range(runs, "depth")
    return [
        _compared(
            f"Usable range of {titles[key]}",
            [_usable(nominal(run.tree), key, left_out_share(run.tree, key, "usable_range"), ends) for run in runs],
        )
        for key in keys
    ]


def compare_sharp(runs: Sequence[Run]) -> Changes:
    """Compare the ranges where cameras are sharp by the first blur criterion."""
    keys, titles = common_cameras(runs, "depth_of_field"), titles_of(runs)
    return [_compared(f"Sharp range of {titles[key]}", [_sharp(run.tree, key) for run in runs]) for key in keys]


def _sharp(tree: xr.DataTree, key: str) -> list[Stretch]:
    share = left_out_share(tree, key, "depth_of_field")
    ranges = sharp_ranges(by_first_criterion(tree).sel(camera=key), "sharp")
    return [
        Stretch(ends=(near, far), errors=(_error(near, 0.0, share), _error(far, 0.0, share))) for near, far in ranges
    ]


def _usable(depth: xr.Dataset, key: str, share: float, between: tuple[float, float] = (0.0, math.inf)) -> list[Stretch]:
    """The usable ranges of a camera between two distances [m]."""
    camera, (low, high) = depth.sel(camera=key), between
    columns = ("usable_near", "usable_far", "usable_near_error", "usable_far_error", "near_limit", "far_limit")
    return [
        Stretch(
            ends=(max(float(near), low), min(float(far), high)),
            errors=(_error(near, near_error, share), _error(far, far_error, share)),
            limits=(str(begins), str(ends)),
        )
        for near, far, near_error, far_error, begins, ends in zip(
            *(camera[column].values for column in columns), strict=True
        )
        if near < high and far > low
    ]


def _error(end: float, error: float, share: float) -> float:
    """Error of an end [m]; an unknown error counts as zero."""
    return SURE * float(np.nan_to_num(error, posinf=np.inf)) + (share + ROUNDING) * (end if np.isfinite(end) else 0.0)


def _moved(by_run: Sequence[Sequence[Stretch]]) -> list[int]:
    """Which ends, 0 near and 1 far, differ from the first run by more than both errors; both if the ranges differ."""
    first, *others = by_run
    return [
        end
        for end in (0, 1)
        if any(
            [stretch.camera for stretch in first] != [stretch.camera for stretch in other]
            or any(
                abs(a.ends[end] - b.ends[end]) > a.errors[end] + b.errors[end]
                for a, b in zip(first, other, strict=True)
            )
            for other in others
        )
    ]


def _compared(what: str, by_run: Sequence[Sequence[Stretch]]) -> Difference | None:
    moved = _moved(by_run)
    values = tuple(listed([span(*within(*stretch.ends)) for stretch in stretches]) or NOWHERE for stretches in by_run)
    limits = [
        f"{side} end set by {limit}"
        for end, side in enumerate(("near", "far"))
        if end in moved and (limit := _limit_words(by_run, end))
    ]
    return Difference(what=what, values=values, where=f"({'; '.join(limits)})" if limits else "") if moved else None


def _limit_words(by_run: Sequence[Sequence[Stretch]], end: int) -> str:
    """The limit that sets an end in every run, if each run has a single range."""
    if any(len(stretches) != 1 for stretches in by_run):
        return ""
    limits = dict.fromkeys(stretches[0].limits[end].replace("_", " ") for stretches in by_run)
    return ARROW.join(f"the {limit}" for limit in limits if limit)

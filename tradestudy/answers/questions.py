"""Inverse questions: the value of an input at which two uncertainties are equal, or a bound or requirement is met."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np
import xarray as xr

from tradestudy.answers.requirement_answer import RequirementAnswer
from tradestudy.answers.requirements import ANY, Judge
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.depth.evaluation import distribution
from tradestudy.errors import NotConvergedError
from tradestudy.execution.steps import Progress
from tradestudy.optics.arrays import FloatArray
from tradestudy.results import dataset
from tradestudy.study.bases import rests_in_words
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.schema.questions import SolvePart
from tradestudy.study.varying import Varying, quantity_entry, question_ends
from tradestudy.units import (
    FRACTION,
    LENGTH,
    PIXELS,
    Dimension,
    pretty,
    pretty_with_error,
    rounded_inwards,
    shows_error,
    significant,
)
from tradestudy.wording import DECLARED_VALUE, listed, with_article


def bracketed(
    inside: float,
    outside: float,
    holds: Callable[[float], bool | None],
    *,
    possible: Callable[[float], float],
    close: float,
) -> tuple[float, float]:
    """The last value found at which a condition holds, and the next one at which it does not.

    Parameters
    ----------
    inside, outside
        Where it holds, and where it does not; either may be the larger.
    holds
        Whether it holds at a value; None if this cannot be known, which ends the search.
    possible
        The permitted value nearest to a value, such as a whole number.
    close
        Relative distance of the two values at which the search ends.
    """
    while abs(outside - inside) > close * max(abs(inside), abs(outside)):
        middle = possible((inside + outside) / 2.0)
        if middle in (inside, outside):
            break
        kept = holds(middle)
        if kept is None:
            break
        inside, outside = (middle, outside) if kept else (inside, middle)
    return inside, outside


PLANS: Final = range(8)
"""The arrangements of the views from which the scatter of an answer is estimated; the first is that of the run."""


def planned(definition: StudyDefinition, plan: int = 0) -> StudyDefinition:
    """The study with the calibrations expected from its targets, where none has been inferred yet.

    Raises
    ------
    TradestudyError
        A target is seen in too few views.
    """
    asked = definition.calibrations_to_infer()
    if not asked:
        return definition
    from tradestudy.calibration.camera_target import TargetToInfer, planned_calibration

    return definition.with_posteriors(
        {key: planned_calibration(one, plan) for key, one in asked.items() if isinstance(one, TargetToInfer)}
    )


def to_be_planned(definition: StudyDefinition, varying: Varying) -> StudyDefinition:
    """The study without calibrations inferred from targets that a question varies, to make its values comparable."""
    varied = varied_calibrations(definition, varying)
    kept = {key: posterior for key, posterior in definition.posteriors.items() if key not in varied}
    return replace(definition, posteriors=kept, before=definition)


def varied_calibrations(definition: StudyDefinition, varying: Varying) -> set[str]:
    """Keys of the inferred calibrations that a question varies."""
    keys = definition.posterior_keys
    ends = [definition.with_values(varying.changes(end)).posterior_keys for end in (varying.low, varying.high)]
    return {keys[name] for name in keys if any(end.get(name) != keys[name] for end in ends)}


def plans(definition: StudyDefinition) -> range:
    """The arrangements of the views to try: only the first if nothing needs planning or every pose is given."""
    from tradestudy.calibration.camera_target import TargetToInfer

    asked = definition.calibrations_to_infer().values()
    is_spread = any(isinstance(one, TargetToInfer) and one.part.poses is None for one in asked)
    return PLANS if is_spread else PLANS[:1]


_ROOT_TOLERANCE: Final = 1e-10
_ROUNDING: Final = 1e-12
_PLACES: Final = 9  # values tried between the ends of a question
_EXTRAPOLATED: Final = 2.0  # lengths of the interval, on a logarithmic scale, by which a solution may lie beyond it
_LOG_OF_UNBOUNDED: Final = 700.0  # represents the logarithm of the ratio to an unbounded width


@dataclass(frozen=True, kw_only=True)
class Solution:
    """A value that answers an inverse question, with its standard error, in the SI unit of the varied input."""

    value: float
    error: float


@dataclass(frozen=True, kw_only=True)
class Solved:
    """Every solution of an inverse question within its ends, ascending, with the answer in words.

    `tried` has the values at which the depth uncertainty [m] of a camera was computed, each with that uncertainty (the
    geometric mean over scrambles or plans), for a question that gives it a required value; otherwise it is empty.
    `rests_on` names the input that decides the variance at the first solution, and `share` is its share of it; empty
    and NaN where none is known to.
    """

    solutions: tuple[Solution, ...]
    dimension: Dimension
    answer: str
    tried: tuple[tuple[float, float], ...] = ()
    rests_on: str = ""
    share: float = math.nan

    @property
    def value(self) -> float:
        """The first solution; NaN if there is none."""
        return self.solutions[0].value if self.solutions else math.nan

    @property
    def error(self) -> float:
        """Its standard error."""
        return self.solutions[0].error if self.solutions else math.nan


def solve(definition: StudyDefinition, question: SolvePart) -> Solved:
    """Find the values of an input that make two depth uncertainties equal at a distance, or give one a required value.

    The ratio of the uncertainties is computed at nine values between the declared ends. Wherever it passes one between
    two of them, Brent's method finds the crossing on a logarithmic scale, in each scramble of the draws. Two crossings
    between neighbouring values are not seen. For whole numbers, such as a number of views, the answer is the first that
    is certain enough. If the question varies the target of a calibration, the calibration is planned for eight
    arrangements of the views, and the error is that of their mean.

    Raises
    ------
    OutOfRangeError
        The ends do not share a unit, or the varied path does not exist.
    NotConvergedError
        The root finder fails.
    """
    varying = Varying.of(definition, question)
    dimension, low, high = varying.dimension, varying.low, varying.high
    ratios = _Ratios(to_be_planned(definition, varying), question, varying)
    places = [math.log(varying.possible(math.exp(log))) for log in np.linspace(math.log(low), math.log(high), _PLACES)]
    places = list(dict.fromkeys(places))
    means = np.array([ratios.mean(log) for log in places])
    tried: tuple[tuple[float, float], ...] = ()
    if question.equal is None:
        widths = np.where(means >= _LOG_OF_UNBOUNDED, np.inf, question.goal * np.exp(means))
        tried = tuple(zip(map(math.exp, places), widths.tolist(), strict=True))
    if np.all(np.abs(means) <= _ROUNDING):
        throughout = "equal throughout" if question.equal is not None else f"exactly {_goal_words(question)} throughout"
        answer = f"{throughout}, from {pretty(low, dimension)} to {pretty(high, dimension)}"
        return Solved(solutions=(), dimension=dimension, answer=answer, tried=tried)
    find = ratios.whole_number if varying.is_counted else ratios.crossing
    found = [
        find((places[k], places[k + 1]))
        for k in range(len(places) - 1)
        if means[k] * means[k + 1] <= 0.0 and (means[k] != 0.0 or k == 0)  # a root at a tried value counts once
    ]
    if not found and np.isnan(means).any():  # a claim about all values would be unfounded
        return Solved(solutions=(), dimension=dimension, answer=_undecided(question))
    if not found:
        answer = _nowhere(definition, question, (low, high), means)
        if question.equal is None and question.errors != "noise" and np.all(means > 0.0):
            best = math.exp(places[int(np.argmin(means))])
            answer += _larger_noise(definition.with_values(varying.changes(best)), question)
        return Solved(solutions=(), dimension=dimension, answer=answer, tried=tried)
    answer = _answer(definition, question, found, is_counted=varying.is_counted)
    if ratios.plans > 1:
        answer += f"; mean over {ratios.plans} arrangements of the calibration views"
    rests, share = "", math.nan
    if question.errors == "calibration" and question.equal is None:
        answer += _larger_noise(definition.with_values(varying.changes(found[0].value)), question)
        rests, share = _corner_noise(ratios.changed(math.log(found[0].value)), question)
    return Solved(solutions=tuple(found), dimension=dimension, answer=answer, tried=tried, rests_on=rests, share=share)


class _Ratios:
    """Logarithm of the ratio of the uncertainty to its target, against the logarithm of the varied value."""

    def __init__(self, definition: StudyDefinition, question: SolvePart, varying: Varying) -> None:
        self._definition, self._question, self._varying = definition, question, varying
        self._plans = plans(definition)
        self._known: dict[tuple[float, int], FloatArray] = {}

    @property
    def plans(self) -> int:
        """Number of arrangements of the views for which a calibration is planned; 1 if none is."""
        return len(self._plans)

    def mean(self, log_value: float) -> float:
        """Mean over all scrambles, or all plans of a calibration."""
        return float(np.mean(self._all(log_value)))

    def crossing(self, logs: tuple[float, float]) -> Solution:
        """Where the ratio passes one between two values: mean and standard error over the scrambles or plans."""
        count = max(len(self._all(log)) for log in logs)
        roots = np.exp(
            [_root(partial(self._one, k), self._nearest(k, logs), self._question.says) for k in range(count)]
        )
        return Solution(value=float(np.mean(roots)), error=_error_of_mean(roots))

    def _nearest(self, number: int, logs: tuple[float, float]) -> tuple[float, float]:
        """The closest values, tried for other scrambles, between which this one passes one."""
        own = number if self.plans > 1 else 0
        tried = sorted(log for log, plan in self._known if plan == own and logs[0] <= log <= logs[1])
        ratios = [self._one(number, log) for log in tried]
        passed = [k for k, (one, other) in enumerate(itertools.pairwise(ratios)) if one * other <= 0.0]
        return (tried[passed[0]], tried[passed[0] + 1]) if passed else logs

    def whole_number(self, logs: tuple[float, float]) -> Solution:
        """The whole number next to the crossing on the side that meets the limit; error over scrambles or plans."""
        count = max(len(self._all(log)) for log in logs)
        certain, other = sorted(logs, key=self.mean)
        each = [self._last_whole(partial(self._one, k), (certain, other)) for k in range(count)]
        return Solution(value=self._last_whole(self.mean, (certain, other)), error=_error_of_mean(np.array(each)))

    def _last_whole(self, log_ratio: Callable[[float], float], logs: tuple[float, float]) -> float:
        certain, other = (float(round(math.exp(log))) for log in logs)
        if log_ratio(logs[0]) > 0.0 or log_ratio(logs[1]) <= 0.0:  # this scramble or plan crosses beyond an end
            return certain if log_ratio(logs[0]) > 0.0 else other
        possible = self._varying.possible
        return bracketed(certain, other, lambda one: log_ratio(math.log(one)) <= 0.0, possible=possible, close=0.0)[0]

    def _one(self, number: int, log_value: float) -> float:
        """The ratio in one scramble or one plan; a linear model is the same in all scrambles."""
        if self.plans > 1:
            return float(np.mean(self.at_plan(log_value, number)))
        ratios = self.at_plan(log_value, 0)
        return float(ratios[min(number, len(ratios) - 1)])

    def _all(self, log_value: float) -> FloatArray:
        if self.plans > 1:
            return np.array([self._one(plan, log_value) for plan in self._plans])
        return self.at_plan(log_value, 0)

    def at_plan(self, log_value: float, plan: int) -> FloatArray:
        """The ratio at a value in one plan of a calibration; (scrambles,)."""
        key = (log_value, plan)
        if key not in self._known:
            self._known[key] = _log_ratios(planned(self.changed(log_value), plan), self._question)
        return self._known[key]

    def changed(self, log_value: float) -> StudyDefinition:
        """The study with a value, before its calibrations are planned."""
        varying = self._varying
        value = min(max(math.exp(log_value), varying.low), varying.high)  # rounding may carry it beyond an end
        return self._definition.with_values(varying.changes(value))


def _error_of_mean(values: FloatArray) -> float:
    return float(np.std(values, ddof=1) / math.sqrt(len(values))) if len(values) > 1 else 0.0


def _root(log_ratio: Callable[[float], float], logs: tuple[float, float], says: str) -> float:
    ends = [log_ratio(log) for log in logs]
    if ends[0] * ends[1] > 0.0:  # in this scramble the root lies beyond an end
        return logs[int(abs(ends[1]) < abs(ends[0]))]
    from scipy.optimize import brentq  # takes half a second to load, and only `solve` needs it

    root, report = brentq(log_ratio, *logs, xtol=_ROOT_TOLERANCE, full_output=True)
    if not report.converged:
        raise NotConvergedError("no root found for an inverse question", value=says, remedy="narrow its range")
    return float(root)


def _log_ratios(definition: StudyDefinition, question: SolvePart) -> FloatArray:
    """Logarithm of the ratio of the uncertainty to its target; (scrambles,)."""
    cameras = definition.case.cameras
    if question.equal is not None:
        first, second = (_widths(cameras[name], question) for name in question.equal)
    else:
        assert question.camera is not None  # the schema ensures it
        first, second = _widths(cameras[question.camera], question), np.array([question.goal])
    with np.errstate(divide="ignore", invalid="ignore"):  # unbounded intervals are valid
        found = np.log(first) - np.log(second)
    return np.asarray(np.clip(found, -_LOG_OF_UNBOUNDED, _LOG_OF_UNBOUNDED))


def _widths(camera: DepthCamera, question: SolvePart) -> FloatArray:
    """Uncertainty [m] at the distance of the question, in each scramble; draws need to converge only there."""
    asked = replace(camera, propagation=replace(camera.propagation, judged=(question.place,)))
    return distribution(asked, np.array([question.place]), question.errors).judged_widths[:, 0]


def _larger_noise(definition: StudyDefinition, question: SolvePart) -> str:
    """The matching noise, if it alone exceeds what a question requires of the calibration."""
    noise = question.model_copy(update={"errors": "noise"})
    width = float(np.mean(_widths(definition.case.cameras[question.camera or ""], noise)))
    both = f"the matching noise of one measurement, {pretty(width, LENGTH)}, exceeds the goal"
    return f"; {both} of {pretty(question.goal, LENGTH)}" if width > question.goal else ""


_NOISE_STEP: Final = 1.01  # factor of the corner noise on both sides of the declared one
_MOST: Final = 0.5  # of the variance


def _corner_noise(definition: StudyDefinition, question: SolvePart) -> tuple[str, float]:
    """The corner noise of a calibration to be planned, in words, and its share of the variance of depth.

    The planned covariance combines the corners with the errors before the calibration: its logarithmic derivative with
    respect to the variance of the corners is their share. Empty and NaN where this is not most of it.
    """
    from tradestudy.calibration.camera_target import TargetToInfer

    name = question.camera or ""
    asked = {one.name: one for one in definition.calibrations_to_infer().values() if isinstance(one, TargetToInfer)}
    if name not in asked:
        return "", math.nan
    path = ("cameras", name, "calibration", "target", "corner_noise")
    changes = [
        {".".join(path): quantity_entry(asked[name].part.corner_noise * factor, PIXELS)}
        for factor in (1.0 / _NOISE_STEP, _NOISE_STEP)
    ]
    low, high = (_log_ratios(planned(definition.with_values(one)), question)[0] for one in changes)
    share = float(high - low) / (2.0 * math.log(_NOISE_STEP))
    if not share > _MOST:
        return "", math.nan
    title = with_article(definition.file.cameras[name].title)
    return f"corner noise of {title}{rests_in_words(definition, path)}", share


def _undecided(question: SolvePart) -> str:
    """Why the ratio at an end of an inverse question is unknown."""
    where = pretty(question.place, LENGTH)
    if question.equal is not None:
        return f"cannot be decided: at {where} both uncertainties are unbounded, or one camera measures nothing"
    return f"cannot be decided: at {where} nothing is measured"


def _nowhere(
    definition: StudyDefinition, question: SolvePart, ends: tuple[float, float], log_ratios: FloatArray
) -> str:
    """Which camera is more certain throughout, and whether a solution may lie beyond an end."""
    dimension = question_ends(question)[0]
    titles = {name: part.title for name, part in definition.file.cameras.items()}
    between = " to ".join(pretty(end, dimension) for end in ends)
    first_is_certain = bool(np.mean(log_ratios) < 0.0)
    if question.equal is not None:
        outcome = f"{titles[question.equal[0 if first_is_certain else 1]]} is more certain throughout"
    else:
        reaches = "reaches" if first_is_certain else "does not reach"
        outcome = f"{titles[question.camera or '']} {reaches} {_goal_words(question)} with any of them"
    away = np.abs(log_ratios)
    steps = np.diff(away)
    for approaches, end, left, step in (
        (np.all(steps < 0.0), ends[1], away[-1], -steps[-1]),
        (np.all(steps > 0.0), ends[0], away[0], steps[0]),
    ):
        if approaches and left <= _EXTRAPOLATED * _PLACES * step:  # otherwise it levels off before reaching one
            factor = significant(math.exp(float(left)), 2)
            outcome += f"; a solution may lie beyond {pretty(end, dimension)}, where a factor of {factor} remains"
    return f"no value from {between}: {outcome}"


def _goal_words(question: SolvePart) -> str:
    goal = pretty(question.uncertainty, LENGTH) if question.uncertainty is not None else ""
    return f"{goal or pretty(question.relative or 0.0, FRACTION)} at {pretty(question.place, LENGTH)}"


def _answer(definition: StudyDefinition, question: SolvePart, found: Sequence[Solution], *, is_counted: bool) -> str:
    """Every solution with its error, that of a count rounded up to a whole number, and the declared value."""
    dimension = question_ends(question)[0]
    values = [
        f"{one.value:.0f} ± {math.ceil(one.error)}"
        if is_counted and one.error > 0.0
        else pretty_with_error(one.value, one.error, dimension)
        for one in found
    ]
    answer = listed(values) if len(values) == 1 else f"{len(values)} solutions: {listed(values)}"
    return with_declared_value(definition, question, answer)


def with_declared_value(definition: StudyDefinition, question: SolvePart, answer: str) -> str:
    """An answer, followed by the declared value of the varied input if it has one."""
    path = question.paths[0]
    if definition.document.entry(path) is None:
        return answer
    return f"{answer}{DECLARED_VALUE}{definition.document.text_of(path)}"


_TRIED_PLACES: Final = 17  # values tried between the ends of a question
_REFINEMENTS: Final = 4  # halvings of the steps beside the largest margin, if the requirement is met at none of them
_CLOSE: Final = 1e-4  # relative width of the bracket around the value where a requirement ceases to be met


@dataclass(frozen=True, kw_only=True)
class _Trial:
    """The answer to the requirement at one value, in SI."""

    value: float
    answer: RequirementAnswer


def solve_requirement(definition: StudyDefinition, question: SolvePart) -> Solved:
    """Find every value at which a requirement, or the last of several, begins or ceases to be met.

    Where any camera may meet it, each is asked by itself; the solutions are those of the first whose values vary. The
    requirement is evaluated at seventeen values between the declared ends and at the declared value. Where the
    answer changes between two of them, bisection locates the change, because the margin may jump where a camera ceases
    to be usable. Two changes between neighbouring values are not seen. The error combines the final bracket with the
    error of the worst value divided by the slope of its margin.

    Raises
    ------
    OutOfRangeError
        The ends do not share a unit.
    StudyError
        The study is invalid for a value between them.
    """
    varying, judge = Varying.of(definition, question), Judge()
    definition = to_be_planned(definition, varying)
    tried = _Tried(definition=definition, requirements=question.requirements, varying=varying, judge=judge, known={})
    places = {varying.possible(float(value)) for value in np.geomspace(varying.low, varying.high, _TRIED_PLACES)}
    for value in places | varying.declared(definition):
        tried.answer(value)
    for _ in range(_REFINEMENTS):
        for value in _beside_the_nearest({value: tried.answer(value) for value in tried.known}):
            tried.answer(varying.possible(value))
    asked = _cameras_asked(definition, tried)
    varied = {path.removeprefix("cameras.").partition(".")[0] for path in question.paths}
    alone = {name: _solved(tried, definition, name) for name in sorted(asked, key=lambda name: name not in varied)}
    first = next((name for name in alone if name in varied), "")
    solutions, answer = alone[first] if first else _solved(tried, definition)
    if alone:
        each = "; ".join(f"{definition.file.cameras[name].title}: {words}" for name, (_, words) in alone.items())
        answer = each if first else f"{answer}; {each}"
    return Solved(
        solutions=tuple(solutions),
        dimension=varying.dimension,
        answer=with_declared_value(definition, question, answer),
    )


@dataclass(frozen=True, kw_only=True)
class _Tried:
    """The answers to the requirements at the values tried so far, by value in SI."""

    definition: StudyDefinition
    requirements: tuple[str, ...]
    varying: Varying
    judge: Judge
    known: dict[float, list[tuple[RequirementAnswer, Mapping[str, RequirementAnswer]]]]

    def answer(self, value: float, camera: str = "") -> RequirementAnswer:
        """The answer to the requirement that is hardest to meet, of all cameras together or of one alone."""
        if value not in self.known:
            changed = planned(self.definition.with_values(self.varying.changes(value)))
            self.known[value] = [
                self.judge.answer(changed.file.requirements[name], changed.case) for name in self.requirements
            ]
        answers = [every[camera] if camera else deciding for deciding, every in self.known[value]]
        return min(answers, key=lambda one: (one.met is True, one.met is None, np.nan_to_num(one.margin)))


def _cameras_asked(definition: StudyDefinition, tried: _Tried) -> list[str]:
    """The cameras of a requirement on any of several, in their order; none for other requirements."""
    if len(tried.requirements) > 1 or definition.file.requirements[tried.requirements[0]].camera != ANY:
        return []
    ((_, every),) = next(iter(tried.known.values()))
    return list(every) if len(every) > 1 else []


def _solved(tried: _Tried, definition: StudyDefinition, camera: str = "") -> tuple[list[Solution], str]:
    """Where the requirements begin or cease to be met, by all cameras together or by one alone, also in words."""
    varying = tried.varying
    trials = [_Trial(value=value, answer=tried.answer(value, camera)) for value in sorted(tried.known)]
    if undecided := [one.answer.reason for one in trials if one.answer.met is None]:
        return [], f"cannot be decided: {undecided[0]}"
    solutions: list[Solution] = []
    for before, after in itertools.pairwise(trials):
        if before.answer.met == after.answer.met:
            continue
        inside, outside = (before, after) if before.answer.met else (after, before)
        ends = bracketed(
            inside.value,
            outside.value,
            lambda value: tried.answer(value, camera).met,
            possible=varying.possible,
            close=_CLOSE,
        )
        # A count has no values between neighbouring integers.
        bracket = abs(ends[1] - ends[0])
        error = 0.0 if varying.is_counted else _error(tried.answer(ends[0], camera), bracket, before, after)
        solutions.append(Solution(value=ends[0], error=error))
    return solutions, _range_answer(trials, solutions, varying.dimension, varying.declared(definition))


def _error(answer: RequirementAnswer, bracket: float, before: _Trial, after: _Trial) -> float:
    """Half of the bracket, combined with the shift of the end due to the error of the worst value."""
    slope = abs(after.answer.margin - before.answer.margin) / abs(after.value - before.value)
    own = answer.error / abs(answer.value) if answer.error > 0.0 and math.isfinite(answer.value) else 0.0
    return math.hypot(bracket / 2.0, own / slope if slope > 0.0 and math.isfinite(slope) else 0.0)


def _beside_the_nearest(known: Mapping[float, RequirementAnswer]) -> list[float]:
    """Values halfway to the neighbours of that with the largest margin, if it is met nowhere and margins differ."""
    values, margins = sorted(known), [known[value].margin for value in sorted(known)]
    if any(answer.met is not False for answer in known.values()) or _alike(margins):
        return []
    nearest = int(np.argmax(margins))
    beside = {max(nearest - 1, 0), min(nearest + 1, len(values) - 1)} - {nearest}
    return [math.sqrt(values[nearest] * values[k]) for k in beside]


def _alike(margins: Sequence[float]) -> bool:
    return max(margins) - min(margins) <= 1e-9 * max(map(abs, margins))


def _range_answer(
    trials: Sequence[_Trial], solutions: Sequence[Solution], dimension: Dimension, declared: Container[float]
) -> str:
    """The values for which it is met; if there are none, how close it comes and whether it may be met beyond an end."""
    ends = [pretty(trials[k].value, dimension) for k in (0, -1)]
    if not solutions:
        between = f"between {ends[0]} and {ends[1]}"
        return (
            f"met everywhere {between}"
            if trials[0].answer.met
            else f"met nowhere {between}: {_nearest(trials, dimension, declared)}"
        )
    changes = [None, *solutions] if trials[0].answer.met else solutions
    parts = []
    for low, high in itertools.zip_longest(changes[::2], changes[1::2]):
        near, far = (low.value if low else trials[0].value), (high.value if high else trials[-1].value)
        first, last = rounded_inwards(near, far, dimension)
        if low and shows_error(near, low.error, dimension):
            first = pretty_with_error(near, low.error, dimension)
        if high and shows_error(far, high.error, dimension):
            last = pretty_with_error(far, high.error, dimension)
        if low is None:
            parts.append(f"up to {last} (searched from {ends[0]})")
        else:
            parts.append(f"from {first} to {last}" if high else f"from {first} on (searched up to {ends[1]})")
    return f"met {listed(parts)}"


def _nearest(trials: Sequence[_Trial], dimension: Dimension, declared: Container[float] = ()) -> str:
    """Where it comes closest to being met and how close; among values that are equally close, at the declared one."""
    margins = np.array([one.answer.margin for one in trials])
    if _alike(margins.tolist()):
        at = next((k for k, one in enumerate(trials) if one.value in declared), 0)
        return f"it does not depend on this value ({trials[at].answer.reason})"
    closest = np.flatnonzero(margins >= margins.max() - 1e-9 * abs(margins.max())).tolist()
    nearest = next((k for k in closest if trials[k].value in declared), closest[0])
    words = f"closest at {pretty(trials[nearest].value, dimension)}"
    if margins[nearest] > 0.0:
        words += ", where only its guard band is violated"
    else:
        words += f" ({trials[nearest].answer.reason})"
    # A margin that rises towards an end may rise further.
    if nearest in (0, len(trials) - 1) and np.ptp(margins) > 0.0:
        words += "; it may be met beyond that end"
    return words


def questions_group(definition: StudyDefinition, progress: Progress) -> xr.Dataset:
    """The part of /decision that answers inverse questions, for cameras of every kind."""
    questions = definition.file.solve
    solved = []
    for done, (name, question) in enumerate(questions.items()):
        progress("inverse questions", done / len(questions))
        solved.append((solve_requirement if question.requirement else solve)(definition.under(name), question))
    progress("inverse questions", 1.0)
    tried = np.full((len(solved), max(1, *(len(answer.tried) for answer in solved)), 2), np.nan)
    for row, answer in zip(tried, solved, strict=True):
        row[: len(answer.tried)] = np.reshape(answer.tried, (-1, 2))
    return dataset(
        "decision",
        {
            "solved_path": [question.paths[0] for question in questions.values()],
            "solved_goal": [question.goal if question.camera else math.nan for question in questions.values()],
            "solved_place": [question.place for question in questions.values()],
            "solved_errors": [question.errors for question in questions.values()],
            "solved_tried_value": tried[..., 0],
            "solved_tried_uncertainty": tried[..., 1],
            "solution_count": [len(answer.solutions) for answer in solved],
            "solved_value": [answer.value for answer in solved],
            "solved_error": [answer.error for answer in solved],
            "solved_units": [answer.dimension.unit for answer in solved],
            "solved_says": [question.says for question in questions.values()],
            "solved_answer": [answer.answer for answer in solved],
            "solved_rests_on": [answer.rests_on for answer in solved],
            "solved_rests_on_share": [answer.share for answer in solved],
        },
        {"question": list(questions)},
    )

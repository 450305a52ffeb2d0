"""Inverse questions for an uncertainty: the value of an input at which it equals another one, or a bound."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np
import xarray as xr

from tradestudy.answers.required_values import solve_requirement
from tradestudy.answers.solutions import (
    Solution,
    Solved,
    bracketed,
    planned,
    plans,
    to_be_planned,
    to_plan,
    with_declared_value,
)
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.depth.brackets import cubic_zero, stencil
from tradestudy.depth.evaluation import distribution
from tradestudy.execution.steps import Progress
from tradestudy.optics.arrays import FloatArray
from tradestudy.results import dataset
from tradestudy.study.bases import NamedInput, declared_input
from tradestudy.study.prepared import PreparedStudy
from tradestudy.study.schema.questions import SolvePart
from tradestudy.study.varying import Varying, quantity_entry, question_ends
from tradestudy.units import (
    FRACTION,
    LENGTH,
    PIXELS,
    pretty,
    pretty_with_error,
    significant,
)
from tradestudy.wording import counted, listed, with_article

_ROOT_TOLERANCE: Final = 1e-10
_PARABOLAS: Final = 10.0  # times the error of a cubic's zero, by which those of its two parabolas differ at least
_TRUSTED: Final = 0.25  # of a bracket, by which these may differ; otherwise the bracket is halved
_ROUNDING: Final = 1e-12
_PLACES: Final = 9  # values tried between the ends of a question
_EXTRAPOLATED: Final = 2.0  # lengths of the interval, on a logarithmic scale, by which a solution may lie beyond it
_LOG_OF_UNBOUNDED: Final = 700.0  # represents the logarithm of the ratio to an unbounded width


def solve(study: PreparedStudy, question: SolvePart) -> Solved:
    """Find the values of an input that make two depth uncertainties equal at a distance, or give one a required value.

    The ratio of the uncertainties is computed at nine values between the declared ends. Wherever it passes one between
    two of them, cubics through the values around it find the crossing on a logarithmic scale, in each scramble. Two
    crossings between neighbouring values are not seen. For whole numbers, such as a number of views, the answer is the
    first that is certain enough. If the question varies the target of a calibration, the calibration is planned for
    eight arrangements of the views, and the error is that of their mean.

    Raises
    ------
    OutOfRangeError
        The ends do not share a unit, or the varied path does not exist.
    """
    varying = Varying.of(study, question)
    dimension, low, high = varying.dimension, varying.low, varying.high
    ratios = _Ratios(to_be_planned(study, varying), question, varying)
    places = [math.log(varying.possible(math.exp(log))) for log in np.linspace(math.log(low), math.log(high), _PLACES)]
    # Whole numbers may be fewer than the places, which then coincide.
    places = list(dict.fromkeys(places))
    means = np.array([ratios.mean(log) for log in places])
    tried: tuple[tuple[float, float], ...] = ()
    if question.equal is None:
        widths = np.where(means >= _LOG_OF_UNBOUNDED, np.inf, question.goal * np.exp(means))
        tried = tuple(zip(map(math.exp, places), widths.tolist(), strict=True))
    # An input without effect would make every value a crossing.
    if np.all(np.abs(means) <= _ROUNDING):
        throughout = "equal throughout" if question.equal is not None else f"exactly {_goal_words(question)} throughout"
        answer = f"{throughout}, from {pretty(low, dimension)} to {pretty(high, dimension)}"
        return Solved(solutions=(), dimension=dimension, answer=answer, tried=tried)
    find = ratios.whole_number if varying.is_counted else ratios.crossing
    solutions = [
        find((places[k], places[k + 1]))
        for k in range(len(places) - 1)
        if means[k] * means[k + 1] <= 0.0 and (means[k] != 0.0 or k == 0)  # a root at a tried value counts once
    ]
    if not solutions and np.isnan(means).any():  # a claim about all values would be unfounded
        return Solved(solutions=(), dimension=dimension, answer=_undecided(question))
    if not solutions:
        answer = _nowhere(study, question, (low, high), means)
        if question.equal is None and question.errors != "noise" and np.all(means > 0.0):
            best = math.exp(places[int(np.argmin(means))])
            answer += _larger_noise(study.with_values(varying.changes(best)), question)
        return Solved(solutions=(), dimension=dimension, answer=answer, tried=tried)
    answer = _answer(study, question, solutions, is_counted=varying.is_counted)
    if ratios.plans > 1:
        answer += f"; mean over {ratios.plans} arrangements of the calibration views"
    rests_on, share = NamedInput(), math.nan
    if question.errors == "calibration" and question.equal is None:
        answer += _larger_noise(study.with_values(varying.changes(solutions[0].value)), question)
        rests_on, share = _corner_noise(ratios.changed(math.log(solutions[0].value)), question)
    return Solved(
        solutions=tuple(solutions), dimension=dimension, answer=answer, tried=tried, rests_on=rests_on, share=share
    )


class _Ratios:
    """Logarithm of the ratio of the uncertainty to its target, against the logarithm of the varied value."""

    def __init__(self, study: PreparedStudy, question: SolvePart, varying: Varying) -> None:
        self._study, self._question, self._varying = study, question, varying
        self._plans = plans(study)
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
        roots = np.exp([self._root(k, logs) for k in range(count)])
        return Solution(value=float(np.mean(roots)), error=_error_of_mean(roots))

    def _root(self, number: int, logs: tuple[float, float]) -> float:
        """Where the ratio in one scramble or plan passes one between two values; the nearer of these if nowhere."""
        own_plan = number if self.plans > 1 else 0
        while True:
            tried = np.array(sorted(log for log, plan in self._known if plan == own_plan))  # for other scrambles, too
            ratios = np.array([self._ratio(number, log) for log in tried])
            within = (logs[0] <= tried[:-1]) & (tried[1:] <= logs[1])
            passed = np.flatnonzero(within & (ratios[:-1] * ratios[1:] <= 0.0))[:1]
            if not passed.size:
                return min(logs, key=lambda log: abs(self._ratio(number, log)))
            low, high = tried[passed[0]], tried[passed[0] + 1]
            around = stencil(passed, tried.size)[:, 0]
            with np.errstate(invalid="ignore", divide="ignore"):  # equal ratios
                zero, apart = cubic_zero(tried[around], ratios[around])
            trusted = low <= zero <= high and apart < _TRUSTED * (high - low)
            best = float(zero if trusted else 0.5 * (low + high))
            if high - low <= _ROOT_TOLERANCE or (trusted and apart <= _PARABOLAS * _ROOT_TOLERANCE) or best in tried:
                return best
            self._ratio(number, best)

    def whole_number(self, logs: tuple[float, float]) -> Solution:
        """The whole number next to the crossing on the side that meets the limit; error over scrambles or plans."""
        count = max(len(self._all(log)) for log in logs)
        certain, other = sorted(logs, key=self.mean)  # the smaller ratio meets the limit
        whole_numbers = [self._last_whole(partial(self._ratio, k), (certain, other)) for k in range(count)]
        return Solution(
            value=self._last_whole(self.mean, (certain, other)), error=_error_of_mean(np.array(whole_numbers))
        )

    def _last_whole(self, log_ratio: Callable[[float], float], logs: tuple[float, float]) -> float:
        certain, other = (float(round(math.exp(log))) for log in logs)
        if log_ratio(logs[0]) > 0.0 or log_ratio(logs[1]) <= 0.0:  # this scramble or plan crosses beyond an end
            return certain if log_ratio(logs[0]) > 0.0 else other
        possible = self._varying.possible
        return bracketed(certain, other, lambda n: log_ratio(math.log(n)) <= 0.0, possible=possible, close=0.0)[0]

    def _ratio(self, number: int, log_value: float) -> float:
        """The ratio in one scramble or one plan; a linear model is the same in all scrambles."""
        if self.plans > 1:
            return float(np.mean(self.at_plan(log_value, number)))
        ratios = self.at_plan(log_value, 0)
        return float(ratios[min(number, len(ratios) - 1)])

    def _all(self, log_value: float) -> FloatArray:
        if self.plans > 1:
            return np.array([self._ratio(plan, log_value) for plan in self._plans])
        return self.at_plan(log_value, 0)

    def at_plan(self, log_value: float, plan: int) -> FloatArray:
        """The ratio at a value in one plan of a calibration; (scrambles,)."""
        key = (log_value, plan)
        if key not in self._known:
            self._known[key] = _log_ratios(planned(self.changed(log_value), plan), self._question)
        return self._known[key]

    def changed(self, log_value: float) -> PreparedStudy:
        """The study with a value, before its calibrations are planned."""
        varying = self._varying
        value = min(max(math.exp(log_value), varying.low), varying.high)  # rounding may carry it beyond an end
        return self._study.with_values(varying.changes(value))


def _error_of_mean(values: FloatArray) -> float:
    return float(np.std(values, ddof=1) / math.sqrt(len(values))) if len(values) > 1 else 0.0


def _log_ratios(study: PreparedStudy, question: SolvePart) -> FloatArray:
    """Logarithm of the ratio of the uncertainty to its target; (scrambles,)."""
    cameras = study.case.cameras
    if question.equal is not None:
        first, second = (_widths(cameras[camera_name], question) for camera_name in question.equal)
    else:
        assert question.camera is not None  # the schema ensures it
        first, second = _widths(cameras[question.camera], question), np.array([question.goal])
    with np.errstate(divide="ignore", invalid="ignore"):  # unbounded intervals are valid
        log_ratios = np.log(first) - np.log(second)
    # Infinite logarithms would make means and interpolated zeros NaN.
    return np.asarray(np.clip(log_ratios, -_LOG_OF_UNBOUNDED, _LOG_OF_UNBOUNDED))


def _widths(camera: DepthCamera, question: SolvePart) -> FloatArray:
    """Uncertainty [m] at the distance of the question, in each scramble; draws need to converge only there."""
    judged = replace(camera, propagation=replace(camera.propagation, judged=(question.place,)))
    return distribution(judged, np.array([question.place]), question.errors).judged_widths[:, 0]


def _larger_noise(study: PreparedStudy, question: SolvePart) -> str:
    """The matching noise, if it alone exceeds what a question requires of the calibration."""
    noise = question.model_copy(update={"errors": "noise"})
    width = float(np.mean(_widths(study.case.cameras[question.camera or ""], noise)))
    if width <= question.goal:
        return ""
    if math.isinf(width):
        return "; the matching noise of one measurement alone leaves its depth without a bound"
    enough = counted(math.ceil((width / question.goal) ** 2), "measurement")
    excess = f"the matching noise of one measurement, {pretty(width, LENGTH)}, exceeds the goal"
    return f"; {excess} of {pretty(question.goal, LENGTH)}, so average at least {enough}"


_NOISE_STEP: Final = 1.01  # factor of the corner noise on both sides of the declared one
_MOST: Final = 0.5  # of the variance


def _corner_noise(study: PreparedStudy, question: SolvePart) -> tuple[NamedInput, float]:
    """The corner noise of a calibration to be planned, and its share of the variance of depth.

    The planned covariance combines the corners with the errors before the calibration: its logarithmic derivative with
    respect to the variance of the corners is their share. Empty and NaN where this is not most of it.
    """
    camera_name = question.camera or ""
    targets = {target.name: target for target in to_plan(study).values()}
    if camera_name not in targets:
        return NamedInput(), math.nan
    path = ("cameras", camera_name, "calibration", "target", "corner_noise")
    changes = [
        {".".join(path): quantity_entry(targets[camera_name].part.corner_noise * factor, PIXELS)}
        for factor in (1.0 / _NOISE_STEP, _NOISE_STEP)
    ]
    low, high = (_log_ratios(planned(study.with_values(change)), question)[0] for change in changes)
    share = float(high - low) / (2.0 * math.log(_NOISE_STEP))
    if not share > _MOST:
        return NamedInput(), math.nan
    title = with_article(study.file.cameras[camera_name].title)
    return declared_input(study, f"corner noise of {title}", path), share


def _undecided(question: SolvePart) -> str:
    """Why the ratio at an end of an inverse question is unknown."""
    where = pretty(question.place, LENGTH)
    if question.equal is not None:
        return f"cannot be decided: at {where} both uncertainties are unbounded, or one camera measures nothing"
    return f"cannot be decided: at {where} nothing is measured"


def _nowhere(study: PreparedStudy, question: SolvePart, ends: tuple[float, float], log_ratios: FloatArray) -> str:
    """Which camera is more certain throughout, and whether a solution may lie beyond an end."""
    dimension = question_ends(question)[0]
    titles = {name: part.title for name, part in study.file.cameras.items()}
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


def _answer(study: PreparedStudy, question: SolvePart, solutions: Sequence[Solution], *, is_counted: bool) -> str:
    """Every solution with its error, that of a count rounded up to a whole number, and the declared value."""
    dimension = question_ends(question)[0]
    values = [
        f"{solution.value:.0f} ± {math.ceil(solution.error)}"
        if is_counted and solution.error > 0.0
        else pretty_with_error(solution.value, solution.error, dimension)
        for solution in solutions
    ]
    answer = listed(values) if len(values) == 1 else f"{len(values)} solutions: {listed(values)}"
    return with_declared_value(study, question, answer)


def questions_group(study: PreparedStudy, progress: Progress) -> xr.Dataset:
    """The part of /decision that answers inverse questions, for cameras of every kind."""
    questions = study.file.solve
    solved = []
    for done, (name, question) in enumerate(questions.items()):
        progress("inverse questions", done / len(questions))
        solved.append((solve_requirement if question.requirement else solve)(study.under(name), question))
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
            "solved_rests_on": [answer.rests_on.words for answer in solved],
            "solved_rests_on_basis": [answer.rests_on.basis for answer in solved],
            "solved_rests_on_share": [answer.share for answer in solved],
        },
        {"question": list(questions)},
    )

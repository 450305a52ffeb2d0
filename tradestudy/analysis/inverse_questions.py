"""Inverse questions: the values of an input that make a camera as certain as another, or as certain as required."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.optimize import brentq

from tradestudy.analysis.depth import distribution
from tradestudy.cameras.calibration import ONE_SIGMA
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.errors import NotConvergedError, OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.expectations import question_ends
from tradestudy.study.schema.questions import SolvePart
from tradestudy.study.varying import Varying
from tradestudy.units import FRACTION, LENGTH, Dimension, pretty, pretty_with_error, significant
from tradestudy.wording import listed

_ROOT_TOLERANCE: Final = 1e-10
_ROUNDING: Final = 1e-12
_PLACES: Final = 9  # values tried between the ends of a question
_AS_FAR_AGAIN: Final = 2.0  # lengths of the interval, on a logarithmic scale, by which a solution may lie beyond it
_BEYOND_ALL: Final = 700.0  # stands for the logarithm of the ratio to a width without bound


@dataclass(frozen=True, kw_only=True)
class Solution:
    """A value that answers an inverse question, with its standard error, in the SI unit of the varied input."""

    value: float
    error: float


@dataclass(frozen=True, kw_only=True)
class Solved:
    """Every solution of an inverse question within its ends, ascending, with the answer in words."""

    solutions: tuple[Solution, ...]
    dimension: Dimension
    answer: str

    @property
    def value(self) -> float:
        """The first solution; NaN if there is none."""
        return self.solutions[0].value if self.solutions else math.nan

    @property
    def error(self) -> float:
        """Its standard error."""
        return self.solutions[0].error if self.solutions else math.nan


def solve(definition: StudyDefinition, question: SolvePart) -> Solved:
    """Find the values of an input that make two cameras equally certain at a distance, or one as certain as required.

    The ratio of the uncertainties is computed at nine values between the declared ends. Wherever it passes one between
    two of them, Brent's method finds the crossing on a logarithmic scale, in each scramble of the draws. Two crossings
    between neighbouring values are not seen.

    Raises
    ------
    OutOfRangeError
        The ends do not share a unit, or the varied path does not exist.
    NotConvergedError
        The root finder fails.
    """
    varying = Varying.of(definition, question)
    dimension, low, high = varying.dimension, varying.low, varying.high
    if varying.is_counted:
        raise OutOfRangeError(
            "this inverse question varies a count, but certainty needs a continuous input",
            value=question.paths[0],
            remedy="declare a requirement on depth uncertainty, and solve for that requirement",
        )
    known: dict[float, FloatArray] = {}

    def log_ratios(log_value: float) -> FloatArray:
        if log_value not in known:
            known[log_value] = _log_ratios(definition.with_values(varying.changes(math.exp(log_value))), question)
        return known[log_value]

    places = np.linspace(math.log(low), math.log(high), _PLACES).tolist()
    means = np.array([float(np.mean(log_ratios(log))) for log in places])
    if np.all(np.abs(means) <= _ROUNDING):
        found = "equal throughout" if question.equal is not None else f"exactly {_goal_words(question)} throughout"
        answer = f"{found}, from {pretty(low, dimension)} to {pretty(high, dimension)}"
        return Solved(solutions=(), dimension=dimension, answer=answer)
    solutions = []
    for k in range(_PLACES - 1):
        if not means[k] * means[k + 1] <= 0.0 or (means[k] == 0.0 and k > 0):  # count a root at a tried value once
            continue
        logs = (places[k], places[k + 1])
        count = max(len(log_ratios(log)) for log in logs)
        roots = np.exp([_root(_one_scramble(log_ratios, scramble), logs, question.says) for scramble in range(count)])
        error = float(np.std(roots, ddof=1) / math.sqrt(count)) if count > 1 else 0.0
        solutions.append(Solution(value=float(np.mean(roots)), error=error))
    if not solutions and np.isnan(means).any():  # a claim about all values would be unfounded
        return Solved(solutions=(), dimension=dimension, answer=_undecided(question))
    if not solutions:
        answer = _nowhere(definition, question, (low, high), means)
        return Solved(solutions=(), dimension=dimension, answer=answer)
    return Solved(solutions=tuple(solutions), dimension=dimension, answer=_answer(definition, question, solutions))


def _one_scramble(log_ratios: Callable[[float], FloatArray], scramble: int) -> Callable[[float], float]:
    """The ratio in one scramble; a linear model has only one, which serves for all."""

    def log_ratio(log_value: float) -> float:
        ratios = log_ratios(log_value)
        return float(ratios[min(scramble, len(ratios) - 1)])

    return log_ratio


def _root(log_ratio: Callable[[float], float], logs: tuple[float, float], says: str) -> float:
    ends = [log_ratio(log) for log in logs]
    if ends[0] * ends[1] > 0.0:  # in this scramble the root lies beyond an end
        return logs[int(abs(ends[1]) < abs(ends[0]))]
    root, report = brentq(log_ratio, *logs, xtol=_ROOT_TOLERANCE, full_output=True)
    if not report.converged:
        raise NotConvergedError("no root found for an inverse question", value=says, remedy="narrow its ends")
    return float(root)


def _log_ratios(definition: StudyDefinition, question: SolvePart) -> FloatArray:
    """Logarithm of the ratio of the uncertainty to its target; (scrambles,)."""
    cameras = definition.case.cameras
    if question.equal is not None:
        first, second = (_widths(cameras[name], question) for name in question.equal)
    else:
        assert question.camera is not None  # the schema ensures it
        first, second = _widths(cameras[question.camera], question), np.array([question.goal])
    with np.errstate(divide="ignore", invalid="ignore"):  # unbounded intervals are outcomes
        found = np.log(first) - np.log(second)
    return np.asarray(np.clip(found, -_BEYOND_ALL, _BEYOND_ALL))


def _widths(camera: DepthCamera, question: SolvePart) -> FloatArray:
    """Uncertainty [m] at the distance of the question, in each scramble; draws need to converge only there."""
    asked = replace(camera, propagation=replace(camera.propagation, judged=(question.place,)))
    return distribution(asked, np.array([question.place]), question.errors).half_widths(ONE_SIGMA)[:, 0]


def _undecided(question: SolvePart) -> str:
    """Why the ratio at an end of an inverse question is unknown."""
    where = pretty(question.place, LENGTH)
    if question.equal is not None:
        return f"cannot be decided: at {where} both are unbounded, or one of them measures nothing"
    return f"cannot be decided: at {where} nothing is measured"


def _nowhere(
    definition: StudyDefinition, question: SolvePart, ends: tuple[float, float], log_ratios: FloatArray
) -> str:
    """Which camera is more certain throughout, and whether a solution may lie beyond an end."""
    dimension = question_ends(question)[0]
    titles = {name: part.title for name, part in definition.file.cameras.items()}
    between = " and ".join(pretty(end, dimension) for end in ends)
    first_is_certain = bool(np.mean(log_ratios) < 0.0)
    if question.equal is not None:
        outcome = f"{titles[question.equal[0 if first_is_certain else 1]]} is more certain throughout"
    else:
        reaches = "reaches" if first_is_certain else "does not reach"
        outcome = f"{titles[question.camera or '']} {reaches} {_goal_words(question)} with any of these values"
    away = np.abs(log_ratios)
    steps = np.diff(away)
    for approaches, end, left, step in (
        (np.all(steps < 0.0), ends[1], away[-1], -steps[-1]),
        (np.all(steps > 0.0), ends[0], away[0], steps[0]),
    ):
        if approaches and left <= _AS_FAR_AGAIN * _PLACES * step:  # otherwise it levels off before reaching one
            factor = significant(math.exp(float(left)), 2)
            outcome += f"; a solution may lie beyond {pretty(end, dimension)}, where a factor of {factor} remains"
    return f"nowhere between {between}: {outcome}"


def _goal_words(question: SolvePart) -> str:
    goal = pretty(question.uncertainty, LENGTH) if question.uncertainty is not None else ""
    return f"{goal or pretty(question.relative or 0.0, FRACTION)} at {pretty(question.place, LENGTH)}"


def _answer(definition: StudyDefinition, question: SolvePart, found: Sequence[Solution]) -> str:
    """Every solution with its error, and the declared value."""
    dimension = question_ends(question)[0]
    values = [pretty_with_error(one.value, one.error, dimension) for one in found]
    answer = listed(values) if len(values) == 1 else f"{len(values)} solutions: {listed(values)}"
    return beside_declared(definition, question, answer)


def beside_declared(definition: StudyDefinition, question: SolvePart, answer: str) -> str:
    """An answer, followed by the declared value of the varied input if it has one."""
    path = question.paths[0]
    if definition.document.entry(path) is None:
        return answer
    return f"{answer}; declared: {definition.document.text_of(path)}"

"""Inverse questions: which value of an input makes a camera as certain as another, or as its distance asks."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.optimize import brentq

from tradestudy.analysis.depth import distribution
from tradestudy.cameras.calibration import ONE_SIGMA
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.errors import NotConvergedError
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.document import Entry
from tradestudy.study.expectations import question_ends
from tradestudy.study.schema.questions import SolvePart
from tradestudy.study.sweep import quantity_entry
from tradestudy.units import FRACTION, LENGTH, Dimension, pretty

_ROOT_TOLERANCE: Final = 1e-10
_BEYOND_ALL: Final = 700.0  # a logarithm of two widths that stands for one that has no bound


@dataclass(frozen=True, kw_only=True)
class Solved:
    """The answer to an inverse question and its standard error, in the SI unit of what was varied."""

    value: float
    error: float
    dimension: Dimension
    answer: str


def solve(definition: StudyDefinition, question: SolvePart) -> Solved:
    """Find the value of an input that makes two cameras equally certain at a distance, or one as certain as asked.

    The ratio of the uncertainties is followed between the declared ends and its crossing of one is found by Brent's
    method, on a logarithmic scale, in each scramble of the draws.

    Raises
    ------
    OutOfRangeError
        Where the ends do not share a unit, or the varied path does not exist.
    NotConvergedError
        If the root finder fails.
    """
    dimension, low, high = question_ends(question)
    known: dict[float, FloatArray] = {}

    def log_ratios(log_value: float) -> FloatArray:
        if log_value not in known:
            known[log_value] = _log_ratios(definition, question, quantity_entry(math.exp(log_value), dimension))
        return known[log_value]

    logs = (math.log(low), math.log(high))
    ends = [float(np.mean(log_ratios(log))) for log in logs]
    if np.isnan(ends).any():
        return Solved(value=math.nan, error=math.nan, dimension=dimension, answer=_undecided(question))
    if ends[0] * ends[1] > 0.0:
        between = f"{pretty(low, dimension)} and {pretty(high, dimension)}"
        return Solved(
            value=math.nan,
            error=math.nan,
            dimension=dimension,
            answer=_nowhere(definition, question, between, ends[0] < 0.0),
        )
    count = max(len(log_ratios(log)) for log in logs)
    roots = [_root(_one_scramble(log_ratios, k), logs, question.says) for k in range(count)]
    value = float(np.mean(np.exp(roots)))
    error = float(np.std(np.exp(roots), ddof=1) / math.sqrt(len(roots))) if len(roots) > 1 else 0.0
    return Solved(value=value, error=error, dimension=dimension, answer=_answer(definition, question, value, error))


def _one_scramble(log_ratios: Callable[[float], FloatArray], scramble: int) -> Callable[[float], float]:
    """Of one scramble alone; a linear model stands for all."""

    def log_ratio(log_value: float) -> float:
        ratios = log_ratios(log_value)
        return float(ratios[min(scramble, len(ratios) - 1)])

    return log_ratio


def _root(log_ratio: Callable[[float], float], logs: tuple[float, float], says: str) -> float:
    ends = [log_ratio(log) for log in logs]
    if ends[0] * ends[1] > 0.0:  # this scramble has its root beyond an end that others have it within
        return logs[int(abs(ends[1]) < abs(ends[0]))]
    root, report = brentq(log_ratio, *logs, xtol=_ROOT_TOLERANCE, full_output=True)
    if not report.converged:
        raise NotConvergedError("an inverse question was not solved", value=says, remedy="narrow its ends")
    return float(root)


def _log_ratios(definition: StudyDefinition, question: SolvePart, value: Entry) -> FloatArray:
    """ln of the uncertainty over the one that it is to equal, with a value in place of what is varied; (scrambles,)."""
    cameras = definition.with_values(dict.fromkeys(question.paths, value)).case.cameras
    if question.equal is not None:
        first, second = (_widths(cameras[name], question) for name in question.equal)
    else:
        assert question.camera is not None  # the schema lets no other through
        assert question.relative is not None
        first, second = _widths(cameras[question.camera], question), np.array([question.relative * question.at])
    with np.errstate(divide="ignore", invalid="ignore"):  # unbounded intervals are outcomes
        found = np.log(first) - np.log(second)
    return np.asarray(np.clip(found, -_BEYOND_ALL, _BEYOND_ALL))


def _widths(camera: DepthCamera, question: SolvePart) -> FloatArray:
    """Uncertainty [m] at the distance of the question, of each scramble; draws are settled there alone."""
    asked = replace(camera, propagation=replace(camera.propagation, judged=(question.at,)))
    return distribution(asked, np.array([question.at]), question.errors).half_widths(ONE_SIGMA)[:, 0]


def _undecided(question: SolvePart) -> str:
    """Why an end of an inverse question has no ratio."""
    where = pretty(question.at, LENGTH)
    if question.equal is not None:
        return f"cannot be told: at {where} both are unbounded, or one of them measures nothing"
    return f"cannot be told: at {where} nothing is measured"


def _nowhere(definition: StudyDefinition, question: SolvePart, between: str, first_is_certain: bool) -> str:
    titles = {name: part.title for name, part in definition.file.cameras.items()}
    if question.equal is not None:
        certain = question.equal[0 if first_is_certain else 1]
        return f"nowhere between {between}: {titles[certain]} is more certain throughout"
    wanted = f"{pretty(question.relative or 0.0, FRACTION)} at {pretty(question.at, LENGTH)}"
    met = "certain enough" if first_is_certain else "not certain enough"
    return f"nowhere between {between}: {titles[question.camera or '']} is {met} throughout for {wanted}"


def _answer(definition: StudyDefinition, question: SolvePart, value: float, error: float) -> str:
    dimension = question_ends(question)[0]
    answer = pretty(value, dimension, digits=3)
    if error > 0.0:
        answer += f" ± {pretty(error, dimension, digits=1)}"
    path = question.paths[0]
    if definition.document.entry(path) is not None:
        answer += f" (declared: {definition.document.text_of(path)})"
    return answer

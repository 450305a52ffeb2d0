"""Inverse questions for a requirement: the values of an input at which it begins or ceases to be met."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np

from tradestudy.answers.requirement_answer import RequirementAnswer
from tradestudy.answers.requirements import ANY, Judge
from tradestudy.answers.solutions import Solution, Solved, bracketed, planned, to_be_planned, with_declared_value
from tradestudy.errors import TradestudyError
from tradestudy.study.prepared import PreparedStudy
from tradestudy.study.schema.questions import SolvePart
from tradestudy.study.varying import Varying
from tradestudy.units import (
    Dimension,
    pretty,
    pretty_with_error,
    rounded_inwards,
    shows_error,
)
from tradestudy.wording import listed

_TRIED_PLACES: Final = 17  # values tried between the ends of a question
_REFINEMENTS: Final = 4  # halvings of the steps beside the largest margin, if the requirement is met at none of them
_BEYOND: Final = (2.0, 10.0, 1e3)  # factors by which values beyond an end are tried, if it comes closest there
_CLOSE: Final = 1e-4  # relative width of the bracket around the value where a requirement ceases to be met


_Judged = tuple[RequirementAnswer, Mapping[str, RequirementAnswer]]
"""The answer to one requirement, and that of each camera."""
_MetBeyond = Callable[[Iterable[float]], float | None]
"""The first of several values at which it is met."""


@dataclass(frozen=True, kw_only=True)
class _Trial:
    """The answer to the requirement at one value, in SI."""

    value: float
    answer: RequirementAnswer


def solve_requirement(study: PreparedStudy, question: SolvePart) -> Solved:
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
    varying, judge = Varying.of(study, question), Judge()
    study = to_be_planned(study, varying)
    tried = _Tried(study=study, requirements=question.requirements, varying=varying, judge=judge, known={})
    places = {varying.possible(float(value)) for value in np.geomspace(varying.low, varying.high, _TRIED_PLACES)}
    for value in places | varying.declared(study):
        tried.answer(value)
    for _ in range(_REFINEMENTS):
        for value in _beside_the_nearest({value: tried.answer(value) for value in tried.known}):
            tried.answer(varying.possible(value))
    cameras = _several_cameras(study, tried)
    varied = {path.removeprefix("cameras.").partition(".")[0] for path in question.paths}
    alone = {name: _solved(tried, study, name) for name in sorted(cameras, key=lambda name: name not in varied)}
    first = next((camera for camera in alone if camera in varied), "")
    solutions, answer = alone[first] if first else _solved(tried, study)
    if alone:
        by_camera = "; ".join(f"{study.file.cameras[camera].title}: {words}" for camera, (_, words) in alone.items())
        answer = by_camera if first else f"{answer}; {by_camera}"
    return Solved(
        solutions=tuple(solutions),
        dimension=varying.dimension,
        answer=with_declared_value(study, question, answer),
    )


@dataclass(frozen=True, kw_only=True)
class _Tried:
    """The answers to the requirements at the values tried so far, by value in SI."""

    study: PreparedStudy
    requirements: tuple[str, ...]
    varying: Varying
    judge: Judge
    known: dict[float, list[_Judged]]

    def answer(self, value: float, camera: str = "") -> RequirementAnswer:
        """The answer to the requirement that is hardest to meet, of all cameras together or of one alone."""
        if value not in self.known:
            self.known[value] = self._judged(value)
        return _hardest(self.known[value], camera)

    def met_beyond(self, values: Iterable[float], camera: str = "") -> float | None:
        """The first of values outside the range of the question, which the study may refuse, at which they are met."""
        for value in map(self.varying.possible, values):
            with suppress(TradestudyError):
                if _hardest(self._judged(value), camera).met:
                    return value
        return None

    def _judged(self, value: float) -> list[_Judged]:
        changed = planned(self.study.with_values(self.varying.changes(value)))
        return [self.judge.answer(changed.file.requirements[name], changed.case) for name in self.requirements]


def _hardest(judged: Sequence[_Judged], camera: str) -> RequirementAnswer:
    answers = [by_camera[camera] if camera else deciding for deciding, by_camera in judged]
    # Missed ones come first, then undecided ones; among equals, the smallest margin.
    return min(answers, key=lambda answer: (answer.met is True, answer.met is None, np.nan_to_num(answer.margin)))


def _several_cameras(study: PreparedStudy, tried: _Tried) -> list[str]:
    """The cameras of a requirement on any of several, in their order; none for other requirements."""
    if len(tried.requirements) > 1 or study.file.requirements[tried.requirements[0]].camera != ANY:
        return []
    ((_, by_camera),) = next(iter(tried.known.values()))
    return list(by_camera) if len(by_camera) > 1 else []


def _solved(tried: _Tried, study: PreparedStudy, camera: str = "") -> tuple[list[Solution], str]:
    """Where the requirements begin or cease to be met, by all cameras together or by one alone, also in words."""
    varying = tried.varying
    trials = [_Trial(value=value, answer=tried.answer(value, camera)) for value in sorted(tried.known)]
    if undecided := [trial.answer.reason for trial in trials if trial.answer.met is None]:
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
    beyond = partial(tried.met_beyond, camera=camera)
    return solutions, _range_answer(trials, solutions, varying.dimension, varying.declared(study), beyond)


def _error(answer: RequirementAnswer, bracket: float, before: _Trial, after: _Trial) -> float:
    """Half of the bracket, combined with the shift of the end due to the error of the worst value."""
    slope = abs(after.answer.margin - before.answer.margin) / abs(after.value - before.value)
    relative = answer.error / abs(answer.value) if answer.error > 0.0 and math.isfinite(answer.value) else 0.0
    return math.hypot(bracket / 2.0, relative / slope if slope > 0.0 and math.isfinite(slope) else 0.0)


def _beside_the_nearest(answers: Mapping[float, RequirementAnswer]) -> list[float]:
    """Values halfway to the neighbours of that with the largest margin, if it is met nowhere and margins differ."""
    values, margins = sorted(answers), [answers[value].margin for value in sorted(answers)]
    if any(answer.met is not False for answer in answers.values()) or _alike(margins):
        return []
    nearest = int(np.argmax(margins))
    neighbours = {max(nearest - 1, 0), min(nearest + 1, len(values) - 1)} - {nearest}
    # Halfway on a logarithmic scale, on which the first values are evenly spaced.
    return [math.sqrt(values[nearest] * values[k]) for k in neighbours]


def _alike(margins: Sequence[float]) -> bool:
    """Whether they are equal up to rounding; those of requirements without a value are infinite."""
    return max(margins) == min(margins) or max(margins) - min(margins) <= 1e-9 * abs(min(margins)) < math.inf


def _range_answer(
    trials: Sequence[_Trial],
    solutions: Sequence[Solution],
    dimension: Dimension,
    declared: Container[float],
    met_beyond: _MetBeyond,
) -> str:
    """The values for which it is met; if there are none, how close it comes and where beyond an end it is met."""
    ends = [pretty(trials[k].value, dimension) for k in (0, -1)]
    if not solutions:
        between = f"between {ends[0]} and {ends[1]}"
        return (
            f"met everywhere {between}"
            if trials[0].answer.met
            else f"met nowhere {between}: {_nearest(trials, dimension, declared, met_beyond)}"
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


def _nearest(
    trials: Sequence[_Trial],
    dimension: Dimension,
    declared: Container[float] = (),
    met_beyond: _MetBeyond = lambda _values: None,
) -> str:
    """Where it comes closest to being met and how close; among values that are equally close, at the declared one."""
    margins = np.array([trial.answer.margin for trial in trials])
    below, above = [trials[0].value / factor for factor in _BEYOND], [trials[-1].value * factor for factor in _BEYOND]
    if _alike(margins.tolist()):
        at = next((k for k, trial in enumerate(trials) if trial.value in declared), 0)
        if (met := met_beyond([*below, *above])) is None:
            return f"it does not depend on this value ({trials[at].answer.reason})"
        return f"equally far from it everywhere ({trials[at].answer.reason}); met at {pretty(met, dimension)}"
    closest = np.flatnonzero(margins >= margins.max() - 1e-9 * abs(margins.max())).tolist()
    nearest = next((k for k in closest if trials[k].value in declared), closest[0])
    words = f"closest at {pretty(trials[nearest].value, dimension)}"
    if margins[nearest] > 0.0:
        words += ", where only its guard band is violated"
    else:
        words += f" ({trials[nearest].answer.reason})"
    beyond = {0: below, len(trials) - 1: above}.get(nearest, [])
    met = met_beyond(beyond)
    return words if met is None else f"{words}; beyond that end, it is met at {pretty(met, dimension)}"

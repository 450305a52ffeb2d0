"""Inverse questions about a requirement: over which values of an input is it met?"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from tradestudy.analysis.halving import bracketed
from tradestudy.analysis.held import Held
from tradestudy.analysis.inverse_questions import Solution, Solved, beside_declared
from tradestudy.analysis.planned_calibrations import planned, to_be_planned
from tradestudy.analysis.requirements import Judge
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.schema.questions import SolvePart
from tradestudy.study.varying import Varying
from tradestudy.units import FRACTION, Dimension, pretty, pretty_with_error
from tradestudy.wording import listed

_PLACES: Final = 17  # between the ends of a question
_CLOSE: Final = 1e-4  # of a value: how far apart the two are between which a requirement ceases to be met


@dataclass(frozen=True, kw_only=True)
class _Trial:
    """What became of the requirement at one value, in SI."""

    value: float
    held: Held


def solve_requirement(definition: StudyDefinition, question: SolvePart) -> Solved:
    """Find every value at which a requirement begins or ceases to be met.

    It is held at seventeen values between the declared ends and at the declared value, and its ends are followed
    between two of them by halving, for a margin may jump where a camera ceases to be usable. Two changes between
    neighbouring values are not seen. The error of an end is the bracket that halving leaves, and the error of the worst
    value over the slope of its margin.

    Raises
    ------
    OutOfRangeError
        Where the ends do not share a unit.
    StudyError
        Where the study cannot have a value between them.
    """
    varying, judge = Varying.of(definition, question), Judge()
    requirement, dimension = definition.file.requirements[question.requirement or ""], varying.dimension
    definition = to_be_planned(definition, varying)
    known: dict[float, Held] = {}

    def is_met(value: float) -> bool | None:
        known[value] = judge.answer(requirement, planned(definition.with_values(varying.changes(value))).case)[0]
        return known[value].met

    places = {varying.possible(float(value)) for value in np.geomspace(varying.low, varying.high, _PLACES)}
    for value in places | varying.declared(definition):
        is_met(value)
    trials = [_Trial(value=value, held=held) for value, held in sorted(known.items())]
    if undecided := [one.held.reason for one in trials if one.held.met is None]:
        reason = undecided[0]
        return Solved(solutions=(), dimension=dimension, answer=f"cannot be told: {reason}")
    solutions: list[Solution] = []
    for before, after in itertools.pairwise(trials):
        if before.held.met == after.held.met:
            continue
        inside, outside = (before, after) if before.held.met else (after, before)
        ends = bracketed(inside.value, outside.value, is_met, possible=varying.possible, close=_CLOSE)
        # What is counted has nothing between two neighbours.
        error = 0.0 if varying.is_counted else _error(known[ends[0]], abs(ends[1] - ends[0]), before, after)
        solutions.append(Solution(value=ends[0], error=error))
    answer = _answer(trials, solutions, dimension)
    return Solved(solutions=tuple(solutions), dimension=dimension, answer=beside_declared(definition, question, answer))


def _error(held: Held, bracket: float, before: _Trial, after: _Trial) -> float:
    """Half of the bracket, and what the error of the worst value moves the end by along its margin."""
    slope = abs(after.held.margin - before.held.margin) / abs(after.value - before.value)
    own = held.error / abs(held.value) if held.error > 0.0 and math.isfinite(held.value) else 0.0
    return math.hypot(bracket / 2.0, own / slope if slope > 0.0 and math.isfinite(slope) else 0.0)


def _answer(trials: Sequence[_Trial], solutions: Sequence[Solution], dimension: Dimension) -> str:
    """Over which values it is met; where it is nowhere, how near it comes and whether it may be beyond an end."""
    ends = [pretty(trials[k].value, dimension) for k in (0, -1)]
    if not solutions:
        between = f"between {ends[0]} and {ends[1]}"
        return (
            f"met anywhere {between}" if trials[0].held.met else f"met nowhere {between}: {_nearest(trials, dimension)}"
        )
    told = [pretty_with_error(one.value, one.error, dimension) for one in solutions]
    begins = [None, *told] if trials[0].held.met else told
    parts = []
    for first, last in itertools.zip_longest(begins[::2], begins[1::2]):
        if first is None:
            parts.append(f"up to {last} (sought from {ends[0]})")
        else:
            parts.append(f"from {first} on (sought up to {ends[1]})" if last is None else f"from {first} to {last}")
    return f"met {listed(parts)}"


def _nearest(trials: Sequence[_Trial], dimension: Dimension) -> str:
    margins = np.array([one.held.margin for one in trials])
    nearest = int(np.argmax(margins))
    told = f"nearest at {pretty(trials[nearest].value, dimension)}"
    if margins[nearest] > 0.0:
        told += ", where only its guard band is broken"
    elif margins[nearest] > -1.0:
        told += f", missed by {pretty(-float(margins[nearest]), FRACTION, digits=2)}"
    # A margin that rises to an end may go on rising.
    if nearest in (0, len(trials) - 1) and np.ptp(margins) > 0.0:
        told += "; it may be met beyond that end"
    return told

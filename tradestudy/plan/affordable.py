"""The tightest tolerance with which a study fits its budget."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import Final

from tradestudy.accuracy import Accuracy
from tradestudy.effects.selection import Chosen, Selection, sum_of_seconds
from tradestudy.errors import UnaffordableError
from tradestudy.plan.situations.situation import Situation
from tradestudy.study.definition import StudyDefinition

# Of the two digits of tolerances, those that are always looked at; the sampling tolerances of light are among them.
_LADDER: Final = (10, 12, 15, 20, 25, 30, 40, 50, 60, 70, 80, 90)


@dataclass(frozen=True, kw_only=True)
class Offer:
    """A tolerance for everything, as `--tolerance` takes it, and the least that the run takes with it [s]."""

    tolerance: str
    seconds: float


def tightest_offer(
    definition: StudyDefinition,
    situations: tuple[Situation, ...],
    seconds: Callable[[StudyDefinition, Mapping[str, Selection]], float],
) -> Offer | None:
    """Find the tightest tolerance of two digits, looser than what is asked for, that fits the study's budget.

    The run need not become shorter with every step: a looser picture may no longer be one of those that are compared
    anyway. So every tolerance at which another model is chosen is looked at, and a ladder between them, from the
    tightest on; then every tolerance between the first that fits and the last before it. Only where compared pictures
    of one and the same choice take now more, now less within a rung of the ladder could a tighter one be passed over.

    Parameters
    ----------
    definition, situations
        The study and the pieces of it that models are chosen for.
    seconds
        Predicts the run of a study with the models chosen [s].

    Returns
    -------
    Offer | None
        The quickest that was looked at where none fits; None where nothing looser can be asked for.
    """
    tolerances = tuple(_looser(min(definition.file.accuracy.wanted().relative.values())))
    forced, budget = definition.file.effects.forced(), definition.file.accuracy.wanted().budget
    pieces, known = tuple(map(_remembering, situations)), dict[str, float]()

    @cache
    def asked(index: int) -> StudyDefinition:
        return definition.with_tolerance(_text(tolerances[index]))

    @cache
    def selections(index: int) -> Mapping[str, Selection] | None:
        accuracy = Accuracy(relative=asked(index).file.accuracy.wanted().relative)
        try:
            return {one.name: one.select(accuracy, forced) for one in pieces}
        except UnaffordableError:  # one tolerance for all may be tighter than some that are asked for
            return None

    def names(index: int) -> object:
        found = selections(index)
        return found and [[model.name for model in one.chosen.values()] for one in found.values()]

    def takes(index: int) -> float:
        found, spot = selections(index), asked(index).file.light_spot
        if found is None:
            return math.inf
        key = f"{names(index)} {spot and spot.tolerance}"  # all that a run takes its time for
        if key not in known:
            known[key] = seconds(asked(index), found)
        return known[key]

    if not tolerances:
        return None
    last = len(tolerances) - 1
    rungs = [i for i, (digits, _) in enumerate(tolerances) if digits in _LADDER]
    stops = sorted({0, *_changes(names, 0, last), *rungs, last})
    tight = -1
    for stop in stops:
        if takes(stop) <= budget:
            best = next(i for i in range(tight + 1, stop + 1) if takes(i) <= budget)
            break
        tight = stop
    else:
        best = min(stops, key=takes)
    return Offer(tolerance=_text(tolerances[best]), seconds=takes(best))


def _remembering(piece: Situation) -> Situation:
    """The same piece that counts the cost of a set once; no cost depends on the accuracy."""
    if piece.seconds is sum_of_seconds:
        return piece
    known: dict[tuple[str, ...], float] = {}

    def seconds(chosen: Chosen) -> float:
        names = tuple(model.name for model in chosen.values())
        if names not in known:
            known[names] = piece.seconds(chosen)
        return known[names]

    return replace(piece, seconds=seconds)


def _changes(names: Callable[[int], object], low: int, high: int) -> list[int]:
    """First tolerance of every other choice; where the ends choose alike, so does all between.

    For the sets that fit a tolerance fit every looser one, and the best of the loosest is the best of fewer.
    """
    if names(low) == names(high):
        return []
    if high - low == 1:
        return [high]
    middle = (low + high) // 2
    return _changes(names, low, middle) + _changes(names, middle, high)


def _looser(relative: float) -> Iterator[tuple[int, int]]:
    """Two digits and the power of ten of every percentage beyond a relative error, up to 100 %."""
    for power in range(math.floor(math.log10(100.0 * relative)) - 1, 1):
        for digits in range(10, 100):
            if float(f"{digits}e{power}") > 100.0 * relative * (1.0 + 1e-9):
                yield digits, power
    if relative < 1.0:
        yield 10, 1


def _text(tolerance: tuple[int, int]) -> str:
    digits, power = tolerance
    return f"{float(f'{digits}e{power}'):g} %"

"""Measure error and time of every candidate for a problem of a study, within a time budget."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from types import ModuleType
from typing import Any, Final

import numpy as np

from tradestudy.errors import TradestudyError
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.units import DURATION, pretty

_REPEATS: Final = 3
_SHORT: Final = 2.0  # seconds up to which a computation is timed more than once
_SHARE_OF_REFERENCES: Final = 0.5  # of the time left, so that time remains for candidates to compare with the reference
_TENTH: Final = 0.1 * (1.0 + 1e-12)  # allows for rounding
# Modules whose caches contain no computed physics.
_KEPT: Final = ("tradestudy.provenance", "tradestudy.machine", "tradestudy.units", __name__)


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A set of models and settings that can solve a problem.

    Parameters
    ----------
    models
        The set in words.
    compute
        Computes its answer.
    chosen
        Whether a run of the study uses it.
    growth
        Predicted time relative to that of the slowest candidate measured before it.
    """

    models: str
    compute: Callable[[], FloatArray]
    chosen: bool = False
    growth: float = 1.0


@dataclass(frozen=True, kw_only=True)
class Reference:
    """Values, with their error, to compare candidates with; they take ``growth`` times as long as coarser ones."""

    words: str
    compute: Callable[[], tuple[FloatArray, float]]
    growth: float = 1.0


@dataclass(frozen=True, kw_only=True)
class CostProblem:
    """A problem of a study: a camera or a light path.

    Parameters
    ----------
    name, title
        Name in the results, and title.
    difference
        Relative error of values (first argument) against those of a reference (second).
    candidates
        From fast to slow, including the chosen one.
    references
        From coarse to fine.
    left_out
        What is not among the candidates, and why.
    """

    name: str
    title: str
    difference: Callable[[FloatArray, FloatArray], float]
    candidates: tuple[Candidate, ...] = ()
    references: tuple[Reference, ...] = ()
    left_out: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Entry:
    """A measured candidate: its relative error, never below that of the reference, and its wall time [s]."""

    models: str
    error: float
    seconds: float
    chosen: bool


@dataclass(frozen=True, kw_only=True)
class Measured:
    """A measured problem; without a reference there are no entries, and ``left_out`` says why."""

    problem: CostProblem
    entries: tuple[Entry, ...] = ()
    reference: str = ""
    reference_error: float = np.nan
    left_out: tuple[str, ...]


def measure(problem: CostProblem, seconds: float) -> Measured:
    """Measure the chosen candidate, then the finest reference that half of the remaining time allows, then the others.

    A computation predicted to exceed the remaining time is not started; one that has started is finished.

    Parameters
    ----------
    problem
        The problem.
    seconds
        Wall time for all measurements [s].
    """
    begin = time.perf_counter()
    measured: list[tuple[Candidate, FloatArray, float]] = []
    left_out = list(problem.left_out)

    def left() -> float:
        return seconds - (time.perf_counter() - begin)

    def take(candidate: Candidate) -> None:
        predicted = candidate.growth * max((took for _, _, took in measured), default=0.0)
        if predicted >= left():
            left_out.append(
                f"{candidate.models}: needs about {_words(predicted)}, more than the {_words(max(left(), 0.0))} left"
            )
            return
        try:
            measured.append((candidate, *_timed(candidate.compute, left)))
        except TradestudyError as error:
            left_out.append(f"{candidate.models}: {error}")

    # The chosen models come first: even a short budget measures them, and their time predicts that of the references.
    for candidate in problem.candidates:
        if candidate.chosen:
            take(candidate)
    finest: tuple[Reference, FloatArray, float] | None = None
    took = max((duration for _, _, duration in measured), default=0.0)
    for reference in problem.references:
        # The first reference may take all the time: without one, there is nothing to compare with.
        predicted = reference.growth * took / (_SHARE_OF_REFERENCES if finest else 1.0)
        if predicted >= left():
            if finest is None:
                left_out.append(
                    f"not measured: the reference needs about {_words(predicted)}, more than the time left; give a "
                    "larger budget"
                )
            break
        started = time.perf_counter()
        try:
            finest = (reference, *reference.compute())
        except TradestudyError as error:
            left_out.append(f"reference, {reference.words}: {error}")
            break
        took = time.perf_counter() - started
    if finest is None:
        return Measured(problem=problem, left_out=tuple(left_out))
    for candidate in problem.candidates:
        if not candidate.chosen:
            take(candidate)
    reference, values, floor = finest
    entries = [
        Entry(
            models=candidate.models,
            error=max(problem.difference(answer, values), floor),
            seconds=took,
            chosen=candidate.chosen,
        )
        for candidate, answer, took in measured
    ]
    return Measured(
        problem=problem,
        entries=tuple(sorted(entries, key=lambda entry: entry.seconds)),
        reference=reference.words,
        reference_error=floor,
        left_out=tuple(left_out),
    )


def _words(seconds: float) -> str:
    return pretty(seconds, DURATION, digits=2)


def _timed(compute: Callable[[], FloatArray], left: Callable[[], float]) -> tuple[FloatArray, float]:
    """The result of a computation, and its shortest time in three runs with empty caches; a long one runs once."""
    taken: list[float] = []
    while len(taken) < _REPEATS and (not taken or taken[0] <= min(_SHORT, left())):
        forget()
        begin = time.perf_counter()
        values = compute()
        taken.append(time.perf_counter() - begin)
    return values, min(taken)


def forget() -> None:
    """Empty every cache of this program's computations, so that the next one starts afresh."""
    for name, module in list(sys.modules.items()):
        if name.startswith("tradestudy.") and name not in _KEPT:
            for cached in _cached_functions(module):
                cached.cache_clear()


@cache
def _cached_functions(module: ModuleType) -> tuple[Any, ...]:
    """The cached functions that a module defines; they exist once it is imported."""
    return tuple(
        value
        for value in vars(module).values()
        if getattr(value, "__module__", None) == module.__name__ and callable(getattr(value, "cache_clear", None))
    )


def on_frontier(entries: tuple[Entry, ...]) -> BoolArray:
    """Which entries are Pareto-optimal: no other has as small an error in as little time, and less of either."""
    error, took = (np.array([getattr(entry, attribute) for entry in entries]) for attribute in ("error", "seconds"))
    no_worse = (error[:, None] <= error) & (took[:, None] <= took)
    better = (error[:, None] < error) | (took[:, None] < took)
    return np.asarray(~np.any(no_worse & better, axis=0) & np.isfinite(error), dtype=bool)


def next_digit(entries: tuple[Entry, ...]) -> Entry | None:
    """The fastest entry with at most a tenth of the chosen entry's error; None if there is none."""
    chosen_error = next((entry.error for entry in entries if entry.chosen), np.nan)
    within = [entry for entry in entries if entry.error <= _TENTH * chosen_error]
    return min(within, key=lambda entry: (entry.seconds, entry.error), default=None)

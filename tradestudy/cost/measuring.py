"""Timing computations afresh, within a time that is agreed on before."""

from __future__ import annotations

import statistics
import sys
import time
import tracemalloc
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from types import ModuleType
from typing import Any, Final, Generic, TypeVar

from tradestudy.cost.defaults import FEWEST_REPEATS
from tradestudy.cost.entries import Entry
from tradestudy.study.schema.light_spot import MethodName
from tradestudy.units import significant

Value = TypeVar("Value")

MOST_PLACES: Final = 9  # of a study's distances that are measured at
REFERENCE_SEED: Final = 0x5EED  # of references that are drawn; what is measured takes its seeds from 0 up
_LONG_ENOUGH: Final = 0.2  # seconds that the repeats of a quick computation fill
_MOST_REPEATS: Final = 200
_LONG: Final = 5.0  # seconds from which the traced run is the only one
# How much longer than predicted pictures take.
_TELLING: Final = 0.2  # predicted seconds from which a picture tells the pace
_UNKNOWN: Final = 2.0  # as on a machine that is in use
_LEAST: Final = 0.5  # no picture is believed to be quicker than that
# What no computation of physics owns: the sources and libraries of this process, its processor, its cached functions.
_KEPT: Final = ("tradestudy.provenance", "tradestudy.machine", "tradestudy.units", __name__)


@dataclass(frozen=True, kw_only=True)
class Timed(Generic[Value]):
    """Values of a computation, one for each run, and what the runs took."""

    values: tuple[Value, ...]
    seconds: float
    least_seconds: float
    peak_memory: float
    repeats: int


@dataclass(kw_only=True)
class Allowance:
    """The wall time that a measurement may take.

    What is predicted to exceed what is left is not begun; what has begun is finished, so that the time is kept to
    within the error of one prediction. A reference is begun only where it leaves time for what is held against it.

    Parameters
    ----------
    seconds
        Altogether [s].
    repeats
        Wished for; one of computations of 5 s and more, and fewer where the time does not allow them.
    """

    seconds: float
    repeats: int = FEWEST_REPEATS
    begin: float = field(default_factory=lambda: time.perf_counter())

    @property
    def left(self) -> float:
        """Seconds that are left."""
        return self.seconds - (time.perf_counter() - self.begin)

    def allows(self, predicted: float) -> bool:
        """Whether a computation that takes so long may begin."""
        return predicted <= self.left

    def lacking(self, predicted: float) -> str:
        """Why a computation that takes so long is not begun."""
        if predicted == 0.0:
            return "no time left for this quantity"
        left = significant(max(self.left, 0.0), 2)
        return f"no time left: it takes about {significant(predicted, 2)} s, {left} s are left for this quantity"

    def keeping(self, seconds: float) -> Allowance:
        """An allowance of its own for what is left, less what is to be kept for something else."""
        return Allowance(seconds=max(self.left - seconds, 0.0), repeats=self.repeats)

    def share(self, share: float) -> Allowance:
        """An allowance of its own for a part of what is left."""
        return Allowance(seconds=max(self.left, 0.0) * share, repeats=self.repeats)


def forget() -> None:
    """Empty every cache of this program's computations, so that the next one is done afresh."""
    for name, module in list(sys.modules.items()):
        if name.startswith("tradestudy.") and name not in _KEPT:
            for cached in _cached_functions(module):
                cached.cache_clear()


@cache
def _cached_functions(module: ModuleType) -> tuple[Any, ...]:
    """Those that a module defines; they stand in it once it is imported."""
    return tuple(
        value
        for value in vars(module).values()
        if getattr(value, "__module__", None) == module.__name__ and callable(getattr(value, "cache_clear", None))
    )


def measure(compute: Callable[[int], Value], allowance: Allowance) -> Timed[Value]:
    """Run a computation once for its memory, and then again and again for its time.

    Parameters
    ----------
    compute
        Takes the number of the run, from which random ones take their seed.
    allowance
        Repeats, and the time that bounds them. Where it does not allow one more run, and of computations of 5 s and
        more, the traced run is the only one, and its time counts although tracing lengthens it.
    """
    forget()
    tracemalloc.start()
    try:
        begin = time.perf_counter()
        values = [compute(0)]
        first = time.perf_counter() - begin
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    taken: list[float] = []
    while len(taken) < _MOST_REPEATS and first < _LONG and allowance.allows(first):
        if len(taken) >= allowance.repeats and sum(taken) >= _LONG_ENOUGH:
            break
        forget()
        begin = time.perf_counter()
        value = compute(len(taken) + 1)
        taken.append(time.perf_counter() - begin)
        if len(values) <= allowance.repeats:
            values.append(value)
    taken = taken or [first]
    return Timed(
        values=tuple(values),
        seconds=statistics.median(taken),
        least_seconds=min(taken),
        peak_memory=float(peak),
        repeats=len(taken),
    )


def entry_of(
    timed: Timed[Value],
    *,
    model: str,
    setting: str,
    evaluations: float,
    error: float,
    typical_error: float,
    chosen: bool,
) -> Entry:
    """What was timed, as an entry, with the errors that its values are found to have."""
    return Entry(
        model=model,
        setting=setting,
        evaluations=evaluations,
        error=error,
        typical_error=typical_error,
        seconds=timed.seconds,
        least_seconds=timed.least_seconds,
        peak_memory=timed.peak_memory,
        repeats=timed.repeats,
        chosen=chosen,
    )


@dataclass(kw_only=True)
class Pace:
    """Seconds over predicted seconds, law by law: the most of all pictures so far, for finer ones exceed it the more.

    ``first`` is that of the first picture by Kirchhoff's law, which is the coarsest.
    """

    seen: dict[MethodName, float] = field(default_factory=dict)
    first: float | None = None

    def of(self, method: MethodName) -> float:
        """That of a law; by default that of Kirchhoff's law, and where this is unknown, too, twice as predicted."""
        return self.seen.get(method, self.seen.get("kirchhoff", _UNKNOWN))

    def learn(self, method: MethodName, *, predicted: float, took: float) -> None:
        """Count one more picture; quick ones tell nothing."""
        if predicted < _TELLING:
            return
        ratio = max(took / predicted, _LEAST)
        self.seen[method] = max(ratio, self.seen.get(method, 0.0))
        if method == "kirchhoff" and self.first is None:
            self.first = ratio

    def for_others(self) -> Pace:
        """What is known of it before the first of other pictures is measured: the pace of a coarse one."""
        return Pace() if self.first is None else Pace(seen={"kirchhoff": self.first})

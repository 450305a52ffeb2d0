"""What computes points: any of several ways, all of which give the same bits."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Final, Protocol

from tradestudy.errors import OutOfRangeError, TradestudyError
from tradestudy.execution.outcome import Point, Raised, Value, attempt

MOST_DEATHS: Final = 3
"""Workers that may die over one point before the run gives it up."""


class Executor(Protocol):
    """Where points are computed."""

    def map_unordered(
        self, function: Callable[[Point], Value], points: Sequence[Point]
    ) -> Generator[tuple[int, Value | Raised], None, None]:
        """Compute every point once, and give its place in ``points`` with its value as soon as it is there.

        Parameters
        ----------
        function
            A function of a module, without random state of its own; it is named, not sent, to other processes.
        points
            Its arguments; they are pickled for other processes.

        Raises
        ------
        LostPointError
            Workers died over one point again and again.
        UnavailableError
            There is nothing to compute with.
        """
        ...


class UnavailableError(TradestudyError):
    """What was asked to compute the points cannot be reached, or cannot be used."""

    exit_status = 2


class LostPointError(Exception):
    """Workers died over one point; ``index`` is its place among the points."""

    def __init__(self, index: int, deaths: int) -> None:
        super().__init__(index, deaths)
        self.index, self.deaths = index, deaths


@dataclass(frozen=True)
class Serial:
    """One point after another, here."""

    def map_unordered(
        self, function: Callable[[Point], Value], points: Sequence[Point]
    ) -> Generator[tuple[int, Value | Raised], None, None]:
        """As `Executor` says."""
        for index, point in enumerate(points):
            yield index, attempt(function, point)


def refuse_fewer_than_one(count: int, what: str) -> None:
    """Workers are counted from one.

    Raises
    ------
    OutOfRangeError
        For fewer.
    """
    if count < 1:
        raise OutOfRangeError(what, value=str(count), limit="1 or more", remedy="leave it out to compute serially")

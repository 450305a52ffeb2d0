"""What computes points: any of several ways, all of which give the same bits; the simplest ones stand here."""

from __future__ import annotations

import traceback
from collections import deque
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from queue import SimpleQueue
from threading import Thread
from typing import Any, Protocol, TypeVar

from tradestudy.errors import OutOfRangeError, TradestudyError

Point = TypeVar("Point")
Value = TypeVar("Value")


@dataclass(frozen=True)
class Raised:
    """An error on its way to whoever asked; its traceback travels as a note, for ``--debug``."""

    error: Exception

    def __reduce__(self) -> tuple[Any, ...]:
        trace = "".join(traceback.format_exception(self.error))
        return _raised_elsewhere, (type(self.error), self.error.args, dict(self.error.__dict__), trace)


def _raised_elsewhere(kind: type[Exception], arguments: tuple[Any, ...], state: dict[str, Any], trace: str) -> Raised:
    # Not through the constructor: those of this package take keywords, which the standard way of exceptions drops.
    error = kind.__new__(kind, *arguments)
    error.args = arguments
    error.__dict__.update(state)
    error.add_note(f"where it was computed:\n{trace}")
    return Raised(error)


def attempt(function: Callable[[Point], Value], point: Point) -> Value | Raised:
    """Compute one point."""
    try:
        return function(point)
    except Exception as error:
        return Raised(error)


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


@dataclass(frozen=True)
class Threads:
    """Threads of this process: they cost nothing to start, and share its memory and its interpreter.

    Parameters
    ----------
    count
        Number of threads, 1 or more.
    """

    count: int

    def __post_init__(self) -> None:
        refuse_fewer_than_one(self.count, "number of threads")

    def map_unordered(
        self, function: Callable[[Point], Value], points: Sequence[Point]
    ) -> Generator[tuple[int, Value | Raised], None, None]:
        """As `Executor` says."""
        waiting = deque(enumerate(points))
        done: SimpleQueue[tuple[int, Value | Raised]] = SimpleQueue()

        def work() -> None:
            while True:
                try:
                    index, point = waiting.popleft()
                except IndexError:
                    return
                done.put((index, attempt(function, point)))

        # Daemons of our own: those of the standard library would finish their points before an interrupted run ends.
        for _ in range(min(self.count, len(points))):
            Thread(target=work, daemon=True).start()
        try:
            for _ in range(len(points)):
                yield done.get()
        finally:
            waiting.clear()

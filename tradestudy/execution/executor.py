"""How points are computed: executors, which all give identical bits, and the progress that a point reports."""

from __future__ import annotations

import traceback
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from queue import SimpleQueue
from threading import Thread
from typing import Any, Final, Protocol, TypeVar

from tradestudy.errors import OutOfRangeError, TradestudyError

Point = TypeVar("Point")
Value = TypeVar("Value")


@dataclass(frozen=True)
class Raised:
    """An error returned to the caller, with its traceback as a note for ``--debug``."""

    error: Exception

    def __reduce__(self) -> tuple[Any, ...]:
        trace = "".join(traceback.format_exception(self.error))
        return _raised_elsewhere, (type(self.error), self.error.args, dict(self.error.__dict__), trace)


def _raised_elsewhere(kind: type[Exception], arguments: tuple[Any, ...], state: dict[str, Any], trace: str) -> Raised:
    # Bypass the constructor: this package's errors take keywords, which standard pickling of exceptions drops.
    error = kind.__new__(kind, *arguments)
    error.args = arguments
    error.__dict__.update(state)
    error.add_note(f"raised in a worker:\n{trace}")
    return Raised(error)


def attempt(function: Callable[[Point], Value], point: Point) -> Value | Raised:
    """Compute one point; return its error instead of raising it.

    If a library tries to end the program, only this point fails.
    """
    try:
        return function(point)
    except Exception as error:
        return Raised(error)
    except SystemExit as ending:
        failed = RuntimeError(f"the computation of a point tried to end the program with status {ending.code}")
        failed.__cause__ = ending
        return Raised(failed)


class Executor(Protocol):
    """Computes points."""

    def map_unordered(
        self, function: Callable[[Point], Value], points: Sequence[Point]
    ) -> Generator[tuple[int, Value | Raised], None, None]:
        """Compute every point once, and yield its index in ``points`` with its value as soon as it is done.

        Parameters
        ----------
        function
            A module-level function without random state of its own; other processes import it by name.
        points
            Its arguments, which are pickled for other processes.

        Raises
        ------
        LostPointError
            Workers died repeatedly over one point.
        UnavailableError
            The requested workers cannot be reached or used.
        """
        ...


class UnavailableError(TradestudyError):
    """The requested workers cannot be reached or used."""

    exit_status = 2


class LostPointError(Exception):
    """Workers died over one point; ``index`` is its position among the points."""

    def __init__(self, index: int, deaths: int) -> None:
        super().__init__(index, deaths)
        self.index, self.deaths = index, deaths


@dataclass(frozen=True)
class Serial:
    """Computes one point after another in this thread."""

    def map_unordered(
        self, function: Callable[[Point], Value], points: Sequence[Point]
    ) -> Generator[tuple[int, Value | Raised], None, None]:
        """See `Executor.map_unordered`."""
        for index, point in enumerate(points):
            yield index, attempt(function, point)


def refuse_fewer_than_one(count: int, what: str) -> None:
    """Refuse a number of workers below one.

    Raises
    ------
    OutOfRangeError
        The count is below one.
    """
    if count < 1:
        raise OutOfRangeError(what, value=str(count), limit="1 or more", remedy="leave it out to compute serially")


@dataclass(frozen=True)
class Threads:
    """Threads of this process, which cost nothing to start and share its memory and interpreter.

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
        """See `Executor.map_unordered`."""
        waiting = deque(enumerate(points))
        done: SimpleQueue[tuple[int, Value | Raised]] = SimpleQueue()

        def work() -> None:
            while True:
                try:
                    index, point = waiting.popleft()
                except IndexError:
                    return
                done.put((index, attempt(function, point)))

        # Our own daemon threads: the standard pool would finish its points before an interrupted run could end.
        for _ in range(min(self.count, len(points))):
            Thread(target=work, daemon=True).start()
        try:
            for _ in range(len(points)):
                yield done.get()
        finally:
            waiting.clear()


Listener = Callable[[float], None]


_listener: Final[ContextVar[Listener]] = ContextVar("_listener", default=lambda _share: None)


def tell(share: float) -> None:
    """Report the fraction of the running point that is done, from 0 to 1.

    Nobody listens in other processes and threads, nor outside a step.
    """
    _listener.get()(share)


@contextmanager
def heard_by(listener: Listener) -> Iterator[None]:
    """Call the listener with what computations within this block `tell`."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


@contextmanager
def part_of_point(begin: float, end: float) -> Iterator[None]:
    """Within this block, 0 to 1 stand for ``begin`` to ``end`` of what surrounds it."""
    outer = _listener.get()
    with heard_by(lambda share: outer(begin + share * (end - begin))):
        yield
    outer(end)

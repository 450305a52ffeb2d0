"""Points on processes of this machine, which may die without taking more than their own point with them."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from threading import Thread
from typing import Any, Final

from tradestudy.execution.executor import (
    LostPointError,
    Point,
    Raised,
    UnavailableError,
    Value,
    attempt,
    refuse_fewer_than_one,
)

MOST_DEATHS: Final = 3
"""Workers that may die over one point before the run gives it up."""
_BEGINNING: Final = -1  # the place of no point: the worker is being started
_NO_COMPLAINT: Final = "ignore:resource_tracker"


@dataclass(frozen=True)
class Processes:
    """Worker processes, each with an interpreter of its own; one that dies is replaced.

    They are started anew (not forked, which would copy locks that other threads hold), so a script that asks for them
    needs the usual ``if __name__ == "__main__":`` around what it does.

    Parameters
    ----------
    count
        Number of processes, 1 or more.
    """

    count: int

    def __post_init__(self) -> None:
        refuse_fewer_than_one(self.count, "number of worker processes")

    def map_unordered(
        self, function: Callable[[Point], Value], points: Sequence[Point]
    ) -> Generator[tuple[int, Value | Raised], None, None]:
        """As `Executor` says; a worker has one point at a time, so a death costs the one point that it interrupts."""
        waiting = deque(range(len(points)))
        deaths: Counter[int] = Counter()
        pools: list[ProcessPoolExecutor] = []
        underway: dict[Future[Any], tuple[ProcessPoolExecutor, int]] = {}
        watched, run = multiprocessing.Pipe(duplex=False)

        def start() -> None:
            with _started_quietly():
                # Of one process: a death breaks the whole pool, and does not tell over which of its points.
                pool = ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), _end_with, (watched,))
                pools.append(pool)
                underway[pool.submit(os.getpid)] = pool, _BEGINNING

        def employ(pool: ProcessPoolExecutor) -> None:
            if waiting:
                try:
                    future = pool.submit(attempt, function, points[waiting[0]])
                except BrokenProcessPool:  # its process died between two points
                    start()
                else:
                    underway[future] = pool, waiting.popleft()

        try:
            for _ in range(min(self.count, len(points))):
                start()
            while underway:
                for future in wait(underway, return_when=FIRST_COMPLETED).done:
                    pool, index = underway.pop(future)
                    try:
                        outcome = future.result()
                    except BrokenProcessPool:
                        if index == _BEGINNING:
                            raise UnavailableError(
                                "a worker process died before it could begin",
                                remedy="compute serially; a script that asks for processes needs "
                                "'if __name__ == \"__main__\":'",
                            ) from None
                        deaths[index] += 1
                        if deaths[index] >= MOST_DEATHS:
                            raise LostPointError(index, deaths[index]) from None
                        waiting.appendleft(index)
                        start()
                        continue
                    except Exception as error:  # not of the point, whose errors are values
                        outcome = Raised(TypeError(f"the value of a point cannot be sent: {error}"))
                    employ(pool)  # before the result is handed on: no worker waits for whoever takes it
                    if index != _BEGINNING:
                        yield index, outcome
        finally:
            run.close()  # ends the workers, whatever they are at
            for pool in pools:
                pool.shutdown()


@contextmanager
def _started_quietly() -> Iterator[None]:
    """Nothing that is started here sees Ctrl-C, which a terminal sends to all: the run ends its workers itself.

    Nor does the tracker of semaphores complain that a run which was killed has left it some to remove.
    """
    if os.name != "posix":
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    sys.warnoptions.append(_NO_COMPLAINT)
    try:
        yield
    finally:
        sys.warnoptions.remove(_NO_COMPLAINT)
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _end_with(watched: Connection) -> None:
    """Have a worker end itself as soon as its run closes the other end of the pipe, or is killed."""

    def watch() -> None:
        with suppress(EOFError):
            watched.recv()
        os._exit(1)

    Thread(target=watch, daemon=True).start()

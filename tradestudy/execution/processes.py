"""Compute points on processes of this machine; a process that dies takes only its current point with it."""

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
"""Workers that may die over one point before the run gives up on it."""
_BEGINNING: Final = -1  # index of no point: the worker is starting
_NO_COMPLAINT: Final = "ignore:resource_tracker"


@dataclass(frozen=True)
class Processes:
    """Worker processes, each with its own interpreter; one that dies is replaced.

    They are spawned, not forked (a fork would copy locks that other threads hold), so a script that uses them
    needs the usual ``if __name__ == "__main__":`` guard.

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
        """See `Executor.map_unordered`; a worker holds one point at a time, so a death costs only that point."""
        waiting = deque(range(len(points)))
        deaths: Counter[int] = Counter()
        pools: list[ProcessPoolExecutor] = []
        underway: dict[Future[Any], tuple[ProcessPoolExecutor, int]] = {}
        watched, run = multiprocessing.Pipe(duplex=False)

        def start() -> None:
            with _started_quietly():
                # One process per pool: a death breaks the whole pool without saying which point caused it.
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
                                "a worker process died before it could start",
                                remedy="compute serially; a script that uses processes needs "
                                "'if __name__ == \"__main__\":'",
                            ) from None
                        deaths[index] += 1
                        if deaths[index] >= MOST_DEATHS:
                            raise LostPointError(index, deaths[index]) from None
                        waiting.appendleft(index)
                        start()
                        continue
                    except Exception as error:  # not from the point: its errors arrive as values
                        outcome = Raised(TypeError(f"the value of a point cannot be sent: {error}"))
                    employ(pool)  # before the result is yielded, so that no worker waits for the consumer
                    if index != _BEGINNING:
                        yield index, outcome
        finally:
            run.close()  # ends the workers at once
            for pool in pools:
                pool.shutdown()


@contextmanager
def _started_quietly() -> Iterator[None]:
    """Block Ctrl-C for processes started here: a terminal sends it to all of them, but the run ends its own workers.

    Also keep the semaphore tracker from complaining when it cleans up after a killed run.
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
    """End this worker as soon as its run closes the other end of the pipe or is killed."""

    def watch() -> None:
        with suppress(EOFError):
            watched.recv()
        os._exit(1)

    Thread(target=watch, daemon=True).start()

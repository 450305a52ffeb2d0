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
from dataclasses import dataclass, field
from multiprocessing import forkserver, resource_tracker
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
"""Number of workers that may die over one point before the run stops."""
_BEGINNING: Final = -1  # in place of an index while a worker starts
_NO_COMPLAINT: Final = "ignore:resource_tracker"
# Workers are forked from a process without threads: a fork of this one would copy locks held by its threads. On macOS,
# no fork is safe.
_FORKING: Final = sys.platform == "linux"


@dataclass(frozen=True)
class _Worker:
    """One process, in its own pool: a dying process breaks its whole pool without showing which point caused it."""

    pool: ProcessPoolExecutor
    run: Connection
    """The process ends when this is closed."""

    @classmethod
    def started(cls) -> tuple[_Worker, Future[int]]:
        """A new worker, and a future that is done once it has started."""
        watched, run = multiprocessing.Pipe(duplex=False)
        with _started_quietly():
            context = multiprocessing.get_context("forkserver" if _FORKING else "spawn")
            pool = ProcessPoolExecutor(1, context, _end_with, (watched,))
            return cls(pool, run), pool.submit(os.getpid)


@dataclass(frozen=True)
class Processes:
    """Worker processes, each with its own interpreter; one that dies is replaced.

    Each runs the calling script again, which needs the usual ``if __name__ == "__main__":`` guard. They wait for
    further points until `close`, or as long as this object exists. On Linux, the process from which they are forked
    starts loading at once and stays until the program ends.

    Parameters
    ----------
    count
        Number of processes, 1 or more.
    preload
        Modules that most points need. On Linux, they are loaded once for all workers of this program.
    """

    count: int
    preload: tuple[str, ...] = ()
    _idle: list[_Worker] = field(default_factory=list, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        refuse_fewer_than_one(self.count, "number of worker processes")
        if _FORKING:
            with _started_quietly():
                multiprocessing.set_forkserver_preload(list(self.preload))
                forkserver.ensure_running()

    def map_unordered(
        self, function: Callable[[Point], Value], points: Sequence[Point]
    ) -> Generator[tuple[int, Value | Raised], None, None]:
        """See `Executor.map_unordered`; a worker has one point at a time, so its death costs only that point."""
        waiting = deque(range(len(points)))
        deaths: Counter[int] = Counter()
        underway: dict[Future[Any], tuple[_Worker, int]] = {}

        def start() -> None:
            worker, starting = _Worker.started()
            underway[starting] = worker, _BEGINNING

        def employ(worker: _Worker) -> None:
            if not waiting:
                self._idle.append(worker)
                return
            try:
                future = worker.pool.submit(attempt, function, points[waiting[0]])
            except BrokenProcessPool:  # the process died between two points
                _end([worker])
                start()
            else:
                underway[future] = worker, waiting.popleft()

        try:
            for _ in range(min(self.count, len(points))):
                employ(self._idle.pop()) if self._idle else start()
            while underway:
                for future in wait(underway, return_when=FIRST_COMPLETED).done:
                    worker, index = underway.pop(future)
                    try:
                        outcome = future.result()
                    except BrokenProcessPool:
                        _end([worker])
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
                    except Exception as error:  # not an error of the point, which would arrive as a value
                        outcome = Raised(TypeError(f"the value of a point cannot be sent: {error}"))
                    employ(worker)  # before yielding, so that no worker waits for the consumer
                    if index != _BEGINNING:
                        yield index, outcome
        finally:
            _end([worker for worker, _ in underway.values()])

    def close(self) -> None:
        """End the workers that wait for further points."""
        while self._idle:
            _end([self._idle.pop()])


def _end(workers: Sequence[_Worker]) -> None:
    """End workers at once, even while they compute."""
    for worker in workers:
        worker.run.close()
    for worker in workers:
        worker.pool.shutdown()


@contextmanager
def _started_quietly() -> Iterator[None]:
    """Block Ctrl-C, which a terminal also sends to the processes started here: the run itself ends its workers.

    Also keep the semaphore tracker from warning when it cleans up after a killed run.
    """
    if os.name != "posix":
        yield
        return
    sys.warnoptions.append(_NO_COMPLAINT)
    resource_tracker.ensure_running()  # starting it unblocks Ctrl-C
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        sys.warnoptions.remove(_NO_COMPLAINT)
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _end_with(watched: Connection) -> None:
    """End this worker as soon as its run is killed or closes the other end of the pipe."""

    def watch() -> None:
        with suppress(EOFError):
            watched.recv()
        os._exit(1)

    Thread(target=watch, daemon=True).start()

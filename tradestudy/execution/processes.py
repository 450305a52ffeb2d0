"""Points on processes of this machine, which may die without taking more than their own point with them."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from threading import Thread
from typing import Any, Final

from tradestudy.execution.executor import MOST_DEATHS, LostPointError, UnavailableError, refuse_fewer_than_one
from tradestudy.execution.outcome import Point, Raised, Value, attempt

_READY: Final = -1
_IDLE: Final = None
_PATIENCE: Final = 2.0  # s, for a worker told to end


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
        """As `Executor` says; points go out one at a time, so a death costs the one point that it interrupts."""
        waiting = deque(range(len(points)))
        deaths: Counter[int] = Counter()
        workers = [_Worker.start(function) for _ in range(min(self.count, len(points)))]
        left = len(points)
        try:
            while left:
                for worker in _heard(workers):
                    try:
                        index, outcome = worker.connection.recv()
                    except (EOFError, OSError):
                        workers.remove(worker)
                        _bury(worker, deaths, waiting)
                        workers.append(_Worker.start(function))
                        continue
                    worker.ready, worker.underway = True, _IDLE
                    # Before the result is handed on, so that the worker does not wait for whoever takes it.
                    _employ(worker, waiting, points)
                    if index != _READY:
                        left -= 1
                        yield index, outcome
                for worker in workers:  # a point taken back from the dead goes to whoever is idle
                    if worker.ready and worker.underway is _IDLE:
                        _employ(worker, waiting, points)
        finally:
            for worker in workers:
                worker.process.terminate()
            for worker in workers:
                worker.end()


@dataclass(eq=False)
class _Worker:
    """A process, the pipe to it, and the point that it is computing."""

    process: BaseProcess
    connection: Connection
    ready: bool = False
    underway: int | None = field(default=_IDLE)

    @classmethod
    def start(cls, function: Callable[[Any], Any]) -> _Worker:
        context = multiprocessing.get_context("spawn")
        here, there = context.Pipe()
        process = context.Process(target=_work, args=(there, function), daemon=True)
        with _deaf_to_control_c():
            process.start()
        there.close()  # or its end would never be seen here
        return cls(process, here)

    def end(self) -> None:
        self.connection.close()
        self.process.join(_PATIENCE)
        if self.process.is_alive():
            self.process.kill()
            self.process.join()
        self.process.close()


def _heard(workers: list[_Worker]) -> list[_Worker]:
    """Wait for workers that have something to say, or have died."""
    speaking = wait([worker.connection for worker in workers])
    return [worker for worker in workers if worker.connection in speaking]


def _employ(worker: _Worker, waiting: deque[int], points: Sequence[Any]) -> None:
    if not waiting:
        return
    worker.underway = waiting.popleft()
    with suppress(BrokenPipeError):  # it has died: its end of the pipe will tell so next
        worker.connection.send((worker.underway, points[worker.underway]))


def _bury(worker: _Worker, deaths: Counter[int], waiting: deque[int]) -> None:
    """Take back the point of a worker that has died."""
    worker.end()
    if not worker.ready:
        raise UnavailableError(
            "a worker process died before it could begin",
            remedy="compute serially; a script that asks for processes needs 'if __name__ == \"__main__\":'",
        )
    if worker.underway is _IDLE:
        return
    deaths[worker.underway] += 1
    if deaths[worker.underway] >= MOST_DEATHS:
        raise LostPointError(worker.underway, deaths[worker.underway])
    waiting.appendleft(worker.underway)


@contextmanager
def _deaf_to_control_c() -> Iterator[None]:
    """Processes started here never see Ctrl-C, which a terminal sends to all: the run ends them itself."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _work(connection: Connection, function: Callable[[Any], Any]) -> None:
    """What a worker process does: take a point, compute it, give its value back."""
    Thread(target=_end_with_the_run, daemon=True).start()
    with suppress(EOFError, OSError):  # the run has gone
        connection.send((_READY, None))
        while True:
            index, point = connection.recv()
            outcome = attempt(function, point)
            connection.send_bytes(_message(index, outcome))


def _message(index: int, outcome: object) -> bytes:
    try:
        return pickle.dumps((index, outcome), protocol=pickle.HIGHEST_PROTOCOL)
    except Exception as error:
        return pickle.dumps((index, Raised(TypeError(f"the value of a point cannot be sent: {error}"))))


def _end_with_the_run() -> None:
    """A run that is killed cannot end its workers; they do it themselves."""
    run = multiprocessing.parent_process()
    if run is not None:
        wait([run.sentinel])
        os._exit(1)

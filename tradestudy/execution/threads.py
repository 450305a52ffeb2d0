"""Points on threads of this process."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from queue import SimpleQueue
from threading import Thread

from tradestudy.execution.executor import Point, Raised, Value, attempt, refuse_fewer_than_one


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

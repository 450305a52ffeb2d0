"""Points on the workers of a Dask cluster that somebody has started."""

from __future__ import annotations

import math
import pickle
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass, field
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, Final

from tradestudy.errors import TradestudyError
from tradestudy.execution.dask_connection import SAME_CODE, connected
from tradestudy.execution.environment import environment
from tradestudy.execution.executor import LostPointError, Point, Raised, UnavailableError, Value, attempt

if TYPE_CHECKING:
    from distributed import Client, Future

GRAIN: Final = 0.2
"""Seconds of work that go to a worker at once: one point, or as many cheap ones as take this long."""
_LOOK_AGAIN: Final = 2.0  # s without a result until the cluster is looked at
_WITHOUT_WORKERS: Final = 30.0  # s until a cluster that has lost all its workers is given up


class ClusterLostError(TradestudyError):
    """The cluster went away during a run."""


@dataclass(frozen=True)
class DaskCluster:
    """A Dask cluster by the address of its scheduler; its workers need this very version of the program.

    A worker that dies costs the points that it was computing; Dask gives them to others.

    Parameters
    ----------
    address
        Such as ``tcp://10.0.0.1:8786``.
    timeout
        Seconds to wait for the scheduler, and then for a worker.
    """

    address: str
    timeout: float = 5.0

    def check(self) -> None:
        """See that the cluster answers and that its workers compute as this process does.

        Raises
        ------
        UnavailableError
            Dask is not installed; the scheduler does not answer; it has no workers; a worker runs other code.
        """
        with connected(self.address, self.timeout):
            pass

    def map_unordered(
        self, function: Callable[[Point], Value], points: Sequence[Point]
    ) -> Generator[tuple[int, Value | Raised], None, None]:
        """As `Executor` says.

        Raises
        ------
        ClusterLostError
            The scheduler, or the last worker, went away.
        """
        if not points:
            return
        with connected(self.address, self.timeout) as client:
            work = _Work(client=client, address=self.address, function=function, points=points)
            while work.left:
                work.submit()
                yield from work.received()


@dataclass(kw_only=True)
class _Work:
    """Points on their way: sent in chunks, whose size follows the time that points take."""

    client: Client
    address: str
    function: Callable[[Any], Any]
    points: Sequence[Any]
    computed: int = 0
    seconds: float = 0.0
    underway: dict[Future[Any], list[int]] = field(default_factory=dict)
    suspects: deque[int] = field(default_factory=deque)  # were on workers that died; computed alone to find the one
    alone: bool = False
    done: SimpleQueue[Future[Any]] = field(default_factory=SimpleQueue)

    def __post_init__(self) -> None:
        self.waiting = deque(range(len(self.points)))
        self.threads: int = max(1, sum(self.client.nthreads().values()))

    @property
    def left(self) -> int:
        return len(self.points) - self.computed

    def submit(self) -> None:
        """Give every thread of the cluster one chunk, and no more.

        A worker has nothing to compute until its last results have been fetched, or they would die with it.
        """
        self.alone = bool(self.suspects) and not self.underway
        if self.alone:
            self._send([self.suspects.popleft()])
        while self.waiting and not self.suspects and len(self.underway) < self.threads:
            self._send([self.waiting.popleft() for _ in range(min(self._chunk_size(), len(self.waiting)))])

    def _send(self, chunk: list[int]) -> None:
        # As bytes of our own, since Dask would look for its futures in every part of a point.
        payload = pickle.dumps((self.function, [self.points[index] for index in chunk]))
        future = self.client.submit(_compute, payload, environment(), pure=False)
        self.underway[future] = chunk
        future.add_done_callback(self.done.put)

    def _chunk_size(self) -> int:
        if not self.computed:
            return 1
        affordable = int(GRAIN * self.computed / max(self.seconds, 1e-9))
        return max(1, min(affordable, math.ceil(len(self.waiting) / self.threads / 2)))

    def received(self) -> Iterator[tuple[int, Any]]:
        """Wait for a chunk and give what it holds."""
        from distributed.scheduler import KilledWorker

        future = self._next()
        chunk = self.underway.pop(future)
        try:
            seconds, outcomes = pickle.loads(future.result())
        except KilledWorker as killed:
            if self.alone:
                raise LostPointError(chunk[0], killed.allowed_failures + 1) from killed
            self.suspects.extend(chunk)  # whatever the dead workers had: Dask cannot tell which it was
            return
        except Exception as error:  # by the worker around the points, which themselves raise nothing
            if future.status != "error":
                raise self._lost() from error
            raise UnavailableError(
                "a worker of the Dask cluster cannot compute", value=f"{self.address}: {error}", remedy=SAME_CODE
            ) from error
        self.seconds += seconds
        self.computed += len(chunk)
        yield from zip(chunk, outcomes, strict=True)

    def _next(self) -> Future[Any]:
        """The next future that is done, unless the cluster is."""
        empty_since: float | None = None
        while True:
            try:
                return self.done.get(timeout=_LOOK_AGAIN)
            except Empty:  # look at the cluster
                pass
            if self._has_workers():
                empty_since = None
            elif empty_since is None:
                empty_since = time.monotonic()
            elif time.monotonic() - empty_since > _WITHOUT_WORKERS:
                raise self._lost()

    def _has_workers(self) -> bool:
        try:
            return bool(self.client.nthreads())
        except Exception as error:  # whatever the client says where its scheduler is gone
            raise self._lost() from error

    def _lost(self) -> ClusterLostError:
        return ClusterLostError(
            "the Dask cluster was lost", value=self.address, remedy="what is finished is kept; run again"
        )


def _compute(payload: bytes, expected: dict[str, str]) -> bytes:
    """Compute a chunk on a worker, which may have joined after the others were checked."""
    if environment() != expected:
        raise RuntimeError(f"other code than that of the run: {environment()}, not {expected}")
    function, points = pickle.loads(payload)
    begin = time.perf_counter()
    outcomes = [attempt(function, point) for point in points]
    return pickle.dumps((time.perf_counter() - begin, outcomes), protocol=pickle.HIGHEST_PROTOCOL)

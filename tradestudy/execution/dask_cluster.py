"""Points on the workers of a Dask cluster that somebody has started."""

from __future__ import annotations

import math
import re
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from tradestudy.errors import TradestudyError
from tradestudy.execution.executor import LostPointError, Point, Raised, UnavailableError, Value, attempt
from tradestudy.execution.fingerprint import environment

if TYPE_CHECKING:
    from distributed import Client, Future

# Checked here, since a client that cannot read its address neither starts nor ends.
_ADDRESS: Final = re.compile(r"(tcp|tls|ws|wss)://[^\s/:]+:\d{1,5}")
_SAME_CODE: Final = "install the same tradestudy and libraries on every worker as here"
_GRAIN: Final = 0.2
"""Seconds of work that go to a worker at once, as sending a point takes 20 ms: one point, or as many cheap ones."""
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
        with self._connected():
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
        from distributed.scheduler import KilledWorker

        waiting, suspects = deque(range(len(points))), deque[int]()
        underway: dict[Future[Any], list[int]] = {}
        computed, seconds = 0, 0.0
        with self._connected() as client:

            def send(chunk: list[int]) -> None:
                future = client.submit(_compute, function, [points[i] for i in chunk], environment(), pure=False)
                underway[future] = chunk

            threads = max(1, sum(client.nthreads().values()))
            while waiting or suspects or underway:
                alone = bool(suspects) and not underway
                if alone:
                    send([suspects.popleft()])
                # No more than one chunk to a thread: results that wait on a worker would die with it, and Dask blames
                # everything that a dead worker had, also what it had not begun.
                while waiting and not (alone or suspects) and len(underway) < threads:
                    affordable = int(_GRAIN * computed / max(seconds, 1e-9))
                    size = max(1, min(affordable, math.ceil(len(waiting) / threads / 2)))
                    send([waiting.popleft() for _ in range(min(size, len(waiting)))])
                for future in self._done(client, underway):
                    chunk = underway.pop(future)
                    try:
                        took, outcomes = future.result()
                    except KilledWorker as killed:
                        if alone:
                            raise LostPointError(chunk[0], killed.allowed_failures + 1) from killed
                        suspects.extend(chunk)  # of all that the dead workers had; computed alone to find the one
                        continue
                    except Exception as error:  # by the worker around the points, whose own errors are values
                        raise self._lost() if future.status != "error" else self._unable(error) from error
                    seconds, computed = seconds + took, computed + len(chunk)
                    yield from zip(chunk, outcomes, strict=True)

    @contextmanager
    def _connected(self) -> Iterator[Client]:
        """Give a client of a cluster whose workers compute as this process does."""
        try:
            from distributed import Client
        except ModuleNotFoundError as error:
            raise UnavailableError("Dask is not installed", remedy="pip install 'tradestudy[dask]'") from error
        if not _ADDRESS.fullmatch(self.address):
            raise UnavailableError(
                "this cannot be the address of a Dask scheduler",
                value=repr(self.address),
                limit="such as tcp://10.0.0.1:8786",
                remedy="a scheduler says its own when it starts",
            )
        try:
            client = Client(self.address, timeout=self.timeout, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            raise UnavailableError(
                "no Dask scheduler answers",
                value=self.address,
                remedy="start one with 'dask scheduler' and 'dask worker'",
            ) from error
        try:
            self._check_workers(client)
            yield client
        finally:
            client.close(timeout=self.timeout)

    def _check_workers(self, client: Client) -> None:
        try:
            client.wait_for_workers(1, timeout=self.timeout)
        except TimeoutError as error:
            raise UnavailableError(
                "the Dask cluster has no workers", value=self.address, remedy=f"start one: dask worker {self.address}"
            ) from error
        try:
            found: dict[str, dict[str, str]] = client.run(environment)
        except Exception as error:
            raise self._unable(error) from error
        for worker, theirs in found.items():
            differing = [
                f"{name} {theirs.get(name, 'none')[:12]} there, {ours[:12]} here"
                for name, ours in environment().items()
                if theirs.get(name) != ours
            ]
            if differing:
                raise UnavailableError(
                    f"the Dask worker {worker} computes with other code", value="; ".join(differing), remedy=_SAME_CODE
                )

    def _done(self, client: Client, underway: Iterable[Future[Any]]) -> Iterable[Future[Any]]:
        """Wait for points that are done, unless the cluster is."""
        from distributed import wait

        with_workers = time.monotonic()
        while time.monotonic() - with_workers < _WITHOUT_WORKERS:
            try:
                with client.as_current():
                    found = wait(list(underway), timeout=_LOOK_AGAIN, return_when="FIRST_COMPLETED")
            except TimeoutError:  # look at the cluster
                if self._has_workers(client):
                    with_workers = time.monotonic()
            except Exception as error:  # futures are cancelled where the scheduler is gone
                raise self._lost() from error
            else:
                done: set[Future[Any]] = found.done
                return done
        raise self._lost()

    def _has_workers(self, client: Client) -> bool:
        try:
            return bool(client.nthreads())
        except Exception as error:  # whatever the client says where its scheduler is gone
            raise self._lost() from error

    def _lost(self) -> ClusterLostError:
        return ClusterLostError(
            "the Dask cluster was lost", value=self.address, remedy="what is finished is kept; run again"
        )

    def _unable(self, error: Exception) -> UnavailableError:
        return UnavailableError(
            "a worker of the Dask cluster cannot compute", value=f"{self.address}: {error}", remedy=_SAME_CODE
        )


def _compute(
    function: Callable[[Point], Value], points: Sequence[Point], expected: dict[str, str]
) -> tuple[float, list[Value | Raised]]:
    """Seconds and values of a chunk on a worker, which may have joined after the others were checked."""
    if environment() != expected:
        raise RuntimeError(f"other code than that of the run: {environment()}, not {expected}")
    begin = time.perf_counter()
    outcomes = [attempt(function, point) for point in points]
    return time.perf_counter() - begin, outcomes

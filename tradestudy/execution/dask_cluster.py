"""Compute points on the workers of a running Dask cluster."""

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
from tradestudy.execution.steps import environment

if TYPE_CHECKING:
    from distributed import Client, Future

# Checked here because a client with an invalid address neither starts nor fails.
_ADDRESS: Final = re.compile(r"(tcp|tls|ws|wss)://[^\s/:]+:\d{1,5}")
_SAME_CODE: Final = "install the same tradestudy and libraries on every worker as here"
_GRAIN: Final = 0.2
"""Seconds of work to send to a worker at once, a point or several short ones, because sending takes 20 ms."""
_LOOK_AGAIN: Final = 2.0  # seconds without a result after which the cluster is checked
_WITHOUT_WORKERS: Final = 30.0  # seconds without a worker after which the cluster counts as lost


class ClusterLostError(TradestudyError):
    """The cluster was lost during a run."""


@dataclass(frozen=True)
class DaskCluster:
    """A Dask cluster, given by the address of its scheduler; its workers must run exactly this version of the program.

    If a worker dies, Dask gives its points to other workers.

    Parameters
    ----------
    address
        Address of the scheduler, such as ``tcp://10.0.0.1:8786``.
    timeout
        Seconds to wait for the scheduler, and then for a worker.
    """

    address: str
    timeout: float = 5.0

    def check(self) -> None:
        """Check that the cluster answers and that its workers run the same code as this process.

        Raises
        ------
        UnavailableError
            Dask is not installed, the scheduler does not answer or has no workers, or a worker runs different code.
        """
        with self._connected():
            pass

    def map_unordered(
        self, function: Callable[[Point], Value], points: Sequence[Point]
    ) -> Generator[tuple[int, Value | Raised], None, None]:
        """See `Executor.map_unordered`.

        Raises
        ------
        ClusterLostError
            The scheduler or the last worker was lost.
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
                # At most one chunk per thread: results waiting on a worker would die with it, and Dask blames every
                # task that a dead worker held, even those it had not started.
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
                        suspects.extend(chunk)  # all that the dead workers held; each runs alone to find the culprit
                        continue
                    except Exception as error:  # from the worker itself: the errors of points arrive as values
                        raise self._lost() if future.status != "error" else self._unable(error) from error
                    seconds, computed = seconds + took, computed + len(chunk)
                    yield from zip(chunk, outcomes, strict=True)

    @contextmanager
    def _connected(self) -> Iterator[Client]:
        """Yield a client of a cluster whose workers run the same code as this process."""
        try:
            from distributed import Client
        except ModuleNotFoundError as error:
            raise UnavailableError("Dask is not installed", remedy="pip install 'tradestudy[dask]'") from error
        if not _ADDRESS.fullmatch(self.address):
            raise UnavailableError(
                "not the address of a Dask scheduler",
                value=repr(self.address),
                limit="addresses such as tcp://10.0.0.1:8786",
                remedy="use the address that the scheduler prints when it starts",
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
            environments: dict[str, dict[str, str]] = client.run(environment)
        except Exception as error:
            raise self._unable(error) from error
        for worker, theirs in environments.items():
            differing = [
                f"{name} {theirs.get(name, 'none')[:12]} there, {ours[:12]} here"
                for name, ours in environment().items()
                if theirs.get(name) != ours
            ]
            if differing:
                raise UnavailableError(
                    f"the Dask worker {worker} runs other code", value="; ".join(differing), remedy=_SAME_CODE
                )

    def _done(self, client: Client, underway: Iterable[Future[Any]]) -> Iterable[Future[Any]]:
        """Wait until some points are done; raise if the cluster is lost meanwhile."""
        from distributed import wait

        with_workers = time.monotonic()
        while time.monotonic() - with_workers < _WITHOUT_WORKERS:
            try:
                with client.as_current():
                    finished = wait(list(underway), timeout=_LOOK_AGAIN, return_when="FIRST_COMPLETED")
            except TimeoutError:  # time to check the cluster
                if self._has_workers(client):
                    with_workers = time.monotonic()
            except Exception as error:  # futures are cancelled when the scheduler is lost
                raise self._lost() from error
            else:
                done: set[Future[Any]] = finished.done
                return done
        raise self._lost()

    def _has_workers(self, client: Client) -> bool:
        try:
            return bool(client.nthreads())
        except Exception as error:  # the client may raise anything when it has lost its scheduler
            raise self._lost() from error

    def _lost(self) -> ClusterLostError:
        return ClusterLostError(
            "the Dask cluster was lost", value=self.address, remedy="run again; finished points are kept"
        )

    def _unable(self, error: Exception) -> UnavailableError:
        return UnavailableError(
            "a worker of the Dask cluster cannot compute", value=f"{self.address}: {error}", remedy=_SAME_CODE
        )


def _compute(
    function: Callable[[Point], Value], points: Sequence[Point], expected: dict[str, str]
) -> tuple[float, list[Value | Raised]]:
    """Compute a chunk on a worker; return seconds and values. Check the worker too, as it may have joined late."""
    if environment() != expected:
        raise RuntimeError(f"the worker runs other code than the run: {environment()}, not {expected}")
    begin = time.perf_counter()
    outcomes = [attempt(function, point) for point in points]
    return time.perf_counter() - begin, outcomes

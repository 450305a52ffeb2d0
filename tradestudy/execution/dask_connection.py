"""The way to a Dask cluster, with a word for each reason why there is none."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

from tradestudy.execution.environment import environment
from tradestudy.execution.executor import UnavailableError

if TYPE_CHECKING:
    from distributed import Client

# Checked here, since a client that cannot read its address neither starts nor ends.
_ADDRESS: Final = re.compile(r"(tcp|tls|ws|wss)://[^\s/:]+:\d{1,5}")
SAME_CODE: Final = "install the same tradestudy and libraries on every worker as here"


@contextmanager
def connected(address: str, timeout: float) -> Iterator[Client]:
    """Give a client of a cluster whose workers compute as this process does.

    Raises
    ------
    UnavailableError
        Dask is not installed; no scheduler answers in ``timeout`` seconds; it has no workers; a worker runs other code.
    """
    try:
        from distributed import Client
    except ModuleNotFoundError as error:
        raise UnavailableError("Dask is not installed", remedy="pip install 'tradestudy[dask]'") from error
    if not _ADDRESS.fullmatch(address):
        raise UnavailableError(
            "this cannot be the address of a Dask scheduler",
            value=repr(address),
            limit="such as tcp://10.0.0.1:8786",
            remedy="a scheduler says its own when it starts",
        )
    try:
        client = Client(address, timeout=timeout, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise UnavailableError(
            "no Dask scheduler answers",
            value=address,
            remedy="start one with 'dask scheduler' and 'dask worker'",
        ) from error
    try:
        _check_workers(client, address, timeout)
        yield client
    finally:
        client.close(timeout=timeout)


def _check_workers(client: Client, address: str, timeout: float) -> None:
    try:
        client.wait_for_workers(1, timeout=timeout)
    except TimeoutError as error:
        raise UnavailableError(
            "the Dask cluster has no workers", value=address, remedy=f"start one: dask worker {address}"
        ) from error
    try:
        found: dict[str, dict[str, str]] = client.run(environment)
    except Exception as error:
        raise UnavailableError(
            "a worker of the Dask cluster cannot compute", value=f"{address}: {error}", remedy=SAME_CODE
        ) from error
    for worker, theirs in found.items():
        differing = [
            f"{name} {theirs.get(name, 'none')[:12]} there, {ours[:12]} here"
            for name, ours in environment().items()
            if theirs.get(name) != ours
        ]
        if differing:
            raise UnavailableError(
                f"the Dask worker {worker} computes with other code", value="; ".join(differing), remedy=SAME_CODE
            )

"""Workers that tests share, because each has a second of libraries to load."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tradestudy.cli import _NEEDED_BY_WORKERS
from tradestudy.execution import Processes


@pytest.fixture(scope="session")
def two_processes() -> Iterator[Processes]:
    """For points that end well; what kills a worker, or asks which one computed, takes workers of its own."""
    shared = Processes(2, preload=_NEEDED_BY_WORKERS)
    yield shared
    shared.close()

"""Seconds that parts of a computation took, kept with the run and apart from its results."""

from __future__ import annotations

import time
from collections.abc import Iterator, MutableMapping
from contextlib import contextmanager

# Wall seconds by the name of what took them; for run.json, never for results, which two equal runs must share.
Seconds = MutableMapping[str, float]


@contextmanager
def timed(seconds: Seconds, name: str) -> Iterator[None]:
    """Add the wall time of a block under a name."""
    begin = time.perf_counter()
    yield
    seconds[name] = seconds.get(name, 0.0) + time.perf_counter() - begin

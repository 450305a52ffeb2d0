"""Compute the independent points of a study serially, on threads, on processes or on a Dask cluster."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tradestudy.execution.dask_cluster import DaskCluster
    from tradestudy.execution.executor import Executor, Serial, Threads
    from tradestudy.execution.processes import Processes
    from tradestudy.execution.steps import Checkpoints, Steps

__all__ = ["Checkpoints", "DaskCluster", "Executor", "Processes", "Serial", "Steps", "Threads"]

_MODULES = {
    "Checkpoints": "steps",
    "DaskCluster": "dask_cluster",
    "Processes": "processes",
    "Steps": "steps",
}


def __getattr__(name: str) -> Any:
    # Loaded on first use, because planning computes no points.
    if name in __all__:
        return getattr(importlib.import_module(f"tradestudy.execution.{_MODULES.get(name, 'executor')}"), name)
    raise AttributeError(f"module 'tradestudy.execution' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__

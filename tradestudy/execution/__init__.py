"""Compute the independent points of a study serially, on threads, on processes or on a Dask cluster."""

from __future__ import annotations

from tradestudy.execution.checkpoints import Checkpoints
from tradestudy.execution.dask_cluster import DaskCluster
from tradestudy.execution.executor import Executor, Serial, Threads
from tradestudy.execution.processes import Processes
from tradestudy.execution.steps import Steps

__all__ = ["Checkpoints", "DaskCluster", "Executor", "Processes", "Serial", "Steps", "Threads"]

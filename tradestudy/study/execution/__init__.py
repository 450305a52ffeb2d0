"""Independent points of a study, computed one after another, on threads, on processes or on a Dask cluster."""

from __future__ import annotations

from tradestudy.study.execution.checkpoints import Checkpoints
from tradestudy.study.execution.dask_cluster import DaskCluster
from tradestudy.study.execution.executor import Executor, Serial
from tradestudy.study.execution.processes import Processes
from tradestudy.study.execution.steps import Steps
from tradestudy.study.execution.threads import Threads

__all__ = ["Checkpoints", "DaskCluster", "Executor", "Processes", "Serial", "Steps", "Threads"]

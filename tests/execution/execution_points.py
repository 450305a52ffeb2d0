"""Points for workers to compute, in a module that they load quickly; each computation leaves a file behind."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tradestudy.errors import OutOfRangeError
from tradestudy.execution.steps import FOLDER, _whole_records
from tradestudy.optics.arrays import FloatArray


@dataclass(frozen=True, kw_only=True)
class LoggedPoint:
    """One point: where it is logged, its number, how long it takes, and what befalls whoever computes it.

    It waits all that time, or computes if it ``works``.
    """

    folder: Path
    number: int
    seconds: float = 0.0
    works: bool = False
    fate: str = ""


def compute(point: LoggedPoint) -> FloatArray:
    """Leave a file, take the time, meet the fate."""
    (point.folder / f"{point.number}.{os.getpid()}.{time.monotonic_ns()}").touch()
    end = time.perf_counter() + point.seconds
    while time.perf_counter() < end:
        if not point.works:
            time.sleep(max(0.0, end - time.perf_counter()))
    if point.fate == "kills always":
        os.kill(os.getpid(), signal.SIGKILL)
    if point.fate == "kills once" and not (point.folder / "killed").exists():
        (point.folder / "killed").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if point.fate == "is refused":
        raise OutOfRangeError("the number", value=str(point.number), limit="another", remedy="choose it")
    if point.fate == "ends the program":
        sys.exit(7)
    if point.fate == "cannot be sent":
        return lambda: None  # type: ignore[return-value]  # on purpose
    return np.random.default_rng(point.number).normal(size=5)


def keys_on_disk(folder: Path) -> set[bytes]:
    """Finished points that an unfinished run has left in its output folder."""
    found: set[bytes] = set()
    for path in (folder / FOLDER).glob("*"):
        with contextlib.suppress(FileNotFoundError):  # the run has finished in the meantime
            found |= {key for key, _, _ in _whole_records(path.read_bytes())}
    return found


def times_computed(folder: Path) -> dict[int, int]:
    """How often each point was computed."""
    counts: dict[int, int] = {}
    for path in folder.glob("*.*.*"):
        number = int(path.name.split(".")[0])
        counts[number] = counts.get(number, 0) + 1
    return counts


def workers(folder: Path) -> set[int]:
    """Processes that computed."""
    return {int(path.name.split(".")[1]) for path in folder.glob("*.*.*")}

"""What holds for every test."""

from __future__ import annotations

import fcntl
import gc
import hashlib
import os
import pickle
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import pytest

if TYPE_CHECKING:
    from tradestudy.api import Result
    from tradestudy.calibration.posteriors import InferredCalibration
    from tradestudy.execution import Processes

Made = TypeVar("Made")

# Read when numpy loads. The matrices of the tests are small: threads that wait for each other on busy cores cost more
# than they give.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Many tests start the program in a process of its own; it is compiled once for all of them, whatever the shell says.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False


def pytest_collection_finish() -> None:
    """Modules and tests live to the end: without this, a tenth of the time goes into looking for garbage in them."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(200_000)


@pytest.fixture(scope="module")
def only_rays() -> Iterator[None]:
    """Skip the trials by waves of pictures that are made by rays: here, waves change nothing.

    For tests that ask something else of many pictures; tests/imaging/test_pictures_by_waves.py tests what it changes.
    """
    from tradestudy.models import scene_pictures

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scene_pictures, "_changed", lambda _trial: (0.0, 1.0))
        yield


@pytest.fixture(scope="module")
def empty_figures() -> Iterator[None]:
    """Reports have all their figures, but nobody draws in them: for tests that ask something else of a run."""
    from tradestudy.figures import drawn
    from tradestudy.figures.drawing import Plotted

    svg = b'<svg xmlns="http://www.w3.org/2000/svg" width="10pt" height="10pt" viewBox="0 0 10 10"></svg>'
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(drawn, "drawn_here", lambda drawings, _progress=None: dict.fromkeys(drawings, Plotted(svg=svg)))
        yield


def made_once(temporary: pytest.TempPathFactory, name: str, make: Callable[[Path], Made]) -> Made:
    """What one worker makes, in a folder for all of them, and the others read: for what takes long."""
    base = temporary.getbasetemp()
    shared = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    kept = shared / f"{name}.pickle"
    with (shared / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not kept.exists():
            kept.write_bytes(pickle.dumps(make(shared)))
    made: Made = pickle.loads(kept.read_bytes())
    return made


@pytest.fixture(scope="session")
def two_processes() -> Iterator[Processes]:
    """Workers that tests share, because each has a second of libraries to load.

    For points that end well; what kills a worker, or asks which one computed, takes workers of its own.
    """
    from tradestudy.cli import _NEEDED_BY_WORKERS
    from tradestudy.execution import Processes

    shared = Processes(2, preload=_NEEDED_BY_WORKERS)
    yield shared
    shared.close()


@dataclass(frozen=True)
class HeadlineRun:
    """How the run ended, and where it wrote."""

    done: subprocess.CompletedProcess[str]
    folder: Path


@pytest.fixture(scope="session")
def headline_run(tmp_path_factory: pytest.TempPathFactory) -> HeadlineRun:
    """The headline study, run strictly by its command, on every core."""

    def run(shared: Path) -> HeadlineRun:
        folder = shared / "headline"
        folder.mkdir()
        study = Path(__file__).parents[1] / "studies" / "plenoptic_vs_stereo.yaml"
        command = [sys.executable, "-m", "tradestudy", "run", str(study), "--strict"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=240, check=False)
        return HeadlineRun(done, folder / "reports" / "plenoptic-vs-stereo")

    return made_once(tmp_path_factory, "headline", run)


@pytest.fixture(scope="session")
def calibrated_webcams(tmp_path_factory: pytest.TempPathFactory) -> InferredCalibration:
    """The webcams calibrated from their corners."""

    def calibrate(_shared: Path) -> InferredCalibration:
        from tests.calibration.cameras import MEASURED, corners, webcams
        from tradestudy.calibration.posteriors import infer

        return infer(corners(webcams(), MEASURED))

    return made_once(tmp_path_factory, "webcams", calibrate)


@pytest.fixture(scope="session")
def run_of(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Result]:
    """Runs a shipped study, by its name and changes, once for all that ask for the same."""

    def run(name: str, *changes: str) -> Result:
        def compute(_shared: Path) -> Result:
            from tradestudy import load

            return load(Path(__file__).parents[1] / "studies" / f"{name}.yaml", changes).run()

        return made_once(tmp_path_factory, f"{name}-{hashlib.sha1(repr(changes).encode()).hexdigest()}", compute)

    return run

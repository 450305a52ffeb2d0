"""How fast this machine is: measured once, remembered in the user's cache folder, and used to predict seconds."""

from __future__ import annotations

import contextlib
import json
import math
import os
import platform
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np

from tradestudy.provenance import cores

REFERENCE_SECONDS: Final[Mapping[str, float]] = {
    "fast Fourier transform": 1.366e-3,
    "complex exponentials": 2.46e-3,
    "matrix products": 7.97e-4,
    "interpreter loop": 1.42e-3,
}
"""Least seconds of each kernel on the reference machine, idle: two cores of an AMD EPYC 9004, November 2026."""

FILE: Final = "machine.json"
_FORMAT: Final = 1
_FEWEST, _LONGEST = 5, 0.15  # repeats, and seconds, of each kernel
_PLAUSIBLE: Final = (1e-3, 1e3)


def identity() -> dict[str, str | int]:
    """What makes two machines the same where seconds are compared."""
    return {
        "processor": _processor(),
        "architecture": platform.machine(),
        "cores": cores(),
    }


def machine_speed(folder: Path | None = None) -> float:
    """Speed of this machine over that of the reference machine, as remembered, or measured now in less than a second.

    Parameters
    ----------
    folder
        Where it is remembered; the user's cache folder unless given. What stands there is ignored, and replaced, where
        it is damaged or belongs to another processor, number of cores or numpy; where nothing can be written the speed
        is measured anew by every process.
    """
    file = (cache_folder() if folder is None else folder) / FILE
    remembered = _remembered(file)
    if remembered is not None:
        return remembered
    measured = measure_kernels()
    speed = speed_of(measured)
    _remember(file, speed, measured)
    return speed


def speed_of(seconds: Mapping[str, float]) -> float:
    """Geometric mean over the kernels of the reference's seconds over these, so that no kernel counts more."""
    ratios = [REFERENCE_SECONDS[name] / seconds[name] for name in REFERENCE_SECONDS]
    return math.exp(math.fsum(map(math.log, ratios)) / len(ratios))


def measure_kernels() -> dict[str, float]:
    """Least seconds of each kernel: whatever else runs on the machine only ever adds."""
    return {name: _least(kernel) for name, kernel in _kernels().items()}


def cache_folder() -> Path:
    """The folder in which the user's programs keep what they can find out again."""
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        given = os.environ.get("XDG_CACHE_HOME", "")
        # The standard says: a path that is not absolute is no path.
        base = Path(given) if given and Path(given).is_absolute() else Path.home() / ".cache"
    return base / "tradestudy"


def _kernels() -> Mapping[str, Callable[[], object]]:
    """What the computations of this program consist of, in small."""
    rng = np.random.default_rng(0)
    field = rng.standard_normal((256, 256)) + 0j
    phase = rng.uniform(-3.0, 3.0, 2**16)
    matrices = rng.standard_normal((200, 48, 48))  # small ones: their products stay on one thread
    return {
        "fast Fourier transform": lambda: np.fft.fft2(field),
        "complex exponentials": lambda: np.exp(1j * phase),
        "matrix products": lambda: matrices @ matrices,
        "interpreter loop": lambda: sum(k * k for k in range(40_000)),
    }


def _least(kernel: Callable[[], object]) -> float:
    taken: list[float] = []
    begin = time.perf_counter()
    while len(taken) < _FEWEST or time.perf_counter() - begin < _LONGEST:
        start = time.perf_counter()
        kernel()
        taken.append(time.perf_counter() - start)
    return min(taken)


def _key() -> dict[str, str | int]:
    """Whose speed it is."""
    return {**identity(), "numpy": np.__version__}


def _remembered(file: Path) -> float | None:
    """The speed in a file; None where there is none that can be believed."""
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    if not isinstance(content, dict) or content.get("format") != _FORMAT or content.get("machine") != _key():
        return None
    speed = content.get("speed")
    # Also refuses NaN; a bool is an int to Python.
    believable = isinstance(speed, float) and _PLAUSIBLE[0] < speed < _PLAUSIBLE[1]
    return speed if believable else None


def _remember(file: Path, speed: float, seconds: Mapping[str, float]) -> None:
    """Write the file whole or not at all; that it cannot be written is no error, only a second each time."""
    content = {
        "format": _FORMAT,
        "machine": _key(),
        "speed": speed,
        "kernel_seconds": dict(seconds),
        "measured": datetime.now(UTC).isoformat(timespec="seconds"),
    }
    temporary = ""
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(
            "w", dir=file.parent, prefix=f".{file.name}.", delete=False, encoding="utf-8"
        ) as stream:
            temporary = stream.name
            json.dump(content, stream, indent=2)
        Path(temporary).replace(file)
    except OSError:
        with contextlib.suppress(OSError):
            if temporary:
                Path(temporary).unlink(missing_ok=True)


@cache
def _processor() -> str:
    """Model of the processor in its maker's words, as far as the system tells."""
    with contextlib.suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines():
            name, _, value = line.partition(":")
            if name.strip() == "model name":
                return value.strip()
    return platform.processor() or platform.machine()

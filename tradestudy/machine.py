"""The machine: what identifies it when computing times are compared, and its free memory."""

from __future__ import annotations

import contextlib
import math
import os
import platform
from functools import cache
from pathlib import Path

from tradestudy.provenance import cores


def identity() -> dict[str, str | int]:
    """Processor, architecture and cores."""
    return {
        "processor": _processor(),
        "architecture": platform.machine(),
        "cores": cores(),
    }


def available_memory() -> float:
    """Bytes available without swapping; infinite if the system does not say."""
    with contextlib.suppress(OSError, ValueError):
        for line in Path("/proc/meminfo").read_text(encoding="utf-8").splitlines():
            name, _, value = line.partition(":")
            if name == "MemAvailable":
                return 1024.0 * float(value.split()[0])
    if hasattr(os, "sysconf") and {"SC_PHYS_PAGES", "SC_PAGE_SIZE"} <= os.sysconf_names.keys():
        return float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    return math.inf


@cache
def _processor() -> str:
    """Model name of the processor, if the system provides one."""
    with contextlib.suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines():
            name, _, value = line.partition(":")
            if name.strip() == "model name":
                return value.strip()
    return platform.processor() or platform.machine()

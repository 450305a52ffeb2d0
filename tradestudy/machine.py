"""What makes two machines the same where seconds are compared."""

from __future__ import annotations

import contextlib
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


@cache
def _processor() -> str:
    """Model of the processor in its maker's words, as far as the system tells."""
    with contextlib.suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines():
            name, _, value = line.partition(":")
            if name.strip() == "model name":
                return value.strip()
    return platform.processor() or platform.machine()

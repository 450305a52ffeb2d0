"""What the headline study costs in a new process: `python tests/benchmarks/headline.py` writes headline.json beside it.

Whole processes, from outside: wall seconds (median and range over the repeats) and peak memory, with the machine and
the versions they were measured on. Times are also given over that of a bare interpreter, which outlives a machine.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from datetime import UTC, datetime
from pathlib import Path

from tradestudy.provenance import machine, versions

HERE = Path(__file__).parent
STUDY = HERE.parents[1] / "studies" / "plenoptic_vs_stereo.yaml"
REPEATS = 5


def measure(*arguments: str) -> dict[str, float]:
    """Wall seconds and peak memory [MB] of a Python process, over the repeats after one warm-up."""
    seconds, memory = [], []
    for repeat in range(REPEATS + 1):
        with tempfile.TemporaryDirectory() as folder:
            begin = time.perf_counter()
            process = subprocess.Popen([sys.executable, *arguments], cwd=folder, stdout=subprocess.DEVNULL)
            _, status, usage = os.wait4(process.pid, 0)
            if status != 0:
                raise SystemExit(f"{arguments} ended with {status}")
            if repeat:
                seconds.append(time.perf_counter() - begin)
                memory.append(usage.ru_maxrss / 1024)
    return {
        "seconds_median": round(statistics.median(seconds), 3),
        "seconds_least": round(min(seconds), 3),
        "seconds_most": round(max(seconds), 3),
        "peak_memory_mb": round(max(memory), 1),
    }


def main() -> None:
    """Measure and write."""
    cases = {
        "bare interpreter": ("-c", "pass"),
        "import tradestudy": ("-c", "import tradestudy"),
        "check": ("-m", "tradestudy", "check", str(STUDY)),
        "run with HTML and PDF": ("-m", "tradestudy", "run", str(STUDY), "--quiet"),
    }
    figures = {name: measure(*arguments) for name, arguments in cases.items()}
    bare = figures["bare interpreter"]["seconds_median"]
    for figure in figures.values():
        figure["over_bare_interpreter"] = round(figure["seconds_median"] / bare, 1)
    record = {
        "measured": datetime.now(UTC).date().isoformat(),
        "repeats": REPEATS,
        "load_average": round(os.getloadavg()[0], 1),
        "machine": machine(),
        "versions": versions(),
        "figures": figures,
    }
    (HERE / "headline.json").write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")
    print(json.dumps(figures, indent=2))


if __name__ == "__main__":
    main()

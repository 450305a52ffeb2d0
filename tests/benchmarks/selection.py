"""How long weighing and choosing models takes: `python tests/benchmarks/selection.py` writes selection.md.

Every study is loaded in a process of its own. The first time it is weighed there, libraries are imported too; then it
is weighed again and again, each time with every cache of the program emptied, as a new plan finds them. Milliseconds
are over the pieces that are weighed: cameras that measure depth, and the light, lens or sharpness asked for; where some
cameras derive their disparity error from the picture, over these alone.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import time
from datetime import UTC, datetime
from pathlib import Path

STUDIES = Path(__file__).parents[2] / "studies"
TABLE = Path(__file__).with_suffix(".md")
REPEATS = 15
LIMIT_MS = 50.0


def weigh(path: Path) -> dict[str, float]:
    """Weigh a study and choose, repeatedly, and say what a piece of it took [ms]."""
    from tradestudy import api
    from tradestudy.cost.measuring import forget
    from tradestudy.study.choice import choose

    definition = api.load(path).definition
    wall, processor = [], []
    for _ in range(REPEATS + 1):
        forget()
        begin = time.perf_counter(), time.process_time()
        situations, _ = choose(definition)
        wall.append(1e3 * (time.perf_counter() - begin[0]))
        processor.append(1e3 * (time.process_time() - begin[1]))
    if not situations:
        return {"pieces": 0}
    derived = sum(not isinstance(one.disparity_error_px, float | int) for one in definition.case.cameras.values())
    shared = derived or len(situations)
    return {
        "pieces": len(situations),
        "derived": derived,
        "first": wall[0] / shared,
        "least": min(wall[1:]) / shared,
        "median": statistics.median(wall[1:]) / shared,
        "processor": statistics.median(processor[1:]) / shared,
    }


def main() -> None:
    """Measure the shipped studies and write the table."""
    load = os.getloadavg()[0]
    rows = []
    for path in sorted(STUDIES.glob("*.yaml")):
        code = f"import json, runpy; from pathlib import Path; m = runpy.run_path({str(Path(__file__))!r}); "
        code += f"print('RECORD' + json.dumps(m['weigh'](Path({str(path)!r}))))"
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        found = json.loads(done.stdout.rpartition("RECORD")[2])
        if not found["pieces"]:
            continue
        verdict = "holds" if found["median"] <= LIMIT_MS else "**misses**"
        rows.append(
            f"| {path.stem} | {found['pieces']} | {found['derived']} | {found['first']:.1f} | {found['least']:.1f} | "
            f"{found['median']:.1f} | {found['processor']:.1f} | {verdict} |"
        )
        print(rows[-1], flush=True)
    lines = [
        "# Milliseconds to weigh and choose the models of one camera",
        "",
        f"Written by `python tests/benchmarks/selection.py` on {datetime.now(UTC).date().isoformat()}; load average",
        f"{load:.1f} at the start, {os.getloadavg()[0]:.1f} at the end, on {os.cpu_count()} cores. Per piece that is",
        "weighed; per derived camera where there are any. *First* is the first time in a process, imports included;",
        f"the others are over {REPEATS} repeats with empty caches, and their median is held against {LIMIT_MS:g} ms.",
        "On a shared machine wall time tells how busy it was; the processor time beside it does so less.",
        "",
        "| study | pieces | derived cameras | first | least | median | processor, median | verdict |",
        "|---|---:|---:|---:|---:|---:|---:|---|",
        *rows,
    ]
    TABLE.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()

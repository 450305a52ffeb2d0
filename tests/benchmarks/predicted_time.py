"""Predicted against measured seconds of every step of the shipped studies, and of the time left after a tenth.

``python tests/benchmarks/predicted_time.py [--busy N] [STUDY …]`` runs each study in a process of its own, one worker,
beside N processes that do nothing but keep a core busy, and writes predicted_time.md beside this file; only the rows of
the given studies are measured anew.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
STUDIES = HERE.parents[1] / "studies"
RECORD, TABLE = HERE / "predicted_time.json", HERE / "predicted_time.md"
LONG_ENOUGH = 2.0  # seconds of a step whose time left is looked at
TENTH = 0.1


def run(path: Path) -> dict[str, Any]:
    """Run a study here: what every step was predicted to take, what it took, and how far off the time left was."""
    begin = time.perf_counter()
    from tradestudy import api
    from tradestudy.execution.time_left import TimeLeft

    left, reported, planned = TimeLeft(time.perf_counter), [], dict[str, float]()
    began = dict[str, float]()

    def predicted(seconds: Mapping[str, float]) -> None:
        began.setdefault("plan", time.perf_counter())
        if not planned:
            planned.update(seconds)
        left.expect(seconds)

    def progress(step: str, share: float) -> None:
        left(step, share)
        reported.append((time.perf_counter(), step, share, left.of_step))

    with tempfile.TemporaryDirectory() as folder:
        api.run(api.load(path), Path(folder) / "run", progress=progress, predicted=predicted)
    end = time.perf_counter()
    names = list(dict.fromkeys(step for _, step, _, _ in reported))
    starts = {name: next(at for at, step, _, _ in reported if step == name) for name in names}
    ends = dict(zip(names, [*list(starts.values())[1:], end], strict=True))
    return {
        "planned after": began["plan"] - begin,
        "took": end - began["plan"],
        "predicted": sum(planned.values()),
        "load": os.getloadavg()[0],
        "steps": {
            name: {
                "predicted": planned.get(name),
                "took": ends[name] - starts[name],
                **_after_a_tenth(
                    [one for one in reported if one[1] == name], starts[name], ends[name], planned.get(name)
                ),
            }
            for name in names
        },
    }


def _after_a_tenth(
    reported: list[tuple[float, str, float, float]], start: float, end: float, predicted: float | None
) -> dict[str, float]:
    """Largest factors by which the predicted time of a step, and the time left, were wrong after a tenth of the step.

    At the very end, no time left is as good as a little. Without a report before the end, the prediction is all there
    is after a tenth of the time.
    """
    took = end - start
    total = [(at - start + left) / took for at, _, share, left in reported if TENTH <= share < 1.0]
    rest = [
        (left + TENTH * took) / (end - at + TENTH * took)
        for at, _, share, left in reported
        if TENTH <= share < 1.0 - TENTH
    ]
    otherwise = [predicted / took] if predicted else [1.0]
    return {"total": _factor(total or otherwise), "left": _factor(rest or otherwise)}


def _factor(ratios: list[float]) -> float:
    """The largest of the ratios or their inverses; infinite if nothing was known or left."""
    return max(max(one, 1.0 / one) if one > 0.0 else math.inf for one in ratios)


def table(record: dict[str, Any]) -> str:
    """The record as Markdown."""
    lines = [
        "# Predicted and measured seconds of every step",
        "",
        "Written by `python tests/benchmarks/predicted_time.py`. *Ratio*: time predicted by the plan over time taken.",
        "For steps of 2 s and more, *total* and *left* are the largest factors by which predictions during the step",
        "were wrong: of its time, elapsed plus left, in all reports after a tenth of the step; and of the time left",
        "alone, in all reports between a tenth and nine tenths, with a tenth of the step added to both sides. Without",
        "such a report, the prediction of the plan counts. *All* counts from the plan on. Load is the average at the",
        "end: this machine is shared, and what else ran changed during runs.",
        "",
        "| study | busy | load | step | predicted s | took s | ratio | total | left |",
        "|---|---:|---:|---|---:|---:|---:|---:|---:|",
    ]
    for key, one in sorted(record.items()):
        study, busy = key.split(" ")
        rows = {name: step for name, step in one["steps"].items() if step["took"] >= TENTH}
        for name, step in {"all": one, **rows}.items():
            predicted, took = step["predicted"] or 0.0, step["took"]
            told = took >= LONG_ENOUGH and name != "all"
            total, left = (f"{step[column]:.2f}" if told else "" for column in ("total", "left"))
            lines.append(
                f"| {study} | {busy} | {one['load']:.1f} | {name} | {predicted:.2f} | {took:.2f} | "
                f"{predicted / took:.2f} | {total} | {left} |"
            )
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure the named studies, or all, and write record and table."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--busy", type=int, default=0)
    asked.add_argument("studies", nargs="*")
    given = asked.parse_args()
    names = given.studies or sorted(path.stem for path in STUDIES.glob("*.yaml"))
    record = json.loads(RECORD.read_text(encoding="utf-8")) if RECORD.is_file() else {}
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}  # as the command line sets it
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(given.busy)]
    try:
        for name in names:
            code = f"import json, runpy; from pathlib import Path; m = runpy.run_path({str(Path(__file__))!r}); "
            code += f"print('RECORD' + json.dumps(m['run'](Path({str(STUDIES / f'{name}.yaml')!r}))))"
            done = subprocess.run(
                [sys.executable, "-c", code], capture_output=True, text=True, check=False, env=environment
            )
            found = [line for line in done.stdout.splitlines() if line.startswith("RECORD")]
            if not found:
                print(f"{name}: {done.stderr.strip().splitlines()[-1:]}")
                continue
            record[f"{name} {given.busy}"] = json.loads(found[0].removeprefix("RECORD"))
            RECORD.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
            TABLE.write_text(table(record), encoding="utf-8")
            print(name, "done", flush=True)
    finally:
        for process in busy:
            process.kill()
            process.wait()


if __name__ == "__main__":
    main()

"""Predicted against measured seconds of every step of every shipped study.

``python tests/benchmarks/step_costs.py [STUDY …]`` runs each study in a process of its own, one worker, and writes
step_costs.md beside this file (only the given studies' rows are measured anew). Processor seconds are compared: what
else runs on the machine does not count in them. They are what the constants of `tradestudy.plan.predicted_time` come
from: processor seconds of a step over its counts of work.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from datetime import UTC, datetime
from pathlib import Path

HERE = Path(__file__).parent
STUDIES = HERE.parents[1] / "studies"
RECORD = HERE / "step_costs.json"
TABLE = HERE / "step_costs.md"
LONG_ENOUGH = 1.0  # seconds from which a prediction of fixed work has to hold
FACTOR = 2.0
WITH_PICTURES = ("start", "depth", "decision", "claims", "pictures")


class StepClock:
    """Attributes time to the step that was named last."""

    def __init__(self) -> None:
        self.step = "start"
        self.wall: dict[str, float] = {}
        self.processor: dict[str, float] = {}
        self.last = time.perf_counter(), time.process_time()

    def __call__(self, step: str, _share: float) -> None:
        now = time.perf_counter(), time.process_time()
        self.wall[self.step] = self.wall.get(self.step, 0.0) + now[0] - self.last[0]
        self.processor[self.step] = self.processor.get(self.step, 0.0) + now[1] - self.last[1]
        self.step, self.last = step, now


def run(path: Path) -> dict[str, object]:
    """Run a study here and compare."""
    clock = StepClock()
    from tradestudy import api
    from tradestudy.machine import machine_speed

    study = api.load(path)
    speed = machine_speed()
    plan = study.plan()
    result = study.run(clock)
    clock("report", 0.0)
    with tempfile.TemporaryDirectory() as folder:
        result.write(folder)
    clock("end", 1.0)
    predicted = {step.name: (step.low, step.high, step.work) for step in plan.steps}
    steps = {
        name: {
            "low": predicted.get(name, (0.0, 0.0, ""))[0],
            "high": predicted.get(name, (0.0, 0.0, ""))[1],
            "work": predicted.get(name, (0.0, 0.0, "not predicted"))[2],
            "processor": round(clock.processor.get(name, 0.0), 3),
            "wall": round(clock.wall.get(name, 0.0), 3),
        }
        for name in dict.fromkeys([*predicted, *clock.wall])
        if name != "end"
    }
    return {
        "measured": datetime.now(UTC).date().isoformat(),
        "load_average": round(os.getloadavg()[0], 1),
        "speed": round(speed, 3),
        "steps": steps,
    }


def verdict(step: dict[str, float]) -> str:
    """Whether a prediction holds: fixed work within a factor of two, a range by containing what it took."""
    low, high, took = step["low"], step["high"], step["processor"]
    if max(took, low) < LONG_ENOUGH:
        return "short"
    if low == high:
        return "holds" if low / FACTOR <= took <= low * FACTOR else "**misses**"
    return "within" if low <= took <= high else "**outside**"


def with_pictures(steps: dict[str, dict[str, float]]) -> dict[str, dict[str, float]]:
    """Pictures of cameras are made wherever depth is asked for: those steps as one."""
    if "pictures" not in steps:
        return steps
    together = [steps[name] for name in WITH_PICTURES if name in steps]
    whole = {key: sum(one[key] for one in together) for key in ("low", "high", "processor", "wall")}
    others = {name: step for name, step in steps.items() if name not in WITH_PICTURES}
    return {", ".join(WITH_PICTURES): {**whole, "work": steps["pictures"]["work"]}, **others}


def table(record: dict[str, dict[str, object]]) -> str:
    """The record as Markdown."""
    lines = [
        "# Predicted and measured seconds of every step",
        "",
        "Written by `python tests/benchmarks/step_costs.py`, which runs every shipped study, one worker. Processor",
        "seconds are held against the prediction, because the machine was shared; wall seconds stand beside them.",
        "Fixed work of a second and more has to be within a factor of two; what samples until it has converged states",
        "a range.",
        "",
        "| study | step | predicted s | processor s | wall s | verdict | work |",
        "|---|---|---:|---:|---:|---|---|",
    ]
    for study, one in record.items():
        for name, step in with_pictures(one["steps"]).items():  # type: ignore[arg-type]
            low, high = step["low"], step["high"]
            predicted = f"{low:.2g}" if low == high else f"{low:.2g} – {high:.2g}"
            lines.append(
                f"| {study} | {name} | {predicted} | {step['processor']:.2f} | {step['wall']:.2f} | {verdict(step)} | "
                f"{step['work']} |"
            )
    lines += ["", "| study | date | load average | speed of the machine |", "|---|---|---:|---:|"]
    lines += [
        f"| {study} | {one['measured']} | {one['load_average']} | {one['speed']} |" for study, one in record.items()
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure the named studies, or all, and write record and table."""
    names = sys.argv[1:] or sorted(path.stem for path in STUDIES.glob("*.yaml"))
    record = json.loads(RECORD.read_text(encoding="utf-8")) if RECORD.is_file() else {}
    for name in names:
        code = f"import json, runpy; m = runpy.run_path({str(Path(__file__))!r}); from pathlib import Path; "
        code += f"print('RECORD' + json.dumps(m['run'](Path({str(STUDIES / f'{name}.yaml')!r}))))"
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
        found = [line for line in done.stdout.splitlines() if line.startswith("RECORD")]
        if not found:
            print(f"{name}: {done.stderr.strip().splitlines()[-1:]}")
            continue
        record[name] = json.loads(found[0].removeprefix("RECORD"))
        RECORD.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
        TABLE.write_text(table(record), encoding="utf-8")
        for step, values in record[name]["steps"].items():
            print(name, step, verdict(values), values["low"], values["high"], values["processor"], flush=True)


if __name__ == "__main__":
    main()

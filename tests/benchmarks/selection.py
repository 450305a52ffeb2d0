"""How long weighing and choosing models takes: ``python -m tests.benchmarks.selection`` writes selection.md.

Every study is loaded in a process of its own and weighed once wholly, imports included. Then each of its pieces is
weighed by itself, again and again, each time with every cache of the program emptied, as a new plan finds them: every
camera that measures depth, the depth of field, the light path, the lenses whose points spread. A camera is as many as
its study makes of it: under each reading, in each design of a sweep, at the values of an inverse question. The slowest
one decides. So are random cameras whose disparity error is derived from the picture.
"""

from __future__ import annotations

import copy
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tests.campaigns.depth_cases import KINDS, base_study, random_study
from tradestudy.errors import TradestudyError, UnaffordableError
from tradestudy.machine import machine_speed
from tradestudy.study.definition import StudyDefinition

ROOT = Path(__file__).parents[2]
STUDIES = ROOT / "studies"
TABLE = Path(__file__).with_suffix(".md")
REPEATS = 15
RANDOM_CAMERAS = 30  # of each kind
REPEATS_OF_ONE = 5
SEED = 20
LIMIT_MS = 50.0


def pieces(definition: StudyDefinition) -> dict[str, Callable[[], object]]:
    """What weighs and chooses the models of each piece of a study."""
    from tradestudy.accuracy import Accuracy
    from tradestudy.plan.choice import choose
    from tradestudy.plan.situations.every import depth_of_field_situation
    from tradestudy.plan.situations.light_spot import light_spot_situation
    from tradestudy.plan.situations.point_spread import point_spread_situation

    file, accuracy = definition.file, Accuracy(relative=definition.file.accuracy.wanted().relative)
    found: dict[str, Callable[[], object]] = {}
    for name, camera in definition.case.cameras.items():
        alone = copy.copy(definition)
        vars(alone)["case"] = replace(definition.case, cameras={name: camera})  # where the definition keeps it
        vars(alone)["file"] = file.model_copy(update={"depth_of_field": None, "light_spot": None, "point_spread": None})
        found[name] = partial(choose, alone)
    situations: dict[str, Callable[[], Any]] = {}
    if file.depth_of_field is not None:
        situations["depth of field"] = partial(depth_of_field_situation, definition, file.depth_of_field)
    if file.light_spot is not None:
        situations["light path"] = partial(light_spot_situation, file.light_spot)
    if file.point_spread is not None:
        situations["point spread"] = partial(point_spread_situation, file.point_spread)
    forced = file.effects.forced()
    return found | {name: lambda make=make: make().select(accuracy, forced) for name, make in situations.items()}


def forms(definition: StudyDefinition) -> int:
    """How many cameras a study makes of each of its cameras."""
    from tradestudy.plan.situations.depth import every_variant

    return sum(1 for _ in every_variant(definition))


def milliseconds(task: Callable[[], object], repeats: int) -> tuple[list[float], list[float]]:
    """Wall and processor time of a task that finds every cache empty."""
    from tradestudy.cost.measuring import forget

    wall, processor = [], []
    for _ in range(repeats):
        forget()
        begin = time.perf_counter(), time.process_time()
        with suppress(UnaffordableError):  # to find that nothing is accurate enough takes as long
            task()
        wall.append(1e3 * (time.perf_counter() - begin[0]))
        processor.append(1e3 * (time.process_time() - begin[1]))
    return wall, processor


def of_study(name: str) -> dict[str, Any]:
    """The whole study the first time [ms], and each piece."""
    from tradestudy import api

    definition = api.load(STUDIES / f"{name}.yaml").definition
    begin = time.perf_counter()
    from tradestudy.plan.choice import choose

    choose(definition)
    first = 1e3 * (time.perf_counter() - begin)
    found = {}
    for piece, task in pieces(definition).items():
        wall, processor = (times[1:] for times in milliseconds(task, REPEATS + 1))
        found[piece] = {
            "forms": forms(definition) if piece in definition.case.cameras else 1,
            "least": min(wall),
            "median": statistics.median(wall),
            "processor": statistics.median(processor),
        }
    return {"first": first, "pieces": found}


def of_random_cameras(kind: str) -> list[tuple[float, float]]:
    """Processor time of each [ms], the median and the least of a few repeats."""
    from tradestudy.plan.choice import choose

    with tempfile.TemporaryDirectory() as folder:
        cameras = _random_cameras(base_study(kind, Path(folder)), kind)
        milliseconds(partial(choose, next(cameras)), 1)  # imports
        times = [milliseconds(partial(choose, next(cameras)), REPEATS_OF_ONE)[1] for _ in range(RANDOM_CAMERAS)]
        return [(statistics.median(one), min(one)) for one in times]


def _random_cameras(base: StudyDefinition, kind: str) -> Iterator[StudyDefinition]:
    rng = np.random.default_rng(SEED)
    while True:
        with suppress(TradestudyError):  # parts that make no camera
            yield random_study(base, kind, rng)


def _by_itself(what: str) -> Any:
    """What a process of its own finds."""
    command = [sys.executable, "-m", "tests.benchmarks.selection", what]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


def _row_of_study(name: str) -> str:
    found = _by_itself(name)
    if not found["pieces"]:
        return ""
    slowest, times = max(found["pieces"].items(), key=lambda one: one[1]["median"] / one[1]["forms"])
    each = times["median"] / times["forms"]
    verdict = "holds" if each <= LIMIT_MS else "**misses**"
    return (
        f"| {name} | {len(found['pieces'])} | {found['first']:.0f} | {slowest} | {times['least']:.1f} | "
        f"{times['median']:.1f} | {times['processor']:.1f} | {times['forms']} | {each:.1f} | {verdict} |"
    )


def _row_of_kind(kind: str) -> str:
    times, least = np.array(_by_itself(kind)).T
    most = f"{np.quantile(times, 0.9):.1f} | {times.max():.1f} | {np.sum(times > LIMIT_MS)}"
    return f"| {kind} | {times.size} | {np.median(times):.1f} | {most} | {least.max():.1f} |"


def _speed() -> float:
    """Of this machine just now, once it is warm."""
    with tempfile.TemporaryDirectory() as folder:
        return statistics.median(machine_speed(Path(folder) / str(run)) for run in range(5))


def main() -> None:
    """Measure the shipped studies and random cameras, and write the tables."""
    load, before = os.getloadavg()[0], _speed()
    studies = [row for path in sorted(STUDIES.glob("*.yaml")) if (row := _row_of_study(path.stem))]
    kinds = [_row_of_kind(kind) for kind in KINDS]
    lines = [
        "# Milliseconds to weigh and choose the models of one camera",
        "",
        f"Written by `python -m tests.benchmarks.selection` on {datetime.now(UTC).date().isoformat()}; load average",
        f"{load:.1f} at the start, {os.getloadavg()[0]:.1f} at the end, on {os.cpu_count()} cores. *First* is the",
        "whole study the first time in a process, imports included. Then each piece is weighed by itself,",
        f"{REPEATS} times with empty caches. A camera is *as many* as the study makes of it by readings, designs and",
        f"questions; the median of the slowest, for *each* of these, is held against {LIMIT_MS:g} ms. On a shared",
        "machine wall time tells how busy it was; the processor time beside it does so less. Its speed against the",
        f"reference machine was {before:.2f} before and {_speed():.2f} after.",
        "",
        "| study | pieces | first | slowest | least | median | processor, median | as many | each | verdict |",
        "|---|---:|---:|---|---:|---:|---:|---:|---:|---|",
        *studies,
        "",
        "Random cameras whose disparity error is derived from the picture (`tests/campaigns/depth_cases.py`):",
        f"processor time of each, the median of {REPEATS_OF_ONE} repeats with empty caches; *quickest*: the largest of",
        "their least repeats.",
        "",
        f"| kind | cameras | median | 90 % | largest | over {LIMIT_MS:g} ms | quickest |",
        "|---|---:|---:|---:|---:|---:|---:|",
        *kinds,
    ]
    TABLE.write_text("\n".join(lines) + "\n", encoding="utf-8")
    print("\n".join(lines))


if __name__ == "__main__":
    if len(sys.argv) > 1:
        asked = sys.argv[1]
        print(json.dumps(of_random_cameras(asked) if asked in KINDS else of_study(asked)))
    else:
        main()

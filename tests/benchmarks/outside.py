"""One aperture beside other people's packages; run by hand, writes outside.json beside it.

    python tests/benchmarks/outside.py [--python OTHER_INTERPRETER] [--repeat 15] [--clock wall|cpu]

f = 12.5 mm, f/3.8, object at 150 mm, 550 nm, 256 × 256 targets of 0.25 µm in the image plane. prysm, hcipy and
poppy compute the Fourier transform of the pupil, which is the Fresnel law in the image plane: there the truth is the
Airy pattern, for them and for our ``fresnel``. Our ``kirchhoff``, a harder law, is held against direct quadrature. They
are taken from the interpreter given, so that their dependencies need not be ours. Ours and theirs take turns, and of
each the least time counts, every set-up included; ours without and with the check that states its error. By the
processor's clock times hardly depend on what else the machine does.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from datetime import UTC, datetime
from itertools import product
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

from aperture import WAVELENGTH, true_error
from outside_packages import airy, error

from tradestudy.optics.propagation.aperture import aperture_field
from tradestudy.optics.propagation.lens import CircularLens, PointSource
from tradestudy.optics.propagation.result import Method
from tradestudy.optics.propagation.targets import TargetGrid
from tradestudy.optics.propagation.wave_optics import FieldAccuracy
from tradestudy.provenance import machine, versions

RECORD = Path(__file__).with_suffix(".json")
SOURCE = PointSource(distance=0.15)
LENS = CircularLens(radius=12.5e-3 / 7.6, focal_length=12.5e-3, lens_phase="perfect")
PITCH, COUNT = 0.25e-6, 256
METHODS: tuple[Method, ...] = ("fresnel", "kirchhoff")
TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-6, 1e-8)


def main() -> None:
    """Measure both, compare at equal or better error, write the record."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--python", default=sys.executable)
    parser.add_argument("--repeat", type=int, default=60)
    parser.add_argument("--clock", choices=("wall", "cpu"), default="wall")
    options = parser.parse_args()
    if options.clock == "cpu":
        time.perf_counter = time.process_time  # the results time themselves
    ours, theirs = in_turns(options.python, options.repeat, options.clock)
    for row in theirs:
        for method, timed in product(METHODS, ("milliseconds", "milliseconds_with_check")):
            equal = [mine for mine in ours if mine["method"] == method and mine["error"] <= row["error"]]
            least = min(mine[timed] for mine in equal)
            row[timed.replace("milliseconds", f"{method}_times_faster")] = round(row["milliseconds"] / least, 1)
    record = {
        "measured": datetime.now(UTC).date().isoformat(),
        "machine": machine(),
        "versions": versions(),
        "clock": options.clock,
        "load_average_at_end": [round(v, 2) for v in os.getloadavg()],
        "ours": ours,
        "theirs": theirs,
    }
    print(json.dumps(record, indent=1, ensure_ascii=False))
    RECORD.write_text(json.dumps(record, indent=1, ensure_ascii=False) + "\n")


Row = dict[str, Any]


def in_turns(python: str, repeat: int, clock: str) -> tuple[list[Row], list[Row]]:
    """Least times of ours and of theirs, one pass after the other."""
    case = {
        "radius": LENS.radius,
        "distance": LENS.image_of(SOURCE)[2],
        "wavelength": WAVELENGTH,
        "pitch": PITCH,
        "count": COUNT,
        "clock": clock,
    }
    script = str(Path(__file__).with_name("outside_packages.py"))
    ours, theirs = [], []
    with subprocess.Popen(
        [python, script, json.dumps(case)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as packages:
        assert packages.stdin is not None
        assert packages.stdout is not None
        for _ in range(repeat):
            ours.append([measured(method, tolerance) for method in METHODS for tolerance in TOLERANCES])
            packages.stdin.write("again\n")
            packages.stdin.flush()
            theirs.append(json.loads(packages.stdout.readline()))
        packages.stdin.close()
    return least(ours), least(theirs)


def least(passes: list[list[Row]]) -> list[Row]:
    """Of each row the least milliseconds."""
    return [
        {name: round(min(row[name] for row in rows), 1) if "milliseconds" in name else value
         for name, value in rows[-1].items()}
        for rows in zip(*passes, strict=True)
    ]  # fmt: skip


def measured(method: Method, tolerance: float) -> Row:
    """Our milliseconds without and with the check, stated and true error."""
    distance = LENS.image_of(SOURCE)[2]
    targets = TargetGrid.centred(centre=(0.0, 0.0), pitch=PITCH, count=COUNT, distance=distance)
    found = aperture_field(
        source=SOURCE,
        lens=LENS,
        targets=targets,
        wavelength=WAVELENGTH,
        method=method,
        accuracy=FieldAccuracy(tolerance=tolerance),
    )
    if method == "fresnel":
        case = {"radius": LENS.radius, "distance": distance, "wavelength": WAVELENGTH}
        true = error(found.intensity, airy(case, targets.x_axis))
    else:
        true = true_error(SOURCE, LENS, targets, found)
    return {
        "method": method,
        "tolerance": tolerance,
        "milliseconds": 1e3 * found.effort.seconds,
        "milliseconds_with_check": 1e3 * (found.effort.seconds + found.effort.check_seconds),
        "stated": float(f"{found.error.intensity:.2g}"),
        "error": float(f"{true:.2g}"),
    }


if __name__ == "__main__":
    main()

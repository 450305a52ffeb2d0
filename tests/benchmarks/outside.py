"""One aperture beside other people's packages; run by hand, writes outside.json beside it.

    python tests/benchmarks/outside.py [--python OTHER_INTERPRETER] [--repeat 15] [--clock wall|cpu]

f = 12.5 mm, f/3.8, object at 150 mm, 550 nm, 256 × 256 targets of 0.25 µm in the image plane. The packages compute the
Fourier transform of the pupil, which is the Fresnel law in the image plane: there the truth is the Airy pattern, for
them and for our ``fresnel``. Our ``kirchhoff``, a harder law, is held against direct quadrature. They are taken from
the interpreter given, so that their dependencies need not be ours. Seconds include every set-up and exclude our check;
by the processor's clock they hardly depend on what else the machine does.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from aperture import WAVELENGTH, true_error
from outside_packages import airy, error

from tradestudy.optics.propagation import CircularLens, FieldAccuracy, Method, PointSource, TargetGrid, aperture_field
from tradestudy.provenance import machine, versions

RECORD = Path(__file__).with_suffix(".json")
SOURCE = PointSource(distance=0.15)
LENS = CircularLens(radius=12.5e-3 / 7.6, focal_length=12.5e-3, lens_phase="perfect")
PITCH, COUNT = 0.25e-6, 256
TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-6, 1e-8)


def main() -> None:
    """Measure both, compare at equal or better error, write the record."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--python", default=sys.executable)
    parser.add_argument("--repeat", type=int, default=15)
    parser.add_argument("--clock", choices=("wall", "cpu"), default="wall")
    options = parser.parse_args()
    if options.clock == "cpu":
        time.perf_counter = time.process_time  # the results time themselves
    ours = [row for method in ("fresnel", "kirchhoff") for row in measured(method, options.repeat)]
    theirs = packages(options.python, options.repeat, options.clock)
    for row in theirs:
        for method in ("fresnel", "kirchhoff"):
            equal = [mine for mine in ours if mine["method"] == method and mine["error"] <= row["error"]]
            fastest = min(equal, key=lambda mine: mine["milliseconds"])
            row[f"{method}_times_faster"] = round(row["milliseconds"] / fastest["milliseconds"], 1)
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


def measured(method: Method, repeat: int) -> list[dict[str, object]]:
    """Our milliseconds, stated and true error at every tolerance."""
    distance = LENS.image_of(SOURCE)[2]
    targets = TargetGrid.centred(centre=(0.0, 0.0), pitch=PITCH, count=COUNT, distance=distance)
    rows = []
    for tolerance in TOLERANCES:
        results = [
            aperture_field(
                source=SOURCE,
                lens=LENS,
                targets=targets,
                wavelength=WAVELENGTH,
                method=method,
                accuracy=FieldAccuracy(tolerance=tolerance),
            )
            for _ in range(repeat)
        ]
        last = results[-1]
        if method == "fresnel":
            case = {"radius": LENS.radius, "distance": distance, "wavelength": WAVELENGTH}
            true = error(last.intensity, airy(case, targets.x_axis))
        else:
            true = true_error(SOURCE, LENS, targets, last)
        rows.append(
            {
                "method": method,
                "tolerance": tolerance,
                "milliseconds": round(1e3 * float(np.min([r.effort.seconds for r in results])), 1),
                "stated": float(f"{last.error.intensity:.2g}"),
                "error": float(f"{true:.2g}"),
            }
        )
    return rows


def packages(python: str, repeat: int, clock: str) -> list[dict[str, object]]:
    """What the packages of an interpreter take."""
    case = {
        "radius": LENS.radius,
        "distance": LENS.image_of(SOURCE)[2],
        "wavelength": WAVELENGTH,
        "pitch": PITCH,
        "count": COUNT,
        "repeat": max(3, repeat // 3),
        "clock": clock,
    }
    script = str(Path(__file__).with_name("outside_packages.py"))
    done = subprocess.run([python, script, json.dumps(case)], stdout=subprocess.PIPE, text=True, check=True)
    return [json.loads(line) for line in done.stdout.splitlines()]


if __name__ == "__main__":
    main()

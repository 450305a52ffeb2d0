"""Seconds, memory and convergence of the chain on the light spot of the paper's Figure 7; run by hand.

    python tests/benchmarks/chain.py [point] [spot] [knobs]

Every part writes its section of chain.json beside this file, with the machine, the versions and the load.
``point``: one source point on and off axis. ``spot``: the 4 mm incoherent spot by each method. ``knobs``: the spot by
Kirchhoff on both legs with every knob refined twice alone, then all at once.
"""

from __future__ import annotations

import json
import os
import resource
import sys
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from tradestudy.optics.chain.accuracy import ChainAccuracy, ChainImage
from tradestudy.optics.chain.array_field import PupilWave
from tradestudy.optics.chain.image import chain_image
from tradestudy.optics.chain.point_image import stated_point
from tradestudy.optics.chain.scene import (
    FRESNEL,
    GEOMETRIC,
    KIRCHHOFF,
    KIRCHHOFF_FRESNEL,
    Legs,
    LightPath,
    Microlenses,
    PixelGrid,
    square_centres,
)
from tradestudy.optics.chain.sources import DiscSource
from tradestudy.optics.propagation.lens import CircularLens, PointSource
from tradestudy.provenance import machine, versions

WAVELENGTH = 550e-9
RECORD = Path(__file__).with_suffix(".json")
REPEATS = 5
SPOT = DiscSource(diameter=4e-3, distance=0.15)

Row = dict[str, object]
KNOBS = (
    "pupil_nodes",
    "microlens_nodes",
    "field_sampling",
    "diffraction_reach",
    "pixel_sampling",
    "source_sampling",
)


def scene() -> LightPath:
    """Figure 7: f = 12.5 mm and f_L = 0.432 mm at f/3.8, 3 × 3 microlenses of 23 pixels, in focus at 150 mm."""
    return LightPath(
        main_lens=CircularLens(radius=12.5e-3 / 7.6, focal_length=12.5e-3, lens_phase="parabolic"),
        microlenses=Microlenses(
            centres=square_centres(pitch=126.5e-6, count=3),
            focal_lengths=np.full(9, 0.432e-3),
            aperture="circular",
            aperture_width=0.432e-3 / 3.8,
            pitch=126.5e-6,
            layout="square",
            gaps="opaque",
            lens_phase="parabolic",
        ),
        array_distance=15.271e-3,
        detector_distance=0.587e-3,
        pixels=PixelGrid(pitch=5.5e-6, shape=(69, 69)),
    )


def difference(a: np.ndarray, b: np.ndarray) -> float:
    """Relative L2 over pixels."""
    return float(np.linalg.norm(a - b) / np.linalg.norm(b))


def timed(source: PointSource | DiscSource, legs: Legs, accuracy: ChainAccuracy) -> tuple[ChainImage, float, float]:
    """Image, wall seconds and CPU seconds."""
    wall, cpu = time.perf_counter(), time.process_time()
    image = chain_image(
        scene(), source, wavelength=WAVELENGTH, legs=legs, accuracy=accuracy, rng=np.random.default_rng(0)
    )
    return image, time.perf_counter() - wall, time.process_time() - cpu


def memory() -> float:
    """Largest resident memory so far [GB]."""
    return round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6, 2)


def point() -> Iterator[Row]:
    """One source point, Kirchhoff on both legs: the image with its stated error, best of five, the check apart."""
    for x, y in ((0.0, 0.0), (1.3e-3, 0.7e-3)):
        source = PointSource(x=x, y=y, distance=0.15)
        finest = ChainAccuracy(tolerance=1e-6, field_sampling=1.3, diffraction_reach=1.5)
        reference = timed(source, KIRCHHOFF, finest)[0]
        wave = PupilWave(path=scene(), source=source, wavelength=WAVELENGTH, method="kirchhoff")
        for tolerance in (1e-3, 1e-4, 1e-5):
            accuracy = ChainAccuracy(tolerance=tolerance)
            seconds, cpu = [], []
            for _ in range(REPEATS):
                start, start_cpu = time.perf_counter(), time.process_time()
                stated_point(wave, False, accuracy)
                seconds.append(time.perf_counter() - start)
                cpu.append(time.process_time() - start_cpu)
            image, wall, _ = timed(source, KIRCHHOFF, accuracy)
            yield {
                "source_mm": [1e3 * x, 1e3 * y],
                "tolerance": tolerance,
                "seconds_with_stated_error": round(min(seconds), 3),
                "cpu_seconds": round(min(cpu), 3),
                "seconds_with_direct_check": round(wall, 3),
                "stated": digits(image.numerical_error),
                "true": digits(difference(image.pixels, reference.pixels)),
            }


def spot() -> Iterator[Row]:
    """The 4 mm incoherent spot by each method, at 1 %."""
    kirchhoff = None
    for name, legs in (
        ("Kirchhoff", KIRCHHOFF),
        ("Kirchhoff–Fresnel", KIRCHHOFF_FRESNEL),
        ("Fresnel", FRESNEL),
        ("geometric", GEOMETRIC),
    ):
        image, wall, cpu = timed(SPOT, legs, ChainAccuracy(tolerance=1e-2))
        kirchhoff = image.pixels if kirchhoff is None else kirchhoff
        yield {
            "method": name,
            "seconds": round(wall, 1),
            "cpu_seconds": round(cpu, 1),
            "stated": digits(image.numerical_error),
            "difference_from_kirchhoff": digits(difference(image.pixels, kirchhoff)),
            "peak_memory_gb": memory(),
            "effort": image.effort,
        }


def knobs() -> Iterator[Row]:
    """The spot by Kirchhoff on both legs: every knob refined twice alone, then all at once."""
    settings = {"as is": ChainAccuracy(tolerance=1e-2)}
    settings |= {knob: ChainAccuracy(tolerance=1e-2, **{knob: 2.0}) for knob in KNOBS}
    settings["tolerance halved"] = ChainAccuracy(tolerance=5e-3)
    settings["all at once, 1.4 times each and the tolerance divided by 1.4"] = ChainAccuracy(
        tolerance=7e-3, **dict.fromkeys(KNOBS, 1.4)
    )
    settings["all at once"] = ChainAccuracy(tolerance=5e-3, **dict.fromkeys(KNOBS, 2.0))
    base = None
    for name, accuracy in settings.items():
        image, wall, cpu = timed(SPOT, KIRCHHOFF, accuracy)
        base = image.pixels if base is None else base
        yield {
            "refined twice": name,
            "change": digits(difference(base, image.pixels)),
            "seconds": round(wall, 1),
            "cpu_seconds": round(cpu, 1),
            "stated": digits(image.numerical_error),
            "peak_memory_gb": memory(),
            "effort": image.effort,
        }


def digits(value: float) -> float:
    """Two digits."""
    return float(f"{value:.2g}")


def main() -> None:
    """Run the parts asked for and write each into the record."""
    asked = sys.argv[1:] or ["point", "spot", "knobs"]
    for part in (point, spot, knobs):
        if part.__name__ not in asked:
            continue
        rows, begin = [], os.getloadavg()
        for row in part():
            print(row, flush=True)
            rows.append(row)
        record = json.loads(RECORD.read_text()) if RECORD.exists() else {}
        record[part.__name__] = {
            "measured": datetime.now(UTC).date().isoformat(),
            "machine": machine(),
            "versions": versions(),
            "load_average_before_and_after": [round(begin[0], 2), round(os.getloadavg()[0], 2)],
            "rows": rows,
        }
        RECORD.write_text(json.dumps(record, indent=1, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    main()

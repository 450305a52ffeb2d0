"""Times one aperture by hand: ``python tests/benchmarks/aperture.py [--repeat N] [--clock wall|cpu]``.

Main lens: f = 12.5 mm, f/3.8, object at 150 mm, 550 nm, 256 × 256 targets of 0.25 µm in the image plane, tolerance 1e-6
of the intensity; error against direct quadrature on ample nodes at 400 targets. Microlens: rays and boundary wave
against Kirchhoff on defocused images, at like stated errors. Seconds are the result's own, set-up included and
the check apart; by the processor's clock they hardly depend on what else the machine does. Writes aperture.json beside
this file. Other packages stand in outside.py.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from tradestudy.optics.propagation.aperture import aperture_field, lens_wave
from tradestudy.optics.propagation.kernels import KirchhoffKernel, direct_sum
from tradestudy.optics.propagation.lens import LENS_PHASES, CircularLens, LensPhase, Obliquity, PointSource
from tradestudy.optics.propagation.result import ApertureField, Method
from tradestudy.optics.propagation.targets import TargetGrid, TargetPoints
from tradestudy.optics.propagation.wave_optics import FieldAccuracy, nodes_for, sample_wave
from tradestudy.provenance import machine, versions

WAVELENGTH = 550e-9
RECORD = Path(__file__).with_suffix(".json")


def main() -> None:
    """Measure, print, and write if asked."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--repeat", type=int, default=15)
    parser.add_argument("--clock", choices=("wall", "cpu"), default="wall")
    options = parser.parse_args()
    if options.clock == "cpu":
        time.perf_counter = time.process_time  # the results time themselves
    report = {
        "measured": datetime.now(UTC).date().isoformat(),
        "machine": machine(),
        "versions": versions(),
        "clock": options.clock,
        "load_average": [round(v, 2) for v in os.getloadavg()],
        "main_lens": [main_lens(p, x, options.repeat) for p in LENS_PHASES for x in (0.0, 2e-3)],
        "microlens": [
            microlens(phase, obliquity, distance, pixels, options.repeat)
            for phase, obliquity in (("perfect", "textbook"), ("stigmatic", "paper"), ("parabolic", "paper"))
            for distance in (0.568e-3, 0.7e-3, 1.2e-3)
            for pixels in (24, 64, 256)
        ],
    }
    text = json.dumps(report, indent=1)
    print(text)
    RECORD.write_text(text + "\n")


def main_lens(phase: LensPhase, x: float, repeat: int) -> dict[str, object]:
    """Kirchhoff in the image plane."""
    source = PointSource(x=x, distance=0.15)
    lens = CircularLens(
        radius=12.5e-3 / 7.6,
        focal_length=12.5e-3,
        lens_phase=phase,
        focus_distance=0.15 if phase == "stigmatic" else None,
    )
    image_x, image_y, b = lens.image_of(source)
    targets = TargetGrid.centred(centre=(image_x, image_y), pitch=0.25e-6, count=256, distance=b)
    seconds, check, result = timed(source, lens, targets, "kirchhoff", "paper", 1e-6, repeat)
    return {
        "lens_phase": phase,
        "source_x_mm": 1e3 * x,
        "milliseconds_best": digits(1e3 * float(np.min(seconds))),
        "milliseconds_median": digits(1e3 * float(np.median(seconds))),
        "check_milliseconds": digits(1e3 * float(np.min(check))),
        "nodes": result.effort.nodes,
        "rank": result.effort.rank,
        "stated_error": digits(result.error.intensity),
        "true_error": digits(true_error(source, lens, targets, result)),
    }


def true_error(source: PointSource, lens: CircularLens, targets: TargetGrid, result: ApertureField) -> float:
    """Relative L2 error of the intensity, at the 200 brightest targets and 200 others drawn at random."""
    wave = lens_wave(source=source, lens=lens, wavelength=WAVELENGTH)
    kernel = KirchhoffKernel(wavelength=WAVELENGTH, obliquity="paper")
    order = np.argsort(-result.intensity.ravel())
    some = np.concatenate([order[:200], np.random.default_rng(0).choice(order[200:], 200, replace=False)])
    x, y, z = (c[some] for c in targets.coordinates())
    points = TargetPoints(x=x, y=y, distance=z)
    counts = nodes_for(wave, kernel, points, FieldAccuracy(tolerance=1e-10)).scaled(1.5)
    exact = np.abs(direct_sum(sample_wave(wave, counts), kernel, x, y, z)) ** 2
    return float(np.linalg.norm(result.intensity.ravel()[some] - exact) / np.linalg.norm(exact))


def microlens(phase: LensPhase, obliquity: Obliquity, distance: float, pixels: int, repeat: int) -> dict[str, object]:
    """Boundary wave and Kirchhoff on one defocused microlens image of 32 µm."""
    source = PointSource(x=0.3e-3, distance=13.64e-3)
    lens = CircularLens(
        radius=0.432e-3 / 7.6,
        focal_length=0.432e-3,
        lens_phase=phase,
        focus_distance=13.64e-3 if phase == "stigmatic" else None,
    )
    x, y, b = lens.image_of(source)
    width = 2.6 * lens.radius * abs(distance / b - 1)
    targets = TargetGrid.centred(
        centre=(x * distance / b, y * distance / b), pitch=width / pixels, count=pixels, distance=distance
    )
    tolerance = 0.1 if phase == "parabolic" else 0.02
    edge_seconds, _, edge = timed(source, lens, targets, "boundary_wave", obliquity, tolerance, repeat)
    area_seconds, _, area = timed(source, lens, targets, "kirchhoff", obliquity, tolerance, repeat)
    return {
        "lens_phase": phase,
        "obliquity": obliquity,
        "detector_mm": digits(1e3 * distance),
        "pixels": pixels,
        "boundary_wave_ms": digits(1e3 * float(np.min(edge_seconds))),
        "kirchhoff_ms": digits(1e3 * float(np.min(area_seconds))),
        "times_faster": digits(float(np.min(area_seconds) / np.min(edge_seconds))),
        "boundary_wave_stated": digits(edge.error.intensity),
        "kirchhoff_stated": digits(area.error.intensity),
        "handed_over": edge.handed_over,
    }


def digits(value: float) -> float:
    """Three digits."""
    return float(f"{value:.3g}")


def timed(
    source: PointSource,
    lens: CircularLens,
    targets: TargetGrid,
    method: Method,
    obliquity: Obliquity,
    tolerance: float,
    repeat: int,
) -> tuple[list[float], list[float], ApertureField]:
    """Seconds of every repetition without its check and of the check, and the last result."""
    seconds, check = [], []
    for _ in range(repeat):
        result = aperture_field(
            source=source,
            lens=lens,
            targets=targets,
            wavelength=WAVELENGTH,
            method=method,
            obliquity=obliquity,
            accuracy=FieldAccuracy(tolerance=tolerance),
        )
        seconds.append(result.effort.seconds)
        check.append(result.effort.check_seconds)
    return seconds, check, result


if __name__ == "__main__":
    main()

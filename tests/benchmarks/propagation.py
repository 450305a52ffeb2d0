"""Seconds of propagating the errors of one camera to depth; run by hand: ``python tests/benchmarks/propagation.py``.

Prints seconds of 2²⁰ exact draws at one distance, 8 scrambles of 2¹⁷, against 0.4 s on two idle cores, and where they
go; and how many times longer exact draws to 1 % take than the line at 100 distances. The cameras are those of the
shipped studies with errors that are usually declared.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from tests.calibration.cameras import focused, normal, stereo
from tradestudy.answers.cost_measuring import forget
from tradestudy.cameras.calibration import Calibration, Propagation
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.depth.draws import SCRAMBLES, _of_draws, inverse_depth_model, settled_draws, uncertain_sources
from tradestudy.depth.evaluation import distribution
from tradestudy.optics.arrays import FloatArray
from tradestudy.uncertainty.sources import ErrorClass
from tradestudy.uncertainty.streams import scramble_scores

LIMIT: Final = 0.4  # seconds
REPEATS: Final = 7
DRAWS: Final = 2**20
PLACE: Final = np.array([1.0])
MANY: Final = np.geomspace(0.3, 2.0, 100)
STEREO_ERRORS: Final = {
    **dict.fromkeys(("yaw", "pitch", "roll"), float(np.radians(0.2))),
    "baseline": 5e-5,
    "focal_length": 3e-6,
    **dict.fromkeys([f"{side}_principal_point_{axis}" for side in ("left", "right") for axis in "xy"], 1e-6),
    **dict.fromkeys(("left_distortion_k1", "right_distortion_k1"), 1e-3),
}
PLENOPTIC_ERRORS: Final = {
    "mla_distance": 1e-6,
    "focal_length": 1e-6,
    "microlens_gap": 0.2e-6,
    "microlens_pitch": 1e-10,
    "array_rotation": 3.5e-4,
    **dict.fromkeys(("array_tilt_x", "array_tilt_y"), 3.5e-4),
    **dict.fromkeys(("array_offset_x", "array_offset_y"), 10e-6),
    "field_curvature": 2e-6,
}


def calibrated(camera: DepthCamera, deviations: dict[str, float]) -> DepthCamera:
    """The camera with independent normal errors; of a plenoptic one, the centres of its microlenses scatter as well."""
    groups = tuple(normal(name, deviation) for name, deviation in deviations.items())
    if "microlens_center_scatter" in camera.error_vocabulary:
        groups = (*groups, normal("microlens_center_scatter", 0.2e-6, ErrorClass.ELEMENT))
    return replace(camera, calibration=Calibration(groups=groups))


def seconds(task: Callable[[], object]) -> tuple[float, float]:
    """Least wall and processor seconds of some runs that find every cache empty, after one run for the imports."""
    wall, processor = [], []
    for _ in range(REPEATS + 1):
        forget()
        begin = time.perf_counter(), time.process_time()
        task()
        wall.append(time.perf_counter() - begin[0])
        processor.append(time.process_time() - begin[1])
    return min(wall[1:]), min(processor[1:])


def report(name: str, camera: DepthCamera) -> None:
    """Print what one camera takes."""
    each = DRAWS // SCRAMBLES
    sources = uncertain_sources(camera, "both")
    wall, processor = seconds(lambda: _of_draws(camera, PLACE, 0.0, "both", each))
    verdict = "holds" if wall <= LIMIT else "MISSES"
    print(
        f"{name}, {sources.dimensions} errors: 2^20 exact draws: {wall:.3f} s, processor {processor:.3f} s: {verdict}"
    )

    def scores(scramble: int) -> FloatArray:
        return scramble_scores(sources.dimensions, each, seed=0, point="depth", scramble=scramble)

    drawn = sources.draw(scores(0))
    model = inverse_depth_model(camera, PLACE)
    for what, task in {
        "scores": lambda: scores(0),
        "scores and errors": lambda: sources.draw(scores(0)),
        "readings": lambda: model(drawn),
    }.items():
        print(f"  {what} of one scramble: {seconds(task)[1]:.3f} s of processor")
    judged = Propagation(model="exact", judged=tuple(MANY))
    to_tolerance = replace(camera, propagation=judged)
    _, line = seconds(lambda: distribution(camera, MANY, "both"))
    _, exact = seconds(lambda: distribution(to_tolerance, MANY, "both"))
    draws = SCRAMBLES * settled_draws(to_tolerance, 0.0, "both")
    print(
        f"  100 distances, processor: line {line:.4f} s, {draws} exact draws {exact:.3f} s, "
        f"{exact / line:.0f} times as long"
    )


def main() -> None:
    """Measure a stereo rig and a focused plenoptic camera."""
    print(f"load average {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    report("stereo, 100 mm", calibrated(stereo(), STEREO_ERRORS))
    report("focused plenoptic, R5", calibrated(focused(), PLENOPTIC_ERRORS))


if __name__ == "__main__":
    main()

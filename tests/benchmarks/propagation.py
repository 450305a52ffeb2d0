"""Seconds of propagating the errors of one camera to depth; run by hand: ``python tests/benchmarks/propagation.py``.

Prints seconds of 2²⁰ exact draws at one distance, 8 scrambles of 2¹⁷, against 0.4 s on two idle cores, where they go, and
how many times longer exact draws to 1 % take than the line at 100 distances. The cameras are those of the shipped
studies with errors that are usually declared.
"""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from tests.calibration.cameras import focused, normal, stereo
from tradestudy.analysis.depth import distribution
from tradestudy.analysis.depth_draws import (
    SCRAMBLES,
    exact_depths,
    exact_distribution,
    settled_draws,
    uncertain_sources,
)
from tradestudy.cameras.calibration import Calibration, Propagation
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cost.measuring import forget
from tradestudy.uncertainty.error_class import ErrorClass
from tradestudy.uncertainty.scores import scramble_scores

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
    """Median and least of some runs that find every cache empty, after one run for the imports."""
    taken = []
    for _ in range(REPEATS + 1):
        forget()
        begin = time.perf_counter()
        task()
        taken.append(time.perf_counter() - begin)
    return statistics.median(taken[1:]), min(taken[1:])


def with_draws(camera: DepthCamera, draws: int) -> DepthCamera:
    """The camera that takes so many exact draws, which no tolerance ends sooner."""
    propagation = Propagation(model="exact", tolerance=0.0, max_draws=draws, judged=tuple(PLACE))
    return replace(camera, propagation=propagation)


def report(name: str, camera: DepthCamera) -> None:
    """Print what one camera takes."""
    each = DRAWS // SCRAMBLES
    exact = with_draws(camera, DRAWS)
    dimensions = uncertain_sources(exact, "both").dimensions

    def at_once() -> None:
        from tradestudy.analysis.depth_draws import _of_draws

        _of_draws(exact, PLACE, 0.0, "both", each)

    median, least = seconds(at_once)
    verdict = "holds" if least <= LIMIT else "MISSES"
    print(f"{name}, {dimensions} errors: 2^20 exact draws: median {median:.3f} s, least {least:.3f} s: {verdict}")
    scores, _ = seconds(lambda: scramble_scores(dimensions, each, seed=0, point="depth", scramble=0))
    one, _ = seconds(lambda: exact_depths(exact, PLACE, 0.0, "both", 0, each))
    print(f"  one scramble of 2^17 on one core: {one:.3f} s, {scores:.3f} s of these for its scores")
    doubled, _ = seconds(lambda: exact_distribution(exact, PLACE, 0.0, "both"))
    print(f"  doubled up to 2^20 from 2^11: {doubled:.3f} s")
    judged = Propagation(model="exact", judged=tuple(MANY))
    to_tolerance = replace(camera, propagation=judged)
    line, _ = seconds(lambda: distribution(camera, MANY, "both"))
    drawn, _ = seconds(lambda: distribution(to_tolerance, MANY, "both"))
    draws = SCRAMBLES * settled_draws(to_tolerance, 0.0, "both")
    print(f"  100 distances: line {line:.4f} s, {draws} exact draws {drawn:.3f} s, {drawn / line:.0f} times as long")


def main() -> None:
    """Measure a stereo rig and a focused plenoptic camera."""
    print(f"load average {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    report("stereo, 100 mm", calibrated(stereo(), STEREO_ERRORS))
    report("focused plenoptic, R5", calibrated(focused(), PLENOPTIC_ERRORS))


if __name__ == "__main__":
    main()

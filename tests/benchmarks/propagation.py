"""Speed and efficiency of propagation; run by hand: ``python tests/benchmarks/propagation.py``.

Prints seconds for 2²⁰ depth draws, evaluations that plain Monte Carlo needs for the error of Sobol points, error
against seconds of every tier, and the peak of memory against the number of draws.
"""

from __future__ import annotations

import time
import tracemalloc
from dataclasses import dataclass, replace

import numpy as np

from tradestudy.uncertainty.distributions import Normal, Uniform
from tradestudy.uncertainty.error_class import ErrorClass
from tradestudy.uncertainty.evaluation import Model, Outcome
from tradestudy.uncertainty.joint import JointNormal
from tradestudy.uncertainty.linear import linear
from tradestudy.uncertainty.monte_carlo import Sampling, propagate
from tradestudy.uncertainty.outputs import PROBABILITIES
from tradestudy.uncertainty.sources import Source, Sources
from tradestudy.uncertainty.streams import plain_random, scrambled_sobol

ALL = Sampling(absolute_tolerance=0.0, relative_tolerance=0.0, budget_draws=2**20)
REPEATS = 5


@dataclass(frozen=True, kw_only=True)
class Case:
    name: str
    model: Model
    sources: Sources


def _normal(name: str, deviation: float, error_class: ErrorClass = ErrorClass.RIG) -> Source:
    return Source(name=name, distribution=Normal(mean=0.0, standard_deviation=deviation), error_class=error_class)


def stereo() -> Case:
    """Rig of 30.5 mm and 100 mm at 1 m: rotation, focal lengths, principal points, distortion, pixel noise."""
    f, baseline, distance, x, y = 0.0305, 0.1, 1.0, 0.004, 0.003
    rotation = {name: np.radians(0.2) for name in ("yaw", "pitch", "roll")}
    optics = {"left_f": 3e-6, "right_f": 3e-6, "left_c": 1e-6, "right_c": 1e-6, "k1": 1e-3, "k2": 1e-2}
    noise = {"left_noise": 1e-6, "right_noise": 1e-6}

    def model(v):
        left = x * (1.0 + v["left_f"] / f) + v["left_c"] + v["left_noise"]
        rx, ry = x / f - baseline / distance, y / f
        rx, ry = rx * np.cos(v["roll"]) - ry * np.sin(v["roll"]), rx * np.sin(v["roll"]) + ry * np.cos(v["roll"])
        rz = np.cos(v["pitch"]) - ry * np.sin(v["pitch"])
        tangent = (rx * np.cos(v["yaw"]) - rz * np.sin(v["yaw"])) / (rx * np.sin(v["yaw"]) + rz * np.cos(v["yaw"]))
        square = tangent * tangent + ry * ry
        bent = tangent * (1.0 + square * (v["k1"] + v["k2"] * square))
        right = (f + v["right_f"]) * bent + v["right_c"] + v["right_noise"]
        return Outcome(values=(left - right) / (f * (baseline + v["baseline"])))

    groups = [_normal(name, s) for name, s in ({"baseline": 5e-5} | rotation | optics).items()]
    groups += [_normal(name, s, ErrorClass.MEASUREMENT) for name, s in noise.items()]
    return Case(name="stereo, 1 m, 12 sources", model=model, sources=Sources(groups=tuple(groups)))


def plenoptic() -> Case:
    """R5 (z = 14.773 mm, b_L = 0.568 mm) at 0.3 m, same-type pair: z and f_M tied, gap, pitch, curvature, noise."""
    f, z, gap, spacing, distance = 12.5e-3, 14.773e-3, 0.568e-3, np.sqrt(3.0) * 126.5e-6, 0.3
    image = distance * f / (distance - f)
    offset = spacing * gap / (z - image)  # local disparity of the pair

    def model(v):
        array = z + v["mla_distance"] + v["curvature"] + v["tilt"]
        relief = (gap + v["gap"]) * spacing * (1.0 + v["pitch"]) / (offset + v["noise"])
        return Outcome(values=1.0 / (f + v["focal_length"]) - 1.0 / (array - relief))

    tied = JointNormal.from_correlation(
        name="z and f_M",
        parameters=("mla_distance", "focal_length"),
        mean=np.zeros(2),
        standard_deviation=np.array([5e-6, 5e-6]),
        correlation=np.array([[1.0, 0.95], [0.95, 1.0]]),
        error_class=ErrorClass.RIG,
    )
    groups = (
        tied,
        _normal("gap", 1e-6),
        _normal("pitch", 1e-4),
        Source(name="curvature", distribution=Uniform(low=-5e-6, high=5e-6), error_class=ErrorClass.ELEMENT),
        _normal("tilt", 1e-6),
        _normal("noise", 0.55e-6, ErrorClass.MEASUREMENT),
    )
    return Case(name="plenoptic, 0.3 m, 7 sources", model=model, sources=Sources(groups=groups))


def _run(case: Case, sampling: Sampling, seed: int = 0):
    return propagate(case.model, case.sources, sampling, seed=seed, point="benchmark", inverse_depth=True)


def _speed(case: Case) -> None:
    seconds = [_run(case, ALL).seconds for _ in range(REPEATS)]
    print(f"{case.name}: 2^20 draws: median {np.median(seconds):.2f} s, min {min(seconds):.2f} s")


def _efficiency(case: Case) -> None:
    truth = _run(case, replace(ALL, budget_draws=2**22), seed=1).quantiles[:, 0]

    def squared_error(sampler, draws):
        sampling = replace(ALL, sampler=sampler, replicates=32, first_draws=draws, budget_draws=32 * draws)
        mine = _run(case, sampling)
        return 32.0 * mine.quantiles_error[:, 0] ** 2 + (mine.quantiles[:, 0] - truth) ** 2

    print(f"{case.name}: evaluations of plain draws over Sobol points at equal error, per quantile")
    for draws in (2**8, 2**11, 2**14):
        ratio = squared_error(plain_random, draws) / squared_error(scrambled_sobol, draws)
        shown = ", ".join(f"{100 * p:.1f} %: {r:.0f}x" for p, r in zip(PROBABILITIES, ratio, strict=True))
        print(f"  {draws:6d} draws per replicate: {shown}")


def _tiers(case: Case) -> None:
    truth = _run(case, replace(ALL, budget_draws=2**22), seed=1)
    ends, u = truth.symmetric_interval[:, 0], truth.half_width[0]

    def report(name, seconds, evaluations, interval):
        error = np.max(np.abs(interval - ends)) / u
        print(
            f"  {name:32s} {evaluations:8d} evaluations {seconds * 1e3:9.2f} ms  error of the 95 % ends {error:.1e} u"
        )

    print(f"{case.name}: tiers")
    start = time.perf_counter()
    line = linear(case.model, case.sources, inverse_depth=True)
    seconds = time.perf_counter() - start
    report("linear", seconds, line.evaluations, line.symmetric_interval[:, 0])
    report("linear in inverse depth", seconds, line.evaluations, line.mapped_quantiles([0.025, 0.975])[:, 0])
    for name, sampler in (("Sobol", scrambled_sobol), ("plain", plain_random)):
        for draws in (2**12, 2**16, 2**20):
            mine = _run(case, replace(ALL, sampler=sampler, budget_draws=draws))
            report(f"{name}, 2^{draws.bit_length() - 1}", mine.seconds, mine.evaluations, mine.symmetric_interval[:, 0])


def _memory(case: Case) -> None:
    for exponent in (17, 19, 21):
        sampling = replace(ALL, budget_draws=2**exponent, memory_bytes=2**24, batch_draws=2**12)
        tracemalloc.start()
        mine = _run(case, sampling)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        print(f"{case.name}: 2^{exponent} draws in {mine.replicates} replicates, peak {peak / 2**20:.1f} MiB of 16")


if __name__ == "__main__":
    for chosen in (stereo(), plenoptic()):
        _speed(chosen)
        _efficiency(chosen)
        _tiers(chosen)
        _memory(chosen)

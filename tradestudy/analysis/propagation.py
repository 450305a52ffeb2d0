"""Errors of one camera propagated to depth: noise, calibration and both, on the axis and at the edge, by every tier."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from tradestudy.calibration.uncertain_cameras import UncertainCamera
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.uncertainty.error_class import CALIBRATION, NOISE, ErrorClass
from tradestudy.uncertainty.evaluation import Model
from tradestudy.uncertainty.linear import linear, validity
from tradestudy.uncertainty.monte_carlo import Sampling, propagate
from tradestudy.uncertainty.outputs import POLE_MARGIN, PROBABILITIES, Propagated
from tradestudy.uncertainty.sources import Sources

WAYS: Final[Mapping[str, tuple[ErrorClass, ...]]] = {
    "noise": NOISE,
    "calibration": CALIBRATION,
    "both": (*NOISE, *CALIBRATION),
}
FIELDS: Final = ("axis", "edge")
TIERS: Final = ("linear", "inverse linear", "sobol")
"""Cheapest first; a posterior is drawn once and then goes the way of the third."""


@dataclass(frozen=True, kw_only=True, eq=False)
class AnalyticTier:
    """What a line gives; arrays over distance, NaN where the sources have no variance.

    ``ends`` are those of its central 95 % interval [m], shape (2, distances); ``verdict`` is that of JCGM 101, clause 8
    with two digits; ``error`` the larger difference of the ends from Monte Carlo [m].
    """

    uncertainty: FloatArray
    quantiles: FloatArray
    verdict: np.ndarray[tuple[int, ...], np.dtype[np.str_]]
    error: FloatArray
    evaluations: int
    seconds: float

    @property
    def ends(self) -> FloatArray:
        """Of the central 95 % interval [m]."""
        return self.quantiles[[0, -1]]


@dataclass(frozen=True, kw_only=True, eq=False)
class PropagatedWay:
    """One camera, one place in the field, one way: the Monte Carlo result and the cheaper tiers beside it.

    ``tier`` names, per distance, the cheapest whose 95 % interval is within the accuracy of the study.
    """

    monte_carlo: Propagated
    linear: AnalyticTier
    inverse_linear: AnalyticTier
    tier: tuple[str, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class PropagationPoint:
    """One camera whose errors are propagated: at distances [m], at places in the field, as well as is asked."""

    camera: UncertainCamera
    distance: FloatArray
    fields: tuple[float, ...]
    accuracy: float
    budget: int
    seed: int


def propagate_all_ways(point: PropagationPoint) -> list[list[PropagatedWay]]:
    """Propagate the errors of one camera at every place in the field, every way."""
    return [
        [
            propagate_way(
                point.camera,
                point.distance,
                field,
                way,
                accuracy=point.accuracy,
                budget=point.budget,
                seed=point.seed,
            )
            for way in WAYS
        ]
        for field in point.fields
    ]


def sampling_of(accuracy: float, budget: int, outputs: int) -> Sampling:
    """How to sample: an error of each quantile of at most ``accuracy`` of it."""
    return Sampling(
        absolute_tolerance=0.0,
        relative_tolerance=accuracy,
        budget_draws=budget,
        batch_draws=max(2**8, 2**14 >> max(outputs - 1, 0).bit_length()),
        memory_bytes=2**28,
    )


def propagate_way(
    camera: UncertainCamera,
    distance: FloatArray,
    field: float,
    way: str,
    *,
    accuracy: float,
    budget: int,
    seed: int,
) -> PropagatedWay:
    """Propagate the errors of one camera.

    Parameters
    ----------
    camera
        The camera.
    distance
        True distances [m].
    field
        Place in the field, 0 to 1.
    way
        Which classes of errors are drawn.
    accuracy
        Allowed error of every quantile over its magnitude.
    budget
        Most draws.
    seed
        Of the study.
    """
    model = camera.model(distance, field)
    sources = camera.sources.of_class(WAYS[way])
    found = propagate(
        model,
        sources,
        sampling_of(accuracy, budget, distance.size),
        seed=seed,
        point=f"{camera.name}/{field:g}/{way}",
        inverse_depth=True,
    )
    plain, inverse = _analytic(model, sources, found)
    tiers = (plain, inverse)
    return PropagatedWay(
        monte_carlo=found,
        linear=plain,
        inverse_linear=inverse,
        tier=tuple(_cheapest(tiers, found, accuracy, k) for k in range(distance.size)),
    )


def _analytic(model: Model, sources: Sources, found: Propagated) -> tuple[AnalyticTier, AnalyticTier]:
    """Both lines: in depth, and in inverse depth with quantiles mapped back."""
    begin = time.perf_counter()
    outputs = found.nominal.size
    try:
        line = linear(model, sources, inverse_depth=True)
    except OutOfRangeError:  # a source without a variance: no line exists, and NaN says so
        missing = _no_line(outputs)
        return missing, missing
    seconds = time.perf_counter() - begin
    scores = np.array([-1.959963984540054, -1.0, 0.0, 1.0, 1.959963984540054])[:, None]
    tables = (line.estimate + scores * line.standard_uncertainty, line.mapped_quantiles(PROBABILITIES))
    tiers = []
    for quantiles in tables:
        judged = validity(quantiles[[0, -1]], found, standard_uncertainty=line.standard_uncertainty)
        tiers.append(
            AnalyticTier(
                uncertainty=line.standard_uncertainty,
                quantiles=quantiles,
                verdict=judged.verdict,
                error=np.maximum(judged.low_difference, judged.high_difference),
                evaluations=line.evaluations,
                seconds=seconds,
            )
        )
    return tiers[0], tiers[1]


def _no_line(outputs: int) -> AnalyticTier:
    return AnalyticTier(
        uncertainty=np.full(outputs, np.nan),
        quantiles=np.full((len(PROBABILITIES), outputs), np.nan),
        verdict=np.full(outputs, "no variance"),
        error=np.full(outputs, np.nan),
        evaluations=0,
        seconds=0.0,
    )


def _cheapest(tiers: tuple[AnalyticTier, AnalyticTier], found: Propagated, accuracy: float, k: int) -> str:
    """The cheapest tier whose ends are within the accuracy, as far as Monte Carlo can tell; "" where nothing ranks."""
    if found.status[k] == "unranked":
        return ""
    noise = 2.0 * float(np.max(found.quantiles_error[[0, -1], k]))
    for name, tier in zip(TIERS, tiers, strict=False):
        # Against the nominal depth, which is finite where an end of the interval is not.
        if tier.error[k] <= max(accuracy * found.nominal[k], noise):
            return name
    return TIERS[-1]


def moments_end(found: Propagated, distance: FloatArray) -> float:
    """Where mean and standard deviation cease to exist [m], coming from near.

    Between two distances it is where the margin to infinity, which falls with distance, reaches its limit (log–log);
    where another condition ends them, the last distance at which they exist. Infinite where they exist at every
    distance, NaN where at none.
    """
    ranked = np.flatnonzero(found.status != "unranked")
    if ranked.size == 0 or not found.moments_exist[ranked[0]]:
        return float("nan")
    lost = ranked[~found.moments_exist[ranked]]
    if lost.size == 0:
        return float("inf")
    last, first = ranked[ranked < lost[0]][-1], lost[0]
    margins = found.pole_margin[[last, first]]
    if not (margins[0] > POLE_MARGIN > margins[1] > 0.0 and np.isfinite(margins[0])):
        return float(distance[last])
    share = np.log(margins[0] / POLE_MARGIN) / np.log(margins[0] / margins[1])
    return float(distance[last] * (distance[first] / distance[last]) ** share)

"""Two cameras under uncertainty: who errs less with what probability, where they are equal, what stability it takes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.interpolate import PchipInterpolator

from tradestudy.analysis.propagation import WAYS
from tradestudy.calibration.declaration import StabilityQuestionPart
from tradestudy.calibration.sources import SEPARATOR
from tradestudy.calibration.uncertain_cameras import UncertainCamera, short_name, sources_of
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.uncertainty.decision import (
    Draws,
    RankProbability,
    Solution,
    crossings,
    half_width,
    log_ratio,
    rank_probability,
    solve_in_replicates,
)
from tradestudy.uncertainty.sources import Sources
from tradestudy.uncertainty.streams import scrambled_sobol

_RANK_DRAWS, _CROSSING_DRAWS, _SOLVE_DRAWS, _REPLICATES = 2**11, 2**10, 2**12, 8
_CROSSING_POINTS = 65
_LARGEST = 10.0  # of a logarithm of two widths: 20 000 to one
RANK_WAYS: Final = ("calibration", "both")
"""Over calibrations alone, as after averaging all noise away, and over single measurements."""
_SCALES = (1e-4, 1e4)  # of the declared spread


def _draws(draws: int, outputs: int, seed: int, point: str) -> Draws:
    batch = max(2**8, 2**14 >> max(outputs - 1, 0).bit_length())
    return Draws(
        draws=draws, replicates=_REPLICATES, sampler=scrambled_sobol, seed=seed, point=point, batch_draws=batch
    )


def rank(
    first: UncertainCamera, second: UncertainCamera, distance: FloatArray, field: float, way: str, *, seed: int
) -> RankProbability:
    """Probability that the depth error of the first camera is smaller than that of the second, over distances [m].

    What both share, the surroundings, is drawn once for both.
    """
    return rank_probability(
        first.model(distance, field),
        second.model(distance, field),
        sources_of(first, second).of_class(WAYS[way]),
        distance,
        _draws(_RANK_DRAWS, distance.size, seed, f"rank/{first.name}/{second.name}/{field:g}/{way}"),
    )


def crossovers(
    first: UncertainCamera, second: UncertainCamera, distance: FloatArray, field: float, way: str, *, seed: int
) -> tuple[Solution, ...]:
    """Distances [m] between the ends of ``distance`` where both are equally uncertain, each with its Monte Carlo error.

    Each replicate's widths are computed on a fine grid and joined by a monotone cubic in the logarithm of distance,
    whose error there is below a tenth of a per mille.
    """
    grid = np.geomspace(distance[0], distance[-1], _CROSSING_POINTS)

    def width(camera: UncertainCamera, replicate: int) -> FloatArray:
        draws = _draws(_CROSSING_DRAWS, grid.size, seed, f"crossing/{camera.name}/{field:g}/{way}")
        return half_width(camera.model(grid, field), camera.sources.of_class(WAYS[way]), draws, replicate)

    ratios = [log_ratio(width(first, replicate), width(second, replicate)) for replicate in range(_REPLICATES)]
    # Where only one is bounded the ratio is infinite: its sign counts, and a large number joins it to the rest.
    ratios = [
        np.clip(np.nan_to_num(ratio, nan=np.nan, posinf=_LARGEST, neginf=-_LARGEST), -_LARGEST, _LARGEST)
        for ratio in ratios
    ]
    seen = np.flatnonzero(np.all(np.isfinite(ratios), axis=0))
    if seen.size < 2:
        return ()
    logs = np.log(grid[seen])
    curves = [PchipInterpolator(logs, ratio[seen]) for ratio in ratios]
    return crossings(
        lambda points, replicate: np.asarray(curves[replicate](np.log(points))), grid[seen], replicates=_REPLICATES
    )


@dataclass(frozen=True, kw_only=True)
class Stability:
    """The answer to an inverse question.

    Parameters
    ----------
    declared, value, error
        Standard deviation of the error as declared and as needed, and the Monte Carlo error of the latter, in the unit
        of the error; NaN where no spread answers.
    reason
        Why there is no answer; empty where there is one.
    wanted, without, as_declared
        Uncertainty [m] wanted, left without this error, and as declared.
    """

    declared: float
    value: float
    error: float
    reason: str
    wanted: float
    without: float
    as_declared: float


def stability(question: StabilityQuestionPart, cameras: Mapping[str, UncertainCamera], *, seed: int) -> Stability:
    """Find the spread of one error at which a camera is as uncertain as asked for, all else as declared.

    The draws of the error are scaled about zero, so that its shape stays; both widths come from the same random
    numbers in each replicate.

    Raises
    ------
    OutOfRangeError
        The camera has no such error.
    """
    camera, place = cameras[question.camera], np.array([question.at])
    sources = camera.sources.of_class(WAYS[question.way])
    asked_for, declared = _errors_asked_for(camera, sources, question.parameter)

    def width(of: UncertainCamera, scale: float, replicate: int) -> float:
        scaled = dict.fromkeys(asked_for, scale) if of is camera else {}
        draws = _draws(_SOLVE_DRAWS, 1, seed, f"solve/{of.name}/{question.way}")
        drawn = of.sources.of_class(WAYS[question.way])
        return float(half_width(of.model(place, 0.0, scaled), drawn, draws, replicate)[0])

    def wanted(replicate: int) -> float:
        if question.equal is not None:
            return width(cameras[question.equal], 1.0, replicate)
        return float((question.relative or 0.0) * question.at)

    wanted_widths = [wanted(replicate) for replicate in range(_REPLICATES)]

    def quantity(log_scale: float, replicate: int) -> float:
        found = width(camera, float(np.exp(log_scale)), replicate)
        return float(log_ratio(np.array(found), np.array(wanted_widths[replicate])))

    without, as_declared = (
        float(np.mean([width(camera, scale, replicate) for replicate in range(_REPLICATES)])) for scale in (0.0, 1.0)
    )
    reason = ""
    answer = Solution(value=np.nan, standard_error=np.nan)
    try:
        answer = solve_in_replicates(quantity, low=np.log(_SCALES[0]), high=np.log(_SCALES[1]), replicates=_REPLICATES)
    except OutOfRangeError:
        reached = without > float(np.mean(wanted_widths))
        reason = "not even without this error" if reached else "whatever its spread"
    scale = float(np.exp(answer.value))
    return Stability(
        declared=declared,
        value=declared * scale,
        error=declared * scale * answer.standard_error,
        reason=reason,
        wanted=float(np.mean(wanted_widths)),
        without=without,
        as_declared=as_declared,
    )


def _errors_asked_for(camera: UncertainCamera, sources: Sources, name: str) -> tuple[tuple[str, ...], float]:
    """The errors that a name stands for, one or those of a group, and the declared standard deviation of the first."""
    full = camera.name + SEPARATOR + name
    for group in sources.active_groups:
        members = group.parameters if group.name == full else tuple(p for p in group.parameters if p == full)
        if members:
            deviation = group.marginal(group.parameters.index(members[0])).standard_deviation
            return tuple(map(short_name, members)), float("nan") if deviation is None else deviation
    known = [short_name(name) for group in sources.active_groups for name in (group.name, *group.parameters)]
    raise OutOfRangeError(
        f"{camera.name} has no such error in this way of counting",
        value=name,
        limit=", ".join(dict.fromkeys(known)),
        remedy="ask for one of its errors",
    )

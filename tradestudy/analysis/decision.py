"""Which camera for which distance: winners, crossovers, what other readings change, and inverse questions."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from tradestudy.analysis.depth import WAYS, depth_uncertainty
from tradestudy.analysis.usable import all_met, boundaries, evaluate_limits, margin, usable_ends
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.errors import NotConvergedError
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.study.definition import Case, StudyDefinition
from tradestudy.study.expectations import question_ends
from tradestudy.study.schema.questions import SolvePart
from tradestudy.study.sweep import quantity_entry
from tradestudy.units import Dimension, pretty

_ROOT_TOLERANCE = 1e-10


@dataclass(frozen=True, kw_only=True)
class PairVerdict:
    """The headline pair under one reading of the assumptions.

    Parameters
    ----------
    winner, more_certain
        Names by place and way, shape (place, way); ``winner`` counts only usable cameras and may be empty.
    ratio
        Uncertainty of the first camera over that of the second, shape (place, way).
    crossings
        For each way, the distances [m] where the two are equally uncertain, usable or not, and the camera that is more
        certain nearer than that.
    changes
        For each way, the distances [m] where the winner changes, and who wins nearer and farther.
    """

    winner: list[list[str]]
    more_certain: list[list[str]]
    ratio: FloatArray
    crossings: Mapping[str, tuple[tuple[float, str], ...]]
    changes: Mapping[str, tuple[tuple[float, str, str], ...]]


def is_usable(case: Case, name: str, distance: FloatArray) -> BoolArray:
    """Where every limit of the study holds for a camera, at distances [m]."""
    return all_met(evaluate_limits(case.cameras[name], case.criteria, distance), distance.shape)


def best_cameras(usable: Mapping[str, BoolArray], uncertainty: Mapping[str, FloatArray]) -> list[str]:
    """The usable camera of lowest uncertainty at each distance; empty where none is usable."""
    names = list(usable)
    table = np.stack([np.where(usable[name], uncertainty[name], np.inf) for name in names])
    table = np.where(np.isnan(table), np.inf, table)
    best = np.argmin(table, axis=0)
    return [names[i] if math.isfinite(table[i, k]) else "" for k, i in enumerate(best)]


def decide_pair(case: Case, pair: tuple[str, str], places: FloatArray) -> PairVerdict:
    """Who of two cameras is more certain, and who wins among the usable, at places [m] and three ways."""
    first, second = (case.cameras[name] for name in pair)
    ratios = np.stack([_ratio(first, second, places, way) for way in WAYS], axis=-1)
    winners = _winners(case, pair, places, WAYS)
    crossings = {way: _crossings(case, pair, way) for way in WAYS}
    ends = {place for name in pair for place in _ends_of_use(case, name)}
    return PairVerdict(
        winner=[list(row) for row in zip(*winners, strict=True)],
        more_certain=[[_more_certain(pair, r) for r in row] for row in ratios],
        ratio=ratios,
        crossings=crossings,
        changes={way: _changes(case, pair, way, ends | {place for place, _ in crossings[way]}) for way in WAYS},
    )


def _ratio(first: DepthCamera, second: DepthCamera, distance: FloatArray, way: str) -> FloatArray:
    """u₁/u₂; infinite over infinite is undecided, NaN."""
    a, b = depth_uncertainty(first, distance, way), depth_uncertainty(second, distance, way)
    with np.errstate(divide="ignore", invalid="ignore"):  # unbounded intervals are outcomes
        return np.asarray(a / b)


def _more_certain(pair: tuple[str, str], ratio: float) -> str:
    """Of two that are equal to rounding neither is."""
    if math.isnan(ratio) or math.isclose(ratio, 1.0, rel_tol=1e-9):
        return ""
    return pair[0] if ratio < 1.0 else pair[1]


def _winners(case: Case, pair: tuple[str, str], distance: FloatArray, ways: Iterable[str]) -> list[list[str]]:
    usable = {name: is_usable(case, name, distance) for name in pair}
    return [
        best_cameras(usable, {name: depth_uncertainty(case.cameras[name], distance, way) for name in pair})
        for way in ways
    ]


def _ends_of_use(case: Case, name: str) -> tuple[float, ...]:
    """Distances [m] where a camera becomes usable or ceases to be."""
    camera = case.cameras[name]
    limits = evaluate_limits(camera, case.criteria, case.distance)
    return tuple(end.distance for end in usable_ends(camera, case.criteria, case.distance, limits))


def _changes(case: Case, pair: tuple[str, str], way: str, places: set[float]) -> tuple[tuple[float, str, str], ...]:
    """Where the winner changes: only where a camera's use ends or the two are equally uncertain can it."""
    if not places:
        return ()
    ordered = np.array(sorted(places))
    (sides,) = _winners(case, pair, np.concatenate([ordered * (1.0 - 1e-9), ordered * (1.0 + 1e-9)]), (way,))
    found: list[tuple[float, str, str]] = []
    for place, nearer, farther in zip(ordered.tolist(), sides[: ordered.size], sides[ordered.size :], strict=True):
        # Both cameras change at one place, to the last digit or next to it: it is told once.
        if nearer != farther and not (found and place <= found[-1][0] * (1.0 + 1e-9)):
            found.append((place, nearer, farther))
    return tuple(found)


def _crossings(case: Case, pair: tuple[str, str], way: str) -> tuple[tuple[float, str], ...]:
    first, second = (case.cameras[name] for name in pair)

    def below_one(points: FloatArray) -> FloatArray:
        ratio = _ratio(first, second, points, way)
        return margin(ratio < 1.0, ratio - 1.0)

    # Between the poles of either camera the ratio is undecided; it counts as "not below one" on both sides alike.
    found = boundaries(below_one, case.distance)
    return tuple((end.distance, pair[1] if end.begins else pair[0]) for end in found)


@dataclass(frozen=True, kw_only=True)
class Solved:
    """The answer to an inverse question, in the SI unit of what was varied."""

    value: float
    dimension: Dimension
    answer: str


def solve(definition: StudyDefinition, question: SolvePart) -> Solved:
    """Find the value of one input that makes two cameras equally certain at a distance.

    The ratio of the uncertainties is followed between the declared ends and its crossing of one is found by Brent's
    method, on a logarithmic scale where both ends are positive.

    Raises
    ------
    OutOfRangeError
        Where the ends do not share a unit, or the varied path does not exist.
    NotConvergedError
        If the root finder fails.
    """
    from scipy.optimize import brentq

    dimension, low, high = question_ends(question)
    distance = np.array([question.at])

    def log_ratio(log_value: float) -> float:
        value = quantity_entry(math.exp(log_value), dimension)
        cameras = definition.with_values({question.vary: value}).case.cameras
        first, second = (cameras[name] for name in question.equal)
        ratio = float(_ratio(first, second, distance, question.errors)[0])
        return math.log(ratio) if ratio > 0.0 and math.isfinite(ratio) else math.copysign(700.0, ratio - 1.0)

    ends = [log_ratio(math.log(value)) for value in (low, high)]
    between = f"{pretty(low, dimension)} and {pretty(high, dimension)}"
    if ends[0] * ends[1] > 0.0:
        certain = question.equal[0] if ends[0] < 0.0 else question.equal[1]
        return Solved(
            value=math.nan,
            dimension=dimension,
            answer=f"nowhere between {between}: {certain} is more certain throughout",
        )
    root, report = brentq(log_ratio, math.log(low), math.log(high), xtol=_ROOT_TOLERANCE, full_output=True)
    if not report.converged:
        raise NotConvergedError("an inverse question was not solved", value=question.says, remedy="narrow its ends")
    value = math.exp(root)
    answer = pretty(value, dimension, digits=3)
    if definition.document.entry(question.vary) is not None:
        answer += f" (declared: {definition.document.text_of(question.vary)})"
    return Solved(value=value, dimension=dimension, answer=answer)

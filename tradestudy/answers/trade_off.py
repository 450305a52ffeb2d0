"""/criteria: the Pareto front of cameras or designs, and their ranks under all possible weights of the criteria."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from tradestudy.answers.decision import is_usable
from tradestudy.answers.depth import over_designs
from tradestudy.answers.requirements import ANY, Judge
from tradestudy.answers.trade_criteria import criterion_of
from tradestudy.cameras.depth_camera import DepthCamera, UsableCriteria
from tradestudy.depth.evaluation import distribution, judged_at
from tradestudy.depth.table import judged_uncertainty_error
from tradestudy.depth.usable import usable_intervals
from tradestudy.execution.steps import Progress
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.prepared import Case, PreparedStudy
from tradestudy.study.schema.requirements import TradeOffPart, WeighedPart, weighed_dimension
from tradestudy.study.varying import sweep_axes
from tradestudy.uncertainty.trade_off import Acceptability, ValueScale, acceptability
from tradestudy.units import LENGTH, parse, pretty

BoolArray = npt.NDArray[np.bool_]


def non_dominated(values: FloatArray, maximise: Sequence[bool]) -> BoolArray:
    """Which rows no other row dominates, over any number of criteria.

    A row dominates another if it is at least as good in every criterion and better in one, so equal rows do not
    dominate each other. A row with a NaN dominates none and is not on the front.

    Parameters
    ----------
    values
        Shape (alternatives, criteria); infinite values are compared as such.
    maximise
        For each criterion, whether more is better.

    Returns
    -------
    numpy.ndarray
        Shape (alternatives,).
    """
    costs = np.where(np.asarray(maximise, dtype=bool), -values, values)
    known = ~np.isnan(costs).any(axis=1)
    undominated = np.zeros(len(costs), dtype=bool)
    if not known.any():
        return undominated
    # In lexicographic order only earlier rows can dominate a row, and duplicates are removed.
    rows, inverse = np.unique(costs[known] + 0.0, axis=0, return_inverse=True)
    on_front = np.zeros(len(rows), dtype=bool)
    for number, row in enumerate(rows):
        on_front[number] = not (rows[:number][on_front[:number]] <= row).all(axis=1).any()
    undominated[known] = on_front[inverse.ravel()]
    return undominated


@dataclass(frozen=True, kw_only=True)
class CriterionValues:
    """Criteria of cameras, in SI, with their standard errors; shape (cameras, criteria).

    NaN if a camera has no value: it is not usable at the distance, or not usable at all.
    """

    values: FloatArray
    errors: FloatArray


class Measurer:
    """Computes criteria; shares the results of cameras that occur in several designs."""

    def __init__(self) -> None:
        self._known: dict[tuple[WeighedPart, DepthCamera, UsableCriteria], tuple[float, float]] = {}

    def measure(self, study: PreparedStudy) -> CriterionValues:
        """The criteria of the trade-off of a study, over its cameras."""
        file, case = study.file, study.case
        assert file.trade_off is not None  # the caller has checked
        measured = np.array(
            [
                [
                    self._measured(case, camera, criterion, weighed)
                    for criterion, weighed in file.trade_off.criteria.items()
                ]
                for camera in file.ranked
            ]
        )
        return CriterionValues(values=measured[..., 0], errors=measured[..., 1])

    def _measured(self, case: Case, camera: str, criterion: str, weighed: WeighedPart) -> tuple[float, float]:
        if weighed.quantity is None:
            return criterion_of(case, camera, criterion).number, 0.0
        key = (weighed, case.cameras[camera], case.criteria)
        if key not in self._known:
            self._known[key] = _computed(case, camera, weighed)
        return self._known[key]


def _computed(case: Case, camera_name: str, weighed: WeighedPart) -> tuple[float, float]:
    camera = case.cameras[camera_name]
    if weighed.at is not None:
        at = np.array([weighed.at])
        if not is_usable(case, camera_name, at)[0]:
            return math.nan, 0.0
        error = judged_uncertainty_error(camera, at, depth=distribution)
        return float(judged_at(camera, at)[0]), float(np.nan_to_num(error)[0])
    intervals = usable_intervals(camera, case.criteria, case.distance)
    if not intervals:
        return math.nan, 0.0
    is_near = weighed.quantity == "usable_near"
    return (intervals[0].near, intervals[0].near_error) if is_near else (intervals[-1].far, intervals[-1].far_error)


def value_scales(study: PreparedStudy) -> tuple[ValueScale, ...]:
    """The value function of every criterion of a trade-off, in SI."""
    part, attributes = study.file.trade_off, study.case.attributes
    assert part is not None
    scales = []
    for criterion, weighed in part.criteria.items():
        dimension = weighed_dimension(criterion, weighed.quantity, attributes.values())
        scales.append(ValueScale(worst=parse(weighed.worst, dimension), best=parse(weighed.best, dimension)))
    return tuple(scales)


STEP = "trade-off"


def trade_off_group(
    study: PreparedStudy, designs: Sequence[PreparedStudy], judge: Judge, progress: Progress
) -> xr.Dataset:
    """/criteria over (candidate, criterion), candidates and ranks, and over (swept parameters, candidate)."""
    file, axes = study.file, sweep_axes(study)
    part, names = file.trade_off, file.ranked
    assert part is not None  # the caller has checked
    measurer, scales, weights = Measurer(), value_scales(study), part.weights
    declared = measurer.measure(study)
    ranking = acceptability(declared.values, declared.errors, scales, weights, seed=file.propagation.seed)
    measured, feasible = [], []
    for number, design in enumerate(designs):
        progress(STEP, number / len(designs))
        measured.append(declared if design is study else measurer.measure(design))
        feasible.append(_feasible(design, names, judge))
    possible = np.array(feasible)  # the Pareto front is that of all candidates in all feasible designs
    table = np.array([criteria.values for criteria in measured])
    rows = np.where(possible[..., np.newaxis], table, np.nan).reshape(possible.size, -1)
    front = non_dominated(rows, [scale.best > scale.worst for scale in scales]).reshape(possible.shape)
    progress(STEP, 1.0)
    shape = tuple(len(axis.labels) for axis in axes)
    values: dict[str, Any] = {
        **_weighed(study, part, declared, scales),
        **_ranks(ranking),
        "feasible": np.array(feasible, dtype=np.float64).reshape(*shape, len(names)),
        "on_pareto_front": front.astype(np.float64).reshape(*shape, len(names)),
    }
    if axes:
        whole = (*shape, len(names), len(part.criteria))
        values["design_value"] = table.reshape(whole)
        values["design_value_error"] = np.array([criteria.errors for criteria in measured]).reshape(whole)
    coordinates: dict[str, Any] = {
        "candidate": list(names),
        "weighed": list(part.criteria),
        "rank": np.arange(1, len(names) + 1),
    }
    return over_designs("criteria", values, coordinates, axes, {"weight_draws": ranking.draws})


def _weighed(
    study: PreparedStudy, part: TradeOffPart, measured: CriterionValues, scales: Sequence[ValueScale]
) -> dict[str, Any]:
    attributes = study.case.attributes
    dimensions = [
        weighed_dimension(criterion, weighed.quantity, attributes.values())
        for criterion, weighed in part.criteria.items()
    ]
    ranges = [weighed.range for weighed in part.criteria.values()]
    order = part.order or ()
    return {
        "weighed_value": measured.values,
        "weighed_value_error": measured.errors,
        "weighed_units": [dimension.unit or "1" for dimension in dimensions],
        "weighed_says": [_says(criterion, weighed) for criterion, weighed in part.criteria.items()],
        "worst": [scale.worst for scale in scales],
        "best": [scale.best for scale in scales],
        "worth": np.stack(
            [scale.value(column) for scale, column in zip(scales, measured.values.T, strict=True)], axis=1
        ),
        "worth_error": measured.errors / [abs(scale.best - scale.worst) for scale in scales],
        "clipped": np.stack(
            [scale.clips(column) for scale, column in zip(scales, measured.values.T, strict=True)], axis=1
        ).astype(np.float64),
        "weight_low": [low for low, _ in ranges],
        "weight_high": [high for _, high in ranges],
        "weight_order": [order.index(criterion) + 1 if criterion in order else 0 for criterion in part.criteria],
    }


def _says(criterion: str, weighed: WeighedPart) -> str:
    match weighed.quantity:
        case None:
            return criterion
        case "depth_uncertainty":
            return f"depth uncertainty at {pretty(weighed.at or 0.0, LENGTH)}"
        case quantity:
            return f"{'near' if quantity == 'usable_near' else 'far'} end of the usable range"


def _ranks(ranking: Acceptability) -> dict[str, Any]:
    first, missing = ranking.rank[:, 0], np.asarray(np.isnan(ranking.central).any(axis=1))
    reasons = ["never ranks first" if share == 0.0 else "ranks first in too few draws" for share in first.tolist()]
    return {
        "weight_mean": ranking.mean,
        "rank_acceptability": ranking.rank,
        "rank_acceptability_error": ranking.rank_error,
        "central_weight": ranking.central,
        "central_weight_error": ranking.central_error,
        "central_weight_reason": [
            reason if none else "" for reason, none in zip(reasons, missing.tolist(), strict=True)
        ],
    }


def _feasible(design: PreparedStudy, names: Sequence[str], judge: Judge) -> list[bool]:
    """Whether each candidate itself meets all "must" requirements, including those that any camera may meet."""
    feasible = dict.fromkeys(names, True)
    for requirement in design.file.requirements.values():
        if requirement.priority != "must":
            continue
        deciding, answers = judge.answer(requirement, design.case)
        for candidate in names:
            answer = answers.get(candidate) if requirement.camera == ANY else deciding
            feasible[candidate] &= answer is not None and answer.met is True
    return list(feasible.values())

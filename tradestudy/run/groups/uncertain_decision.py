"""What calibration errors add to /decision: ranks by probability, crossovers with their error, stability needed."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import xarray as xr

from tradestudy.analysis.propagation import FIELDS
from tradestudy.analysis.uncertain_decision import RANK_WAYS, Stability, crossovers, rank, stability
from tradestudy.calibration.declaration import CalibrationStudyPart, StabilityQuestionPart
from tradestudy.calibration.uncertain_cameras import UncertainCameras, short_name
from tradestudy.cameras.kinds import ERROR_UNITS
from tradestudy.execution.steps import Progress
from tradestudy.results import dataset
from tradestudy.units import ANGLE, LENGTH, NUMBER, Dimension, pretty

_DIMENSIONS = {"m": LENGTH, "rad": ANGLE, "1": NUMBER}


def uncertain_decision(
    uncertain: UncertainCameras, part: CalibrationStudyPart, progress: Progress
) -> xr.Dataset | None:
    """Variables for /decision, or None where the calibration part asks nothing."""
    values: dict[str, Any] = {}
    coordinates: dict[str, Any] = {}
    if part.compare:
        progress("comparison", 0.0)
        values |= _compared(uncertain, part)
        coordinates |= {
            "pair": [f"{first} vs {second}" for first, second in part.compare],
            "field": list(FIELDS),
            "rank_way": list(RANK_WAYS),
            "rank_distance": np.array(part.distance_values()),
        }
    if part.questions:
        progress("comparison", 0.5)
        values |= _answered(uncertain, part)
        coordinates["stability"] = list(part.questions)
    return dataset("decision", values, coordinates) if values else None


def _compared(uncertain: UncertainCameras, part: CalibrationStudyPart) -> dict[str, Any]:
    distance = np.array(part.distance_values())
    shape = (len(part.compare), len(FIELDS), len(RANK_WAYS))
    names = ("rank_first", "rank_first_error", "rank_second")
    ranks = {name: np.full((*shape, distance.size), np.nan) for name in names}
    found: dict[tuple[int, ...], Any] = {}
    places = itertools.product(enumerate(part.compare), enumerate((0.0, part.edge)), enumerate(RANK_WAYS))
    for (i, pair), (j, field), (k, way) in places:
        first, second = (uncertain.cameras[name] for name in pair)
        ranked = rank(first, second, distance, field, way, seed=part.seed)
        ranks["rank_first"][i, j, k] = ranked.first
        ranks["rank_first_error"][i, j, k] = ranked.first_error
        ranks["rank_second"][i, j, k] = ranked.second
        found[i, j, k] = crossovers(first, second, distance, field, way, seed=part.seed)
    most = max(1, *(len(solutions) for solutions in found.values()))
    equal, error = np.full((*shape, most), np.nan), np.full((*shape, most), np.nan)
    for place, solutions in found.items():
        for order, solution in enumerate(solutions):
            equal[(*place, order)], error[(*place, order)] = solution.value, solution.standard_error
    return {
        **ranks,
        "pair_first": [first for first, _ in part.compare],
        "pair_second": [second for _, second in part.compare],
        "equal_distance": equal,
        "equal_distance_error": error,
    }


def _answered(uncertain: UncertainCameras, part: CalibrationStudyPart) -> dict[str, Any]:
    answers = [stability(question, uncertain.cameras, seed=part.seed) for question in part.questions.values()]
    dimensions = [_dimension(question, uncertain) for question in part.questions.values()]
    return {
        "stability_says": [question.says for question in part.questions.values()],
        "stability_answer": [_in_words(a, d) for a, d in zip(answers, dimensions, strict=True)],
        "stability_declared": [answer.declared for answer in answers],
        "stability_value": [answer.value for answer in answers],
        "stability_error": [answer.error for answer in answers],
        "stability_units": [dimension.unit or "1" for dimension in dimensions],
        "stability_wanted": [answer.wanted for answer in answers],
        "stability_without": [answer.without for answer in answers],
        "stability_as_declared": [answer.as_declared for answer in answers],
    }


def _dimension(question: StabilityQuestionPart, uncertain: UncertainCameras) -> Dimension:
    """What the error, or the first of a group's, is measured in."""
    groups = uncertain.cameras[question.camera].groups
    name = next((group.parameters[0] for group in groups if group.name == question.parameter), question.parameter)
    return _DIMENSIONS[ERROR_UNITS.get(short_name(name), "1")]


def _in_words(answer: Stability, dimension: Dimension) -> str:
    if answer.reason:
        left = pretty(answer.without, LENGTH)
        return f"{answer.reason}: {pretty(answer.wanted, LENGTH)} wanted, {left} left without it"
    error = pretty(answer.error, dimension, digits=2)
    factor = answer.value / answer.declared
    return (
        f"{pretty(answer.value, dimension, digits=3)} (± {error} Monte Carlo), {factor:.3g} times the declared "
        f"{pretty(answer.declared, dimension, digits=3)}"
    )

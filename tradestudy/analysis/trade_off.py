"""Criteria of a trade-off as numbers: declared, derived for the relief, or computed with their errors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tradestudy.analysis.decision import is_usable
from tradestudy.analysis.depth_table import judged_uncertainty, judged_uncertainty_error
from tradestudy.analysis.trade_criteria import criterion_of
from tradestudy.analysis.usable import usable_intervals
from tradestudy.cameras.depth_camera import DepthCamera, UsableCriteria
from tradestudy.errors import Problem, StudyError
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.definition import Case, StudyDefinition
from tradestudy.study.schema.requirements import WeighedPart, weighed_dimension
from tradestudy.uncertainty.trade_off import ValueScale
from tradestudy.units import parse


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

    def measure(self, definition: StudyDefinition) -> CriterionValues:
        """The criteria of the trade-off of a study, over its cameras."""
        file, case = definition.file, definition.case
        assert file.trade_off is not None  # the caller has checked
        found = np.array(
            [
                [self._one(case, camera, name, one) for name, one in file.trade_off.criteria.items()]
                for camera in file.ranked
            ]
        )
        return CriterionValues(values=found[..., 0], errors=found[..., 1])

    def _one(self, case: Case, camera: str, name: str, one: WeighedPart) -> tuple[float, float]:
        if one.quantity is None:
            return criterion_of(case, camera, name).number, 0.0
        key = (one, case.cameras[camera], case.criteria)
        if key not in self._known:
            self._known[key] = _computed(case, camera, one)
        return self._known[key]


def _computed(case: Case, name: str, one: WeighedPart) -> tuple[float, float]:
    camera = case.cameras[name]
    if one.at is not None:
        at = np.array([one.at])
        if not is_usable(case, name, at)[0]:
            return math.nan, 0.0
        return float(judged_uncertainty(camera, at)[0]), float(np.nan_to_num(judged_uncertainty_error(camera, at))[0])
    found = usable_intervals(camera, case.criteria, case.distance)
    if not found:
        return math.nan, 0.0
    is_near = one.quantity == "usable_near"
    return (found[0].near, found[0].near_error) if is_near else (found[-1].far, found[-1].far_error)


def value_scales(definition: StudyDefinition) -> tuple[ValueScale, ...]:
    """The value function of every criterion of a trade-off, in SI."""
    part, attributes = definition.file.trade_off, definition.case.attributes
    assert part is not None
    scales = []
    for name, one in part.criteria.items():
        dimension = weighed_dimension(name, one.quantity, attributes.values())
        scales.append(ValueScale(worst=parse(one.worst, dimension), best=parse(one.best, dimension)))
    return tuple(scales)


def refuse_words(definition: StudyDefinition) -> None:
    """Refuse, before anything is computed, to weigh a derived criterion that has no number for some camera.

    Raises
    ------
    StudyError
        At every such criterion.
    """
    part, case = definition.file.trade_off, definition.case
    if part is None:
        return
    problems: list[Problem] = []
    for name, one in part.criteria.items():
        if one.quantity is None:
            problems += _words(definition, case, name, definition.file.ranked)
    if problems:
        raise StudyError(problems)


def _words(definition: StudyDefinition, case: Case, name: str, ranked: Sequence[str]) -> list[Problem]:
    path = ("trade_off", "criteria", name)
    found = {camera: criterion_of(case, camera, name) for camera in ranked}
    return [
        definition.document.locate(path).problem(
            path,
            f"{camera!r} has no number for this criterion ({one.text}); leave the criterion out, or list candidates "
            "without this camera",
        )
        for camera, one in found.items()
        if math.isnan(one.number)
    ]

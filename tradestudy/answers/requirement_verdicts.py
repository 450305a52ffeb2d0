"""/requirements: which are met, by which camera, with what margin; under every reading, and in every design."""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import xarray as xr

from tradestudy.answers.decision import largest_cause
from tradestudy.answers.depth import over_designs
from tradestudy.answers.requirement_answer import RequirementAnswer
from tradestudy.answers.requirements import ALL, ANY, Judge
from tradestudy.answers.solutions import bracketed, planned
from tradestudy.errors import TradestudyError
from tradestudy.execution import Steps
from tradestudy.imaging.picture import at_bound
from tradestudy.results import padded_attributes
from tradestudy.study.bases import NamedInput, uncertain_input
from tradestudy.study.prepared import Case, PreparedStudy
from tradestudy.study.schema.requirements import (
    BoundOverPart,
    CriterionPart,
    LengthBelowPart,
    RefocusablePart,
    RefocusedDepthOfFieldPart,
    Required,
    RequirementPart,
    ShareAbovePart,
    ShareBelowPart,
    SharpPart,
    UsablePart,
)
from tradestudy.study.varying import SweepAxis, Varying, sweep_axes
from tradestudy.units import FRACTION, LENGTH, pretty
from tradestudy.wording import counted, limit_words

_BY_MATCHING: Final = ("depth_uncertainty", "usable", "failed_fraction")  # quantities that depend on the matcher
# Quantities and limits that depend on errors.
_OF_ERRORS: Final = ("depth_uncertainty", "relative_uncertainty", "failed_fraction")
_Answers = tuple[RequirementAnswer, Mapping[str, RequirementAnswer]]
"""The deciding answer to a requirement, and those of all cameras that it concerns."""
_ROOT_TO: Final = 0.1  # of the tolerance: relative accuracy of the ends of an interval


def requirements_group(
    study: PreparedStudy, designs: Sequence[PreparedStudy], judge: Judge, steps: Steps
) -> xr.Dataset:
    """/requirements over requirements, and over (swept parameters, requirement)."""
    requirements, axes = study.file.requirements, sweep_axes(study)
    found = {name: judge.answer(one, study.case) for name, one in requirements.items()}
    only_depth = all(one.asks_for_depth for one in requirements.values())
    cameras = list(study.case.cameras if only_depth else study.case.all_cameras)
    deciding = [one for one, _ in found.values()]
    by_camera = [[every.get(name) for name in cameras] for _, every in found.values()]
    margins = [[math.nan if one is None else 100.0 * one.margin for one in row] for row in by_camera]
    values: dict[str, Any] = {
        "says": [one.says for one in requirements.values()],
        "priority": [one.priority for one in requirements.values()],
        "quantity": [one.quantity for one in requirements.values()],
        "of": [one.camera for one in requirements.values()],
        "met": [_verdict(one) for one in deciding],
        "camera_deciding": [one.camera for one in deciding],
        "value": [one.value for one in deciding],
        "value_error": [one.error for one in deciding],
        "bound": [one.bound for one in deciding],
        "bound_is_relative": [
            isinstance(one.required, BoundOverPart) and one.required.is_relative for one in requirements.values()
        ],
        "bound_text": [_bound_words(one.required) for one in requirements.values()],
        "over_near": [one.over[0] if one.over else math.nan for one in requirements.values()],
        "over_far": [one.over[-1] if one.over else math.nan for one in requirements.values()],
        "place": [one.place for one in deciding],
        "margin_percent": [100.0 * one.margin for one in deciding],
        "margin_sigma": [one.margin_in_errors for one in deciding],
        "conformity": [one.conformity for one in deciding],
        "within_tolerance": _near_its_bound(study, found.values()),
        "reason": [one.reason for one in deciding],
        "limited_by": [one.limit for one in deciding],
        **_rests_on(study, deciding),
        **_with_matching_at_its_bound(study, judge),
        **_under_other_readings(study, judge),
        "camera_met": [[-1 if one is None else _verdict(one) for one in row] for row in by_camera],
        "camera_margin_percent": margins,
        "camera_reason": [["" if one is None else one.reason for one in row] for row in by_camera],
    }
    coordinates: dict[str, Any] = {"requirement": list(requirements), "camera": cameras}
    if study.readings:
        coordinates["reading"] = list(study.readings)
    if axes:
        judge.check([(one, design.case) for design in designs for one in design.file.requirements.values()], steps)
        answers = [
            [judge.answer(design.file.requirements[name], design.case) for name in requirements] for design in designs
        ]
        table = [[one for one, _ in row] for row in answers]
        shape = (*(len(axis.labels) for axis in axes), len(requirements))

        def shaped(of: list[list[Any]]) -> np.ndarray[Any, Any]:
            return np.array(of).reshape(shape)

        values |= {
            "design_met": shaped([[_verdict(one) for one in row] for row in table]),
            "design_camera": shaped([[one.camera for one in row] for row in table]),
            "design_margin_percent": shaped([[100.0 * one.margin for one in row] for row in table]),
            "design_margin_sigma": shaped([[one.margin_in_errors for one in row] for row in table]),
            "design_within_tolerance": shaped([_near_its_bound(study, row) for row in answers]),
            "design_reason": shaped([[one.reason for one in row] for row in table]),
            "design_limited_by": shaped([[one.limit for one in row] for row in table]),
        }
        if len(axes) == 1 and _is_numeric(axes[0]):
            columns = list(zip(*answers, strict=True))
            found_stretches = [
                _stretches(study, name, axes[0], column, judge)
                for name, column in zip(requirements, columns, strict=True)
            ]
            absent = {"met_from": math.nan, "met_to": math.nan, "met_to_within": math.nan, "met_camera": ""}
            values |= padded_attributes(found_stretches, absent)
        steps.progress("requirements", 1.0)
    return over_designs("requirements", values, coordinates, axes)


def _bound_words(required: Required) -> str:
    """A bound in words."""
    match required:
        case BoundOverPart(is_relative=True):
            share = pretty(required.limit, FRACTION)
            return f"at most {share} {'the' if share.endswith('times') else 'of the'} distance"
        case BoundOverPart():
            return f"at most {pretty(required.limit, LENGTH)}"
        case LengthBelowPart():
            return f"at most {pretty(required.below, LENGTH)}"
        case ShareBelowPart():
            return f"at most {pretty(required.below, FRACTION)}"
        case ShareAbovePart():
            return f"at least {pretty(required.above, FRACTION)}"
        case UsablePart():
            return "usable"
        case SharpPart(above=None):
            return "sharp"
        case SharpPart():
            return f"at least {pretty(required.above or 0.0, LENGTH)}"
        case RefocusablePart(planes=None):
            return "refocusable"
        case RefocusablePart():
            return f"at least {counted(required.planes or 0, 'plane')}"
        case RefocusedDepthOfFieldPart():
            return f"{'at least' if required.below is None else 'at most'} {pretty(required.bound, LENGTH)}"
        case CriterionPart():
            return f"{'at most' if required.side == 'below' else 'at least'} {required.bound}"


def _rests_on(study: PreparedStudy, deciding: Sequence[RequirementAnswer]) -> dict[str, Any]:
    """The limit that decides or, if errors do, the largest cause of the camera's uncertainty at the worst distance."""
    inputs, shares = [], []
    for requirement, answer in zip(study.file.requirements.values(), deciding, strict=True):
        cause, limit = None, ""
        if answer.limit:
            which = "sharp" if requirement.quantity == "depth_of_field" else "usable"
            limit = f"the {which} range of {study.file.cameras[answer.camera].title} ({limit_words(answer.limit)})"
        uncertain = requirement.quantity in _OF_ERRORS and answer.value > 0.0
        if math.isfinite(answer.place) and (answer.limit in _OF_ERRORS or (uncertain and not answer.limit)):
            cause = largest_cause(study.case.cameras[answer.camera], np.array([answer.place]), answer.field)
        inputs.append(
            NamedInput(words=limit) if cause is None else uncertain_input(study, answer.camera, cause.parameter)
        )
        shares.append(math.nan if cause is None else cause.share)
    return {
        "rests_on": [one.words for one in inputs],
        "rests_on_basis": [one.basis for one in inputs],
        "rests_on_share": shares,
    }


def _with_matching_at_its_bound(study: PreparedStudy, judge: Judge) -> dict[str, Any]:
    """Requirements on cameras with a declared matcher, answered as if that matcher reached the theoretical bound."""
    case = study.case
    best = replace(case, cameras={name: at_bound(camera) for name, camera in case.cameras.items()})
    found = [
        judge.answer(one, best)[0] if one.quantity in _BY_MATCHING and _concerns_a_matcher(one, case, best) else None
        for one in study.file.requirements.values()
    ]
    if not any(found):
        return {}
    return {
        "bound_alone_met": [-1 if one is None else _verdict(one) for one in found],
        "bound_alone_camera": ["" if one is None else one.camera for one in found],
        "bound_alone_value": [math.nan if one is None else one.value for one in found],
        "bound_alone_value_error": [math.nan if one is None else one.error for one in found],
        "bound_alone_place": [math.nan if one is None else one.place for one in found],
        "bound_alone_reason": ["" if one is None else one.reason for one in found],
    }


def _under_other_readings(study: PreparedStudy, judge: Judge) -> dict[str, Any]:
    """The answers under each reading other than the study as declared."""
    if not study.readings:
        return {}
    found = [
        [judge.answer(reading.file.requirements[name], reading.case)[0] for reading in study.readings.values()]
        for name in study.file.requirements
    ]
    return {
        "reading_says": [study.file.readings[name].says for name in study.readings],
        "reading_met": [[_verdict(one) for one in row] for row in found],
        "reading_camera": [[one.camera for one in row] for row in found],
        "reading_reason": [[one.reason for one in row] for row in found],
    }


def _concerns_a_matcher(requirement: RequirementPart, case: Case, best: Case) -> bool:
    return any(
        requirement.camera in (ANY, ALL, name) and camera is not best.cameras[name]
        for name, camera in case.cameras.items()
    )


def _tolerance(study: PreparedStudy, requirement: RequirementPart) -> float:
    """The change that omitted effects may make to a requirement's quantity; declared values do not change."""
    if requirement.quantity == "criterion" or requirement.asks_for_refocusing:  # geometry, which no effect changes
        return -math.inf
    is_sharpness = requirement.quantity == "depth_of_field"
    return study.file.accuracy.asked().tolerances["depth_of_field" if is_sharpness else "depth_uncertainty"]


def _near_its_bound(
    study: PreparedStudy, found: Iterable[tuple[RequirementAnswer, Mapping[str, RequirementAnswer]]]
) -> list[float]:
    """1 for every answer that omitted effects could reverse, 0 for the others."""
    requirements = study.file.requirements.values()
    of_ends = study.file.accuracy.asked().tolerances["usable_range"]
    return [
        float(_could_be_reversed(deciding, every.values(), required.camera, _tolerance(study, required), of_ends))
        for (deciding, every), required in zip(found, requirements, strict=True)
    ]


def _could_be_reversed(
    deciding: RequirementAnswer,
    every: Collection[RequirementAnswer],
    cameras: str,
    of_value: float,
    of_ends: float,
) -> bool:
    """Whether changes of this size could reverse an answer.

    A met "any" and a missed "all" are reversed only if every camera with that answer changes; a missed "any" and a met
    "all" are reversed if one camera changes.
    """
    if deciding.met is None:
        return False
    if deciding.met is (cameras != ALL):
        return all(one.could_be_overturned(of_value, of_ends) for one in every if one.met is deciding.met)
    return any(one.could_be_overturned(of_value, of_ends) for one in every)


def _verdict(answer: RequirementAnswer) -> int:
    return -1 if answer.met is None else int(answer.met)


def _is_numeric(axis: SweepAxis) -> bool:
    return len(axis.values) > 1 and not isinstance(axis.labels[0], str) and axis.dimension is not None


@dataclass(frozen=True, kw_only=True)
class _Stretch:
    """An interval of the swept parameter in which one camera meets a requirement, with the error of its ends."""

    met_from: float
    met_to: float
    met_to_within: float
    met_camera: str


def _stretches(
    study: PreparedStudy, name: str, axis: SweepAxis, column: Sequence[_Answers], judge: Judge
) -> list[_Stretch]:
    """Intervals of one parameter in which a requirement is met, with ends located between designs.

    Where any camera may meet it, those of each camera by itself.
    """
    places = [float(label) for label in axis.labels]
    of = study.file.requirements[name].camera
    runs = [
        (camera, numbers)
        for camera in (column[0][1] if of == ANY else (of,))
        for is_met, numbers in _runs([_is_met_by(camera, one) for one in column])
        if is_met
    ]
    found = []
    for camera, numbers in runs:
        first, last = numbers[0], numbers[-1]
        (low, low_error), (high, high_error) = (
            _root(study, name, axis, (places[end], places[neighbour]), camera, judge)
            if 0 <= neighbour < len(column)
            else (places[end], 0.0)
            for end, neighbour in ((first, first - 1), (last, last + 1))
        )
        found.append(_Stretch(met_from=low, met_to=high, met_to_within=max(low_error, high_error), met_camera=camera))
    return found


def _runs(values: Sequence[bool]) -> list[tuple[bool, list[int]]]:
    """Equal neighbours together, with their indices."""
    return [(value, list(group)) for value, group in itertools.groupby(range(len(values)), key=lambda k: values[k])]


def _is_met_by(camera: str, answers: _Answers) -> bool:
    """Whether one camera, or all together if it is "all", meets a requirement."""
    deciding, every = answers
    return every.get(camera, deciding).met is True


def _root(
    study: PreparedStudy,
    name: str,
    axis: SweepAxis,
    ends: tuple[float, float],
    camera: str,
    judge: Judge,
) -> tuple[float, float]:
    """Where a camera that meets a requirement at the first of two values ceases to meet it, with the error.

    Found by bisection, because the margin may jump where a camera ceases to be usable. Parameters that count
    something, such as images, take whole numbers.
    """
    assert axis.dimension is not None
    varying = Varying.between(study, (axis.path,), axis.dimension, min(ends), max(ends))

    def holds(value: float) -> bool | None:
        try:
            changed = planned(study.with_values(varying.changes(value)))
        except TradestudyError:  # no valid study lies between, or no plan of its calibration
            return None
        requirement = changed.file.requirements[name]
        return _is_met_by(camera, judge.answer(requirement, changed.case))

    close = _ROOT_TO * study.file.accuracy.asked().tolerances["depth_uncertainty"]
    inside, outside = bracketed(*ends, holds, possible=varying.possible, close=close)
    return inside, 0.0 if varying.is_counted else abs(outside - inside) / 2.0

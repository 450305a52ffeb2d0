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
from tradestudy.study.bases import NamedInput, assumed_blur, uncertain_input
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
    judged = {name: judge.answer(requirement, study.case) for name, requirement in requirements.items()}
    only_depth = all(requirement.asks_for_depth for requirement in requirements.values())
    cameras = list(study.case.cameras if only_depth else study.case.all_cameras)
    deciding = [answer for answer, _ in judged.values()]
    by_camera = [[all_answers.get(camera) for camera in cameras] for _, all_answers in judged.values()]
    margins = [[math.nan if answer is None else 100.0 * answer.margin for answer in row] for row in by_camera]
    values: dict[str, Any] = {
        "says": [requirement.says for requirement in requirements.values()],
        "priority": [requirement.priority for requirement in requirements.values()],
        "quantity": [requirement.quantity for requirement in requirements.values()],
        "of": [requirement.camera for requirement in requirements.values()],
        "met": [_verdict(answer) for answer in deciding],
        "camera_deciding": [answer.camera for answer in deciding],
        "value": [answer.value for answer in deciding],
        "value_error": [answer.error for answer in deciding],
        "bound": [answer.bound for answer in deciding],
        "bound_is_relative": [
            isinstance(requirement.required, BoundOverPart) and requirement.required.is_relative
            for requirement in requirements.values()
        ],
        "bound_text": [_bound_words(requirement.required) for requirement in requirements.values()],
        "over_near": [requirement.over[0] if requirement.over else math.nan for requirement in requirements.values()],
        "over_far": [requirement.over[-1] if requirement.over else math.nan for requirement in requirements.values()],
        "place": [answer.place for answer in deciding],
        "margin_percent": [100.0 * answer.margin for answer in deciding],
        "margin_sigma": [answer.margin_in_errors for answer in deciding],
        "conformity": [answer.conformity for answer in deciding],
        "within_tolerance": _near_its_bound(study, judged.values()),
        "reason": [answer.reason for answer in deciding],
        "limited_by": [answer.limit for answer in deciding],
        **_rests_on(study, deciding),
        **_with_matching_at_its_bound(study, judge),
        **_under_other_readings(study, judge),
        "camera_met": [[-1 if answer is None else _verdict(answer) for answer in row] for row in by_camera],
        "camera_margin_percent": margins,
        "camera_reason": [["" if answer is None else answer.reason for answer in row] for row in by_camera],
    }
    coordinates: dict[str, Any] = {"requirement": list(requirements), "camera": cameras}
    if study.readings:
        coordinates["reading"] = list(study.readings)
    if axes:
        # In one step on the workers, so that the judge can look up the answers below.
        judge.check(
            [(requirement, design.case) for design in designs for requirement in design.file.requirements.values()],
            steps,
        )
        answers = [
            [judge.answer(design.file.requirements[name], design.case) for name in requirements] for design in designs
        ]
        table = [[answer for answer, _ in row] for row in answers]
        shape = (*(len(axis.labels) for axis in axes), len(requirements))

        def shaped(rows: list[list[Any]]) -> np.ndarray[Any, Any]:
            return np.array(rows).reshape(shape)

        values |= {
            "design_met": shaped([[_verdict(answer) for answer in row] for row in table]),
            "design_camera": shaped([[answer.camera for answer in row] for row in table]),
            "design_margin_percent": shaped([[100.0 * answer.margin for answer in row] for row in table]),
            "design_closeness": shaped([[answer.closeness for answer in row] for row in table]),
            "design_margin_sigma": shaped([[answer.margin_in_errors for answer in row] for row in table]),
            "design_within_tolerance": shaped([_near_its_bound(study, row) for row in answers]),
            "design_reason": shaped([[answer.reason for answer in row] for row in table]),
            "design_limited_by": shaped([[answer.limit for answer in row] for row in table]),
        }
        if len(axes) == 1 and _is_numeric(axes[0]):
            columns = list(zip(*answers, strict=True))
            stretches = [
                _stretches(study, name, axes[0], column, judge)
                for name, column in zip(requirements, columns, strict=True)
            ]
            absent = {"met_from": math.nan, "met_to": math.nan, "met_to_within": math.nan, "met_camera": ""}
            values |= padded_attributes(stretches, absent)
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
        cause, named = None, NamedInput()
        if answer.limit:
            which = "sharp" if requirement.quantity == "depth_of_field" else "usable"
            assumed = assumed_blur(study, answer.camera) if answer.limit.partition(", ")[0] == "focus" else ""
            why = limit_words(answer.limit) + f", by its {assumed}" * bool(assumed)
            words = f"the {which} range of {study.file.cameras[answer.camera].title} ({why})"
            named = NamedInput(words=words, basis="assumed" if assumed else "")
        # Errors decide where their limit ends the usable range, or where no limit does and the value depends on them.
        uncertain = requirement.quantity in _OF_ERRORS and answer.value > 0.0
        if math.isfinite(answer.place) and (answer.limit in _OF_ERRORS or (uncertain and not answer.limit)):
            cause = largest_cause(study.case.cameras[answer.camera], np.array([answer.place]), answer.field)
        inputs.append(named if cause is None else uncertain_input(study, answer.camera, cause.parameter))
        shares.append(math.nan if cause is None else cause.share)
    return {
        "rests_on": [entry.words for entry in inputs],
        "rests_on_basis": [entry.basis for entry in inputs],
        "rests_on_share": shares,
    }


def _with_matching_at_its_bound(study: PreparedStudy, judge: Judge) -> dict[str, Any]:
    """Requirements on cameras with a declared matcher, answered as if that matcher reached the theoretical bound."""
    case = study.case
    best = replace(case, cameras={name: at_bound(camera) for name, camera in case.cameras.items()})
    answers = [
        judge.answer(requirement, best)[0]
        if requirement.quantity in _BY_MATCHING and _concerns_a_matcher(requirement, case, best)
        else None
        for requirement in study.file.requirements.values()
    ]
    if not any(answers):
        return {}
    return {
        "bound_alone_met": [-1 if answer is None else _verdict(answer) for answer in answers],
        "bound_alone_camera": ["" if answer is None else answer.camera for answer in answers],
        "bound_alone_value": [math.nan if answer is None else answer.value for answer in answers],
        "bound_alone_value_error": [math.nan if answer is None else answer.error for answer in answers],
        "bound_alone_place": [math.nan if answer is None else answer.place for answer in answers],
        "bound_alone_reason": ["" if answer is None else answer.reason for answer in answers],
    }


def _under_other_readings(study: PreparedStudy, judge: Judge) -> dict[str, Any]:
    """The answers under each reading other than the study as declared."""
    if not study.readings:
        return {}
    answers = [
        [judge.answer(reading.file.requirements[name], reading.case)[0] for reading in study.readings.values()]
        for name in study.file.requirements
    ]
    return {
        "reading_says": [study.file.readings[name].says for name in study.readings],
        "reading_met": [[_verdict(answer) for answer in row] for row in answers],
        "reading_camera": [[answer.camera for answer in row] for row in answers],
        "reading_reason": [[answer.reason for answer in row] for row in answers],
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
    study: PreparedStudy, answers: Iterable[tuple[RequirementAnswer, Mapping[str, RequirementAnswer]]]
) -> list[float]:
    """1 for every answer that omitted effects could reverse, 0 for the others."""
    requirements = study.file.requirements.values()
    of_ends = study.file.accuracy.asked().tolerances["usable_range"]
    return [
        float(_could_be_reversed(deciding, all_answers.values(), required.camera, _tolerance(study, required), of_ends))
        for (deciding, all_answers), required in zip(answers, requirements, strict=True)
    ]


def _could_be_reversed(
    deciding: RequirementAnswer,
    answers: Collection[RequirementAnswer],
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
        return all(answer.could_be_overturned(of_value, of_ends) for answer in answers if answer.met is deciding.met)
    return any(answer.could_be_overturned(of_value, of_ends) for answer in answers)


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
    study: PreparedStudy, requirement_name: str, axis: SweepAxis, column: Sequence[_Answers], judge: Judge
) -> list[_Stretch]:
    """Intervals of one parameter in which a requirement is met, with ends located between designs.

    Where any camera may meet it, those of each camera by itself.
    """
    places = [float(label) for label in axis.labels]
    concerned = study.file.requirements[requirement_name].camera
    runs = [
        (camera, numbers)
        for camera in (column[0][1] if concerned == ANY else (concerned,))
        for is_met, numbers in _runs([_is_met_by(camera, answers) for answers in column])
        if is_met
    ]
    stretches = []
    # At an end of the sweep, the interval ends with the last design, since none beyond it was asked for.
    for camera, numbers in runs:
        first, last = numbers[0], numbers[-1]
        (low, low_error), (high, high_error) = (
            _root(study, requirement_name, axis, (places[end], places[neighbour]), camera, judge)
            if 0 <= neighbour < len(column)
            else (places[end], 0.0)
            for end, neighbour in ((first, first - 1), (last, last + 1))
        )
        stretches.append(
            _Stretch(met_from=low, met_to=high, met_to_within=max(low_error, high_error), met_camera=camera)
        )
    return stretches


def _runs(values: Sequence[bool]) -> list[tuple[bool, list[int]]]:
    """Equal neighbours together, with their indices."""
    return [(value, list(group)) for value, group in itertools.groupby(range(len(values)), key=lambda k: values[k])]


def _is_met_by(camera: str, answers: _Answers) -> bool:
    """Whether one camera, or all together if it is "all", meets a requirement."""
    deciding, by_camera = answers
    return by_camera.get(camera, deciding).met is True


def _root(
    study: PreparedStudy,
    requirement_name: str,
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
        requirement = changed.file.requirements[requirement_name]
        return _is_met_by(camera, judge.answer(requirement, changed.case))

    close = _ROOT_TO * study.file.accuracy.asked().tolerances["depth_uncertainty"]
    inside, outside = bracketed(*ends, holds, possible=varying.possible, close=close)
    return inside, 0.0 if varying.is_counted else abs(outside - inside) / 2.0

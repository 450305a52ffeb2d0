"""Checks of requirements: their criteria and depths of field must exist in the study, and cameras must have them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from tradestudy.cameras.declaration import AttributesPart
from tradestudy.declarations.part import MistakeAt, nearest_name
from tradestudy.study.schema.criteria import DERIVED, criterion_dimension, criterion_names
from tradestudy.study.schema.depth_of_field import DepthOfFieldPart
from tradestudy.study.schema.requirements import CriterionPart, RequirementPart, SharpPart
from tradestudy.units import UnitError, parse


def requirement_mistakes(
    requirements: Mapping[str, RequirementPart],
    attributes: Mapping[str, AttributesPart],
    *,
    focus: DepthOfFieldPart | None,
    relief: bool,
    measures_depth: bool,
) -> Iterator[MistakeAt]:
    """Requirements that cannot be tested on any camera of the study, each at the key at fault."""
    for key, one in requirements.items():
        place = ("requirements", key, one.quantity)
        if isinstance(one.required, CriterionPart):
            yield from _of_criterion(one.required, (*place,), attributes, relief=relief)
        elif isinstance(one.required, SharpPart):
            yield from _of_sharpness(one.required, (*place,), focus)
        elif one.asks_for_depth and not measures_depth:
            yield MistakeAt(place, "no camera of this study measures depth")


def criterion_mistake(name: str, attributes: Mapping[str, AttributesPart], *, relief: bool) -> str:
    """Why a criterion of this name cannot be compared with a number; empty if it can."""
    names = criterion_names(attributes.values(), relief=relief)
    if name in DERIVED and not relief:
        return f"{name!r} is derived for a relief; add relief and depth_of_field"
    if name not in names:
        declared = "" if names else "; no camera declares any (attributes: {others: {mass: 380 g}})"
        return f"no camera has a criterion {name!r}{nearest_name(name, names)}{declared}"
    if criterion_dimension(name, attributes.values()) is None:
        return f"{name!r} must be a number with the same kind of unit in all cameras that declare it"
    return ""


def bound_mistake(name: str, bound: str, attributes: Mapping[str, AttributesPart]) -> str:
    """Why a bound does not fit a criterion; empty if it does."""
    dimension = criterion_dimension(name, attributes.values())
    assert dimension is not None  # only valid criteria get here
    try:
        parse(bound, dimension)
    except UnitError as error:
        return str(error)
    return ""


def _of_criterion(
    required: CriterionPart, place: tuple[str, ...], attributes: Mapping[str, AttributesPart], *, relief: bool
) -> Iterator[MistakeAt]:
    if what := criterion_mistake(required.name, attributes, relief=relief):
        yield MistakeAt((*place, "name"), what)
    elif what := bound_mistake(required.name, required.bound, attributes):
        yield MistakeAt((*place, required.side), what)


def _of_sharpness(required: SharpPart, place: tuple[str, ...], focus: DepthOfFieldPart | None) -> Iterator[MistakeAt]:
    if focus is None:
        yield MistakeAt(place, "needs the section depth_of_field, whose criteria say what counts as sharp")
    elif required.criterion is not None and required.criterion not in focus.criteria:
        names = nearest_name(required.criterion, focus.criteria)
        yield MistakeAt((*place, "criterion"), f"depth_of_field has no criterion {required.criterion!r}{names}")

"""All pieces of a study that effects are chosen for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from tradestudy.effects.base import SlotName
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.situations.depth import depth_situations
from tradestudy.study.situations.depth_of_field import depth_of_field_situation
from tradestudy.study.situations.light_spot import light_spot_situation
from tradestudy.study.situations.point_spread import point_spread_situation
from tradestudy.study.situations.situation import Situation


def every_situation(definition: StudyDefinition, forced: Mapping[SlotName, str]) -> tuple[Situation, ...]:
    """In the order in which a run comes to them; costs are those of the reference machine.

    So the choice is the same on every machine.
    """
    return tuple(_situations(definition, forced))


def _situations(definition: StudyDefinition, forced: Mapping[SlotName, str]) -> Iterator[Situation]:
    file = definition.file
    if definition.case.cameras:
        yield from depth_situations(definition, forced)
    if file.depth_of_field is not None:
        yield depth_of_field_situation(definition, file.depth_of_field)
    if file.light_spot is not None:
        yield light_spot_situation(file.light_spot)
    if file.point_spread is not None:
        yield point_spread_situation(file.point_spread)

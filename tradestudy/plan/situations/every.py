"""All pieces of a study that effects are chosen for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from tradestudy.effects.base import SlotName
from tradestudy.plan.situations.situation import Situation
from tradestudy.study.definition import StudyDefinition


def every_situation(definition: StudyDefinition, forced: Mapping[SlotName, str]) -> tuple[Situation, ...]:
    """In the order in which a run comes to them; costs are those of the reference machine.

    So the choice is the same on every machine.
    """
    return tuple(_situations(definition, forced))


def _situations(definition: StudyDefinition, forced: Mapping[SlotName, str]) -> Iterator[Situation]:
    # Each kind is imported where it is asked for: a study file is checked with them, and few ask for light.
    file = definition.file
    if definition.case.cameras:
        from tradestudy.plan.situations.depth import depth_situations

        yield from depth_situations(definition, forced)
    if file.depth_of_field is not None:
        from tradestudy.plan.situations.depth_of_field import depth_of_field_situation

        yield depth_of_field_situation(definition, file.depth_of_field)
    if file.light_spot is not None:
        from tradestudy.plan.situations.light_spot import light_spot_situation

        yield light_spot_situation(file.light_spot)
    if file.point_spread is not None:
        from tradestudy.plan.situations.point_spread import point_spread_situation

        yield point_spread_situation(file.point_spread)

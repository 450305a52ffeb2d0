"""All pieces of a study that effects are chosen for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

from tradestudy.effects.base import SlotName
from tradestudy.effects.sharpness import diffraction_of_sharpness
from tradestudy.plan.situations.situation import Situation
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.schema.depth_of_field import DepthOfFieldPart

DEPTH_OF_FIELD: Final = "depth-of-field"


def depth_of_field_situation(definition: StudyDefinition, asked: DepthOfFieldPart) -> Situation:
    """Criteria that allow for diffraction, with it or without; both cost nothing, so that it stays unless forced."""
    cameras = definition.case.all_cameras.values()
    return Situation(
        name=DEPTH_OF_FIELD,
        title="Depth of field",
        quantities=("depth_of_field",),
        slots=(
            diffraction_of_sharpness(
                [camera.focus for camera in cameras],
                [part.criterion(definition.case.wavelength) for part in asked.criteria.values()],
            ),
        ),
    )


def every_situation(definition: StudyDefinition, forced: Mapping[SlotName, str]) -> Iterator[Situation]:
    """In the order in which a run comes to them; costs are those of the reference machine.

    So the choice is the same on every machine.
    """
    # Imported where they are asked for: a study file is checked with them, and few ask for light.
    file = definition.file
    if definition.case.cameras:
        from tradestudy.plan.situations.depth import depth_situations

        yield from depth_situations(definition, forced)
    if file.depth_of_field is not None:
        yield depth_of_field_situation(definition, file.depth_of_field)
    if file.light_spot is not None:
        from tradestudy.plan.situations.light_spot import light_spot_situation

        yield light_spot_situation(file.light_spot)
    if file.point_spread is not None:
        from tradestudy.plan.situations.point_spread import point_spread_situation

        yield point_spread_situation(file.point_spread)

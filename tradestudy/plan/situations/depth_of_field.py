"""What every camera keeps in focus: whether the diffraction spot counts in what is sharp."""

from __future__ import annotations

from typing import Final

from tradestudy.effects.sharpness import diffraction_of_sharpness
from tradestudy.plan.situations.situation import Situation
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.schema.depth_of_field import DepthOfFieldPart

NAME: Final = "depth-of-field"


def depth_of_field_situation(definition: StudyDefinition, asked: DepthOfFieldPart) -> Situation:
    """Criteria that allow for diffraction, with it or without; both cost nothing, so that it stays unless forced."""
    cameras = definition.case.all_cameras.values()
    return Situation(
        name=NAME,
        title="Depth of field",
        quantities=("depth_of_field",),
        slots=(
            diffraction_of_sharpness(
                [camera.focus for camera in cameras],
                [part.criterion(definition.case.wavelength) for part in asked.sharp.values()],
            ),
        ),
    )

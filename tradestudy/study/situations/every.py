"""All pieces of a study that effects are chosen for."""

from __future__ import annotations

from tradestudy.study.definition import StudyDefinition
from tradestudy.study.situations.depth import depth_situations
from tradestudy.study.situations.situation import Situation


def every_situation(definition: StudyDefinition, *, speed: float) -> tuple[Situation, ...]:
    """Cameras that measure depth, one after the other; costs are for a machine of this speed."""
    return depth_situations(definition, speed=speed) if definition.case.cameras else ()

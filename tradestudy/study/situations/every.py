"""All pieces of a study that effects are chosen for."""

from __future__ import annotations

from tradestudy.study.definition import StudyDefinition
from tradestudy.study.situations.depth import depth_situations
from tradestudy.study.situations.situation import Situation


def every_situation(definition: StudyDefinition) -> tuple[Situation, ...]:
    """Cameras that measure depth, one after the other; costs are those of the reference machine.

    So the choice is the same on every machine.
    """
    return depth_situations(definition) if definition.case.cameras else ()

"""Calibrations by targets for the values that a question tries: planned for each, not sampled as in the run."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from tradestudy.study.definition import StudyDefinition
from tradestudy.study.varying import Varying

PLANS: Final = range(8)
"""The arrangements of the views from which the scatter of an answer is estimated; the first is that of the run."""


def planned(definition: StudyDefinition, plan: int = 0) -> StudyDefinition:
    """The study with the calibrations expected from its targets, where none has been inferred yet.

    Raises
    ------
    TradestudyError
        A target is seen in too few views.
    """
    asked = definition.calibrations_to_infer()
    if not asked:
        return definition
    from tradestudy.calibration.camera_target import TargetToInfer, planned_calibration

    return definition.with_posteriors(
        {key: planned_calibration(one, plan) for key, one in asked.items() if isinstance(one, TargetToInfer)}
    )


def to_be_planned(definition: StudyDefinition, varying: Varying) -> StudyDefinition:
    """The study without calibrations inferred from targets that a question varies, to make its values comparable."""
    varied = varied_calibrations(definition, varying)
    kept = {key: posterior for key, posterior in definition.posteriors.items() if key not in varied}
    return replace(definition, posteriors=kept, before=definition)


def varied_calibrations(definition: StudyDefinition, varying: Varying) -> set[str]:
    """Keys of the inferred calibrations that a question varies."""
    keys = definition.posterior_keys
    ends = [definition.with_values(varying.changes(end)).posterior_keys for end in (varying.low, varying.high)]
    return {keys[name] for name in keys if any(end.get(name) != keys[name] for end in ends)}


def plans(definition: StudyDefinition) -> range:
    """The arrangements of the views to try: only the first if nothing needs planning or every pose is given."""
    from tradestudy.calibration.camera_target import TargetToInfer

    asked = definition.calibrations_to_infer().values()
    is_spread = any(isinstance(one, TargetToInfer) and one.part.poses is None for one in asked)
    return PLANS if is_spread else PLANS[:1]

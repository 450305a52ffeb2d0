"""All groups that a study's calibration part asks for."""

from __future__ import annotations

import xarray as xr

from tradestudy.calibration.declaration import CalibrationStudyPart
from tradestudy.execution import Steps
from tradestudy.run.groups.calibration import calibration_group
from tradestudy.run.groups.sensitivity import sensitivity_group
from tradestudy.run.groups.uncertain_decision import uncertain_decision
from tradestudy.study.definition import StudyDefinition


def uncertain_groups(
    definition: StudyDefinition, part: CalibrationStudyPart, decision: xr.Dataset, steps: Steps
) -> dict[str, xr.Dataset]:
    """/calibration, /sensitivity, and /decision with what calibration errors add to it."""
    uncertain = definition.uncertain_cameras(part, steps)
    added = uncertain_decision(uncertain, part, steps.progress)
    return {
        "/calibration": calibration_group(uncertain, part, steps),
        "/sensitivity": sensitivity_group(list(uncertain.cameras.values()), part, steps),
        "/decision": decision if added is None else decision.merge(added),
    }

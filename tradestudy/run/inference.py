"""Infer the calibrations that a study needs before it can predict depth."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from tradestudy.errors import Problem, StudyError, TradestudyError
from tradestudy.execution import Steps
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.varying import calibrations_to_infer

if TYPE_CHECKING:
    from tradestudy.calibration.corners.rig_measurement import GeometryContradictionError
    from tradestudy.calibration.posteriors import InferredCalibration


def infer_calibrations(
    definition: StudyDefinition, steps: Steps
) -> tuple[StudyDefinition, Mapping[str, InferredCalibration]]:
    """Infer every calibration from a target or corners, for the study, its readings and the designs of its sweep.

    Returns
    -------
    StudyDefinition
        The study, with the inferred calibrations of its cameras.
    mapping of str to InferredCalibration
        Calibrations of the study as declared, by camera.

    Raises
    ------
    TradestudyError
        A calibration cannot be inferred, or contradicts the declared geometry.
    """
    asked = calibrations_to_infer(definition)
    if not asked:
        return definition, {}
    from tradestudy.calibration.corners.rig_measurement import GeometryContradictionError
    from tradestudy.calibration.posteriors import infer

    names = [one.name for one in asked.values()]
    try:
        found = dict(zip(asked, steps.map("calibration", infer, list(asked.values()), names), strict=True))
    except GeometryContradictionError as error:
        raise StudyError(_located(definition, error)) from None
    known = definition.with_posteriors({key: one.calibration for key, one in found.items()})
    return known, {one.name: found[key] for key, one in definition.calibrations_to_infer().items()}


def refuse_corners(definition: StudyDefinition) -> None:
    """Refuse corners, of the study as declared and of its readings, that a run would refuse after their fit.

    Raises
    ------
    StudyError
        No rig fits the corners, or they contradict the declared geometry.
    """
    forms = [definition, *definition.readings.values()]
    asked = {key: request for form in forms for key, request in form.calibrations_to_infer().items()}
    if not asked:
        return
    from tradestudy.calibration.corners.rig_measurement import GeometryContradictionError
    from tradestudy.calibration.posteriors import CornersToInfer, check_corners

    problems = []
    for request in asked.values():
        try:
            if isinstance(request, CornersToInfer):
                check_corners(request)
        except GeometryContradictionError as error:
            problems += _located(definition, error)
        except TradestudyError as error:
            path = ("cameras", request.name, "calibration", "corners")
            problems.append(definition.document.locate(path).problem(path, str(error)))
    if problems:
        raise StudyError(problems)


def _located(definition: StudyDefinition, error: GeometryContradictionError) -> list[Problem]:
    """Every contradiction between corners and geometry, located at the calibration key of its camera."""
    found = []
    for line in str(error).splitlines():
        name = next(name for name in definition.file.cameras if f"cameras.{name}." in line)
        path = ("cameras", name, "calibration", "corners")
        found.append(definition.document.locate(path).problem(path, line))
    return found

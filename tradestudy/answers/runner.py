"""Compute the results tree of a planned study."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from tradestudy.answers.budget import budget_group
from tradestudy.answers.calibration import infer_calibrations
from tradestudy.answers.claims import claims_group
from tradestudy.answers.datasheet import datasheet_group
from tradestudy.answers.decision import decision_group
from tradestudy.answers.depth import DepthTables, depth_at_places_group, depth_field_group, depth_group, depth_tables
from tradestudy.answers.depth_map import depth_map_group
from tradestudy.answers.designs import design_verdicts
from tradestudy.answers.disparity_causes import compute_kirchhoff_pictures, disparity_causes_group
from tradestudy.answers.questions import questions_group
from tradestudy.answers.ranks import ranks_group
from tradestudy.answers.registers import assumptions_group, cameras_group, contradictions_group, effects_group
from tradestudy.answers.requirement_verdicts import requirements_group
from tradestudy.answers.requirements import Judge
from tradestudy.execution import Steps
from tradestudy.execution.steps import Seconds
from tradestudy.models.plan import Plan
from tradestudy.results import FORMAT_VERSION, UNCONVERGED
from tradestudy.study.prepared import PreparedStudy
from tradestudy.study.varying import sweep_axes, sweep_points

NOMINAL = "as declared"


def compute(
    plan: Plan,
    steps: Steps | None = None,
    seconds: Seconds | None = None,
    pictures: Path | None = None,
) -> xr.DataTree:
    """Compute everything that a study asks for.

    Parameters
    ----------
    plan
        The study, and the models chosen for it.
    steps
        How independent points are computed: on which workers, with which checkpoints and progress.
    seconds
        Receives the time that each timed part took.
    pictures
        Folder for the pictures of the study's scene; None keeps only their reduced form in the results.

    Returns
    -------
    xarray.DataTree
        Groups and variables as defined in `tradestudy.results`.
    """
    steps = Steps() if steps is None else steps
    study, inferred, failed = infer_calibrations(plan.study, steps)
    run = _Run(
        study=study,
        designs=sweep_points(study, sweep_axes(study)),
        readings={NOMINAL: study, **study.readings},
        steps=steps,
        seconds={} if seconds is None else seconds,
        pictures=pictures,
    )
    groups: dict[str, xr.Dataset] = {
        "/": _root(study).assign_attrs({UNCONVERGED: failed} if failed else {}),
        "/cameras": cameras_group(study),
        "/assumptions": assumptions_group(study),
        "/contradictions": contradictions_group(study),
    }
    if inferred:
        from tradestudy.answers.calibration import calibration_group

        groups["/calibration"] = calibration_group(inferred)
    if plan.problems:
        groups["/effects"] = effects_group(plan)
    tables: DepthTables = {}
    if study.case.cameras:
        compute_kirchhoff_pictures(study, steps.progress)
        tables = depth_tables(study, run.designs, steps)
        groups |= _depth_groups(run, tables)
    groups |= _groups_of_few(run)
    groups |= _answers(run, tables, groups.get("/criteria"))
    if study.file.solve:
        decided = [groups["/decision"]] if "/decision" in groups else []
        solved = questions_group(study, steps.progress)
        groups["/decision"] = xr.merge([*decided, solved], combine_attrs="drop_conflicts")
    return xr.DataTree.from_dict(groups)


@dataclass(frozen=True, kw_only=True)
class _Run:
    """The study being computed, its designs and readings, and how to compute it."""

    study: PreparedStudy
    designs: Sequence[PreparedStudy]
    readings: Mapping[str, PreparedStudy]
    steps: Steps
    seconds: Seconds
    pictures: Path | None


def _root(study: PreparedStudy) -> xr.Dataset:
    file = study.file
    attributes = {"format_version": FORMAT_VERSION, "study": file.study, "title": file.title, "question": file.question}
    return xr.Dataset(attrs=attributes | ({} if file.scene is None else {"wavelength": file.scene.wavelength}))


def _depth_groups(run: _Run, tables: DepthTables) -> dict[str, xr.Dataset]:
    """Groups about the cameras that measure depth, and which of them is best."""
    study, steps, file = run.study, run.steps, run.study.file
    groups = {"/depth": depth_group(study, run.designs, tables)}
    if file.propagation.field_places:
        groups["/depth_field"] = depth_field_group(study, file.propagation.field_places, steps)
    steps.progress("decision", 0.0)
    if (mapped := depth_map_group(study)) is not None:
        groups["/depth_map"] = mapped
    if file.decision is not None:
        groups["/depth_at_places"] = depth_at_places_group(study, file.decision.at)
    if file.decision is not None or not file.sweep:
        groups["/budget"] = budget_group(study, groups.get("/depth_at_places", groups["/depth"]))
    if (causes := disparity_causes_group(study)) is not None:
        groups["/disparity_causes"] = causes
    groups["/datasheet"] = datasheet_group(study)
    decided = [decision_group(study, run.readings, steps.progress)]
    if file.sweep:
        decided.append(design_verdicts(study, run.designs, tables))
    steps.progress("decision", 1.0)
    if file.decision is not None:
        decided.append(ranks_group(study, steps))
    groups["/decision"] = xr.merge(decided, combine_attrs="drop_conflicts")
    return groups


def _groups_of_few(run: _Run) -> dict[str, xr.Dataset]:
    """Groups that few studies ask for; their modules are imported on demand."""
    study, file, models = run.study, run.study.file, run.study.choices.models
    progress, seconds = run.steps.progress, run.seconds
    groups: dict[str, xr.Dataset] = {}
    if file.value_of_information is not None:
        from tradestudy.answers.value_of_information import value_of_information_group

        groups["/value_of_information"] = value_of_information_group(study, file.value_of_information, progress)
    if file.scene is not None and file.scene.image is not None:
        from tradestudy.answers.scene import pictures_group, take_scene

        depth = file.scene.image.depth_maps
        taken = take_scene(study, run.pictures, run.steps, depth=depth)
        groups["/pictures"] = pictures_group(taken)
    if file.depth_loop is not None:
        from tradestudy.answers.depth_loop import depth_loop_group

        groups["/depth_loop"] = depth_loop_group(study, file.depth_loop, run.steps)
    if file.sensitivity is not None:
        from tradestudy.answers.sensitivity import sensitivity_group

        groups["/sensitivity"] = sensitivity_group(study, np.array(file.sensitivity.at), run.steps)
    if file.measurements:
        from tradestudy.answers.measured import measurements_group

        groups["/measurements"] = measurements_group(study)
    if file.depth_of_field is not None:
        from tradestudy.answers.depth_of_field import criteria_group, depth_of_field_group

        progress("depth of field", 0.0)
        groups["/depth_of_field"] = depth_of_field_group(study, file.depth_of_field)
        if file.relief is not None:
            groups["/criteria"] = criteria_group(study)
        progress("depth of field", 1.0)
    if file.refocusing is not None:
        from tradestudy.answers.refocusing import refocusing_group

        groups["/refocusing"] = refocusing_group(study, run.designs, file.refocusing)
    if file.fresnel_validity is not None:
        from tradestudy.answers.fresnel_validity import fresnel_validity_group

        groups["/fresnel_validity"] = fresnel_validity_group(file.fresnel_validity, run.steps, seconds)
    if file.light_spot is not None:
        from tradestudy.answers.light import images_group
        from tradestudy.models import light_spot

        groups["/images"] = images_group(file.light_spot, run.steps, seconds, models[light_spot.NAME])
    if file.point_spread is not None:
        from tradestudy.answers.light import point_spread_group
        from tradestudy.models import sharpness as point_spread

        laws = models[point_spread.NAME]
        groups["/point_spread"] = point_spread_group(file.point_spread, run.steps, seconds, laws)
    if file.hard_cases is not None:
        from tradestudy.answers.hard_cases import hard_cases_group

        groups["/hard_cases"] = hard_cases_group(file.hard_cases, progress)
    return groups


def _answers(run: _Run, tables: DepthTables, criteria: xr.Dataset | None) -> dict[str, xr.Dataset]:
    """Claims, requirements and the trade-off, whose criteria join those derived for a relief."""
    study, file, progress = run.study, run.study.file, run.steps.progress
    groups: dict[str, xr.Dataset] = {}
    if file.claims or file.requirements:
        progress("claims", 0.0)
    if file.claims:
        groups["/claims"] = claims_group(study, run.readings, progress)
    judge = Judge({key: table.intervals for key, table in tables.items()})
    if file.requirements:
        groups["/requirements"] = requirements_group(study, run.designs, judge, run.steps)
    if file.claims or file.requirements:
        progress("claims", 1.0)
    if file.trade_off is not None:
        from tradestudy.answers.trade_off import trade_off_group

        weighed = trade_off_group(study, run.designs, judge, progress)
        merged = [weighed] if criteria is None else [criteria, weighed]
        groups["/criteria"] = xr.merge(merged, combine_attrs="drop_conflicts")
    return groups

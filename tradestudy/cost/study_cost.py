"""Measure the cost of accuracy for every problem of a study that has more than one set of models."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Iterator
from datetime import UTC, datetime

import xarray as xr

from tradestudy import machine, provenance
from tradestudy.cost import DEFAULT_BUDGET
from tradestudy.cost.depth import Offered, depth_problem
from tradestudy.cost.measuring import CostProblem, Measured, measure, next_digit, on_frontier
from tradestudy.cost.spot import spot_problem
from tradestudy.effects.models import Models, SlotName, models_of
from tradestudy.errors import OutOfRangeError
from tradestudy.execution import Steps
from tradestudy.imaging.picture import PictureDisparityError
from tradestudy.plan.plan import Plan
from tradestudy.plan.problems import light_spot
from tradestudy.results import dataset
from tradestudy.run.inference import infer_calibrations
from tradestudy.study.definition import StudyDefinition
from tradestudy.wording import json_text


def require_prices(definition: StudyDefinition) -> None:
    """Refuse a study without a choice of models.

    Raises
    ------
    OutOfRangeError
        If it has no light spot and no camera with calibration errors or a derived disparity error.
    """
    cameras = definition.case.cameras.values()
    calibrated = any(camera.calibration.groups or not camera.calibration.inferred for camera in cameras)
    pictured = any(isinstance(camera.disparity_error_px, PictureDisparityError) for camera in cameras)
    if not calibrated and not pictured and definition.file.light_spot is None:
        raise OutOfRangeError(
            "there is only one way to compute every answer of this study, so there are no costs to compare",
            value=definition.file.study,
            limit="cameras with calibration errors or derived disparity errors, or a light spot",
            remedy="measure the cost of another study",
        )


def study_cost(plan: Plan, steps: Steps | None = None, *, budget: float = DEFAULT_BUDGET) -> xr.Dataset:
    """Measure error against time for the sets of models that can solve each problem of a study.

    Parameters
    ----------
    plan
        The study with its chosen models.
    steps
        What infers calibrations that are not known yet, and reports progress; None infers them in this process.
    budget
        Wall time for all measurements [s]. What does not fit is left out and listed. Inference takes extra time.

    Returns
    -------
    xarray.Dataset
        ``/cost``, with machine and date in its attributes.

    Raises
    ------
    OutOfRangeError
        If the budget is not positive and finite, or the study has no choice of models.
    """
    if not 0.0 < budget < math.inf:
        raise OutOfRangeError(
            "budget of the measurements",
            value=f"{budget:g} s",
            limit="> 0 s, finite",
            remedy="give it in seconds, such as 120",
        )
    require_prices(plan.definition)
    steps = Steps() if steps is None else steps
    definition, _ = infer_calibrations(plan.definition, steps)
    problems = list(_problems(plan, definition))
    found: list[Measured] = []
    end = time.perf_counter() + budget
    for number, problem in enumerate(problems):
        steps.progress("cost", number / len(problems))
        # Time that one problem does not use goes to those after it.
        found.append(measure(problem, (end - time.perf_counter()) / (len(problems) - number)))
    steps.progress("cost", 1.0)
    return _dataset(found, budget)


def cost_json(study: str, study_hash: str, cost: xr.Dataset) -> str:
    """A cost as JSON: the name and hash of its study, its attributes, and a row for every problem and every entry."""
    tables = {"problems": cost.drop_dims("entry").to_dataframe().reset_index()}
    tables["entries"] = cost.drop_dims("problem").to_dataframe()
    rows = {name: json.loads(one.to_json(orient="records", double_precision=15)) for name, one in tables.items()}
    return json_text({"study": study, "study_hash": study_hash, **cost.attrs, **rows}) + "\n"


def _problems(plan: Plan, definition: StudyDefinition) -> Iterator[CostProblem]:
    for name in definition.case.cameras:
        chosen, offered = _models(plan, name)
        problem = depth_problem(definition.case, name, definition.file.cameras[name].title, chosen, offered)
        if problem is not None:
            yield problem
    if (part := definition.file.light_spot) is not None:
        yield spot_problem(part, light_spot.NAME, light_spot.spot_models(plan.models(light_spot.NAME)))


def _models(plan: Plan, name: str) -> tuple[Models, Offered]:
    """The models applied to a problem, and those available."""
    (problem,) = (one for one in plan.problems if one.name == name)
    offered: dict[SlotName, tuple[str, ...]] = {}
    for decision in problem.choice.decisions:
        named = models_of(decision.slot, "depth") if decision.forced else (decision.model,)
        offered[decision.slot] = (*offered.get(decision.slot, ()), *named)
    return problem.models, offered


def _dataset(found: list[Measured], budget: float) -> xr.Dataset:
    entries = [(one, entry) for one in found for entry in one.entries]
    values = {
        "problem_of": [one.problem.name for one, _ in entries],
        "models": [entry.models for _, entry in entries],
        "relative_error": [entry.error for _, entry in entries],
        "seconds": [entry.seconds for _, entry in entries],
        "chosen": [entry.chosen for _, entry in entries],
        "frontier": [bool(on) for one in found for on in on_frontier(one.entries)],
        "next_digit": [entry is next_digit(one.entries) for one, entry in entries],
        "title": [one.problem.title for one in found],
        "reference": [one.reference for one in found],
        "reference_error": [one.reference_error for one in found],
        "left_out": ["\n".join(one.left_out) for one in found],
    }
    return dataset(
        "cost",
        values,
        {"problem": [one.problem.name for one in found]},
        attributes={
            "machine": json.dumps(machine.identity(), sort_keys=True),
            "measured": datetime.now(UTC).isoformat(timespec="seconds"),
            "budget": budget,
            "code_hash": provenance.code_hash(),
        },
    )

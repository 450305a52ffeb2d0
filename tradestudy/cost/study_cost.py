"""All that a study asks for and that can be had at more than one price, measured within a given time."""

from __future__ import annotations

import json
import math
import os
import time
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime
from functools import partial
from typing import Any, Final

import numpy as np
import xarray as xr

from tradestudy import machine, provenance
from tradestudy.calibration.posteriors import TargetToInfer
from tradestudy.cost.defaults import DEFAULT_BUDGET, FEWEST_REPEATS
from tradestudy.cost.depth import depth_cost
from tradestudy.cost.depth_of_field import depth_of_field_cost
from tradestudy.cost.entries import (
    DIGITS,
    NOWHERE_USABLE,
    CostTable,
    Entry,
    a_tenth_of_what_is_asked,
    cheapest_within,
    most_accurate,
    next_digit,
    on_frontier,
)
from tradestudy.cost.measuring import Allowance, Pace
from tradestudy.cost.picture import picture_cost
from tradestudy.cost.point_spread import point_spread_cost
from tradestudy.cost.posterior import posterior_cost
from tradestudy.cost.spot import point_cost, spot_cost
from tradestudy.errors import OutOfRangeError
from tradestudy.execution import Steps
from tradestudy.execution.steps import Progress
from tradestudy.imaging.derived_error import PictureDisparityError
from tradestudy.plan.plan import Plan, plan_of
from tradestudy.plan.situations import light_spot, point_spread
from tradestudy.plan.situations.every import DEPTH_OF_FIELD
from tradestudy.plan.situations.light_spot import spot_models
from tradestudy.results import dataset
from tradestudy.run.inference import infer_calibrations
from tradestudy.study.definition import StudyDefinition

_ENTRY_FIELDS: Final = {
    "model": "model",
    "setting": "setting",
    "evaluations": "evaluations",
    "relative_error": "error",
    "typical_error": "typical_error",
    "seconds": "seconds",
    "least_seconds": "least_seconds",
    "peak_memory": "peak_memory",
    "repeats": "repeats",
    "chosen": "chosen",
}


def study_cost(
    definition: StudyDefinition,
    *,
    repeats: int = FEWEST_REPEATS,
    budget: float = DEFAULT_BUDGET,
    progress: Progress = lambda _step, _share: None,
) -> xr.Dataset:
    """Measure error against seconds for every model and setting that can answer a quantity of a study.

    Parameters
    ----------
    definition
        The study as declared.
    repeats
        How often each computation is timed, 3 or more; quick ones oftener, those of 5 s and more once, in the run that
        traces their memory, and others only as often as the time allows.
    budget
        Wall time for everything [s], within the error of what is predicted; starting up, and calibrations that have to
        be inferred first, come on top. Every quantity shares its part between its reference and what is held against
        it; what does not fit is left out and named.
    progress
        Called with the step and the share done.

    Returns
    -------
    xarray.Dataset
        ``/cost``; machine, date and load stand in its attributes.

    Raises
    ------
    OutOfRangeError
        For fewer than three repeats, a budget that is no time, or a study without anything to measure.
    UnaffordableError, StudyError
        Where a run of the study would be refused; see `plan_of`.
    """
    if repeats < FEWEST_REPEATS:
        raise OutOfRangeError("repeats of a measurement", value=str(repeats), limit=f">= {FEWEST_REPEATS}")
    if not 0.0 < budget < math.inf:
        raise OutOfRangeError(
            "time for measuring",
            value=f"{budget:g} s",
            limit="> 0 s, finite",
            remedy="give the seconds that measuring may take, such as 600",
        )
    progress("cost: models of the study", 0.0)
    questions = list(_questions(definition, plan_of(definition), progress))
    allowance = Allowance(seconds=budget, repeats=repeats)
    # What one question leaves of its share goes to those after it.
    found = [question(allowance.share(1.0 / (len(questions) - number))) for number, question in enumerate(questions)]
    if found and all(one.left_out == (NOWHERE_USABLE,) for one in found):
        raise OutOfRangeError(
            "none of the cameras is usable at any distance of the study, so that there is nothing whose cost could be "
            "measured",
            value=", ".join(definition.case.cameras),
            remedy="ask for other distances, or loosen a condition of what is usable",
        )
    if not found:
        raise OutOfRangeError(
            "this study asks for nothing that has more than one price",
            value=definition.file.study,
            limit="depth, depth of field, calibration, a light spot or point-spread functions",
        )
    return _dataset(found, budget=budget)


def _questions(declared: StudyDefinition, plan: Plan, progress: Progress) -> Iterator[Callable[[Allowance], CostTable]]:
    """What the study asks for, the quickest first, so that the dear ones get what is left."""
    file, to_infer = declared.file, plan.definition.calibrations_to_infer()
    begin = time.perf_counter()
    definition, _ = infer_calibrations(plan.definition, Steps(progress=progress))
    inferring = time.perf_counter() - begin
    declared = declared.with_posteriors(definition.posteriors)
    if (asked := file.depth_of_field) is not None:
        sharpness = plan.selections[DEPTH_OF_FIELD]
        yield lambda allowance: depth_of_field_cost(definition, asked, sharpness, allowance, progress)
    if (spread := file.point_spread) is not None:
        law = plan.selections[point_spread.NAME].name_of("main_lens_diffraction")
        yield lambda allowance: point_spread_cost(spread, law, allowance, progress)
    if definition.case.cameras:
        yield lambda allowance: depth_cost(definition, allowance, progress)
        laws = {name: camera.disparity_error_px for name, camera in declared.case.cameras.items()}
        derived = [one for one in plan.situations if isinstance(laws.get(one.name), PictureDisparityError)]
        for number, situation in enumerate(derived, start=1):
            selection, name = plan.selections[situation.name], f"picture_{number}"
            yield partial(picture_cost, declared, situation, selection, progress=progress, name=name)
    # One stands for all: each is a posterior of a dozen parameters and takes as long.
    if shown := [one for one in to_infer.values() if isinstance(one, TargetToInfer)]:
        name, each = shown[0].name, inferring / len(definition.posteriors)
        yield partial(
            posterior_cost,
            shown[0],
            definition.case.cameras[name],
            file.cameras[name].title,
            definition.case.distance,
            progress=progress,
            inferring=each,
        )
    if (spot := file.light_spot) is not None:
        speed, pace = machine.machine_speed(), Pace()
        if not spot.spot.coherent:  # one wave has no points of its own
            yield lambda allowance: point_cost(spot, allowance, progress, speed=speed, pace=pace)
        if not spot.spot.is_point:
            chosen = spot_models(plan.selections[light_spot.NAME])
            pixels_to = file.accuracy.wanted().relative["pixel_intensity"]
            yield lambda allowance: spot_cost(
                spot, chosen, allowance, progress, speed=speed, asked=pixels_to, pace=pace.for_others()
            )


def _dataset(found: list[CostTable], *, budget: float) -> xr.Dataset:
    entries = [(measured, entry) for measured in found for entry in measured.entries]
    frontier = [
        on_frontier([e.error for e in one.entries], [e.seconds for e in one.entries], one.reference_error)
        for one in found
        if one.entries
    ]
    digits = [next_digit(measured) for measured in found]
    within = [cheapest_within(measured, error) for measured in found for error in DIGITS]
    values: dict[str, Any] = {
        "quantity": [measured.name for measured, _ in entries],
        **{name: [getattr(entry, own) for _, entry in entries] for name, own in _ENTRY_FIELDS.items()},
        "frontier": np.concatenate(frontier) if frontier else np.zeros(0, dtype=bool),
        "title": [measured.title for measured in found],
        "says": [measured.says for measured in found],
        "reference": [measured.reference for measured in found],
        "reference_error": [measured.reference_error for measured in found],
        "reference_seconds": [measured.reference_seconds for measured in found],
        "left_out": ["\n".join(measured.left_out) for measured in found],
        "notes": ["\n".join(measured.notes) for measured in found],
        **_told("chosen", [None if digit is None else digit.own for digit in digits]),
        "next_wanted": [math.nan if digit is None else digit.wanted for digit in digits],
        **_told("next", [None if digit is None else digit.found for digit in digits]),
        **_told("quicker", [None if digit is None else digit.quicker for digit in digits]),
        **_told("best", [most_accurate(measured) for measured in found]),
        "asked_error": [measured.asked for measured in found],
        **_told("asked_tenth", [a_tenth_of_what_is_asked(measured) for measured in found]),
        **{name: np.reshape(of, (len(found), len(DIGITS))) for name, of in _told("digit", within).items()},
    }
    return dataset(
        "cost",
        values,
        {"cost_quantity": [measured.name for measured in found], "digit": list(DIGITS)},
        attributes={
            "machine": json.dumps(machine.identity(), sort_keys=True),
            "measured": datetime.now(UTC).isoformat(timespec="seconds"),
            "load_average": round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else math.nan,
            "budget": budget,
            "code_hash": provenance.code_hash(),
            "ways": json.dumps({measured.name: dict(measured.ways) for measured in found}),
            "not_of_a_run": json.dumps([measured.name for measured in found if not measured.of_a_run]),
        },
    )


def _told(name: str, entries: Sequence[Entry | None]) -> dict[str, list[Any]]:
    """Words, error and seconds of entries, as the results hold them."""
    return {
        f"{name}_entry": ["" if entry is None else entry.words for entry in entries],
        f"{name}_error": [math.nan if entry is None else entry.error for entry in entries],
        f"{name}_seconds": [math.nan if entry is None else entry.seconds for entry in entries],
    }

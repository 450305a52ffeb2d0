"""Measure the cost of accuracy for every problem of a study that has more than one set of models."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from typing import Final

import numpy as np
import xarray as xr
from scipy.special import stdtrit

from tradestudy import machine, provenance
from tradestudy.answers.calibration import infer_calibrations
from tradestudy.answers.cost_measuring import (
    Candidate,
    CostProblem,
    Measured,
    Reference,
    measure,
    next_digit,
    on_frontier,
)
from tradestudy.cameras.depth_camera import DepthCamera, disparity_error_at, numerical_error_of_disparity_error
from tradestudy.depth.draws import SCRAMBLES
from tradestudy.depth.evaluation import distribution, judged_at, variance_shares
from tradestudy.depth.linear import has_covariance
from tradestudy.depth.usable import all_met, evaluate_limits
from tradestudy.effects import LENSES, MODEL, OFF, Models, SlotName, models_of
from tradestudy.errors import OutOfRangeError
from tradestudy.execution import Steps
from tradestudy.imaging.picture import PictureDisparityError
from tradestudy.light_methods import short_title
from tradestudy.models import DEFAULT_BUDGET, light_spot
from tradestudy.models.plan import Plan
from tradestudy.models.spot_images import RAYS, SpotModels, compared_models, picture_of
from tradestudy.optics.arrays import FloatArray
from tradestudy.results import dataset
from tradestudy.study.prepared import Case, PreparedStudy, apply_models
from tradestudy.study.schema.wave_optics import LightSpotPart
from tradestudy.units import FRACTION, pretty
from tradestudy.wording import json_text, listed

Offered = Mapping[SlotName, tuple[str, ...]]
"""The models of every effect in a problem, from the cheapest to the most complete."""

_MOST_PLACES: Final = 9
_TIGHTER: Final = (1.0, 0.3, 0.1, 0.03)  # tolerances of the draws, relative to that of the study
# Numbers of draws of references, and growth of their computing time.
_DRAWS: Final = ((2**13, 1.0), (2**16, 8.0), (2**20, 16.0))
_FEWEST: Final = 2  # candidates needed for a choice


def depth_problem(case: Case, name: str, title: str, chosen: Models, offered: Offered) -> CostProblem | None:
    """Candidates for the depth uncertainty of a camera at up to nine distances where it is usable.

    They are the chosen models with every way to propagate the calibration, the chosen models with every law of
    diffraction, and the most complete models at ever tighter tolerances.

    Parameters
    ----------
    case
        The study's case, with known calibrations and the chosen models applied.
    name, title
        Name and title of the camera.
    chosen, offered
        The models applied to it, and those available.

    Returns
    -------
    CostProblem or None
        None if there is only one way to compute the camera's depth uncertainty.
    """
    declared, taken = case.all_cameras[name], case.cameras[name]
    assert isinstance(declared, DepthCamera)  # the study requests its depth
    sets: dict[DepthCamera, str] = {}
    for models, tighter in _sets(declared, chosen, offered):
        camera = apply_models(declared, models)
        tolerance = tighter * camera.propagation.tolerance
        camera = replace(camera, propagation=replace(camera.propagation, tolerance=tolerance))
        # Different sets of models can make equal cameras, which are measured once.
        sets.setdefault(camera, _words(models, offered, tolerance))
    if len(sets) < _FEWEST:
        return None
    places = _usable_places(case, taken)
    if not places.size:
        return CostProblem(name=name, title=title, difference=_worst, left_out=("usable at no distance of the study",))
    complete = apply_models(declared, _complete(declared, offered))
    return CostProblem(
        name=name,
        title=title,
        difference=_worst,
        candidates=tuple(
            Candidate(models=words, compute=partial(judged_at, camera, places), chosen=camera == taken)
            for camera, words in sets.items()
        ),
        references=tuple(_references(complete, places)),
    )


def _propagations(camera: DepthCamera, offered: Offered) -> tuple[str, ...]:
    """The models that propagate a camera's calibration errors; noise alone where it has none."""
    if not camera.calibration.groups:
        return (OFF,)
    return tuple(model for model in offered["calibration"] if model != "linear" or has_covariance(camera))


def _complete(camera: DepthCamera, offered: Offered) -> Models:
    return {**{slot: models[-1] for slot, models in offered.items()}, "calibration": _propagations(camera, offered)[-1]}


def _sets(camera: DepthCamera, chosen: Models, offered: Offered) -> Iterator[tuple[Models, float]]:
    """Sets of models, with the tolerance of their draws relative to that of the study."""
    complete = _complete(camera, offered)
    for propagation in _propagations(camera, offered):
        yield {**chosen, "calibration": propagation}, 1.0
    for law in offered.get(LENSES[0], ()):
        lenses: Models = {lens: law for lens in LENSES if law in offered.get(lens, ())}
        yield {**chosen, **lenses}, 1.0
    yield {**complete, "calibration": chosen["calibration"]}, 1.0
    for tighter in _TIGHTER if complete["calibration"] == "exact" else (1.0,):
        yield complete, tighter


def _words(models: Models, offered: Offered, tolerance: float) -> str:
    """A set of models in words that distinguish it from the others."""
    propagation = MODEL["calibration", models["calibration"]]
    if models["calibration"] == "exact":
        propagation += f", sampled to {pretty(tolerance, FRACTION, digits=2)}"
    pictures = {slot: names for slot, names in offered.items() if slot != "calibration" and len(names) > 1}
    if not pictures:
        return propagation
    if all(models[slot] == names[-1] for slot, names in pictures.items()):
        return f"every effect, {propagation}"
    laws = dict.fromkeys(models[lens] for lens in LENSES if lens in pictures)
    law_names = [law.capitalize() for law in laws if law != OFF]
    return f"{f'{listed(law_names)} diffraction' if law_names else 'no diffraction'}, {propagation}"


def _usable_places(case: Case, camera: DepthCamera) -> FloatArray:
    """Some of the study's distances [m] where the camera is usable and its uncertainty finite."""
    usable = all_met(evaluate_limits(camera, case.criteria, case.distance, depth=distribution), case.distance.shape)
    places = case.distance[usable & np.isfinite(judged_at(camera, case.distance))]
    if not places.size:
        return places
    evenly = np.geomspace(places[0], places[-1], _MOST_PLACES)
    return np.asarray(places[np.unique(np.abs(places[:, None] - evenly).argmin(axis=0))])


def _references(camera: DepthCamera, places: FloatArray) -> Iterator[Reference]:
    """The most complete models with ever more draws from another seed; a single reference where nothing is drawn."""
    law = camera.propagation
    if law.model != "exact":
        yield Reference(words="every effect", compute=partial(_with_error, camera, places))
        return
    # No error meets a tolerance of 0, so that all draws are made.
    for draws, growth in _DRAWS:
        drawn = replace(law, tolerance=0.0, max_draws=draws, seed=law.seed + 1, judged=tuple(places.tolist()))
        yield Reference(
            words=f"every effect, {draws} draws from another seed",
            compute=partial(_with_error, replace(camera, propagation=drawn), places),
            growth=growth,
        )


def _with_error(camera: DepthCamera, places: FloatArray) -> tuple[FloatArray, float]:
    """Depth uncertainty [m] and its relative error, the largest over all places.

    The error is that of the draws, from the Student t interval over their scrambles, plus the change due to the
    numerical error δ of the disparity error: √(1 + s ((1 + δ)² − 1)) − 1 with the share s of the noise in the variance.
    """
    measured = distribution(camera, places, "both")
    share = np.nan_to_num(variance_shares(camera, places)["noise"], nan=1.0)
    relative_error = numerical_error_of_disparity_error(camera, places) / disparity_error_at(camera, places)
    picture = np.sqrt(1.0 + share * ((1.0 + relative_error) ** 2 - 1.0)) - 1.0
    drawn = stdtrit(SCRAMBLES - 1, 0.975) * measured.judged_error / measured.judged
    return measured.judged, max(float(np.nanmax(drawn + picture)), float(np.finfo(np.float64).eps))


def _worst(values: FloatArray, reference: FloatArray) -> float:
    """Largest relative difference where the reference is finite; infinite where the values have no answer there."""
    finite = np.isfinite(reference)
    return float(np.max(np.nan_to_num(np.abs(values[finite] / reference[finite] - 1.0), nan=np.inf), initial=0.0))


_COARSEST, _FINEST = 0.2, 1e-6  # possible tolerances of a picture
_OF_RAYS: Final = 0.2  # time of a picture by rays relative to that of one by waves
# Tolerance relative to that of the chosen models, and growth of the computing time.
_SPOT_REFERENCES: Final = ((0.5, 2.0), (0.15, 4.0), (0.05, 4.0))


def spot_problem(part: LightSpotPart, name: str, chosen: SpotModels) -> CostProblem:
    """Candidates for all pixels of the picture of the spot.

    They are the chosen models, every law that the study names, and Kirchhoff's law at several tolerances.

    Parameters
    ----------
    part
        The light path.
    name
        Name of the problem.
    chosen
        The models of the picture in a run.
    """

    def reference(tolerance: float, growth: float) -> Reference:
        models = replace(compared_models(part, "kirchhoff"), tolerance=max(tolerance, _FINEST))

        def compute() -> tuple[FloatArray, float]:
            picture = picture_of(part, models, seed=part.seed + 1)
            return picture.pixels, picture.numerical_error

        return Reference(words=_spot_words(part, models), compute=compute, growth=growth)

    return CostProblem(
        name=name,
        title="Picture of the light spot",
        difference=_relative_norm,
        candidates=tuple(
            Candidate(
                models=_spot_words(part, models),
                compute=partial(lambda models: picture_of(part, models, seed=part.seed).pixels, models),
                chosen=models == chosen,
                growth=growth,
            )
            for models, growth in _spot_sets(part, chosen)
        ),
        references=tuple(reference(share * chosen.tolerance, growth) for share, growth in _SPOT_REFERENCES),
    )


def _spot_sets(part: LightSpotPart, chosen: SpotModels) -> Iterator[tuple[SpotModels, float]]:
    """Sets of models, each once, with their time relative to that of the sets before them."""
    sets = {chosen: 1.0}
    for method in (*part.methods, "kirchhoff"):
        models = replace(compared_models(part, method), tolerance=chosen.tolerance)
        sets.setdefault(models, _OF_RAYS if method in RAYS else 1.0)
    for factor, growth in ((3.0, 1.0), (0.3, 3.0)):
        tolerance = min(max(factor * chosen.tolerance, _FINEST), _COARSEST)
        sets.setdefault(replace(compared_models(part, "kirchhoff"), tolerance=tolerance), growth)
    yield from sets.items()


def _spot_words(part: LightSpotPart, models: SpotModels) -> str:
    """Law and tolerance in words, and what is left out of the declared spot."""
    left_out = {
        "cross-talk": models.separate,
        "pixels' width": not models.integrated,
        "spot's size": models.point and not part.spot.is_point,
        "spectrum": models.monochromatic and len(part.lines) > 1,
    }
    to = "" if models.method == "geometric" else f" to {pretty(models.tolerance, FRACTION, digits=2)}"
    return (
        short_title(models.method)
        + to
        + "".join(f", without {effect}" for effect, is_left_out in left_out.items() if is_left_out)
    )


def _relative_norm(values: FloatArray, reference: FloatArray) -> float:
    """Relative L2 difference over the pixels."""
    return float(np.linalg.norm(values - reference) / np.linalg.norm(reference))


def require_prices(study: PreparedStudy) -> None:
    """Refuse a study without a choice of models.

    Raises
    ------
    OutOfRangeError
        If it has no light spot and no camera with calibration errors or a derived disparity error.
    """
    cameras = study.case.cameras.values()
    calibrated = any(camera.calibration.groups or not camera.calibration.inferred for camera in cameras)
    pictured = any(isinstance(camera.disparity_error_px, PictureDisparityError) for camera in cameras)
    if not calibrated and not pictured and study.file.light_spot is None:
        raise OutOfRangeError(
            "there is only one way to compute every answer of this study, so there are no costs to compare",
            value=study.file.study,
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
    require_prices(plan.study)
    steps = Steps() if steps is None else steps
    study, *_ = infer_calibrations(plan.study, steps)
    problems = list(_problems(plan, study))
    measured: list[Measured] = []
    end = time.perf_counter() + budget
    for number, problem in enumerate(problems):
        steps.progress("cost", number / len(problems))
        # Time that one problem does not use goes to those after it.
        measured.append(measure(problem, (end - time.perf_counter()) / (len(problems) - number)))
    steps.progress("cost", 1.0)
    return _dataset(measured, budget)


def cost_json(study: str, study_hash: str, cost: xr.Dataset) -> str:
    """A cost as JSON: the name and hash of its study, its attributes, and a row for every problem and every entry."""
    tables = {"problems": cost.drop_dims("entry").to_dataframe().reset_index()}
    tables["entries"] = cost.drop_dims("problem").to_dataframe()
    rows = {name: json.loads(table.to_json(orient="records", double_precision=15)) for name, table in tables.items()}
    return json_text({"study": study, "study_hash": study_hash, **cost.attrs, **rows}) + "\n"


def _problems(plan: Plan, study: PreparedStudy) -> Iterator[CostProblem]:
    for camera_name in study.case.cameras:
        chosen, offered = _models(plan, camera_name)
        problem = depth_problem(study.case, camera_name, study.file.cameras[camera_name].title, chosen, offered)
        if problem is not None:
            yield problem
    if (part := study.file.light_spot) is not None:
        yield spot_problem(part, light_spot.NAME, light_spot.spot_models(plan.models(light_spot.NAME)))


def _models(plan: Plan, name: str) -> tuple[Models, Offered]:
    """The models applied to a problem, and those available."""
    (choice,) = (choice for choice in plan.problems if choice.name == name)
    offered = {
        slot.name: models_of(slot.name, "depth") if slot.name in choice.forced else slot.models
        for slot in choice.problem.slots
    }
    return choice.models, offered


def _dataset(results: list[Measured], budget: float) -> xr.Dataset:
    entries = [(result, entry) for result in results for entry in result.entries]
    values = {
        "problem_of": [result.problem.name for result, _ in entries],
        "models": [entry.models for _, entry in entries],
        "relative_error": [entry.error for _, entry in entries],
        "seconds": [entry.seconds for _, entry in entries],
        "chosen": [entry.chosen for _, entry in entries],
        "frontier": [bool(on) for result in results for on in on_frontier(result.entries)],
        "next_digit": [entry is next_digit(result.entries) for result, entry in entries],
        "title": [result.problem.title for result in results],
        "reference": [result.reference for result in results],
        "reference_error": [result.reference_error for result in results],
        "left_out": ["\n".join(result.left_out) for result in results],
    }
    return dataset(
        "cost",
        values,
        {"problem": [result.problem.name for result in results]},
        attributes={
            "machine": json.dumps(machine.identity(), sort_keys=True),
            "measured": datetime.now(UTC).isoformat(timespec="seconds"),
            "budget": budget,
            "code_hash": provenance.code_hash(),
        },
    )

"""Depth uncertainty of a camera: the sets of models that can compute it, and their reference."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np
from scipy.special import stdtrit

from tradestudy.analysis.depth import distribution, judged_uncertainty, variance_shares
from tradestudy.analysis.depth_draws import SCRAMBLES
from tradestudy.analysis.linear_depth import has_covariance
from tradestudy.analysis.usable import all_met, evaluate_limits
from tradestudy.cameras.depth_camera import DepthCamera, disparity_error_at, numerical_error_of_disparity_error
from tradestudy.cost.measuring import Candidate, CostProblem, Reference
from tradestudy.effects.models import LENSES, OFF, Models, SlotName
from tradestudy.effects.words import MODEL
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.building import apply_models
from tradestudy.study.definition import Case
from tradestudy.units import FRACTION, pretty
from tradestudy.wording import listed

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
            Candidate(models=words, compute=partial(judged_uncertainty, camera, places), chosen=camera == taken)
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
    named = [law.capitalize() for law in laws if law != OFF]
    return f"{f'{listed(named)} diffraction' if named else 'no diffraction'}, {propagation}"


def _usable_places(case: Case, camera: DepthCamera) -> FloatArray:
    """Some of the study's distances [m] where the camera is usable and its uncertainty finite."""
    usable = all_met(evaluate_limits(camera, case.criteria, case.distance), case.distance.shape)
    places = case.distance[usable & np.isfinite(judged_uncertainty(camera, case.distance))]
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
    found = distribution(camera, places, "both")
    share = np.nan_to_num(variance_shares(camera, places)["noise"], nan=1.0)
    off = numerical_error_of_disparity_error(camera, places) / disparity_error_at(camera, places)
    picture = np.sqrt(1.0 + share * ((1.0 + off) ** 2 - 1.0)) - 1.0
    drawn = stdtrit(SCRAMBLES - 1, 0.975) * found.judged_error / found.judged
    return found.judged, max(float(np.nanmax(drawn + picture)), float(np.finfo(np.float64).eps))


def _worst(values: FloatArray, reference: FloatArray) -> float:
    """Largest relative difference where the reference is finite; infinite where the values have no answer there."""
    finite = np.isfinite(reference)
    return float(np.max(np.nan_to_num(np.abs(values[finite] / reference[finite] - 1.0), nan=np.inf), initial=0.0))

"""Depth uncertainty whose disparity error is derived: what every model of the picture behind it costs and changes."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from tradestudy.accuracy import Accuracy
from tradestudy.analysis.depth import depth_uncertainty
from tradestudy.analysis.linear_depth import has_covariance
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cost.depth import usable_places
from tradestudy.cost.entries import NOWHERE_USABLE, CostTable, nothing_measured
from tradestudy.cost.measuring import Allowance, entry_of, measure
from tradestudy.cost.picture_reference import reference_error_px
from tradestudy.effects.base import OFF, SlotName
from tradestudy.effects.selection import Selection
from tradestudy.errors import TradestudyError, UnaffordableError
from tradestudy.execution.steps import Progress
from tradestudy.imaging.derived_error import PictureDisparityError
from tradestudy.optics.arrays import FloatArray
from tradestudy.plan.situations.situation import Situation
from tradestudy.study.acting import acting
from tradestudy.study.definition import StudyDefinition

TITLES: Final[Mapping[str, str]] = {
    OFF: "no diffraction",
    "airy": "Airy",
    "fresnel": "Fresnel",
    "kirchhoff": "Kirchhoff",
}
_LENSES: Final[tuple[SlotName, ...]] = ("main_lens_diffraction", "microlens_diffraction")
# What a selection would take if the study wanted other accuracies.
_WANTED: Final = (0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 5e-3, 2e-3, 1e-3)
_REFERENCE_SHARE: Final = 0.5  # at most, of what is left, so that models can be held against it
# A lattice of Kirchhoff's part has up to four points for every distance, the reference one.
_LATTICE_POINTS: Final = 4.0

Names = dict[SlotName, str]


def picture_cost(
    definition: StudyDefinition,
    situation: Situation,
    selection: Selection,
    allowance: Allowance,
    *,
    progress: Progress,
    name: str,
) -> CostTable:
    """Measure the sets of picture models that a selection could take for one camera, against all at their best.

    Parameters
    ----------
    definition
        The study as declared, no models acting in it.
    situation, selection
        Of a camera whose disparity error is derived: its models, and those that a run of the study takes.
    allowance
        Time and repeats.
    progress
        Called with the step and the share done.
    name
        Of the quantity in the results.

    Returns
    -------
    CostTable
        Without entries where the camera is usable at no distance of the study, or the time does not allow a reference.
    """
    declared = definition.case.cameras[situation.name]
    taken = acting(declared, {slot: model.name for slot, model in selection.chosen.items()})
    places = usable_places(definition, taken)
    camera = declared.without_calibration_errors() if taken.propagation.model == "off" else _by_line(declared)
    chosen = acting(camera, _names(selection))
    step = f"cost: {name}"
    progress(step, 0.0)
    title = f"Picture models: {situation.title}"
    says = (
        f"Depth uncertainty of {situation.title} at {places.size} distances where it is usable, its disparity error "
        "derived anew and propagated linearly: seconds for all of them, relative error at the worst. Settings name "
        "what is simpler than the most complete models."
    )
    if places.size == 0:
        return nothing_measured(name, title, says, NOWHERE_USABLE)
    try:
        places, reference, reference_error, reference_seconds = _reference(camera, places, allowance)
    except UnaffordableError as error:
        return nothing_measured(name, title, says, f"everything: {error}")
    entries, left_out = [], []
    sets = _sets(camera, situation, selection)
    for number, (model_camera, names) in enumerate(sets.items()):
        progress(step, number / len(sets))
        model, setting = _words(names, situation)
        predicted = _LATTICE_POINTS * reference_seconds if "kirchhoff" in names.values() else 0.0
        if not allowance.allows(predicted):
            left_out.append(f"{', '.join(filter(None, (model, setting)))}: {allowance.lacking(predicted)}")
            continue
        timed = measure(
            lambda _run, one=model_camera: depth_uncertainty(one, places),  # type: ignore[misc]  # bound at once
            allowance,
        )
        with np.errstate(invalid="ignore"):  # no bar at all is no answer: infinite
            relative = np.abs(timed.values[0] / reference - 1.0)
        relative = np.where(np.isnan(relative), np.inf, relative)
        entries.append(
            entry_of(
                timed,
                model=model,
                setting=setting,
                evaluations=math.nan,
                error=float(np.max(relative)),
                typical_error=float(np.median(relative)),
                chosen=model_camera == chosen,
            )
        )
    progress(step, 1.0)
    order = list(TITLES.values())
    return CostTable(
        name=name,
        title=title,
        says=says,
        reference="every effect at once by a code of its own: Kirchhoff's transfer at each distance, no interpolation, "
        "every replica up to the cut-off, more nodes in the band",
        reference_error=reference_error,
        reference_seconds=reference_seconds,
        entries=tuple(sorted(entries, key=lambda entry: order.index(entry.model.partition(" at ")[0]))),
        left_out=tuple(left_out),
        ways={entry.model: "effects, or an accuracy.depth_uncertainty that calls for it" for entry in entries},
    )


def _by_line(camera: DepthCamera) -> DepthCamera:
    """The camera with errors that propagate without draws, whose scatter would hide what pictures change."""
    if not has_covariance(camera):
        return camera.without_calibration_errors()
    return replace(camera, propagation=replace(camera.propagation, model="linear"))


def _names(selection: Selection) -> Names:
    """Of the picture: ways of propagation are priced with the depth uncertainty."""
    return {slot: model.name for slot, model in selection.chosen.items() if slot != "calibration"}


def _reference(
    camera: DepthCamera, places: FloatArray, allowance: Allowance
) -> tuple[FloatArray, FloatArray, float, float]:
    """Places where depth uncertainty is finite [m], what it is there [m], its largest relative error, seconds it took.

    Raises
    ------
    UnaffordableError
        Where the time, or what a picture asks for, does not allow one.
    """
    law = camera.disparity_error_px
    assert isinstance(law, PictureDisparityError)  # its situation has a picture
    begin = time.perf_counter()
    geometry = camera.picture_geometry(places)
    found: list[tuple[FloatArray, FloatArray]] = []
    for k in range(places.size):
        found.append(reference_error_px(geometry.at(np.array([k])), law.settings))
        needed = (time.perf_counter() - begin) / (k + 1) * (places.size - k - 1)
        if not allowance.allows(needed / _REFERENCE_SHARE):
            raise UnaffordableError(
                "time for a reference",
                value=f"{needed:.1f} s more",
                limit=f"half of the {max(allowance.left, 0.0):.1f} s that are left",
                remedy="a larger --budget measures it",
            )
    value, off = (np.concatenate(column) for column in zip(*found, strict=True))
    uncertainty, moved = _uncertainty(camera, places, value), _uncertainty(camera, places, value + off)
    finite = np.isfinite(uncertainty) & np.isfinite(moved)
    if not finite.any():
        raise UnaffordableError("no finite uncertainty with every effect in it", remedy="look at fewer distances")
    error = float(np.max(moved[finite] / uncertainty[finite] - 1.0))
    return places[finite], uncertainty[finite], error, time.perf_counter() - begin


def _uncertainty(camera: DepthCamera, places: FloatArray, error_px: FloatArray) -> FloatArray:
    """Of a camera that has these disparity errors [px] at these places [m]; NaN where they are no numbers."""
    found = [
        depth_uncertainty(replace(camera, disparity_error_px=float(error)), places[k : k + 1])[0]
        if math.isfinite(error) and error > 0.0
        else math.nan
        for k, error in enumerate(error_px)
    ]
    return np.array(found)


def _sets(camera: DepthCamera, situation: Situation, selection: Selection) -> dict[DepthCamera, Names]:
    """Sets of models by the camera in which they act; of those that make the same camera the first.

    Diffraction by every law, everything else at its best; then omissions, and what is or would be selected.
    """
    ladder = (_with_law(situation, law) for law in TITLES)
    sets: dict[DepthCamera, Names] = {}
    for names in (*ladder, *_omissions(situation), _names(selection), *_preferred(situation)):
        sets.setdefault(acting(camera, names), names)
    return sets


def _complete(situation: Situation) -> Names:
    """The most complete model of every slot of the picture."""
    return {slot.name: slot.models[-1].name for slot in situation.slots if slot.name != "calibration"}


def _with_law(situation: Situation, law: str) -> Names:
    """Everything, with one law at both lenses as far as they have it."""
    lenses: Names = {slot.name: law for slot in situation.slots if slot.name in _LENSES and law in slot.model_names}
    return _complete(situation) | lenses


def _omissions(situation: Situation) -> Iterator[Names]:
    """One effect after the other by its simpler models, beside Fresnel's law; none that could never be selected."""
    standing = _with_law(situation, "fresnel")
    for slot in situation.slots:
        if slot.name in (*_LENSES, "calibration"):
            continue
        for model in slot.models[:-1]:
            if all(math.isfinite(bound.relative_change) for bound in model.bounds.values()):
                yield {**standing, slot.name: model.name}


def _preferred(situation: Situation) -> Iterator[Names]:
    """What would be selected for other accuracies, where anything would be."""
    for relative in _WANTED:
        try:
            yield _names(situation.select(Accuracy.of_all(relative), {}))
        except TradestudyError:
            continue  # so accurate is no set


def _words(names: Names, situation: Situation) -> tuple[str, str]:
    """The law of diffraction, and what else is simpler than the most complete models."""
    complete = _complete(situation)
    at_main, at_micro = (names[slot] for slot in _LENSES)
    model = TITLES[at_main]
    if complete[_LENSES[1]] != OFF and at_micro != at_main:
        model += f" at the main lens, {TITLES[at_micro]} at microlenses"
    simpler = [
        f"{slot.replace('_', ' ')} {name}"
        for slot, name in names.items()
        if slot not in _LENSES and name != complete[slot]
    ]
    return model, ", ".join(simpler)

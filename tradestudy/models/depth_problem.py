"""The choice of models of picture and calibration for cameras that measure depth."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.accuracy import Quantity
from tradestudy.cameras.depth_camera import DepthCamera, declared_disparity_error
from tradestudy.cameras.depth_measurement import towards_corners
from tradestudy.depth.linear import has_covariance
from tradestudy.effects import LENSES, OFF, Models, SlotName, models_of
from tradestudy.imaging.picture import PictureDisparityError
from tradestudy.models.depth_variant import DepthVariant
from tradestudy.models.problem import Change, Changes, Evidence, SimulationProblem, Slot
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.document import Entry
from tradestudy.study.prepared import PreparedStudy, complete_in_closed_form
from tradestudy.study.schema.root import StudyFile
from tradestudy.study.varying import SweepAxis, Varying, axes_of_camera
from tradestudy.wording import NO_MICROLENSES

# Models are compared at no more than this many of the study's distances, since changes vary slowly with distance.
_MOST_DISTANCES: Final = 101
# Margins on changes computed at some distances, between which they may be larger, and on changes that a trial finds at
# a few places; set by `python -m tests.campaigns.depth_regret` on scenes other than those it reports.
MARGIN: Final = 1.1
TRIAL_MARGIN: Final = 1.25
_SURE: Final = 0.5  # share of the estimated error of linear propagation that it makes at least
_ALL: Final = 1.0 - 1e-9  # of a disparity error, which cannot become zero
# Effects whose simpler models save time, in the order in which they are tried.
_SAVING: Final[tuple[SlotName, ...]] = (*LENSES, "calibration", "spectrum", "crosstalk")
_COSTLY: Final[Mapping[SlotName, int]] = {"calibration": 2, **dict.fromkeys(LENSES, 1)}  # draws; Kirchhoff's integral
_OTHERS: Final[tuple[SlotName, ...]] = ("defocus_blur", "pixel_integration", "vignetting", "sensor_noise")

# The largest number of designs examined in a sweep, evenly along each axis with its ends. The ends alone are not
# enough: changes are not monotonic where a design between them is in focus and they are not.
_MOST_DESIGNS: Final = 48
_ENDS: Final = 2
# Number of values examined of the parameter that an inverse question varies, including its ends.
_OF_QUESTIONS: Final = 5


class DepthProblem(SimulationProblem):
    """One camera that measures depth, in every form in which the study uses it.

    Parameters
    ----------
    name, title
        Key of the camera in the study, and its title.
    variants
        Forms of the camera; the form that a set of models changes most counts.
    asked
        Quantities with a tolerance.
    forced
        Models that the study prescribes.
    drawn_above
        Largest relative error of linear propagation that is accepted in a form that occurs only in readings or inverse
        questions; a form with a larger error is propagated by draws.
    rejected_above
        Relative error of linear propagation with which it cannot be chosen: the tolerance of the depth uncertainty.
    """

    def __init__(
        self,
        name: str,
        title: str,
        variants: Sequence[DepthVariant],
        asked: tuple[Quantity, ...],
        forced: Models,
        drawn_above: float = math.inf,
        rejected_above: float = math.inf,
    ) -> None:
        self.name, self.title, self.asked = name, title, asked
        self._variants, self._drawn_above, self._rejected_above = tuple(variants), drawn_above, rejected_above
        self._drawn: frozenset[DepthVariant] = frozenset()
        self._pictured = tuple(variant for variant in variants if variant.law is not None and variant.places.size)
        slots = _slots(variants[0].camera, [variant.camera for variant in self._pictured], forced)
        bare = not any(
            variant.camera.calibration.groups or not variant.camera.calibration.inferred for variant in variants
        )
        self.slots = tuple(
            _NO_ERRORS if bare and slot.name == "calibration" and not slot.reason else slot for slot in slots
        )
        self._linear: Change | None = None
        self._exact_paths: tuple[float, float] | None = None

    def changes(self, models: Models) -> Changes:
        """The largest changes over all forms of the camera, as far as they are known."""
        if models == self.complete:
            return {quantity: Change(relative=0.0) for quantity in self.asked}
        of_forms = [self._changes_of(variant, models) for variant in self._variants]
        worst: dict[Quantity, Change] = {
            quantity: max((changes[quantity] for changes in of_forms), key=lambda c: c.relative)
            for quantity in of_forms[0]
        }
        return worst | (self._noise(models) if "depth_noise" in self.asked else {})

    def other_models(self, models: Models) -> Mapping[str, Models]:
        """Models of the readings and inverse questions that need draws, although the study as declared does not."""
        if models["calibration"] == "exact":
            return {}
        drawn = [variant for variant in self._variants if variant in self._drawn]  # in the order of the study
        return {reading: {**models, "calibration": "exact"} for variant in drawn for reading in variant.only_in}

    def unasked(self, models: Models) -> Changes:
        """The change of the uncertainty from noise alone, where it has no tolerance."""
        return {} if "depth_noise" in self.asked else self._noise(models)

    def try_out(self, models: Models) -> bool:
        """Try out linear propagation where it could suffice, then Kirchhoff's transfer where Fresnel's could."""
        if models["calibration"] != "exact" and self._linear is None and self._is_line:
            self._try_line()
            return True
        if (
            self._exact_paths is None
            and self._pictured
            and any(models[lens] != "kirchhoff" for lens in self._free_lenses)
        ):
            worst = max(self._pictured, key=lambda variant: float(np.nanmax(np.sum(variant.by_exact_paths, axis=0))))
            of_error, of_depth = worst.tried_by_exact_paths()
            self._exact_paths = TRIAL_MARGIN * of_error, TRIAL_MARGIN * of_depth
            return True
        return False

    @cached_property
    def _is_line(self) -> bool:
        """Whether errors can be propagated linearly: all calibrations are known before the run and have covariances."""
        cameras = [variant.camera for variant in self._variants]
        return all(camera.calibration.inferred and has_covariance(camera) for camera in cameras)

    @property
    def _free_lenses(self) -> list[SlotName]:
        """Lenses whose model of diffraction the study leaves open."""
        return [lens for lens in LENSES if self._is_free(lens)]

    def _is_free(self, effect: SlotName) -> bool:
        """Whether the study leaves the model of an effect open."""
        return any(slot.name == effect and len(slot.models) > 1 for slot in self.slots)

    def _changes_of(self, variant: DepthVariant, models: Models) -> Changes:
        """Changes of the total uncertainty and of the ends of usable ranges, for one form of the camera."""
        if variant in self._drawn:
            models = {**models, "calibration": "exact"}
        line = self._line(models)
        if not variant.places.size or math.isinf(line.relative):
            return {"depth_uncertainty": line, "usable_range": line}
        left_out = self._paths_left_out(variant, models)
        computed = moved = variant.moved(models)
        if left_out is not None or line.relative > 0.0:
            moved = variant.moved(models, 0.0 if left_out is None else left_out, line.relative)
        evidence = self._evidence(left_out, drawn=line.relative > 0.0)
        whole = _largest(variant, moved.uncertainty, computed.uncertainty, evidence, line)
        if variant.fields:
            off_axis = variant.moved_of_field(models) + line.relative
            whole = (
                whole if off_axis <= whole.relative else replace(whole, relative=off_axis, least=off_axis, at=math.nan)
            )
        return {
            "depth_uncertainty": whole,
            "usable_range": Change(
                relative=float(_with_margin(moved.ends, computed.ends)), least=computed.ends, evidence=evidence
            ),
        }

    def _noise(self, models: Models) -> dict[Quantity, Change]:
        """The largest change, over all forms, of the uncertainty from noise alone, without calibration errors."""
        changes = []
        for variant in self._variants:
            left_out = self._paths_left_out(variant, models)
            computed = variant.moved_noise(models)
            moved = computed if left_out is None else variant.moved_noise(models, left_out)
            changes.append(
                _largest(variant, moved, computed, self._evidence(left_out, drawn=False), Change(relative=0.0))
            )
        return {"depth_noise": max(changes, key=lambda change: change.relative)}

    def _evidence(self, left_out: FloatArray | None, *, drawn: bool) -> Evidence:
        if drawn or (left_out is not None and self._exact_paths is not None):
            return "trial"
        return "computed" if left_out is None else "rule"

    def _line(self, models: Models) -> Change:
        """The error of linear propagation; it adds to every change that is computed with it."""
        if models["calibration"] == "exact":
            return Change(relative=0.0)
        if not self._is_line:
            return _UNKNOWN
        if not any(variant.camera.calibration.groups for variant in self._variants):
            return Change(relative=0.0)
        return _TO_BE_TRIED if self._linear is None else self._linear

    def _try_line(self) -> None:
        """Find the largest error of linear propagation, and the forms that need draws although the study does not."""
        errors: dict[DepthVariant, tuple[float, float]] = {}
        for variant in self._variants:
            if variant.camera.calibration.groups:
                errors[variant] = variant.linear_error()
                if errors[variant][0] > self._rejected_above and not variant.only_in and self._is_free("calibration"):
                    break  # the study as declared needs draws, whatever its other forms need
        # Only forms that occur in readings and questions alone may be propagated by other models than the study.
        beyond = frozenset(variant for variant, (error, _) in errors.items() if error > self._drawn_above)
        if all(variant.only_in for variant in beyond) and self._is_free("calibration"):
            self._drawn = beyond
        error, at = max(
            (missed for variant, missed in errors.items() if variant not in self._drawn), default=(0.0, math.nan)
        )
        self._linear = Change(relative=error, least=_SURE * error, evidence="trial", at=at)

    def _paths_left_out(self, variant: DepthVariant, models: Models) -> FloatArray | None:
        """Relative change of the disparity error, everywhere, if the lenses that do not use Kirchhoff's law did."""
        if variant.law is None:
            return None
        of_lens = dict(zip(LENSES, variant.by_exact_paths, strict=True))
        parts = [of_lens[lens] for lens in self._free_lenses if models[lens] != "kirchhoff"]
        if not parts:
            return None
        left_out = np.minimum(np.nan_to_num(np.sum(parts, axis=0), nan=0.0, posinf=1.0), _ALL)
        if self._exact_paths is not None:
            of_error, of_depth = self._exact_paths
            # The change of the depth uncertainty is that of the noise times its share of the variance.
            left_out = np.minimum(left_out, np.minimum(of_error, of_depth / variant.noise_share))
        return np.asarray(left_out)


def _largest(
    variant: DepthVariant, moved: FloatArray, computed: FloatArray, evidence: Evidence, line: Change
) -> Change:
    """The largest change over the places, with its margin and with the error of linear propagation."""
    if not moved.size:
        return Change(relative=line.relative, evidence=evidence)
    changed = _with_margin(moved, computed)
    place, least = int(np.argmax(changed)), float(np.max(np.abs(computed)))
    largest = float(changed[place])
    return Change(
        relative=(1.0 + line.relative) * largest + line.relative,
        least=least,
        evidence=evidence,
        at=float(variant.places[place]) if largest > 0.0 else line.at,
    )


def _with_margin(moved: ArrayLike, computed: ArrayLike) -> FloatArray:
    """The size of a change with a margin on its computed part: what a rule or a trial adds has a margin of its own."""
    with np.errstate(invalid="ignore"):
        added = np.abs(moved) - np.abs(computed)
    return np.asarray(MARGIN * np.abs(computed) + np.where(np.isnan(added), 0.0, np.maximum(added, 0.0)))


_NO_ERRORS: Final = Slot(name="calibration", models=(OFF,), reason="no calibration errors are declared")
_UNKNOWN: Final = Change(relative=math.inf, least=math.inf, evidence="rule")
_TO_BE_TRIED: Final = Change(relative=math.inf, evidence="rule")


def depth_problems(study: PreparedStudy, forced: Models) -> tuple[DepthProblem, ...]:
    """One problem of choice for each camera that measures depth."""
    variants = tuple(_every_form(study))
    tolerances = study.file.accuracy.asked().tolerances
    asked: tuple[Quantity, ...] = ("depth_uncertainty", "usable_range")
    if "depth_noise" in tolerances:
        asked = (*asked, "depth_noise")
    strictest = min(tolerances[quantity] for quantity in asked[:2])
    return tuple(
        DepthProblem(
            name,
            study.file.cameras[name].title,
            _distinct(variants, name, forced),
            asked,
            forced,
            strictest,
            tolerances["depth_uncertainty"],
        )
        for name in study.case.cameras
    )


def _every_form(study: PreparedStudy) -> Iterator[tuple[str, PreparedStudy]]:
    """The study, its readings, designs of its sweep, values of its inverse questions and ends of its assumptions.

    Each comes with the name of its reading or question, which may use models of its own; "" for study and designs.
    """
    yield "", study
    yield from study.readings.items()
    for axes in _axes_of_cameras(study):
        for values in _designs(axes):
            yield "", study.with_values({axis.path: value for axis, value in zip(axes, values, strict=True)})
    for name, question in study.file.solve.items():
        varying = Varying.of(study, question)
        for value in np.linspace(varying.low, varying.high, _OF_QUESTIONS):
            yield name, study.with_values(varying.changes(float(value)))
    for variant in _assumed(study):
        yield "value_of_information", variant


def _axes_of_cameras(study: PreparedStudy) -> Iterator[tuple[SweepAxis, ...]]:
    """For every camera, the axes of the sweep that can change it; each set of axes once.

    An axis of another camera would take the place of designs in which the camera itself changes.
    """
    of_cameras = (axes_of_camera(study, camera_name) for camera_name in study.case.cameras)
    yield from dict.fromkeys(camera_axes for camera_axes in of_cameras if camera_axes)


def _assumed(study: PreparedStudy) -> Iterator[PreparedStudy]:
    """The study with each assumption at either of its ends, the others as declared."""
    part = study.file.value_of_information
    for assumption in part.assumptions.values() if part is not None else ():
        if assumption.readings is None:
            for value in (assumption.low, assumption.high):
                yield study.with_values(dict.fromkeys(assumption.paths, value))
        for reading in assumption.readings or ():
            yield study.with_values(study.definition.entries_of_reading(reading))


def _designs(axes: Sequence[SweepAxis]) -> Iterator[tuple[Entry, ...]]:
    """The values along all axes, for every design examined."""
    sizes = [len(axis.values) for axis in axes]
    while math.prod(sizes) > _MOST_DESIGNS and max(sizes) > _ENDS:
        sizes[sizes.index(max(sizes))] -= 1
    kept = [
        [axis.values[k] for k in np.unique(np.round(np.linspace(0, len(axis.values) - 1, size)).astype(int))]
        for axis, size in zip(axes, sizes, strict=True)
    ]
    # The ends alone are too many designs from six axes on; then only the first of these are examined.
    return itertools.islice(itertools.product(*kept), _MOST_DESIGNS)


def _distinct(variants: Sequence[tuple[str, PreparedStudy]], camera_name: str, forced: Models) -> list[DepthVariant]:
    """The distinct forms of a camera; `only_in` names the readings and questions of forms that no design has."""
    forms: list[DepthVariant] = []
    for reading, study in variants:
        form = _variant(study, camera_name, forced)
        if form is None:
            continue
        index = next((k for k, other in enumerate(forms) if _same(form, other)), None)
        if index is None:
            forms.append(replace(form, only_in=(reading,) if reading else ()))
        elif forms[index].only_in:
            forms[index] = replace(forms[index], only_in=(*forms[index].only_in, reading) if reading else ())
    return forms


def _variant(study: PreparedStudy, camera_name: str, forced: Models) -> DepthVariant | None:
    camera = study.case.cameras.get(camera_name)
    if camera is None:  # a reading may replace it by a camera that measures no depth
        return None
    distance, file = study.case.distance, study.file
    step = max(1, -(-distance.size // _MOST_DISTANCES))
    return DepthVariant(
        camera=camera,
        criteria=study.case.criteria,
        distance=np.unique(np.append(distance[::step], distance[-1:])),
        asked=np.array(file.depth_distances),
        error_sources=_error_sources_asked(file),
        fields=tuple(place for share in file.propagation.field_places for place in towards_corners(share)),
        forced=applicable(camera, forced),
    )


def _error_sources_asked(file: StudyFile) -> tuple[str, ...]:
    """The errors that answers include: both kinds, and calibration alone where a question names it."""
    sources = {getattr(part, "errors", "") for part in (*file.solve.values(), *file.claims.values())}
    return ("both", "calibration") if "calibration" in sources else ("both",)


def _same(variant: DepthVariant, other: DepthVariant) -> bool:
    return (
        variant.camera == other.camera
        and variant.fields == other.fields
        and variant.error_sources == other.error_sources
        and variant.criteria == other.criteria
        and np.array_equal(variant.distance, other.distance)
        and np.array_equal(variant.asked, other.asked)
    )


def applicable(camera: DepthCamera, forced: Models) -> dict[SlotName, str]:
    """The forced models that apply to a camera's depth: of microlenses and of a spectrum only if it has them."""
    applied = {slot: model for slot, model in forced.items() if model in models_of(slot, "depth")}
    law = camera.disparity_error_px
    if not isinstance(law, PictureDisparityError):
        return {slot: model for slot, model in applied.items() if slot == "calibration"}
    if not camera.pictured_by_microlenses:
        for slot in ("microlens_diffraction", "crosstalk"):
            applied.pop(slot, None)
    if not law.settings.spectrum:
        applied.pop("spectrum", None)
    return applied


def _slots(camera: DepthCamera, pictured: Sequence[DepthCamera], forced: Models) -> tuple[Slot, ...]:
    """A slot for every effect on depth; with one model where the study or all forms of the camera allow no other."""
    applied: dict[SlotName, str] = {}
    for form in (camera, *pictured):
        applied |= applicable(form, forced)
    why = _why_no_picture(camera, pictured=bool(pictured))
    slots = []
    for effect in (*_SAVING, *_OTHERS):
        models, reason = models_of(effect, "depth"), ""
        if effect != "calibration" and (reason := _absent(camera, pictured, effect) or why):
            models = (OFF,)
        slot = Slot(
            name=effect, models=models, saves_time=effect in _SAVING, costly=_COSTLY.get(effect, 0), reason=reason
        )
        slots.append(slot if slot.reason else slot.under(applied))
    return tuple(slots)


def _why_no_picture(camera: DepthCamera, *, pictured: bool) -> str:
    """Why the picture does not affect depth; empty where it does."""
    if pictured:
        return ""
    if isinstance(camera.disparity_error_px, float | int):
        return f"the disparity error is fixed at {declared_disparity_error(camera):.3g} px"
    return "the camera forms no picture at any distance of the study"


def _absent(camera: DepthCamera, pictured: Sequence[DepthCamera], slot: SlotName) -> str:
    """Why a picture lacks an effect; empty where some form of the camera has it."""
    if slot in ("microlens_diffraction", "crosstalk") and not camera.pictured_by_microlenses:
        return "the compared pictures are not taken through single microlenses" if camera.elements else NO_MICROLENSES
    laws = [(form, form.disparity_error_px) for form in pictured]
    complete = [complete_in_closed_form(form, law) for form, law in laws if isinstance(law, PictureDisparityError)]
    if slot == "spectrum" and complete and all(models.spectrum == OFF for models in complete):
        return "the study declares one wavelength"
    return ""

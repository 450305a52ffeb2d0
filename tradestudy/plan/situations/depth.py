"""Cameras that measure depth: what of picture and calibration their depth uncertainty calls for."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from tradestudy.analysis.depth import DepthErrors, depth_uncertainty, model_error
from tradestudy.analysis.linear_depth import has_covariance
from tradestudy.analysis.usable import SUBDIVISIONS, all_met, evaluate_limits, usable_ends, usable_stretches
from tradestudy.cameras.depth_camera import DepthCamera, Limit, UsableCriteria, declared_disparity_error
from tradestudy.cameras.picture_geometry import LensStage, PictureGeometry
from tradestudy.effects.base import OFF, Bound, EffectCriterion, Model, Slot, SlotName
from tradestudy.effects.depth_errors import EXACT, LINEAR, calibration_slot
from tradestudy.effects.picture_slots import (
    EXTENT_OF_POINTS,
    MARGIN,
    PIXEL_OVER_PITCH,
    Worst,
    blur_over_pixel,
    electrons,
    light_left,
    main_lens_airy,
    microlens_airy,
    reach_over_airy,
    spectrum_width,
)
from tradestudy.imaging.derived_error import PictureDisparityError
from tradestudy.optics.airy import FIRST_DARK_RING
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.plan.situations.pictures import PictureCase, picture_slots, worst_at, worst_of
from tradestudy.plan.situations.situation import Situation
from tradestudy.study.acting import acting, in_closed_form
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.document import Entry
from tradestudy.study.expectations import question_ends
from tradestudy.study.sweep import SweepAxis, quantity_entry, sweep_axes

# Bounds are looked for at this many of the study's distances; they change slowly in between, where the disparity error
# is derived by less than the margin.
_MOST_DISTANCES: Final = 401
_MOST_DERIVED: Final = 101
# Of every usable stretch: what a model changes swings with the blur, from focus to focus of several microlens types;
# from one trial to the next it stays within the margin.
_TRIAL_DISTANCES: Final = 15
_ENDS_ARE_KNOWN_TO: Final = 1e-2  # of their distance: trials go a tenth beyond
# Designs of a sweep that are weighed: all, or so many at most, evenly among each axis with its ends. Nothing goes
# steadily from end to end where a design between them is in focus and they are not.
_MOST_DESIGNS: Final = 64
_ENDS: Final = 2
# Values of what an inverse question varies, its ends among them.
_OF_QUESTIONS: Final = 5
_OF_MICROLENSES: Final[tuple[SlotName, ...]] = ("microlens_diffraction", "crosstalk")
# Bisections: of the ends of the usable range, and of a pair's decision under one reading.
_ASKED_FOR_ENDS: Final = 700
_ASKED_FOR_DECISION: Final = 4000
# On the reference machine: one distance of one camera, all errors, all limits.
_SECONDS_PER_DISTANCE: Final = 4e-5
_SECONDS_PER_DRAWN_DISTANCE: Final = 2e-3
_MOST_ASKED: Final = 4  # distances that a study asks about, at which the linear model is tried
_NEVER_TRIED: Final = Worst(value=math.inf, at=math.nan)


@dataclass(frozen=True, kw_only=True)
class _Variant:
    """A camera as one reading or one design of the study has it."""

    camera: DepthCamera
    criteria: UsableCriteria
    distance: FloatArray
    asked: tuple[float, ...]
    wavelength: float
    forced: Mapping[SlotName, str]

    @cached_property
    def as_forced(self) -> DepthCamera:
        """The camera with its calibration propagated, or left out, as the study insists."""
        return acting(self.camera, {"calibration": self.forced["calibration"]} if "calibration" in self.forced else {})

    @cached_property
    def limits(self) -> Mapping[str, Limit]:
        """Of the usable range, over the distances."""
        return evaluate_limits(self.as_forced, self.criteria, self.distance)

    @cached_property
    def usable(self) -> BoolArray:
        """At which of the distances the camera is usable."""
        return all_met(self.limits, self.distance.shape)

    @cached_property
    def imaged(self) -> FloatArray:
        """Distances where the camera forms a picture: curves are shown there, usable or not."""
        return self.distance[self.camera.images(self.distance)]

    @cached_property
    def uncertainty(self) -> FloatArray:
        """Depth uncertainty there, with everything that is not forced otherwise."""
        return depth_uncertainty(self.camera, self.imaged)


def depth_situations(definition: StudyDefinition, forced: Mapping[SlotName, str]) -> tuple[Situation, ...]:
    """One situation for each camera that measures depth, its bounds the worst over all variants of the study.

    Every slot is weighed beside the models that the study forces in the others.
    """
    variants = tuple(every_variant(definition))
    found = []
    for name in definition.case.cameras:
        own: list[_Variant] = []
        for variant in variants:
            one = _variant(variant, name, forced)
            if one is not None and not any(_same(one, other) for other in own):
                own.append(one)
        found.append(
            Situation(
                name=name,
                title=definition.file.cameras[name].title,
                quantities=("depth_uncertainty",),
                slots=(
                    *_picture(own, _times_asked(definition, name)),
                    _calibration(own, definition.case.distance.size),
                ),
            )
        )
    return tuple(found)


def every_variant(definition: StudyDefinition) -> Iterator[StudyDefinition]:
    """The study, its readings, the designs of its sweep, and some between the ends of its inverse questions."""
    yield definition
    yield from definition.readings.values()
    axes = sweep_axes(definition)
    for values in _designs(axes) if axes else ():
        yield definition.with_values({axis.path: value for axis, value in zip(axes, values, strict=True)})
    for question in definition.file.solve.values():
        dimension, low, high = question_ends(question)
        for value in np.linspace(low, high, _OF_QUESTIONS):
            yield definition.with_values(dict.fromkeys(question.paths, quantity_entry(float(value), dimension)))


def _designs(axes: Sequence[SweepAxis]) -> Iterator[tuple[Entry, ...]]:
    """Values of each axis, of every design that is weighed."""
    sizes = [len(axis.values) for axis in axes]
    while math.prod(sizes) > _MOST_DESIGNS and max(sizes) > _ENDS:
        sizes[sizes.index(max(sizes))] -= 1
    kept = [
        [axis.values[k] for k in np.unique(np.round(np.linspace(0, len(axis.values) - 1, size)).astype(int))]
        for axis, size in zip(axes, sizes, strict=True)
    ]
    return itertools.islice(itertools.product(*kept), _MOST_DESIGNS)


def _variant(definition: StudyDefinition, name: str, forced: Mapping[SlotName, str]) -> _Variant | None:
    camera = definition.case.cameras.get(name)
    if camera is None:  # a reading may replace it by one that measures no depth
        return None
    distance, file = definition.case.distance, definition.file
    most = _MOST_DERIVED if isinstance(camera.disparity_error_px, PictureDisparityError) else _MOST_DISTANCES
    step = max(1, -(-distance.size // most))
    asked = [*(() if file.decision is None else file.decision.at), *(one.at for one in file.solve.values())]
    asked += [end for one in file.requirements.values() for end in one.depth_uncertainty.over]
    own = _applicable(camera, forced)
    # Where to weigh is found in closed form, and with every error of calibration.
    sought = in_closed_form({slot: name for slot, name in own.items() if slot != "calibration"})
    if not has_covariance(camera):
        sought["calibration"] = EXACT
    return _Variant(
        camera=acting(camera, sought),
        criteria=definition.case.criteria,
        distance=np.unique(np.append(distance[::step], distance[-1:])),
        asked=tuple(asked),
        wavelength=definition.case.wavelength,
        forced=own,
    )


def _applicable(camera: DepthCamera, forced: Mapping[SlotName, str]) -> dict[SlotName, str]:
    """The forced models that a camera has: not of microlenses without them, nor of a spectrum that is not declared.

    Nor those that are for spots: the boundary wave, for transfer functions have Fresnel's law in closed form, and
    coherent crosstalk.
    """
    law = camera.disparity_error_px
    found = {slot: name for slot, name in forced.items() if name not in ("boundary_wave", "coherent")}
    if isinstance(law, PictureDisparityError):
        if law.models.microlens_diffraction == OFF:
            for slot in _OF_MICROLENSES:
                found.pop(slot, None)
        if not law.settings.spectrum:
            found.pop("spectrum", None)
    return found


def _same(one: _Variant, other: _Variant) -> bool:
    return (
        one.camera == other.camera
        and one.criteria == other.criteria
        and np.array_equal(one.distance, other.distance)
        and (one.wavelength, one.asked) == (other.wavelength, other.asked)
    )


def _times_asked(definition: StudyDefinition, name: str) -> int:
    """At how many distances a run asks for the uncertainty of a camera, roughly: curves, ends, and the decision."""
    designs = math.prod(len(axis.values) for axis in sweep_axes(definition))
    asked = designs * (8 * definition.case.distance.size + _ASKED_FOR_ENDS)
    decision = definition.file.decision
    if decision is not None and name in decision.between:
        asked += _ASKED_FOR_DECISION * (1 + len(definition.readings))
    return asked


def _picture(variants: Sequence[_Variant], asked: int) -> tuple[Slot, ...]:
    """Slots of the picture: weighed where the disparity error is derived from it, all off where it is declared."""
    derived = [_picture_case(variant) for variant in variants]
    found = [case for case in derived if case is not None and case.places.size]
    if found:
        return picture_slots(found, asked=asked)
    first = variants[0]
    if isinstance(first.camera.disparity_error_px, float | int):
        reason = (
            f"the disparity error is declared, {declared_disparity_error(first.camera):g} px, and stands for the whole "
            "picture; what blurs, mixes or dims the picture reaches depth only if it is derived"
        )
    else:
        reason = "the camera forms no picture at any distance of the study"
    return tuple(
        Slot(
            name=name,
            models=(
                Model(
                    name=OFF,
                    bounds={"depth_uncertainty": Bound(relative_change=0.0, criterion=strength, reason=reason)},
                ),
            ),
        )
        for name, strength in _strengths(variants).items()
    )


def _strengths(variants: Sequence[_Variant]) -> dict[SlotName, EffectCriterion]:
    """How strong each effect is in the picture where it is strongest, whether it reaches depth or not.

    Of usable distances; of all that are pictured, for a camera that is usable nowhere.
    """
    anywhere = any(variant.usable.any() for variant in variants)
    pictures = [(one, one.distance[one.usable] if anywhere else one.imaged) for one in variants]
    seen = [(one, places, one.camera.picture_geometry(places)) for one, places in pictures if places.size]

    def strongest(size: Callable[[PictureGeometry, float], FloatArray]) -> Worst:
        return worst_of(worst_at(places, size(geometry, one.wavelength)) for one, places, geometry in seen)

    blur = strongest(lambda geometry, _wavelength: geometry.blur_px)
    main_lens = strongest(lambda geometry, wavelength: _airy_px(geometry, geometry.main_lens, wavelength))
    microlens = strongest(lambda geometry, wavelength: _airy_px(geometry, geometry.microlens, wavelength))
    reach = strongest(
        lambda geometry, wavelength: np.asarray(
            _airy_px(geometry, geometry.microlens, wavelength) * math.sqrt(2.0) / geometry.widest_window_px
        )
    )
    return {
        "defocus_blur": blur_over_pixel(value=blur.value, at=blur.at),
        "main_lens_diffraction": main_lens_airy(value=main_lens.value, at=main_lens.at),
        "microlens_diffraction": microlens_airy(value=microlens.value, at=microlens.at),
        "crosstalk": reach_over_airy(value=1.0 / reach.value, at=reach.at),
        "pixel_integration": PIXEL_OVER_PITCH,
        "source_extent": EXTENT_OF_POINTS,
        "spectrum": spectrum_width(value=math.nan),
        "vignetting": light_left(value=math.nan),
        "sensor_noise": electrons(value=math.nan),
    }


def _airy_px(geometry: PictureGeometry, stage: LensStage | None, wavelength: float) -> FloatArray:
    """Airy radius of a lens on the sensor [samples]; NaN without it."""
    if stage is None:
        return np.full(geometry.distance.shape, math.nan)
    return np.asarray(FIRST_DARK_RING * wavelength * stage.f_number * stage.relay / geometry.sample_pitch)


def _picture_case(variant: _Variant) -> PictureCase | None:
    law = variant.camera.disparity_error_px
    if not isinstance(law, PictureDisparityError):
        return None
    places = _trial_places(variant)
    # Over the distances of the study as its limits had them, whose pictures are known.
    counts = variant.usable if variant.usable.any() else variant.camera.images(variant.distance)
    everywhere, tried = (DepthErrors.of(variant.as_forced, asked) for asked in (variant.distance, places))
    errors = [(everywhere, counts), (tried, np.ones(places.shape, dtype=bool))]
    # Where calibration loses the far end of depth, noise alone may not, and is shown by itself.
    lost = np.concatenate([one.distance[at & np.isinf(one.uncertainty)] for one, at in errors])
    if lost.size:
        errors.append((DepthErrors.of(variant.as_forced, lost, "noise"), np.ones(lost.shape, dtype=bool)))
    return PictureCase(
        camera=variant.as_forced,
        settings=law.settings,
        places=places,
        forced=variant.forced,
        errors=tuple(errors),
        shown=np.union1d(variant.imaged, _around_ends(variant)),
    )


def _around_ends(variant: _Variant) -> FloatArray:
    """Distances [m] between which the ends of the usable range are sought first."""
    first = np.flatnonzero(variant.usable[1:] != variant.usable[:-1])
    sought = np.linspace(variant.distance[first], variant.distance[first + 1], SUBDIVISIONS + 1).ravel()
    return sought[variant.camera.images(sought)]


def _trial_places(variant: _Variant) -> FloatArray:
    """Across every usable interval and a tenth beyond, as leaving blur out would extend it, and wherever is asked.

    And where the picture is the sharpest, for there what pixels and diffraction do is seen the best.
    """
    camera, distance = variant.as_forced, variant.distance
    found = [np.asarray(variant.asked), _in_focus(variant)]
    ends = usable_ends(camera, variant.criteria, distance, variant.limits, to=_ENDS_ARE_KNOWN_TO)
    for near, far in usable_stretches(ends, distance, variant.usable):
        found.append(np.geomspace(0.9 * near, 1.1 * far, _TRIAL_DISTANCES))
        found.append(np.array([near, far]))
    if not variant.usable.any():
        found.append(distance[np.unique(np.linspace(0, distance.size - 1, _TRIAL_DISTANCES).astype(int))])
    places = np.unique(np.concatenate(found))
    return places[camera.images(places)]


def _in_focus(variant: _Variant) -> FloatArray:
    """Usable distances of least blur [m]: several where microlenses have several focal lengths."""
    distance = variant.distance[variant.usable]
    if not distance.size:
        return distance
    blur = np.pad(variant.camera.picture_geometry(distance).blur_px, 1, constant_values=math.inf)
    return distance[(blur[1:-1] < blur[:-2]) & (blur[1:-1] <= blur[2:])]


def _calibration(variants: Sequence[_Variant], distances: int) -> Slot:
    """The slot of calibration, held against the camera with everything."""
    calibrations = [variant.camera.calibration for variant in variants]
    known = all(calibration.inferred for calibration in calibrations)
    tried = worst_of(_linear_error(variant) for variant in variants) if known else _NEVER_TRIED
    return calibration_slot(
        share_of_uncertainty=max(map(_share_of_calibration, variants)) if known else math.inf,
        linear_error=tried.value,
        at=tried.at,
        exact_seconds=distances * _SECONDS_PER_DRAWN_DISTANCE,
        are_declared=not known or any(calibration.groups for calibration in calibrations),
    )


def _linear_error(variant: _Variant) -> Worst:
    """The largest departure of the linear model from draws, at a few distances of most and of least uncertainty.

    At the ends and in the middle of what is usable, where the uncertainty is the largest share of the distance, and
    wherever the study asks.
    """
    camera, places = acting(variant.camera, {"calibration": LINEAR}), variant.distance[variant.usable]
    asked = np.array(variant.asked[:_MOST_ASKED])
    asked = asked[camera.images(asked)]
    if not has_covariance(camera):  # no line exists
        return _NEVER_TRIED
    if not camera.calibration.groups or not (places.size or asked.size):
        return Worst(value=0.0, at=math.nan)
    tried = np.unique(np.append(asked, places[[0, places.size // 2, -1]])) if places.size else np.unique(asked)
    if places.size:
        relative = depth_uncertainty(camera, places) / places
        tried = np.union1d(tried, places[[int(np.nanargmax(np.where(np.isfinite(relative), relative, 0.0)))]])
    error = model_error(camera, tried).intervals
    return worst_at(tried, np.where(np.isnan(error), 0.0, error))


def _share_of_calibration(variant: _Variant) -> float:
    """1 − u(noise)/u(both), the largest where a picture is formed; a lost far end counts as the whole.

    With a margin where the noise beside it is derived and its own models may move it.
    """
    if not variant.camera.calibration.groups:
        return 0.0
    without = depth_uncertainty(variant.camera, variant.imaged, "noise")
    with np.errstate(invalid="ignore"):  # infinite over infinite: the far end is lost without it as well
        share = 1.0 - np.where(np.isinf(without), 1.0, without / variant.uncertainty)
    derived = isinstance(variant.camera.disparity_error_px, PictureDisparityError)
    return min(1.0, (MARGIN if derived else 1.0) * float(np.nanmax(share, initial=0.0)))

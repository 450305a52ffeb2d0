"""Pictures that a disparity error is derived from: every model tried in closed form, one slot at a time."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np

from tradestudy.analysis.depth import DepthErrors
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cameras.picture_geometry import LensStage, PictureGeometry
from tradestudy.effects.base import Slot, SlotName
from tradestudy.effects.picture_slots import (
    PictureTrial,
    Worst,
    crosstalk,
    defocus_blur,
    diffraction,
    pixel_integration,
    sensor_noise,
    source_extent,
    spectrum,
    vignetting,
)
from tradestudy.imaging.light import field_illumination, mean_electrons, noise_variance
from tradestudy.imaging.models import PictureModels, PictureSettings
from tradestudy.imaging.optical_transfer import kirchhoff_defocus
from tradestudy.imaging.picture import WeighedPicture, disparity_bound_px
from tradestudy.optics.airy import FIRST_DARK_RING
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.study.acting import in_closed_form, with_models

# On the reference machine [s]: for every distance at which a run asks for the error; and for every point of the lattice
# that Kirchhoff's part is interpolated on, whose spot takes more places and nodes the wider it is: coefficients of
# powers of its defocus in waves.
_SECONDS_PER_DISTANCE: Final = {
    "fresnel": 6e-5,
    "airy": 1e-5,
    "disc": 1e-5,
    "share": 2e-5,
    "weighted": 1e-4,
    "kirchhoff": 1e-3,
}
_SECONDS_PER_POINT: Final = (9.5e-3, 3.7e-3, 4.7e-4)
_ROUNDING: Final = 1e-12  # of a cube of an inverse distance: where the plane is that of the image there is no more


@dataclass(frozen=True, kw_only=True)
class PictureCase:
    """A camera with a derived disparity error, at places [m] that count, under the models that are forced.

    Parameters
    ----------
    errors
        Of its depth, and at which of their distances an uncertainty counts; of noise alone where all errors together
        leave none.
    shown
        Distances [m] that a run asks for.
    """

    camera: DepthCamera
    settings: PictureSettings
    places: FloatArray
    forced: Mapping[SlotName, str]
    errors: tuple[tuple[DepthErrors, BoolArray], ...]
    shown: FloatArray
    _known: dict[PictureModels, FloatArray] = field(default_factory=dict, init=False, compare=False)

    @cached_property
    def geometry(self) -> PictureGeometry:
        """At the places."""
        return self.camera.picture_geometry(self.places)

    @property
    def complete(self) -> PictureModels:
        """The most complete models in closed form."""
        return PictureModels(
            defocus_blur="disc",
            main_lens_diffraction="fresnel",
            microlens_diffraction="off" if self.geometry.microlens is None else "fresnel",
            crosstalk="off" if self.geometry.microlens is None else "share",
            pixel_integration="square",
            spectrum="weighted" if self.settings.spectrum else "off",
            vignetting="cos4",
            sensor_noise="shot+read+quantisation",
        )

    def change(self, slot: SlotName, name: str) -> float:
        """Relative change of the disparity error if one slot takes another model, the largest over the places."""
        standing = self._standing(slot)
        models = with_models(standing, {slot: name})
        return 0.0 if models == standing else _departure(self._bound_px(standing), self._bound_px(models))

    def _standing(self, slot: SlotName) -> PictureModels:
        """What a slot is weighed beside: the models that are forced elsewhere, and the most complete of the others.

        In closed form, so that nothing has to be integrated.
        """
        beside = {other: name for other, name in self.forced.items() if other != slot}
        return with_models(self.complete, in_closed_form(beside))

    def _bound_px(self, models: PictureModels) -> FloatArray:
        if models not in self._known:
            self._known[models] = self._weighed.bound_px(models)
        return self._known[models]

    @cached_property
    def _weighed(self) -> WeighedPicture:
        return WeighedPicture(geometry=self.geometry, settings=self.settings)

    @property
    def illumination(self) -> float:
        """Light left at the field angle."""
        return float(
            field_illumination(
                self.settings.field_angle,
                pupil_diameter=self.geometry.pupil_diameter,
                stop_separation=self.settings.stop_separation,
            )
        )

    @property
    def electrons(self) -> Worst:
        """Fewest per pixel, at the edge of the field that is asked for."""
        geometry = self.geometry
        found = mean_electrons(self.settings.light, geometry.light_f_number, geometry.pixel_pitch, self.illumination)
        least = worst_at(self.places, -found)
        return Worst(value=-least.value, at=least.at)

    def airy_px(self, stage: LensStage | None) -> Worst:
        """Largest Airy radius of a lens on the sensor [samples]."""
        if stage is None:
            return Worst(value=math.nan)
        radius = FIRST_DARK_RING * self.settings.wavelength * stage.f_number * stage.relay
        return worst_at(self.places, np.asarray(radius / self.geometry.sample_pitch))

    def reach_airy(self) -> Worst:
        """Half a micro-image over the largest Airy radius of a microlens; infinite without microlenses."""
        if self.geometry.microlens is None:
            return Worst(value=math.inf)
        airy = self.airy_px(self.geometry.microlens)
        return Worst(value=self.geometry.widest_window_px / math.sqrt(2.0) / airy.value, at=airy.at)

    def aberration(self, stage: LensStage | None) -> Worst:
        """Path at the rim, ``R⁴/8 (…)`` [waves]; a corrected lens leaves only what defocus makes of it."""
        if stage is None:
            return Worst(value=0.0)
        rim = (stage.aperture_diameter / 2.0) ** 4 / 8.0 / self.settings.wavelength
        there = np.abs(1.0 / stage.plane_distance**3)
        if self.settings.lens_phase == "parabolic":
            return worst_at(self.places, rim * (there + np.abs(1.0 / stage.object_distance**3)))
        focused = np.abs(1.0 / stage.focal_length - 1.0 / stage.object_distance) ** 3
        apart = np.abs(there - focused)
        return worst_at(self.places, rim * np.where(apart > _ROUNDING * there, apart, 0.0))

    def paraxial_change(self, stage: LensStage | None) -> float:
        """Relative change of the disparity error by what Fresnel leaves out of a lens, the largest over the places.

        Spherical aberration of W waves at the rim, balanced, is a defocus of W waves: a blur wider or narrower by
        ``8 λ N W``. Wider changes more; the rest of the aberration, a thirteenth, is left to the margin.
        """
        waves = self.aberration(stage).value
        if stage is None or waves == 0.0:
            return 0.0
        is_main = stage is self.geometry.main_lens
        standing = self._standing("main_lens_diffraction" if is_main else "microlens_diffraction")
        # Aberration blurs what is in focus as well, where a study insists that everything is.
        geometry = self.geometry if standing.defocus_blur == "disc" else self.geometry.in_focus()
        own = geometry.main_lens if is_main else geometry.microlens
        assert own is not None  # as the stage that was given is
        wider = own.blur_diameter + 8.0 * self.settings.wavelength * own.f_number * waves
        moved = replace(own, blur_diameter=wider)
        geometry = replace(geometry, main_lens=moved) if is_main else replace(geometry, microlens=moved)
        blurred = with_models(standing, {"defocus_blur": "disc"})
        return _departure(self._bound_px(standing), disparity_bound_px(geometry, self.settings, blurred))

    def depth_change(self, change: float) -> float:
        """Relative change of the depth uncertainty that such a one of the disparity error makes at most.

        Calibration, which does not change, is counted as if it did.
        """
        if change == 0.0 or math.isinf(change):
            return change
        largest = (float(np.nanmax(one.largest_change(change)[at], initial=0.0)) for one, at in self.errors)
        return max(change, *largest)

    def obliquity(self, stage: LensStage | None) -> float:
        """``1 − cos²θ`` at the rim: the cosine, and the longer way."""
        if stage is None:
            return 0.0
        half = stage.aperture_diameter / 2.0
        return float(np.nanmax(half**2 / (half**2 + stage.plane_distance**2)))


def _departure(reference: FloatArray, value: FloatArray) -> float:
    """Relative change of a disparity error, the largest over the places."""
    with np.errstate(divide="ignore", invalid="ignore"):  # where nothing passes either is infinite
        found = np.abs(value / reference - 1.0)
    found = np.where(np.isinf(reference) & np.isfinite(value), np.inf, found)
    return float(np.max(np.where(np.isnan(found), 0.0, found), initial=0.0))


def picture_slots(cases: Sequence[PictureCase], *, asked: int) -> tuple[Slot, ...]:
    """Slots of the picture of one camera, weighed over every variant of it; costs are for so many distances asked."""
    stages = [(case, case.geometry.main_lens, case.geometry.microlens) for case in cases]
    noise = [_noise_shares(case) for case in cases]

    pictured = [(case.settings, case.camera.picture_geometry(case.shown)) for case in cases]

    spectra = [([one for one, _ in case.settings.spectrum], case.settings.wavelength) for case in cases]
    widths = [(max(lines) - min(lines)) / centre for lines, centre in spectra if lines]
    trial = PictureTrial(
        change=lambda slot, name: max(case.change(slot, name) for case in cases),
        blur_px=worst_of(worst_at(case.places, case.geometry.blur_px) for case in cases),
        main_lens_airy_px=worst_of(case.airy_px(main) for case, main, _ in stages),
        microlens_airy_px=worst_of(case.airy_px(micro) for case, _, micro in stages),
        lens_phases=sorted({case.settings.lens_phase for case in cases}),
        aberration_waves=(
            worst_of(case.aberration(main) for case, main, _ in stages),
            worst_of(case.aberration(micro) for case, _, micro in stages),
        ),
        paraxial_change=(
            max(case.paraxial_change(main) for case, main, _ in stages),
            max(case.paraxial_change(micro) for case, _, micro in stages),
        ),
        obliquity=(
            max(case.obliquity(main) for case, main, _ in stages),
            max(case.obliquity(micro) for case, _, micro in stages),
        ),
        electrons=min((case.electrons for case in cases), key=lambda one: one.value),
        illumination=min(case.illumination for case in cases),
        read_noise_share=max(read for read, _ in noise),
        quantisation_share=max(rounding for _, rounding in noise),
        spectrum_width=max(widths, default=math.nan),
        microlens_reach_airy=min((case.reach_airy() for case in cases), key=lambda one: one.value),
        depth_change=lambda change: max(case.depth_change(change) for case in cases),
        seconds=lambda name: _SECONDS_PER_DISTANCE.get(name, 0.0) * asked,
        lattice_seconds=(
            _lattice_seconds((settings, geometry.main_lens) for settings, geometry in pictured),
            _lattice_seconds((settings, geometry.microlens) for settings, geometry in pictured),
        ),
    )
    return (
        defocus_blur(trial),
        diffraction(trial, "main_lens_diffraction"),
        diffraction(trial, "microlens_diffraction"),
        crosstalk(trial),
        pixel_integration(trial),
        source_extent(trial),
        spectrum(trial),
        vignetting(trial),
        sensor_noise(trial),
    )


def _lattice_seconds(lenses: Iterable[tuple[PictureSettings, LensStage | None]]) -> float:
    """What the lattices of Kirchhoff's transfer take for lenses of variants; those that share one compute it once."""
    lattices: dict[tuple[float, float, bytes], float] = {}
    for settings, lens in lenses:
        if lens is None:
            continue
        lengths = np.stack([lens.focal_length, lens.plane_distance, lens.object_distance]).tobytes()
        for wavelength in [one for one, _ in settings.spectrum] or [settings.wavelength]:
            key = (wavelength, lens.aperture_diameter, lengths)
            waves = np.abs(kirchhoff_defocus(lens, wavelength))
            lattices[key] = float(np.sum(np.polynomial.polynomial.polyval(waves, _SECONDS_PER_POINT)))
    return math.fsum(lattices.values())


def worst_at(places: FloatArray, values: FloatArray) -> Worst:
    """The largest over places [m], and where it is; nowhere if it is the same everywhere. NaN where all are."""
    spread = np.broadcast_to(values, places.shape)
    if np.isnan(spread).all():
        return Worst(value=math.nan)
    index = int(np.nanargmax(spread))
    same = bool(np.nanmin(spread) == spread[index])
    return Worst(value=float(spread[index]), at=math.nan if same else float(places[index]))


def worst_of(found: Iterable[Worst]) -> Worst:
    """The largest of several; NaN only where none has a value."""
    return max(found, key=lambda one: -math.inf if math.isnan(one.value) else one.value, default=Worst(value=math.nan))


def _noise_shares(case: PictureCase) -> tuple[float, float]:
    """Share of read noise and of rounding in the noise power of the darkest pixel."""
    sensor, electrons = case.settings.sensor_noise, case.electrons.value
    shot, read, everything = (
        float(noise_variance(electrons, sensor, model)) for model in ("shot", "shot+read", "shot+read+quantisation")
    )
    return (read - shot) / everything, (everything - read) / everything

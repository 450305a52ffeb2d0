"""How far exact paths and cosines move a disparity error derived by Fresnel's transfer: a closed rule, and a trial."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from tradestudy.cameras.picture_geometry import LensStage, PictureGeometry
from tradestudy.effects import LENSES, OFF, Models, SlotName
from tradestudy.imaging.models import PictureModels, PictureSettings
from tradestudy.imaging.optical_transfer import is_by_rays
from tradestudy.imaging.picture import WeighedPicture, disparity_bound_px
from tradestudy.optics.arrays import FloatArray, IndexArray
from tradestudy.study.building import with_models

ErrorPx = Callable[[Models], FloatArray]
"""Disparity error [samples] over distances, with some models replaced."""
# Set by 150 random cameras, at the places where the rule is tightest.
_MARGIN: Final = 2.0
_TRANSFER_ERROR: Final = 2e-4  # of Kirchhoff's transfer, with which Fresnel's is compared
_NARROWER: Final = 0.5  # width of a disc of rays per sin² θ


def change_by_exact_paths(
    geometry: PictureGeometry,
    settings: PictureSettings,
    models: PictureModels,
    error_px: ErrorPx,
) -> tuple[FloatArray, FloatArray]:
    """Estimate, with a margin, how far Kirchhoff's law at either lens moves a disparity error found by Fresnel's.

    Fresnel's law leaves out two things. One is the excess path at the rim, which acts like a defocus once balanced. The
    other is the angle θ of the rays at the rim: amplitude falls by ε = sin² θ towards it, and the cutoff is 2 sin θ/λ,
    ε/2 below 1/(λ N). Both together increase the logarithmic loss of contrast by diffraction by the share ε, and
    therefore what diffraction adds to the error by the same share.

    Parameters
    ----------
    geometry, settings, models
        The picture; the models are the most complete in closed form.
    error_px
        Disparity error over the distances of the geometry.

    Returns
    -------
    tuple
        Relative changes by the main lens and by the microlenses, over distance; zero without microlenses.
    """
    main = _aberrated(geometry.main_lens, settings)
    moved = replace(geometry, main_lens=main)
    by_main_lens = _of_stage(geometry.main_lens, main, moved, settings, models, error_px, "main_lens_diffraction")
    if geometry.microlens is None:
        return by_main_lens, np.zeros(geometry.distance.shape)
    micro = _aberrated(geometry.microlens, settings)
    moved = replace(geometry, microlens=micro)
    return by_main_lens, _of_stage(
        geometry.microlens, micro, moved, settings, models, error_px, "microlens_diffraction"
    )


def _of_stage(
    stage: LensStage,
    aberrated: LensStage,
    moved: PictureGeometry,
    settings: PictureSettings,
    models: PictureModels,
    error_px: ErrorPx,
    slot: SlotName,
) -> FloatArray:
    """The change by one lens; ``moved`` is the picture with that lens aberrated."""
    error, without_diffraction = error_px({}), error_px({slot: OFF})
    by_paths, other = np.zeros(error.shape), np.flatnonzero(aberrated.blur_diameter != stage.blur_diameter)
    with np.errstate(invalid="ignore", divide="ignore"):
        by_diffraction = np.minimum(1.0, np.abs(without_diffraction / error - 1.0))
        if other.size:
            blurred = disparity_bound_px(moved.at(other), settings, with_models(models, {"defocus_blur": "disc"}))
            by_paths[other] = np.abs(blurred / error[other] - 1.0)
    return np.asarray(_MARGIN * (by_paths + _obliquity(stage) * by_diffraction) + _TRANSFER_ERROR)


def _aberrated(stage: LensStage, settings: PictureSettings) -> LensStage:
    """The lens with its blur changed by exact paths and angles.

    Light that falls off by ε = sin² θ towards the rim makes the disc of rays narrower by about ε/2. Spherical
    aberration of W waves at the rim, balanced, acts like a defocus of W waves, a blur of ``8 λ N W``; the margin covers
    the remaining thirteenth. A well-corrected lens has no spherical aberration: its rays meet in one point. A parabolic
    lens has ``W = R⁴/8 (1/b³ + 1/a³)/λ``.
    """
    # Far out of focus, both laws use the same disc of rays and differ by diffraction alone.
    by_waves = ~is_by_rays(stage.blur_diameter, settings.wavelength, stage.f_number)
    blur = stage.blur_diameter * (1.0 + _NARROWER * _obliquity(stage) * by_waves)
    if settings.lens_phase == "parabolic":
        rim = (stage.aperture_diameter / 2.0) ** 4 / 8.0
        path = rim * (np.abs(1.0 / stage.plane_distance**3) + np.abs(1.0 / stage.object_distance**3))
        blur = blur + 8.0 * stage.f_number * path
    return replace(stage, blur_diameter=blur)


def _obliquity(stage: LensStage) -> FloatArray:
    """sin² θ of the rays at the rim."""
    half = stage.aperture_diameter / 2.0
    return np.asarray(half**2 / (half**2 + stage.plane_distance**2))


def places_to_try(weight: FloatArray, blur_px: FloatArray) -> IndexArray:
    """Up to four places to try: where the rule's change of the uncertainty is largest, the sharpest, and two others.

    Changes oscillate with defocus, and can pass through zero where the rule is largest. Of places no more blurred than
    that one, the third is where the rule comes closest to halfway between the other two. The fourth has the largest
    change by the rule on the other side of the sharpest, where other blurs occur.

    Parameters
    ----------
    weight, blur_px
        Relative change of the uncertainty by the rule, and blur [samples], over places by rising distance.
    """
    weight = np.nan_to_num(weight, posinf=1.0)
    largest, sharpest = int(np.argmax(weight)), int(np.nanargmin(blur_px))
    from_halfway = np.abs(weight - (weight[largest] + weight[sharpest]) / 2.0)
    between = int(np.argmin(np.where(blur_px <= blur_px[largest], from_halfway, np.inf)))
    number = np.arange(weight.size)
    beyond = number >= sharpest if largest < sharpest else number <= sharpest
    other = int(np.argmax(np.where(beyond, weight, -np.inf)))
    return np.unique([largest, between, sharpest, other])


def tried_change(geometry: PictureGeometry, settings: PictureSettings, models: PictureModels) -> FloatArray:
    """Relative size of the change of the disparity error by Kirchhoff's law at all lenses, over distance.

    In light of the mean wavelength: a spectrum would only average over the defocus, in which the tried places differ.
    """
    if models.spectrum != OFF:
        wavelengths, weights = np.array(settings.spectrum).T
        settings = replace(settings, wavelength=float(np.average(wavelengths, weights=weights)))
    fresnel = replace(models, spectrum=OFF)
    exact = with_models(fresnel, {name: "kirchhoff" for name in LENSES if getattr(models, name) != OFF})
    picture = WeighedPicture(geometry=geometry, settings=settings, interpolated=False)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.abs(picture.bound_px(exact) / picture.bound_px(fresnel) - 1.0))

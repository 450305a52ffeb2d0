"""A closed-form estimate of how far exact paths and cosines move a disparity error derived by Fresnel's transfer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from tradestudy.cameras.picture_geometry import LensStage, PictureGeometry
from tradestudy.effects.models import OFF, Models, SlotName
from tradestudy.imaging.models import PictureModels, PictureSettings
from tradestudy.imaging.optical_transfer import is_by_rays
from tradestudy.imaging.picture import disparity_bound_px
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.acting import with_models

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
    main, microlens = geometry.main_lens, geometry.microlens
    moved = replace(geometry, main_lens=_aberrated(main, settings))
    by_main_lens = _of_stage(main, moved, settings, models, error_px, "main_lens_diffraction")
    if microlens is None:
        return by_main_lens, np.zeros(geometry.distance.shape)
    moved = replace(geometry, microlens=_aberrated(microlens, settings))
    return by_main_lens, _of_stage(microlens, moved, settings, models, error_px, "microlens_diffraction")


def _of_stage(
    stage: LensStage,
    aberrated: PictureGeometry,
    settings: PictureSettings,
    models: PictureModels,
    error_px: ErrorPx,
    slot: SlotName,
) -> FloatArray:
    error, without_diffraction = error_px({}), error_px({slot: OFF})
    with np.errstate(invalid="ignore", divide="ignore"):
        by_diffraction = np.minimum(1.0, np.abs(without_diffraction / error - 1.0))
        blurred = disparity_bound_px(aberrated, settings, with_models(models, {"defocus_blur": "disc"}))
        by_paths = np.abs(blurred / error - 1.0)
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

"""Transfer of all lenses of a camera together: each by the model chosen for it, over the spectrum chosen."""

from __future__ import annotations

from typing import assert_never

import numpy as np

from tradestudy.imaging.geometry import LensStage, PictureGeometry
from tradestudy.imaging.models import DefocusModel, DiffractionModel, PictureModels, PictureSettings
from tradestudy.imaging.transfer import airy_transfer, disc_transfer, fresnel_transfer, kirchhoff_transfers
from tradestudy.optics.arrays import FloatArray

_MOST_BLUR_OF_WAVES = 200.0


def optical_transfer(
    geometry: PictureGeometry, settings: PictureSettings, models: PictureModels, frequency_px: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Transfer of the lenses, without the pixel, at |ν| [cycles/sample]; shape (distances, frequencies), and its error.

    With the model ``weighted`` it is the mean over the spectrum of the product of all stages; thin lenses focus all
    colours alike.
    """
    spectrum = settings.spectrum if models.spectrum == "weighted" else ((settings.wavelength, 1.0),)
    total = sum(weight for _, weight in spectrum)
    shape = (geometry.distance.size, frequency_px.size)
    transfer, error = np.zeros(shape), np.zeros(shape[0])
    for wavelength, weight in spectrum:
        passed = np.ones(shape)
        for stage, model in (
            (geometry.main_lens, models.main_lens_diffraction),
            (geometry.microlens, models.microlens_diffraction),
        ):
            if stage is not None:
                found, off = _stage_transfer(
                    stage, model, models.defocus_blur, settings, wavelength, frequency_px / geometry.sample_pitch
                )
                passed *= found
                error += weight / total * off
        transfer += weight / total * passed
    return transfer, error


def _stage_transfer(
    stage: LensStage,
    model: DiffractionModel,
    defocus: DefocusModel,
    settings: PictureSettings,
    wavelength: float,
    frequency: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Of one lens at frequencies on the sensor [cycles/m], and its error over distance."""
    nu = frequency * stage.relay[:, np.newaxis]
    N = stage.f_number[:, np.newaxis]
    blur = (stage.blur_diameter if defocus == "disc" else np.zeros_like(stage.blur_diameter))[:, np.newaxis]
    exact = np.zeros(stage.relay.size)
    blurred = np.any(blur != 0.0)
    # Far out of focus rays err by less than 0.2 √(λN/c), and waves would take ever more nodes for what is not matched.
    by_rays = blur > _MOST_BLUR_OF_WAVES * wavelength * N
    match model:
        case "none":
            return (disc_transfer(nu, blur) if blurred else np.ones_like(nu)), exact
        case "airy":
            spread = airy_transfer(nu, wavelength, N)
            return (spread * disc_transfer(nu, blur) if blurred else spread), exact
        case "fresnel":
            value, error = fresnel_transfer(nu, wavelength, N, np.where(by_rays, 0.0, blur)), exact
        case "kirchhoff":
            value, error = kirchhoff_transfers(
                nu,
                wavelength=wavelength,
                aperture_diameter=stage.aperture_diameter,
                focal_length=stage.focal_length,
                plane_distance=stage.plane_distance,
                defocus_waves=np.where((blur == 0.0) | by_rays, 0.0, stage.defocus(wavelength)[:, np.newaxis])[:, 0],
                lens_phase=settings.lens_phase,
            )
        case _:
            assert_never(model)
    far = by_rays[:, 0]
    if np.any(far):
        value[far] *= disc_transfer(nu[far], blur[far])
        error = np.where(far, error + 0.2 * np.sqrt(wavelength * N[:, 0] / np.where(far, blur[:, 0], 1.0)), error)
    return value, error

"""Pictures in plain pixels: no camera, a blur and a texture in units of the pixel."""

from __future__ import annotations

import numpy as np

from tests.imaging.matcher import Scene
from tradestudy.cameras.picture_geometry import LensStage, PictureGeometry, WholePictures
from tradestudy.imaging.models import Light, PictureModels, PictureSettings, SensorNoise, Texture
from tradestudy.imaging.picture import DerivedDisparityError, disparity_error_px

RAYS = PictureModels(
    defocus_blur="disc",
    main_lens_diffraction="off",
    microlens_diffraction="off",
    crosstalk="off",
    pixel_integration="square",
    spectrum="off",
    vignetting="off",
    sensor_noise="shot+read",
)


def unit_geometry(blur_px: float, f_number: float = 1.0) -> PictureGeometry:
    """A picture at magnification 1 on samples of 1 m, so that lengths on the object are pixels."""
    one = np.ones(1)
    stage = LensStage(
        aperture_diameter=1.0 / f_number,
        focal_length=one,
        object_distance=one,
        plane_distance=one,
        blur_diameter=blur_px * one,
        relay=one,
    )
    return PictureGeometry(
        distance=one,
        magnification=one,
        sample_pitch=1.0,
        sample_width=1.0,
        sample_shape="square",
        pixel_pitch=1.0,
        compared=WholePictures(side_px=1e4 * one),
        light_f_number=one * f_number,
        pupil_diameter=1.0 / f_number,
        main_lens=stage,
        microlens=None,
    )


def bound_of(scene: Scene) -> DerivedDisparityError:
    """The program's bound for a drawn scene, its noise given as read noise beside the shot noise."""
    settings = PictureSettings(
        texture=Texture(contrast=scene.contrast, correlation_length=scene.length_px),
        light=Light(electrons=scene.electrons, f_number=1.0),
        sensor_noise=SensorNoise(
            read_noise_electrons=(scene.noise**2 - scene.electrons) ** 0.5, full_well_electrons=1e9, bits=16
        ),
        wavelength=1e-9,
        window_px=scene.window,
    )
    return disparity_error_px(unit_geometry(scene.blur_px), settings, RAYS)

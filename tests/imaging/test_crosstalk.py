"""Light of neighbouring micro-images against an Airy pattern on a grid, and against what encircles its energy."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy.fft import irfft2, rfft2
from scipy.special import j0, j1

from tests.cameras.builders import r5, stereo
from tests.imaging.test_picture import SETTINGS
from tradestudy.cameras.picture_geometry import MatchedWindow, PictureGeometry
from tradestudy.imaging.models import PictureModels, closed_form_models, neighbours_share
from tradestudy.imaging.passed_texture import matched_window
from tradestudy.imaging.picture import disparity_error_px
from tradestudy.optics.arrays import FloatArray

WAVELENGTH = 550e-9
DISTANCE = np.array([0.3, 1.0])


def pictured() -> PictureGeometry:
    return r5().picture_geometry(DISTANCE)


def window(side_px: float, aside_px: float = 0.0) -> MatchedWindow:
    return MatchedWindow(side_px=np.full(2, side_px), apart_px=np.full(2, 2.0 * aside_px))


def micro_image_radius(geometry: PictureGeometry) -> float:
    return geometry.micro_image_diameter / 2.0


def test_the_middle_of_a_micro_image_loses_what_an_airy_pattern_holds_outside() -> None:
    geometry = pictured()
    assert geometry.microlens is not None
    v = np.pi * micro_image_radius(geometry) / (WAVELENGTH * geometry.microlens.f_number)
    found = neighbours_share(geometry, WAVELENGTH, window(1e-3), blurred=False)
    np.testing.assert_allclose(found, j0(v) ** 2 + j1(v) ** 2, rtol=1e-6)


@lru_cache(maxsize=2)
def light_on_a_grid(step: float, count: int, *, radius: float, f_number: float, blur: float) -> FloatArray:
    """The disc of a micro-image convolved with an Airy pattern, and with a disc of blur, if it has a diameter."""
    x = np.fft.fftfreq(count, 1.0 / count) * step
    r = np.hypot(x[:, np.newaxis], x)
    v = np.pi * np.maximum(r, 1e-12) / (WAVELENGTH * f_number)
    kernel = (2.0 * j1(v) / v) ** 2 * np.pi / 4.0 / (WAVELENGTH * f_number) ** 2 * step**2
    if blur:
        disc = (r <= blur / 2.0).astype(float)
        kernel = irfft2(rfft2(kernel) * rfft2(disc / disc.sum()), s=r.shape)
    return np.asarray(irfft2(rfft2(kernel) * rfft2((r <= radius).astype(float)), s=r.shape))


@pytest.mark.parametrize("blurred", [False, True])
@pytest.mark.parametrize(("window_px", "aside_px"), [(8.0, 0.0), (16.0, 0.0), (8.0, 4.0), (5.0, 8.0)])
def test_the_share_is_that_of_light_on_a_grid(window_px: float, aside_px: float, blurred: bool) -> None:
    """Light of a micro-image averaged over the window."""
    geometry = pictured()
    lens = geometry.microlens
    assert lens is not None
    blur_diameter = 3.0 * geometry.sample_pitch
    geometry = replace(geometry, microlens=replace(lens, blur_diameter=np.full(2, blur_diameter)))
    step, count, blur = 0.2e-6, 2048, blur_diameter if blurred else 0.0
    x = np.fft.fftfreq(count, 1.0 / count) * step
    radius, f_number = micro_image_radius(geometry), float(lens.f_number[0])
    own = light_on_a_grid(step, count, radius=radius, f_number=f_number, blur=blur)
    seen = np.hypot(
        x[:, np.newaxis] - aside_px * geometry.sample_pitch, x
    ) <= window_px * geometry.sample_pitch / math.sqrt(math.pi)
    found = neighbours_share(geometry, WAVELENGTH, window(window_px, aside_px), blurred=blurred)
    assert found[0] == pytest.approx(1.0 - own[seen].mean(), rel=0.02)


def test_neighbours_dim_the_texture_by_their_share() -> None:
    """Where noise outweighs both textures, the error is that of a texture of less contrast."""
    geometry, dark = pictured(), replace(SETTINGS, light=replace(SETTINGS.light, electrons=100.0), window_px=16.0)
    models = closed_form_models(dark, microlenses=True)
    share = neighbours_share(geometry, WAVELENGTH, matched_window(geometry, dark, models), blurred=True)
    found = disparity_error_px(geometry, dark, models).value
    alone: PictureModels = replace(models, crosstalk="off")
    for k in range(2):
        texture = replace(dark.texture, contrast=dark.texture.contrast * (1.0 - float(share[k])))
        expected = disparity_error_px(geometry, replace(dark, texture=texture), alone).value[k]
        assert found[k] == pytest.approx(expected, rel=3e-4)
    assert np.all(found > 1.005 * disparity_error_px(geometry, dark, alone).value)


def test_a_camera_without_microlenses_has_no_neighbours() -> None:
    geometry = stereo().picture_geometry(DISTANCE)
    assert np.all(neighbours_share(geometry, WAVELENGTH, window(15.0), blurred=True) == 0.0)

"""A derived disparity error with one cause taken away: against limits in which that cause is gone by itself."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.cameras.builders import r5
from tests.imaging.scenes import RAYS, unit_geometry
from tests.imaging.test_picture import CLOSED, SETTINGS, hand_lens
from tradestudy.errors import OutOfRangeError
from tradestudy.imaging.models import Light, SensorNoise, Texture
from tradestudy.imaging.picture import CHANGES, disparity_error_px, error_causes

FRESNEL = replace(CLOSED, main_lens_diffraction="fresnel")
FOCUS = 55e-3


def causes(camera, distance, settings=SETTINGS, models=FRESNEL, brightest=math.nan):
    return error_causes(camera.picture_geometry(np.atleast_1d(distance)), settings, models, brightest)


def factor(found, change: str):
    return found.value / found.changed[CHANGES.index(change)]


def test_nothing_counts_in_focus_where_light_is_all_rays() -> None:
    found = causes(hand_lens(5.6), FOCUS, replace(SETTINGS, wavelength=5e-9))
    assert factor(found, "no blur") == pytest.approx(1.0, abs=0.01)
    assert factor(found, "no diffraction") == pytest.approx(1.0, abs=0.01)


def test_without_diffraction_is_the_limit_of_short_waves() -> None:
    for f_number in (9.8, 22.0):
        found = causes(hand_lens(f_number), [53e-3, FOCUS])
        short = disparity_error_px(
            hand_lens(f_number).picture_geometry(np.array([53e-3, FOCUS])),
            replace(SETTINGS, wavelength=1e-11),
            FRESNEL,
        )
        assert found.changed[CHANGES.index("no diffraction")] == pytest.approx(short.value, rel=2e-3)
        assert factor(found, "no diffraction")[1] > 1.2


def test_without_blur_is_the_camera_focused_there() -> None:
    """Focused anew the lens moves by a fiftieth of the image distance, which changes scale and light as little."""
    there = 54e-3
    refocused = replace(hand_lens(5.6), focus_distance=there)
    found, sharp = causes(hand_lens(5.6), there), causes(refocused, there)
    assert factor(found, "no blur") > 1.5
    assert found.changed[CHANGES.index("no blur")] == pytest.approx(sharp.value, rel=0.05)


def test_stopping_down_at_fixed_light_raises_the_share_of_diffraction_and_lowers_that_of_blur() -> None:
    open_, closed = causes(hand_lens(9.8), [53e-3, FOCUS]), causes(hand_lens(22.0), [53e-3, FOCUS])
    assert np.all(factor(closed, "no diffraction") > 1.3 * factor(open_, "no diffraction"))
    assert factor(closed, "no blur")[0] < 0.8 * factor(open_, "no blur")[0]


def test_a_wide_blur_counts_most() -> None:
    found = causes(hand_lens(5.6), 48e-3, brightest=1.5)
    order = np.argsort(found.changed[:, 0])
    assert CHANGES[order[0]] == "no blur"
    assert factor(found, "no blur")[0] > 5.0


@pytest.mark.parametrize(
    ("electrons", "read_noise", "texture", "blur", "expected"),
    [
        (1e4, 0.0, Texture(contrast=0.3, correlation_length=10.0), 3.0, math.sqrt(10.0)),
        (1e-5, 0.0, Texture(contrast=0.3, correlation_length=1.0), 0.0, 10.0),
        (1e-2, 100.0, Texture(contrast=0.3, correlation_length=1.0), 0.0, 100.0),
    ],
    ids=["light over which texture stands out", "light in which it drowns", "reading in which it drowns"],
)
def test_ten_times_the_light_lowers_the_error_as_its_noise_says(
    electrons: float, read_noise: float, texture: Texture, blur: float, expected: float
) -> None:
    """Where nothing is aliased the bound follows noise over signal, and its square once noise is the larger."""
    settings = replace(
        SETTINGS,
        texture=texture,
        light=Light(electrons=electrons, f_number=1.0),
        sensor_noise=SensorNoise(read_noise_electrons=read_noise, full_well_electrons=1e5, bits=32),
    )
    found = error_causes(unit_geometry(blur), settings, RAYS, math.nan)
    assert factor(found, "ten times the light") == pytest.approx(expected, rel=0.005)


def test_the_light_of_another_camera_equals_that_light_declared() -> None:
    brightest = np.array([3.0, math.nan])
    found = causes(hand_lens(22.0), [53e-3, FOCUS], brightest=brightest)
    light = replace(SETTINGS.light, electrons=3.0 * SETTINGS.light.electrons)
    declared = disparity_error_px(
        hand_lens(22.0).picture_geometry(np.array([53e-3])), replace(SETTINGS, light=light), FRESNEL
    )
    k = CHANGES.index("light of the brightest")
    assert found.changed[k, 0] == pytest.approx(declared.value[0], rel=1e-12)
    assert found.changed_error[k, 0] == pytest.approx(declared.error[0], rel=1e-6)
    assert np.isnan(found.changed[k, 1])
    assert np.isnan(found.changed_error[k, 1])


def test_without_diffraction_removes_it_from_every_lens() -> None:
    """And can be worse: texture far finer than the micro-image's pixels is no longer kept out of them."""
    models = replace(CLOSED, microlens_diffraction="airy")
    found = causes(r5(), 0.3, models=models)
    short = disparity_error_px(r5().picture_geometry(np.array([0.3])), replace(SETTINGS, wavelength=1e-11), models)
    assert factor(found, "no diffraction")[0] < 0.95
    assert found.changed[CHANGES.index("no diffraction")] == pytest.approx(short.value, rel=2e-3)


def test_without_a_picture_all_values_are_nan() -> None:
    found = causes(hand_lens(), [10e-3, FOCUS], brightest=2.0)
    assert np.isnan(found.value[0])
    assert np.all(np.isnan(found.changed[:, 0]))
    assert np.all(np.isfinite(found.changed[:, 1]))
    assert np.all(found.changed_error[:, 1] < 0.01 * found.changed[:, 1])


def test_a_lens_that_is_not_there_is_refused() -> None:
    with pytest.raises(OutOfRangeError, match="microlens"):
        causes(hand_lens(), FOCUS, models=replace(FRESNEL, microlens_diffraction="airy"))

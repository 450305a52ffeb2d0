"""Texture, light and noise against transforms, simulated sensors and areas of circles."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest

from tradestudy.errors import OutOfRangeError
from tradestudy.imaging.models import (
    Light,
    SensorNoise,
    Texture,
    field_illumination,
    mean_electrons,
    noise_variance,
    share_beyond,
    texture_spectrum,
)

SENSOR = SensorNoise(read_noise_electrons=12.0, full_well_electrons=20_000.0, bits=9)


def test_the_spectrum_is_that_of_an_exponential_autocorrelation() -> None:
    """S(ν) = 2π ∫ c² exp(−r/ℓ) J₀(2πνr) r dr, at 20 digits."""
    with mpmath.workdps(20):
        for nu in (0.0, 0.03, 0.4):
            exact = 2 * mpmath.pi * mpmath.quad(
                lambda r, nu=nu: 0.04 * mpmath.exp(-r / 3) * mpmath.besselj(0, 2 * mpmath.pi * nu * r) * r,
                mpmath.linspace(0, 160, 80),
            )  # fmt: skip
            assert float(texture_spectrum(nu, 0.2, 3.0)) == pytest.approx(float(exact), rel=1e-12)


def test_the_share_beyond_a_frequency_is_the_integral_from_there() -> None:
    with mpmath.workdps(20):
        beyond = mpmath.quad(
            lambda nu: 2 * mpmath.pi * nu * 2 * mpmath.pi * 9 / (1 + (6 * mpmath.pi * nu) ** 2) ** mpmath.mpf(1.5),
            [0.2, 1, 10, mpmath.inf],
        )
    assert float(share_beyond(0.2, 3.0)) == pytest.approx(float(beyond), rel=1e-10)
    assert share_beyond(0.0, 3.0) == 1.0


def test_electrons_follow_solid_angle_and_area() -> None:
    light = Light(electrons=8000.0, f_number=4.0, pixel_pitch=5e-6)
    # A cone of half the width through a pixel of twice the side, at half the light.
    assert mean_electrons(light, 8.0, 10e-6, 0.5) == pytest.approx(8000 / 4 * 4 / 2)
    assert mean_electrons(Light(electrons=8000.0, f_number=4.0), 4.0, 10e-6) == pytest.approx(8000)


@pytest.mark.parametrize("model", ["shot", "shot+read", "shot+read+quantisation"])
def test_the_variance_is_that_of_a_simulated_sensor(model: str) -> None:
    rng = np.random.default_rng(4)
    step = SENSOR.full_well_electrons / 2**SENSOR.bits
    value = rng.poisson(900.0, 400_000).astype(float)
    if "read" in model:
        value += rng.normal(0.0, SENSOR.read_noise_electrons, value.size)
    if "quantisation" in model:
        value = step * np.round(value / step)
    # A variance of n values is known to √(2/n); a step of 1.2 standard deviations is almost even noise.
    tolerance = 4 * math.sqrt(2 / value.size) + (0.003 if "quantisation" in model else 0.0)
    assert float(noise_variance(900.0, SENSOR, model)) == pytest.approx(np.var(value), rel=tolerance)
    assert noise_variance(900.0, SENSOR, "off") == 0.0


def test_illumination_is_cos4_times_the_area_that_two_stops_leave() -> None:
    assert field_illumination(math.radians(30), pupil_diameter=5e-3, stop_separation=0.0) == pytest.approx(9 / 16)
    angle, pupil, apart = math.radians(20), 4e-3, 6e-3
    shift = apart * math.tan(angle)
    x = np.linspace(-pupil, pupil, 4001)
    inside = [np.hypot(x[:, None] - s, x[None, :]) < pupil / 2 for s in (0.0, shift)]
    area = np.sum(inside[0] & inside[1]) / np.sum(inside[0])
    found = field_illumination(angle, pupil_diameter=pupil, stop_separation=apart)
    assert found == pytest.approx(math.cos(angle) ** 4 * area, rel=1e-3)
    assert field_illumination(math.radians(80), pupil_diameter=pupil, stop_separation=apart) == pytest.approx(0.0)


@pytest.mark.parametrize(
    "make",
    [
        lambda: Texture(contrast=0.0, correlation_length=1e-4),
        lambda: Texture(contrast=0.1, correlation_length=math.inf),
        lambda: Light(electrons=-1.0, f_number=4.0),
        lambda: Light(electrons=1.0, f_number=4.0, pixel_pitch=0.0),
        lambda: SensorNoise(read_noise_electrons=-1.0, full_well_electrons=1.0, bits=8),
        lambda: SensorNoise(read_noise_electrons=1.0, full_well_electrons=1.0, bits=0),
        lambda: field_illumination(math.pi / 2, pupil_diameter=1.0, stop_separation=0.0),
        lambda: field_illumination(0.1, pupil_diameter=1.0, stop_separation=-1.0),
    ],
)
def test_impossible_values_are_refused(make) -> None:
    with pytest.raises(OutOfRangeError):
        make()

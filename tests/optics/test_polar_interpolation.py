"""Fields on rings: exact harmonics come back, rough fields are refused, singular ones too."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import j0

from tradestudy.optics.propagation.targets import polar_field

CENTRE, RADIUS, WAVENUMBER = (0.3, -0.2), 1.5, 20.0


def nearly_round(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    a, b = x - CENTRE[0], y - CENTRE[1]
    return j0(WAVENUMBER * np.hypot(a, b)) * (1 + 0.3 * a - 0.2j * b + 0.1 * a * b) * np.exp(0.4j * a)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4, 1e-7])
def test_field_of_few_harmonics_comes_back_everywhere(tolerance: float) -> None:
    asked = []

    def field(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        asked.append(x.size)
        return nearly_round(x, y)

    polar = polar_field(field, centre=CENTRE, radius=RADIUS, wavenumber=21.0, tolerance=tolerance, most=5000)
    assert polar is not None
    rng = np.random.default_rng(2)
    r, angle = RADIUS * np.sqrt(np.append(rng.random(500), [0.0, 1.0])), 2 * np.pi * rng.random(502)
    x, y = CENTRE[0] + r * np.cos(angle), CENTRE[1] + r * np.sin(angle)
    assert np.abs(polar.at(x, y) - nearly_round(x, y)).max() < 4 * tolerance
    assert sum(asked) < 1500


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3])
def test_noise_of_the_field_is_not_magnified_at_the_rim(tolerance: float) -> None:
    """Many turns over few steps: a polynomial a step beyond its points would be wrong by the noise a million times."""
    rng, noise, wavenumber = np.random.default_rng(4), tolerance / 10, 400.0

    def field(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        r = np.hypot(x - CENTRE[0], y - CENTRE[1])
        return j0(wavenumber * r) + noise * rng.uniform(-1, 1, x.shape)

    polar = polar_field(field, centre=CENTRE, radius=RADIUS, wavenumber=wavenumber, tolerance=tolerance, most=50_000)
    assert polar is not None
    angle = np.linspace(0, 6, 50)
    r = RADIUS * np.linspace(0.99, 1.0, 50)
    value = polar.at(CENTRE[0] + r * np.cos(angle), CENTRE[1] + r * np.sin(angle))
    assert np.abs(value - j0(wavenumber * r)).max() < 3 * tolerance


def test_a_field_that_varies_with_the_angle_is_left_to_other_methods() -> None:
    def wave(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.exp(1j * WAVENUMBER * (x + y))

    assert polar_field(wave, centre=CENTRE, radius=RADIUS, wavenumber=21.0, tolerance=1e-3, most=800) is None


def test_a_singular_field_is_left_to_other_methods() -> None:
    assert (
        polar_field(lambda x, y: None, centre=CENTRE, radius=RADIUS, wavenumber=WAVENUMBER, tolerance=1e-3, most=5000)
        is None
    )

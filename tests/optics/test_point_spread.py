from __future__ import annotations

import functools

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import erf, j0, j1

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.sampled_point_spread import Measured, PointSpread, peak_position
from tradestudy.optics.spread_metrics import (
    diffraction_limited_peak,
    encircled_energy,
    encircled_energy_radius,
    full_width_at_half_maximum,
    rms_width,
    strehl_ratio,
)
from tradestudy.optics.spread_shares import (
    modulation_transfer,
    pixel_shares,
    share_on_neighbouring_pixels,
    share_outside_disc,
    window_share,
)

WAVELENGTH, F_NUMBER, POWER = 550e-9, 4.0, 2.5
SCALE = WAVELENGTH * F_NUMBER  # the Airy pattern in v = π r/(λ N)
CENTRE = (0.31e-6, -0.17e-6)  # between samples on purpose


@functools.cache
def airy(samples: int = 193, half_width: float = 24e-6) -> PointSpread:
    x = np.linspace(-half_width, half_width, samples)
    v = np.pi * np.hypot(x[None, :] - CENTRE[0], x[:, None] - CENTRE[1]) / SCALE
    with np.errstate(invalid="ignore"):
        amplitude = np.where(v == 0, 1.0, 2 * j1(v) / v)
    return PointSpread(x=x, y=x, intensity=POWER * np.pi / (4 * SCALE**2) * amplitude**2, pupil_power=POWER)


@functools.cache
def gaussian(sigma_x: float = 2e-6, sigma_y: float = 3e-6, samples: int = 129) -> PointSpread:
    x = np.linspace(-20e-6, 20e-6, samples)
    profile_x = np.exp(-((x - CENTRE[0]) ** 2) / (2 * sigma_x**2)) / (sigma_x * np.sqrt(2 * np.pi))
    profile_y = np.exp(-((x - CENTRE[1]) ** 2) / (2 * sigma_y**2)) / (sigma_y * np.sqrt(2 * np.pi))
    return PointSpread(x=x, y=x, intensity=POWER * np.outer(profile_y, profile_x), pupil_power=POWER)


def assert_true_within_stated(measured: Measured, truth: object, largest_error: float) -> None:
    """The stated error covers the true one and is itself small."""
    assert np.all(np.abs(measured.value - truth) <= measured.error)
    assert np.all(measured.error <= largest_error)


def airy_energy(radius: object) -> np.ndarray:
    v = np.pi * np.asarray(radius) / SCALE
    return 1 - j0(v) ** 2 - j1(v) ** 2


def test_peak_is_found_between_samples() -> None:
    assert peak_position(airy()) == pytest.approx(CENTRE, abs=1e-11)
    assert peak_position(gaussian()) == pytest.approx(CENTRE, abs=1e-11)


@pytest.mark.parametrize("angle", [0.0, 0.7, 2.0])
def test_airy_full_width_at_half_maximum(angle: float) -> None:
    half = brentq(lambda v: (2 * j1(v) / v) ** 2 - 0.5, 1, 2, xtol=1e-14)
    assert_true_within_stated(full_width_at_half_maximum(airy(), angle=angle), 2 * half * SCALE / np.pi, 5e-9)


def test_gaussian_full_width_follows_the_cut() -> None:
    factor = 2 * np.sqrt(2 * np.log(2))
    for angle, sigma in ((0.0, 2e-6), (np.pi / 2, 3e-6)):
        assert_true_within_stated(full_width_at_half_maximum(gaussian(), angle=angle), factor * sigma, 1e-10)


def test_airy_encircled_energy() -> None:
    radii = np.array([[0.5e-6, 2.684e-6], [8e-6, 23e-6]])
    assert_true_within_stated(encircled_energy(airy(), centre=CENTRE, radius=radii), airy_energy(radii), 1e-4)


@pytest.mark.parametrize("share", [0.5, 0.8])
def test_airy_encircled_energy_radius_is_of_the_pupils_power(share: float) -> None:
    truth = brentq(lambda r: airy_energy(r) - share, 0.1e-6, 5e-6, xtol=1e-16)
    assert_true_within_stated(encircled_energy_radius(airy(), centre=CENTRE, share=share), truth, 5e-10)


def test_a_fraction_of_energy_beyond_the_window_is_refused() -> None:
    with pytest.raises(OutOfRangeError, match="widen the window"):
        encircled_energy_radius(airy(), centre=CENTRE, share=0.99)


def test_rms_width_within_declared_radius() -> None:
    sigma, radius = 2e-6, 6e-6
    round_spot = gaussian(sigma, sigma)
    q = radius**2 / (2 * sigma**2)
    truth = sigma * np.sqrt(2 * (1 - np.exp(-q) * (1 + q)) / (1 - np.exp(-q)))
    assert_true_within_stated(rms_width(round_spot, centre=CENTRE, radius=radius), truth, 1e-9)


def test_rms_width_of_airy_grows_with_its_limit() -> None:
    # ∫ r³ (2 J1(v)/v)² dr has the primitive v²/2 (J0² + J1²) − v J0 J1 in v
    for radius in (5e-6, 20e-6):
        v = np.pi * radius / SCALE
        second = 4 * (v**2 / 2 * (j0(v) ** 2 + j1(v) ** 2) - v * j0(v) * j1(v))
        truth = SCALE / np.pi * np.sqrt(second / (2 * airy_energy(radius)))
        assert_true_within_stated(rms_width(airy(), centre=CENTRE, radius=radius), truth, 1e-9)


def test_airy_strehl_ratio_is_one() -> None:
    diameter, distance = 1e-3, F_NUMBER * 1e-3
    peak = diffraction_limited_peak(
        pupil_power=POWER, pupil_area=np.pi / 4 * diameter**2, wavelength=WAVELENGTH, distance=distance
    )
    assert_true_within_stated(strehl_ratio(airy(), reference_peak=peak), 1.0, 1e-3)
    assert strehl_ratio(airy(), reference_peak=2 * peak).value == pytest.approx(0.5, abs=1e-5)


def test_airy_transfer_function() -> None:
    cutoff = 1 / SCALE
    frequency = np.array([0.05, 0.3, 0.7, 0.98, 1.05]) * cutoff
    reduced = np.minimum(frequency / cutoff, 1)
    truth = 2 / np.pi * (np.arccos(reduced) - reduced * np.sqrt(1 - reduced**2))
    for fx, fy in ((frequency, 0 * frequency), (frequency * np.cos(1), frequency * np.sin(1))):
        measured = modulation_transfer(airy(), frequency_x=fx, frequency_y=fy)
        assert_true_within_stated(measured, truth, 0.04)
        assert np.all(measured.error >= 1 - window_share(airy()).value)


def test_light_outside_the_window_is_missing_at_the_lowest_frequencies_alone() -> None:
    """The value at 0 is the share inside; dividing all by it would move the others away from the closed form."""
    psf, share = airy(), float(window_share(airy()).value)
    assert 0.01 < 1.0 - share < 0.05
    zero = modulation_transfer(psf, frequency_x=np.array(0.0), frequency_y=np.array(0.0))
    assert float(zero.value) == pytest.approx(share, rel=1e-5)
    assert abs(float(zero.value) - 1.0) <= 1.001 * float(zero.error)  # two quadratures of the share inside
    s = np.linspace(0.2, 0.8, 7)
    truth = 2 / np.pi * (np.arccos(s) - s * np.sqrt(1 - s**2))
    value = modulation_transfer(psf, frequency_x=s / SCALE, frequency_y=np.zeros(7)).value
    assert np.abs(value - truth).mean() < 0.5 * np.abs(value / share - truth).mean()


def test_gaussian_transfer_function() -> None:
    f = 5e4
    measured = modulation_transfer(gaussian(), frequency_x=np.array([0, f, 0]), frequency_y=np.array([0, 0, f]))
    truth = [1, np.exp(-2 * (np.pi * 2e-6 * f) ** 2), np.exp(-2 * (np.pi * 3e-6 * f) ** 2)]
    assert_true_within_stated(measured, truth, 1e-8)


def test_frequency_beyond_the_sampling_is_refused() -> None:
    with pytest.raises(OutOfRangeError, match=r"1e\+07 1/m .*5e-08 m"):
        modulation_transfer(gaussian(), frequency_x=np.array(1e7), frequency_y=np.array(0.0))
    with pytest.raises(OutOfRangeError, match=r"nan"):
        modulation_transfer(gaussian(), frequency_x=np.array(np.nan), frequency_y=np.array(0.0))


def test_share_outside_a_geometric_disc() -> None:
    radius = 5e-6
    assert_true_within_stated(share_outside_disc(airy(), centre=CENTRE, radius=radius), 1 - airy_energy(radius), 1e-6)


def test_pixels_integrate_the_intensity_and_are_not_mirrored() -> None:
    pitch, corner, shape = 5.5e-6, (-11e-6, -8.25e-6), (3, 4)
    shares = pixel_shares(gaussian(), pitch=pitch, corner=corner, shape=shape)
    x = corner[0] + pitch * np.arange(shape[1] + 1)
    y = corner[1] + pitch * np.arange(shape[0] + 1)
    along_x = np.diff(erf((x - CENTRE[0]) / (2e-6 * np.sqrt(2)))) / 2
    along_y = np.diff(erf((y - CENTRE[1]) / (3e-6 * np.sqrt(2)))) / 2
    assert_true_within_stated(shares, np.outer(along_y, along_x), 1e-7)


def test_neighbouring_pixels() -> None:
    pitch = 5.5e-6

    def within(half: float, along: int) -> float:
        sigma = (2e-6, 3e-6)[along]
        return float(
            (erf((half - CENTRE[along]) / (sigma * 2**0.5)) + erf((half + CENTRE[along]) / (sigma * 2**0.5))) / 2
        )

    truth = within(1.5 * pitch, 0) * within(1.5 * pitch, 1) - within(0.5 * pitch, 0) * within(0.5 * pitch, 1)
    measured = share_on_neighbouring_pixels(gaussian(), pitch=pitch, centre=(0.0, 0.0))
    assert_true_within_stated(measured, truth, 1e-7)


def test_the_stated_error_grows_with_coarser_sampling_and_still_covers_the_true_one() -> None:
    truth = airy_energy(4e-6)
    stated = []
    for samples in (193, 97, 49):
        measured = encircled_energy(airy(samples), centre=CENTRE, radius=np.array(4e-6))
        assert abs(measured.value - truth) <= measured.error
        stated.append(float(measured.error))
    assert stated[0] < stated[1] / 4 < stated[2] / 16


@pytest.mark.parametrize(
    "change",
    [
        {"x": np.linspace(-1, 1, 34)},
        {"x": np.linspace(-1, 1, 33) ** 3},
        {"intensity": np.zeros((33, 37))},
        {"intensity": -np.ones((33, 33))},
        {"intensity": np.full((33, 33), np.nan)},
        {"pupil_power": 0.0},
    ],
)
def test_impossible_samples_are_refused(change: dict[str, object]) -> None:
    axis = np.linspace(-1, 1, 33)
    with pytest.raises(OutOfRangeError):
        PointSpread(**({"x": axis, "y": axis, "intensity": np.ones((33, 33)), "pupil_power": 1.0} | change))


@pytest.mark.parametrize(
    "call",
    [
        lambda p: encircled_energy(p, centre=CENTRE, radius=np.array(1.0)),
        lambda p: encircled_energy(p, centre=(1.0, 0.0), radius=np.array(1e-6)),
        lambda p: encircled_energy_radius(p, centre=CENTRE, share=1.5),
        lambda p: rms_width(p, centre=CENTRE, radius=0.0),
        lambda p: strehl_ratio(p, reference_peak=0.0),
        lambda p: p.at(20.1e-6, 0.0),
        lambda p: p.at(0.0, [0.0, 1.0]),
        lambda p: pixel_shares(p, pitch=5e-6, corner=(0.0, 0.0), shape=(9, 9)),
    ],
)
def test_light_that_leaves_the_window_is_refused(call) -> None:
    with pytest.raises(OutOfRangeError):
        call(gaussian())


def test_the_rim_of_the_window_is_inside_it() -> None:
    """There, the spline passes through the samples."""
    rim = airy().at([airy().x[0], airy().x[-1]], airy().y[-1])
    np.testing.assert_allclose(rim, airy().intensity[-1, [0, -1]], rtol=1e-9)


def test_peak_on_the_rim_is_refused() -> None:
    axis = np.linspace(0, 1, 33)
    ramp = PointSpread(x=axis, y=axis, intensity=np.tile(axis, (33, 1)), pupil_power=1.0)
    with pytest.raises(OutOfRangeError, match="rim"):
        peak_position(ramp)


def test_half_maximum_outside_the_window_is_refused() -> None:
    axis = np.linspace(-1, 1, 33)
    broad = PointSpread(x=axis, y=axis, intensity=np.exp(-0.1 * (axis[:, None] ** 2 + axis**2)), pupil_power=100.0)
    with pytest.raises(OutOfRangeError, match="half maximum"):
        full_width_at_half_maximum(broad, angle=0.0)

"""Disparities of windows: bias, spread against the bound, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad

from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.optics.two_apertures import centroid_of_common_part
from tradestudy.optics.window_matching import (
    Matches,
    PairOfPictures,
    Reason,
    cubic_weights,
    gradient_along,
    match_windows,
    odd_window,
)


def matched(
    left: FloatArray, right: FloatArray, *noise: float | FloatArray, window: int = 15, limit: float = 0.3
) -> Matches:
    """Along x, from −3 to 4, with the noise of both pictures or of each."""
    variances = [np.broadcast_to(np.square(noise[k]), left.shape) for k in (0, -1)]

    def moved(picture: FloatArray, step: int) -> FloatArray:
        found = np.full_like(right, np.nan)
        if step >= 0:
            found[:, : right.shape[1] - step] = picture[:, step:]
        else:
            found[:, -step:] = picture[:, :step]
        return found

    def difference(step: int) -> tuple[FloatArray, FloatArray, BoolArray]:
        found = moved(right, step) - left
        return found, variances[0] + moved(variances[1], step), np.isfinite(found)

    return match_windows(
        [PairOfPictures(gradient=gradient_along(left, (1.0, 0.0)), difference=difference)],
        range(-3, 5),
        window=window,
        least_share=1.0,
        largest_deviation=limit,
    )


def smooth_texture(
    rng: np.random.Generator, shift: float, side: int = 96, width: float = 2.0
) -> tuple[FloatArray, ...]:
    """Gaussian texture and the same moved to the right, both exact: a spectrum shifted by its phase."""
    side = 96
    frequency = np.fft.fftfreq(side)
    spectrum = np.fft.fft2(rng.standard_normal((side, side)))
    spectrum *= np.exp(-2.0 * (math.pi * width) ** 2 * (frequency[:, None] ** 2 + frequency[None, :] ** 2))
    picture = np.fft.ifft2(spectrum).real
    moved = np.fft.ifft2(spectrum * np.exp(-2j * math.pi * frequency[None, :] * shift)).real
    scale = 400.0 / picture.std()
    return picture * scale, moved * scale


def test_the_spread_meets_the_bound_of_a_sinusoid() -> None:
    """Amplitude 400 e, period 8 px, 60 e of noise in each picture, 15 × 15 px: √2 σ/√Σg² = 0.02546 px."""
    gradient = 400.0 * (2.0 * math.pi / 8.0)
    bound = math.sqrt(2.0) * 60.0 / math.sqrt(225.0 * gradient**2 / 2.0)
    assert bound == pytest.approx(0.02546, abs=5e-6)
    rng = np.random.default_rng(1)
    x = np.arange(200.0)
    for shift in (0.0, 0.25, 0.4, 0.5):
        errors, stated = [], []
        for _ in range(8):
            phase = rng.uniform(0.0, 2.0 * math.pi)
            left, right = (
                400.0 * np.sin(2.0 * math.pi * (x - moved) / 8.0 + phase) + 60.0 * rng.standard_normal((200, 200))
                for moved in (0.0, shift)
            )
            found = matched(left, right, 60.0)
            apart = np.s_[10:190:15, 10:190:15]  # windows that share no pixel
            assert np.all(found.reason[apart] == Reason.MEASURED)
            errors.append(found.disparity[apart] - shift)
            stated.append(found.deviation[apart])
        error = np.array(errors)
        # 1152 windows: 2.1 % of standard error of their spread, 0.03 σ of that of their mean.
        assert abs(error.mean()) < 4.0 * bound / math.sqrt(error.size)
        assert 0.94 * bound < error.std() < 1.25 * bound
        assert np.mean(stated) == pytest.approx(error.std(), rel=0.1)


def test_each_window_states_the_noise_of_its_own_pixels() -> None:
    """Noise that grows fourfold from left to right in one picture, and from top to bottom in the other."""
    rng = np.random.default_rng(8)
    noise = [
        np.broadcast_to(one, (96, 96)) for one in (np.linspace(10.0, 40.0, 96), np.linspace(10.0, 40.0, 96)[:, None])
    ]
    relative = []
    for _ in range(60):
        clear = smooth_texture(rng, 0.0)
        found = matched(
            *(one + two * rng.standard_normal((96, 96)) for one, two in zip(clear, noise, strict=True)), *noise
        )
        relative.append((found.disparity / found.deviation)[9:90:15, 9:90:15])
    # 60 independent windows in each place: their spread is known to 9 %, over rows or columns of six to 4 %.
    squares = np.mean(np.square(relative), axis=0)
    assert np.sqrt(squares.mean()) == pytest.approx(1.0, abs=0.06)
    for axis in (0, 1):
        assert np.sqrt(squares.mean(axis=axis)) == pytest.approx(np.ones(6), abs=0.15)


@pytest.mark.parametrize("shift", [-1.37, -0.5, 0.1, 0.33, 0.77, 2.25])
def test_known_shifts_of_a_texture_are_found_without_bias(shift: float) -> None:
    rng = np.random.default_rng(2)
    left, right = smooth_texture(rng, shift)
    noisy = [one + 20.0 * rng.standard_normal(one.shape) for one in (left, right)]
    found = matched(*noisy, 20.0, window=9)
    middle = found.disparity[16:-16, 16:-16]
    assert np.mean(np.isfinite(middle)) > 0.99
    assert abs(np.nanmean(middle) - shift) < 0.005
    assert np.nanmax(np.abs(middle - shift)) < 0.3


def test_pictures_without_texture_measure_nothing() -> None:
    rng = np.random.default_rng(3)
    found = matched(*(1000.0 + 30.0 * rng.standard_normal((80, 80)) for _ in range(2)), 30.0, window=9)
    assert np.mean(np.isfinite(found.disparity)) < 0.01
    assert np.array_equal(np.isfinite(found.disparity), found.reason == Reason.MEASURED)


def test_pictures_of_different_things_do_not_match() -> None:
    rng = np.random.default_rng(4)
    left, right = smooth_texture(rng, 0.0)[0], smooth_texture(rng, 0.0)[0]
    found = matched(left, right, 5.0, window=11)
    assert np.mean(np.isfinite(found.disparity)) < 0.02


def test_a_stripe_repeated_within_the_range_is_ambiguous() -> None:
    rng = np.random.default_rng(5)
    x = np.arange(80.0)
    left, right = (400.0 * np.sin(2.0 * math.pi * x / 3.0) + 20.0 * rng.standard_normal((80, 80)) for _ in range(2))
    reason = matched(left, right, 20.0, window=9).reason[10:-10, 10:-10]
    # The best of −3, 0 and 3 lies in the range only where it is 0.
    assert np.all(np.isin(reason, [Reason.AMBIGUOUS, Reason.OUT_OF_RANGE]))
    assert np.mean(reason == Reason.AMBIGUOUS) > 0.2


def test_disparities_beyond_the_range_are_out_of_range() -> None:
    left, right = smooth_texture(np.random.default_rng(6), 4.6, width=3.0)
    reason = matched(left, right, 1.0).reason[20:-20, 20:-20]
    assert not np.any(reason == Reason.MEASURED)
    assert np.mean(reason == Reason.OUT_OF_RANGE) > 0.5


def test_cubic_weights_are_exact_for_cubics() -> None:
    def cubic(x: FloatArray) -> FloatArray:
        return 3.0 - x + 2.0 * x**2 - 0.7 * x**3

    at = np.array([0.0, 0.2, 0.5, 1.0])
    assert cubic_weights(at) @ cubic(np.arange(-1.0, 3.0)) == pytest.approx(cubic(at), rel=1e-12)


@pytest.mark.parametrize(("apart", "other"), [(0.7, 1.5), (1.4, 1.0), (2.0, 1.5), (0.3, 2.0)])
def test_the_centroid_of_two_discs_by_quadrature(apart: float, other: float) -> None:
    def height(x: float) -> float:
        return math.sqrt(max(0.0, min(1.0 - x * x, other**2 - (x - apart) ** 2)))

    ends = max(-1.0, apart - other), min(1.0, apart + other)
    area, moment = (quad(one, *ends, limit=400)[0] for one in (height, lambda x: x * height(x)))
    assert centroid_of_common_part(apart, 1.0, other) == pytest.approx(moment / area, abs=2e-4)


def test_windows_are_odd() -> None:
    assert [odd_window(size) for size in (2.0, 3.0, 7.0, 7.9, 8.1, 15.0)] == [3, 3, 7, 7, 9, 15]
    with pytest.raises(ValueError, match="matching window"):
        odd_window(1.0)

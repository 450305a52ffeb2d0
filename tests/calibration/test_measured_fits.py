"""Fits to measured depth errors: exact data, published data, and the coverage of stated intervals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tradestudy.calibration.measured_fits import (
    MEAN_OF_NORMAL,
    Fitted,
    disparity_errors,
    exponent,
    noise_and_floor,
    offset_and_scale,
    ripple,
)
from tradestudy.calibration.measured_table import read_measurements

PUBLISHED = Path(__file__).parents[1] / "data" / "measured"


def test_exact_points_give_the_truth() -> None:
    z = np.geomspace(0.5, 8.0, 9)
    slope, d = 60.0 / z**2, 60.0 / z
    assert exponent(z, 3.0 * z**1.7).value == pytest.approx(1.7, abs=1e-12)
    noise, floor = noise_and_floor(np.hypot(0.2 / slope, 0.002), slope)
    assert (noise.value, floor.value) == pytest.approx((0.2, 0.002), rel=1e-9)
    found = offset_and_scale(0.3 + 0.01 * d - 0.003 * slope, d, np.ones(9), slope)
    assert [one.value for one in found] == pytest.approx([0.3, 0.01, 0.003], rel=1e-9)


def test_the_mean_of_normal_errors() -> None:
    drawn = np.random.default_rng(3).normal(size=1_000_000)
    assert np.abs(drawn).mean() == pytest.approx(MEAN_OF_NORMAL, rel=2e-3)


def test_mean_disparity_errors_are_those_behind_noisy_depths() -> None:
    """Drawn disparities, with an offset and noise, give the offset back although their mean depth is shifted."""
    z, px_m, noise, offset = np.array([2.0, 4.0]), 60.0, 0.6, -0.4
    drawn = px_m / z + offset + noise * np.random.default_rng(5).normal(size=(2_000_000, 2))
    depth = px_m / drawn
    errors = disparity_errors(depth.mean(axis=0) - z, depth.std(axis=0), z, px_m / z**2)
    assert errors == pytest.approx([offset, offset], abs=5e-3)
    alone = disparity_errors(depth.mean(axis=0) - z, np.zeros(2), z, px_m / z**2)
    assert abs(alone[1] - offset) > 0.02  # so that the test sees the shift


def test_too_few_points_leave_values_unknown() -> None:
    two = np.array([1.0, 2.0])
    assert np.isnan(exponent(two, two**2).value)
    assert "two samples per period" in ripple(two, two, signed=True).reason


def test_a_signed_ripple_is_found() -> None:
    d = np.arange(8.0, 30.0, 0.2)
    found = ripple(0.1 + 0.05 * np.sin(2.0 * np.pi * 1.1 * d + 2.0) + 1e-4 * np.cos(37.0 * d), d, signed=True)
    assert found.found
    assert (found.scale.value, found.amplitude.value, found.phase) == pytest.approx((1.1, 0.05, 2.0), rel=1e-2)


def test_the_ripple_of_a_published_stereo_head_gives_its_focal_length_times_baseline() -> None:
    """The maxima, evenly spaced in 1/Z, correspond to 59.7 px·m, not to the nominal 882.5 px × 75 mm = 66.2 px·m."""
    table, nominal = read_measurements(PUBLISHED / "oak_75mm_800p.csv"), 882.5 * 0.075
    errors = table.absolute_error * nominal / table.distance**2
    found = ripple(errors, nominal / table.distance, signed=False)
    product = found.scale.times(nominal)
    assert product.value == pytest.approx(59.7, rel=0.02)
    assert product.excludes(nominal)
    # One disparity error, b + A, gives every maximum beyond 2 m to 15 %, where a point lies within a tenth of a period.
    z, turns = table.distance, found.scale.value * nominal / table.distance + found.phase / (2.0 * np.pi) - 0.25
    far = [np.flatnonzero((np.round(turns) == one) & (z > 2.0)) for one in np.unique(np.round(turns))]
    maxima = np.array([points[np.argmax(errors[points])] for points in far if points.size])
    maxima = maxima[np.abs(turns[maxima] - np.round(turns[maxima])) <= 0.1]
    assert maxima.size > 15
    largest = found.mean.value + found.amplitude.value
    assert np.abs(largest / errors[maxima] - 1.0).max() < 0.15


def test_the_exponent_of_a_published_stereo_camera() -> None:
    table = read_measurements(PUBLISHED / "stereo_rms_32_points.csv")
    found = exponent(table.distance, table.rms)
    assert found.value == pytest.approx(2.0, abs=0.05)
    assert not found.excludes(2.0)


def _holds(found: Fitted, truth: float) -> bool:
    return found.low <= truth <= found.high


@pytest.mark.slow
def test_intervals_contain_the_truth_as_often_as_they_say() -> None:
    rng, trials = np.random.default_rng(1), 600
    held: dict[str, list[bool]] = {}
    z = np.geomspace(0.5, 8.0, 12)
    slope, d = 60.0 / z**2, 60.0 / z
    far = 60.0 / np.arange(3.0, 10.0, 0.1)
    for trial in range(trials):
        sigma = np.hypot(0.2 / slope, 0.002) * np.sqrt(rng.chisquare(20, 12) / 20.0)
        noise, floor = noise_and_floor(sigma, slope)
        errors = 0.3 + 0.01 * d - 0.003 * slope + 0.05 * rng.normal(size=12)
        offset, scale, shift = offset_and_scale(errors, d, np.ones(12), slope)
        power = exponent(z, 3.0 * z**1.7 * np.exp(0.2 * rng.normal(size=12)))
        known = {noise: 0.2, floor: 0.002, offset: 0.3, scale: 0.01, shift: 0.003, power: 1.7}
        names: tuple[str, ...] = ("noise", "floor", "offset", "scale", "shift", "power")
        if trial < 150:  # slower
            wave = 0.2 + 0.15 * np.sin(2.0 * np.pi * 0.93 * far + 1.0)
            found = ripple(np.abs(wave + 0.03 * rng.normal(size=far.size)), far, signed=False)
            known |= {found.scale: 0.93, found.amplitude: 0.15, found.mean: 0.2}
            names += ("ripple scale", "ripple amplitude", "ripple mean")
        for name, (one, truth) in zip(names, known.items(), strict=True):
            held.setdefault(name, []).append(_holds(one, truth))
    shares = {name: float(np.mean(one)) for name, one in held.items()}
    assert all(0.89 <= share <= 0.99 for share in shares.values()), shares


@pytest.mark.slow
def test_scatter_alone_rarely_looks_like_a_ripple() -> None:
    rng, far = np.random.default_rng(2), 60.0 / np.arange(3.0, 10.0, 0.1)
    seen = [ripple(np.abs(rng.normal(size=far.size)), far, signed=False).found for _ in range(150)]
    assert np.mean(seen) <= 0.04


def test_three_points_of_which_one_dominates_have_no_undefined_error() -> None:
    """Two columns of a fit may differ by powers of ten, and a column may be zero."""
    noise, floor = noise_and_floor(np.array([2e-3, 3e-3, 40e-3]), 60.0 / np.array([1.016, 2.032, 3.048]) ** 2)
    assert not np.isnan([noise.error, noise.high, floor.error, floor.high]).any()
    assert np.isnan(exponent(np.ones(5), np.arange(1.0, 6.0)).value)

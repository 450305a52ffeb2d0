"""What a sensor makes of light: its photon transfer curve, its ends, its mosaic."""

from __future__ import annotations

import numpy as np
import pytest

from tradestudy.errors import OutOfRangeError
from tradestudy.imaging.models import Light, SensorNoise
from tradestudy.imaging.render.tiles import Mosaic, Recording

READ, WELL, BITS, BLACK = 12.0, 20000.0, 12, 500.0


def recording(**changes: object) -> Recording:
    values: dict[str, object] = {
        "light": Light(electrons=1000.0, f_number=4.0),
        "noise": SensorNoise(read_noise_electrons=READ, full_well_electrons=WELL, bits=BITS),
        "model": "shot+read+quantisation",
        "black_level": BLACK,
    }
    return Recording(**(values | changes))  # type: ignore[arg-type]


def test_the_photon_transfer_curve_gives_gain_and_read_noise() -> None:
    """Variance against mean: a line of slope 1/gain, which meets zero light at read and quantisation noise."""
    one, rng = recording(), np.random.default_rng(7)
    gain = WELL / 2**BITS
    levels = np.linspace(0.0, 12000.0, 9)
    pictures = [one.record(np.full(200_000, level), rng).astype(float) for level in levels]
    mean = np.array([p.mean() for p in pictures]) - BLACK / gain
    variance = np.array([p.var() for p in pictures])
    slope, intercept = np.polyfit(mean, variance, 1, w=1 / variance)
    assert slope == pytest.approx(1 / gain, rel=0.01)
    assert intercept == pytest.approx((READ / gain) ** 2 + 1 / 12, rel=0.02)
    assert mean == pytest.approx(levels / gain, abs=0.15)


def test_a_pixel_holds_no_more_than_its_full_well() -> None:
    rng = np.random.default_rng(1)
    assert np.all(recording(model="shot").record(np.full(100, 10 * WELL), rng) == WELL)
    bright = recording().record(np.full(1000, 10 * WELL), rng)
    assert bright.dtype == np.uint16
    assert np.all(bright == 2**BITS - 1)


def test_without_noise_the_picture_is_the_light_itself() -> None:
    light = np.linspace(0.0, 100.0, 11)
    assert recording(model="off").record(light, np.random.default_rng(0)) == pytest.approx(light)


def test_a_mosaic_has_its_colours_where_its_pattern_says() -> None:
    rows, columns = np.mgrid[0:4, 0:4]
    found = Mosaic(pattern="GRBG", response=(0.5, 1.0, 0.7)).colors(rows, columns)
    assert "".join("RGB"[c] for c in found[0]) == "GRGR"
    assert "".join("RGB"[c] for c in found[1]) == "BGBG"
    assert np.array_equal(found[:2], found[2:])


def test_a_black_level_above_the_full_well_is_refused() -> None:
    with pytest.raises(OutOfRangeError, match="black level"):
        recording(black_level=WELL)

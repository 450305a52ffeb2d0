"""Textures and surfaces: their statistics, their filter, and where rays meet them first."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tradestudy.errors import OutOfRangeError
from tradestudy.imaging.models import Texture
from tradestudy.imaging.scenes.pattern import (
    Pattern,
    PicturePattern,
    RandomPattern,
    pattern_of,
    read_depths,
    read_picture,
)
from tradestudy.imaging.scenes.scene import Rock
from tradestudy.imaging.scenes.surfaces import Flat, HeightField, Nearby, Sphere
from tradestudy.optics.arrays import FloatArray

SIDE = 256
PATTERN = RandomPattern(texture=Texture(contrast=0.2, correlation_length=8e-4), sample=1e-4, side=2 * SIDE, seed=3)


def seen(pattern: Pattern, x: FloatArray, y: FloatArray, deviation: float) -> FloatArray:
    """Brightness at places, filtered to a standard deviation along each axis."""
    level, share = pattern.mixture(np.full(x.size, deviation**2, np.float32))
    return pattern.brightness(x.astype(np.float32), y.astype(np.float32), level, share)


def test_the_texture_has_its_contrast_and_its_correlation_length() -> None:
    found = np.stack(
        [
            RandomPattern(texture=PATTERN.texture, sample=1e-4, side=512, seed=seed)
            .build()
            .values[0, : 513 * 513]
            .reshape(513, 513)[:512, :512]
            - 1.0
            for seed in range(4)
        ]
    )
    assert np.abs(found.mean()) < 1e-6
    correlation = [np.mean(found * np.roll(found, lag, axis=2)) / 0.04 for lag in (4, 8, 16)]
    # Of ten correlation lengths squared and more in four pictures, to some percent.
    assert correlation == pytest.approx(np.exp([-0.5, -1.0, -2.0]), abs=0.04)


@pytest.mark.parametrize("deviation", [1.0, 1.7, 3.2, 7.0])
def test_the_filter_has_the_variance_that_is_asked_for(deviation: float) -> None:
    """A wave that is long beside the filter keeps exp(−2π²ν²σ²) of its amplitude."""
    waves = 4
    x = np.arange(SIDE) + 0.5
    wave = 1.0 + 0.5 * np.cos(2 * np.pi * waves * x / SIDE)
    pattern = pattern_of(np.broadcast_to(wave, (1, SIDE, SIDE)), 1.0)
    at = np.linspace(0.0, SIDE, 4001)
    found = seen(pattern, at, np.full_like(at, 77.7), deviation) - 1.0
    kept = 2 * np.mean(found * np.cos(2 * np.pi * waves * at / SIDE)) / 0.5
    assert kept == pytest.approx(np.exp(-2 * np.pi**2 * (waves / SIDE) ** 2 * deviation**2), abs=0.01)


def rays(count: int, spread: float = 0.05) -> tuple[FloatArray, FloatArray]:
    rng = np.random.default_rng(5)
    return tuple(  # type: ignore[return-value]  # of two
        (scale * rng.uniform(-1, 1, (2, count))).astype(np.float32) for scale in (spread, 0.5)
    )


def test_a_tilted_plane_and_a_sphere_are_met_where_their_equations_hold() -> None:
    start, slope = rays(2000)
    tilt = np.deg2rad(30)
    plane = Flat(
        centre=(0.01, 0.0, 0.2),
        first=(float(np.cos(tilt)), 0.0, float(np.sin(tilt))),
        second=(0.0, 1.0, 0.0),
        size=(np.inf, np.inf),
        pattern=PATTERN,
    )
    z = plane.depth(start, slope, None)
    x = start[0] + z * slope[0]
    assert np.max(np.abs(z - 0.2 - np.tan(tilt) * (x - 0.01))) < 1e-6
    u, v = plane.place(start + z * slope, z)
    assert np.hypot(u, v) == pytest.approx(
        np.sqrt((x - 0.01) ** 2 + (start[1] + z * slope[1]) ** 2 + (z - 0.2) ** 2), abs=1e-6
    )
    sphere = Sphere(centre=(0.01, -0.02, 0.3), radius=0.1, pattern=PATTERN)
    z = sphere.depth(start, slope, None)
    met = np.isfinite(z)
    at = np.stack([*(start + np.where(met, z, 0) * slope), np.where(met, z, 0)]) - np.array([[0.01], [-0.02], [0.3]])
    assert 200 < met.sum() < 1800
    assert np.max(np.abs(np.hypot(np.hypot(at[0], at[1]), at[2])[met] - 0.1)) < 1e-6
    assert np.all(at[2][met] < 0.1 * 0.1)  # from the front


def brute_force(relief: HeightField, start: FloatArray, slope: FloatArray) -> FloatArray:
    """First crossing by many small steps."""
    near, far = relief.extent
    z = np.linspace(near * (1 - 1e-6), far * (1 + 1e-6), 8001)
    behind = np.stack([relief._gap(start, slope, np.full(start.shape[1], one, np.float32)) <= 0 for one in z])
    return np.where(behind.any(axis=0), z[np.argmax(behind, axis=0)], np.inf)


@pytest.mark.parametrize("perspective", [False, True])
def test_rays_meet_a_rugged_relief_where_they_first_cross_it(perspective: bool) -> None:
    rock = Rock(near=0.1, far=0.14, feature_size=0.02, hurst=0.4, seed=2, number=0, pattern=PATTERN).build()
    step = 0.004 if perspective else 5e-4
    depths = rock.depths[:SIDE, :SIDE]
    relief = HeightField(
        depths=depths,
        corner=(-step * (SIDE - 1) / 2,) * 2,
        step=step,
        perspective=perspective,
        repeats=False,
        pattern=PATTERN,
    )
    start, slope = rays(600, 0.01)
    expected = brute_force(relief, start, slope)
    resolution = 0.04 / 8000
    found, nearby = relief.approach(start, slope, 5e-4)
    assert np.mean(np.isfinite(found)) > 0.9
    # Grazing rays cross and come out again within a sample of the relief, which the search may step over.
    there = np.isfinite(found)  # the relief ends, its last depths go on only for the search
    assert np.mean(np.abs(found - expected)[there] < 3 * resolution) > 0.98
    beside = start + np.float32(3e-4)
    expected = brute_force(relief, beside, slope)
    found = relief.depth(beside, slope, nearby)
    assert 0.3 < np.mean(nearby.direct) < 1.0
    there = np.isfinite(found)
    assert np.mean(np.abs(found - expected)[there] < 5 * resolution) > 0.98


def test_a_ray_that_would_begin_behind_the_surface_still_meets_it() -> None:
    """Nearby rays leave a ray further than stated where cones of light are wide; the search then begins in front."""
    rock = Rock(near=0.1, far=0.14, feature_size=0.02, hurst=0.4, seed=2, number=0, pattern=PATTERN).build()
    start, slope = rays(600, 0.01)
    expected = rock.depth(start, slope, None)
    assert np.all(np.isfinite(expected))
    behind = Nearby(
        safe=np.asarray(expected + np.float32(1e-3)), met=expected, direct=np.zeros(expected.size, dtype=np.bool_)
    )
    assert rock.depth(start, slope, behind) == pytest.approx(expected, abs=1e-7)


def test_a_rock_lies_within_its_range_and_differs_with_its_seed() -> None:
    values = {"near": 0.14, "far": 0.16, "feature_size": 0.01, "hurst": 0.8, "number": 0, "pattern": PATTERN}
    first, second = (Rock(seed=seed, **values).build() for seed in (1, 2))
    for rock in (first, second):
        assert rock.extent == pytest.approx((0.14, 0.16), abs=1e-7)
    assert np.corrcoef(first.depths.ravel(), second.depths.ravel())[0, 1] < 0.2


@pytest.mark.parametrize("name", ["map.png", "map.tiff", "map.npy"])
def test_depth_maps_are_read_from_every_format(tmp_path: Path, name: str) -> None:
    depths = np.arange(1, 13, dtype=np.uint16).reshape(3, 4) * 1000
    if name.endswith("npy"):
        np.save(tmp_path / name, depths)
    else:
        Image.fromarray(depths if name.endswith("png") else depths.astype(np.float32)).save(tmp_path / name)
    assert read_depths(tmp_path / name, 1e-4) == pytest.approx(depths * 1e-4)


def test_a_depth_map_with_holes_and_a_file_that_is_not_one_are_refused(tmp_path: Path) -> None:
    Image.fromarray(np.array([[0, 7], [9, 9]], np.uint8)).save(tmp_path / "holes.png")
    with pytest.raises(OutOfRangeError, match=r"1 pixels of .*fill the holes"):
        read_depths(tmp_path / "holes.png", 1e-3)
    (tmp_path / "text.png").write_text("no picture")
    with pytest.raises(OutOfRangeError, match="cannot be read"):
        read_picture(tmp_path / "text.png")
    Image.fromarray(np.ones((4, 4), np.float32)).save(tmp_path / "whole.tiff")
    whole = (tmp_path / "whole.tiff").read_bytes()
    (tmp_path / "cut.tiff").write_bytes(whole[:40])  # warnings are errors here: none reaches the terminal
    with pytest.raises(OutOfRangeError, match="cannot be read"):
        read_depths(tmp_path / "cut.tiff", 1e-3)
    with pytest.raises(OutOfRangeError, match=r"none\.png: No such file or directory \(allowed"):
        read_depths(tmp_path / "none.png", 1e-3)


def test_a_picture_keeps_its_colours_and_its_rows(tmp_path: Path) -> None:
    colors = np.zeros((4, 4, 3), np.uint8)
    colors[:2, :, 0] = 200  # red above
    colors[2:, :, 2] = 100  # blue below
    Image.fromarray(colors).save(tmp_path / "colors.png")
    for from_top in (True, False):
        pattern = PicturePattern(file=tmp_path / "colors.png", sha256="", sample=1.0, from_top=from_top).build()
        x, y = np.array([2.0, 2.0], np.float32), np.array([0.5, 3.5], np.float32)
        level, share = pattern.mixture(np.zeros(2, np.float32))
        red, blue = (pattern.brightness(x, y, level, share, np.array([c, c])) for c in (0, 2))
        upper, lower = (0, 1) if from_top else (1, 0)
        assert red[upper] > 0
        assert red[lower] == 0
        assert blue[upper] == 0
        assert red[upper] == pytest.approx(2 * blue[lower])


def test_a_texture_darker_than_black_is_refused() -> None:
    with pytest.raises(OutOfRangeError, match="at most 30 %"):
        RandomPattern(texture=Texture(contrast=0.5, correlation_length=1e-3), sample=1e-4, side=64, seed=0)

"""Rays of exact directions: against rays traced one by one the other way, paraxial rays, and Kirchhoff as λ → 0."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.optics.small_chain import PITCH, camera, relative
from tests.optics.test_chain_mixed import image
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain import exact_rays
from tradestudy.optics.chain.accuracy import ChainAccuracy
from tradestudy.optics.chain.scene import (
    EXACT_RAYS,
    GEOMETRIC,
    KIRCHHOFF,
    Legs,
    LightPath,
    PixelGrid,
    hexagonal_centres,
    square_centres,
)
from tradestudy.optics.chain.sources import DiscSource
from tradestudy.optics.propagation.lens import CircularLens, PointSource

ASIDE = DiscSource(diameter=0.6e-3, distance=24e-3, x=0.13e-3, y=-0.06e-3)
CENTRED = DiscSource(diameter=0.6e-3, distance=24e-3)
SMALL = DiscSource(diameter=0.1e-3, distance=24e-3, x=0.05e-3, y=0.03e-3)
FINE = ChainAccuracy(tolerance=2e-3)
FAST_LENS = CircularLens(radius=0.45e-3, focal_length=2e-3, lens_phase="parabolic")  # f/2.2: aberration of many pixels


def fast(**changes: object) -> LightPath:
    """Steep enough that exact rays land pixels away from paraxial ones."""
    return camera(main_lens=FAST_LENS, pixels=PixelGrid(pitch=4e-6, shape=(17, 29)), **changes)


def one_by_one(path: LightPath, source: DiscSource, count: int, rng: np.random.Generator) -> FloatArray:
    """Parabolic lenses by Snell-like bending of unit vectors, rays drawn at random and dropped into pixels."""
    lens = path.main_lens
    r, turn = source.diameter / 2 * np.sqrt(rng.random(count)), 2 * math.pi * rng.random(count)
    s = np.column_stack([source.x + r * np.cos(turn), source.y + r * np.sin(turn), np.full(count, -source.distance)])
    r, turn = lens.radius * np.sqrt(rng.random(count)), 2 * math.pi * rng.random(count)
    u = np.column_stack([r * np.cos(turn), r * np.sin(turn), np.zeros(count)])
    towards = u - s
    length = np.linalg.norm(towards, axis=1)
    power = 1 / length**4
    inside = np.zeros(count, dtype=bool)
    direction = (towards / length[:, None])[:, :2] - u[:, :2] / lens.focal_length
    x = u[:, :2] + path.array_distance * direction / np.sqrt(1 - np.sum(direction**2, axis=1))[:, None]
    landing = np.full((count, 2), np.inf)
    for centre, focal_length in zip(path.microlenses.centres, path.microlenses.focal_lengths, strict=True):
        offset = x - centre
        inside = np.hypot(*offset.T) <= path.microlenses.aperture_width / 2
        bent = direction[inside] - offset[inside] / focal_length
        slope = bent / np.sqrt(1 - np.sum(bent**2, axis=1))[:, None]
        landing[inside] = x[inside] + path.detector_distance * slope
    edges = (path.pixels.edges_y, path.pixels.edges_x)
    return np.histogram2d(landing[:, 1], landing[:, 0], bins=edges, weights=power / power.sum())[0]


def start_rays_at(start: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Even where another plane would serve better."""
    monkeypatch.setattr(exact_rays, "start_of_rays", lambda *_: start)


@pytest.mark.parametrize("source", [ASIDE, CENTRED, SMALL], ids=["aside", "centred", "small"])
def test_a_disc_is_its_rays_traced_one_by_one(source: DiscSource) -> None:
    path = fast()
    count = 1_000_000
    drawn = one_by_one(path, source, count, np.random.default_rng(3))
    found = image(path, source, EXACT_RAYS, accuracy=ChainAccuracy(tolerance=5e-3))
    noise = math.sqrt(drawn.sum() / count) / float(np.linalg.norm(drawn))  # of counts that are drawn
    assert relative(found.pixels, drawn) < 2 * noise < 0.05
    assert found.pixels.sum() == pytest.approx(drawn.sum(), rel=5e-3)
    assert relative(image(path, source, GEOMETRIC).pixels, drawn) > 5 * noise  # paraxial rays are another picture


def test_a_point_is_the_limit_of_small_discs() -> None:
    point = PointSource(x=0.05e-3, y=0.03e-3, distance=24e-3)
    tiny = DiscSource(diameter=1e-6, distance=24e-3, x=point.x, y=point.y)
    of_point, of_disc = (image(camera(), one, EXACT_RAYS).pixels for one in (point, tiny))
    assert relative(of_disc, of_point) < 5e-3


def test_perfect_lenses_leave_paraxial_rays_as_they_are() -> None:
    main = CircularLens(radius=0.1e-3, focal_length=2e-3, lens_phase="perfect")
    path = camera(main_lens=main, lens_phase="perfect", pixels=PixelGrid(pitch=1.8e-6, shape=(21, 51)))
    exact, paraxial = (image(path, ASIDE, legs, accuracy=FINE) for legs in (EXACT_RAYS, GEOMETRIC))
    cosines = 3 * (0.3e-3 / 2.5e-3) ** 2  # cos⁴ of the steepest line behind the array, within it
    assert relative(exact.pixels, paraxial.pixels) < cosines + exact.numerical_error < 0.06
    assert exact.pixels.sum() == pytest.approx(paraxial.pixels.sum(), rel=3e-3)


@pytest.mark.slow
def test_kirchhoff_approaches_rays_as_the_wavelength_shrinks() -> None:
    path = fast()
    rays = image(path, CENTRED, EXACT_RAYS, accuracy=ChainAccuracy(tolerance=5e-3)).pixels
    apart = [
        relative(image(path, CENTRED, KIRCHHOFF, wavelength=w, accuracy=ChainAccuracy(tolerance=2e-2)).pixels, rays)
        for w in (1.2e-6, 0.3e-6)
    ]
    paraxial = relative(image(path, CENTRED, GEOMETRIC).pixels, rays)
    assert apart[1] < 0.6 * apart[0]
    assert apart[1] < 0.5 * paraxial


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"lens_phase": "stigmatic", "focus_distance": 0.3e-3},
        {"gaps": "clear"},
        {"aperture": "square"},
        {"layout": "hexagonal", "centres": hexagonal_centres(pitch=PITCH, rings=1), "focal_lengths": np.full(7, 76e-6)},
    ],
    ids=["parabolic", "stigmatic", "clear", "square", "hexagonal"],
)
def test_all_ways_of_tracing_agree_on_every_array(changes: dict[str, object], monkeypatch: pytest.MonkeyPatch) -> None:
    path, pictures = camera(**changes), []
    for start in ("detector", "array", "source"):
        start_rays_at(start, monkeypatch)
        pictures.append(image(path, ASIDE, EXACT_RAYS, accuracy=ChainAccuracy(tolerance=1e-2)).pixels)
    from_detector, from_array, from_source = pictures
    assert from_detector.sum() == pytest.approx(from_source.sum(), rel=1e-2)  # fading edges hold a little more
    assert from_array.sum() == pytest.approx(from_source.sum(), rel=2e-3)
    for one in (from_detector, from_array):
        assert 0 < relative(one, from_source) < 0.02


@pytest.mark.parametrize("diameter", [2e-3, 10e-3])
def test_an_array_lit_only_by_the_disc_receives_light_in_proportion_to_its_area(diameter: float) -> None:
    """d²s d²u = (a²/z²) d²x d²u cos⁴: the area of the array, seen through the middle of the pupil, over the disc's."""
    path = camera(gaps="clear", pixels=PixelGrid(pitch=20e-6, shape=(9, 9)))
    found = image(path, DiscSource(diameter=diameter, distance=24e-3), EXACT_RAYS, accuracy=FINE)
    array = 3 * PITCH**2 * (24e-3 / path.array_distance) ** 2
    cosines = 1 - (path.main_lens.radius / path.array_distance) ** 2  # mean over the pupil
    assert found.pixels.sum() == pytest.approx(cosines * array / (math.pi * diameter**2 / 4), rel=3e-4)
    assert found.numerical_error <= FINE.tolerance


@pytest.mark.parametrize("diameter", [0.1e-3, 0.5e-3, 2e-3, 10e-3])
@pytest.mark.parametrize("pitch", [4e-6, 2e-3])
def test_every_disc_meets_the_tolerance_with_the_predicted_number_of_rays(diameter: float, pitch: float) -> None:
    path = camera(pixels=PixelGrid(pitch=pitch, shape=(9, 23) if pitch < 1e-3 else (3, 3)))
    disc = DiscSource(diameter=diameter, distance=24e-3)
    found = image(path, disc, EXACT_RAYS, accuracy=FINE)
    assert 0 < found.numerical_error <= FINE.tolerance
    assert found.effort["rays"] < 2.1 * exact_rays.ray_count(path, disc, FINE) < 1e7


def test_symmetry_saves_work_and_changes_nothing() -> None:
    path = camera(
        centres=square_centres(pitch=PITCH, count=3),
        focal_lengths=np.full(9, 76e-6),
        pixels=PixelGrid(pitch=1.8e-6, shape=(45, 45)),
    )
    loose = ChainAccuracy(tolerance=1e-2)
    whole = image(path, CENTRED, EXACT_RAYS, accuracy=loose)
    other = image(path, replace(CENTRED, x=1e-12 + 2e-9 * PITCH, y=3e-9 * PITCH), EXACT_RAYS, accuracy=loose)
    assert relative(whole.pixels, other.pixels) < 1e-3  # the nodes on a lens have other symmetries
    assert whole.effort["rays"] < 0.4 * other.effort["rays"]


@pytest.mark.parametrize("start", ["detector", "array", "source"])
def test_the_stated_error_covers_the_true_one_and_shrinks_with_the_tolerance(start: str) -> None:
    lenses = {"centres": np.zeros((1, 2)), "focal_lengths": np.array([76e-6])} if start == "array" else {}
    path = camera(pixels=PixelGrid(pitch=4e-6 if start == "array" else 1.8e-6, shape=(11, 45)), **lenses)
    source = {"detector": ASIDE, "array": replace(ASIDE, diameter=1.5e-3), "source": SMALL}[start]
    assert exact_rays.start_of_rays(path, source) == start
    truth = image(path, source, EXACT_RAYS, accuracy=ChainAccuracy(tolerance=1.5e-3)).pixels
    before = math.inf
    for tolerance in (3e-2, 5e-3):
        found = image(path, source, EXACT_RAYS, accuracy=ChainAccuracy(tolerance=tolerance))
        assert relative(found.pixels, truth) <= found.numerical_error < before
        before = found.numerical_error


@pytest.mark.parametrize("start", ["array", "source"])
def test_rays_are_refined_where_the_first_ones_miss_the_tolerance(start: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Perfect lenses have the picture of a disc by exact areas of the pupil; the first rays are too few on purpose."""
    perfect = CircularLens(radius=0.1e-3, focal_length=2e-3, lens_phase="perfect")
    path, disc = camera(lens_phase="perfect", main_lens=perfect), DiscSource(diameter=0.6e-3, distance=24e-3)
    accuracy = ChainAccuracy(tolerance=2e-2)
    start_rays_at(start, monkeypatch)
    monkeypatch.setattr(exact_rays, "_ORDER", 1.0)
    found = image(path, disc, EXACT_RAYS, accuracy=accuracy)
    assert found.effort["rays"] > 1.5 * exact_rays.ray_count(path, disc, accuracy)
    assert relative(found.pixels, image(path, disc, GEOMETRIC).pixels) < found.numerical_error <= accuracy.tolerance


def test_samples_of_the_detector_are_refined_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """A narrow image of a steep microlens is nearly all edge."""
    path = camera(
        centres=np.zeros((1, 2)), focal_lengths=np.array([60e-6]), pixels=PixelGrid(pitch=1.8e-6, shape=(15, 15))
    )
    disc, accuracy = DiscSource(diameter=2.2e-3, distance=24e-3), ChainAccuracy(tolerance=2e-2)
    assert exact_rays.start_of_rays(path, disc) == "detector"
    found = image(path, disc, EXACT_RAYS, accuracy=accuracy)
    assert found.effort["rays"] > 1.5 * exact_rays.ray_count(path, disc, accuracy)
    start_rays_at("array", monkeypatch)
    truth = image(path, disc, EXACT_RAYS, accuracy=ChainAccuracy(tolerance=8e-3)).pixels
    assert relative(found.pixels, truth) < found.numerical_error <= accuracy.tolerance


def test_cases_beyond_rays_are_refused() -> None:
    with pytest.raises(OutOfRangeError, match="exact rays beside waves"):
        Legs(to_array="geometric", to_detector="kirchhoff", exact=True)
    centres = PixelGrid(pitch=4e-6, shape=(9, 23), integrated=False)
    with pytest.raises(OutOfRangeError, match="rays at the centre of a pixel"):
        image(camera(pixels=centres), ASIDE, EXACT_RAYS)
    with pytest.raises(OutOfRangeError, match="coherent disc"):
        image(camera(), replace(ASIDE, coherent=True), EXACT_RAYS)

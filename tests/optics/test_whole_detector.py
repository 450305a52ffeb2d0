"""Where light of a spot is followed: on patches while they do, over the whole detector where they would not."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.optics.small_chain import PITCH, WAVELENGTH, camera, relative
from tradestudy.errors import UnaffordableError
from tradestudy.optics.chain import spot_points as module
from tradestudy.optics.chain.accuracy import ChainAccuracy, ChainImage
from tradestudy.optics.chain.detector_patch import DetectorPatch
from tradestudy.optics.chain.image import chain_image
from tradestudy.optics.chain.point_image import compute_point
from tradestudy.optics.chain.scene import KIRCHHOFF, Legs, LightPath, PixelGrid, square_centres
from tradestudy.optics.chain.sources import DiscSource
from tradestudy.optics.chain.spot_points import SpotRequest
from tradestudy.optics.propagation.lens import CircularLens, PointSource

WIDE = CircularLens(radius=0.4e-3, focal_length=2e-3, lens_phase="parabolic")  # lights all three microlenses
DISC = DiscSource(diameter=0.1e-3, distance=24e-3)
FINE, COARSE = ChainAccuracy(tolerance=1e-3), ChainAccuracy(tolerance=5e-2)
MIXED = Legs(to_array="geometric", to_detector="kirchhoff")


def patch(path: LightPath, accuracy: ChainAccuracy) -> DetectorPatch:
    return asked(path, KIRCHHOFF, accuracy).patch


def asked(path: LightPath, legs: Legs, accuracy: ChainAccuracy) -> SpotRequest:
    return SpotRequest(path=path, source=DISC, wavelength=WAVELENGTH, legs=legs, accuracy=accuracy)


def errors_of_points(path: LightPath, legs: Legs, accuracy: ChainAccuracy) -> list[float]:
    """Relative distance of a few points of the disc from their own, far finer computation."""
    spot = asked(path, legs, accuracy).prepared()
    nodes, found = spot.request.nodes, []
    for x, y in nodes.all[:: len(nodes.all) // 4]:
        at = (float(x), float(y))
        wave = spot.request.wave(*at)
        truth = compute_point(wave, legs.to_detector, ChainAccuracy(tolerance=1e-5)).pixels / wave.power()
        found.append(relative(spot.light(at).on_pixels(spot), truth))
    return found


@pytest.mark.parametrize("legs", [KIRCHHOFF, MIXED], ids=["waves", "rays to the array"])
def test_points_keep_a_thousandth_where_patches_cannot(legs: Legs, monkeypatch: pytest.MonkeyPatch) -> None:
    """In focus, what microlenses throw on their neighbours' pixels interferes; patches know only how much it is."""
    path = camera(main_lens=WIDE)
    assert patch(path, FINE).whole_detector
    assert max(errors_of_points(path, legs, FINE)) < 2e-4
    choose = module.detector_patch
    patches = ChainAccuracy(tolerance=1e-3, memory_limit=1.0)  # the whole detector takes more at once
    monkeypatch.setattr(module, "detector_patch", lambda *a, accuracy, **k: choose(*a, accuracy=patches, **k))
    assert min(errors_of_points(path, legs, FINE)) > 5e-4


def test_the_cheaper_method_is_chosen_unless_it_misses_the_tolerance() -> None:
    row = camera(main_lens=WIDE)
    assert not patch(row, COARSE).whole_detector
    large = camera(
        main_lens=WIDE,
        centres=square_centres(pitch=PITCH, count=21),
        focal_lengths=np.full(441, 76e-6),
        pixels=PixelGrid(pitch=4e-6, shape=(137, 137)),
    )
    assert not patch(large, ChainAccuracy(tolerance=1e-2, memory_limit=8e9)).whole_detector
    alone = camera(
        main_lens=WIDE,
        centres=np.zeros((1, 2)),
        focal_lengths=np.array([76e-6]),
        pixels=PixelGrid(pitch=4e-6, shape=(7, 7)),
    )
    assert not patch(alone, COARSE).whole_detector
    assert patch(alone, FINE).whole_detector
    assert not patch(alone, ChainAccuracy(tolerance=1e-3, memory_limit=1.0)).whole_detector


@pytest.mark.parametrize(
    ("pixels", "limit"),
    [(PixelGrid(pitch=50e-3, shape=(3, 3)), 2e9), (PixelGrid(pitch=4e-6, shape=(9, 23)), 1e6)],
    ids=["wide pixels", "little memory"],
)
def test_work_beyond_the_memory_is_refused_before_it_starts(pixels: PixelGrid, limit: float) -> None:
    shares: list[float] = []
    with pytest.raises(UnaffordableError, match=r"nodes, .* samples, .* GB .*raise the memory limit"):
        chain_image(
            camera(pixels=pixels), DISC, wavelength=WAVELENGTH, legs=KIRCHHOFF, done=shares.append,
            accuracy=ChainAccuracy(tolerance=1e-2, memory_limit=limit), rng=np.random.default_rng(0),
        )  # fmt: skip
    assert shares == []


def test_corners_of_patches_contain_no_light_invented_by_too_few_nodes() -> None:
    """On wide patches more nodes of the microlenses change nothing, far from the ray images, too."""
    path = camera(main_lens=WIDE, pixels=PixelGrid(pitch=4e-6, shape=(61, 61)))
    found = []
    for density in (1.0, 2.0):
        chosen = ChainAccuracy(tolerance=1e-2, diffraction_reach=2.0, microlens_nodes=density)
        spot = asked(path, KIRCHHOFF, chosen).prepared()
        assert not spot.request.patch.whole_detector
        found.append(spot.light((0.0, 0.0)).on_pixels(spot))
    assert relative(found[0], found[1]) < 1e-5


@pytest.mark.parametrize("x", [0.0, 0.6e-3])
@pytest.mark.slow
def test_averages_over_the_source_have_the_stated_error(x: float) -> None:
    """Against a disc of many more nodes, whose shadow moves across every microlens: a slow fall of all spectra.

    Off the axis one side of the disc is dark, and shows nothing of the other.
    """
    path, disc = camera(main_lens=WIDE), DiscSource(x=x, diameter=1.2e-3, distance=24e-3)

    def image(sampling: float) -> ChainImage:
        return chain_image(
            path, disc, wavelength=WAVELENGTH, legs=KIRCHHOFF, rng=np.random.default_rng(0),
            accuracy=ChainAccuracy(tolerance=1e-2, source_sampling=sampling),
        )  # fmt: skip

    truth = image(1.1).pixels
    for sampling in (0.35, 0.6) if x == 0.0 else (0.6,):
        found = image(sampling)
        error = relative(found.pixels, truth)
        # The radii at which the main lens's field is known are as many as the nodes call for: single points show that.
        stated = math.hypot(*(found.error_terms[f"source {name}"] for name in ("angles", "radii")))
        assert error < (stated if x == 0.0 else found.numerical_error), sampling
        assert 0.5 * error < stated < 6 * error, sampling


@pytest.mark.parametrize("extended", [False, True], ids=["point", "disc"])
def test_a_window_narrower_than_a_fresnel_length_is_the_middle_of_a_wide_one(extended: bool) -> None:
    """Where the band ends with the window its edge rings on every pixel: light is followed beyond."""
    source = DISC if extended else PointSource(distance=24e-3)

    def image(side: int) -> ChainImage:
        path = camera(
            centres=np.zeros((1, 2)),
            focal_lengths=np.array([0.6e-3]),
            aperture_width=13e-6,
            pitch=14e-6,
            detector_distance=0.63e-3,
            pixels=PixelGrid(pitch=3.5e-6, shape=(side, side)),
        )
        return chain_image(
            path, source, wavelength=WAVELENGTH, legs=KIRCHHOFF, rng=np.random.default_rng(0),
            accuracy=ChainAccuracy(tolerance=1e-4),
        )  # fmt: skip

    narrow, wide = image(5), image(55)
    assert narrow.numerical_error < 1e-3
    assert relative(narrow.pixels, wide.pixels[25:30, 25:30]) < narrow.numerical_error + wide.numerical_error

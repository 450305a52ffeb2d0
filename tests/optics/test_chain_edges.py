"""Boundary waves behind the microlenses, against quadrature written elsewhere and Kirchhoff's integral."""

from __future__ import annotations

import numpy as np
import pytest

from tests.optics.small_chain import PITCH, WAVELENGTH, camera, relative
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.chain.accuracy import ChainAccuracy, ChainImage
from tradestudy.optics.chain.image import unguarded_image, unguarded_separate_image
from tradestudy.optics.chain.scene import LegMethod, Legs, LightPath, PixelGrid
from tradestudy.optics.chain.sources import DiscSource
from tradestudy.optics.propagation.lens import CircularLens, PointSource

ON, OFF = PointSource(distance=24e-3), PointSource(x=0.13e-3, y=-0.06e-3, distance=24e-3)
WIDE = CircularLens(radius=0.4e-3, focal_length=2e-3, lens_phase="parabolic")  # lights all three microlenses
OUT_OF_FOCUS = np.array([55e-6, 110e-6, 140e-6])  # by 1 to 2 Fresnel zones; 76 µm would be in focus
FIRST: tuple[LegMethod, ...] = ("geometric", "boundary_wave", "fresnel", "kirchhoff")


def image(
    path: LightPath, source: PointSource | DiscSource, first: LegMethod, last: LegMethod, tolerance: float
) -> ChainImage:
    # `chain_image` refuses perfect microlenses, whose light is the sphere that these laws carry in closed form.
    return unguarded_image(
        path, source, wavelength=WAVELENGTH, legs=Legs(to_array=first, to_detector=last),
        accuracy=ChainAccuracy(tolerance=tolerance), rng=np.random.default_rng(7),
    )  # fmt: skip


@pytest.mark.parametrize("first", FIRST)
@pytest.mark.parametrize("source", [ON, OFF])
@pytest.mark.parametrize("phase", ["parabolic", "perfect"])
def test_a_point_is_kirchhoffs_within_its_stated_error(first: LegMethod, source: PointSource, phase: str) -> None:
    path = camera(main_lens=WIDE, lens_phase=phase, focal_lengths=OUT_OF_FOCUS)
    edge, area = (image(path, source, first, last, 1e-2) for last in ("boundary_wave", "kirchhoff"))
    change = relative(edge.pixels, area.pixels)
    assert 1e-4 < change < edge.numerical_error + area.numerical_error < 0.04
    assert area.handed_over == 0.0
    assert edge.handed_over < 0.1


@pytest.mark.parametrize("width", [24e-6, 48e-6])
def test_far_from_focus_it_equals_the_integral(width: float) -> None:
    """The closed form is exact for spheres, but for the obliquity: no leading term of anything."""
    path = camera(
        centres=np.zeros((1, 2)), focal_lengths=np.full(1, 300e-6), aperture_width=width, pitch=2 * PITCH,
        main_lens=WIDE, lens_phase="perfect", pixels=PixelGrid(pitch=4e-6, shape=(15, 15)),
    )  # fmt: skip
    edge, area = (image(path, ON, "geometric", last, 1e-4) for last in ("boundary_wave", "kirchhoff"))
    assert edge.handed_over == pytest.approx(0.0, abs=1e-12)
    assert 1e-12 < relative(edge.pixels, area.pixels) < edge.numerical_error + area.numerical_error < 5e-4


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"main_lens": WIDE, "focal_lengths": np.full(3, 76e-6)},
        {"main_lens": WIDE, "focal_lengths": np.full(3, 10e-6), "pixels": PixelGrid(pitch=40e-6, shape=(3, 5))},
    ],
    ids=["cut", "in focus", "steeper than any ray"],
)
def test_points_in_focus_or_cut_by_a_shadow_are_left_to_kirchhoff(changes: dict[str, object]) -> None:
    """No microlens is lit as a whole, or all are in focus, or have no rays: the very same picture, all handed over."""
    edge, area = (image(camera(**changes), OFF, "geometric", last, 1e-3) for last in ("boundary_wave", "kirchhoff"))
    assert edge.handed_over == 1.0
    np.testing.assert_allclose(edge.pixels, area.pixels, rtol=0, atol=1e-12 * area.pixels.max())


@pytest.mark.parametrize("first", ["geometric", "kirchhoff"])
def test_a_disc_is_kirchhoffs_within_its_stated_error(first: LegMethod) -> None:
    path = camera(main_lens=WIDE, lens_phase="perfect", focal_lengths=OUT_OF_FOCUS)
    disc = DiscSource(diameter=0.1e-3, distance=24e-3)
    edge, area = (image(path, disc, first, last, 5e-2) for last in ("boundary_wave", "kirchhoff"))
    assert 1e-4 < relative(edge.pixels, area.pixels) < edge.numerical_error + area.numerical_error < 0.1
    # The light of rays is one sphere throughout, that of waves holds what the edge of the main lens adds.
    assert edge.handed_over < 1e-12 if first == "geometric" else 1e-3 < edge.handed_over < 0.5


def test_light_through_gaps_is_left_to_kirchhoff() -> None:
    """Clear gaps: their share of the light, and no more, is handed over; perfect lenses keep the rest from focus."""
    path = camera(main_lens=WIDE, lens_phase="perfect", gaps="clear", focal_lengths=OUT_OF_FOCUS)
    edge, area = (image(path, ON, "geometric", last, 1e-2) for last in ("boundary_wave", "kirchhoff"))
    assert relative(edge.pixels, area.pixels) < edge.numerical_error + area.numerical_error < 0.04
    gap = 1 - np.pi / 4 * (24 / 26) ** 2
    assert gap - 1e-9 < edge.handed_over < gap + 0.02


def test_microlenses_without_a_main_lens() -> None:
    path = camera(
        main_lens=WIDE, lens_phase="perfect", focal_lengths=OUT_OF_FOCUS, pixels=PixelGrid(pitch=4e-6, shape=(6, 20))
    )
    edge, area = (
        unguarded_separate_image(
            path, ON, wavelength=WAVELENGTH, legs=Legs(to_array="geometric", to_detector=last),
            accuracy=ChainAccuracy(tolerance=1e-2), rng=np.random.default_rng(0),
        )
        for last in ("boundary_wave", "kirchhoff")
    )  # fmt: skip
    assert relative(edge.pixels, area.pixels) < edge.numerical_error + area.numerical_error < 0.04


def test_it_has_no_squares_and_no_coherent_discs() -> None:
    with pytest.raises(OutOfRangeError, match="circular apertures"):
        image(camera(aperture="square"), ON, "geometric", "boundary_wave", 1e-2)
    with pytest.raises(OutOfRangeError, match="coherent"):
        image(camera(), DiscSource(diameter=1e-4, distance=24e-3, coherent=True), "kirchhoff", "boundary_wave", 1e-2)

"""What a picture is without cross-talk and without integration over pixels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.chain.accuracy import ChainAccuracy
from tradestudy.optics.chain.image import chain_image, separate_image
from tradestudy.optics.chain.scene import FRESNEL, GEOMETRIC, LightPath, Microlenses, PixelGrid, square_centres
from tradestudy.optics.chain.sources import DiscSource
from tradestudy.optics.propagation.lens import CircularLens, PointSource

WAVELENGTH, PITCH, COUNT = 550e-9, 60e-6, 8
ACCURACY = ChainAccuracy(tolerance=1e-4)
POINT = PointSource(x=0.2e-3, y=-0.1e-3, distance=0.1)


def two_by_two(**pixels: object) -> LightPath:
    lenses = Microlenses(
        centres=square_centres(pitch=PITCH, count=2), focal_lengths=np.full(4, 0.3e-3), aperture="circular",
        aperture_width=50e-6, pitch=PITCH, layout="square", gaps="opaque", lens_phase="parabolic",
    )  # fmt: skip
    grid = PixelGrid(pitch=2 * PITCH / 16, shape=(16, 16))
    return LightPath(
        main_lens=CircularLens(radius=0.8e-3, focal_length=8e-3, lens_phase="parabolic"), microlenses=lenses,
        array_distance=9.6e-3, detector_distance=0.45e-3, pixels=replace(grid, **pixels),
    )  # fmt: skip


def image(
    path: LightPath,
    source: PointSource | DiscSource = POINT,
    legs: object = FRESNEL,
    accuracy: ChainAccuracy = ACCURACY,
) -> np.ndarray:
    rng = np.random.default_rng(0)
    return chain_image(path, source, wavelength=WAVELENGTH, legs=legs, accuracy=accuracy, rng=rng).pixels  # type: ignore[arg-type]  # Legs


@pytest.mark.parametrize("legs", [FRESNEL, GEOMETRIC])
def test_without_crosstalk_each_quarter_shows_its_own_microlens(legs: object) -> None:
    path = two_by_two()
    found = separate_image(
        path, POINT, wavelength=WAVELENGTH, legs=legs, accuracy=ACCURACY, rng=np.random.default_rng(0)  # type: ignore[arg-type]  # Legs
    ).pixels  # fmt: skip
    for index, (x, y) in enumerate(path.microlenses.centres):
        alone = replace(path.microlenses, centres=np.array([[x, y]]), focal_lengths=path.microlenses.focal_lengths[:1])
        whole = image(replace(path, microlenses=alone), legs=legs)  # on all pixels, in place of its window
        rows, columns = (slice(0, COUNT) if c < 0 else slice(COUNT, 2 * COUNT) for c in (y, x))
        scale = float(np.linalg.norm(found))
        assert np.linalg.norm(found[rows, columns] - whole[rows, columns]) < 5e-4 * scale, index
    lost = image(path, legs=legs).sum() - found.sum()
    assert abs(lost) < 0.2 * found.sum()


def test_a_sample_at_the_centre_is_the_integral_over_a_fifteenth_of_the_pixel() -> None:
    """The mean over a pixel of side d differs from its centre by O(d²): fifteen times finer leaves a 225th."""
    coarse = two_by_two()
    sampled = image(two_by_two(integrated=False)) / coarse.pixels.pitch**2
    fine = PixelGrid(pitch=coarse.pixels.pitch / 15, shape=(240, 240))
    middle = image(replace(coarse, pixels=fine))[7::15, 7::15] / fine.pitch**2
    whole = image(coarse) / coarse.pixels.pitch**2
    assert np.linalg.norm(sampled - whole) > 0.05 * np.linalg.norm(sampled)
    assert np.linalg.norm(sampled - middle) < np.linalg.norm(sampled - whole) / 100


def test_a_disc_is_sampled_as_its_points_are() -> None:
    """A spot far below the resolution is a point."""
    path = two_by_two(integrated=False)
    small = DiscSource(diameter=1e-6, distance=0.1, x=POINT.x, y=POINT.y)
    disc = image(path, small, accuracy=ChainAccuracy(tolerance=2e-3))
    assert np.linalg.norm(disc - image(path)) < 1e-2 * np.linalg.norm(disc)


def test_rays_have_no_light_at_a_point() -> None:
    with pytest.raises(OutOfRangeError, match="centre of a pixel"):
        image(two_by_two(integrated=False), legs=GEOMETRIC)

"""What microlenses and pixels a point's light is followed on: those that its tolerance feels, whatever lies around."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.optics.small_chain import PITCH, WAVELENGTH, camera, relative
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain import landing
from tradestudy.optics.chain import point_image as module
from tradestudy.optics.chain.accuracy import ChainAccuracy, ChainImage
from tradestudy.optics.chain.array_field import PupilWave
from tradestudy.optics.chain.image import chain_image
from tradestudy.optics.chain.lit_part import LitPart, lit_part, reached_pixels
from tradestudy.optics.chain.point_image import compute_point
from tradestudy.optics.chain.scene import KIRCHHOFF, Legs, LightPath, PixelGrid, square_centres
from tradestudy.optics.propagation.kernels import direct_sum
from tradestudy.optics.propagation.lens import CircularLens, PointSource

LENS = CircularLens(radius=0.3e-3, focal_length=2e-3, lens_phase="parabolic")
WAVES_THEN_RAYS = Legs(to_array="kirchhoff", to_detector="geometric")
SOURCE = PointSource(x=0.05e-3, y=0.02e-3, distance=24e-3)


def array(across: int) -> LightPath:
    pixels = 1 + 2 * round(across * PITCH / 8e-6)
    return camera(
        main_lens=LENS,
        centres=square_centres(pitch=PITCH, count=across),
        focal_lengths=np.full(across**2, 76e-6),
        pixels=PixelGrid(pitch=4e-6, shape=(pixels, pixels)),
    )


def wave(path: LightPath) -> PupilWave:
    return PupilWave(path=path, source=SOURCE, wavelength=WAVELENGTH, method="kirchhoff")


def image(path: LightPath, tolerance: float, legs: Legs = KIRCHHOFF) -> ChainImage:
    return chain_image(
        path, SOURCE, wavelength=WAVELENGTH, legs=legs, accuracy=ChainAccuracy(tolerance=tolerance),
        rng=np.random.default_rng(0),
    )  # fmt: skip


@pytest.mark.parametrize("legs", [KIRCHHOFF, WAVES_THEN_RAYS])
def test_work_grows_with_the_light_and_not_with_the_array(legs: Legs) -> None:
    nodes = [image(array(across), 5e-2, legs).effort["microlens nodes"] for across in (9, 21)]
    assert nodes[0] == nodes[1]


@pytest.fixture(scope="module")
def whole_by_waves() -> FloatArray:
    """The picture from all microlenses on all pixels, far finer."""
    path = array(9)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "lit_part", lambda wave, _accuracy: LitPart(wave=wave, lost=0.0))
        patch.setattr(module, "reached_pixels", lambda path, _: tuple(slice(0, n) for n in path.pixels.shape))
        found = compute_point(wave(path), "kirchhoff", ChainAccuracy(tolerance=1e-4))
    return found.pixels / wave(path).power()


@pytest.fixture(scope="module")
def whole_by_rays() -> FloatArray:
    """The picture from all microlenses, far finer."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(landing, "lit_part", lambda wave, _accuracy: LitPart(wave=wave, lost=0.0))
        return image(array(9), 1e-4, WAVES_THEN_RAYS).pixels


@pytest.mark.parametrize("tolerance", [5e-2, 1e-2, 2e-3])
def test_omitted_light_is_within_the_stated_error(tolerance: float, whole_by_waves: FloatArray) -> None:
    path = array(9)
    found = image(path, tolerance)
    assert lit_part(wave(path), ChainAccuracy(tolerance=tolerance)).lost > 0.0
    assert relative(found.pixels, whole_by_waves) <= found.numerical_error <= 2 * tolerance
    assert 0.0 < found.error_terms["unlit microlenses"] <= tolerance / 2


@pytest.mark.parametrize("tolerance", [5e-2, 1e-2, 2e-3])
def test_rays_behind_waves_state_what_is_left_out(tolerance: float, whole_by_rays: FloatArray) -> None:
    found = image(array(9), tolerance, WAVES_THEN_RAYS)
    assert relative(found.pixels, whole_by_rays) <= found.numerical_error <= 2 * tolerance
    assert 0.0 < found.error_terms["unlit microlenses"] <= tolerance / 2


def test_the_estimate_of_dark_microlenses_agrees_with_direct_quadrature() -> None:
    """The power on each microlens that is left out, over that on all of them, within the fringes of the law."""
    path = array(9)
    lit = lit_part(wave(path), ChainAccuracy(tolerance=5e-2))
    kept = {tuple(one) for one in np.round(lit.wave.path.microlenses.centres, 12)}
    dark = np.array([one for one in path.microlenses.centres if tuple(np.round(one, 12)) not in kept])
    rng = np.random.default_rng(0)
    at = dark[:, None] + PITCH * rng.uniform(-0.5, 0.5, (len(dark), 40, 2))
    x, y = at.reshape(-1, 2).T
    one = wave(path)
    samples = one.samples(one.nodes((x, y), density=1.2))
    field = direct_sum(samples, one.kernel, x, y, np.full(x.size, path.array_distance))
    power = np.mean(np.abs(field.reshape(len(dark), -1)) ** 2, axis=1) * PITCH**2 / one.power()
    assert np.sqrt(np.sum(power**2)) <= lit.lost <= 10 * np.sqrt(np.sum(power**2))


def test_all_microlenses_stay_where_light_may_come_from_everywhere() -> None:
    path = array(9)
    coherent = replace(wave(path), coherent_radius=1e-4)
    assert lit_part(coherent, ChainAccuracy(tolerance=5e-2)).wave is coherent


def test_pixels_outside_the_light_are_left_out() -> None:
    path = replace(array(9), microlenses=array(1).microlenses)
    rows, columns = reached_pixels(path, 10e-6)
    edges = path.pixels.edges_y
    far = path.microlenses.cell_reach + 10e-6
    assert edges[rows.start] <= -far < edges[rows.start + 1]
    assert edges[rows.stop - 1] < far <= edges[rows.stop]
    assert rows == columns
    aside = replace(path, pixels=PixelGrid(pitch=4e-6, shape=(5, 5), centre=(1e-3, 0.0)))
    assert all(part.stop - part.start >= 1 for part in reached_pixels(aside, 10e-6))

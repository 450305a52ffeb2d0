"""Where points land in raw pictures, how blurred, and how much light passes: held against the paper's equations."""

from __future__ import annotations

import numpy as np
import pytest

from tests.imaging.figure_7 import (
    APERTURE,
    F_L,
    GAP,
    PITCH,
    PIXEL,
    PUPIL,
    F,
    Z,
    figure_7,
    lit_share,
    picture,
    places,
    wall,
)
from tradestudy.cameras.light_cones import LightCones
from tradestudy.cameras.parts import Lens
from tradestudy.cameras.single_lens import SingleLensExposure
from tradestudy.imaging.models import Texture
from tradestudy.imaging.scenes.pattern import RandomPattern, pattern_of
from tradestudy.optics.arrays import FloatArray


def relay(distance: float) -> tuple[float, float]:
    """Image distance b_M and a_L = z − b_M of a point [m]."""
    b = F * distance / (distance - F)
    return b, Z - b


def landing(cones: LightCones, where: FloatArray, point: FloatArray, distance: float) -> FloatArray:
    """Where on the sensor [m] light of a point lands through the middle of each cone's lens, shape (2, cones)."""
    missed = point[:, None] - (cones.start + distance * cones.slope)
    return where[:, cones.pixel] + missed / (cones.start_by_pixel + distance * np.asarray(cones.slope_by_pixel))


@pytest.mark.parametrize(("distance", "v"), [(0.15, 2.785), (0.3, 3.795), (1.0, 4.451)])
def test_a_point_lands_where_equation_4_puts_it(distance: float, v: float) -> None:
    exposure = figure_7()
    where = np.stack(places(exposure, slice(0, 256), slice(0, 256)))
    b, a_l = relay(distance)
    assert a_l / GAP == pytest.approx(v, abs=6e-4)
    point = np.array([0.7e-3, -0.4e-3])
    cones = exposure.cones(*where)
    found = landing(cones, where, point, distance)
    # Which microlens a cone goes through follows from where its ray crosses the array.
    s = where[:, cones.pixel]
    on_lens = -cones.start
    centre = s + (on_lens - s) * GAP / (Z + GAP)
    lattice = np.linalg.solve(PITCH * np.array([[1.0, 0.5], [0.0, np.sqrt(0.75)]]), centre)
    assert np.allclose(lattice, np.rint(lattice), atol=1e-6)
    image = point * b / distance
    expected = centre + (centre - image[:, None]) * GAP / a_l
    assert np.max(np.abs(found - expected)) < 1e-3 * PIXEL
    seeing = np.unique(np.rint(lattice).astype(int), axis=1)
    assert seeing.shape[1] > 60


@pytest.mark.parametrize(
    ("distance", "spacing", "blur", "partly_lit"),
    [(0.15, 31.26, 0.006, None), (0.3, 29.06, 1.97, 2), (1.0, 28.17, 2.77, 3)],
)
def test_micro_images_of_a_small_spot(distance: float, spacing: float, blur: float, partly_lit: int | None) -> None:
    """Their places, their width, and in microlenses that are only partly lit their shift."""
    b, a_l = relay(distance)
    width, size = 1.5, 512  # standard deviation and period in samples, of which a pixel has two
    at = np.minimum(np.arange(size) + 0.5, size - np.arange(size) - 0.5)
    spot = np.exp(-0.5 * (at[:, None] ** 2 + at[None, :] ** 2) / width**2)
    sample = 0.5 * PIXEL * a_l / GAP * distance / b
    scene = wall(pattern_of(spot[None], sample), distance)
    exposure, area = figure_7(pixels=200), (slice(85, 115), slice(90, 110 if partly_lit is None else 200))
    raw = picture(exposure, scene, *area, samples=2048)
    x, y = (grid.reshape(raw.shape) / PIXEL for grid in places(exposure, *area))

    def micro_image(number: int) -> tuple[float, float, float]:
        """Centre and variance along x of the micro-image of a lens on the x axis [px]."""
        near = np.where(np.hypot(x - number * spacing, y) < 9.0, raw, 0.0)
        share = near / near.sum()
        centre = float(np.sum(share * x))
        return centre, float(np.sum(share * y)), float(np.sum(share * (x - centre) ** 2))

    assert micro_image(0)[:2] == pytest.approx((0.0, 0.0), abs=1.5e-3)
    known = 1 / 12 + (width / 2) ** 2 + 0.5**2 / 6  # the pixel, the spot, and its interpolation between samples
    assert 4 * np.sqrt(max(micro_image(0)[2] - known, 0.0)) == pytest.approx(blur, abs=0.05)
    if partly_lit is None:
        return
    exact = PITCH / PIXEL * (1 + GAP / a_l)
    assert exact == pytest.approx(spacing, abs=5e-3)
    assert micro_image(1)[:2] == pytest.approx((exact, 0.0), abs=1.5e-3)
    # Forwards: every point of the spot fills a disc on the array, of which the aperture of a microlens takes a part,
    # and its light lands where eq. 4 says, shifted by h b_L (1/b_L + 1/a_L − 1/f_L) on its way through h.
    rng = np.random.default_rng(1)
    count = 1_000_000
    on_object = sample * (width * rng.standard_normal((2, count)) + rng.random((2, count)) - rng.random((2, count)))
    h = APERTURE * (rng.random((2, count)) - 0.5)
    centre = np.array([[partly_lit * PITCH], [0.0]])
    lit = (np.hypot(*h) < APERTURE / 2) & (np.hypot(*(centre + h - on_object * Z / distance)) < a_l * PUPIL / 2 / b)
    spread = GAP * (1 / GAP + 1 / a_l - 1 / F_L)
    lands = (centre + (centre - on_object * b / distance) * GAP / a_l + h * spread)[0, lit].mean() / PIXEL
    assert abs(h[0, lit].mean() * spread / PIXEL) > 0.1
    assert micro_image(partly_lit)[:2] == pytest.approx((lands, 0.0), abs=0.01)


def test_opaque_gaps_pass_the_fraction_of_the_array_that_microlenses_fill() -> None:
    exposure = figure_7(pixels=600)
    cones = exposure.cones(*places(exposure, slice(10, 589), slice(1, 598)))  # 14 and 25 periods of the white picture
    conventional = SingleLensExposure(
        name="image",
        sensor=exposure.sensor,
        lens=Lens(focal_length=F, f_number=3.8),
        focus_distance=1 / (1 / F - 1 / (Z + GAP)),
    ).cones(*places(exposure, slice(10, 589), slice(1, 598)))
    share = lit_share(cones).sum() / lit_share(conventional).sum()
    assert share == pytest.approx(np.pi / 4 * APERTURE**2 / (np.sqrt(0.75) * PITCH**2), rel=2e-3)
    assert share == pytest.approx(0.7327, rel=2e-3)


def test_without_power_microlenses_leave_the_conventional_picture() -> None:
    """Their apertures cast shadows; divided by a white picture, what remains is that of the main lens alone."""
    gap = 0.1e-3
    focus = 1 / (1 / F - 1 / (Z + gap))
    texture = RandomPattern(
        texture=Texture(contrast=0.2, correlation_length=1e-3), sample=20e-6, side=1024, seed=1
    ).build()
    white = pattern_of(np.ones((1, 64, 64)), 1e-3)
    raw = figure_7(focal_lengths=(1e6,), gap=gap)
    conventional = SingleLensExposure(
        name="image", sensor=raw.sensor, lens=Lens(focal_length=F, f_number=3.8), focus_distance=focus
    )
    area = (slice(40, 140), slice(60, 160))
    shadow = picture(raw, wall(white, focus), *area)
    lit = shadow > 0.2 * shadow.max()
    assert 0.5 < lit.mean() < 0.9
    seen = picture(raw, wall(texture, focus), *area)[lit] / shadow[lit]
    plain = (picture(conventional, wall(texture, focus), *area) / picture(conventional, wall(white, focus), *area))[lit]
    assert np.std(plain) > 0.1
    assert np.std(seen - plain) < 0.01

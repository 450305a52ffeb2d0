"""Light beyond the patches of a spot: its amount, its law, and the picture that it completes."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from scipy import integrate, special

from tests.optics.small_chain import WAVELENGTH, camera, relative
from tradestudy.optics.chain.accuracy import ChainAccuracy, far_light
from tradestudy.optics.chain.point_image import compute_point
from tradestudy.optics.chain.scene import KIRCHHOFF, PixelGrid
from tradestudy.optics.chain.sources import DiscSource
from tradestudy.optics.chain.spot_points import SpotRequest
from tradestudy.optics.propagation.lens import CircularLens


def test_the_transfer_equals_the_light_that_leaves_the_patches() -> None:
    """All of it over the plane: beyond a square of half side H falls the share h/H. None falls on the patch."""
    grid = PixelGrid(pitch=2e-6, shape=(801, 801))
    found = far_light(grid, np.array([[5e-6, -3e-6], [0.0, 8e-6]]), 40e-6, np.array([0.25, 0.5]), np.zeros(2))
    assert found.sum() == pytest.approx(0.75 * (1 - 40 / 801), rel=0.02)
    assert np.all(found[400 - 15 : 400 + 15, 400 - 15 : 400 + 15] == 0.0)


def test_its_decay_follows_airy_s_law() -> None:
    """Beyond v a focused lens leaves J₀² + J₁² of its light, on average 2/(π v): as 1/r³ does."""
    v = np.linspace(60.0, 60.0 + 20 * math.pi, 4001)
    left = special.j0(v) ** 2 + special.j1(v) ** 2
    assert np.trapezoid(left * v, v) / (v[-1] - v[0]) == pytest.approx(2 / math.pi, rel=1e-3)
    light = far_light(PixelGrid(pitch=1e-6, shape=(601, 601)), np.zeros((1, 2)), 20e-6, np.ones(1), np.zeros(1))
    centres = 1e-6 * (np.arange(601) - 300)
    radius = np.hypot(centres, centres[:, None])
    rings = [r * light[(radius > r) & (radius <= 2 * r)].sum() for r in (40e-6, 80e-6, 140e-6)]
    assert max(rings) < 1.02 * min(rings)


@pytest.mark.parametrize("pitch", [1e-6, 17e-6])
@pytest.mark.parametrize("radius", [10e-6, 25e-6, 34e-6])
def test_a_blurred_disc_follows_the_same_law(radius: float, pitch: float) -> None:
    """Its law, integrated over pixels, is all that left: over those as well that are wider than from rays to patch."""
    half, side = 40e-6, 2 * round(600e-6 / pitch) + 1
    grid = PixelGrid(pitch=pitch, shape=(side, side))
    moved = np.array([[0.3 * pitch, 0.45 * pitch]])
    found = far_light(grid, moved, half, np.ones(1), np.array([radius])).sum()
    edge = side * pitch / 2

    def beyond(square: float) -> float:
        """By quadrature over azimuth and distance from a square on."""
        inner, _ = integrate.dblquad(
            lambda r, phi: 0.5 * (1 / (r - radius) ** 2 + 1 / (r + radius) ** 2),
            0.0, math.pi / 4, lambda phi: square / math.cos(phi), lambda phi: 1.0, epsrel=1e-8,
        )  # fmt: skip
        return 8 * inner

    assert found == pytest.approx(1 - beyond(edge) / beyond(half), rel=0.05)


def test_the_law_of_a_blurred_disc_is_that_of_its_edge() -> None:
    """Kirchhoff's light well outside a disc of rays, averaged over rings and fringes, beside 1/r³."""
    v_edge, share = 40.0, np.linspace(1.4, 2.4, 6)
    found = []
    for v in v_edge * share:  # Lommel: a uniform pupil, defocused until its rays fill a disc of v_edge
        around = v + np.linspace(-math.pi, math.pi, 41)
        found.append(np.mean([_defocused(one, v_edge) for one in around]))
    law = (share**2 + 1) / (share * (share**2 - 1) ** 2)
    scale = np.array(found) / law
    assert scale.max() < 1.15 * scale.min()
    assert np.ptp(np.log(np.array(found) * share**3)) > 3 * np.ptp(np.log(scale))


@cache
def _rule() -> tuple[np.ndarray, np.ndarray]:
    t, w = np.polynomial.legendre.leggauss(400)
    return (t + 1) / 2, w / 2


def _defocused(v: float, v_edge: float) -> float:
    """Irradiance of a circular pupil with a quadratic phase, by direct quadrature."""
    t, w = _rule()
    return float(abs(np.sum(w * t * special.j0(v * t) * np.exp(0.5j * v_edge * t**2))) ** 2)


def test_points_keep_their_light() -> None:
    """Against the whole detector at once, points of a spot miss hardly any light together, and far more without."""
    path = camera(
        main_lens=CircularLens(radius=0.4e-3, focal_length=2e-3, lens_phase="parabolic"),
        pixels=PixelGrid(pitch=4e-6, shape=(39, 51)),
    )
    accuracy, disc = ChainAccuracy(tolerance=1e-2), DiscSource(diameter=0.1e-3, distance=24e-3)
    spot = SpotRequest(path=path, source=disc, wavelength=WAVELENGTH, legs=KIRCHHOFF, accuracy=accuracy).prepared()
    nodes = spot.request.nodes
    whole, followed, completed = (np.zeros(path.pixels.shape) for _ in range(3))
    for x, y in nodes.all[:: len(nodes.all) // 6]:
        at = (float(x), float(y))
        wave, light = spot.request.wave(*at), spot.light(at)
        full = ChainAccuracy(tolerance=1e-4, diffraction_reach=3.0)
        whole += compute_point(wave, "kirchhoff", full).pixels / wave.power()
        completed += light.on_pixels(spot)
        followed += light.on_pixels(spot) - light.far
    missing = 1 - followed.sum() / whole.sum()
    assert missing > 2e-3
    assert abs(1 - completed.sum() / whole.sum()) < 0.2 * missing
    assert relative(completed, whole) < relative(followed, whole)

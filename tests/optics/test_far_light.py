"""Light beyond the patches of a spot: its amount, its law, and the picture that it completes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import special

from tests.optics.small_chain import WAVELENGTH, camera, relative
from tradestudy.optics.chain import KIRCHHOFF, ChainAccuracy, DiscSource, PixelGrid
from tradestudy.optics.chain.far_light import far_light
from tradestudy.optics.chain.point_image import compute_point
from tradestudy.optics.chain.sources import source_nodes
from tradestudy.optics.chain.spot_image import source_density
from tradestudy.optics.chain.spot_points import point_light, prepare_spot, tables_at
from tradestudy.optics.propagation.lens import CircularLens


def test_it_is_what_leaves_the_patches() -> None:
    """All of it over the plane: beyond a square of half side H falls the share h/H. None falls on the patch."""
    grid = PixelGrid(pitch=2e-6, shape=(801, 801))
    found = far_light(grid, np.array([[5e-6, -3e-6], [0.0, 8e-6]]), 40e-6, np.array([0.25, 0.5]))
    assert found.sum() == pytest.approx(0.75 * (1 - 40 / 801), rel=0.02)
    assert np.all(found[400 - 15 : 400 + 15, 400 - 15 : 400 + 15] == 0.0)


def test_its_law_is_airys() -> None:
    """Beyond v a focused lens leaves J₀² + J₁² of its light, on average 2/(π v): as 1/r³ does."""
    v = np.linspace(60.0, 60.0 + 20 * math.pi, 4001)
    left = special.j0(v) ** 2 + special.j1(v) ** 2
    assert np.trapezoid(left * v, v) / (v[-1] - v[0]) == pytest.approx(2 / math.pi, rel=1e-3)
    light = far_light(PixelGrid(pitch=1e-6, shape=(601, 601)), np.zeros((1, 2)), 20e-6, np.ones(1))
    centres = 1e-6 * (np.arange(601) - 300)
    radius = np.hypot(centres, centres[:, None])
    rings = [r * light[(radius > r) & (radius <= 2 * r)].sum() for r in (40e-6, 80e-6, 140e-6)]
    assert max(rings) < 1.02 * min(rings)


def test_points_keep_their_light() -> None:
    """Against the whole detector at once, points of a spot miss hardly any light together, and far more without."""
    path = camera(
        main_lens=CircularLens(radius=0.4e-3, focal_length=2e-3, lens_phase="parabolic"),
        pixels=PixelGrid(pitch=4e-6, shape=(39, 51)),
    )
    accuracy, disc = ChainAccuracy(tolerance=1e-2), DiscSource(diameter=0.1e-3, distance=24e-3)
    nodes = source_nodes(path, disc, wavelength=WAVELENGTH, density=source_density(accuracy))
    spot = prepare_spot(path, disc, nodes, WAVELENGTH, KIRCHHOFF, accuracy)
    whole, followed, completed = (np.zeros(path.pixels.shape) for _ in range(3))
    for x, y in nodes.all[:: len(nodes.all) // 6]:
        at = (float(x), float(y))
        wave, light = spot.wave(*at), point_light(spot, at, tables_at(spot, [at])[at])
        full = ChainAccuracy(tolerance=1e-4, diffraction_reach=3.0)
        whole += compute_point(wave, "kirchhoff", full).pixels / wave.power()
        completed += light.on_pixels(spot)
        followed += light.on_pixels(spot) - light.far
    missing = 1 - followed.sum() / whole.sum()
    assert missing > 2e-3
    assert abs(1 - completed.sum() / whole.sum()) < 0.2 * missing
    assert relative(completed, whole) < relative(followed, whole)

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import j1

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.quadrature import QuadratureNodes, disc_nodes, gauss_legendre, rectangle_nodes


def disc_moment(i: int, j: int, radius: float) -> float:
    """Integral of x^i y^j over a disc about the origin, in closed form."""
    if i % 2 or j % 2:
        return 0.0
    angular = 2 * math.gamma((i + 1) / 2) * math.gamma((j + 1) / 2) / math.gamma((i + j) / 2 + 1)
    return angular * radius ** (i + j + 2) / (i + j + 2)


@pytest.mark.parametrize(("rings", "angles"), [(1, 3), (2, 7), (3, 11), (5, 20)])
def test_disc_rule_is_exact_to_its_stated_degree_and_no_further(rings: int, angles: int):
    radius = 1.7
    nodes = disc_nodes(radius=radius, radial_count=rings, angular_count=angles)
    for i in range(angles):
        for j in range(angles - i):
            if i + j <= 4 * rings - 2:
                found = np.sum(nodes.weights * nodes.x**i * nodes.y**j)
                assert found == pytest.approx(disc_moment(i, j, radius), abs=2e-14 * radius ** (i + j + 2))
    beyond = 4 * rings  # the first even power of the radius that the rings miss
    power = np.sum(nodes.weights * (nodes.x**2 + nodes.y**2) ** (beyond // 2))
    exact = 2 * math.pi * radius ** (beyond + 2) / (beyond + 2)
    assert abs(power / exact - 1) > 1e-12


def test_disc_rule_converges_faster_than_any_power_on_a_plane_wave():
    turns = 30.0  # k R; the integral is 2π R² J1(k R)/(k R)
    exact = 2 * math.pi * j1(turns) / turns
    errors = []
    for rings in (8, 12, 16, 20):
        nodes = disc_nodes(radius=1.0, radial_count=rings, angular_count=4 * rings, centre=(0.3, -0.2))
        wave = np.exp(1j * turns * ((nodes.x - 0.3) * 0.6 + (nodes.y + 0.2) * 0.8))
        errors.append(abs(np.sum(nodes.weights * wave) - exact))
    slopes = np.diff(np.log(errors)) / np.diff(np.log([8, 12, 16, 20]))
    assert errors[-1] < 1e-13
    assert slopes[1] < slopes[0] < 0  # steeper with every refinement
    assert slopes[1] < -10


def test_rectangle_rule_is_exact_for_products_of_polynomials():
    nodes = rectangle_nodes(width=2.0, height=3.0, counts=(3, 4), centre=(1.0, -0.5))
    for i in range(6):
        for j in range(8):
            in_x = (2.0 ** (i + 1) - 0.0) / (i + 1)
            in_y = (1.0 ** (j + 1) - (-2.0) ** (j + 1)) / (j + 1)
            found = np.sum(nodes.weights * nodes.x**i * nodes.y**j)
            assert found == pytest.approx(in_x * in_y, rel=1e-13, abs=1e-12)
    assert nodes.half_extent == 1.5


@pytest.mark.parametrize("count", [1, 2, 5, 24, 100, 240])
def test_gauss_legendre_rules_agree_with_numpy(count: int):
    x, w = np.polynomial.legendre.leggauss(count)
    nodes, weights = gauss_legendre(count)
    np.testing.assert_allclose(nodes, (x + 1) / 2, atol=3e-15)
    np.testing.assert_allclose(weights, w / 2, rtol=1e-10)
    assert weights.sum() == pytest.approx(1.0, abs=1e-13)


@pytest.mark.parametrize(
    "make",
    [
        lambda: disc_nodes(radius=0.0, radial_count=2, angular_count=2),
        lambda: disc_nodes(radius=math.inf, radial_count=2, angular_count=2),
        lambda: disc_nodes(radius=1.0, radial_count=0, angular_count=2),
        lambda: rectangle_nodes(width=-1.0, height=1.0, counts=(2, 2)),
        lambda: rectangle_nodes(width=1.0, height=math.nan, counts=(2, 2)),
        lambda: rectangle_nodes(width=1.0, height=1.0, counts=(2, 0)),
        lambda: QuadratureNodes(x=np.zeros(2), y=np.zeros(3), weights=np.zeros(2), centre=(0.0, 0.0), half_extent=1.0),
    ],
)
def test_impossible_rules_are_refused(make):
    with pytest.raises(OutOfRangeError):
        make()


def test_rings_with_fewer_angles_inside_integrate_what_turns_less_there() -> None:
    """∬ cos(f·r) over a disc is 2πR² J₁(fR)/(fR); a ring of radius r needs more than f r angles."""
    relative = np.sqrt(gauss_legendre(14)[0])
    angles = np.ceil(20.0 * relative + 6 * np.cbrt(np.maximum(20.0 * relative, 1.0))).astype(int) + 3
    nodes = disc_nodes(radius=2.0, radial_count=14, angular_count=angles)
    assert nodes.count == angles.sum() < 0.85 * 14 * angles[-1]
    expected = 2 * np.pi * 4.0 * j1(20.0) / 20.0
    value = nodes.weights @ np.cos(6.0 * nodes.x + 8.0 * nodes.y)
    assert value == pytest.approx(expected, abs=1e-7)
    few = disc_nodes(radius=2.0, radial_count=14, angular_count=angles // 2)
    assert abs(few.weights @ np.cos(6.0 * few.x + 8.0 * few.y) - expected) > 1e-3

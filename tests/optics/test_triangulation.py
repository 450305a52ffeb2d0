"""Equations 3 to 6 and 8 against an ABCD ray trace written here, 40-digit arithmetic, and published numbers."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from tradestudy.optics.thin_lens import (
    main_lens_image_coordinate,
    object_distance_of_virtual_depth,
    project_to_detector,
    virtual_depth,
)
from tradestudy.optics.triangulation import (
    midpoint_depth,
    plenoptic_depth,
    stereo_depth,
    stereo_disparity,
)

KEPLERIAN = {"mla_distance": 14.773e-3, "microlens_gap": 0.568e-3, "focal_length": 12.5e-3}
GALILEAN = {"mla_distance": 11.607e-3, "microlens_gap": 0.4464e-3, "focal_length": 12.5e-3}
EPSILON = 2.0**-52


def plenoptic_depth_condition(
    object_distance: float, *, mla_distance: float, microlens_gap: float, focal_length: float
) -> float:
    """Σ |∂ ln a / ∂ ln p| over p = Δσ, Δx, b_L (each contributes b_L |v| (f/s)² / a), z and f."""
    a, f, z = object_distance, focal_length, mla_distance
    a_L = microlens_gap * float(virtual_depth(a, z, microlens_gap, f))
    slope = ((a - f) / f) ** 2  # |∂a/∂s|
    return (3.0 * abs(a_L) * slope + z * slope + f * (a / f) ** 2) / abs(a)


def ray(height: float, slope: float, *elements: tuple[tuple[float, float], tuple[float, float]]) -> tuple[float, float]:
    """Follow a paraxial ray (height, slope) through ABCD matrices."""
    for (a, b), (c, d) in elements:
        height, slope = a * height + b * slope, c * height + d * slope
    return height, slope


def space(length: float) -> tuple[tuple[float, float], tuple[float, float]]:
    return ((1.0, length), (0.0, 1.0))


def lens(f: float) -> tuple[tuple[float, float], tuple[float, float]]:
    return ((1.0, 0.0), (-1.0 / f, 1.0))


def chief_ray_through_microlens(xi: float, a: float, center: float, relay: dict[str, float]) -> float:
    """Absolute detector coordinate of the object ray that passes the centre of one microlens, undeviated there."""
    f, z, gap = relay["focal_length"], relay["mla_distance"], relay["microlens_gap"]

    def height_at_array(slope: float) -> tuple[float, float]:
        return ray(xi, slope, space(a), lens(f), space(z))

    # The system is linear in the starting slope: two trial rays give the one through the centre.
    low, high = height_at_array(0.0)[0], height_at_array(1.0)[0]
    slope = (center - low) / (high - low)
    height, angle = height_at_array(slope)
    return height + gap * angle


@pytest.mark.parametrize("relay", [KEPLERIAN, GALILEAN], ids=["keplerian", "galilean"])
@pytest.mark.parametrize("a", [0.06, 0.15, 0.3, 1.0, 10.0])
@pytest.mark.parametrize("center", [0.0, 126.5e-6, -3 * 126.5e-6])
def test_equation_4_is_the_chief_ray_in_local_coordinates(relay: dict[str, float], a: float, center: float) -> None:
    xi = 2.3e-3
    traced = chief_ray_through_microlens(xi, a, center, relay) - center
    assert float(project_to_detector(xi, a, center, **relay)) == pytest.approx(traced, rel=1e-9)


@pytest.mark.parametrize("relay", [KEPLERIAN, GALILEAN], ids=["keplerian", "galilean"])
@pytest.mark.parametrize("a", [0.06, 0.15, 0.3, 1.0, 10.0])
def test_equation_8_finds_the_distance_of_traced_rays(relay: dict[str, float], a: float) -> None:
    centers = (0.0, 126.5e-6)
    local = [chief_ray_through_microlens(1e-3, a, center, relay) - center for center in centers]
    depth = plenoptic_depth(local[0] - local[1], centers[0] - centers[1], **relay)
    assert float(depth) == pytest.approx(a, rel=1e-8)


def test_absolute_coordinates_in_equation_8_turn_300_mm_into_a_third_of_it() -> None:
    centers = np.array([0.0, 126.5e-6])
    local = project_to_detector(0.0, 0.3, centers, **KEPLERIAN)
    absolute = local + centers
    wrong = plenoptic_depth(absolute[0] - absolute[1], centers[0] - centers[1], **KEPLERIAN)
    assert 0.08 < float(wrong) < 0.11


@pytest.mark.parametrize("relay", [KEPLERIAN, GALILEAN], ids=["keplerian", "galilean"])
@pytest.mark.parametrize("a", [0.01, 0.06, 0.15, 1.0, 1e2, 1e4, 1e6, 1e8])
def test_projection_and_disparity_to_1e_12(relay: dict[str, float], a: float) -> None:
    xi, center = 1e-3, 253e-6
    with mpmath.workdps(40):
        f, z, gap = (mpmath.mpf(relay[key]) for key in ("focal_length", "mla_distance", "microlens_gap"))
        # Equation 4 as the paper prints it, and its difference for two microlenses.
        denominator = a * f - z * (a - f)
        sigma = -xi * f * gap / denominator + mpmath.mpf(center) * (f - a) * gap / denominator
        disparity = mpmath.mpf(center) * (f - a) * gap / denominator
        a_L = z - a * f / (a - f)
        # How much of the relative accuracy of z − f and s survives their subtraction.
        condition = float((z - f + abs(f * f / (a - f))) / abs(a_L))
    tolerance = max(1e-12, 10 * condition * EPSILON)
    assert tolerance <= 1e-12
    assert float(project_to_detector(xi, a, center, **relay)) == pytest.approx(float(sigma), rel=tolerance)
    assert center / float(virtual_depth(a, **relay)) == pytest.approx(float(disparity), rel=tolerance)
    x_image = float(-mpmath.mpf(xi) * f / (a - f))
    assert float(main_lens_image_coordinate(xi, a, relay["focal_length"])) == pytest.approx(x_image, rel=1e-12)


@settings(max_examples=300)
@given(
    a=st.floats(0.03, 1e8),
    f=st.floats(1e-3, 25e-3),
    share=st.floats(-0.3, 0.5),
    gap=st.floats(0.1e-3, 1e-3),
)
def test_forward_then_backward_is_the_identity_within_the_condition_number(
    a: float, f: float, share: float, gap: float
) -> None:
    assume(a > 1.2 * f)
    relay = {"mla_distance": f * (1 + share), "microlens_gap": gap, "focal_length": f}
    assume(abs(float(virtual_depth(a, **relay))) > 1e-6)
    condition = plenoptic_depth_condition(a, **relay)
    back = float(plenoptic_depth(126.5e-6 / virtual_depth(a, **relay), 126.5e-6, **relay))
    bound = 10 * condition * EPSILON
    # Where the bound reaches the pole, infinity is as near as rounding allows.
    assert abs(back / a - 1) <= bound or (bound > 0.1 and math.isinf(back))


@pytest.mark.parametrize("a", [0.08, 0.3, 3.0, 300.0])
@pytest.mark.parametrize("relay", [KEPLERIAN, GALILEAN], ids=["keplerian", "galilean"])
def test_condition_number_is_the_measured_sensitivity(relay: dict[str, float], a: float) -> None:
    """Perturb every input by one part in 10⁹ at 50 digits and add up what depth does."""
    step = mpmath.mpf(10) ** -9
    with mpmath.workdps(50):
        names = ("disparity", "baseline", "microlens_gap", "mla_distance", "focal_length")

        def depth(values: dict[str, mpmath.mpf]) -> mpmath.mpf:
            f = values["focal_length"]
            shift = values["mla_distance"] - f - values["microlens_gap"] * values["baseline"] / values["disparity"]
            return f + f * f / shift

        inputs = {name: mpmath.mpf(relay[name]) for name in names[2:]}
        inputs["baseline"] = mpmath.mpf(1)
        f, exact = inputs["focal_length"], mpmath.mpf(a)
        inputs["disparity"] = inputs["microlens_gap"] / (inputs["mla_distance"] - f - f * f / (exact - f))
        total = sum(abs(depth(inputs | {name: inputs[name] * (1 + step)}) / exact - 1) / step for name in names)
    assert plenoptic_depth_condition(a, **relay) == pytest.approx(float(total), rel=1e-4)


def test_poles_are_outcomes() -> None:
    f, z, gap = 12.5e-3, 14.773e-3, 0.568e-3
    at_array = 1 / (1 / f - 1 / z)
    assert abs(float(virtual_depth(at_array, z, gap, f))) < 1e-12
    assert float(plenoptic_depth(gap * 1.0 / (z - f), 1.0, **KEPLERIAN)) > 1e8  # the disparity of infinity
    assert np.isinf(plenoptic_depth(0.9 * gap / (z - f), 1.0, **KEPLERIAN))  # beyond it
    assert np.isinf(plenoptic_depth(0.0, 1.0, **KEPLERIAN))
    assert object_distance_of_virtual_depth((z - f) / gap, z, gap, f) == math.inf
    assert np.isnan(object_distance_of_virtual_depth((z - f) / gap + 0.1, z, gap, f))
    assert float(object_distance_of_virtual_depth(2.0, z, gap, f)) == pytest.approx(0.150, rel=1e-3)


@pytest.mark.parametrize("angle", [0.0, 0.1, -0.05])
@pytest.mark.parametrize("z", [0.01, 0.5, 10.0, 1e8])
def test_stereo_disparity_and_depth_to_1e_12(z: float, angle: float) -> None:
    B, f = 0.1, 30.5e-3
    with mpmath.workdps(40):
        half = mpmath.mpf(angle) / 2
        d = 2 * mpmath.mpf(f) * mpmath.tan(mpmath.atan(mpmath.mpf(B) / (2 * mpmath.mpf(z))) - half)
    assert float(stereo_disparity(z, B, f, convergence_angle=angle)) == pytest.approx(float(d), rel=1e-12)
    # Towards infinity a converging rig subtracts its own angle; the condition is that of tan φ − tan θ/2.
    condition = 1 + abs(math.tan(angle / 2)) / (B / (2 * z))
    back = float(stereo_depth(stereo_disparity(z, B, f, convergence_angle=angle), B, f, convergence_angle=angle))
    assert back == pytest.approx(z, rel=max(1e-12, 10 * condition * EPSILON))


def test_stereo_poles() -> None:
    assert np.isinf(stereo_depth(0.0, 0.1, 0.03))
    assert np.isinf(stereo_depth(-1e-6, 0.1, 0.03))
    assert stereo_disparity(math.inf, 0.1, 0.03) == 0.0


@given(x=st.floats(-0.5, 0.5), y=st.floats(-0.5, 0.5), z=st.floats(0.2, 50.0))
def test_midpoint_of_rays_that_meet_is_the_point(x: float, y: float, z: float) -> None:
    left, right = np.array([-0.05, 0.0, 0.0]), np.array([0.05, 0.0, 0.0])
    point = np.array([x, y, z])
    found = float(midpoint_depth(point - left, (point - right) * 3.0, left, right))
    assert found == pytest.approx(z, rel=1e-9)


def test_midpoint_of_skew_rays_is_halfway_between_them() -> None:
    # One ray along z at x = −1, one at y = 0.2 towards −x that reaches x = −1 at z = 5: the gap is 0.2 in y, at z = 5.
    left, right = np.array([-1.0, 0.0, 0.0]), np.array([1.0, 0.2, 0.0])
    assert float(midpoint_depth(np.array([0.0, 0.0, 1.0]), np.array([-2.0, 0.0, 5.0]), left, right)) == pytest.approx(
        5.0
    )
    assert np.isinf(midpoint_depth(np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, 1.0]), left, right))

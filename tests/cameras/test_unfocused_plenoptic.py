"""The unfocused plenoptic camera: rays traced through pupil, array and pixels; least squares solved outright."""

import dataclasses
import math

import mpmath
import numpy as np
import pytest

from tests.cameras.builders import F_L, PITCH, depth_read
from tests.cameras.builders import F_MAIN as F_M
from tests.cameras.builders import unfocused as camera
from tradestudy.cameras.depth_camera import UsableCriteria
from tradestudy.cameras.focus import BlurCriterion
from tradestudy.cameras.parts import Lens, Sensor
from tradestudy.errors import OutOfRangeError

A0, PIXEL = 0.15, 5.5e-6
DISTANCES = np.array([0.05, 0.1, 0.149, 0.151, 0.3, 2.0])


def pupil_of_pixel(pixel_offset, gap, mla_distance):
    """Where the ray from a pixel through the centre of its microlens crosses the main lens."""
    return pixel_offset * mla_distance / gap


def crossing_on_array(distance, pupil, focal_length, mla_distance):
    """Where the ray from an axial point through a place in the pupil crosses the array, at thirty digits."""
    a, u, f, z = (mpmath.mpf(value) for value in (distance, pupil, focal_length, mla_distance))
    return u + (u / a - u / f) * z


def test_published_microlens_aperture_and_fill_factor():
    array = camera().microlenses
    assert array.aperture_diameter == pytest.approx(113.7e-6, abs=0.05e-6)
    assert array.aperture_diameter / array.pitch < 1.0


def test_views_are_the_pixels_whose_rays_pass_the_pupil():
    found = camera()
    z = 1 / (1 / F_M - 1 / A0)
    half = range(-11, 12)  # 23 pixels under a microlens, one of them in its middle
    passing = [
        (i, j)
        for i in half
        for j in half
        if math.hypot(pupil_of_pixel(i * PIXEL, F_L, z), pupil_of_pixel(j * PIXEL, F_L, z)) <= F_M / 3.8 / 2
    ]
    assert found.views == len(passing)
    assert found.views_across == len({i for i, j in passing if j == 0})
    assert found.estimator_baseline == pytest.approx(
        pupil_of_pixel((max(i for i, _ in passing) - min(i for i, _ in passing)) * PIXEL, F_L, z), rel=1e-12
    )


def test_disparity_is_the_distance_of_two_traced_rays_on_the_array():
    found = camera()
    z, du = 1 / (1 / mpmath.mpf(F_M) - 1 / mpmath.mpf(A0)), found.estimator_baseline
    for distance in DISTANCES:
        with mpmath.workdps(30):
            apart = crossing_on_array(distance, du / 2, F_M, z) - crossing_on_array(distance, -du / 2, F_M, z)
        assert found.disparity(distance) == pytest.approx(float(apart), rel=1e-9, abs=1e-15)
    assert found.disparity_of_infinity(1.0) == pytest.approx(float(du * (1 - z / F_M)), rel=1e-9)
    np.testing.assert_allclose(found.depth_of_disparity(found.disparity(DISTANCES), 1.0), DISTANCES, rtol=1e-12)
    assert found.depth_of_disparity(found.disparity_of_infinity(1.0) - 1e-9, 1.0) == math.inf


def test_a_shift_of_one_microlens_between_neighbouring_views_is_the_refocus_distance():
    found = camera()
    neighbours = found.disparity(0.1) * found.view_pupil_diameter / found.estimator_baseline
    assert found.refocus_distance(neighbours / PITCH) == pytest.approx(0.1, rel=1e-12)


def test_least_squares_baseline_is_that_of_the_solved_normal_equations():
    found = camera(estimator="least-squares")
    positions = found.view_positions
    # Each view sees the point at (x₀ + κ u, y₀ + κ v), one error for each coordinate; the slope κ is z (1/a − 1/a₀).
    ones, zeros = np.ones(len(positions)), np.zeros(len(positions))
    design = np.vstack(
        (np.column_stack((ones, zeros, positions[:, 0])), np.column_stack((zeros, ones, positions[:, 1])))
    )
    slope_error = math.sqrt(np.linalg.inv(design.T @ design)[2, 2])  # for unit error of one coordinate
    # A pair Δu apart has the slope error √2/Δu.
    assert found.estimator_baseline == pytest.approx(math.sqrt(2.0) / slope_error, rel=1e-9)
    fine = camera(estimator="least-squares", sensor=Sensor(columns=99, rows=99, pixel_pitch=PIXEL / 10))
    many = math.sqrt(math.pi / 16) * fine.main_lens.pupil_diameter**2 / fine.view_pupil_diameter
    assert fine.estimator_baseline == pytest.approx(many, rel=2e-3)  # views all over a round pupil


def read_with(found, distance, **off):
    """Depth of a fixed picture by intersecting the two rays of a camera that is not what the picture was taken with."""
    with mpmath.workdps(30):
        z0 = 1 / (1 / mpmath.mpf(F_M) - 1 / mpmath.mpf(A0))
        pixels_apart = found.estimator_baseline * F_L / z0
        left, right = (crossing_on_array(distance, s * found.estimator_baseline / 2, F_M, z0) for s in (-1, 1))
        right += mpmath.mpf(off.get("pixel_noise", 0.0))
        z, f, gap = (
            z0 + off.get("mla_distance", 0.0),
            F_M + off.get("focal_length", 0.0),
            F_L + off.get("microlens_gap", 0.0),
        )
        pupil = pixels_apart * z / gap / 2
        # Two rays from (∓pupil, lens) to (left, right, array): where they meet is the image.
        image = z * 2 * pupil / (2 * pupil - (right - left))
        return float(1 / (1 / f - 1 / image))


@pytest.mark.parametrize(
    "off",
    [
        {"pixel_noise": 8e-6},
        {"mla_distance": 3e-6},
        {"focal_length": -2e-6},
        {"microlens_gap": 1e-6},
        {"pixel_noise": -5e-6, "mla_distance": 2e-6, "focal_length": 3e-6, "microlens_gap": -1e-6},
    ],
)
def test_errors_of_calibration_read_a_fixed_picture_as_intersected_rays_do(off):
    found = camera()
    for distance in DISTANCES:
        assert depth_read(found, distance, **off)[0] == pytest.approx(read_with(found, distance, **off), rel=1e-9)


def test_it_measures_as_well_as_the_stereo_rig_of_its_equivalent_baseline():
    found = camera(disparity_error_px=1e-4, discrimination_step_px=1e-4)
    error = 1e-4 * PITCH  # in microlenses, and so small that depth is linear in it
    # dZ = Z² δd/(f B).
    expected = 0.15**2 * error / (F_M * found.equivalent_baseline(0.15))
    assert found.noise(0.15) == pytest.approx(error)
    farther, nearer = depth_read(found, 0.15, pixel_noise=[-error, error])[:, 0]
    assert (farther - nearer) / 2 == pytest.approx(expected, rel=1e-6)
    nearer, farther = found.depth_discrimination(np.array([0.15]))
    assert nearer[0] < expected < farther[0]


def test_refocusing_reaches_as_far_as_each_view_is_sharp():
    found = camera()
    limits = found.focus.sharp_range(BlurCriterion(blur_px=0.5, measure="none", wavelength=550e-9)).slices
    near = float(limits.near[0])
    with mpmath.workdps(30):
        edges = [crossing_on_array(near, s * found.view_pupil_diameter / 2, F_M, found.mla_distance) for s in (1, -1)]
    assert float(abs(edges[0] - edges[1])) == pytest.approx(0.5 * PITCH, rel=1e-9)
    assert found.blur_px(near) == pytest.approx(0.5, rel=1e-9)
    assert found.focus.lateral_resolution(A0) == pytest.approx(PITCH * A0 / found.mla_distance, rel=1e-12)


def test_limits_of_the_usable_range():
    found = camera()
    limits = found.limits(np.array([0.01, 0.15, 40.0]), UsableCriteria(blur_px=0.1, disparity_step_px=0.1))
    assert limits["real_image"].met.tolist() == [False, True, True]
    assert limits["focus"].met.tolist() == [False, True, False]
    # One step from infinity: a = Δu z/step.
    last = found.estimator_baseline * found.mla_distance / (0.1 * PITCH)
    assert limits["last_disparity_step"].met.tolist() == [True, True, last > 40.0]
    assert set(found.limits(0.15, UsableCriteria())) == {"real_image"}


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"focus_distance": 10e-3}, "focus that close"),
        ({"main_lens": Lens(focal_length=F_M, f_number=60.0)}, "views across"),
        ({"disparity_error_px": 0.0}, "disparity error"),
        (
            {"microlenses": dataclasses.replace(camera().microlenses, gap=0.5e-3)},
            "one focal length before the sensor",
        ),
    ],
)
def test_impossible_cameras_are_refused_in_words(changes, what):
    with pytest.raises(OutOfRangeError, match=what):
        camera(**changes)


def test_unknown_errors_are_refused():
    with pytest.raises(OutOfRangeError, match="no such error"):
        depth_read(camera(), 0.15, yaw=1e-3)

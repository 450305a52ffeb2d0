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
    assert found.refocusing.distance(neighbours / PITCH) == pytest.approx(0.1, rel=1e-12)


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
    fine = camera(estimator="least-squares", sensor=Sensor(columns=990, rows=990, pixel_pitch=PIXEL / 10))
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
def test_calibration_errors_act_on_a_fixed_picture_as_intersected_rays_do(off):
    found = camera()
    for distance in DISTANCES:
        assert depth_read(found, distance, **off)[0] == pytest.approx(read_with(found, distance, **off), rel=1e-9)


def view_on_array(point, distance, offset, *, f, z, gap, pupil_to_array):
    """Where a ray from a point meets the array, if the pixel it ends on is so far from its white-image centre.

    The white image is that of the middle of the exit pupil; the physical picture is upside down.
    """

    def trace(height):
        behind = (height - point) / distance - height / f  # a thin lens
        on_array = height + behind * z
        return on_array, (behind - on_array / pupil_to_array) * gap

    # Both are linear in the height at the lens.
    (low, low_offset), (high, high_offset) = trace(-1e-3), trace(1e-3)
    return low + (high - low) * (offset - low_offset) / (high_offset - low_offset)


def traced_views(found, point, distance, *, z=0.0, f=0.0, gap=0.0, pupil=0.0, pitch=0.0):
    """Disparity in the lenses of the design, from two rays through a camera that is off."""
    apart = found.estimator_baseline * F_L / found.mla_distance
    camera_is = {"f": F_M + f, "z": found.mla_distance + z, "gap": F_L + gap}
    camera_is["pupil_to_array"] = camera_is["z"] + pupil
    one, other = (view_on_array(point, distance, s * apart / 2, **camera_is) for s in (1, -1))
    return (other - one) * PITCH / (PITCH + pitch)


@pytest.mark.parametrize(
    "off",
    [
        {},
        {"z": 5e-6},
        {"f": 4e-6, "gap": -2e-6},
        {"pupil": 3e-3},
        {"pupil": -4e-3, "pitch": 1e-7},
        {"z": -5e-6, "f": 3e-6, "gap": 2e-6, "pupil": 2e-3, "pitch": -5e-8},
    ],
)
@pytest.mark.parametrize("slope", [0.0, 0.3])
def test_disparity_and_depth_agree_with_two_traced_rays(off, slope):
    """A camera that is off takes the picture; it is seen as traced, and one that knows it reads the truth from it."""
    found = camera()
    names = {
        "z": "mla_distance",
        "f": "focal_length",
        "gap": "microlens_gap",
        "pupil": "pupil_distance",
        "pitch": "microlens_pitch",
    }
    errors = {names[key]: value for key, value in off.items()}
    traced = traced_views(found, slope * DISTANCES, DISTANCES, **off)
    seen = found.observe_target(errors, slope * DISTANCES, 0.0, DISTANCES)
    np.testing.assert_allclose(seen[0], traced, rtol=1e-9, atol=1e-15)
    # Upright, where the ray through the middle of the main lens ends.
    np.testing.assert_allclose(seen[1], slope * (found.mla_distance + off.get("z", 0.0)), rtol=1e-12)
    inverse, valid = found.believe(errors, (traced, seen[1], seen[2]), DISTANCES)
    np.testing.assert_allclose(1.0 / inverse, DISTANCES, rtol=1e-9)
    assert valid.all()


def test_a_displaced_pupil_acts_as_intersected_rays_say():
    """A fixed picture of the design, its two rays drawn back with another exit pupil."""
    found, pupil = camera(), 2e-3
    z, half = found.mla_distance, found.estimator_baseline * F_L / found.mla_distance / 2
    for distance in DISTANCES:
        slopes, places = [], []
        for sign in (1, -1):
            place = view_on_array(0.0, distance, sign * half, f=F_M, z=z, gap=F_L, pupil_to_array=z)
            places.append(place)
            slopes.append(sign * half / F_L + place / (z + pupil))
        image = z - (places[0] - places[1]) / (slopes[0] - slopes[1])
        assert depth_read(found, distance, pupil_distance=pupil)[0] == pytest.approx(
            1.0 / (1.0 / F_M - 1.0 / image), rel=1e-9
        )


def test_a_tilted_array_acts_locally_like_a_displaced_one():
    found, tilt, field = camera(), 1e-3, 0.8
    at = field * 2048 * PIXEL / 2
    there = depth_read(found, DISTANCES, field, array_tilt_x=tilt)
    moved = depth_read(found, DISTANCES, mla_distance=tilt * at, microlens_gap=-tilt * at)
    np.testing.assert_allclose(there, moved, rtol=1e-12)
    # Without its grid, a lens centre or a shift by noise are the same; a turned array sees the cosine of the shift.
    scattered = depth_read(found, DISTANCES, microlens_center_scatter=1e-6)
    np.testing.assert_allclose(scattered, depth_read(found, DISTANCES, pixel_noise=math.sqrt(2) * 1e-6), rtol=1e-12)
    turned = found.depth_of_disparity(found.disparity(DISTANCES) * math.cos(0.02), 1.0)
    np.testing.assert_allclose(depth_read(found, DISTANCES, array_rotation=0.02), turned, rtol=1e-11)


def test_residual_components_of_a_target_count_in_microlenses():
    found = camera()
    ratio = PITCH / PIXEL
    np.testing.assert_allclose(found.target_noise_px(0.05), [0.1 * ratio, 0.05 * ratio, 0.05 * ratio])
    seen = found.seen_on_sensor(np.array([[3.0, 1000.0, 0.0], [3.0, 1030.0, 0.0]]))
    assert seen.tolist() == [[True] * 3, [False] * 3]


def test_it_measures_as_well_as_a_stereo_rig_with_its_equivalent_baseline():
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
    assert found.estimator_blur_px(near) == pytest.approx(0.5, rel=1e-9)
    in_focus = found.focus.lateral_resolution(A0, 550e-9)
    assert in_focus.sampling == pytest.approx(PITCH * A0 / found.mla_distance, rel=1e-12)
    # A pixel p sees p z/f_L of the pupil, whose Airy radius on the object is 1.22 λ a/(p z/f_L).
    view = found.sensor.pixel_pitch * found.mla_distance / found.microlenses.focal_lengths[0]
    assert in_focus.diffraction == pytest.approx(1.219669891 * 550e-9 * A0 / view, rel=1e-9)


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
            "gap 500 um",
        ),
    ],
)
def test_impossible_cameras_are_refused_with_a_message(changes, what):
    with pytest.raises(OutOfRangeError, match=what):
        camera(**changes)


def test_unknown_errors_are_refused():
    with pytest.raises(OutOfRangeError, match="no such error"):
        depth_read(camera(), 0.15, yaw=1e-3)

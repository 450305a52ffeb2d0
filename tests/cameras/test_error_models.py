"""Exact models against rotation matrices, 40-digit arithmetic, closed forms and published sensitivities."""

import math
from dataclasses import replace

import mpmath
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.cameras.builders import PITCH, depth_read, r5, stereo, unfocused
from tradestudy.cameras.depth_measurement import Environment
from tradestudy.cameras.plenoptic import PLENOPTIC_ERRORS
from tradestudy.cameras.stereo.pair import STEREO_ERRORS, pair_inverse_depth
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.lens_model import Rational
from tradestudy.optics.thin_lens import air_refractive_index, focal_length_change_with_medium
from tradestudy.optics.triangulation import plenoptic_depth
from tradestudy.uncertainty.sources import ErrorClass

DISTANCES = np.array([0.3, 0.5, 1.0, 3.0, 10.0])
DEG = math.radians(1.0)
SCALES = {"m": 5e-6, "rad": 0.2 * DEG, "1": 1e-3}
AIR = Environment(
    housing_expansion=23e-6, baseline_expansion=23e-6, array_expansion=23e-6, scale_expansion=0.0,
        focal_length_expansion=5e-6, glass_index=1.52, wavelength=550e-9,
    temperature=293.15, pressure=101_325.0,
)  # fmt: skip


# What differs from measurement to measurement, or from lens to lens, is in the measured depth alone.
IN_READING_ALONE = ("pixel_noise", "microlens_center_scatter", "array_rotation")


def drawn(table, rng, count=7):
    return {
        name: SCALES[parameter.unit] * rng.standard_normal((count, 1))
        for name, parameter in table.items()
        if name not in IN_READING_ALONE
    }


@pytest.mark.parametrize("triangulation", ["disparity", "midpoint"])
@pytest.mark.parametrize("convergence", [0.0, 0.1])
def test_shared_errors_of_a_rig_act_on_both_sides(triangulation, convergence):
    rig = stereo(triangulation=triangulation, convergence_angle=convergence)
    rng = np.random.default_rng(0)
    turned = {name: 0.2 * DEG * rng.standard_normal((20, 1)) for name in ("yaw", "pitch", "roll")}
    focal, centre = (scale * rng.standard_normal((20, 1)) for scale in (5e-6, 3e-6))
    apart = {"left_focal_length": focal, "right_focal_length": focal}
    apart |= {"left_principal_point_x": -centre / 2, "right_principal_point_x": centre / 2}
    found = rig.read(DISTANCES, 0.3, turned | {"focal_length": focal, "principal_point": centre})
    np.testing.assert_allclose(found.inverse_depth, rig.read(DISTANCES, 0.3, turned | apart).inverse_depth, rtol=1e-12)
    assert not np.broadcast_to(found.no_overlap, (20, 5))[:, 1:].any()
    assert not found.out_of_range.any()
    # The noise moves the left point one way and the right one the other, half of it each.
    noise = 1e-6 * rng.standard_normal((20, 1))
    moved = {"left_principal_point_x": -noise / 2, "right_principal_point_x": noise / 2}
    np.testing.assert_allclose(
        rig.read(DISTANCES, 0.3, turned | {"pixel_noise": noise}).inverse_depth,
        rig.read(DISTANCES, 0.3, turned | moved).inverse_depth,
        rtol=1e-12,
    )


@pytest.mark.parametrize("camera", [stereo(), unfocused()])
def test_noise_given_for_each_distance_adds_to_disparity(camera):
    noise = 1e-6 * np.random.default_rng(6).standard_normal((9, len(DISTANCES)))
    found = camera.read(DISTANCES, 0.0, {"pixel_noise": noise}).inverse_depth
    expected = camera.depth_of_disparity(camera.disparity(DISTANCES) + noise, DISTANCES)
    np.testing.assert_allclose(np.maximum(found, 0.0), 1.0 / expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("estimator", ["same-type-pair", "widest-pair"])
def test_on_the_axis_the_plenoptic_model_is_equation_8(estimator):
    camera = r5(estimator=estimator)
    rng = np.random.default_rng(1)
    scales = {"mla_distance": 5e-6, "focal_length": 5e-6, "microlens_gap": 1e-6, "pixel_noise": 0.55e-6}
    errors = {name: scale * rng.standard_normal((50, 1)) for name, scale in scales.items()}
    found = camera.read(DISTANCES, 0.0, errors).inverse_depth
    depth = plenoptic_depth(
        camera.disparity(DISTANCES) + errors["pixel_noise"],
        camera.estimator_baseline(DISTANCES),
        mla_distance=camera.mla_distance + errors["mla_distance"],
        microlens_gap=camera.microlenses.gap + errors["microlens_gap"],
        focal_length=camera.main_lens.focal_length + errors["focal_length"],
    )
    finite = np.isfinite(depth)
    assert 0.5 < finite.mean() < 1.0
    np.testing.assert_allclose(found[finite], 1.0 / depth[finite], rtol=1e-9)
    assert (found[~finite] <= 0.0).all()


def test_a_disparity_that_crosses_zero_continues_in_its_direction():
    near, far = r5(), r5(mla_distance=11.9e-3)  # Keplerian and Galilean
    for camera, expected in ((near, -1.0), (far, 1.0)):
        crossing = {"pixel_noise": np.array([[-np.sign(expected) * -3e-3]])}
        found = camera.read(np.array([1.0]), 0.0, crossing).inverse_depth
        assert found[0, 0] * camera.main_lens.focal_length == pytest.approx(expected)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("triangulation", ["disparity", "midpoint"])
def test_a_rig_with_known_errors_measures_the_truth(triangulation, seed):
    """All errors at once, in rig and calibration alike, over the field: observation and measured depth are inverses."""
    rig = stereo(triangulation=triangulation, convergence_angle=0.05)
    errors = drawn(STEREO_ERRORS, np.random.default_rng(seed))
    z = np.array([0.7, 2.0])
    image = rig.observe(errors, 0.12 * z, -0.1 * z, z)
    inverse, valid = pair_inverse_depth(rig.pair, errors, image)
    np.testing.assert_allclose(inverse, np.broadcast_to(1.0 / z, inverse.shape), rtol=1e-11)
    assert valid.all()


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("camera", [r5(field_curvature=15e-6), unfocused(field_curvature=15e-6)])
def test_a_plenoptic_camera_with_known_errors_measures_the_truth(camera, seed):
    errors = drawn(PLENOPTIC_ERRORS, np.random.default_rng(seed))
    errors["microlens_pitch"] *= 0.01
    z = np.array([0.2, 0.5, 2.0])
    seen = camera.observe(errors, 0.2 * z, -0.15 * z, z)
    inverse, valid = camera.believe(errors, seen, z)
    np.testing.assert_allclose(inverse, np.broadcast_to(1.0 / z, inverse.shape), rtol=1e-9)
    assert valid.all()


def test_the_stereo_picture_is_that_of_rotation_matrices():
    """Another program's rotations: right camera turned by intrinsic yaw, pitch, roll, distortion by hand."""
    rig = stereo()
    yaw, pitch, roll, k1 = 0.01, -0.02, 0.03, 0.05
    errors = {"yaw": yaw, "pitch": pitch, "roll": roll, "right_distortion_k1": k1, "right_focal_length": 1e-4}
    point = np.array([0.1, -0.07, 1.3])
    # Positive yaw turns z towards −x: about −y in a right-handed frame.
    turn = Rotation.from_euler("YXZ", [-yaw, pitch, roll]).as_matrix()
    a, b, c = turn.T @ (point - np.array([0.05, 0.0, 0.0]))
    u, v = a / c, b / c
    expected = (rig.lens.focal_length + 1e-4) * np.array([u, v]) * (1 + k1 * (u * u + v * v))
    found = rig.observe(errors, *point)
    np.testing.assert_allclose([found[2], found[3]], expected, rtol=1e-12)
    np.testing.assert_allclose(found[:2], rig.lens.focal_length * (point[:2] + np.array([0.05, 0.0])) / point[2])


def sensitivity(measurement, distance, field, name, step):
    plus, minus = (measurement(distance, field, {name: np.array([[s * step]])}).inverse_depth for s in (1.0, -1.0))
    return -(distance**2) * (plus - minus)[0] / (2.0 * step)


def test_stereo_sensitivities_off_the_axis_are_those_of_the_textbook():
    """dZ = (Z²/B)(1 + x²/f²) ψ for yaw, y φ/f for roll, x y for pitch, with x, y the slopes in the right picture."""
    rig = stereo()
    field = 0.7

    def measurement(distance, where, errors):
        return rig.read(distance, where, errors)

    z = np.array([2.0, 5.0])
    x = field * 5.12e-3 / 30.5e-3 - 0.05 / z
    y = field * 5.12e-3 / 30.5e-3
    lever = z**2 / 0.1
    for name, expected in (("yaw", lever * (1 + x**2)), ("roll", lever * y), ("pitch", -lever * x * y)):
        found = sensitivity(measurement, z, field, name, 1e-5)
        np.testing.assert_allclose(np.abs(found), np.abs(expected), rtol=1e-6)


def test_plenoptic_sensitivities_are_the_published_ones():
    """6.24 and 6.40 mm per µm of z and f_M at 1 m, of opposite sign; 20 µm of field curvature: 10.6 mm at 0.3 m."""

    def measurement(distance, where, errors):
        return r5().read(distance, where, errors)

    one = np.array([1.0])
    z = sensitivity(measurement, one, 0.0, "mla_distance", 1e-8)[0]
    f = sensitivity(measurement, one, 0.0, "focal_length", 1e-8)[0]
    assert abs(z) == pytest.approx(6.24e3, rel=1e-3)
    assert abs(f) == pytest.approx(6.40e3, rel=1e-3)
    assert z * f < 0
    near = np.array([0.3, 1.0])
    curved = 20e-6 * np.abs(sensitivity(measurement, near, 1.0, "field_curvature", 1e-8))
    np.testing.assert_allclose(curved, [10.6e-3, 125e-3], rtol=5e-3)
    assert np.all(sensitivity(measurement, near, 0.0, "field_curvature", 1e-8) == 0.0)
    tilted = sensitivity(measurement, near, 1.0, "array_tilt_x", 1e-6)
    # A tilt moves the array by tilt · x and takes the same from the gap, on which a_L = v b_L hangs.
    v = r5().virtual_depth(near)
    np.testing.assert_allclose(np.abs(tilted), (1 + v) * 5.632e-3 * ((near - 12.5e-3) / 12.5e-3) ** 2, rtol=1e-5)


def test_residual_curvature_and_scatter_of_the_centres_move_depth_as_published():
    """At 1 m: 6.2 mm for 1 µm of residual curvature in the corner, 63 mm for 0.2 µm of scatter of each centre."""
    one = np.array([1.0])
    curved = sensitivity(r5().read, one, 1.0, "field_curvature", 1e-8)[0] * 1e-6
    assert abs(curved) == pytest.approx(6.2e-3, rel=0.01)
    scattered = sensitivity(r5().read, one, 0.0, "microlens_center_scatter", 1e-9)[0] * 0.2e-6
    assert abs(scattered) == pytest.approx(63e-3, rel=0.01)
    # Half of what 0.1 px of noise does.
    noise = sensitivity(r5().read, one, 0.0, "pixel_noise", 1e-9)[0] * 0.55e-6
    assert abs(scattered / noise) == pytest.approx(0.51, abs=0.005)
    assert PLENOPTIC_ERRORS["microlens_center_scatter"].error_class is ErrorClass.ELEMENT


@pytest.mark.parametrize("build", [r5, unfocused])
def test_known_curvature_is_corrected_and_ignoring_it_gives_the_published_error(build):
    """20 µm in the corner: 10.6 mm at 0.3 m and 125 mm at 1 m, and nothing where it is known."""
    curved, flat = build(field_curvature=20e-6), build()
    near = np.array([0.3, 1.0])
    np.testing.assert_allclose(depth_read(curved, near, field=1.0), near, rtol=1e-9)
    # The image lies 20 µm farther back: 1/a − 1/f + 1/b = 0 read with that b.
    image = 1.0 / (1.0 / 12.5e-3 - 1.0 / near)
    expected = 1.0 / (1.0 / 12.5e-3 - 1.0 / (image + 20e-6))
    slope = 5.632e-3 / curved.mla_distance
    inverse, _ = flat.believe({}, curved.observe({}, slope * near, slope * near, near), near)
    np.testing.assert_allclose(1.0 / inverse, expected, rtol=1e-9)
    np.testing.assert_allclose(near - expected, [10.6e-3, 125e-3], rtol=0.15)
    # Residual and known value add.
    both = depth_read(build(field_curvature=13e-6), near, field=1.0, field_curvature=7e-6)
    moved = depth_read(flat, near, field=1.0, field_curvature=7e-6)
    np.testing.assert_allclose(both, moved, rtol=1e-9)


@pytest.mark.parametrize("build", [r5, unfocused])
def test_curvature_is_centred_on_the_principal_point(build):
    """κ (r² − (r − p)²)/R² more curvature where the axis is off by p, on the diagonal of the field."""
    camera, off, one = build(field_curvature=20e-6), 1e-5, np.array([1.0])
    found = sensitivity(camera.read, one, 1.0, "principal_point_x", off)[0] * off
    extra = 20e-6 * 2.0 * 5.632e-3 * off / (2.0 * 5.632e-3**2)
    assert abs(found) == pytest.approx(extra * ((1.0 - 12.5e-3) / 12.5e-3) ** 2, rel=1e-3)
    assert abs(sensitivity(camera.read, one, 0.0, "principal_point_x", off)[0]) < 1e-9


@pytest.mark.parametrize("build", [r5, unfocused])
def test_colour_moves_depth_seen_through_one_lens(build):
    """6.3 µm of secondary spectrum: 39 mm at 1 m, whatever stands behind the lens. Stereo is immune."""
    f, shift = 12.5e-3, 6.3e-6
    read = depth_read(build(), DISTANCES, color_shift=shift)
    # 1/b = 1/f' − 1/a is read with f.
    np.testing.assert_allclose(read, 1.0 / (1.0 / f - 1.0 / (f + shift) + 1.0 / DISTANCES), rtol=1e-9)
    assert 1.0 - depth_read(build(), 1.0, color_shift=shift)[0] == pytest.approx(39e-3, abs=0.5e-3)
    # It adds to what temperature does to the lens.
    warm = {"temperature_change": np.array([[2.0]]), "pressure_change": np.array([[1e3]])}
    grown = f * (float(AIR.focal_length_factor(warm)[0, 0]) - 1.0)
    still = replace(AIR, housing_expansion=0.0, array_expansion=0.0)
    both = build().read(DISTANCES, 0.0, warm | {"color_shift": np.array([[shift]])}, still).inverse_depth[0]
    np.testing.assert_allclose(both, 1.0 / f - 1.0 / (f + grown + shift) + 1.0 / DISTANCES, rtol=1e-9)
    rig = stereo()
    assert np.array_equal(depth_read(rig, DISTANCES, color_shift=shift), depth_read(rig, DISTANCES))


def test_plenoptic_reading_in_forty_digits():
    """Every error of the measured depth at once, written out again with mpmath for one point at the edge."""
    known = 30e-6
    camera = r5(field_curvature=known)
    rng = np.random.default_rng(4)
    errors = {name: float(SCALES[each.unit] * rng.standard_normal()) for name, each in PLENOPTIC_ERRORS.items()}
    errors |= {"microlens_pitch": 3e-9, "pixel_noise": 2e-7, "microlens_center_scatter": -1.5e-7}
    a, field = 0.6, 0.5
    found = camera.read(np.array([a]), field, {k: np.array([[v]]) for k, v in errors.items()})
    with mpmath.workdps(40):
        m = mpmath.mpf
        z, gap, f, p = m(camera.mla_distance), m(camera.microlenses.gap), m(camera.main_lens.focal_length), m(PITCH)
        e = {name: m(value) for name, value in errors.items()}
        spacing = m(float(camera.estimator_baseline(np.array(a))))
        corner = m(camera.sensor.diagonal) / 2
        x0 = y0 = m(field) * m(camera.sensor.width) / 2
        apart = spacing * (1 + gap / (z - f * m(a) / (m(a) - f) - m(known) * 2 * (x0 / corner) ** 2))
        x, y = x0 - e["array_offset_x"], y0 - e["array_offset_y"]
        square = ((x - e["principal_point_x"]) ** 2 + (y - e["principal_point_y"]) ** 2) / corner**2
        tilt = e["array_tilt_x"] * x + e["array_tilt_y"] * y
        grid = spacing * (1 + e["microlens_pitch"] / p) * (1 + gap / z) / (1 + gap / (z + e["pupil_distance"]))
        sigma = apart * mpmath.cos(e["array_rotation"]) + e["pixel_noise"] - grid
        sigma += mpmath.sqrt(2) * e["microlens_center_scatter"]
        behind = (gap + e["microlens_gap"] - tilt) * grid / sigma
        image = z + e["mla_distance"] + tilt - behind * (1 + e["depth_distortion"] * square)
        image -= (m(known) + e["field_curvature"]) * square
        at = square / (z + e["mla_distance"] + tilt) ** 2  # ρ² over the square of the image distance
        d0, d1, d2 = (e[f"depth_distortion_d{k}"] for k in range(3))
        undistorted = mpmath.findroot(
            lambda b: b + (1 + d0 * b / z) * (d1 * at * b**2 + d2 * at**2 * b**4) - image, image
        )
        expected = 1 / (f + e["focal_length"]) - 1 / undistorted
    assert found.inverse_depth[0, 0] == pytest.approx(float(expected), rel=1e-9)


def test_temperature_and_pressure_move_a_camera_as_published():
    """Air to vacuum shortens a 12.5 mm lens of one glass by about 10 µm: 60 mm at 1 m, read too near or too far."""
    vacuum = {"pressure_change": np.array([[-101_325.0]])}
    # Δf = −f Δn n_g/(n_g − 1) with the tabulated Δn = 2.73e-4 at 20 °C.
    expected = -12.5e-3 * 2.73e-4 * 1.52 / 0.52
    assert 12.5e-3 * (AIR.focal_length_factor(vacuum)[0, 0] - 1) == pytest.approx(expected, rel=1e-3)
    one = np.array([1.0])
    read = 1.0 / r5().read(one, 0.0, vacuum, AIR).inverse_depth[0, 0]
    shortened = 12.5e-3 + expected
    image = shortened / (1.0 - shortened)  # of a point at 1 m: b = f'a/(a − f'), read with the f of the calibration
    assert read == pytest.approx(12.5e-3 + 12.5e-3**2 / (image - 12.5e-3), rel=1e-4)
    assert 0.05 < read - 1.0 < 0.07
    # Aluminium over z moves depth by 1.8 mm/K at 1 m where the lens does not drift; gap and pitch move with it.
    only_z = 12.5e-3 * 23e-6 * 6.24e3
    assert only_z == pytest.approx(1.8e-3, rel=0.01)
    warm = {"temperature_change": np.array([[1.0]])}
    rig = stereo()
    grown = 1.0 / rig.read(one, 0.0, warm, AIR).inverse_depth[0, 0]
    # Baseline and principal distance both grow by αΔT, so disparity by twice that, and depth is read nearer.
    assert grown - 1.0 == pytest.approx(-2 * 23e-6, rel=1e-3)
    assert rig.read(one, 0.0, vacuum, AIR).inverse_depth[0] == pytest.approx(1.0, rel=1e-14)
    assert r5().read(one, 0.0, warm).inverse_depth[0] == pytest.approx(1.0, rel=1e-12)


def test_air_has_its_tabulated_index():
    """Tables: n − 1 = 2.765e-4 for a helium-neon laser in dry air at 15 °C, 2.731e-4 at 550 nm and 20 °C."""
    assert air_refractive_index(632.8e-9, 288.15, 101_325.0) - 1.0 == pytest.approx(2.7653e-4, rel=1e-3)
    assert air_refractive_index(550e-9, 293.15, 101_325.0) - 1.0 == pytest.approx(2.731e-4, rel=1e-3)
    assert air_refractive_index(550e-9, 293.15, 0.0) == 1.0
    # Lensmaker: 1/f = (n_g/n − 1) K.
    assert focal_length_change_with_medium(1.5, 1.0, 1.33) == pytest.approx(0.5 / (1.5 / 1.33 - 1.0), rel=1e-14)


def test_distortion_inverts_where_it_can_and_says_where_not():
    rng = np.random.default_rng(5)
    x, y = rng.uniform(-0.6, 0.6, (2, 500))
    lens = Rational(k1=np.full(1, -0.2), k2=np.full(1, 0.05))
    back_x, back_y, _ = lens.ray(*lens.image(x, y, 1.0))
    np.testing.assert_allclose([back_x, back_y], [x, y], atol=1e-14)
    # r (1 − r²/3) has its largest value, 2/3, at r = 1: nothing beyond has an origin.
    assert Rational(k1=np.full(1, -1.0 / 3.0)).has_ray(np.array([0.6, 0.7]), np.zeros(2)).tolist() == [True, False]


def test_unseen_points_and_impossible_cameras_are_reported():
    rig = stereo()
    nearest = rig.read(np.array([0.2, 0.5]), 0.0, {"yaw": np.zeros((2, 1))})
    # x = f B/2Z = 7.6 mm at 0.2 m, beyond the sensor's 5.12 mm.
    assert np.broadcast_to(nearest.no_overlap, (2, 2)).tolist() == [[True, False]] * 2
    bent = rig.read(DISTANCES, 0.9, {"left_distortion_k1": np.array([[0.0], [-40.0]])})
    assert bent.out_of_range.any(axis=1).tolist() == [False, True]
    measurement = r5().read(np.array([0.01, 1.0]), 0.0, {"microlens_gap": np.array([[0.0], [-1e-3]])})
    assert measurement.out_of_range.tolist() == [[True, False], [True, True]]
    diverging = rig.read(np.array([10.0]), 0.0, {"yaw": np.array([[1.0 * DEG], [-1.0 * DEG]])})
    assert sorted(np.sign(diverging.inverse_depth[:, 0])) == [-1.0, 1.0]
    with pytest.raises(OutOfRangeError, match="no such error"):
        rig.read(DISTANCES, 0.0, {"jaw": 0.1})
    with pytest.raises(OutOfRangeError, match=r"1\.5 .*0 \(axis\) to 1 \(corner"):
        r5().read(DISTANCES, 1.5, {})
    with pytest.raises(OutOfRangeError, match="environment"):
        Environment(
            housing_expansion=0.0, baseline_expansion=0.0, array_expansion=0.0, scale_expansion=0.0,
        focal_length_expansion=0.0, glass_index=1.0, wavelength=5e-7, temperature=293.0,
            pressure=0.0,
        )  # fmt: skip

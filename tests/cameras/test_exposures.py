"""Rays backwards through drawn rigs, held against where the same rigs image points forwards."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.cameras.builders import r5, stereo, unfocused
from tradestudy.calibration.posterior_file import measurement_of_rig
from tradestudy.cameras.calibrated_pair import CalibratedPair
from tradestudy.cameras.calibration import Calibration
from tradestudy.cameras.conventional.design import ConventionalCamera, FocusStackPlan
from tradestudy.cameras.depth_measurement import Environment
from tradestudy.cameras.light_cones import Exposure, pose_of
from tradestudy.cameras.parts import Lens, Sensor
from tradestudy.cameras.single_lens import SingleLensExposure
from tradestudy.cameras.stereo.design import StereoRig
from tradestudy.cameras.stereo.pair import pair_observation
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.lens_families import KannalaBrandt
from tradestudy.optics.lens_model import LensModel, Rational

ERRORS = {
    "baseline": 3e-4,
    "baseline_direction_y": 0.01,
    "baseline_direction_z": -0.02,
    "yaw": 0.02,
    "pitch": -0.01,
    "roll": 0.015,
    "focal_length": 2e-4,
    "principal_point": 3e-5,
    "left_principal_point_y": 2e-5,
    "right_focal_length": -1e-4,
    "right_distortion_k1": 0.3,
    "left_distortion_k2": 0.5,
}


def points(count: int = 50) -> FloatArray:
    rng = np.random.default_rng(2)
    z = rng.uniform(0.8, 2.0, count)
    return np.stack([*(rng.uniform(-0.08, 0.08, (2, count)) * z), z])


def miss(exposure: Exposure, x: FloatArray, y: FloatArray, point: FloatArray) -> float:
    """How far the rays through the middle of the pupil pass by points of the scene [m]."""
    cones = exposure.cones(x, y)
    rotation, centre = np.array(exposure.pose.rotation), np.array(exposure.pose.centre)[:, None]
    ray = rotation @ np.concatenate([cones.slope, np.ones((1, x.size))])
    start = rotation @ np.concatenate([cones.start, np.zeros((1, x.size))]) + centre
    apart = point - start
    along = np.sum(apart * ray, axis=0) / np.sum(ray * ray, axis=0)
    return float(np.max(np.linalg.norm(apart - along * ray, axis=0)))


@pytest.mark.parametrize("converging", [0.0, 0.1])
@pytest.mark.parametrize("errors", [{}, ERRORS])
@pytest.mark.parametrize("lens", [Rational(), KannalaBrandt(k1=-0.05), Rational(k1=-0.2, k4=0.1, p1=0.003, tau_y=0.05)])
def test_both_pictures_of_a_rig_show_points_where_it_images_them(
    converging: float, errors: dict[str, float], lens: LensModel
) -> None:
    rig = stereo(convergence_angle=converging, principal_distance_rule="focused", distortion=lens)
    world = points()
    image = pair_observation(rig.pair, errors, *world)
    left, right = rig.exposures(1.0, errors, None, 0.0)
    assert (left.name, right.name) == ("left", "right")
    assert miss(left, image[0], image[1], world) < 1e-9
    assert miss(right, image[2], image[3], world) < 1e-9


def test_warming_moves_the_pictures_of_a_rig_as_it_moves_its_measurements() -> None:
    rig, warm = stereo(), {"temperature_change": np.asarray(20.0)}
    environment = Environment(
        housing_expansion=23e-6,
        baseline_expansion=23e-6,
        array_expansion=23e-6,
        scale_expansion=2.6e-6,
        focal_length_expansion=0.0,
        glass_index=1.5,
        wavelength=550e-9,
        temperature=293.0,
        pressure=101325.0,
    )
    growth = 20.0 * 23e-6
    world = points()
    image = pair_observation(
        rig.pair, {"baseline": growth * rig.baseline, "focal_length": growth * rig.principal_distance}, *world
    )
    left, right = rig.exposures(1.0, warm, environment, 0.0)
    assert left.sensor.pixel_pitch == pytest.approx(10e-6 * (1.0 + 20.0 * 2.6e-6), rel=1e-12)
    assert miss(left, image[0], image[1], world) < 1e-9
    assert miss(right, image[2], image[3], world) < 1e-9


RELAY: dict[str, float] = {
    "mla_distance": 2e-5,
    "focal_length": -1.5e-5,
    "microlens_gap": 5e-6,
    "principal_point_x": 4e-5,
    "array_offset_y": -3e-5,
    "field_curvature": 3e-5,
    "depth_distortion": 0.02,
    "array_tilt_x": 2e-3,
}


@pytest.mark.parametrize("name", [None, *RELAY])
def test_micro_images_are_as_far_apart_as_the_camera_observes(name: str | None) -> None:
    camera: Any = r5(estimator="adjacent-pair", lenses="all")
    errors = {} if name is None else {name: RELAY[name]}
    world = np.array([0.03, -0.02, 0.3])
    apart, at_x, at_y = (float(one) for one in camera.observe(errors, *world))
    (exposure,) = camera.exposures(0.3, errors, None, 0.0)
    pixel = camera.sensor.pixel_pitch
    across, down = (grid.ravel() for grid in np.meshgrid(*(np.arange(-60, 60) * pixel,) * 2))
    x, y = at_x + across, at_y + down
    cones = exposure.cones(x, y)
    missed = world[:2, None] - (cones.start + world[2] * cones.slope)
    lands = np.stack([x, y])[:, cones.pixel] + missed / (cones.start_by_pixel + world[2] * cones.slope_by_pixel)
    # Pixels under one microlens agree on where the point lands; neighbours on the same row stand the disparity apart.
    found = np.unique(np.round(lands.T / 1e-9).astype(int), axis=0) * 1e-9
    kept = [found[0]]
    for one in found[1:]:
        if all(np.hypot(*(one - other)) > pixel for other in kept):
            kept.append(one)
    lenses = np.array(kept)
    assert len(lenses) >= 5
    distances = np.linalg.norm(lenses[:, None] - lenses[None], axis=-1) + 1e3 * np.eye(len(lenses))
    nearest = np.sort(distances, axis=1)[:, 0]
    tolerance = 2e-3 if name in ("array_tilt_x", "field_curvature", "depth_distortion") else 2e-5
    assert np.median(nearest) == pytest.approx(apart, rel=tolerance)


def test_a_turned_wider_lattice_moves_micro_images_with_it() -> None:
    camera: Any = unfocused()
    plain, turned = (
        camera.exposures(0.15, errors, None, 0.0)[0]
        for errors in ({}, {"array_rotation": 0.1, "microlens_pitch": 1e-6})
    )
    first, second = np.array([3]), np.array([-2])
    a, b = plain.centres(first, second)[:, 0], turned.centres(first, second)[:, 0]
    assert np.hypot(*b) == pytest.approx(np.hypot(*a) * 127.5 / 126.5)
    assert np.arctan2(b[1], b[0]) - np.arctan2(a[1], a[0]) == pytest.approx(0.1)


def test_every_microlens_has_a_centre_error_of_its_own() -> None:
    camera: Any = unfocused()
    scatter = 2e-7 * np.random.default_rng(1).standard_normal((camera.elements, 2))
    (plain,) = camera.exposures(0.15, {}, None, 0.0)
    (moved,) = camera.exposures(0.15, {"microlens_center_scatter": scatter}, None, 0.0)
    first, second = (grid.ravel() for grid in np.meshgrid(np.arange(-20, 20), np.arange(-20, 20)))
    change = moved.centres(first, second) - plain.centres(first, second)
    assert np.std(change) == pytest.approx(2e-7, rel=0.05)
    assert len(np.unique(change[0])) == first.size


def test_a_stack_focuses_its_pictures_over_its_range() -> None:
    camera = ConventionalCamera(
        lens=Lens(focal_length=0.0183, f_number=9.8),
        sensor=Sensor(columns=100, rows=80, pixel_pitch=7.4e-6),
        focus_distance=0.15,
        stack=FocusStackPlan(near=0.14, far=0.16, most_images=3),
    )
    exposures = camera.exposures(0.15, {}, None, 0.0)
    focus = [one.focus_distance for one in exposures]
    assert [one.name for one in exposures] == ["image-1", "image-2", "image-3"]
    assert 0.14 < focus[0] < focus[1] < focus[2] < 0.16
    # Rays through all of the pupil meet in the plane of focus.
    for one in exposures:
        cones = one.cones(np.array([1e-4]), np.array([0.0]))
        assert float(cones.start_by_lens) + one.focus_distance * float(cones.slope_by_lens) == pytest.approx(0.0)


def test_a_second_stop_behind_microlenses_is_refused() -> None:
    with pytest.raises(OutOfRangeError, match="second stop"):
        r5().exposures(0.15, {}, None, 5e-3)


def turned_pair(lenses: tuple[LensModel, LensModel]) -> tuple[StereoRig, FloatArray, FloatArray]:
    """A rig calibrated with its own values for each camera, and its pose from left to right."""
    turn, move = np.array([0.03, -0.06, 0.02]), np.array([-0.1, 0.004, -0.012])
    interiors = ([500.0, 510.0, 330.0, 230.0], [480.0, 470.0, 300.0, 250.0])
    pair = CalibratedPair(parameters=(*interiors[0], *interiors[1], *turn, *move), lenses=lenses, free=())
    sensor = Sensor(columns=640, rows=480, pixel_pitch=6e-6)
    rig = stereo(sensor=sensor, calibrated_pair=pair)
    assert isinstance(rig, StereoRig)
    return rig, turn, move


@pytest.mark.parametrize("model", ["rational", "fisheye"])
def test_both_pictures_of_a_calibrated_pair_show_points_where_opencv_does(model: str) -> None:
    cv2 = pytest.importorskip("cv2")
    coefficients: tuple[dict[str, float], dict[str, float]]
    if model == "rational":
        coefficients = {"k1": -0.2, "k2": 0.05, "p1": 0.003}, {"k1": 0.1, "k2": -0.02, "p2": -0.002}
        lenses: Any = tuple(Rational(**own) for own in coefficients)
    else:
        coefficients = {"k1": -0.05, "k2": 0.01}, {"k1": 0.03, "k2": 0.0}
        lenses = tuple(KannalaBrandt(**own) for own in coefficients)
    rig, turn, move = turned_pair(lenses)
    world = points()
    left, right = rig.exposures(1.0, {}, None, 0.0)
    from_left = np.array(left.pose.rotation).T @ (world - np.array(left.pose.centre)[:, None])
    interiors = np.array(rig.calibrated_pair.parameters[:8]).reshape(2, 4)
    poses = ((left, np.zeros(3), np.zeros(3)), (right, turn, move))
    for (one, rotation, translation), (fx, fy, cx, cy), own in zip(poses, interiors, coefficients, strict=True):
        names = ("k1", "k2", "p1", "p2") if model == "rational" else ("k1", "k2", "k3", "k4")
        given = np.array([own.get(name, 0.0) for name in names])
        project = cv2.projectPoints if model == "rational" else cv2.fisheye.projectPoints
        matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        seen = from_left.T.reshape(-1, 1, 3)
        image = project(seen, rotation, translation, matrix, given)[0]
        x, y = (image.reshape(-1, 2).T - np.array([[319.5], [239.5]])) * 6e-6
        assert miss(one, x, y, world) < 1e-9
    centres = np.array([one.pose.centre for one in (left, right)])
    np.testing.assert_allclose(centres, np.linalg.norm(move) / 2.0 * np.array([[-1.0, 0, 0], [1.0, 0, 0]]), atol=1e-15)


def test_the_area_that_a_pixel_sees_follows_its_lens_model() -> None:
    """By differences between the rays through the corners of pixels far off the axis."""
    exposure = SingleLensExposure(
        name="wide",
        sensor=Sensor(columns=640, rows=480, pixel_pitch=6e-6),
        lens=Lens(focal_length=2e-3, f_number=4.0),
        focus_distance=1.0,
        principal_distances=(2.0e-3, 2.1e-3),
        distortion=KannalaBrandt(k1=-0.02),
    )
    x, y, half = np.array([1.5e-3, 0.0, -1.0e-3]), np.array([0.9e-3, 0.0, 1.0e-3]), 3e-6
    across = (exposure.cones(x + half, y).slope - exposure.cones(x - half, y).slope) / (2.0 * half)
    down = (exposure.cones(x, y + half).slope - exposure.cones(x, y - half).slope) / (2.0 * half)
    area = np.abs(across[0] * down[1] - across[1] * down[0])
    np.testing.assert_allclose(np.square(exposure.cones(x, y).slope_by_pixel), area, rtol=1e-4)


def test_pixels_that_look_beside_the_scene_are_dark() -> None:
    """A camera turned by 40° sees only up to 50° on its outer side."""
    turned = pose_of(np.zeros(3), np.array([[0.766044, 0.0, 0.642788], [0.0, 1.0, 0.0], [-0.642788, 0.0, 0.766044]]))
    exposure = SingleLensExposure(
        name="turned",
        sensor=Sensor(columns=1000, rows=10, pixel_pitch=6e-6),
        lens=Lens(focal_length=2e-3, f_number=4.0),
        focus_distance=1.0,
        pose=turned,
        distortion=KannalaBrandt(),
    )
    c = exposure.image_distance
    cones = exposure.cones(np.radians([49.9, 50.1, -80.0]) * c, np.zeros(3))
    assert (cones.light > 0.0).tolist() == [True, False, True]


def test_a_cropped_calibrated_pair_keeps_its_rays() -> None:
    rig, _, _ = turned_pair((Rational(k1=-0.1), Rational()))
    assert rig.calibrated_pair is not None
    measurement = measurement_of_rig(rig, rig.calibrated_pair, (640, 480))
    whole = replace(rig, calibration=Calibration(measurement=measurement))
    small = replace(
        whole,
        sensor=replace(rig.sensor, columns=200, rows=121),
        calibration=Calibration(measurement=measurement.cropped(200, 121)),
    )
    x, y = np.array([2e-4, -1e-4]), np.array([1e-4, 3e-4])
    for one, other in zip(whole.exposures(1.0, {}, None, 0.0), small.exposures(1.0, {}, None, 0.0), strict=True):
        np.testing.assert_allclose(one.cones(x, y).slope, other.cones(x, y).slope, rtol=1e-12)
    distance = np.array([0.8])
    assert small.overlap(distance)[0] < whole.overlap(distance)[0]


def test_errors_of_a_design_do_not_apply_to_a_calibrated_pair() -> None:
    rig, _, _ = turned_pair((Rational(), Rational()))
    with pytest.raises(OutOfRangeError, match="calibrated pair with errors of a designed one: yaw"):
        rig.exposures(1.0, {"yaw": np.asarray(0.01)}, None, 0.0)

"""Rays backwards through drawn rigs, held against where the same rigs image points forwards."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.cameras.builders import r5, stereo, unfocused
from tradestudy.cameras.conventional.design import ConventionalCamera, FocusStackPlan
from tradestudy.cameras.environment import Environment
from tradestudy.cameras.light_cones import Exposure
from tradestudy.cameras.parts import Lens, Sensor
from tradestudy.cameras.stereo.pair import pair_observation
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.lens_models.kannala_brandt import KannalaBrandt
from tradestudy.optics.lens_models.lens_model import LensModel
from tradestudy.optics.lens_models.rational import Rational

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

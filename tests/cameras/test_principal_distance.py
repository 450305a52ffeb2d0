"""Where the sensor of a focused stereo rig stands, against rays traced through a thin lens one by one."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

from tests.cameras.builders import depth_read, stereo
from tradestudy.cameras.depth_measurement import Environment
from tradestudy.cameras.parts import Lens, Sensor
from tradestudy.cameras.stereo.design import StereoRig
from tradestudy.errors import OutOfRangeError

F, FOCUS, BASE, PUPIL = 18.3e-3, 55.3e-3, 8e-3, 18.3e-3 / 9.8
DISTANCE = np.array([45e-3, 55.3e-3, 75e-3])
SIGMA = 1e-7


def pair(**changes: Any) -> StereoRig:
    values: dict[str, Any] = {
        "lens": Lens(focal_length=F, f_number=9.8),
        "sensor": Sensor(columns=1600, rows=1200, pixel_pitch=7.4e-6),
        "focus_distance": FOCUS,
        "principal_distance_rule": "focused",
        "baseline": BASE,
    }
    return stereo(**(values | changes))


def refract(position: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """A thin lens: every ray is turned by its height over the focal length."""
    return slope - position / F


def sensor_by_rays() -> float:
    """Where a ray from the focus distance through the rim comes back to the axis."""
    height = PUPIL / 2
    return float(-height / refract(np.array(height), np.array(height / FOCUS)))


def landing(sideways: ArrayLike, z: ArrayLike, sensor: float) -> np.ndarray:
    """Mean place on a sensor, upright, of the rays of points that pass a pupil in even steps."""
    pupil = np.linspace(-PUPIL / 2, PUPIL / 2, 101)[:, None]
    behind = refract(pupil, (pupil - np.atleast_1d(sideways)) / np.atleast_1d(z))
    return -np.mean(pupil + sensor * behind, axis=0)


def traced_side(base: float, turn: float, sensor: float) -> np.ndarray:
    """What one lens, turned inwards, sees of points midway between the two."""
    along = base / 2 * math.cos(turn) - DISTANCE * math.sin(turn)
    return landing(along, DISTANCE * math.cos(turn) + base / 2 * math.sin(turn), sensor)


def traced_disparity(angle: float) -> np.ndarray:
    return 2.0 * traced_side(BASE, angle / 2, sensor_by_rays())


@pytest.mark.parametrize("angle", [0.0, 2 * math.atan(BASE / 2 / FOCUS), -0.05])
def test_disparity_is_that_of_rays_through_both_pupils(angle: float) -> None:
    """Off focus too: the middle of a blurred spot lies where the sensor cuts the ray through the lens's centre."""
    rig = pair(convergence_angle=angle)
    traced = traced_disparity(angle)
    np.testing.assert_allclose(rig.disparity(DISTANCE), traced, rtol=1e-11, atol=1e-16)
    np.testing.assert_allclose(rig.depth_of_disparity(traced, DISTANCE), DISTANCE, rtol=1e-11)
    # By the focal length instead, the same picture would be read half as far again for parallel axes.
    if angle == 0.0:
        naive = replace(rig, principal_distance_rule="focal_length").depth_of_disparity(traced, DISTANCE)
        np.testing.assert_allclose(naive / DISTANCE, 1 - F / FOCUS, rtol=1e-11)


@pytest.mark.parametrize("angle", [0.0, 2 * math.atan(BASE / 2 / FOCUS)])
def test_noise_moves_depth_as_traced_points_say(angle: float) -> None:
    """δZ per δd by moving the point: the slope that turns pixels of noise into depth."""
    rig = pair(convergence_angle=angle)
    t, sensor, step = angle / 2, sensor_by_rays(), 1e-7
    # Moving the point away along the rig's axis moves it along and across the axis of the turned lens.
    slope = np.zeros_like(DISTANCE)
    for sign in (1.0, -1.0):
        z = DISTANCE - sign * step
        along = BASE / 2 * math.cos(t) - z * math.sin(t)
        slope += sign * landing(along, z * math.cos(t) + BASE / 2 * math.sin(t), sensor) / step
    nearer = DISTANCE - rig.depth_of_disparity(rig.disparity(DISTANCE) + 1e-3 * rig.noise(DISTANCE), DISTANCE)
    np.testing.assert_allclose(DISTANCE - depth_read(rig, DISTANCE, pixel_noise=1e-3 * 0.74e-6), nearer, rtol=1e-4)
    np.testing.assert_allclose(nearer, 1e-3 * 0.1 * 7.4e-6 / slope, rtol=1e-4)
    discrimination = rig.depth_discrimination(DISTANCE)[0]
    np.testing.assert_allclose(discrimination, 0.1 * 7.4e-6 / slope, rtol=1e-2)


@pytest.mark.parametrize("angle", [0.0, 0.15])
@pytest.mark.parametrize("error", ["yaw", "baseline", "focal_length", "principal_point"])
def test_errors_act_as_traced_pictures_say(error: str, angle: float) -> None:
    """A rig that is off by the error takes the picture; the design reads it, or its calibration has the error."""
    off = {name: SIGMA if name == error else 0.0 for name in ("yaw", "baseline", "focal_length", "principal_point")}
    base, sensor = BASE + off["baseline"], sensor_by_rays() + off["focal_length"]
    picture = sum(traced_side(base, angle / 2 + turn, sensor) for turn in (0.0, off["yaw"]))
    moved = picture + off["principal_point"] - traced_disparity(angle)
    rig = pair(convergence_angle=angle)
    read = rig.disparity(depth_read(rig, DISTANCE, **{error: SIGMA})) - rig.disparity(DISTANCE)
    np.testing.assert_allclose(np.abs(moved), np.abs(read), rtol=1e-4)


def test_the_error_of_the_principal_distance_scales_parallel_depth() -> None:
    """δZ/Z = δc/c, not δf/f: what everybody knows of a calibration in pixels."""
    read = depth_read(pair(), DISTANCE, focal_length=1e-6)
    np.testing.assert_allclose(read / DISTANCE - 1.0, 1e-6 / sensor_by_rays(), rtol=1e-8)


def test_views_and_overlap_are_those_of_the_ends_of_the_sensor() -> None:
    """An object at the edge of view lands on the end of the sensor."""
    rig = pair()
    across = 2 * FOCUS * math.tan(rig.field_of_view / 2)
    assert landing(across / 2, np.array([FOCUS]), sensor_by_rays())[0] == pytest.approx(1600 * 7.4e-6 / 2)
    assert float(rig.overlap(FOCUS)) == pytest.approx(1 - BASE / across, rel=1e-12)
    assert rig.field_of_view < replace(rig, principal_distance_rule="focal_length").field_of_view
    # 15 µm per pixel on the object, the published scale of the hand-lens imager at its working distance.
    assert across / 1600 == pytest.approx(15e-6, rel=5e-3)


def test_the_exact_model_agrees_with_traced_rays() -> None:
    rig = pair()
    x, y = 2e-3, -1.5e-3
    seen = rig.observe({}, np.array([x]), np.array([y]), np.array([60e-3]))
    sensor, z = sensor_by_rays(), np.array([60e-3])
    traced = [landing(x + BASE / 2, z, sensor), landing(y, z, sensor), landing(x - BASE / 2, z, sensor)]
    np.testing.assert_allclose([c[0] for c in seen[:3]], [c[0] for c in traced], rtol=1e-11)
    read = depth_read(rig, DISTANCE, left_focal_length=1e-6, right_focal_length=1e-6)
    np.testing.assert_allclose(read, depth_read(rig, DISTANCE, focal_length=1e-6))
    # The corner of the sensor is the corner of the field: the point there is just seen by a rig without a baseline.
    narrow = replace(rig, baseline=1e-9)
    assert not narrow.read(DISTANCE, 1.0 - 1e-6, {}).no_overlap.any()
    assert narrow.field_of_view == pytest.approx(2 * math.atan(1600 * 7.4e-6 / 2 / sensor), rel=1e-12)


def test_a_warm_housing_moves_the_sensor_in_proportion() -> None:
    air = Environment(
        housing_expansion=23e-6, baseline_expansion=23e-6, array_expansion=23e-6, scale_expansion=0.0,
        focal_length_expansion=0.0, glass_index=1.52, wavelength=550e-9,
        temperature=293.15, pressure=101_325.0,
    )  # fmt: skip
    warm = pair().read(DISTANCE, 0.0, {"temperature_change": np.array([[1.0]])}, air)
    np.testing.assert_allclose(1 / warm.inverse_depth[0] / DISTANCE - 1.0, -2 * 23e-6, rtol=1e-3)


def test_the_picture_and_the_triangulation_share_one_scale() -> None:
    geometry = pair().picture_geometry(DISTANCE)
    np.testing.assert_allclose(geometry.magnification, pair().disparity(DISTANCE) / BASE, rtol=1e-12)


def test_rules_agree_at_infinity_and_the_default_is_the_focal_length() -> None:
    assert pair(focus_distance=math.inf).principal_distance == F
    assert stereo().principal_distance == stereo().lens.focal_length
    assert pair(focus_distance=1e9).principal_distance == pytest.approx(F * (1 + F / 1e9), rel=1e-15)


def test_lenses_that_refocus_have_no_single_focused_distance() -> None:
    with pytest.raises(OutOfRangeError, match=r": focused .allowed: focal_length.*; give a focus distance"):
        pair(focus_distance=None)
    assert pair(focus_distance=None, principal_distance_rule="focal_length").principal_distance == F

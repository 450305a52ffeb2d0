"""Fields of view, disparity and equivalent baseline of imported and wide rigs, against OpenCV and plane geometry."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.calibration.cameras import stereo
from tradestudy.calibration.corners.rig_measurement import RigMeasurement, rig_parameters
from tradestudy.cameras.calibrated_pair import RADIAL
from tradestudy.cameras.calibration import Calibration
from tradestudy.cameras.parts import Lens, Sensor
from tradestudy.cameras.stereo.pair import STEREO_ERRORS
from tradestudy.optics.lens_families import KannalaBrandt

PIXELS, PITCH, BASELINE, TOE_IN = (1280, 800), 3e-6, 0.1, math.radians(6.0)
LEFT, RIGHT = 800.0, 900.0  # focal lengths [px]
COMMON = math.sqrt(2.0 / (LEFT**-2 + RIGHT**-2))  # in whose pixels disparity counts
COEFFICIENTS = (-0.03, 0.012, -0.004, 0.001)


def toed_in():
    """Unequal focal lengths and principal points; the right camera is turned towards the left one."""
    intrinsics = [[focal, focal, x, 400.0, 0.0, 0.0] for focal, x in ((LEFT, 630.0), (RIGHT, 655.0))]
    # A point at X in the left frame is at R (X − C) in the right one; the right axis R₃ points to the left.
    cos, sin = math.cos(TOE_IN), math.sin(TOE_IN)
    rotation = np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])
    translation = -rotation @ [BASELINE, 0.0, 0.0]
    best = np.array([*intrinsics[0], *intrinsics[1], 0.0, TOE_IN, 0.0, *translation])
    measurement = RigMeasurement(
        best=best, pixels=PIXELS, pixel_pitch=PITCH, vocabulary=rig_parameters(RADIAL) | STEREO_ERRORS
    )
    return stereo(
        lens=Lens(focal_length=COMMON * PITCH, f_number=2.0),
        sensor=Sensor(columns=PIXELS[0], rows=PIXELS[1], pixel_pitch=PITCH),
        calibration=Calibration(measurement=measurement),
    )


def seen(z: float) -> tuple[float, float]:
    """Tangents of the angles at which both see the point at z on the bisector from the middle of the baseline."""
    x = BASELINE / 2.0 + z * math.tan(-TOE_IN / 2.0)
    return x / z, math.tan(math.atan2(x - BASELINE, z) + TOE_IN)


def depth(left: float, right: float) -> float:
    """Where two lines of sight with these tangents in their own cameras meet."""
    return BASELINE / (left - math.tan(math.atan(right) - TOE_IN))


@pytest.mark.parametrize("z", [0.3, 0.8, 3.0])
def test_disparity_and_equivalent_baseline_are_those_of_the_imported_pose(z: float) -> None:
    rig, (left, right) = toed_in(), seen(z)
    assert depth(left, right) == pytest.approx(z, rel=1e-12)
    disparity = COMMON * (left - right)
    assert float(rig.disparity_px(z)) == pytest.approx(disparity, rel=1e-9)
    by_left, by_right = (COMMON / (2.0 * focal**2) for focal in (LEFT, RIGHT))  # change of tangents per pixel
    moved = depth(left + by_left, right - by_right)
    assert float(rig.depth_of_disparity((disparity + 1.0) * PITCH, z)) == pytest.approx(moved, rel=1e-9)
    step = 1e-3
    slope = (1.0 / depth(left + step * by_left, right - step * by_right) - 1.0 / z) / step  # [1/(m px)]
    expected = 1.0 / (slope * COMMON)
    assert float(rig.equivalent_baseline(np.array([z]))[0]) == pytest.approx(expected, rel=1e-4)


def test_the_disparity_of_infinity_of_a_toed_in_pair_is_that_of_its_angle() -> None:
    half = math.tan(TOE_IN / 2.0)
    found = float(toed_in().disparity_of_infinity(1.0)) / PITCH
    assert found == pytest.approx(-2.0 * COMMON * half, rel=1e-9)


def test_the_views_of_a_pair_reach_from_its_own_principal_point() -> None:
    left, right, top, bottom = toed_in().edge_angles(1.0)
    assert (left, right) == pytest.approx((math.atan(630.5 / LEFT), math.atan(649.0 / LEFT + 0.5 / LEFT)))
    assert (top, bottom) == pytest.approx((math.atan(400.5 / LEFT), math.atan(399.5 / LEFT)))


@pytest.mark.parametrize("coefficients", [(0.0, 0.0, 0.0, 0.0), COEFFICIENTS])
def test_the_field_of_view_of_a_fisheye_is_opencv_s(coefficients: tuple[float, ...]) -> None:
    cv2 = pytest.importorskip("cv2")
    focal = 400.0
    rig = stereo(
        lens=Lens(focal_length=focal * PITCH, f_number=2.0),
        sensor=Sensor(columns=PIXELS[0], rows=PIXELS[1], pixel_pitch=PITCH),
        distortion=KannalaBrandt(**dict(zip(("k1", "k2", "k3", "k4"), coefficients, strict=True))),
    )
    matrix = np.diag([focal, focal, 1.0])
    edges = rig.edge_angles(1.0)
    for angle, (x, y) in zip(edges, ((-1, 0), (1, 0), (0, -1), (0, 1)), strict=True):
        assert angle < math.pi / 2.0 + 0.2
        ray = np.array([[[x * math.sin(angle), y * math.sin(angle), math.cos(angle)]]])
        if angle < math.pi / 2.0:  # OpenCV projects points in front of the camera
            pixel, _ = cv2.fisheye.projectPoints(ray, np.zeros(3), np.zeros(3), matrix, np.array(coefficients))
            half = np.array([PIXELS[0] / 2.0, PIXELS[1] / 2.0])
            assert pixel[0, 0] == pytest.approx(half * (x, y), abs=1e-6)
    assert rig.field_of_view == pytest.approx(edges[0] + edges[1])
    assert rig.field_of_view > 1.3 * 2.0 * math.atan(PIXELS[0] / 2.0 / focal)  # the pinhole formula

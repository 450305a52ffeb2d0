"""What both cameras of a calibrated pair see, against closed forms and against OpenCV's counts of pixels."""

import numpy as np
import pytest

from tradestudy.calibration.corners.rig_measurement import shared_area
from tradestudy.cameras.calibrated_pair import PINHOLES, RADIAL

PIXELS = (640, 480)
DISTANCES = np.array([0.2, 0.5, 1.0, 5.0])


def pair(rotation=(0.0, 0.0, 0.0), translation=(-0.06, 0.0, 0.0)):
    camera = [500.0, 500.0, 319.5, 239.5, 0.0, 0.0]
    return np.array([*camera, *camera, *rotation, *translation])


def test_parallel_pinholes_share_what_the_baseline_leaves():
    found = shared_area(pair(), PINHOLES, RADIAL, PIXELS, DISTANCES)
    np.testing.assert_allclose(found, 1.0 - 0.06 * 500.0 / (640.0 * DISTANCES), atol=1e-3)


def test_a_pair_one_above_the_other_shares_heights():
    found = shared_area(pair(translation=(0.0, -0.06, 0.0)), PINHOLES, RADIAL, PIXELS, DISTANCES)
    np.testing.assert_allclose(found, 1.0 - 0.06 * 500.0 / (480.0 * DISTANCES), atol=1e-3)


def test_pictures_without_overlap_share_nothing():
    apart = shared_area(pair(rotation=(0.0, np.pi / 2.0, 0.0)), PINHOLES, RADIAL, PIXELS, DISTANCES)
    behind = shared_area(pair(rotation=(0.0, np.pi, 0.0)), PINHOLES, RADIAL, PIXELS, DISTANCES)
    np.testing.assert_array_equal([apart, behind], 0.0)


def test_a_quarter_turn_about_the_axis_shares_the_middle_square():
    turned = pair(rotation=(0.0, 0.0, np.pi / 2.0), translation=(-1e-9, 0.0, 0.0))
    np.testing.assert_allclose(shared_area(turned, PINHOLES, RADIAL, PIXELS, DISTANCES), 0.75, atol=2e-3)


def test_the_measured_pair_shares_what_opencv_finds(calibrated_webcams):
    """Every second pixel of both pictures, undistorted by OpenCV, placed in the plane, and projected into the other."""
    cv2 = pytest.importorskip("cv2")
    rig, measurement = calibrated_webcams.fit.explained.shared, calibrated_webcams.calibration.measurement
    left, right, turn, shift = rig[:6], rig[6:12], cv2.Rodrigues(rig[12:15])[0], rig[15:]
    columns, rows = measurement.pixels
    grid = np.stack(np.meshgrid(np.arange(0.5, columns, 2.0), np.arange(0.5, rows, 2.0)), axis=-1).reshape(-1, 1, 2)

    def seen(source, target, rotation, translation, z):
        matrices = [np.array([[f, 0, c], [0, g, d], [0, 0, 1]]) for f, g, c, d in (source[:4], target[:4])]
        rays = cv2.undistortPoints(grid, matrices[0], np.array([*source[4:6], 0, 0]))[:, 0]
        points = np.concatenate([rays, np.ones((len(rays), 1))], axis=-1)
        normal, away = z  # of the plane in the frame of the source
        points = points * (away / (points @ normal))[:, None]
        image = cv2.projectPoints(
            points, cv2.Rodrigues(rotation)[0], translation, matrices[1], np.array([*target[4:6], 0, 0])
        )[0][:, 0]
        return np.mean(np.all((image > -0.5) & (image < np.array([columns, rows]) - 0.5), axis=1))

    axis = np.array([0.0, 0.0, 1.0])
    for distance in (0.3, 1.0, 5.0):
        from_left = seen(left, right, turn, shift, (axis, distance))
        normal = turn @ axis
        from_right = seen(right, left, turn.T, -turn.T @ shift, (normal, distance + normal @ shift))
        found = measurement.shared_area(np.array([distance]))[0]
        assert found == pytest.approx(min(from_left, from_right), abs=3e-3)

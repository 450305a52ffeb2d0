"""Projection against its definition at 40 digits, derivatives against complex steps, rotations against expm."""

import mpmath
import numpy as np
import pytest
from scipy.linalg import expm

from tradestudy.calibration.projection import (
    cross_matrix,
    move,
    pose_derivatives,
    project,
    project_with_jacobians,
    ray_slopes,
    right_jacobian,
    rotation_matrix,
    rotation_vector,
)

INTRINSICS = np.array([463.1, 461.7, 316.2, 189.9, 0.114, -0.212])
POINTS = np.random.default_rng(1).uniform([-0.3, -0.2, 0.4], [0.3, 0.2, 0.9], (7, 3))


def test_projection_equals_brown_model_at_40_digits():
    with mpmath.workdps(40):
        for point, image in zip(POINTS, project(INTRINSICS, POINTS), strict=True):
            fx, fy, cx, cy, k1, k2 = map(mpmath.mpf, INTRINSICS.tolist())
            X, Y, Z = map(mpmath.mpf, point.tolist())
            radius = mpmath.sqrt(X**2 + Y**2) / Z
            distorted = radius + k1 * radius**3 + k2 * radius**5
            angle = mpmath.atan2(Y, X)
            expected = (cx + fx * distorted * mpmath.cos(angle), cy + fy * distorted * mpmath.sin(angle))
            np.testing.assert_allclose(image, [float(e) for e in expected], rtol=1e-14)


def test_jacobians_equal_complex_steps():
    def complex_project(intrinsics, points):
        x, y = points[:, 0] / points[:, 2], points[:, 1] / points[:, 2]
        r2 = x**2 + y**2
        L = 1 + intrinsics[4] * r2 + intrinsics[5] * r2**2
        return np.stack([intrinsics[0] * x * L + intrinsics[2], intrinsics[1] * y * L + intrinsics[3]], axis=-1)

    image, by_intrinsics, by_points = project_with_jacobians(INTRINSICS, POINTS)
    np.testing.assert_allclose(image, project(INTRINSICS, POINTS), rtol=1e-15)
    for k in range(6):
        step = 1e-30j * (np.arange(6) == k)
        expected = complex_project(INTRINSICS + step, POINTS + 0j).imag / 1e-30
        np.testing.assert_allclose(by_intrinsics[..., k], expected, rtol=1e-12, atol=1e-12)
    for k in range(3):
        step = 1e-30j * (np.arange(3) == k)
        expected = complex_project(INTRINSICS + 0j, POINTS + step).imag / 1e-30
        np.testing.assert_allclose(by_points[..., k], expected, rtol=1e-12, atol=1e-10)


def test_points_behind_the_camera_are_not_seen():
    behind = np.array([[0.1, 0.1, -1.0], [0.1, 0.1, 0.0], [0.1, 0.1, 1.0]])
    assert np.isnan(project(INTRINSICS, behind)).all(axis=1).tolist() == [True, True, False]


def test_rays_invert_the_projection():
    slopes = ray_slopes(INTRINSICS, project(INTRINSICS, POINTS))
    np.testing.assert_allclose(slopes, POINTS[:, :2] / POINTS[:, 2:], rtol=1e-12)
    np.testing.assert_array_equal(ray_slopes(INTRINSICS, INTRINSICS[None, 2:4]), [[0.0, 0.0]])


def test_a_distortion_without_inverse_gives_no_ray():
    # r (1 − r²) has its largest value 0.385 at 0.577: nothing is imaged at 0.5 focal lengths
    barrel = np.array([100.0, 100.0, 0.0, 0.0, -1.0, 0.0])
    slopes = ray_slopes(barrel, np.array([[50.0, 0.0], [38.0, 0.0], [np.nan, 0.0]]))
    assert np.isnan(slopes[[0, 2]]).all()
    root = [r.real for r in np.roots([-1.0, 0.0, 1.0, -0.38]) if 0 < r.real < 0.577]
    np.testing.assert_allclose(slopes[1], [root[0], 0.0], rtol=1e-10)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-3, 0.9e-2, 1.1e-2, 1.0, 3.0])
def test_rotations_and_their_derivatives(angle):
    vector = angle * np.array([0.36, -0.48, 0.8])
    np.testing.assert_allclose(rotation_matrix(vector), expm(cross_matrix(vector)), atol=3e-15)
    np.testing.assert_allclose(rotation_vector(rotation_matrix(vector)), vector, atol=1e-14)
    # J_r = (1 − exp(−[ω]×))/[ω]× as a power series of the matrix: Σ (−[ω]×)^k/(k+1)!
    series, term = np.zeros((3, 3)), np.eye(3)
    for k in range(60):
        series += term
        term = term @ -cross_matrix(vector) / (k + 2.0)
    np.testing.assert_allclose(right_jacobian(vector), series, atol=1e-14)


def test_motion_derivative_equals_differences():
    pose = np.array([0.3, -0.5, 0.2, 0.1, -0.2, 0.6])
    found = pose_derivatives(np.eye(3), pose, move(pose, POINTS))
    for k in range(6):
        step = 1e-6 * (np.arange(6) == k)
        expected = (move(pose + step, POINTS) - move(pose - step, POINTS)) / 2e-6
        np.testing.assert_allclose(found[..., k], expected, atol=1e-9)


def test_projection_equals_opencv():
    cv2 = pytest.importorskip("cv2")
    camera = np.array([[INTRINSICS[0], 0, INTRINSICS[2]], [0, INTRINSICS[1], INTRINSICS[3]], [0, 0, 1.0]])
    pose = np.array([0.3, -0.5, 0.2, 0.01, -0.02, 0.6])
    flat = POINTS * [1.0, 1.0, 0.0]
    distortion = np.array([*INTRINSICS[4:], 0.0, 0.0])
    expected = cv2.projectPoints(flat, pose[:3], pose[3:], camera, distortion)[0][:, 0]
    np.testing.assert_allclose(project(INTRINSICS, move(pose, flat)), expected, rtol=1e-12)

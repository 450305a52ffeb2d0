"""Cameras with two radial distortion terms beyond a lens model, and rigid motions, with analytic derivatives.

Intrinsic parameters travel as the last axis of an array, in the order of ``INTRINSIC_NAMES``; rotations as rotation
vectors (axis times angle). Everything broadcasts over leading axes. A lens model that has k1 and k2 itself is changed
by those of the parameters; the one that corners are fitted with is a pinhole.
"""

from __future__ import annotations

import numpy as np

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.lens_models.lens_model import LensModel, slopes
from tradestudy.optics.lens_models.rational import IDEAL

INTRINSIC_NAMES = (
    "focal_length_x_px",
    "focal_length_y_px",
    "principal_point_x_px",
    "principal_point_y_px",
    "radial_distortion_k1",
    "radial_distortion_k2",
)


def project(intrinsics: FloatArray, points: FloatArray, lens: LensModel = IDEAL) -> FloatArray:
    """Image of points: u = f x (1 + k1 r² + k2 r⁴) + c, with x = X/Z, r² = x² + y², unless a lens model is given.

    Parameters
    ----------
    intrinsics : array (..., 6)
        Focal lengths and principal point [px], distortion [1], in the order of ``INTRINSIC_NAMES``.
    points : array (..., N, 3)
        Points in the camera's frame: x right, y down, z along the optical axis [m].
    lens
        Lens model that the distortion of the parameters adds to.

    Returns
    -------
    array (..., N, 2)
        Image coordinates [px]; NaN outside the valid field of the lens model, that of a pinhole ending at Z = 0.

    Raises
    ------
    OutOfRangeError
        The parameters have distortion, and the lens model has no k1 and k2.

    Notes
    -----
    D. C. Brown, "Close-range camera calibration", Photogrammetric Engineering 37 (1971) 855, radial terms only.
    """
    x, y, z = points[..., 0], points[..., 1], points[..., 2]
    with np.errstate(all="ignore"):  # what the law is not made for ends as NaN
        u, v = _lens(intrinsics, lens).image(x, y, z)
    return np.where(lens.sees(x, y, z)[..., None], _pixels(intrinsics, u, v), np.nan)


def project_with_jacobians(intrinsics: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Image of points with its derivatives by the intrinsic parameters and by the points.

    Parameters
    ----------
    intrinsics : array (..., 6)
        As for ``project`` [px, 1].
    points : array (..., N, 3)
        Points in the camera's frame [m].

    Returns
    -------
    image : array (..., N, 2)
        Image coordinates [px]; NaN at or behind the camera, as are the derivatives there.
    by_intrinsics : array (..., N, 2, 6)
        Derivatives by the intrinsic parameters.
    by_points : array (..., N, 2, 3)
        Derivatives by the points [px/m].
    """
    lens = _lens(intrinsics)
    u, v = lens.image(points[..., 0], points[..., 1], points[..., 2])
    by_points, by_coefficients = lens.derivatives(points, ("k1", "k2"))
    focal = np.stack([intrinsics[..., 0, None], intrinsics[..., 1, None]], axis=-1)[..., None]
    zero, one = np.zeros_like(u), np.where(np.isnan(u), np.nan, 1.0)
    by_camera = np.stack([np.stack([u, zero, one, zero], axis=-1), np.stack([zero, v, zero, one], axis=-1)], axis=-2)
    by_intrinsics = np.concatenate([by_camera, focal * by_coefficients], axis=-1)
    return _pixels(intrinsics, u, v), by_intrinsics, focal * by_points


def ray_slopes(intrinsics: FloatArray, image: FloatArray, lens: LensModel = IDEAL) -> FloatArray:
    """Slopes (X/Z, Y/Z) of the ray that a camera images at a place: the inverse of ``project``.

    Parameters
    ----------
    intrinsics : array (..., 6)
        As for ``project``.
    image : array (..., N, 2)
        Image coordinates [px].
    lens
        As for ``project``.

    Returns
    -------
    array (..., N, 2)
        Slopes of the rays [1]; NaN where the image coordinates are NaN, for rays at or beyond 90° from the axis, and
        where the distortion has no rising inverse (too far outside the calibrated field): an outcome of a draw, to be
        counted by its cause.
    """
    x = (image[..., 0] - intrinsics[..., 2, None]) / intrinsics[..., 0, None]
    y = (image[..., 1] - intrinsics[..., 3, None]) / intrinsics[..., 1, None]
    return np.stack(slopes(*_lens(intrinsics, lens).ray(x, y)), axis=-1)


def cross_matrix(vector: FloatArray) -> FloatArray:
    """Matrix [a]× with [a]× b = a × b, shape (..., 3, 3)."""
    a, b, c = vector[..., 0], vector[..., 1], vector[..., 2]
    zero = np.zeros_like(a)
    rows = [[zero, -c, b], [c, zero, -a], [-b, a, zero]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def rotation_matrix(rotation_vector: FloatArray) -> FloatArray:
    """Rotation matrix of a rotation vector (Rodrigues): R = I + sinc θ [ω]× + (1 − cos θ)/θ² [ω]×².

    Parameters
    ----------
    rotation_vector : array (..., 3)
        Axis times angle [rad]; any size.

    Returns
    -------
    array (..., 3, 3)
        Proper orthogonal matrices.
    """
    angle = np.linalg.norm(rotation_vector, axis=-1)[..., None, None]
    generator = cross_matrix(rotation_vector)
    half = np.sinc(angle / (2.0 * np.pi))  # (1 - cos θ)/θ² = sinc²(θ/2)/2: no cancellation at small angles
    matrix: FloatArray = np.eye(3) + np.sinc(angle / np.pi) * generator + 0.5 * half**2 * (generator @ generator)
    return matrix


def rotation_vector(matrix: FloatArray) -> FloatArray:
    """Rotation vector of a rotation matrix, shape (..., 3) [rad]; angles in [0, π]."""
    from scipy.spatial.transform import Rotation

    vectors: FloatArray = Rotation.from_matrix(matrix.reshape(-1, 3, 3)).as_rotvec()
    reshaped: FloatArray = vectors.reshape(matrix.shape[:-1])
    return reshaped


def right_jacobian(rotation_vector: FloatArray) -> FloatArray:
    """Matrix J_r with R(ω + δ) = R(ω) R(J_r δ) to first order in δ, shape (..., 3, 3).

    J_r = I − (1 − cos θ)/θ² [ω]× + (θ − sin θ)/θ³ [ω]×² (G. Chirikjian, "Stochastic Models, Information Theory,
    and Lie Groups" 2, 2012, section 10.6).
    """
    angle = np.linalg.norm(rotation_vector, axis=-1)[..., None, None]
    generator = cross_matrix(rotation_vector)
    first = 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2
    small = angle < 1e-2  # the series is exact to 1e-16 there, the closed form loses digits
    safe = np.where(small, 1.0, angle)
    second = np.where(
        small,
        1.0 / 6.0 - angle**2 / 120.0 + angle**4 / 5040.0,
        (safe - np.sin(safe)) / safe**3,
    )
    jacobian: FloatArray = np.eye(3) - first * generator + second * (generator @ generator)
    return jacobian


def move(pose: FloatArray, points: FloatArray) -> FloatArray:
    """Points carried by rigid motions, R x + t.

    Parameters
    ----------
    pose : array (..., 6)
        Rotation vector [rad] and translation [m].
    points : array (..., N, 3)
        Points [m].

    Returns
    -------
    array (..., N, 3)
        The moved points [m].
    """
    moved: FloatArray = points @ np.swapaxes(rotation_matrix(pose[..., :3]), -1, -2) + pose[..., None, 3:]
    return moved


def move_jacobian(pose: FloatArray, points: FloatArray) -> FloatArray:
    """Derivative of ``move`` by the pose, shape (..., N, 3, 6): −R [x]× J_r beside the identity."""
    rotation = rotation_matrix(pose[..., :3])[..., None, :, :]
    by_rotation = -rotation @ cross_matrix(points) @ right_jacobian(pose[..., :3])[..., None, :, :]
    identity = np.broadcast_to(np.eye(3), by_rotation.shape)
    return np.concatenate([by_rotation, identity], axis=-1)


def _lens(intrinsics: FloatArray, lens: LensModel = IDEAL) -> LensModel:
    """The lens model of intrinsic parameters, which broadcasts with points."""
    return lens.with_radial_error(intrinsics[..., 4, None], intrinsics[..., 5, None])


def _pixels(intrinsics: FloatArray, u: FloatArray, v: FloatArray) -> FloatArray:
    """From the normalised picture to pixels."""
    f_x, f_y, c_x, c_y = (intrinsics[..., i, None] for i in range(4))
    return np.stack([f_x * u + c_x, f_y * v + c_y], axis=-1)

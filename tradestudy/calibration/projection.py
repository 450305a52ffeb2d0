"""Projection by cameras with any lens model, rigid motions, and the derivatives of both.

Intrinsic parameters form the last axis of an array, in the order of ``intrinsic_names``; rotations are rotation vectors
(axis times angle). Leading axes broadcast. Coefficients among the parameters replace those of the lens model.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tradestudy.cameras.calibrated_pair import RADIAL
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.lens_families import FAMILIES
from tradestudy.optics.lens_model import IDEAL, LensModel, slopes

LARGEST_ROLL = np.radians(45.0)
"""Largest roll between the pictures of a pair; beyond it, disparity lies along the columns of one of them."""
_COEFFICIENT = "distortion_"


def intrinsic_names(free: Sequence[str]) -> tuple[str, ...]:
    """Names of the intrinsic parameters of a camera with these free coefficients."""
    return (
        "focal_length_x_px",
        "focal_length_y_px",
        "principal_point_x_px",
        "principal_point_y_px",
        *(f"{'radial_' if name.startswith('k') else ''}{_COEFFICIENT}{name}" for name in free),
    )


def coefficient_of(name: str) -> str | None:
    """The lens coefficient that a parameter represents; None for any other parameter."""
    return name.rpartition(_COEFFICIENT)[2] if _COEFFICIENT in name else None


@dataclass(frozen=True, kw_only=True)
class FreeLens:
    """A lens model with free coefficients.

    Parameters
    ----------
    model
        Lens model with starting values of the free coefficients and the values of the fixed ones.
    free
        Names of the free coefficients.
    """

    model: LensModel = IDEAL
    free: tuple[str, ...] = RADIAL

    def at(self, coefficients: FloatArray) -> LensModel:
        """The lens with these values (n,) of its free coefficients."""
        return replace(self.model, **dict(zip(self.free, map(float, coefficients), strict=True)))

    @property
    def start(self) -> FloatArray:
        """Starting values of the free coefficients, shape (n,)."""
        return np.array([getattr(self.model, name) for name in self.free], dtype=np.float64)


def text_of_lens(lens: FreeLens) -> str:
    """A lens as JSON, for files; empty for `RADIAL_LENS`."""
    if lens == RADIAL_LENS:
        return ""
    return json.dumps({"model": lens.model.name, "free": lens.free, "from": lens.model.coefficients()})


def lens_of_text(text: str) -> FreeLens:
    """The lens that `text_of_lens` wrote."""
    if not text:
        return RADIAL_LENS
    fields = json.loads(text)
    return FreeLens(model=FAMILIES[fields["model"]](**fields["from"]), free=tuple(fields["free"]))


RADIAL_LENS = FreeLens()
"""A pinhole with two radial distortion coefficients: the default for fits to corners."""


def project(
    intrinsics: FloatArray, points: FloatArray, lens: LensModel = IDEAL, free: Sequence[str] = RADIAL
) -> FloatArray:
    """Image of points: u = f x (1 + k1 r² + k2 r⁴) + c, with x = X/Z, r² = x² + y², unless a lens model is given.

    Parameters
    ----------
    intrinsics : array (..., 4 + n)
        Focal lengths and principal point [px], coefficients [1, rad], in the order of ``intrinsic_names``.
    points : array (..., N, 3)
        Points in the camera's frame: x right, y down, z along the optical axis [m].
    lens
        Lens model, whose free coefficients come from the parameters.
    free
        Names of the n free coefficients.

    Returns
    -------
    array (..., N, 2)
        Image coordinates [px]; NaN outside the valid field of the lens model (for a pinhole, Z > 0).

    Raises
    ------
    OutOfRangeError
        A coefficient lies outside its range.

    Notes
    -----
    D. C. Brown, "Close-range camera calibration", Photogrammetric Engineering 37 (1971) 855, radial terms only.
    """
    x, y, z = points[..., 0], points[..., 1], points[..., 2]
    with np.errstate(all="ignore"):  # outside its range the model gives NaN
        u, v = _lens(intrinsics, lens, free).image(x, y, z)
    return np.where(lens.sees(x, y, z)[..., None], _pixels(intrinsics, u, v), np.nan)


def project_with_jacobians(
    intrinsics: FloatArray, points: FloatArray, lens: LensModel = IDEAL, free: Sequence[str] = RADIAL
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Image of points, and its derivatives with respect to the intrinsic parameters and the points.

    Parameters
    ----------
    intrinsics, points, lens, free
        As for ``project``.

    Returns
    -------
    image : array (..., N, 2)
        Image coordinates [px] even beyond the valid field; image and derivatives are NaN where the model has no value.
    by_intrinsics : array (..., N, 2, 4 + n)
        Derivatives with respect to the intrinsic parameters.
    by_points : array (..., N, 2, 3)
        Derivatives with respect to the points [px/m].
    """
    lens = _lens(intrinsics, lens, free)
    with np.errstate(all="ignore"):  # outside its range the model gives NaN
        u, v = lens.image(points[..., 0], points[..., 1], points[..., 2])
        by_points, by_coefficients = lens.derivatives(points, free)
    focal = np.stack([intrinsics[..., 0, None], intrinsics[..., 1, None]], axis=-1)[..., None]
    zero, unit = np.zeros_like(u), np.where(np.isnan(u), np.nan, 1.0)
    by_camera = np.stack([np.stack([u, zero, unit, zero], axis=-1), np.stack([zero, v, zero, unit], axis=-1)], axis=-2)
    by_intrinsics = np.concatenate([by_camera, focal * by_coefficients], axis=-1)
    return _pixels(intrinsics, u, v), by_intrinsics, focal * by_points


def project_by_points(
    intrinsics: FloatArray, points: FloatArray, lens: LensModel = IDEAL, free: Sequence[str] = RADIAL
) -> tuple[FloatArray, FloatArray]:
    """Image of points, and its derivatives with respect to the points; see ``project_with_jacobians``."""
    image, _, by_points = project_with_jacobians(intrinsics, points, _lens(intrinsics, lens, free), ())
    return image, by_points


def ray_slopes(
    intrinsics: FloatArray, image: FloatArray, lens: LensModel = IDEAL, free: Sequence[str] = RADIAL
) -> FloatArray:
    """Slopes (X/Z, Y/Z) of the rays that a camera images at given coordinates: the inverse of ``project``.

    Parameters
    ----------
    intrinsics : array (..., 4 + n)
        As for ``project``.
    image : array (..., N, 2)
        Image coordinates [px].
    lens, free
        As for ``project``.

    Returns
    -------
    array (..., N, 2)
        Slopes of the rays [1]; NaN where the image coordinates are NaN, for rays at 90° or more to the axis, and where
        the distortion cannot be inverted (too far outside the calibrated field).
    """
    x = (image[..., 0] - intrinsics[..., 2, None]) / intrinsics[..., 0, None]
    y = (image[..., 1] - intrinsics[..., 3, None]) / intrinsics[..., 1, None]
    return np.stack(slopes(*_lens(intrinsics, lens, free).ray(x, y)), axis=-1)


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
    half = np.sinc(angle / (2.0 * np.pi))  # (1 - cos θ)/θ² = sinc²(θ/2)/2 avoids cancellation at small angles
    matrix: FloatArray = np.eye(3) + np.sinc(angle / np.pi) * generator + 0.5 * half**2 * (generator @ generator)
    return matrix


def rotation_vector(matrix: FloatArray) -> FloatArray:
    """Rotation vector of a rotation matrix, shape (..., 3) [rad]; angles in [0, π]."""
    from scipy.spatial.transform import Rotation

    vectors: FloatArray = Rotation.from_matrix(matrix.reshape(-1, 3, 3)).as_rotvec()
    reshaped: FloatArray = vectors.reshape(matrix.shape[:-1])
    return reshaped


def roll(matrix: FloatArray) -> float:
    """Twist of a rotation matrix (3, 3) about z [rad], in (−π, π]: ``tan(roll/2) = q_z/q_w`` of its quaternion."""
    return float(np.arctan2(matrix[1, 0] - matrix[0, 1], matrix[0, 0] + matrix[1, 1]))


def right_jacobian(rotation_vector: FloatArray) -> FloatArray:
    """Matrix J_r with R(ω + δ) = R(ω) R(J_r δ) to first order in δ, shape (..., 3, 3).

    J_r = I − (1 − cos θ)/θ² [ω]× + (θ − sin θ)/θ³ [ω]×² (G. Chirikjian, "Stochastic Models, Information Theory,
    and Lie Groups" 2, 2012, section 10.6).
    """
    angle = np.linalg.norm(rotation_vector, axis=-1)[..., None, None]
    generator = cross_matrix(rotation_vector)
    first = 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2
    small = angle < 1e-2  # here the series is exact to 1e-16, and the closed form loses digits
    safe = np.where(small, 1.0, angle)
    second = np.where(
        small,
        1.0 / 6.0 - angle**2 / 120.0 + angle**4 / 5040.0,
        (safe - np.sin(safe)) / safe**3,
    )
    jacobian: FloatArray = np.eye(3) - first * generator + second * (generator @ generator)
    return jacobian


def move(pose: FloatArray, points: FloatArray) -> FloatArray:
    """Points after a rigid motion, R x + t.

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


def pose_derivatives(by_points: FloatArray, pose: FloatArray, moved: FloatArray) -> FloatArray:
    """Derivatives with respect to the pose that moved points, from those with respect to the moved points.

    ∂(R x)/∂ω = −[R x]× J_l, with the left Jacobian J_l(ω) = J_r(−ω).

    Parameters
    ----------
    by_points : array (..., N, M, 3)
        Derivatives of M functions of each point.
    pose : array (..., 6)
        Rotation vector [rad] and translation [m].
    moved : array (..., N, 3)
        The points after the motion [m].

    Returns
    -------
    array (..., N, M, 6)
    """
    a, b, c = np.moveaxis(moved - pose[..., None, 3:], -1, 0)[..., None]
    x, y, z = np.moveaxis(by_points, -1, 0)
    turned = np.stack([b * z - c * y, c * x - a * z, a * y - b * x], axis=-1)
    rows = turned.reshape(*turned.shape[:-3], -1, 3) @ right_jacobian(-pose[..., :3])
    return np.concatenate([rows.reshape(turned.shape), np.broadcast_to(by_points, turned.shape)], axis=-1)


def _lens(intrinsics: FloatArray, lens: LensModel, free: Sequence[str]) -> LensModel:
    """The lens model with its free coefficients from the intrinsic parameters, shaped to broadcast with points."""
    changed = {name: intrinsics[..., 4 + k, None] for k, name in enumerate(free)}
    if all(np.all(value == getattr(lens, name)) for name, value in changed.items()):
        return lens  # coefficients are scalars, for which the model has an inverse and a valid field
    return replace(lens, **changed)


def _pixels(intrinsics: FloatArray, u: FloatArray, v: FloatArray) -> FloatArray:
    """Convert normalised image coordinates to pixels."""
    f_x, f_y, c_x, c_y = (intrinsics[..., i, None] for i in range(4))
    return np.stack([f_x * u + c_x, f_y * v + c_y], axis=-1)

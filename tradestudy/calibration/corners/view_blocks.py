"""Residuals of board corners per view, and their derivatives with respect to shared parameters and the view's pose."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

import numpy as np

from tradestudy.calibration.corners.corner_file import StereoCorners
from tradestudy.calibration.projection import (
    RADIAL_LENS,
    FreeLens,
    intrinsic_names,
    move,
    pose_derivatives,
    project_by_points,
    project_with_jacobians,
    ray_slopes,
    rotation_matrix,
    rotation_vector,
)
from tradestudy.errors import NotConvergedError
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.optics.lens_model import IDEAL

RELATIVE_POSE_NAMES = (
    "relative_rotation_x",
    "relative_rotation_y",
    "relative_rotation_z",
    "relative_translation_x",
    "relative_translation_y",
    "relative_translation_z",
)
RELATIVE = slice(-6, None)
ROTATION, TRANSLATION = slice(-6, -3), slice(-3, None)
"""Indices of the rotation and translation of the relative pose among a pair's parameters."""


def shared_names(free: Sequence[str]) -> tuple[str, ...]:
    """Names of the parameters of a pair whose lenses have these free coefficients."""
    intrinsic = intrinsic_names(free)
    return (*(f"left_{name}" for name in intrinsic), *(f"right_{name}" for name in intrinsic), *RELATIVE_POSE_NAMES)


def cameras_of(shared: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Parameters of the left and the right camera of a pair, each (..., 4 + n)."""
    half = (shared.shape[-1] - 6) // 2
    return shared[..., :half], shared[..., half:-6]


@dataclass(frozen=True, kw_only=True)
class ViewBlocks:
    """Residuals (observed − predicted) and derivatives of the prediction, one block per view.

    Parameters
    ----------
    residuals : array (V, M)
        Observed minus predicted coordinates [px]; zero where a corner is absent. Residuals and derivatives are whitened
        if the corners have a noise model.
    by_shared : array (V, M, P)
        Derivatives of the prediction with respect to the shared parameters.
    by_pose : array (V, M, 6)
        Derivatives of the prediction with respect to the pose of the view's board.
    """

    residuals: FloatArray
    by_shared: FloatArray
    by_pose: FloatArray


def board_points(board: FloatArray) -> FloatArray:
    """Corners of a flat board as points with z = 0, shape (..., N, 3)."""
    return np.concatenate([board, np.zeros_like(board[..., :1])], axis=-1)


def camera_blocks(
    intrinsics: FloatArray,
    poses: FloatArray,
    board: FloatArray,
    image: FloatArray,
    present: BoolArray | FloatArray,
    lens: FreeLens = RADIAL_LENS,
) -> ViewBlocks:
    """Blocks of one camera.

    Parameters
    ----------
    intrinsics : array (4 + n,)
        Intrinsic parameters, as for ``projection.project``.
    poses : array (V, 6)
        Poses from board to camera [rad, m].
    board, image : array (V, N, 2)
        Corners on the board [m] and in the image [px].
    present : array (V, N)
        Which corners exist, or the square roots of their weights.
    lens
        Lens model of the camera.

    Returns
    -------
    ViewBlocks
        Blocks with M = 2 N and P = 4 + n.
    """
    points = move(poses, board_points(board))
    predicted, by_intrinsics, by_points = project_with_jacobians(intrinsics, points, lens.model, lens.free)
    return ViewBlocks(
        residuals=_flat(image - predicted, present),
        by_shared=_flat(by_intrinsics, present),
        by_pose=_flat(pose_derivatives(by_points, poses, points), present),
    )


def pair_blocks(shared: FloatArray, poses: FloatArray, corners: StereoCorners) -> ViewBlocks:
    """Blocks of both cameras, coupled by their relative pose.

    Parameters
    ----------
    shared : array (P,)
        Intrinsic parameters of the left and right camera, then the relative pose (left frame to right frame), in the
        order of ``shared_names`` [px, 1, rad, m].
    poses : array (V, 6)
        Poses from board to left camera [rad, m].
    corners : StereoCorners
        The observed corners.

    Returns
    -------
    ViewBlocks
        Blocks with M = 4 N (left corners, then right corners) and P = 14 + 2 n.
    """
    seen_left = move(poses, corners.points)
    seen_right = move(shared[RELATIVE], seen_left)
    lens, (of_left, of_right) = corners.lens, cameras_of(shared)
    left, left_by_intrinsics, left_by_points = project_with_jacobians(of_left, seen_left, lens.model, lens.free)
    right, right_by_intrinsics, right_by_points = project_with_jacobians(of_right, seen_right, lens.model, lens.free)
    right_by_relative = pose_derivatives(right_by_points, shared[RELATIVE], seen_right)
    right_by_pose = pose_derivatives(right_by_points @ rotation_matrix(shared[ROTATION]), poses, seen_left)
    none = np.zeros((*left_by_intrinsics.shape[:-1], len(shared) - len(of_left)))
    by_shared_left = np.concatenate([left_by_intrinsics, none], axis=-1)
    by_shared_right = np.concatenate(
        [np.zeros_like(right_by_intrinsics), right_by_intrinsics, right_by_relative], axis=-1
    )
    return ViewBlocks(
        residuals=both_pictures(corners.left - left, corners.right - right, corners),
        by_shared=both_pictures(by_shared_left, by_shared_right, corners),
        by_pose=both_pictures(pose_derivatives(left_by_points, poses, seen_left), right_by_pose, corners),
    )


def state_blocks(
    shared: FloatArray, poses: FloatArray, corners: StereoCorners, lever: float
) -> tuple[FloatArray, FloatArray]:
    """Residuals of both cameras, and derivatives of the prediction with respect to the states of the views.

    Parameters
    ----------
    shared, poses, corners
        As for ``pair_blocks``.
    lever : float
        Radius of gyration of the board [m]; rotations are expressed as displacements at this radius.

    Returns
    -------
    residuals : array (V, 4 N)
        As for ``pair_blocks``, for a board that does not move.
    by_states : array (V, 4 N, 12)
        Derivatives with respect to the pose, then to a small motion of the board between the two exposures: rotation ×
        lever about the board's centre [m], and translation [m]. The left picture does not see the motion.
    """
    seen_left = move(poses, corners.points)
    seen_right = move(shared[RELATIVE], seen_left)
    lens, (of_left, of_right) = corners.lens, cameras_of(shared)
    left, left_by_points = project_by_points(of_left, seen_left, lens.model, lens.free)
    right, right_by_points = project_by_points(of_right, seen_right, lens.model, lens.free)
    weight = corners.present[..., None] / corners.present.sum(axis=1)[:, None, None]
    centre = (seen_right * weight).sum(axis=1)
    # A small turn about the centre of the board, as of a pose that has moved the board there without turning it.
    by_motion = pose_derivatives(right_by_points, np.concatenate([np.zeros_like(centre), centre], axis=-1), seen_right)
    by_motion[..., :3] /= lever
    left_by_pose = pose_derivatives(left_by_points, poses, seen_left)
    right_by_pose = pose_derivatives(right_by_points @ rotation_matrix(shared[ROTATION]), poses, seen_left)
    by_left = np.concatenate([left_by_pose, np.zeros_like(by_motion)], axis=-1)
    by_right = np.concatenate([right_by_pose, by_motion], axis=-1)
    residuals = both_pictures(corners.left - left, corners.right - right, corners)
    return residuals, both_pictures(by_left, by_right, corners)


def _flat(values: FloatArray, present: BoolArray | FloatArray) -> FloatArray:
    """Coordinates (V, N, 2) or their derivatives (V, N, 2, P) with all rows of a view together; zero where absent."""
    weight = present.reshape(*present.shape, *[1] * (values.ndim - 2))
    return np.where(weight > 0.0, values * weight, 0.0).reshape(len(present), -1, *values.shape[3:])


def both_pictures(left: FloatArray, right: FloatArray, corners: StereoCorners) -> FloatArray:
    """Rows of both pictures as in the `ViewBlocks` of a pair: left corners, then right corners, whitened."""
    rows = np.concatenate([_flat(side, corners.present) for side in (left, right)], axis=1)
    return rows if corners.noise is None else corners.noise.whiten(rows)


def right_centre(shared: FloatArray) -> FloatArray:
    """Centre of the right camera in the left camera's frame, −Rᵀ t [m], shape (..., 3)."""
    turned = rotation_matrix(shared[..., ROTATION]).swapaxes(-1, -2) @ shared[..., TRANSLATION, None]
    return np.asarray(-turned[..., 0])


_FOCALS: Final = 12
_UNIT: Final = np.array([1.0, 1.0, 0.0, 0.0])


def homography(board: FloatArray, image: FloatArray) -> FloatArray:
    """Projective map from board to image, by the normalised direct linear transform.

    Parameters
    ----------
    board : array (N, 2)
        Corners on the board in any unit; at least four, of which no three lie on a line.
    image : array (N, 2)
        The same corners in the image.

    Returns
    -------
    array (3, 3)
        H with image ~ H (x, y, 1); its determinant is positive if the board is in front of the camera.

    Notes
    -----
    R. Hartley, A. Zisserman, "Multiple View Geometry" (2004), algorithm 4.2.
    """
    to_board, to_image = _centring(board), _centring(image)
    x, y = (board @ to_board[:2, :2].T + to_board[:2, 2]).T
    u, v = (image @ to_image[:2, :2].T + to_image[:2, 2]).T
    ones, zeros = np.ones_like(x), np.zeros_like(x)
    rows = np.concatenate(
        [
            np.column_stack([x, y, ones, zeros, zeros, zeros, -u * x, -u * y, -u]),
            np.column_stack([zeros, zeros, zeros, x, y, ones, -v * x, -v * y, -v]),
        ]
    )
    solution = np.linalg.svd(rows, full_matrices=False)[2][-1].reshape(3, 3)
    unscaled = np.linalg.inv(to_image) @ solution @ to_board
    scaled: FloatArray = unscaled / np.cbrt(np.linalg.det(unscaled))
    return scaled


def first_values(
    board: FloatArray, image: FloatArray, present: BoolArray, lens: FreeLens
) -> tuple[FloatArray, FloatArray]:
    """Initial intrinsic parameters and board poses.

    For a pinhole, they have a closed form. Other lens models bend lines, so that focal lengths from a fifth to four
    times the extent of the corners are also tried; the one whose poses fit the corners best is used.

    Parameters
    ----------
    board, image, present
        As for `first_intrinsics`.
    lens
        Lens model with starting values of its coefficients.

    Returns
    -------
    intrinsics : array (4 + n,)
    poses : array (V, 6)

    Raises
    ------
    NotConvergedError
        The views do not determine the intrinsic parameters.
    """
    if lens.model == IDEAL:
        closed = first_intrinsics(board, image, present)
        return np.concatenate([closed, lens.start]), first_poses(closed, board, image, present)
    low, high = (end(image[present], axis=0) for end in (np.min, np.max))
    focals = float(np.max(high - low)) * np.geomspace(0.2, 4.0, _FOCALS)
    tried = [np.array([focal, focal, *((low + high) / 2.0)]) for focal in focals]
    with suppress(NotConvergedError):
        tried.append(first_intrinsics(board, image, present))
    best, values = np.inf, (np.concatenate([tried[0], lens.start]), np.zeros((len(board), 6)))
    for camera in tried:
        intrinsics = np.concatenate([camera, lens.start])
        rays = ray_slopes(intrinsics, image, lens.model, lens.free)
        usable = present & np.all(np.isfinite(rays), axis=-1)
        # Too few of the corners lie in the field of a lens with this focal length.
        if np.any(2 * usable.sum(axis=1) < present.sum(axis=1)):
            continue
        poses = first_poses(_UNIT, board, rays, usable)
        residuals = camera_blocks(intrinsics, poses, board, image, present, lens).residuals
        if (cost := float(np.sum(residuals**2))) < best:
            best, values = cost, (intrinsics, poses)
    if not np.isfinite(best):
        raise NotConvergedError(
            "the lens model does not fit the corners with any focal length",
            value=f"{lens.model.name}, focal lengths of {focals[0]:.0f} to {focals[-1]:.0f} px",
            limit="poses of the board in front of the camera in every view",
            remedy="check the order of the corners, or give coefficients closer to those of the lens",
        )
    return values


def first_intrinsics(board: FloatArray, image: FloatArray, present: BoolArray) -> FloatArray:
    """Intrinsic parameters of a pinhole without skew and distortion, from the image of the absolute conic.

    Parameters
    ----------
    board, image : array (V, N, 2)
        Corners on the board [m] and in the image [px].
    present : bool array (V, N)
        Which corners exist.

    Returns
    -------
    array (4,)
        Focal lengths and principal point [px].

    Raises
    ------
    NotConvergedError
        The views do not determine the intrinsic parameters (all boards parallel, or corners in the wrong order).

    Notes
    -----
    Z. Zhang, "A flexible new technique for camera calibration", IEEE PAMI 22 (2000) 1330, with zero skew.
    """
    normalise = _centring(image[present])
    conditions = []
    for row, exists in enumerate(present):
        columns = (normalise @ homography(board[row, exists], image[row, exists])).T
        # A homography has any scale; views should count alike.
        columns = columns / np.linalg.norm(columns[:2])
        conditions += [
            _conic_row(columns[0], columns[1]),
            _conic_row(columns[0], columns[0]) - _conic_row(columns[1], columns[1]),
        ]
    b11, b22, b13, b23, b33 = np.linalg.svd(np.array(conditions))[2][-1]
    with np.errstate(divide="ignore", invalid="ignore"):  # degenerate views are refused below
        centre = -np.array([b13 / b11, b23 / b22])
        scale = b33 - b13**2 / b11 - b23**2 / b22
        focal = np.sqrt(scale / np.array([b11, b22]))
    if not (np.all(np.isfinite(focal)) and np.all(np.isfinite(centre))):
        raise NotConvergedError(
            "the views do not determine the focal length",
            value=f"{len(present)} views",
            limit="boards tilted in different directions, with corners in the order of the board",
            remedy="add tilted views, and check the order of the corners",
        )
    zoom = normalise[0, 0]
    centre = (centre - normalise[:2, 2]) / zoom
    return np.array([*(focal / zoom), *centre])


def first_poses(intrinsics: FloatArray, board: FloatArray, image: FloatArray, present: BoolArray) -> FloatArray:
    """Board poses from homographies, without distortion.

    Parameters
    ----------
    intrinsics : array (4,)
        Focal lengths and principal point [px].
    board, image : array (V, N, 2)
        Corners on the board [m] and in the image [px].
    present : bool array (V, N)
        Which corners exist.

    Returns
    -------
    array (V, 6)
        Rotation vectors [rad] and translations [m] from board to camera.
    """
    camera = np.array([[intrinsics[0], 0.0, intrinsics[2]], [0.0, intrinsics[1], intrinsics[3]], [0.0, 0.0, 1.0]])
    poses = np.empty((len(board), 6))
    for row, exists in enumerate(present):
        columns = np.linalg.solve(camera, homography(board[row, exists], image[row, exists]))
        columns = columns / np.sqrt(np.linalg.norm(columns[:, 0]) * np.linalg.norm(columns[:, 1]))
        if columns[2, 2] < 0.0:  # a homography has no sign, but the board lies in front of the camera
            columns = -columns
        frame = np.column_stack([columns[:, 0], columns[:, 1], np.cross(columns[:, 0], columns[:, 1])])
        u, _, vh = np.linalg.svd(frame)  # for the nearest rotation: noise makes the columns not quite orthonormal
        poses[row, :3] = rotation_vector(u @ vh)
        poses[row, 3:] = columns[:, 2]
    return poses


def _centring(points: FloatArray) -> FloatArray:
    """Similarity that moves the centroid to the origin and scales the mean distance from it to √2."""
    centre = points.mean(axis=0)
    zoom = np.sqrt(2.0) / np.linalg.norm(points - centre, axis=1).mean()
    return np.array([[zoom, 0.0, -zoom * centre[0]], [0.0, zoom, -zoom * centre[1]], [0.0, 0.0, 1.0]])


def _conic_row(first: FloatArray, second: FloatArray) -> FloatArray:
    """Coefficients of (B11, B22, B13, B23, B33) in firstᵀ B second, with B12 = 0."""
    a, b = first, second
    return np.array([a[0] * b[0], a[1] * b[1], a[0] * b[2] + a[2] * b[0], a[1] * b[2] + a[2] * b[1], a[2] * b[2]])

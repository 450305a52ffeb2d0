"""Residuals of board corners per view, and their derivatives with respect to shared parameters and the view's pose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tradestudy.calibration.corners.corner_file import StereoCorners
from tradestudy.calibration.projection import (
    RADIAL_LENS,
    FreeLens,
    cross_matrix,
    intrinsic_names,
    move,
    move_jacobian,
    project_with_jacobians,
    rotation_matrix,
)
from tradestudy.optics.arrays import BoolArray, FloatArray

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
    own = intrinsic_names(free)
    return (*(f"left_{name}" for name in own), *(f"right_{name}" for name in own), *RELATIVE_POSE_NAMES)


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
    points = board_points(board)
    predicted, by_intrinsics, by_points = project_with_jacobians(intrinsics, move(poses, points), lens.model, lens.free)
    by_pose = by_points @ move_jacobian(poses, points)
    return ViewBlocks(
        residuals=_flat(image - predicted, present),
        by_shared=_flat_rows(by_intrinsics, present),
        by_pose=_flat_rows(by_pose, present),
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
    points = corners.points
    seen_left = move(poses, points)
    seen_right = move(shared[RELATIVE], seen_left)
    lens, (of_left, of_right) = corners.lens, cameras_of(shared)
    left, left_by_intrinsics, left_by_points = project_with_jacobians(of_left, seen_left, lens.model, lens.free)
    right, right_by_intrinsics, right_by_points = project_with_jacobians(of_right, seen_right, lens.model, lens.free)
    left_pose = move_jacobian(poses, points)
    right_by_relative = right_by_points @ move_jacobian(shared[RELATIVE], seen_left)
    right_by_pose = right_by_points @ rotation_matrix(shared[ROTATION]) @ left_pose
    there = corners.present
    whiten = (lambda values: values) if corners.noise is None else corners.noise.whiten
    none = np.zeros((*left_by_intrinsics.shape[:-1], len(shared) - len(of_left)))
    by_shared_left = np.concatenate([left_by_intrinsics, none], axis=-1)
    by_shared_right = np.concatenate(
        [np.zeros_like(right_by_intrinsics), right_by_intrinsics, right_by_relative], axis=-1
    )
    return ViewBlocks(
        residuals=whiten(
            np.concatenate([_flat(corners.left - left, there), _flat(corners.right - right, there)], axis=1)
        ),
        by_shared=whiten(
            np.concatenate([_flat_rows(by_shared_left, there), _flat_rows(by_shared_right, there)], axis=1)
        ),
        by_pose=whiten(
            np.concatenate([_flat_rows(left_by_points @ left_pose, there), _flat_rows(right_by_pose, there)], axis=1)
        ),
    )


def motion_columns(shared: FloatArray, poses: FloatArray, corners: StereoCorners, lever: float) -> FloatArray:
    """Derivatives of the right corners with respect to a small motion of the board between the two exposures.

    Parameters
    ----------
    shared, poses, corners
        As for ``pair_blocks``.
    lever : float
        Radius of gyration of the board [m]; rotations are expressed as displacements at this radius.

    Returns
    -------
    array (V, 4 N, 6)
        Derivatives with respect to rotation × lever about the board's centre [m], then translation [m]; zero in the
        left rows.
    """
    seen = move(shared[RELATIVE], move(poses, corners.points))
    weight = corners.present[..., None] / corners.present.sum(axis=1)[:, None, None]
    centre = (seen * weight).sum(axis=1, keepdims=True)
    twist = np.concatenate(
        [-cross_matrix(seen - centre) / lever, np.broadcast_to(np.eye(3), (*seen.shape[:-1], 3, 3))], axis=-1
    )
    by_points = project_with_jacobians(cameras_of(shared)[1], seen, corners.lens.model, corners.lens.free)[2]
    right = _flat_rows(by_points @ twist, corners.present)
    both = np.concatenate([np.zeros_like(right), right], axis=1)
    return both if corners.noise is None else corners.noise.whiten(both)


def _flat(values: FloatArray, present: BoolArray | FloatArray) -> FloatArray:
    """Coordinates of all corners in one row per view, weighted; zero where absent."""
    weight = present[..., None]
    return np.where(weight > 0.0, values * weight, 0.0).reshape(*values.shape[:-2], -1)


def _flat_rows(values: FloatArray, present: BoolArray | FloatArray) -> FloatArray:
    """Derivatives of all corners in one block per view, weighted; zero where absent."""
    weight = present[..., None, None]
    blanked = np.where(weight > 0.0, values * weight, 0.0)
    return blanked.reshape(len(present), -1, values.shape[-1])

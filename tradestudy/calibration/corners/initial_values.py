"""Initial values of intrinsic parameters and board poses in closed form, from the homographies of a flat board."""

from __future__ import annotations

from contextlib import suppress
from typing import Final

import numpy as np

from tradestudy.calibration.corners.view_blocks import camera_blocks
from tradestudy.calibration.projection import FreeLens, ray_slopes, rotation_vector
from tradestudy.errors import NotConvergedError
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.optics.lens_models.rational import IDEAL

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
    one, zero = np.ones_like(x), np.zeros_like(x)
    rows = np.concatenate(
        [
            np.column_stack([x, y, one, zero, zero, zero, -u * x, -u * y, -u]),
            np.column_stack([zero, zero, zero, x, y, one, -v * x, -v * y, -v]),
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
        seen = ray_slopes(intrinsics, image, lens.model, lens.free)
        there = present & np.all(np.isfinite(seen), axis=-1)
        if np.any(2 * there.sum(axis=1) < present.sum(axis=1)):
            continue
        poses = first_poses(_UNIT, board, seen, there)
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
    for row, there in enumerate(present):
        columns = (normalise @ homography(board[row, there], image[row, there])).T
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
    for row, there in enumerate(present):
        columns = np.linalg.solve(camera, homography(board[row, there], image[row, there]))
        columns = columns / np.sqrt(np.linalg.norm(columns[:, 0]) * np.linalg.norm(columns[:, 1]))
        if columns[2, 2] < 0.0:
            columns = -columns
        frame = np.column_stack([columns[:, 0], columns[:, 1], np.cross(columns[:, 0], columns[:, 1])])
        left, _, right = np.linalg.svd(frame)
        poses[row, :3] = rotation_vector(left @ right)
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

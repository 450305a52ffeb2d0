"""What corners would change by, were the board bent or the lenses of a model with more coefficients."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from tradestudy.calibration.corners.corner_file import StereoCorners
from tradestudy.calibration.corners.view_blocks import LEFT, RELATIVE, RIGHT
from tradestudy.calibration.projection import move, project_with_jacobians, rotation_matrix
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.lens_models.rational import Rational

LENS_EXTENSIONS: Final[Mapping[str, tuple[str, ...]]] = {
    "k3": ("k3",),
    "p1 p2": ("p1", "p2"),
    "k3 p1 p2": ("k3", "p1", "p2"),
    "thin prism": ("s1", "s2", "s3", "s4"),
}
"""Coefficients beside k₁ and k₂ that the projection is linear in about zero."""


def warp_shapes(corners: StereoCorners, lever: float) -> FloatArray:
    """Heights of the corners, shape (V, N, 3) [1], of a board bent by one unit: see `warp_columns`.

    The middle is that of the whole board, so that views which miss corners see the same shape.
    """
    low, high = (end(corners.board[corners.present], axis=0) for end in (np.min, np.max))
    x, y = np.moveaxis((corners.board - (low + high) / 2.0) / lever, -1, 0)
    return np.stack([x * x + y * y, x * x - y * y, 2.0 * x * y], axis=-1)


def warp_columns(shared: FloatArray, poses: FloatArray, corners: StereoCorners, lever: float) -> FloatArray:
    """Derivatives by a bent board: ``z = a (x² + y²)/L² + b (x² − y²)/L² + c 2xy/L²`` about its middle.

    Parameters
    ----------
    shared, poses, corners
        As for ``view_blocks.pair_blocks``.
    lever
        L, radius of gyration of the board [m]: a, b and c are lengths, about the sag towards its edge.

    Returns
    -------
    array (V, 4 N, 3)
        By a, b and c, whitened as the residuals are.
    """
    normal = rotation_matrix(poses[:, :3])[..., 2]
    seen_left = move(poses, corners.points)
    seen_right = move(shared[RELATIVE], seen_left)
    by_left = project_with_jacobians(shared[LEFT], seen_left)[2]
    by_right = project_with_jacobians(shared[RIGHT], seen_right)[2] @ rotation_matrix(shared[12:15])
    shapes = warp_shapes(corners, lever)
    rows = [np.einsum("vnij,vj,vne->vnie", by, normal, shapes) for by in (by_left, by_right)]
    return _laid_out(rows[0], rows[1], corners)


def lens_columns(shared: FloatArray, poses: FloatArray, corners: StereoCorners, names: tuple[str, ...]) -> FloatArray:
    """Derivatives by more coefficients of the left, then of the right lens, at zero; shape (V, 4 N, 2 n).

    Parameters
    ----------
    shared, poses, corners
        As for ``view_blocks.pair_blocks``.
    names
        Coefficients of `Rational`.
    """
    seen_left = move(poses, corners.points)
    seen = (seen_left, move(shared[RELATIVE], seen_left))
    rows = []
    for side, points in zip((LEFT, RIGHT), seen, strict=True):
        focal, radial = shared[side][:2, None], shared[side][4:]
        rows.append(focal * Rational(k1=float(radial[0]), k2=float(radial[1])).derivatives(points, names)[1])
    none = np.zeros_like(rows[0])
    left, right = np.concatenate([rows[0], none], axis=-1), np.concatenate([none, rows[1]], axis=-1)
    return _laid_out(left, right, corners)


def _laid_out(left: FloatArray, right: FloatArray, corners: StereoCorners) -> FloatArray:
    """Rows of both pictures, each (V, N, 2, E), as `ViewBlocks` has them: left corners, then right corners."""
    rows = [np.where(corners.present[..., None, None], side, 0.0) for side in (left, right)]
    both = np.concatenate([side.reshape(len(side), -1, side.shape[-1]) for side in rows], axis=1)
    return both if corners.noise is None else corners.noise.whiten(both)

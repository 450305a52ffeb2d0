"""The warp of a board: a bowl and two saddles, which the corners determine together with the cameras."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from tradestudy.calibration.corners.corner_file import CornerFileError, StereoCorners
from tradestudy.calibration.corners.marginal_views import CompressedViews, compress_views, gyration_radius
from tradestudy.calibration.corners.pair_residual import PairResidualFit
from tradestudy.calibration.corners.view_blocks import RELATIVE, ROTATION, cameras_of
from tradestudy.calibration.projection import move, project_with_jacobians, rotation_matrix
from tradestudy.optics.arrays import FloatArray

WARP_NAMES: Final = ("board_bowl", "board_edge_saddle", "board_diagonal_saddle")
_LEAST_SHOWN: Final = 1e-3  # ratio of the least visible to the most visible combination of warps


def check_warp_shown(corners: StereoCorners) -> None:
    """Refuse boards on which a warp looks like a change of pose, such as boards with only two rows of corners.

    Raises
    ------
    CornerFileError
        In every view, the corners lie on two lines or on another conic section.
    """
    shapes, weight = warp_shapes(corners, gyration_radius(corners)), corners.present[..., None].astype(np.float64)
    flat = np.concatenate([weight, weight * corners.board], axis=-1)
    left = weight * shapes - flat @ (np.linalg.pinv(flat) @ (weight * shapes))
    shown = np.linalg.svd(left.reshape(-1, shapes.shape[-1]), compute_uv=False)
    if shown[-1] < _LEAST_SHOWN * shown[0]:
        raise CornerFileError(
            "the corners cannot show whether the board is bent",
            value=f"least visible warp {shown[-1] / shown[0]:.1e} of the most visible one",
            limit=f">= {_LEAST_SHOWN:g}, as with three rows and three columns",
            remedy="use a board with at least three rows and three columns of corners",
        )


def warped(corners: StereoCorners, warp: FloatArray) -> StereoCorners:
    """Corners on a board with this warp (3,) [m]; see `warp_columns`."""
    return replace(corners, heights=warp_shapes(corners, gyration_radius(corners)) @ warp)


def views_with_warp(fit: PairResidualFit, corners: StereoCorners, warp: FloatArray) -> CompressedViews:
    """Views linearised about a fit; the warp follows the shared parameters.

    Parameters
    ----------
    fit, corners
        The fit and its data.
    warp : array (3,)
        Warp that these corners already include [m].
    """
    columns = warp_columns(fit.shared, fit.states.poses, corners, gyration_radius(corners))
    views = compress_views(fit.shared, fit.states, corners, fit.lever, extra=columns)
    return replace(views, centre=np.concatenate([fit.shared, warp]))


def warp_shapes(corners: StereoCorners, lever: float) -> FloatArray:
    """Heights of the corners for unit warp, shape (V, N, 3) [1]; see `warp_columns`.

    They refer to the centre of the whole board, so that views with missing corners see the same shape.
    """
    low, high = (end(corners.board[corners.present], axis=0) for end in (np.min, np.max))
    x, y = np.moveaxis((corners.board - (low + high) / 2.0) / lever, -1, 0)
    return np.stack([x * x + y * y, x * x - y * y, 2.0 * x * y], axis=-1)


def warp_columns(shared: FloatArray, poses: FloatArray, corners: StereoCorners, lever: float) -> FloatArray:
    """Derivatives with respect to a warp ``z = a (x² + y²)/L² + b (x² − y²)/L² + c 2xy/L²`` about the board's centre.

    Parameters
    ----------
    shared, poses, corners
        As for ``view_blocks.pair_blocks``.
    lever
        L, radius of gyration of the board [m]; a, b and c are lengths, roughly the sag towards the edge.

    Returns
    -------
    array (V, 4 N, 3)
        Derivatives with respect to a, b and c, whitened like the residuals.
    """
    normal = rotation_matrix(poses[:, :3])[..., 2]
    seen_left = move(poses, corners.points)
    seen_right = move(shared[RELATIVE], seen_left)
    lens, (left, right) = corners.lens, cameras_of(shared)
    by_left = project_with_jacobians(left, seen_left, lens.model, lens.free)[2]
    by_right = project_with_jacobians(right, seen_right, lens.model, lens.free)[2] @ rotation_matrix(shared[ROTATION])
    shapes = warp_shapes(corners, lever)
    rows = [np.einsum("vnij,vj,vne->vnie", by, normal, shapes) for by in (by_left, by_right)]
    return _in_block_order(rows[0], rows[1], corners)


def _in_block_order(left: FloatArray, right: FloatArray, corners: StereoCorners) -> FloatArray:
    """Rows of both pictures, each (V, N, 2, E), arranged as in `ViewBlocks`: left corners, then right corners."""
    rows = [np.where(corners.present[..., None, None], side, 0.0) for side in (left, right)]
    both = np.concatenate([side.reshape(len(side), -1, side.shape[-1]) for side in rows], axis=1)
    return both if corners.noise is None else corners.noise.whiten(both)

"""A real pair from its corner file to its calibration, with every check on the way."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tradestudy.calibration.corners.bundle_adjustment import (
    CameraFit,
    PairFit,
    check_rig,
    fit_camera,
    fit_pair,
)
from tradestudy.calibration.corners.corner_file import CornerFileError, StereoCorners
from tradestudy.calibration.corners.pair_residual import (
    PairResidualFit,
    ViewMeans,
    fit_pair_residual,
    view_means,
)
from tradestudy.calibration.corners.view_blocks import LEFT, RELATIVE, RIGHT
from tradestudy.calibration.projection import move, project, ray_slopes, rotation_matrix
from tradestudy.errors import TradestudyError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.triangulation import inverse_depth_on_ray

_BETTER = 0.9  # an exchange of columns must lower the residuals by a tenth to be believed


def observe_pair(shared: FloatArray, points: FloatArray) -> FloatArray:
    """Image coordinates of points in both cameras.

    Parameters
    ----------
    shared : array (..., 18)
        In the order of ``view_blocks.SHARED_NAMES`` [px, 1, rad, m].
    points : array (..., N, 3)
        Points in the left camera's frame [m].

    Returns
    -------
    array (..., N, 4)
        Left x, y and right x, y [px]; NaN for points behind the camera concerned.
    """
    left = project(shared[..., LEFT], points)
    right = project(shared[..., RIGHT], move(shared[..., RELATIVE], points))
    return np.concatenate(np.broadcast_arrays(left, right), axis=-1)


def inverse_depth(shared: FloatArray, seen: FloatArray) -> FloatArray:
    """Inverse depth of points from their coordinates in both images, by disparity only.

    The left ray Z d is Z R d in the axes of the right camera; see `inverse_depth_on_ray`. The right y coordinate takes
    no part.

    Parameters
    ----------
    shared : array (..., 18)
        In the order of ``view_blocks.SHARED_NAMES``; draws of a calibration as leading axes.
    seen : array (..., N, 4)
        Left x, y and right x, y [px].

    Returns
    -------
    array (..., N)
        1/Z in the left camera's frame [1/m]; zero or negative where the rays do not meet in front of the pair, which
        stands for infinity.
    """
    left = ray_slopes(shared[..., LEFT], seen[..., :2])
    right = ray_slopes(shared[..., RIGHT], seen[..., 2:])[..., 0]
    ray = np.concatenate([left, np.ones_like(left[..., :1])], axis=-1)
    turned = ray @ np.swapaxes(rotation_matrix(shared[..., 12:15]), -1, -2)
    moved_x, moved_z = shared[..., 15, None], shared[..., 17, None]
    return inverse_depth_on_ray(turned[..., 0], turned[..., 2], right, moved_x, moved_z)


@dataclass(frozen=True, kw_only=True)
class RigFit:
    """Everything that a corner file says about a pair, short of sampling.

    Parameters
    ----------
    corners : StereoCorners
        What was seen.
    left, right : CameraFit
        Each camera alone.
    pair : PairFit
        Both cameras with one relative pose and independent noise.
    means : ViewMeans
        Mean residuals of the views of that fit.
    explained : PairResidualFit
        The pair with a left–right term per view: the calibration to use.
    """

    corners: StereoCorners
    left: CameraFit
    right: CameraFit
    pair: PairFit
    means: ViewMeans
    explained: PairResidualFit


def fit_rig(corners: StereoCorners) -> RigFit:
    """Fit a pair: cameras, bundle adjustment, left–right term.

    Parameters
    ----------
    corners : StereoCorners
        From ``corners.read_corners``.

    Returns
    -------
    RigFit
        All stages.

    Raises
    ------
    CornerFileError
        Columns are swapped between the cameras, left and right are exchanged, or a view contradicts the others.
    NotConvergedError
        The views do not determine the parameters.
    """
    left = fit_camera(corners.board, corners.left, corners.present)
    right = fit_camera(corners.board, corners.right, corners.present)
    _check_columns(corners, left, right)
    pair = fit_pair(corners, left, right)
    check_rig(pair)
    return RigFit(
        corners=corners,
        left=left,
        right=right,
        pair=pair,
        means=view_means(pair, corners),
        explained=fit_pair_residual(pair, corners),
    )


def _check_columns(corners: StereoCorners, left: CameraFit, right: CameraFit) -> None:
    """Refuse columns swapped between nearly parallel cameras, which fit, though not as well as the right ones."""
    mixed_left = np.stack([corners.left[..., 0], corners.right[..., 1]], axis=-1)
    mixed_right = np.stack([corners.right[..., 0], corners.left[..., 1]], axis=-1)
    mixed = _rms_or_none(replace(corners, left=mixed_left, right=mixed_right))
    present = float(np.hypot(left.corner_rms_px, right.corner_rms_px))
    if mixed is not None and mixed < _BETTER * present:
        raise CornerFileError(
            "one pair of columns is swapped between the cameras",
            value=f"{present:.3g} px rms, and {mixed:.3g} px with left_y_px and right_y_px exchanged",
            limit=f"the exchange lowers the residual by less than {100 * (1 - _BETTER):.0f} %",
            remedy="exchange left_y_px with right_y_px, or left_x_px with right_x_px",
        )


def _rms_or_none(corners: StereoCorners) -> float | None:
    """Root sum square of both cameras' residuals [px]; None where no camera fits these columns."""
    try:
        sides: list[FloatArray] = [corners.left, corners.right]
        fits = [fit_camera(corners.board, side, corners.present) for side in sides]
    except TradestudyError:  # then the columns as given are the better ones
        return None
    return float(np.hypot(fits[0].corner_rms_px, fits[1].corner_rms_px))

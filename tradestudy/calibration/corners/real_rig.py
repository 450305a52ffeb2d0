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
from tradestudy.errors import TradestudyError
from tradestudy.optics.arrays import FloatArray

_BETTER = 0.9  # an exchange of columns must lower the residuals by a tenth to be believed


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


def fit_rig(corners: StereoCorners, *, declared_baseline: float | None = None) -> RigFit:
    """Fit a pair: cameras, bundle adjustment, left–right term.

    Parameters
    ----------
    corners : StereoCorners
        From ``corners.read_corners``.
    declared_baseline : float, optional
        Distance between the cameras by a ruler [m]; checked to ± 20 %.

    Returns
    -------
    RigFit
        All stages.

    Raises
    ------
    CornerFileError
        Columns are swapped between the cameras, left and right are exchanged, a view contradicts the others, or the
        board's unit contradicts the declared baseline.
    NotConvergedError
        The views do not determine the parameters.
    """
    left = fit_camera(corners.board, corners.left, corners.present)
    right = fit_camera(corners.board, corners.right, corners.present)
    _check_columns(corners, left, right)
    pair = fit_pair(corners, left, right)
    check_rig(pair, declared_baseline=declared_baseline)
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

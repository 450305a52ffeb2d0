"""Bundle adjustment of a camera or a pair: all parameters and poses are fitted at once, then poses marginalised."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tradestudy.calibration.corners.corner_file import CornerFileError, StereoCorners
from tradestudy.calibration.corners.view_blocks import (
    ROTATION,
    TRANSLATION,
    ViewBlocks,
    camera_blocks,
    first_values,
    pair_blocks,
    right_centre,
    shared_names,
)
from tradestudy.calibration.laplace import covariance_from_information, triangular_factor
from tradestudy.calibration.projection import (
    LARGEST_ROLL,
    RADIAL_LENS,
    FreeLens,
    intrinsic_names,
    roll,
    rotation_matrix,
    rotation_vector,
)
from tradestudy.errors import NotConvergedError, OutOfRangeError
from tradestudy.optics.arrays import BoolArray, FloatArray

RESIDUAL_LIMIT_PX = 2.0  # corner detectors are ten times better; larger residuals mean wrong correspondences
_MOST_EVALUATIONS = 400  # with many coefficients, the minimum lies in a curved valley and needs small steps
_FIRST_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-4, 1e-14, 1e12
_ROUNDING = 1e-13  # of the sum of squares: a smaller predicted decrease is rounding
_NO_NOISE = 1e-11  # px
_ROUNDED_PX = 1e-6  # far below the noise of any detector
_ROTATION_LIMIT = np.radians(10.0)  # the cameras of a rigid pair do not rotate relative to each other


@dataclass(frozen=True, kw_only=True)
class _Fit:
    """Results of a fit besides its parameters: board poses, covariance of the parameters, noise and residuals."""

    poses: FloatArray
    covariance: FloatArray
    noise_px: float
    residuals_px: FloatArray
    corner_rms_px: float


@dataclass(frozen=True, kw_only=True)
class CameraFit(_Fit):
    """Least-squares fit of one camera.

    Parameters
    ----------
    intrinsics : array (4 + n,)
        Intrinsic parameters in the order of ``projection.intrinsic_names`` [px, 1, rad].
    poses : array (V, 6)
        Poses from board to camera [rad, m].
    covariance : array (4 + n, 4 + n)
        Covariance of the intrinsic parameters with poses marginalised, for the noise estimated from the residuals.
    noise_px : float
        Standard deviation of one coordinate [px], from residuals and degrees of freedom.
    residuals_px : array (V, 2 N)
        Observed minus fitted [px]; zero where a corner is absent.
    corner_rms_px : float
        Root mean square length of the residual vectors of the corners [px].
    """

    intrinsics: FloatArray


@dataclass(frozen=True, kw_only=True)
class PairFit(_Fit):
    """Least-squares fit of both cameras, their relative pose and all board poses.

    Parameters
    ----------
    shared : array (P,)
        Parameters in the order of ``view_blocks.shared_names`` [px, 1, rad, m].
    poses : array (V, 6)
        Poses from board to left camera [rad, m].
    covariance : array (P, P)
        Covariance of the shared parameters with poses marginalised, for independent corner noise.
    noise_px : float
        Standard deviation of one coordinate [px], from residuals and degrees of freedom.
    residuals_px : array (V, 4 N)
        Observed minus fitted, left corners then right corners [px]; zero where a corner is absent.
    corner_rms_px : float
        Root mean square length of the residual vectors of the corners of both cameras [px].
    """

    shared: FloatArray

    @property
    def baseline(self) -> float:
        """Distance between the camera centres [m]."""
        return float(np.linalg.norm(self.shared[TRANSLATION]))


def fit_camera(
    board: FloatArray,
    image: FloatArray,
    present: BoolArray,
    weights: FloatArray | None = None,
    lens: FreeLens = RADIAL_LENS,
    start: tuple[FloatArray, FloatArray] | None = None,
) -> CameraFit:
    """Fit one camera to a flat board seen in several poses.

    Parameters
    ----------
    board, image : array (V, N, 2)
        Corners on the board [m] and in the image [px].
    present : bool array (V, N)
        Which corners exist.
    weights : array (V, N)
        Weights of the corners, small for outliers; None for equal weights.
    lens
        The lens model to fit.
    start
        Intrinsics (4 + n,) and poses (V, 6) from which to start; None for `first_values`.

    Returns
    -------
    CameraFit
        Maximum likelihood for equal, independent, normal noise of all coordinates.

    Raises
    ------
    NotConvergedError
        The views do not determine the parameters, or the fit does not converge.
    CornerFileError
        The residuals exceed ``RESIDUAL_LIMIT_PX``.
    """
    roots = present if weights is None else np.sqrt(weights)
    first, poses = first_values(board, image, present, lens) if start is None else start
    intrinsics, poses, blocks = _minimise(
        lambda shared, poses: camera_blocks(shared, poses, board, image, roots, lens), first, poses
    )
    corner_rms, noise = _residual_sizes(blocks, int(np.count_nonzero(roots)))
    return CameraFit(
        intrinsics=intrinsics,
        poses=poses,
        covariance=noise**2 * covariance_from_information(marginal_information(blocks), intrinsic_names(lens.free)),
        noise_px=noise,
        residuals_px=camera_blocks(intrinsics, poses, board, image, present, lens).residuals,
        corner_rms_px=corner_rms,
    )


def fit_pair(corners: StereoCorners, left: CameraFit, right: CameraFit) -> PairFit:
    """Fit both cameras, their relative pose and all board poses, starting from the fits of the single cameras.

    Parameters
    ----------
    corners : StereoCorners
        The observed corners.
    left, right : CameraFit
        Fits of the single cameras to the same corners.

    Returns
    -------
    PairFit
        Maximum likelihood for equal, independent, normal noise of all coordinates; ``pair_residual`` tests this
        assumption.

    Raises
    ------
    NotConvergedError
        The fit does not converge.
    CornerFileError
        A view contradicts the others (corners in another order), or the residuals exceed ``RESIDUAL_LIMIT_PX``.
    """
    start = np.concatenate([left.intrinsics, right.intrinsics, _median_relative_pose(corners, left, right)])
    shared, poses, blocks = _minimise(lambda shared, poses: pair_blocks(shared, poses, corners), start, left.poses)
    corner_rms, noise = _residual_sizes(blocks, 2 * corners.corner_count)
    return PairFit(
        shared=shared,
        poses=poses,
        covariance=noise**2
        * covariance_from_information(marginal_information(blocks), shared_names(corners.lens.free)),
        noise_px=noise,
        residuals_px=blocks.residuals,
        corner_rms_px=corner_rms,
    )


def check_rig(fit: PairFit) -> None:
    """Refuse a fitted pair if its right camera is not on the right or not upright, or if its corners have no noise.

    Parameters
    ----------
    fit : PairFit
        The fitted pair.

    Raises
    ------
    CornerFileError
        Left and right columns are exchanged, one camera is above or behind the other, the right picture is rotated by
        more than `LARGEST_ROLL` relative to the left one, or the residuals are rounding errors.
    """
    if fit.noise_px < _ROUNDED_PX:
        raise CornerFileError(
            "the corners fit without any error, so their noise cannot be estimated",
            value=f"{fit.noise_px:.1e} px",
            limit=f">= {_ROUNDED_PX:g} px",
            remedy="add the noise of a corner detector to simulated corners, for example 0.1 px",
        )
    if (turned := abs(roll(rotation_matrix(fit.shared[ROTATION])))) > LARGEST_ROLL:
        raise CornerFileError(
            "the right picture is rotated relative to the left one",
            value=f"{np.degrees(turned):.0f}°",
            limit=f"<= {np.degrees(LARGEST_ROLL):.0f}°",
            remedy="turn it upright; for 180°, replace right_x_px by the width of the picture − 1 − right_x_px, and "
            "right_y_px by its height − 1 − right_y_px",
        )
    right, down, ahead = 1e3 * right_centre(fit.shared)
    place = f"the right camera lies {right:+.1f} mm to the right of the left one"
    if abs(right) < max(abs(down), abs(ahead)):
        raise CornerFileError(
            "the cameras are not side by side",
            value=f"{place}, {down:+.1f} mm below and {ahead:+.1f} mm in front of it",
            limit="mostly to the right",
            remedy="if one is above the other, rotate both pictures by 90°: use y as the new x, the width of the "
            "picture − 1 − x as the new y, and the upper camera as the left one",
        )
    if right <= 0.0:
        raise CornerFileError(
            "the left and right columns are exchanged",
            value=place,
            limit="> 0 mm",
            remedy="exchange the left_ and right_ columns",
        )


def marginal_information(blocks: ViewBlocks) -> FloatArray:
    """Information on the shared parameters for unit noise, with poses marginalised: the Schur complement, shape (P, P).

    S = Σ_v AᵀA − AᵀJ (JᵀJ)⁻¹ JᵀA, computed with an orthonormal basis of each J to avoid cancellation.

    Parameters
    ----------
    blocks : ViewBlocks
        Derivatives at the fit.
    """
    basis = np.linalg.qr(blocks.by_pose)[0]
    free = blocks.by_shared - basis @ (np.swapaxes(basis, -1, -2) @ blocks.by_shared)
    information: FloatArray = np.einsum("vmi,vmj->ij", free, free)
    return information


def _minimise(
    evaluate: Callable[[FloatArray, FloatArray], ViewBlocks], shared: FloatArray, poses: FloatArray
) -> tuple[FloatArray, FloatArray, ViewBlocks]:
    """Least squares over shared parameters and poses by damped Gauss–Newton steps that eliminate poses view by view.

    D. Marquardt, SIAM J. Appl. Math. 11 (1963) 431.
    """
    blocks, damping = evaluate(shared, poses), _FIRST_DAMPING
    cost = float(np.sum(blocks.residuals**2))
    if not np.isfinite(cost):
        raise NotConvergedError(
            "the corners do not look like a board in front of a camera",
            value="no pose of the board from which to start",
            limit="a pose of the board in front of the camera in every view",
            remedy="check the order of the corners, and remove false corners",
        )
    for _ in range(_MOST_EVALUATIONS):
        step, pose_step, expected = _damped_step(blocks, damping)
        try:
            tried = evaluate(shared + step, poses + pose_step)
            tried_cost = float(np.sum(tried.residuals**2))
        except OutOfRangeError:  # a coefficient outside its range
            tried_cost = np.inf
        better = tried_cost <= cost  # False for NaN: a board behind the camera
        if better:
            shared, poses, blocks = shared + step, poses + pose_step, tried
        # Judged by the predicted decrease: at the minimum, rounding decides whether the actual one is positive.
        if expected <= _ROUNDING * cost + _NO_NOISE**2 * blocks.residuals.size:
            return shared, poses, blocks
        cost = tried_cost if better else cost
        damping = max(damping / 10.0, _LEAST_DAMPING) if better else 10.0 * damping
        if damping > _MOST_DAMPING:
            break
    raise NotConvergedError(
        "the bundle adjustment did not converge",
        value=f"{_MOST_EVALUATIONS} evaluations",
        limit="a step that changes the residuals by no more than rounding",
        remedy="check the order of the corners, add views with the board tilted differently, or fit fewer coefficients",
    )


def _damped_step(blocks: ViewBlocks, damping: float) -> tuple[FloatArray, FloatArray, float]:
    """Steps of the shared parameters and of the poses, and the predicted decrease of the sum of squares [px²]."""
    views, _, count = blocks.by_shared.shape
    # Damping as additional rows: normal equations would lose half of the digits.
    root = np.sqrt(damping)
    held = root * np.linalg.norm(blocks.by_pose, axis=1)[:, None] * np.eye(6)
    basis, factor = np.linalg.qr(np.concatenate([blocks.by_pose, held], axis=1))
    table = np.concatenate([blocks.by_shared, blocks.residuals[..., None]], axis=-1)
    table = np.concatenate([table, np.zeros((views, 6, count + 1))], axis=1)
    # What the poses can take up lies along their basis; the rest determines the shared parameters.
    inner = np.swapaxes(basis, -1, -2) @ table
    free = (table - basis @ inner).reshape(-1, count + 1)
    size = np.linalg.norm(blocks.by_shared.reshape(-1, count), axis=0)
    below = np.concatenate([root * np.diag(size), np.zeros((count, 1))], axis=1)
    triangle = triangular_factor(np.concatenate([free, below]))
    # Columns of equal length, so that `rcond` does not depend on units; a parameter without effect gets no step.
    scale = np.where(size > 0.0, size, 1.0)
    step = np.linalg.lstsq(triangle[:count, :count] / scale, triangle[:count, count], rcond=1e-15)[0] / scale
    right = inner[..., count] - inner[..., :count] @ step
    pose_step = np.linalg.solve(factor, right[..., None])[..., 0]
    predicted = np.sum(inner[..., count] ** 2) + np.sum(triangle[:count, count] ** 2)
    return step, pose_step, float(predicted)


def _residual_sizes(blocks: ViewBlocks, corner_count: int) -> tuple[float, float]:
    """Root mean square length per corner, and noise of one coordinate [px]; refuses corners that no camera fits."""
    views, _, count = blocks.by_shared.shape
    square_sum = float(np.sum(blocks.residuals**2))
    freedom = 2 * corner_count - count - 6 * views
    if freedom <= 0:
        raise OutOfRangeError(
            "too few corners for the parameters",
            value=f"{2 * corner_count} coordinates for {count + 6 * views} parameters",
            limit="more coordinates than parameters",
            remedy="add corners or views",
        )
    corner_rms = float(np.sqrt(square_sum / corner_count))
    if corner_rms > RESIDUAL_LIMIT_PX:
        raise CornerFileError(
            "no camera fits the corners",
            value=f"{corner_rms:.3g} px rms",
            limit=f"<= {RESIDUAL_LIMIT_PX:g} px",
            remedy="check for swapped columns, false corners, corners in the wrong order, and a bent board",
        )
    return corner_rms, float(np.sqrt(square_sum / freedom))


def _median_relative_pose(corners: StereoCorners, left: CameraFit, right: CameraFit) -> FloatArray:
    """Relative pose of the cameras in the median view; refuses views that differ too much from it."""
    left_rotation, right_rotation = rotation_matrix(left.poses[:, :3]), rotation_matrix(right.poses[:, :3])
    rotation = right_rotation @ np.swapaxes(left_rotation, -1, -2)
    translation = right.poses[:, 3:] - np.einsum("vij,vj->vi", rotation, left.poses[:, 3:])
    between = np.einsum("vij,wij->vw", rotation, rotation)  # trace of R_vᵀ R_w = 1 + 2 cos angle
    angles = np.arccos(np.clip((between - 1.0) / 2.0, -1.0, 1.0))
    centre = int(np.argmin(np.median(angles, axis=1)))
    stray = np.flatnonzero(angles[centre] > _ROTATION_LIMIT)
    if len(stray):
        raise CornerFileError(
            f"view {', '.join(str(corners.views[row]) for row in stray[:5])} contradicts the others",
            value=f"relative rotation differs by {np.degrees(angles[centre, stray].max()):.3g}°",
            limit=f"<= {np.degrees(_ROTATION_LIMIT):.0f}°",
            remedy="number the corners in the same order in both images, or remove the view",
        )
    return np.concatenate([rotation_vector(rotation[centre]), np.median(translation, axis=0)])

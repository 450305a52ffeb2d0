"""Calibration of a real pair from a corner file: cameras, outliers, bundle adjustment, noise and warp."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from tradestudy.calibration.corners.bundle_adjustment import (
    CameraFit,
    PairFit,
    check_rig,
    fit_camera,
    fit_pair,
)
from tradestudy.calibration.corners.corner_file import MINIMUM_CORNERS, CornerFileError, StereoCorners
from tradestudy.calibration.corners.corner_noise import CornerNoise, equal_noise, estimate_noise, outlier_weights
from tradestudy.calibration.corners.pair_residual import (
    CompressedViews,
    PairResidualFit,
    ViewMeans,
    compress_views,
    fit_pair_residual,
    gyration_radius,
    inverse_information,
    view_means,
)
from tradestudy.calibration.corners.view_blocks import (
    RELATIVE,
    ROTATION,
    both_pictures,
    cameras_of,
    first_values,
    right_centre,
    shared_names,
    state_blocks,
)
from tradestudy.calibration.laplace import covariance_from_information
from tradestudy.calibration.projection import move, project, project_by_points, ray_slopes, rotation_matrix
from tradestudy.cameras.calibrated_pair import PINHOLES, RADIAL, Lenses
from tradestudy.errors import NotConvergedError, OutOfRangeError, TradestudyError
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.optics.triangulation import inverse_depth_on_ray

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
    unexplained = weight * shapes - flat @ (np.linalg.pinv(flat) @ (weight * shapes))
    shown = np.linalg.svd(unexplained.reshape(-1, shapes.shape[-1]), compute_uv=False)
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
    by_left = project_by_points(left, seen_left, lens.model, lens.free)[1]
    by_right = project_by_points(right, seen_right, lens.model, lens.free)[1] @ rotation_matrix(shared[ROTATION])
    shapes = warp_shapes(corners, lever)
    left_rows, right_rows = (np.einsum("vnij,vj,vne->vnie", by, normal, shapes) for by in (by_left, by_right))
    return both_pictures(left_rows, right_rows, corners)


_MOST_WEIGHTINGS = 10
_WEIGHTS_SETTLED = 1e-2
_LEAST_ROUNDS, _MOST_ROUNDS = 2, 10  # noise, fit and warp depend on each other
_NOISE_SETTLED = 0.1  # largest relative change of the noise in the last round
_SWAP_IMPROVEMENT = 0.9  # columns count as swapped if exchanging them lowers the residuals by a tenth


def observe_pair(
    shared: FloatArray, points: FloatArray, lenses: Lenses = PINHOLES, free: Sequence[str] = RADIAL
) -> FloatArray:
    """Image coordinates of points in both cameras.

    Parameters
    ----------
    shared : array (..., P)
        Parameters in the order of ``view_blocks.shared_names`` [px, 1, rad, m].
    points : array (..., N, 3)
        Points in the left camera's frame [m].
    lenses, free
        Lens models, and names of their free coefficients.

    Returns
    -------
    array (..., N, 4)
        Left x, y and right x, y [px]; NaN for points outside the field of that camera.
    """
    of_left, of_right = cameras_of(shared)
    left = project(of_left, points, lenses[0], free)
    right = project(of_right, move(shared[..., RELATIVE], points), lenses[1], free)
    return np.concatenate(np.broadcast_arrays(left, right), axis=-1)


def points_midway(shared: FloatArray, z: FloatArray) -> FloatArray:
    """Points at distances z [m] in the left camera's frame, midway between the cameras and their axes, (D, 3)."""
    axis = rotation_matrix(shared[ROTATION])[2] + np.array([0.0, 0.0, 1.0])  # sum of both axes
    return np.concatenate([0.5 * right_centre(shared)[:2] + z[:, None] * axis[:2] / axis[2], z[:, None]], axis=-1)


def inverse_depth(
    shared: FloatArray, seen: FloatArray, lenses: Lenses = PINHOLES, free: Sequence[str] = RADIAL
) -> FloatArray:
    """Inverse depth of points from the disparity of their coordinates in both images.

    Along the axes of the right camera, the left ray Z d is Z R d; see `inverse_depth_on_ray`. The right y coordinate is
    not used.

    Parameters
    ----------
    shared : array (..., P)
        Parameters in the order of ``view_blocks.shared_names``; draws of a calibration as leading axes.
    seen : array (..., N, 4)
        Left x, y and right x, y [px].
    lenses, free
        Lens models, and names of their free coefficients.

    Returns
    -------
    array (..., N)
        1/Z in the left camera's frame [1/m]; zero or negative (meaning infinity) where the rays do not meet in front of
        the pair.
    """
    of_left, of_right = cameras_of(shared)
    left = ray_slopes(of_left, seen[..., :2], lenses[0], free)
    right = ray_slopes(of_right, seen[..., 2:], lenses[1], free)[..., 0]
    ray = np.concatenate([left, np.ones_like(left[..., :1])], axis=-1)
    turned = ray @ np.swapaxes(rotation_matrix(shared[..., ROTATION]), -1, -2)
    moved_x, moved_z = shared[..., -3, None], shared[..., -1, None]
    return inverse_depth_on_ray(turned[..., 0], turned[..., 2], right, moved_x, moved_z)


@dataclass(frozen=True, kw_only=True)
class RigFit:
    """All stages of fitting a pair to a corner file, before sampling.

    Parameters
    ----------
    corners : StereoCorners
        Observed corners without outliers, with the estimated noise.
    present : bool array (V, N)
        Which corners the file contains.
    weights : array (V, 2, N)
        Weights of the corners of the file in both pictures: 1 for most, 0 for outliers and absent ones.
    left, right : CameraFit
        Each camera fitted separately.
    pair : PairFit
        Both cameras fitted with one relative pose and independent noise.
    means : ViewMeans
        Mean residuals of the views in that fit.
    explained : PairResidualFit
        The pair with a left–right term per view, which is the calibration to use.
    warp : array (3,)
        Warp of the board [m]; see `warp_columns`.
    joint_covariance : array (P + 3, P + 3)
        Covariance of the shared parameters and the warp, for given scales of noise and motion.
    """

    corners: StereoCorners
    present: BoolArray
    weights: FloatArray
    left: CameraFit
    right: CameraFit
    pair: PairFit
    means: ViewMeans
    explained: PairResidualFit
    warp: FloatArray
    joint_covariance: FloatArray

    @property
    def covariance(self) -> FloatArray:
        """Covariance of the shared parameters with the warp of the board marginalised, shape (P, P)."""
        return self.joint_covariance[:-3, :-3]

    @property
    def warp_deviation(self) -> FloatArray:
        """Standard deviation of the warp, shape (3,) [m]."""
        deviation: FloatArray = np.sqrt(np.diag(self.joint_covariance)[-3:])
        return deviation


def fit_rig(corners: StereoCorners) -> RigFit:
    """Fit a pair without outliers, with a left–right term, the noise of the corners, and the warp of the board.

    Corners are weighted, and every view has its own noise; see `CornerNoise`. Covariances are those of generalised
    least squares for this noise. The warp of the board is one of the unknowns: a fixed warp would underestimate the
    depth uncertainty by a tenth at the distances of the board.

    Parameters
    ----------
    corners : StereoCorners
        From ``corners.read_corners``.

    Returns
    -------
    RigFit
        All stages of the fit.

    Raises
    ------
    CornerFileError
        Columns are swapped, left and right are exchanged, a view contradicts the others, the board has only two rows of
        corners, or the corners have no noise.
    NotConvergedError
        The views do not determine the parameters, a coefficient of the lens leaves its range, or noise and warp do not
        settle.
    """
    try:
        return _fitted(corners)
    except OutOfRangeError as error:
        raise NotConvergedError(
            "the corners do not determine the lens model; the fit ended at an impossible value",
            value=f"{error.what}: {error.value}",
            remedy="fit fewer coefficients or another lens model, or add corners near the edges of the picture",
        ) from None


def _fitted(corners: StereoCorners) -> RigFit:
    """All stages of the fit, in order."""
    check_warp_shown(corners)
    sides = [_Side.of(corners, image) for image in (corners.left, corners.right)]
    left, right = (side.fit() for side in sides)
    _check_columns(corners, left, right)
    left, right, weights = _weighted(sides, left, right)
    present, corners = corners.present, _without_outliers(corners, weights)
    pair = fit_pair(corners, left, right)
    check_rig(pair)
    means = view_means(pair, corners)
    explained = fit_pair_residual(pair, corners)
    corners, explained, warp = _with_noise_and_warp(corners, weights, pair, explained)
    names = (*shared_names(corners.lens.free), *WARP_NAMES)
    return RigFit(
        corners=corners,
        present=present,
        weights=weights,
        left=left,
        right=right,
        pair=pair,
        means=means,
        explained=explained,
        warp=warp,
        joint_covariance=covariance_from_information(_with_warp(explained, corners, warp)[0], names),
    )


def _with_noise_and_warp(
    corners: StereoCorners, weights: FloatArray, pair: PairFit, explained: PairResidualFit
) -> tuple[StereoCorners, PairResidualFit, FloatArray]:
    """Corners with noise and warp, the fit to them, and the warp (3,) [m], from rounds until the noise settles.

    As long as a bent board is treated as flat, its warp counts as noise, so that a strong warp takes several rounds.
    """
    warp = np.zeros(3)
    for number in range(_MOST_ROUNDS):
        last = explained.noise_px
        corners = replace(corners, noise=_noise_of(corners, explained, weights))
        explained = fit_pair_residual(pair, corners, explained)
        # Before the warp changes again, so that corners, fit and warp belong together.
        if number >= _LEAST_ROUNDS and abs(explained.noise_px / last - 1.0) < _NOISE_SETTLED:
            return corners, explained, warp
        information, gradient = _with_warp(explained, corners, warp)
        warp = warp + (inverse_information(information) @ gradient)[-3:]
        corners = warped(corners, warp)
    raise NotConvergedError(
        "the noise of the corners and the warp of the board do not settle",
        value=f"{_MOST_ROUNDS} rounds",
        limit=f"rounds that change the noise by less than {100 * _NOISE_SETTLED:.0f} %",
        remedy="use a flatter board, or add views with the board tilted differently",
    )


def _with_warp(fit: PairResidualFit, corners: StereoCorners, warp: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Information and gradient for the shared parameters and the warp."""
    return views_with_warp(fit, corners, warp).information(fit.noise_px, fit.motion_scale)


def _noise_of(corners: StereoCorners, fit: PairResidualFit, weights: FloatArray) -> CornerNoise:
    """The noise of corners relative to a fit, with free pose and motion of every view."""
    as_seen = replace(corners, noise=None)
    residuals, free = state_blocks(fit.shared, fit.states.poses, as_seen, fit.lever)
    return estimate_noise(residuals, free, corners.board, weights * corners.present[:, None], corners.noise)


@dataclass(frozen=True, kw_only=True)
class _Side:
    """The corners that one camera saw, and the values from which its fits start."""

    corners: StereoCorners
    image: FloatArray
    start: tuple[FloatArray, FloatArray]

    @classmethod
    def of(cls, corners: StereoCorners, image: FloatArray) -> _Side:
        start = first_values(corners.board, image, corners.present, corners.lens)
        return cls(corners=corners, image=image, start=start)

    def fit(self, weights: FloatArray | None = None) -> CameraFit:
        """Fit the camera, with weights (V, N) of its corners."""
        corners = self.corners
        return fit_camera(corners.board, self.image, corners.present, weights, corners.lens, self.start)


def _weighted(sides: Sequence[_Side], left: CameraFit, right: CameraFit) -> tuple[CameraFit, CameraFit, FloatArray]:
    """Both cameras, refitted until the weights of the corners, shape (V, 2, N), converge."""
    present = sides[0].corners.present
    weights = np.repeat(present[:, None].astype(np.float64), 2, axis=1)
    for _ in range(_MOST_WEIGHTINGS):
        updated = np.stack([outlier_weights(fit.residuals_px, present) for fit in (left, right)], axis=1)
        if np.max(np.abs(updated - weights)) < _WEIGHTS_SETTLED:
            break
        weights = updated
        left, right = (side.fit(weights[:, k]) for k, side in enumerate(sides))
    return left, right, weights


def _without_outliers(corners: StereoCorners, weights: FloatArray) -> StereoCorners:
    """Corners with nonzero weight in both pictures."""
    if np.all(weights[np.repeat(corners.present[:, None], 2, axis=1)] == 1.0):
        return corners
    present = np.all(weights > 0.0, axis=1)
    if np.any(few := present.sum(axis=1) < MINIMUM_CORNERS):
        view = int(np.argmax(few))
        raise CornerFileError(
            f"view {corners.views[view]} has too few corners that are not outliers",
            value=str(int(present[view].sum())),
            limit=f">= {MINIMUM_CORNERS}",
            remedy="remove the view, or detect its corners again",
        )
    return replace(corners, present=present, noise=equal_noise(weights * present[:, None], corners.board))


def _check_columns(corners: StereoCorners, left: CameraFit, right: CameraFit) -> None:
    """Refuse swapped columns, which also fit nearly parallel cameras, but less well than the correct ones."""
    mixed_left = np.stack([corners.left[..., 0], corners.right[..., 1]], axis=-1)
    mixed_right = np.stack([corners.right[..., 0], corners.left[..., 1]], axis=-1)
    mixed = _rms_or_none(replace(corners, left=mixed_left, right=mixed_right))
    present = float(np.hypot(left.corner_rms_px, right.corner_rms_px))
    if mixed is not None and mixed < _SWAP_IMPROVEMENT * present:
        raise CornerFileError(
            "a pair of columns is swapped between the cameras",
            value=f"{present:.3g} px rms, and {mixed:.3g} px with left_y_px and right_y_px exchanged",
            limit=f"an exchange that lowers the residual by less than {100 * (1 - _SWAP_IMPROVEMENT):.0f} %",
            remedy="exchange left_y_px with right_y_px, or left_x_px with right_x_px",
        )


def _rms_or_none(corners: StereoCorners) -> float | None:
    """Root sum of squares of the residuals of both cameras [px]; None if no camera fits these columns."""
    try:
        sides: list[FloatArray] = [corners.left, corners.right]
        fits = [fit_camera(corners.board, side, corners.present, lens=corners.lens) for side in sides]
    except TradestudyError:  # the exchanged columns fit no camera
        return None
    return float(np.hypot(fits[0].corner_rms_px, fits[1].corner_rms_px))

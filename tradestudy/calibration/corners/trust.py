"""How far to trust a pair fitted to corners, judged by halves of the views, by residuals and by other lens models.

Leave-one-out cross-validation measures support: the pair is fitted to all views but one, and the log likelihood of that
view is computed with its pose and motion integrated out. Everything is linearised about a fit, with the noise and the
left–right term of the fit in use.

All depths are those of points midway between the cameras and between their axes. Inverse depth is linearised about the
fit, with its noise and left–right term.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from tradestudy.calibration.corners.bundle_adjustment import fit_camera, fit_pair
from tradestudy.calibration.corners.pair_residual import (
    CompressedViews,
    ViewStates,
    compress_views,
    fit_pair_residual,
    inverse_information,
)
from tradestudy.calibration.corners.real_rig import RigFit, inverse_depth, observe_pair, points_midway
from tradestudy.calibration.corners.view_blocks import RELATIVE, cameras_of
from tradestudy.calibration.projection import FreeLens
from tradestudy.errors import TradestudyError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.lens_model import Rational
from tradestudy.wording import lens_in_words

EXTENSIONS: Final[Sequence[tuple[str, ...]]] = (("k3",), ("p1", "p2"), ("k3", "p1", "p2"), ("s1", "s2", "s3", "s4"))
"""Additional coefficients of the models with which a rational model is compared."""
_STEP: Final = 1e-2  # standard deviations of a parameter


@dataclass(frozen=True, kw_only=True)
class ComparedLens:
    """Another lens model compared with the one in use.

    Parameters
    ----------
    support, support_deviation
        Log likelihood of the views left out in turn, minus that for the model in use, and its standard error over
        views. If it is well above zero, the corners favour the other model.
    depth_change, depth_change_deviation : array (D,)
        Depth from the other model minus depth from the one in use, for the same pictures [m], and its jackknife
        standard error over views.
    failure
        Why the corners do not fit the other model; all numbers are then NaN.
    """

    support: float
    support_deviation: float
    depth_change: FloatArray
    depth_change_deviation: FloatArray
    failure: str = ""


@dataclass(frozen=True, kw_only=True)
class _LeaveOneOut:
    """A model fitted to all views, and to all but each one: inverse depths (D,) and (V, D), log likelihoods (V,)."""

    inverse: FloatArray
    inverses: FloatArray
    log_likelihoods: FloatArray


def compare_lenses(fit: RigFit, z: FloatArray, others: Sequence[FreeLens]) -> Mapping[str, ComparedLens]:
    """Compare the lens model of a fit with others; keys are their names in reports.

    Parameters
    ----------
    fit
        From `fit_rig`.
    z
        Distances at which depth is compared, midway between the cameras and their axes [m].
    others
        Models to fit; a rational model is also compared with `EXTENSIONS`. A model that cannot be fitted is compared
        by NaN, with the reason.
    """
    explained, lens = fit.explained, fit.corners.lens
    images = _images(fit, z)
    in_use = _leave_one_out(fit, lens, explained.shared, explained.states, explained.lever, images)
    compared = {}
    for names in EXTENSIONS if isinstance(lens.model, Rational) else ():
        if more := tuple(name for name in names if name not in lens.free):
            wider = FreeLens(model=lens.model, free=(*lens.free, *more))
            # The additional coefficients of both cameras start at their values in the model.
            added, (left, right) = [getattr(lens.model, name) for name in more], cameras_of(explained.shared)
            start = np.array([*left, *added, *right, *added, *explained.shared[RELATIVE]])
            extended = _leave_one_out(fit, wider, start, explained.states, explained.lever, images)
            compared[lens_in_words(lens.model.name, wider.free)] = _compared(in_use, extended, z)
    for other_lens in others:
        name = lens_in_words(other_lens.model.name, other_lens.free)
        try:
            compared[name] = _compared(in_use, _fitted(fit, other_lens, images), z)
        except TradestudyError as error:
            nothing = np.full_like(z, np.nan)
            compared[name] = ComparedLens(
                support=np.nan,
                support_deviation=np.nan,
                depth_change=nothing,
                depth_change_deviation=nothing,
                failure=str(error),
            )
    return compared


def _fitted(fit: RigFit, lens: FreeLens, images: FloatArray) -> _LeaveOneOut:
    """Another lens model, fitted anew to the same corners."""
    corners = replace(fit.corners, lens=lens)
    # Single cameras and pair only give the last fit its start, for which equal noise is good enough.
    white = replace(corners, noise=None)
    cameras = [fit_camera(white.board, side, white.present, lens=lens) for side in (white.left, white.right)]
    anew = fit_pair_residual(fit_pair(white, *cameras), corners)
    return _leave_one_out(fit, lens, anew.shared, anew.states, anew.lever, images)


def _images(fit: RigFit, z: FloatArray) -> FloatArray:
    """Image coordinates of points midway between the cameras in both pictures, shape (D, 4) [px]."""
    lens, shared = fit.corners.lens, fit.explained.shared
    return observe_pair(shared, points_midway(shared, z), (lens.model, lens.model), lens.free)


def _inverse_depths(lens: FreeLens, shared: FloatArray, images: FloatArray) -> FloatArray:
    return inverse_depth(shared, images, (lens.model, lens.model), lens.free)


def _slopes(lens: FreeLens, shared: FloatArray, deviation: FloatArray, images: FloatArray) -> FloatArray:
    """Derivatives of inverse depth with respect to the shared parameters, shape (D, P)."""
    step = _STEP * deviation
    up, down = (_inverse_depths(lens, shared + sign * np.diag(step), images) for sign in (1.0, -1.0))
    return np.asarray(((up - down) / (2.0 * step[:, None])).T)


def _leave_one_out(
    fit: RigFit, lens: FreeLens, shared: FloatArray, states: ViewStates, lever: float, images: FloatArray
) -> _LeaveOneOut:
    """Fits to all views, and to all but each one, by linear steps from the given parameters."""
    noise, scale = fit.explained.noise_px, fit.explained.motion_scale
    compressed = compress_views(shared, states, replace(fit.corners, lens=lens), lever)
    information, gradient = compressed.information(noise, scale)
    covariance = inverse_information(information)
    best = shared + covariance @ gradient
    slopes = _slopes(lens, best, np.sqrt(np.diag(covariance)), images)
    inverses, log_likelihoods = [], []
    for view in range(len(states.poses)):
        single = compressed.of(np.array([view]))
        view_information, view_gradient = single.information(noise, scale)
        # Both are sums over views, so that leaving one out takes a subtraction instead of a fit.
        step = inverse_information(information - view_information) @ (gradient - view_gradient)
        inverses.append(slopes @ (shared + step - best))
        log_likelihoods.append(float(single.log_likelihood(shared + step, np.asarray(noise), np.asarray(scale))))
    inverse = _inverse_depths(lens, best, images)
    return _LeaveOneOut(
        inverse=inverse, inverses=inverse + np.array(inverses), log_likelihoods=np.array(log_likelihoods)
    )


def _compared(in_use: _LeaveOneOut, alternative: _LeaveOneOut, z: FloatArray) -> ComparedLens:
    gains = alternative.log_likelihoods - in_use.log_likelihoods
    jackknife = (len(gains) - 1) * np.var(alternative.inverses - in_use.inverses, axis=0)
    return ComparedLens(
        support=float(gains.sum()),
        support_deviation=float(np.sqrt(len(gains)) * np.std(gains, ddof=1)),
        depth_change=1.0 / alternative.inverse - 1.0 / in_use.inverse,
        depth_change_deviation=z**2 * np.sqrt(jackknife),
    )


DISTANCES: Final = (0.3, 0.5, 1.0, 2.0, 5.0)
_HALVES: Final = 200
_CELLS: Final = (8, 6)  # number of cells in the map of residuals, across and down


@dataclass(frozen=True, kw_only=True)
class CalibrationTrust:
    """How far to trust a calibration.

    Parameters
    ----------
    distances : array (D,)
        Distances of the checks [m].
    claimed : array (D,)
        Standard deviation of depth from the covariance of the fit [m].
    halves_difference, halves_claim : array (D,)
        Root mean square difference of depths from random halves of the views, and its expectation ``√(C_A + C_B)`` from
        the covariances of the halves [m], both without the warp of the board, which the halves share.
    halves
        Number of random splits.
    view_rms : array (V, 2)
        Root mean square length of the residuals in each view, left and right [px].
    neighbour_correlation : array (2, 2)
        Correlation of the residuals of neighbours on the board along its rows and columns, left and right.
    residual_map : array (2, 6, 8, 2)
        Mean residuals in cells of the left and right picture (rows, then columns), x and y [px]; NaN in cells without
        corners.
    lenses
        Other lens models, by name.
    """

    distances: FloatArray
    claimed: FloatArray
    halves_difference: FloatArray
    halves_claim: FloatArray
    halves: int
    view_rms: FloatArray
    neighbour_correlation: FloatArray
    residual_map: FloatArray
    lenses: Mapping[str, ComparedLens]

    @property
    def ratio(self) -> FloatArray:
        """Ratio of the differences between halves to their expectation, shape (D,): 1 for a correct covariance."""
        return self.halves_difference / self.halves_claim

    @property
    def good_to(self) -> FloatArray:
        """Standard deviation of depth [m] that the halves support, shape (D,); never below the claimed one."""
        return self.claimed * np.maximum(self.ratio, 1.0)


def examine(
    fit: RigFit,
    pixels: tuple[int, int],
    distances: tuple[float, ...] = DISTANCES,
    others: Sequence[FreeLens] = (),
) -> CalibrationTrust:
    """Examine a fitted pair.

    Parameters
    ----------
    fit
        From `fit_rig`.
    pixels
        Columns and rows of the pictures.
    distances
        Distances at which depth is compared [m].
    others
        Lens models to compare in addition to those always compared.
    """
    z = np.array(distances)
    explained = fit.explained
    compressed = compress_views(explained.shared, explained.states, fit.corners, explained.lever)
    slopes = _slopes(fit.corners.lens, explained.shared, np.sqrt(np.diag(fit.covariance)), _images(fit, z))
    difference, claim = _halves(fit, compressed, slopes)
    return CalibrationTrust(
        distances=z,
        claimed=z**2 * np.sqrt(np.einsum("di,ij,dj->d", slopes, fit.covariance, slopes)),
        halves_difference=z**2 * difference,
        halves_claim=z**2 * claim,
        halves=_HALVES,
        view_rms=np.asarray(np.sqrt(np.nanmean(np.sum(_residuals(fit) ** 2, axis=-1), axis=-1)).T),
        neighbour_correlation=_neighbour_correlation(fit),
        residual_map=_residual_map(fit, pixels),
        lenses=compare_lenses(fit, z, others),
    )


def _halves(fit: RigFit, compressed: CompressedViews, slopes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Root mean square difference of inverse depth between random halves of the views, and its expectation, (D,)."""
    rng = np.random.default_rng(0)
    count = len(fit.corners.views)
    squares, claims = [], []
    for _ in range(_HALVES):
        order = rng.permutation(count)
        steps, variances = [], []
        for views in (order[: count // 2], order[count // 2 :]):
            half = compressed.of(views)
            information, gradient = half.information(fit.explained.noise_px, fit.explained.motion_scale)
            covariance = inverse_information(information)
            steps.append(slopes @ covariance @ gradient)
            variances.append(np.einsum("di,ij,dj->d", slopes, covariance, slopes))
        squares.append((steps[0] - steps[1]) ** 2)
        claims.append(variances[0] + variances[1])
    return np.sqrt(np.mean(squares, axis=0)), np.sqrt(np.mean(claims, axis=0))


def _residuals(fit: RigFit) -> FloatArray:
    """Residuals of the cameras fitted separately [px], shape (2, V, N, 2); NaN where a corner does not count."""
    present = fit.corners.present
    residuals = np.stack([camera_fit.residuals_px.reshape(*present.shape, 2) for camera_fit in (fit.left, fit.right)])
    return np.where(present[None, ..., None], residuals, np.nan)


def _residual_map(fit: RigFit, pixels: tuple[int, int]) -> FloatArray:
    cells, size = np.array(_CELLS), np.array(pixels)
    sums, counts = np.zeros((2, cells[1], cells[0], 2)), np.zeros((2, cells[1], cells[0], 1))
    for side, image in enumerate((fit.corners.left, fit.corners.right)):
        present = fit.corners.present
        column, row = np.clip(image[present] / size * cells, 0, cells - 1).astype(int).T
        np.add.at(sums, (side, row, column), _residuals(fit)[side][present])
        np.add.at(counts, (side, row, column), 1.0)
    return np.asarray(np.where(counts > 0.0, sums / np.maximum(counts, 1.0), np.nan))


def _neighbour_correlation(fit: RigFit) -> FloatArray:
    """Mean product of neighbouring residuals divided by their mean square, along board x and y, shape (2 sides, 2)."""
    residuals, board = _residuals(fit), fit.corners.board
    apart = board[:, None] - board[:, :, None]
    present = fit.corners.present
    pairs = present[:, None] & present[:, :, None]
    length = np.where(pairs, np.linalg.norm(apart, axis=-1), np.inf)
    length = np.where(length > 0.0, length, np.inf)
    nearest = 1.2 * length.min(axis=(1, 2), keepdims=True)
    products = np.nan_to_num(np.einsum("svnk,svmk->svnm", residuals, residuals)) / 2.0
    correlations = []
    for along in (0, 1):
        neighbours = (length < nearest) & (np.abs(apart[..., along]) > 0.7 * length)
        mean = np.sum(products * neighbours, axis=(1, 2, 3)) / max(int(neighbours.sum()), 1)
        correlations.append(mean / (np.nanmean(residuals**2, axis=(1, 2, 3))))
    return np.stack(correlations, axis=-1)

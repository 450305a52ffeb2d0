"""How far to trust a pair fitted to corners, judged by halves of the views, by residuals and by other lens models.

All depths are those of points midway between the cameras and between their axes. Inverse depth is linearised about the
fit, with its noise and left–right term.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from tradestudy.calibration.corners.lens_comparison import ComparedLens, compare_lenses, compressed_fit, depth_slopes
from tradestudy.calibration.corners.marginal_views import CompressedViews
from tradestudy.calibration.corners.pair_residual import inverse_information
from tradestudy.calibration.corners.real_rig import RigFit
from tradestudy.calibration.projection import FreeLens
from tradestudy.optics.arrays import FloatArray

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
    compressed = compressed_fit(fit)
    slopes = depth_slopes(fit, z)
    difference, claim = _halves(fit, compressed, slopes)
    return CalibrationTrust(
        distances=z,
        claimed=z**2 * np.sqrt(np.einsum("di,ij,dj->d", slopes, fit.covariance, slopes)),
        halves_difference=z**2 * difference,
        halves_claim=z**2 * claim,
        halves=_HALVES,
        view_rms=_view_rms(fit),
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
    both = np.stack([one.residuals_px.reshape(*present.shape, 2) for one in (fit.left, fit.right)])
    return np.where(present[None, ..., None], both, np.nan)


def _residual_map(fit: RigFit, pixels: tuple[int, int]) -> FloatArray:
    cells, size = np.array(_CELLS), np.array(pixels)
    sums, counts = np.zeros((2, cells[1], cells[0], 2)), np.zeros((2, cells[1], cells[0], 1))
    for side, image in enumerate((fit.corners.left, fit.corners.right)):
        there = fit.corners.present
        column, row = np.clip(image[there] / size * cells, 0, cells - 1).astype(int).T
        np.add.at(sums, (side, row, column), _residuals(fit)[side][there])
        np.add.at(counts, (side, row, column), 1.0)
    return np.asarray(np.where(counts > 0.0, sums / np.maximum(counts, 1.0), np.nan))


def _view_rms(fit: RigFit) -> FloatArray:
    return np.asarray(np.sqrt(np.nanmean(np.sum(_residuals(fit) ** 2, axis=-1), axis=-1)).T)


def _neighbour_correlation(fit: RigFit) -> FloatArray:
    """Mean product of neighbouring residuals divided by their mean square, along board x and y, shape (2 sides, 2)."""
    residuals, board = _residuals(fit), fit.corners.board
    apart = board[:, None] - board[:, :, None]
    there = fit.corners.present
    both = there[:, None] & there[:, :, None]
    length = np.where(both, np.linalg.norm(apart, axis=-1), np.inf)
    length = np.where(length > 0.0, length, np.inf)
    nearest = 1.2 * length.min(axis=(1, 2), keepdims=True)
    products = np.nan_to_num(np.einsum("svnk,svmk->svnm", residuals, residuals)) / 2.0
    found = []
    for along in (0, 1):
        neighbours = (length < nearest) & (np.abs(apart[..., along]) > 0.7 * length)
        mean = np.sum(products * neighbours, axis=(1, 2, 3)) / max(int(neighbours.sum()), 1)
        found.append(mean / (np.nanmean(residuals**2, axis=(1, 2, 3))))
    return np.stack(found, axis=-1)

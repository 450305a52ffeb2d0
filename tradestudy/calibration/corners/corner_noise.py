"""The noise of corners: its standard deviation per view, its correlation between neighbours, and outliers.

Errors of a corner detector are correlated between neighbours (blur, shading, residual distortion) and larger in some
views than in others. A fit that treats them as independent and equal is overconfident.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from tradestudy.calibration.corners.triangular_factor import triangular_factor
from tradestudy.optics.arrays import BoolArray, FloatArray, IndexArray

FULL_WEIGHT: Final = 3.5
"""Robust standard deviations up to which a corner counts fully."""
ZERO_WEIGHT: Final = 10.0
"""Robust standard deviations from which on a corner does not count at all."""
_HALF_WAY: Final = 6.0
_LEAST_DEVIATION: Final = 1e-6  # px, for pictures without noise
_RAYLEIGH_MEDIAN: Final = float(
    np.sqrt(2.0 * np.log(2.0))
)  # median length of a vector whose components have unit standard deviation
_MOST_VIEWS: Final = 60
_LEAST_INDEPENDENT: Final = 1e-3  # share of independent noise that keeps the covariance regular


@dataclass(frozen=True, kw_only=True)
class CornerNoise:
    """Covariance of the noise of the corners of a pair.

    In each view, camera and coordinate, the covariance of corners at a distance d on the board is
    ``σ_v² (a/(1 + d²/ℓ²) + (1 − a) δ/w)``, with w the weight of a corner. Its long tail is deliberate: for a measured
    rig, a Gaussian fits the residuals slightly better, but depths from random halves of the views then differ by 1.27
    times their stated uncertainty; with the long tail, by 1.16 times.

    Parameters
    ----------
    share
        Share a of the variance that is correlated between neighbours [1].
    length
        Correlation length ℓ [m].
    deviation : array (V,)
        Standard deviations σ_v [px].
    weights : array (V, 2, N)
        Weights of the corners in the left and right picture [1]; zero where absent.
    whitening : array (V, 2, N, N)
        Lower triangular matrices that make the noise of the coordinates independent, with the root mean square of σ_v
        as standard deviation.
    """

    share: float
    length: float
    deviation: FloatArray
    weights: FloatArray
    whitening: FloatArray

    def whiten(self, values: FloatArray) -> FloatArray:
        """Whitened residuals (V, 4 N) or derivatives of residuals (V, 4 N, P), left corners then right corners."""
        views, _, corners, _ = self.whitening.shape
        shaped = values.reshape(views, 2, corners, -1)
        whitened: FloatArray = (self.whitening @ shaped).reshape(values.shape)
        return whitened


def equal_noise(weights: FloatArray, board: FloatArray) -> CornerNoise:
    """Independent noise that is equal except for the weights (V, 2, N)."""
    return _noise(board, weights, share=0.0, length=1.0, deviation=np.ones(len(board)))


def outlier_weights(residuals: FloatArray, present: BoolArray) -> FloatArray:
    """Weights of the corners of one camera, shape (V, N), from the lengths of their residual vectors.

    A weight is 1 up to `FULL_WEIGHT` robust standard deviations of the view, and falls to 0 at `ZERO_WEIGHT`.

    Parameters
    ----------
    residuals : array (V, 2 N)
        Observed minus fitted [px].
    present : bool array (V, N)
        Which corners exist; the others get weight zero.

    Notes
    -----
    F. R. Hampel, J. Am. Stat. Assoc. 69 (1974) 383; the standard deviation of a view follows from its median length.
    """
    length = np.linalg.norm(residuals.reshape(*present.shape, 2), axis=-1)
    median = np.nanmedian(np.where(present, length, np.nan), axis=1, keepdims=True)
    size = length / np.maximum(median / _RAYLEIGH_MEDIAN, _LEAST_DEVIATION)
    safe = np.maximum(size, FULL_WEIGHT)
    fall = np.clip((ZERO_WEIGHT - size) / (ZERO_WEIGHT - _HALF_WAY), 0.0, 1.0)
    return np.where(present, FULL_WEIGHT / safe * fall, 0.0)


def estimate_noise(residuals: FloatArray, by_view: FloatArray, board: FloatArray, weights: FloatArray) -> CornerNoise:
    """Estimate share, length and deviations by restricted maximum likelihood, with free pose and motion of every view.

    Parameters
    ----------
    residuals : array (V, 4 N)
        Observed minus fitted [px], from a fit with equal noise.
    by_view : array (V, 4 N, 12)
        Derivatives with respect to pose and motion.
    board : array (V, N, 2)
        Corners on the board [m].
    weights : array (V, 2, N)
        Zero where absent.

    Notes
    -----
    D. Harville, J. Am. Stat. Assoc. 72 (1977) 320, with the shared parameters fixed at their fitted values. Share
    and length are estimated from at most sixty evenly spaced views.
    """
    from scipy.optimize import minimize  # slow to import; only corners need it

    some = np.unique(np.linspace(0, len(board) - 1, min(len(board), _MOST_VIEWS)).astype(int))
    spacing = _spacing(board, weights)
    layouts = _Layouts.of(board[some], weights[some])
    table = np.concatenate([by_view, residuals[..., None]], axis=-1)

    def cost(place: FloatArray) -> float:
        share, length = _share_and_length(place, spacing)
        return -_restricted(table[some], weights[some], layouts.whitening(share, length))[0]

    simplex = np.array([[0.0, np.log(1.5)], [1.5, np.log(1.5)], [0.0, np.log(3.0)]])
    found = minimize(
        cost,
        np.zeros(2),
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "xatol": 0.03, "fatol": 0.1, "maxiter": 100},
    )
    share, length = _share_and_length(found.x, spacing)
    _, deviation = _restricted(table, weights, _Layouts.of(board, weights).whitening(share, length))
    return _noise(board, weights, share=share, length=length, deviation=deviation)


def _share_and_length(place: FloatArray, spacing: float) -> tuple[float, float]:
    """Share between 0 and nearly 1, and length between 0.3 and 10 corner spacings, from unbounded parameters."""
    share = (1.0 - _LEAST_INDEPENDENT) / (1.0 + np.exp(-place[0]))
    return float(share), float(spacing * np.exp(np.clip(place[1], np.log(0.3), np.log(10.0))))


def _spacing(board: FloatArray, weights: FloatArray) -> float:
    """Median distance from a corner to its nearest neighbour [m], in the view with the most corners."""
    view = int(np.argmax((weights[:, 0] > 0.0).sum(axis=1)))
    corners = board[view, weights[view, 0] > 0.0]
    apart = np.linalg.norm(corners[:, None] - corners[None], axis=-1) + np.diag(np.full(len(corners), np.inf))
    return float(np.median(apart.min(axis=1)))


def _restricted(table: FloatArray, weights: FloatArray, whitening: FloatArray) -> tuple[float, FloatArray]:
    """Restricted log likelihood, maximised over the deviations of the views, and these deviations (V,) [px]."""
    views, _, corners, _ = whitening.shape
    whitened = (whitening @ table.reshape(views, 2, corners, -1)).reshape(table.shape)
    triangle = triangular_factor(whitened)
    free = table.shape[-1] - 1
    count = 2 * np.count_nonzero(weights, axis=(1, 2)) - free
    deviation = np.maximum(np.abs(triangle[:, free, free]) / np.sqrt(count), _LEAST_DEVIATION)
    determinants = np.log(np.diagonal(whitening, axis1=-2, axis2=-1)).sum() * 2.0
    volumes = np.log(np.abs(np.diagonal(triangle[:, :free, :free], axis1=-2, axis2=-1))).sum()
    return float(determinants - volumes - np.sum(count * np.log(deviation))), deviation


@dataclass(frozen=True, kw_only=True)
class _Layouts:
    """The different sets of corners and weights in pictures of a board; most views see all corners equally well.

    Parameters
    ----------
    square : array (L, N, N)
        Squared distances of the corners on the board [m²].
    weights : array (L, N)
        Weights of the corners; zero where absent.
    number : int array (V, 2)
        Number of the layout of every view in both cameras.
    """

    square: FloatArray
    weights: FloatArray
    number: IndexArray

    @classmethod
    def of(cls, board: FloatArray, weights: FloatArray) -> _Layouts:
        """Collect the layouts of boards (V, N, 2) [m] and weights (V, 2, N)."""
        views, _, corners = weights.shape
        seen = np.concatenate([np.repeat(board.reshape(views, 1, -1), 2, axis=1), weights], axis=-1)
        found, number = np.unique(seen.reshape(2 * views, -1), axis=0, return_inverse=True)
        own = found[:, : 2 * corners].reshape(-1, corners, 2)
        return cls(
            square=np.sum((own[:, :, None] - own[:, None]) ** 2, axis=-1),
            weights=found[:, 2 * corners :],
            number=number.reshape(views, 2),
        )

    def whitening(self, share: float, length: float) -> FloatArray:
        """Inverse Cholesky factors for unit deviation, shape (V, 2, N, N); identity where a corner is absent."""
        from scipy.linalg.lapack import dtrtri  # slow to import; only corners need it

        there = self.weights > 0.0
        both = there[:, :, None] & there[:, None]
        matrix = np.where(both, share / (1.0 + self.square / length**2), 0.0)
        own = np.where(there, (1.0 - share) / np.where(there, self.weights, 1.0), 1.0)
        corners = np.arange(there.shape[1])
        matrix[:, corners, corners] += own
        # LAPACK inverts a triangular matrix in a third of the time of numpy's general inverse.
        inverse = [dtrtri(factor.T)[0].T for factor in np.linalg.cholesky(matrix)]
        return np.stack(inverse)[self.number]


def _noise(
    board: FloatArray, weights: FloatArray, *, share: float, length: float, deviation: FloatArray
) -> CornerNoise:
    typical = np.sqrt(np.mean(deviation**2)) / deviation
    return CornerNoise(
        share=share,
        length=length,
        deviation=deviation,
        weights=weights,
        whitening=_Layouts.of(board, weights).whitening(share, length) * typical[:, None, None, None],
    )

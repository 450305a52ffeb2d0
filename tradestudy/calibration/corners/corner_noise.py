"""The noise of corners: its standard deviation per view, its correlation between neighbours, and outliers.

Whitened residuals e = M y are free of the fitted parameters: ``M = I − Q Qᵀ``, with Q an orthonormal basis of the
whitened derivatives. If a parameter of the noise changes the whitened covariance by B, then

    ∂ℓ/∂θᵢ = −½ (tr(M Bᵢ) − eᵀ Bᵢ e),    average information Iᵢⱼ = ½ eᵀ Bᵢ M Bⱼ e.

References
----------
A. R. Gilmour, R. Thompson, B. R. Cullis, "Average information REML: an efficient algorithm for variance parameter
estimation in linear mixed models", Biometrics 51 (1995) 1440.

Errors of a corner detector are correlated between neighbours (blur, shading, residual distortion) and larger in some
views than in others. A fit that treats them as independent and equal is overconfident.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from tradestudy.calibration.laplace import triangular_factor
from tradestudy.errors import NotConvergedError
from tradestudy.optics.arrays import BoolArray, FloatArray, IndexArray

_MOST_STEPS: Final = 100
_LONGEST_STEP: Final = 1.0
_LEAST_DAMPING: Final = 1e-12


@dataclass(frozen=True, kw_only=True)
class LocalLikelihood:
    """A log likelihood at one place.

    Parameters
    ----------
    value : float
        Log likelihood.
    gradient : array (K,)
        Its first derivatives.
    information : array (K, K)
        Estimate of its negative second derivatives, positive semidefinite.
    """

    value: float
    gradient: FloatArray
    information: FloatArray


def average_information(basis: FloatArray, changed: FloatArray) -> FloatArray:
    """Sum of ½ eᵀ Bᵢ M Bⱼ e over views, for orthonormal bases Q (V, R, P) and changed residuals Bᵢ e (K, V, R)."""
    along = (np.swapaxes(basis, -1, -2) @ changed[..., None])[..., 0]
    return np.asarray(0.5 * (np.einsum("ivr,jvr->ij", changed, changed) - np.einsum("ivp,jvp->ij", along, along)))


def maximise(likelihood: Callable[[FloatArray], LocalLikelihood], start: FloatArray, settled: float) -> FloatArray:
    """The place of the largest likelihood, by steps of ``information⁻¹ gradient``, halved until the likelihood grows.

    Parameters
    ----------
    likelihood
        Log likelihood at a place (K,) of unbounded parameters on a scale of about 1.
    start : array (K,)
        The place from which to start.
    settled
        Predicted gain of the log likelihood below which a place counts as the maximum.

    Raises
    ------
    NotConvergedError
        No maximum is found.
    """
    place, current = start, likelihood(start)
    information = current.information
    for _ in range(_MOST_STEPS if np.isfinite([current.value, *current.gradient]).all() else 0):
        step = _short_step(information, current.gradient)
        while (gain := 0.5 * float(step @ current.gradient)) > settled:
            trial = likelihood(place + step)
            if trial.value >= current.value:
                break
            step = 0.5 * step
        # Also if no shorter step raises the likelihood: what is left to gain is then too little to matter.
        if not gain > settled:
            return place
        information = _agreeing(trial.information, step, current.gradient - trial.gradient)
        place, current = place + step, trial
    raise NotConvergedError(
        "the scales of the corners' noise do not settle",
        value=f"{_MOST_STEPS} steps",
        limit=f"a step that raises the log likelihood by less than {settled:g}",
        remedy="remove views that contradict the others",
    )


def _short_step(information: FloatArray, gradient: FloatArray) -> FloatArray:
    """The step to the maximum, damped where the likelihood is too flat to locate it (a scale close to zero)."""
    damping = _LEAST_DAMPING
    while True:
        step = np.linalg.solve(information + damping * np.eye(gradient.size), gradient)
        if np.max(np.abs(step)) <= _LONGEST_STEP:
            return np.asarray(step)
        damping *= 10.0


def _agreeing(information: FloatArray, step: FloatArray, decrease: FloatArray) -> FloatArray:
    """The information, corrected to explain by how much the gradient decreased over the last step (the BFGS rule)."""
    along = information @ step
    if not (decrease @ step > 0.0 and along @ step > 0.0):
        return information
    return np.asarray(
        information - np.outer(along, along) / (along @ step) + np.outer(decrease, decrease) / (decrease @ step)
    )


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
_SETTLED: Final = 1e-3  # gain of the log likelihood: a twentieth of a standard deviation of share and length
# Share of the correlated noise, and logarithm of its length in corner spacings; some independent noise keeps the
# covariance regular.
_LOW: Final = np.array([0.0, np.log(0.3)])
_HIGH: Final = np.array([1.0 - 1e-3, np.log(10.0)])
_NEAR_THE_ENDS: Final = 0.08


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
        return _whitened(values, self.whitening)


def equal_noise(weights: FloatArray, board: FloatArray) -> CornerNoise:
    """Independent noise that is equal except for the weights (V, 2, N)."""
    whitening = _Layouts.of(board, weights).of_views(0.0, 1.0)
    return _noise(whitening, weights, share=0.0, length=1.0, deviation=np.ones(len(board)))


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


def estimate_noise(
    residuals: FloatArray, by_view: FloatArray, board: FloatArray, weights: FloatArray, start: CornerNoise | None = None
) -> CornerNoise:
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
    start
        An earlier estimate from which to start.

    Notes
    -----
    D. Harville, J. Am. Stat. Assoc. 72 (1977) 320, with the shared parameters fixed at their fitted values. Share
    and length are estimated from at most sixty evenly spaced views.
    """
    some = np.unique(np.linspace(0, len(board) - 1, min(len(board), _MOST_VIEWS)).astype(int))
    # Median distance from a corner to its nearest neighbour, in the view with the most corners.
    view = int(np.argmax((weights[:, 0] > 0.0).sum(axis=1)))
    corners = board[view, weights[view, 0] > 0.0]
    apart = np.linalg.norm(corners[:, None] - corners[None], axis=-1) + np.diag(np.full(len(corners), np.inf))
    spacing = float(np.median(apart.min(axis=1)))
    layouts = _Layouts.of(board[some], weights[some])
    table = np.concatenate([by_view, residuals[..., None]], axis=-1)

    def likelihood(place: FloatArray) -> LocalLikelihood:
        return _local_likelihood(table[some], weights[some], layouts, _Correlation.at(place, spacing))

    first = np.zeros(2) if start is None or not start.share else _place(start, spacing)
    correlation = _Correlation.at(maximise(likelihood, first, _SETTLED), spacing)
    whitening = _Layouts.of(board, weights).of_views(correlation.share, correlation.length)
    lengths = np.abs(triangular_factor(_whitened(table, whitening))[:, -1, -1])
    return _noise(
        whitening, weights, share=correlation.share, length=correlation.length,
        deviation=_deviations(lengths, weights, by_view.shape[-1]),
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class _Correlation:
    """Share and length of the correlation, and their derivatives by unbounded parameters.

    Parameters
    ----------
    share, length
        As in `CornerNoise`.
    by_place
        Derivatives of the share and of the logarithm of the length, each by its own parameter.
    """

    share: float
    length: float
    by_place: FloatArray

    @classmethod
    def at(cls, place: FloatArray, spacing: float) -> _Correlation:
        """Share between 0 and nearly 1, and length between 0.3 and 10 corner spacings [m], from parameters (2,)."""
        inside = 1.0 / (1.0 + np.exp(-place))
        share, log_length = _LOW + (_HIGH - _LOW) * inside
        return cls(
            share=float(share),
            length=spacing * float(np.exp(log_length)),
            by_place=(_HIGH - _LOW) * inside * (1.0 - inside),
        )


def _place(noise: CornerNoise, spacing: float) -> FloatArray:
    """The unbounded parameters of an estimate, kept away from the ends, where no slope would lead back."""
    inside = (np.array([noise.share, np.log(noise.length / spacing)]) - _LOW) / (_HIGH - _LOW)
    inside = np.clip(inside, _NEAR_THE_ENDS, 1.0 - _NEAR_THE_ENDS)
    return np.asarray(np.log(inside / (1.0 - inside)))


def _local_likelihood(
    table: FloatArray, weights: FloatArray, layouts: _Layouts, correlation: _Correlation
) -> LocalLikelihood:
    """Restricted log likelihood, maximised over the deviations of the views, with derivatives by the correlation."""
    of_layouts = layouts.whitening(correlation.share, correlation.length)
    whitened = _whitened(table, of_layouts[layouts.number])
    basis, triangle = np.linalg.qr(whitened[..., :-1])
    residual = whitened[..., -1] - np.einsum("vrp,vp->vr", basis, np.einsum("vrp,vr->vp", basis, whitened[..., -1]))
    deviation = _deviations(np.linalg.norm(residual, axis=-1), weights, basis.shape[-1])
    residual = residual / deviation[:, None]
    changes = layouts.changes(correlation)
    changes = of_layouts @ changes @ np.swapaxes(of_layouts, -1, -2)
    # twice, because both coordinates of a corner are alike
    traces = 2.0 * np.trace(changes, axis1=-2, axis2=-1)[:, layouts.number].sum(axis=(-2, -1))
    columns = np.concatenate([basis, residual[..., None]], axis=-1)
    changed = np.stack([_whitened(columns, change[layouts.number]) for change in changes])
    free = traces - np.einsum("vrp,ivrp->i", basis, changed[..., :-1])
    count = _freedom(weights, basis.shape[-1])
    # Beside a fitted deviation, a change along the residuals themselves tells nothing.
    explained = np.concatenate([basis, (residual / np.sqrt(count)[:, None])[..., None]], axis=-1)
    volume = np.log(np.abs(np.diagonal(triangle, axis1=-2, axis2=-1))).sum()
    determinants = 2.0 * np.log(np.diagonal(of_layouts[layouts.number], axis1=-2, axis2=-1)).sum()
    return LocalLikelihood(
        value=float(determinants - volume - np.sum(count * np.log(deviation))),
        gradient=-0.5 * (free - np.einsum("vr,ivr->i", residual, changed[..., -1])),
        information=average_information(explained, changed[..., -1]),
    )


def _whitened(table: FloatArray, whitening: FloatArray) -> FloatArray:
    """Whitened rows (V, 4 N, P), for matrices (V, 2, N, N)."""
    views, _, corners, _ = whitening.shape
    return np.asarray((whitening @ table.reshape(views, 2, corners, -1)).reshape(table.shape))


def _freedom(weights: FloatArray, free: int) -> IndexArray:
    """Degrees of freedom of every view."""
    return np.asarray(2 * np.count_nonzero(weights, axis=(1, 2)) - free)


def _deviations(lengths: FloatArray, weights: FloatArray, free: int) -> FloatArray:
    """Standard deviations of the views [px], from the lengths of their whitened residuals after a fit."""
    return np.asarray(np.maximum(lengths / np.sqrt(_freedom(weights, free)), _LEAST_DEVIATION))


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
        rows = np.concatenate([np.repeat(board.reshape(views, 1, -1), 2, axis=1), weights], axis=-1)
        distinct, number = np.unique(rows.reshape(2 * views, -1), axis=0, return_inverse=True)
        positions = distinct[:, : 2 * corners].reshape(-1, corners, 2)
        return cls(
            square=np.sum((positions[:, :, None] - positions[:, None]) ** 2, axis=-1),
            weights=distinct[:, 2 * corners :],
            number=number.reshape(views, 2),
        )

    def whitening(self, share: float, length: float) -> FloatArray:
        """Inverse Cholesky factors for unit deviation, shape (L, N, N); identity where a corner is absent."""
        independent = np.where(self._present, (1.0 - share) / self._safe, 1.0)
        return np.tril(np.linalg.inv(np.linalg.cholesky(share * self._fall(length) + _diagonal(independent))))

    def of_views(self, share: float, length: float) -> FloatArray:
        """Those factors for every view and camera, shape (V, 2, N, N)."""
        return self.whitening(share, length)[self.number]

    def changes(self, correlation: _Correlation) -> FloatArray:
        """Derivatives of the covariances by the parameters of the correlation, shape (2, L, N, N)."""
        fall = self._fall(correlation.length)
        by_share = fall - _diagonal(np.where(self._present, 1.0 / self._safe, 0.0))
        by_length = correlation.share * 2.0 * fall * (1.0 - fall)  # by the logarithm; zero where a corner is absent
        return np.stack([by_share, by_length]) * correlation.by_place[:, None, None, None]

    @property
    def _present(self) -> BoolArray:
        return self.weights > 0.0

    @property
    def _safe(self) -> FloatArray:
        """The weights, with 1 where a corner is absent."""
        return np.where(self._present, self.weights, 1.0)

    def _fall(self, length: float) -> FloatArray:
        """Correlation between corners, 1/(1 + d²/ℓ²); zero where one is absent."""
        pairs = self._present[:, :, None] & self._present[:, None]
        return np.where(pairs, 1.0 / (1.0 + self.square / length**2), 0.0)


def _diagonal(values: FloatArray) -> FloatArray:
    """Diagonal matrices of values (L, N)."""
    return values[..., None] * np.eye(values.shape[-1])


def _noise(
    whitening: FloatArray, weights: FloatArray, *, share: float, length: float, deviation: FloatArray
) -> CornerNoise:
    typical = np.sqrt(np.mean(deviation**2)) / deviation
    return CornerNoise(
        share=share,
        length=length,
        deviation=deviation,
        weights=weights,
        whitening=whitening * typical[:, None, None, None],
    )

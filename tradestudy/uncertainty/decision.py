"""Which decision is best under uncertainty, and what knowing an uncertain parameter is worth to it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from tradestudy.errors import OutOfRangeError
from tradestudy.uncertainty.distributions import FloatArray
from tradestudy.uncertainty.evaluation import Model, Replicate, alignment_with
from tradestudy.uncertainty.outputs import RunningMean
from tradestudy.uncertainty.sources import Sources


@dataclass(frozen=True, kw_only=True, eq=False)
class RankProbability:
    """Which of two cameras errs less, per distance, with Monte Carlo standard errors.

    ``first`` + ``second`` + ``neither`` is one; ``neither`` contains draws in which both fail or both are
    infinite.
    """

    first: FloatArray
    first_error: FloatArray
    second: FloatArray
    neither: FloatArray


def rank_probability(
    first: Model,
    second: Model,
    sources: Sources,
    true_depth: FloatArray,
    *,
    draws: int,
    replicates: int,
    seed: int,
    point: str,
    batch_draws: int = 2**14,
) -> RankProbability:
    """Probability that |depth error| of one camera is smaller than that of the other.

    If only calibration errors are drawn, this is the probability over calibrations. A draw without a result loses
    against one with a result, and an infinite depth against a finite one.

    Parameters
    ----------
    first, second : Model
        Models of inverse depth at the compared distances, outputs (draws, distances).
    sources : Sources
        The sources of both cameras together; a shared source, such as temperature, appears once.
    true_depth : array, shape (distances,)
        True depth [m].
    draws : int
        Draws per replicate, a power of two; both cameras get the same random numbers.
    replicates : int
        Independent replicates, >= 2; their scatter is the Monte Carlo error.
    seed, point
        Seed of the study, >= 0, and identity of the study point.
    batch_draws : int
        Draws per call of a model; does not affect results.

    Raises
    ------
    OutOfRangeError
        A number is outside its range, or a model returns an array of the wrong shape.
    """
    if draws < 2 or draws & (draws - 1) or replicates < 2:
        raise OutOfRangeError(
            "draws and replicates of a comparison",
            value=f"{draws}, {replicates}",
            limit="draws a power of two, replicates >= 2",
            remedy="use a power of two and several replicates, whose scatter gives the error",
        )
    wins, losses = RunningMean(), RunningMean()
    alignment = alignment_with([first, second], sources)
    for number in range(replicates):
        errors = []
        for model in (first, second):
            replicate = Replicate(
                model, sources, seed=seed, point=point, replicate=number,
                alignment=alignment, inverse_depth=True,
            )  # fmt: skip
            replicate.lengthen(draws, batch_draws)
            error = np.abs(replicate.values - np.asarray(true_depth, float)[:, None])
            errors.append(np.where(np.isnan(error), np.inf, error))  # no result loses against any
        mine, theirs = errors
        wins.add(np.mean(mine < theirs, axis=-1))
        losses.add(np.mean(theirs < mine, axis=-1))
    return RankProbability(
        first=wins.mean,
        first_error=wins.standard_error,
        second=losses.mean,
        neither=1.0 - wins.mean - losses.mean,
    )


_FEWEST: Final = 32  # number of draws
_INTERVALS: Final = (1, 2, 4)  # of cubic splines; generalised cross-validation selects the best
_DEGREE: Final = 3
_FEW_CHOICES: Final = 8
_RESAMPLED: Final = 400  # number of equally plausible fits


@dataclass(frozen=True, kw_only=True)
class Worth:
    """Average gain from additional knowledge before a decision.

    Parameters
    ----------
    value
        Expected gain of utility, corrected for its upward bias; at least 0.
    error
        Standard error.
    bias
        Upward bias: noise that taking the maximum over decisions turns into gain.
    """

    value: float
    error: float
    bias: float


def worth_of_all(utility: FloatArray) -> Worth:
    """Worth of perfect information, E[max_d U_d] − max_d E[U_d].

    Parameters
    ----------
    utility
        U of every decision in every draw, shape (draws, decisions).

    Raises
    ------
    OutOfRangeError
        There are fewer than 32 draws, or a utility is not finite.
    """
    _require(utility)
    gain = utility.max(axis=1) - utility[:, int(np.argmax(utility.mean(axis=0)))]
    return Worth(value=float(gain.mean()), error=float(gain.std(ddof=1) / math.sqrt(gain.size)), bias=0.0)


def worth_of_one(utility: FloatArray, parameter: FloatArray, rng: np.random.Generator) -> Worth:
    """Worth of partial information, E_φ[max_d E(U_d | φ)] − max_d E[U_d], by regression of the utilities on φ.

    Each E(U_d | φ) is a cubic spline in the ranks of φ, fitted to all draws, or the mean at each value if φ has at most
    eight. Resampled, equally plausible fits show how much noise the maximum turns into gain.

    Parameters
    ----------
    utility
        U of every decision in every draw, shape (draws, decisions).
    parameter
        φ in every draw, shape (draws,).
    rng
        Generator for the resampled fits.

    Raises
    ------
    OutOfRangeError
        As for `worth_of_all`.

    References
    ----------
    M. Strong, J. E. Oakley, A. Brennan, "Estimating multiparameter partial expected value of perfect information from a
    probabilistic sensitivity analysis sample: a nonparametric regression approach", Med. Decis. Making 34, 311 (2014).
    """
    _require(utility)
    best = int(np.argmax(utility.mean(axis=0)))
    # Only differences decide. Relative to the best decision, the scatter that all decisions share cancels.
    incremental = utility - utility[:, [best]]
    basis = _spline_basis(parameter, incremental)
    coefficients, *_ = np.linalg.lstsq(basis, incremental, rcond=None)
    fitted = basis @ coefficients
    raw_gain = _gain(fitted)
    # Residuals of different decisions are correlated; their covariance applies to every coefficient.
    residual = incremental - fitted
    covariance = residual.T @ residual / max(1, len(basis) - basis.shape[1])
    root = _root(np.asarray(np.linalg.pinv(basis.T @ basis), dtype=np.float64))
    across = _root(covariance)
    scatter = basis @ root
    resampled = np.array(
        [
            _gain(fitted + scatter @ rng.standard_normal((scatter.shape[1], across.shape[0])) @ across.T)
            for _ in range(_RESAMPLED)
        ]
    )
    # The maximum of noisy fits is too high. Noise added to the fit raises it about as much as the fit's own noise did.
    bias = max(0.0, float(resampled.mean()) - raw_gain)
    sampling = float((fitted.max(axis=1) - fitted[:, best]).std(ddof=1) / math.sqrt(len(fitted)))
    return Worth(value=max(0.0, raw_gain - bias), error=math.hypot(float(resampled.std(ddof=1)), sampling), bias=bias)


def _gain(fitted: FloatArray) -> float:
    return float(fitted.max(axis=1).mean() - fitted.mean(axis=0).max())


def _root(matrix: FloatArray) -> FloatArray:
    """R with R Rᵀ equal to the matrix, which may be singular."""
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)), dtype=np.float64)


def _spline_basis(parameter: FloatArray, utility: FloatArray) -> FloatArray:
    """Basis of cubic splines in the ranks of a parameter, with the number of intervals that predicts best."""
    ranks = (np.argsort(np.argsort(parameter, kind="stable"), kind="stable") + 0.5) / parameter.size
    choices = np.unique(parameter)
    if choices.size <= _FEW_CHOICES:  # fit the mean at each value
        return np.asarray(parameter[:, np.newaxis] == choices, dtype=np.float64)
    candidates = [_basis(ranks, intervals) for intervals in _INTERVALS]
    return min(candidates, key=lambda basis: _generalised_error(basis, utility))


def _basis(ranks: FloatArray, intervals: int) -> FloatArray:
    from scipy.interpolate import BSpline  # takes longer to load than most studies to check

    knots = np.pad(np.linspace(0.0, 1.0, intervals + 1), _DEGREE, mode="edge")
    return np.asarray(BSpline.design_matrix(ranks, knots, _DEGREE).toarray(), dtype=np.float64)


def _generalised_error(basis: FloatArray, utility: FloatArray) -> float:
    """Mean squared residual divided by (1 − p/n)²: Craven and Wahba's criterion."""
    coefficients, *_ = np.linalg.lstsq(basis, utility, rcond=None)
    n, p = basis.shape
    return float(np.sum((utility - basis @ coefficients) ** 2) / (1.0 - p / n) ** 2)


def _require(utility: FloatArray) -> None:
    if utility.ndim != 2 or len(utility) < _FEWEST or not np.isfinite(utility).all():
        raise OutOfRangeError(
            "utilities of decisions",
            value=f"shape {utility.shape}, {np.count_nonzero(~np.isfinite(utility))} non-finite",
            limit=f"(draws, decisions), at least {_FEWEST} draws, finite",
            remedy="use more draws, and a finite loss where no camera is usable",
        )

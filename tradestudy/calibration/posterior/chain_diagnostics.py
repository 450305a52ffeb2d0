"""Rank-normalised split R-hat and effective sample sizes of ensembles of walkers.

Vehtari, Gelman, Simpson, Carpenter, Bürkner, "Rank-normalization, folding, and localization: an improved R-hat",
Bayesian Analysis 16 (2021) 667. A chain here is a whole ensemble, (steps, walkers): its walkers are merged, because
walkers of one ensemble move along each other's differences and are not independent chains.
"""

from __future__ import annotations

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft
from scipy.special import ndtri

from tradestudy.optics.arrays import FloatArray


def rank_normalised_split_r_hat(chains: FloatArray) -> float:
    """Largest of the bulk and the folded rank-normalised split R-hat of one parameter (eqs. 3, 4, 14).

    Parameters
    ----------
    chains : array (ensembles, steps, walkers)
        Draws; walkers = 1 gives the textbook chain.

    Returns
    -------
    float
        1 for chains that agree; inf for chains each stuck at its own value; NaN for a constant.
    """
    halves = _split(chains)
    folded = np.abs(halves - np.median(halves))
    return max(_r_hat(_rank_normalise(halves)), _r_hat(_rank_normalise(folded)))


def bulk_effective_size(chains: FloatArray) -> float:
    """Independent draws worth of the merged ensembles, for the centre of one parameter's distribution.

    Parameters
    ----------
    chains : array (ensembles, steps, walkers)
        Draws.
    """
    return _effective_size(_rank_normalise(_split(chains)))


def tail_effective_size(chains: FloatArray) -> float:
    """Smaller effective size of the indicators of the 5 % and 95 % quantiles (section 4.3 of the paper).

    Parameters
    ----------
    chains : array (ensembles, steps, walkers)
        Draws.
    """
    halves = _split(chains)
    ends = np.quantile(halves, [0.05, 0.95])
    return min(_effective_size((halves <= end).astype(float)) for end in ends)


def _split(chains: FloatArray) -> FloatArray:
    """Each chain cut in two halves of equal length, shape (2 ensembles, steps // 2, walkers)."""
    half = chains.shape[1] // 2
    return np.concatenate([chains[:, :half], chains[:, -half:]])


def _rank_normalise(chains: FloatArray) -> FloatArray:
    """Normal scores of the ranks over all chains (eq. 14)."""
    from scipy.stats import rankdata  # a second to import, and only chains need it

    ranks = rankdata(chains, axis=None).reshape(chains.shape)
    scores: FloatArray = ndtri((ranks - 0.375) / (chains.size + 0.25))
    return scores


def _r_hat(chains: FloatArray) -> float:
    """Potential scale reduction of merged chains (eqs. 1 to 3)."""
    size = chains[0].size
    within = float(chains.var(axis=(1, 2), ddof=1).mean())
    between = float(chains.mean(axis=(1, 2)).var(ddof=1))
    if within == 0.0:
        return float("inf") if between > 0.0 else float("nan")
    return float(np.sqrt((size - 1.0) / size + between / within))


def _effective_size(chains: FloatArray) -> float:
    """Effective size from the variance of the mean (eqs. 10 to 13), walkers averaged before correlation is measured.

    The mean of all draws is the mean over steps of the walkers' average, whose autocorrelation carries the correlation
    between walkers too. With one walker this is the effective size of the paper.
    """
    count, steps, _ = chains.shape
    single = _pooled_variance(chains.reshape(count, -1))
    series = chains.mean(axis=2)
    if single == 0.0:
        return float("nan")
    pooled = _pooled_variance(series)
    within = series.var(axis=1, ddof=1).mean()
    correlation = 1.0 - (within - _autocovariance(series).mean(axis=0) * steps / (steps - 1.0)) / pooled
    correlation[0] = 1.0
    time = max(_geyer_time(correlation), 1.0 / np.log10(count * steps))
    return float(single / (pooled * time) * count * steps)


def _pooled_variance(chains: FloatArray) -> float:
    """Variance of a draw over all chains, between and within (eq. 2)."""
    size = chains.shape[1]
    within = chains.var(axis=1, ddof=1).mean() * (size - 1.0) / size
    return float(within + chains.mean(axis=1).var(ddof=1))


def _autocovariance(series: FloatArray) -> FloatArray:
    """Autocovariance of each row at all lags, divided by the length."""
    steps = series.shape[1]
    size = next_fast_len(2 * steps)
    spectrum = rfft(series - series.mean(axis=1, keepdims=True), size, axis=1)
    covariance: FloatArray = irfft(np.abs(spectrum) ** 2, size, axis=1)[:, :steps] / steps
    return covariance


def _geyer_time(correlation: FloatArray) -> float:
    """Integrated autocorrelation time by the initial monotone sequence (C. Geyer, Stat. Sci. 7 (1992) 473)."""
    pairs = correlation[: len(correlation) // 2 * 2].reshape(-1, 2).sum(axis=1)
    negative = np.flatnonzero(pairs < 0.0)
    pairs = pairs[: negative[0]] if len(negative) else pairs
    return float(-1.0 + 2.0 * np.minimum.accumulate(pairs).sum())

"""Rank-normalised split R-hat and effective sample sizes of ensembles of walkers.

Vehtari, Gelman, Simpson, Carpenter, Bürkner, "Rank-normalization, folding, and localization: an improved R-hat",
Bayesian Analysis 16 (2021) 667, as ArviZ computes them. Here, a chain is a whole ensemble, (steps, walkers): its
walkers are merged, because walkers of one ensemble move along each other's differences and are not independent chains.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtri

from tradestudy.optics.arrays import FloatArray


def rank_normalised_split_r_hat(chains: FloatArray) -> float:
    """The larger of the bulk and the folded rank-normalised split R-hat of one parameter (eqs. 3, 4, 14).

    Parameters
    ----------
    chains : array (ensembles, steps, walkers)
        Draws; one walker gives an ordinary chain.

    Returns
    -------
    float
        1 for chains that agree; inf if each chain is stuck at its own value; NaN for a constant.
    """
    from arviz_stats.base.array import array_stats

    merged = np.concatenate(_halves(chains), axis=1).reshape(len(chains), -1)
    with np.errstate(divide="ignore", invalid="ignore"):  # chains without any spread
        return float(array_stats.rhat(merged, method="rank"))


def bulk_effective_size(chains: FloatArray) -> float:
    """Effective sample size of the merged ensembles for the centre of one parameter's distribution.

    Parameters
    ----------
    chains : array (ensembles, steps, walkers)
        Draws.
    """
    from scipy.stats import rankdata  # takes a second to import; only chains need it

    halves = np.concatenate(_halves(chains))
    ranks = rankdata(halves, axis=None).reshape(halves.shape)
    return _effective_size(ndtri((ranks - 0.375) / (ranks.size + 0.25)))


def tail_effective_size(chains: FloatArray) -> float:
    """The smaller of the effective sample sizes for the 5 % and 95 % quantiles (section 4.3 of the paper).

    Parameters
    ----------
    chains : array (ensembles, steps, walkers)
        Draws.
    """
    halves = np.concatenate(_halves(chains))
    ends = np.quantile(halves, [0.05, 0.95])
    return min(_effective_size((halves <= end).astype(float)) for end in ends)


def _halves(chains: FloatArray) -> tuple[FloatArray, FloatArray]:
    """First and second half of each chain."""
    half = chains.shape[1] // 2
    return chains[:, :half], chains[:, -half:]


def _effective_size(chains: FloatArray) -> float:
    """Effective sample size of merged chains, from the autocorrelation of the walkers' average.

    This average includes the correlation between walkers; its effective sample size is scaled to the variance of a
    single draw.
    """
    from arviz_stats.base.array import array_stats

    single = _pooled_variance(chains.reshape(len(chains), -1))
    if single == 0.0:
        return float("nan")
    average = chains.mean(axis=2)
    return float(array_stats.ess(average, method="identity")) * single / _pooled_variance(average)


def _pooled_variance(chains: FloatArray) -> float:
    """Variance of a draw over all chains, between and within them (eq. 2)."""
    size = chains.shape[1]
    within = chains.var(axis=1, ddof=1).mean() * (size - 1.0) / size
    return float(within + chains.mean(axis=1).var(ddof=1))

"""Do intervals cover what they claim, and are posteriors calibrated? Exact tests with the multiplicity controlled."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import BoolArray, FloatArray

CoverageTrial = Callable[[np.random.Generator], BoolArray]
"""Draws a truth from the prior, infers it, and says for each interval whether it covers the truth, shape (cells,)."""

IntArray = NDArray[np.int64]

RankTrial = Callable[[np.random.Generator], FloatArray]
"""Draws a truth from the prior, infers it, and returns the share of posterior draws below it, shape (cells,)."""


@dataclass(frozen=True, kw_only=True)
class CoverageVerdict:
    """Coverage of several intervals over many trials.

    Parameters
    ----------
    trials : int
        Independent repeats.
    covered : int array (cells,)
        Repeats in which the interval covered the truth.
    nominal : float
        Coverage claimed.
    p_values : array (cells,)
        Two-sided exact binomial.
    adjusted_p_values : array (cells,)
        After Holm's correction for testing all cells at once.
    level : float
        Probability of any false alarm that is accepted.
    """

    trials: int
    covered: IntArray
    nominal: float
    p_values: FloatArray
    adjusted_p_values: FloatArray
    level: float

    @property
    def passed(self) -> bool:
        """Whether no cell contradicts the claim."""
        return bool(np.all(self.adjusted_p_values >= self.level))


@dataclass(frozen=True, kw_only=True)
class RankVerdict:
    """Uniformity of the truths' ranks in their posteriors.

    Parameters
    ----------
    trials : int
        Independent repeats.
    counts : int array (cells, bins)
        Truths by the bin of their rank.
    p_values : array (cells,)
        Chi-square test of equal bins.
    adjusted_p_values : array (cells,)
        After Holm's correction.
    level : float
        Probability of any false alarm that is accepted.
    """

    trials: int
    counts: IntArray
    p_values: FloatArray
    adjusted_p_values: FloatArray
    level: float

    @property
    def passed(self) -> bool:
        """Whether no cell contradicts uniformity."""
        return bool(np.all(self.adjusted_p_values >= self.level))


def coverage_verdict(covered: BoolArray, *, nominal: float = 0.95, level: float = 0.01) -> CoverageVerdict:
    """Test claimed coverages by exact binomial tests, all cells together at one level.

    Parameters
    ----------
    covered : bool array (trials, cells)
        Whether each interval covered its truth; the trials are independent, the cells need not be.
    nominal : float
        Coverage claimed.
    level : float
        Accepted probability that any right cell is refused.

    Returns
    -------
    CoverageVerdict
        Counts, p values, verdict.

    Notes
    -----
    S. Holm, Scand. J. Stat. 6 (1979) 65: valid whatever the dependence between the cells.
    """
    from scipy.stats import binomtest

    _require_trials(len(covered), 1)
    counts = covered.sum(axis=0)
    distinct, cells = np.unique(counts, return_inverse=True)
    p_values = np.array([binomtest(int(count), len(covered), nominal).pvalue for count in distinct])[cells]
    return CoverageVerdict(
        trials=len(covered),
        covered=counts,
        nominal=nominal,
        p_values=p_values,
        adjusted_p_values=holm(p_values),
        level=level,
    )


def rank_verdict(shares: FloatArray, *, bins: int = 20, level: float = 0.01) -> RankVerdict:
    """Test that truths drawn from the prior rank uniformly among their posterior's draws.

    Parameters
    ----------
    shares : array (trials, cells)
        Share of posterior draws below the truth, in [0, 1].
    bins : int
        Equal bins; at least five trials are needed per bin.
    level : float
        Accepted probability that any right cell is refused.

    Returns
    -------
    RankVerdict
        Counts, p values, verdict.

    Notes
    -----
    Simulation-based calibration: S. Talts et al., arXiv:1804.06788. Thin the draws to independent ones first.
    """
    from scipy.stats import chisquare

    _require_trials(len(shares), 5 * bins)
    index = np.minimum((shares * bins).astype(int), bins - 1)
    counts = np.stack([np.bincount(column, minlength=bins) for column in index.T])
    p_values = np.array([chisquare(row).pvalue for row in counts])
    return RankVerdict(
        trials=len(shares), counts=counts, p_values=p_values, adjusted_p_values=holm(p_values), level=level
    )


def run_trials(trial: Callable[[np.random.Generator], FloatArray | BoolArray], trials: int, seed: int) -> FloatArray:
    """Repeat a trial with independent random streams, so that a repeat can be run again alone.

    Parameters
    ----------
    trial : CoverageTrial or RankTrial
        One repeat.
    trials : int
        How many.
    seed : int
        Zero is a seed like any other; repeat i has the i-th stream spawned from it.

    Returns
    -------
    array (trials, cells)
        What the trials returned.
    """
    _require_trials(trials, 1)
    streams = np.random.SeedSequence(seed).spawn(trials)
    return np.stack([trial(np.random.default_rng(stream)) for stream in streams])


def holm(p_values: FloatArray) -> FloatArray:
    """Holm's step-down adjusted p values, shape (cells,).

    Parameters
    ----------
    p_values : array (cells,)
        Single tests.
    """
    order = np.argsort(p_values)
    steps = np.maximum.accumulate(p_values[order] * np.arange(len(p_values), 0, -1))
    adjusted = np.empty_like(p_values)
    adjusted[order] = np.minimum(steps, 1.0)
    return adjusted


def _require_trials(trials: int, least: int) -> None:
    """Refuse a test that could not refuse anything."""
    if trials < least:
        raise OutOfRangeError(
            "too few trials for the test", value=str(trials), limit=f">= {least}", remedy="repeat more often"
        )

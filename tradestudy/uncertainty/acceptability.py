"""Stochastic multicriteria acceptability: ranks of alternatives for all weights, and weights that favour each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import ndtri

from tradestudy.uncertainty.distributions import FloatArray
from tradestudy.uncertainty.sobol import scrambled_sobol
from tradestudy.uncertainty.streams import point_generator
from tradestudy.uncertainty.value_scale import ValueScale
from tradestudy.uncertainty.weights import WeightSpace

_DRAWS, _SCRAMBLES = 2**11, 16
_EQUAL: Final = 1e-12  # on the scale of values; smaller differences count as ties


@dataclass(frozen=True, kw_only=True)
class Acceptability:
    """Ranks of alternatives for all possible weights.

    Parameters
    ----------
    rank, rank_error
        Share of the weights that give an alternative a rank, b_i^r, and its standard error; shape (alternatives,
        ranks). Tied alternatives share their ranks.
    central, central_error
        Mean of the weights that rank an alternative first, and its standard error; shape (alternatives, criteria).
        NaN if it is never first, or first in too few draws to estimate the error.
    mean
        Mean of all weights.
    draws
        Number of sets of weights.
    """

    rank: FloatArray
    rank_error: FloatArray
    central: FloatArray
    central_error: FloatArray
    mean: FloatArray
    draws: int


def acceptability(
    measured: FloatArray, errors: FloatArray, scales: tuple[ValueScale, ...], weights: WeightSpace, *, seed: int
) -> Acceptability:
    """Rank alternatives by Σ_j w_j v_j(x_ij), over the weights and over the errors of the criteria.

    Parameters
    ----------
    measured, errors
        x_ij and its standard error, shape (alternatives, criteria); errors are normal and independent.
    scales
        Value functions v_j.
    weights
        The possible weights, all equally likely.
    seed
        Seed of the study.

    Returns
    -------
    Acceptability
        Standard errors come from independent scrambles of Sobol points; that of a share is at least one draw. If
        nothing is uncertain, the ranks are exact.

    References
    ----------
    R. Lahdelma, P. Salminen, "SMAA-2: stochastic multicriteria acceptability analysis for group decision making",
    Oper. Res. 49, 444 (2001).
    """
    uncertain = np.argwhere(np.isfinite(measured) & (errors > 0.0))
    dimensions = weights.dimensions + len(uncertain)
    scrambles = list(_scrambles(measured, errors, uncertain, scales, weights, dimensions, seed))
    rank, first, sums, mean, counts = (np.array(part) for part in zip(*scrambles, strict=True))
    draws = int(counts.sum())
    exact = dimensions == 0
    found = rank.mean(axis=0)
    error = np.zeros(found.shape) if exact else np.maximum(_standard_error(rank), 1.0 / draws)
    with np.errstate(invalid="ignore", divide="ignore"):  # an alternative that is never first has no central weights
        central = sums.sum(axis=0) / first.sum(axis=0)[:, np.newaxis]
        residual = (sums - central * first[..., np.newaxis]) / first.mean(axis=0)[:, np.newaxis]
    central_error = np.zeros(central.shape) if exact else _standard_error(residual)
    few = first.sum(axis=0) * _DRAWS < (0.5 if exact else 2.0 * _SCRAMBLES)
    central[few], central_error[few] = np.nan, np.nan
    return Acceptability(
        rank=found,
        rank_error=error,
        central=central,
        central_error=central_error,
        mean=mean.mean(axis=0),
        draws=1 if exact else draws,
    )


def _standard_error(scrambles: FloatArray) -> FloatArray:
    return np.asarray(scrambles.std(axis=0, ddof=1) / np.sqrt(len(scrambles)))


_Scramble = tuple[FloatArray, FloatArray, FloatArray, FloatArray, int]


def _scrambles(
    measured: FloatArray,
    errors: FloatArray,
    uncertain: np.ndarray[tuple[int, ...], np.dtype[np.intp]],
    scales: tuple[ValueScale, ...],
    weights: WeightSpace,
    dimensions: int,
    seed: int,
) -> Iterator[_Scramble]:
    """For each scramble: shares of ranks, shares of first ranks, sums of the weights for these, mean weight, draws."""
    for replicate in range(_SCRAMBLES):
        stream = scrambled_sobol(dimensions, point_generator(seed=seed, point="trade-off", replicate=replicate))
        drawn, others = weights.draw(stream, _DRAWS)
        count = drawn.shape[1]
        values = np.repeat(measured[..., np.newaxis], count, axis=2)
        for (row, column), uniform in zip(uncertain, others, strict=True):
            values[row, column] += errors[row, column] * ndtri(uniform)
        worth = np.stack([scale.value(values[:, j]) for j, scale in enumerate(scales)], axis=1)
        shares = rank_shares(np.einsum("ijk,jk->ki", worth, drawn))
        first = shares[0]
        # Dividing by the draws of each scramble makes scrambles count equally despite a few extra draws.
        sums = np.einsum("ki,jk->ij", first, drawn) / count
        yield (
            np.stack([one.mean(axis=0) for one in shares], axis=1),
            first.mean(axis=0),
            sums,
            drawn.mean(axis=1),
            count,
        )


def rank_shares(worth: FloatArray) -> list[FloatArray]:
    """For each rank, the share of it that every alternative has in every draw: 1 or 0, or a fraction in a tie.

    Parameters
    ----------
    worth
        Larger is better, shape (draws, alternatives).
    """
    order = np.argsort(-worth, axis=1, kind="stable")
    ordered = np.take_along_axis(worth, order, axis=1)
    count = worth.shape[1]
    # Starts of groups of equal worth; alternatives within a group are tied.
    begins = np.ones(worth.shape, dtype=bool)
    begins[:, 1:] = ordered[:, :-1] - ordered[:, 1:] > _EQUAL
    place = np.arange(count)
    start = np.maximum.accumulate(np.where(begins, place, 0), axis=1)
    ends = np.ones(worth.shape, dtype=bool)
    ends[:, :-1] = begins[:, 1:]
    last = np.minimum.accumulate(np.where(ends, place, count)[:, ::-1], axis=1)[:, ::-1]
    back = np.argsort(order, axis=1)
    start, last = (np.take_along_axis(one, back, axis=1) for one in (start, last))
    size = last - start + 1
    return [np.where((start <= rank) & (rank <= last), 1.0 / size, 0.0) for rank in range(count)]

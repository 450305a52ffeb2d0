"""Ranks of alternatives under uncertain weights of criteria (stochastic multicriteria acceptability)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from tradestudy.errors import OutOfRangeError
from tradestudy.uncertainty.distributions import FloatArray
from tradestudy.uncertainty.streams import UniformStream, point_generator, scrambled_sobol

_ROUNDING: Final = 1e-12
_MOST_BATCHES: Final = 1024  # tried to obtain one batch of weights within their ranges


@dataclass(frozen=True, kw_only=True)
class WeightSpace:
    """All weights w ≥ 0 with Σw = 1 that satisfy their ranges and an order.

    Parameters
    ----------
    low, high
        Lower and upper end of the range of each weight; equal for a fixed weight.
    order
        Indices of weights that must not increase along this list; empty for no order. An order requires that every
        range is [0, 1].

    Raises
    ------
    OutOfRangeError
        No weights satisfy the ranges.
    """

    low: tuple[float, ...]
    high: tuple[float, ...]
    order: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if not math.fsum(self.low) <= 1.0 + _ROUNDING or not math.fsum(self.high) >= 1.0 - _ROUNDING:
            raise OutOfRangeError(
                "ranges of weights",
                value=f"minima sum to {math.fsum(self.low):g}, maxima to {math.fsum(self.high):g}",
                limit="minima at most 1, maxima at least 1",
                remedy="widen the ranges",
            )
        if self.order and any((self.low[k], self.high[k]) != (0.0, 1.0) for k in range(len(self.low))):
            raise OutOfRangeError(
                "an order of weights", value="with ranges", limit="without ranges", remedy="remove one of the two"
            )

    @property
    def free(self) -> tuple[int, ...]:
        """Indices of the weights that are not fixed."""
        return tuple(k for k, (low, high) in enumerate(zip(self.low, self.high, strict=True)) if high > low)

    @property
    def dimensions(self) -> int:
        """Number of uniform random numbers that one set of weights needs."""
        return max(len(self.free) - 1, 0)

    def draw(self, stream: UniformStream, count: int) -> tuple[FloatArray, FloatArray]:
        """At least ``count`` sets of weights, uniform on this space, and the remaining coordinates of the stream.

        One of three maps of constant density turns points of the cube into weights: a simplex above the minima, a
        simplex below the maxima, or the box of all ranges but the widest, whichever leaves the fewest weights outside
        the ranges. Weights outside are redrawn.

        Parameters
        ----------
        stream
            Uniform points with `dimensions` coordinates or more; the additional ones are returned with the weights.
        count
            Number of points drawn at a time; a power of two.

        Returns
        -------
        tuple
            Weights, shape (weights, draws), and the additional coordinates, shape (others, draws).

        Raises
        ------
        OutOfRangeError
            Almost no weights lie within the ranges.
        """
        kept: list[tuple[FloatArray, FloatArray]] = []
        for _ in range(_MOST_BATCHES):
            points = stream(count)
            weights = self._weights(points[: self.dimensions])
            inside = self._inside(weights)
            kept.append((weights[:, inside], points[self.dimensions :, inside]))
            if sum(part.shape[1] for part, _ in kept) >= count:
                break
        else:
            accepted = sum(part.shape[1] for part, _ in kept)
            raise OutOfRangeError(
                "ranges of weights",
                value=f"{accepted} of {_MOST_BATCHES * count} sets of weights lie within",
                limit=f"at least 1 in {_MOST_BATCHES}",
                remedy="fix the weights with the narrowest ranges, or widen those ranges",
            )
        weights, remaining = (np.concatenate(parts, axis=1) for parts in zip(*kept, strict=True))
        return self._ordered(weights), remaining

    def _weights(self, points: FloatArray) -> FloatArray:
        free, count = list(self.free), points.shape[1]
        low, high = np.array(self.low), np.array(self.high)
        weights = np.repeat(low[:, np.newaxis], count, axis=1)
        if not free:
            return weights
        rest = 1.0 - math.fsum(low[k] for k in range(len(low)) if k not in free)
        free_low, free_high = low[free][:, np.newaxis], high[free][:, np.newaxis]
        widths = (free_high - free_low)[:, 0]
        above, below = rest - float(free_low.sum()), float(free_high.sum()) - rest
        dimensions, widest = len(free) - 1, int(np.argmax(widths))
        volumes = [
            max(above, 0.0) ** dimensions / math.factorial(dimensions),
            max(below, 0.0) ** dimensions / math.factorial(dimensions),
            math.prod(np.delete(widths, widest)),
        ]
        match int(np.argmin(volumes)):
            case 0:
                weights[free] = free_low + above * _simplex(points)
            case 1:
                weights[free] = free_high - below * _simplex(points)
            case _:
                narrower = np.delete(np.arange(len(free)), widest)
                within = np.empty((len(free), count))
                within[narrower] = free_low[narrower] + widths[narrower][:, np.newaxis] * points
                within[widest] = rest - within[narrower].sum(axis=0)
                weights[free] = within
        return weights

    def _inside(self, weights: FloatArray) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        low, high = np.array(self.low)[:, np.newaxis], np.array(self.high)[:, np.newaxis]
        return np.asarray(((weights >= low - _ROUNDING) & (weights <= high + _ROUNDING)).all(axis=0))

    def _ordered(self, weights: FloatArray) -> FloatArray:
        """Sort the weights into the order; with equal ranges, all orders are equally likely."""
        if not self.order:
            return weights
        places = list(self.order)
        weights[places] = -np.sort(-weights[places], axis=0)
        return weights


def _simplex(points: FloatArray) -> FloatArray:
    """Uniform points of the simplex Σv = 1 from points of the cube, by stick breaking: shape (n + 1, draws)."""
    shares: list[FloatArray] = []
    rest = np.ones(points.shape[1])
    for number, row in enumerate(points):
        # Of n − k breaks to come, the nearest is at 1 − (1 − u)^(1/(n − k)): written so that small shares keep digits.
        share = -np.expm1(np.log1p(-row) / (len(points) - number))
        shares.append(rest * share)
        rest = rest * (1.0 - share)
    return np.stack([*shares, rest])


def range_mistake(low: Sequence[float], high: Sequence[float]) -> str:
    """The mistake in ranges of weights, with the numbers; empty if some weights satisfy them."""
    if math.fsum(low) > 1.0 + _ROUNDING:
        return f"the minimum weights sum to {math.fsum(low):g}; all weights sum to 1, so at most 1 is expected"
    if math.fsum(high) < 1.0 - _ROUNDING:
        return f"the maximum weights sum to {math.fsum(high):g}; all weights sum to 1, so at least 1 is expected"
    return ""


@dataclass(frozen=True, kw_only=True)
class ValueScale:
    """A linear value function of one criterion, with end points that do not depend on the alternatives.

    Parameters
    ----------
    worst, best
        Values of the criterion that are worth 0 and 1; values beyond them also count as 0 and 1.
    """

    worst: float
    best: float

    def value(self, measured: FloatArray) -> FloatArray:
        """Worth from 0 to 1; unknown values are worth 0."""
        with np.errstate(invalid="ignore"):
            value = np.clip((measured - self.worst) / (self.best - self.worst), 0.0, 1.0)
        return np.where(np.isnan(value), 0.0, value)

    def clips(self, measured: FloatArray) -> npt.NDArray[np.bool_]:
        """Whether each value lies beyond the ends."""
        low, high = sorted((self.worst, self.best))
        return np.asarray((measured < low) | (measured > high))


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
    mean_rank = rank.mean(axis=0)
    # A rank that no draw gave has no scatter; its probability is still known only to within one draw.
    error = np.zeros(mean_rank.shape) if exact else np.maximum(_standard_error(rank), 1.0 / draws)
    with np.errstate(invalid="ignore", divide="ignore"):  # an alternative that is never first has no central weights
        central = sums.sum(axis=0) / first.sum(axis=0)[:, np.newaxis]
        # A ratio of means: its standard error is that of its residuals, to first order.
        residual = (sums - central * first[..., np.newaxis]) / first.mean(axis=0)[:, np.newaxis]
    central_error = np.zeros(central.shape) if exact else _standard_error(residual)
    # Fewer than two first ranks per scramble, on average, give no reliable mean of the weights.
    few = first.sum(axis=0) * _DRAWS < (0.5 if exact else 2.0 * _SCRAMBLES)
    central[few], central_error[few] = np.nan, np.nan
    return Acceptability(
        rank=mean_rank,
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
    from scipy.special import ndtri  # `check` reads `WeightSpace` and must not wait for scipy

    for replicate in range(_SCRAMBLES):
        stream = scrambled_sobol(dimensions, point_generator(seed=seed, point="trade-off", replicate=replicate))
        drawn, uniforms = weights.draw(stream, _DRAWS)
        count = drawn.shape[1]
        values = np.repeat(measured[..., np.newaxis], count, axis=2)
        for (row, column), uniform in zip(uncertain, uniforms, strict=True):
            values[row, column] += errors[row, column] * ndtri(uniform)
        worth = np.stack([scale.value(values[:, j]) for j, scale in enumerate(scales)], axis=1)
        shares = rank_shares(np.einsum("ijk,jk->ki", worth, drawn))
        first = shares[0]
        # Dividing by the draws of each scramble makes scrambles count equally despite a few extra draws.
        sums = np.einsum("ki,jk->ij", first, drawn) / count
        yield (
            np.stack([share.mean(axis=0) for share in shares], axis=1),
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
    start, last = (np.take_along_axis(places, back, axis=1) for places in (start, last))
    size = last - start + 1
    return [np.where((start <= rank) & (rank <= last), 1.0 / size, 0.0) for rank in range(count)]

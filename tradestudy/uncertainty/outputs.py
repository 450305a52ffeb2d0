"""Outputs of draws: depth, failures, quantiles and their errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tradestudy.errors import OutOfRangeError
from tradestudy.uncertainty.distributions import FloatArray
from tradestudy.uncertainty.evaluation import BoolArray

# Selecting a few order statistics is faster than sorting long rows, but not for shorter rows or more of them.
_MOST_SELECTED: Final = 16
_DRAWS_PER_SELECTED: Final = 1000


def order_quantile(ascending: FloatArray, probability: ArrayLike) -> FloatArray:
    """Quantiles of sorted rows, interpolated between order statistics at (k − ½)/n; +∞ where one of these is +∞.

    Parameters
    ----------
    ascending : array, shape (rows, n)
        Sorted along the last axis, without NaN.
    probability : array, shape (p,) or ()
        Probabilities; the first and last draws also represent the tails beyond them.

    Returns
    -------
    array, shape (p, rows) or (rows,)
    """
    p, n = np.asarray(probability, float), ascending.shape[-1]
    position = _position(p, n)
    low = position.astype(np.int64)
    weight = position - low
    # An upper neighbour with zero weight must not count, since it may be infinite.
    upper = np.where(weight > 0.0, ascending[..., np.minimum(low + 1, n - 1)], 0.0)
    value = (1.0 - weight) * ascending[..., low] + weight * upper
    return np.moveaxis(value, -1, 0) if p.ndim else np.asarray(value)


def quantiles_of(values: FloatArray, probability: ArrayLike) -> FloatArray:
    """Quantiles of unsorted rows, bit for bit equal to `order_quantile` of the sorted rows.

    Parameters
    ----------
    values : array, shape (rows, n)
        Without NaN.
    probability : array, shape (p,) or ()
        Probabilities.
    """
    p, n = np.asarray(probability, float), values.shape[-1]
    if p.size > min(_MOST_SELECTED, n // _DRAWS_PER_SELECTED):
        return order_quantile(np.sort(values, axis=-1), p)
    low = _position(p, n).astype(np.int64)
    return order_quantile(np.partition(values, np.unique([low, np.minimum(low + 1, n - 1)]), axis=-1), p)


def valley_quantile(values: FloatArray, probability: float) -> FloatArray:
    """Quantile of rows that fall and then rise, bit for bit equal to `quantiles_of`, without sorting.

    The k smallest of a row are neighbours, so the k-th smallest is the lowest of the higher ends of all k neighbours.

    Parameters
    ----------
    values : array, shape (rows, n)
        Without NaN.
    probability : float
        The probability.
    """
    n = values.shape[-1]
    position = float(_position(np.asarray(probability), n))
    low = int(position)
    lower, upper = (np.min(np.maximum(values[:, : n - k], values[:, k:]), axis=1) for k in (low, min(low + 1, n - 1)))
    weight = position - low
    return np.asarray((1.0 - weight) * lower + (weight * upper if weight > 0.0 else 0.0))


def _position(probability: FloatArray, n: int) -> FloatArray:
    return np.asarray(np.clip(probability * n - 0.5, 0.0, n - 1.0))


PROBABILITIES = (0.025, 0.15865525393145707, 0.5, 0.8413447460685429, 0.975)  # Φ(±1) beside the median
"""Quantiles that are always computed: the ends of the central 95 % and 68.27 % intervals, and the median."""

POLE_MARGIN = 6.0
"""Mean and standard deviation of depth are stated only if infinity is at least this many standard deviations of inverse
depth away (probability below 1e-9 for a normal one); otherwise, they would depend on the number of draws."""

TAIL_SHAPE_LIMIT = 0.5
"""Shape of the generalised Pareto tail from which on the variance does not exist."""

_MAGNITUDES = (1e-140, 1e140)  # a double can represent their squares, summed over any number of draws

_TAIL_PROBABILITY = 0.01
_FEWEST_FOR_TAIL = 50


@dataclass(frozen=True, kw_only=True, eq=False)
class ReplicateStatistics:
    """Statistics of one replicate over the draws that have a rank; outputs are the last axis."""

    quantiles: FloatArray
    half_width: FloatArray
    mean: FloatArray
    standard_deviation: FloatArray
    tail_shape: FloatArray
    pole_margin: FloatArray
    infinite_fraction: FloatArray


def _upper_tail_shape(ascending: FloatArray) -> FloatArray:
    """Shape ξ of a generalised Pareto tail by probability-weighted moments (Hosking and Wallis 1987)."""
    n = ascending.shape[-1]
    # The length of the tail is that of Pareto-smoothed importance sampling (Vehtari et al.); Hosking and Wallis
    # recommend the plotting positions (i − 0.35)/n.
    tail = min(n // 5, int(3.0 * np.sqrt(n)))
    excess = ascending[..., n - tail :] - ascending[..., n - tail - 1, None]
    weight = 1.0 - (np.arange(1, tail + 1) - 0.35) / tail
    a0, a1 = np.mean(excess, axis=-1), np.mean(excess * weight, axis=-1)
    denominator = a0 - 2.0 * a1
    # A tail without spread has no excess: it has the shape of a bounded tail.
    shape = np.full(a0.shape, -np.inf)
    np.divide(a0, denominator, out=shape, where=denominator > 0.0)
    return np.where(np.isfinite(shape), 2.0 - shape, -1.0)


def _tail_shape(ascending: FloatArray, has_infinite: BoolArray) -> FloatArray:
    """Shape of the heavier tail; +∞ if a draw is infinite, or if there are too few draws to estimate it."""
    if ascending.shape[-1] < _FEWEST_FOR_TAIL:
        return np.full(ascending.shape[0], np.inf)
    finite = np.where(has_infinite[:, None], 0.0, ascending)  # ∞ − ∞ would warn; the last line overwrites these rows
    shape = np.maximum(_upper_tail_shape(finite), _upper_tail_shape(-finite[:, ::-1]))
    return np.where(has_infinite, np.inf, shape)


def _pole_margin(median: FloatArray, far: FloatArray) -> FloatArray:
    """Distance from inverse depth to zero in standard deviations, from its median and 1 % quantile, taken as normal."""
    from scipy.special import ndtri  # which reading a study does not need

    w, w_far = 1.0 / median, 1.0 / far  # an infinite depth gives zero
    spread = (w - w_far) / -float(ndtri(_TAIL_PROBABILITY))
    margin = np.where(w > 0.0, np.inf, 0.0)
    np.divide(w, spread, out=margin, where=spread > 0.0)
    return margin


def _of_ranked(ascending: FloatArray, *, depth: bool) -> tuple[FloatArray, ...]:
    """Statistics of sorted rows without NaN, in the order of the fields of `ReplicateStatistics`."""
    infinite = np.isinf(ascending)
    has_infinite = infinite[:, -1]
    ends = np.abs(ascending[:, [0, -1]])
    size = np.max(np.where(np.isinf(ends), 0.0, ends), axis=1)
    beyond = (size > _MAGNITUDES[1]) | ((size > 0.0) & (size < _MAGNITUDES[0]))
    if np.any(beyond):
        raise OutOfRangeError(
            "outputs whose squares a double cannot represent",
            value=f"{size[beyond][0]:.3g}",
            limit=f"magnitudes from {_MAGNITUDES[0]:g} to {_MAGNITUDES[1]:g}, or 0",
            remedy="state the output in another unit",
        )
    finite = np.where(has_infinite[:, None], 0.0, ascending) if np.any(has_infinite) else ascending
    quantiles = order_quantile(ascending, PROBABILITIES)
    freedom = 1 if ascending.shape[-1] > 1 else 0
    margin = (
        _pole_margin(quantiles[2], order_quantile(ascending, 1.0 - _TAIL_PROBABILITY))
        if depth
        else np.full(quantiles.shape[1], np.inf)
    )
    half_width = np.full(margin.shape, np.inf)  # wherever the upper end is infinite, whatever the lower one is
    np.multiply(0.5, quantiles[3] - quantiles[1], out=half_width, where=np.isfinite(quantiles[3]))
    return (
        quantiles,
        half_width,
        np.where(has_infinite, np.nan, np.mean(finite, axis=-1)),
        np.where(has_infinite, np.nan, np.std(finite, axis=-1, ddof=freedom)),
        _tail_shape(ascending, has_infinite),
        margin,
        np.mean(infinite, axis=-1),
    )


def replicate_statistics(values: FloatArray, failures: NDArray[np.int64], *, depth: bool) -> ReplicateStatistics:
    """Statistics of one replicate.

    Parameters
    ----------
    values : array, shape (outputs, draws)
        Draws; NaN has no rank, +∞ has the last one.
    failures : int array, shape (causes, outputs)
        Draws without a rank, by cause.
    depth : bool
        Whether the outputs are depths, for which the distance to the pole at infinity is checked.

    Returns
    -------
    ReplicateStatistics
        NaN for outputs without a single ranked draw.

    Raises
    ------
    OutOfRangeError
        An output is so small or large that its squares underflow or overflow.
    """
    outputs, draws = values.shape
    ascending = np.sort(values, axis=-1)
    counts = draws - np.sum(failures, axis=0)
    columns = {
        field.name: np.full((len(PROBABILITIES), outputs) if field.name == "quantiles" else outputs, np.nan)
        for field in fields(ReplicateStatistics)
    }
    # NaN sorts to the end, so that the ranked draws of an output come first. Outputs with as many of them share a pass.
    for count in np.unique(counts[counts > 0]):
        rows = np.flatnonzero(counts == count)
        statistics = _of_ranked(ascending[rows, :count], depth=depth)
        for column, statistic in zip(columns.values(), statistics, strict=True):
            column[..., rows] = statistic
    return ReplicateStatistics(**columns)


class RunningMean:
    """Mean and standard error over replicates in constant memory, updated in a fixed order (Welford)."""

    def __init__(self) -> None:
        self.count = 0
        self._infinite: NDArray[np.int64] = np.zeros((), np.int64)
        self._mean: FloatArray = np.zeros(())
        self._squares: FloatArray = np.zeros(())

    def add(self, value: FloatArray) -> None:
        """Add the statistic of one more replicate."""
        self.count += 1
        infinite = np.isinf(value)
        self._infinite = self._infinite + infinite
        deviation = np.where(infinite, 0.0, value - np.where(infinite, 0.0, self._mean))
        self._mean = self._mean + deviation / self.count
        self._squares = self._squares + deviation * np.where(infinite, 0.0, value - self._mean)

    @property
    def mean(self) -> FloatArray:
        """Mean over replicates; +∞ where any of them is infinite."""
        return np.where(self._infinite > 0, np.inf, self._mean)

    @property
    def standard_error(self) -> FloatArray:
        """Standard error of the mean; 0 if all replicates are infinite, +∞ if some are, NaN for fewer than two."""
        if self.count < 2:
            return np.full(self._mean.shape, np.nan)
        error = np.sqrt(self._squares / (self.count * (self.count - 1)))
        mixed = np.where(self._infinite == self.count, 0.0, np.inf)
        return np.where(self._infinite > 0, mixed, error)


RunningStatistics = Mapping[str, RunningMean]
"""Running mean of every statistic, by name."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Propagated:
    """Distribution of each output; quantiles refer to the draws that have a rank.

    Outputs are the last axis. Errors are standard errors from replicate to replicate. Mean and standard deviation are
    NaN where second moments do not exist. The ``status`` of an output is ``converged``, ``budget`` (the tolerance was
    not reached), ``memory`` (neither tolerance nor budget were reached: propagate fewer outputs at a time, or raise
    ``memory_bytes``), or ``unranked`` (no draw has a rank). ``failed`` counts the draws without a rank, by cause.
    """

    quantiles: FloatArray
    quantiles_error: FloatArray
    half_width: FloatArray
    half_width_error: FloatArray
    mean: FloatArray
    mean_error: FloatArray
    standard_deviation: FloatArray
    standard_deviation_error: FloatArray
    failed: NDArray[np.int64]
    status: NDArray[np.str_]
    draws: int
    replicates: int

    @property
    def failed_fraction(self) -> FloatArray:
        """Share of the draws that have no rank, by cause, shape (causes, outputs)."""
        return self.failed / self.draws

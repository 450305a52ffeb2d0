"""Quantiles of draws, and means over replicates with their errors."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tradestudy.uncertainty.distributions import FloatArray

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


def ranked_quantiles(ascending: FloatArray, probability: FloatArray) -> FloatArray:
    """`order_quantile` of the draws that have a rank, shape (p, rows); NaN in rows without any.

    Parameters
    ----------
    ascending : array, shape (rows, n)
        Sorted along the last axis, so that the draws without a rank, NaN, come last.
    probability : array, shape (p,)
        Probabilities.
    """
    missing = np.isnan(ascending).sum(axis=1)
    quantiles = np.full((probability.size, len(ascending)), np.nan)
    whole = missing == 0
    quantiles[:, whole] = order_quantile(ascending[whole], probability)
    for row in np.flatnonzero(~whole & (missing < ascending.shape[1])):
        quantiles[:, row] = order_quantile(ascending[row, : -missing[row]], probability)
    return quantiles


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

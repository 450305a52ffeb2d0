"""Quantiles of draws."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike

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


def _position(probability: FloatArray, n: int) -> FloatArray:
    return np.asarray(np.clip(probability * n - 0.5, 0.0, n - 1.0))

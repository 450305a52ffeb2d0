"""The Pareto front: alternatives that no other alternative dominates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from tradestudy.optics.arrays import FloatArray

BoolArray = npt.NDArray[np.bool_]


def non_dominated(values: FloatArray, maximise: Sequence[bool]) -> BoolArray:
    """Which rows no other row dominates, over any number of criteria.

    A row dominates another if it is at least as good in every criterion and better in one, so equal rows do not
    dominate each other. A row with a NaN dominates none and is not on the front.

    Parameters
    ----------
    values
        Shape (alternatives, criteria); infinite values are compared as such.
    maximise
        For each criterion, whether more is better.

    Returns
    -------
    numpy.ndarray
        Shape (alternatives,).
    """
    costs = np.where(np.asarray(maximise, dtype=bool), -values, values)
    known = ~np.isnan(costs).any(axis=1)
    found = np.zeros(len(costs), dtype=bool)
    if not known.any():
        return found
    # In lexicographic order only earlier rows can dominate a row, and duplicates are removed.
    rows, inverse = np.unique(costs[known] + 0.0, axis=0, return_inverse=True)
    on_front = np.zeros(len(rows), dtype=bool)
    for number, row in enumerate(rows):
        on_front[number] = not (rows[:number][on_front[:number]] <= row).all(axis=1).any()
    found[known] = on_front[inverse.ravel()]
    return found

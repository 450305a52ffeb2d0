"""Shares of a variance: Shapley effects of groups of correlated parameters on linear outputs."""

from __future__ import annotations

from collections.abc import Sequence
from math import comb
from typing import Final

import numpy as np

from tradestudy.errors import OutOfRangeError
from tradestudy.uncertainty.distributions import FloatArray
from tradestudy.uncertainty.joint import correlation_factor

MOST_PARTS: Final = 12
"""The explained variance is computed for every subset of the parts; 2¹² subsets take half a second."""

# Directions of a subset that are shorter than this fraction of one standard deviation depend on the others. Rounding
# leaves 1e-9; the shortest that `correlation_factor` keeps is 1.5e-7.
_NO_DIRECTION = 1e-8
# Errors cancel exactly if only this fraction of their sum remains, which is its rounding.
_CANCELLED = 1e-14


def shapley_shares(sensitivity: FloatArray, covariance: FloatArray, parts: Sequence[Sequence[int]]) -> FloatArray:
    """Share of the variance of each output that is due to each part; shares sum to 1 even if parts are correlated.

    The worth of a part is what it adds to the explained variance Var(E[w | X_S]), averaged over all orders in which the
    parts can become known. For independent parts, this is their share of the sum of variances.

    Parameters
    ----------
    sensitivity : array, shape (parameters, outputs)
        Derivative of each output with respect to each parameter [unit of the output per unit of the parameter].
    covariance : array, shape (parameters, parameters)
        Covariance of the parameters, taken as jointly normal; it may be singular, with zeros on the diagonal.
    parts : sequence of sequences of int
        The rows that belong to each part; each row belongs to exactly one part. At most 12 parts.

    Returns
    -------
    array, shape (parts, outputs)
        From 0 to 1; NaN where the output has no variance or its sensitivity is not finite.

    Raises
    ------
    OutOfRangeError
        There are too many parts, a parameter belongs to none or to two of them, or no distribution has the covariance.

    Notes
    -----
    E. Song, B. L. Nelson and J. Staum, "Shapley effects for global sensitivity analysis: theory and computation", 2016;
    A. B. Owen and C. Prieur, "On Shapley value for measuring importance of dependent inputs", 2017.
    """
    _require_parts(parts, len(sensitivity))
    deviation = np.sqrt(np.diag(covariance))
    scaled = np.where(np.isfinite(sensitivity), sensitivity, np.nan) * deviation[:, None]
    factor = _factor(covariance, deviation)
    explained = _explained(factor, factor.T @ scaled, parts)
    total = explained[-1]
    varies = total > (_CANCELLED * np.sum(np.abs(scaled), axis=0)) ** 2
    subsets = np.arange(len(explained))
    size = np.bitwise_count(subsets)
    weight = np.array([1.0 / (len(parts) * comb(len(parts) - 1, k)) for k in range(len(parts))])
    shares = np.full((len(parts), sensitivity.shape[1]), np.nan)
    for part, share in enumerate(shares):
        without = subsets[subsets & (1 << part) == 0]
        gained = explained[without | (1 << part)] - explained[without]
        np.divide(weight[size[without]] @ gained, total, out=share, where=varies)
    return shares


def _require_parts(parts: Sequence[Sequence[int]], parameters: int) -> None:
    if len(parts) > MOST_PARTS:
        raise OutOfRangeError(
            "number of parts among which a variance is divided",
            value=str(len(parts)),
            limit=f"at most {MOST_PARTS}",
            remedy="combine parts that belong together",
        )
    rows = sorted(row for part in parts for row in part)
    if rows != list(range(parameters)):
        raise OutOfRangeError(
            "assignment of parameters to the parts of a variance",
            value=f"rows {rows}",
            limit=f"each of the {parameters} once",
            remedy="assign every parameter to exactly one part",
        )


def _factor(covariance: FloatArray, deviation: FloatArray) -> FloatArray:
    """Standardised parameters as rows, with independent directions as columns; a constant is a row of zeros."""
    moving = np.flatnonzero(deviation > 0.0)
    if moving.size == 0:
        return np.zeros((deviation.size, 0))
    scale = deviation[moving]
    inner = correlation_factor(covariance[np.ix_(moving, moving)] / np.outer(scale, scale))
    factor = np.zeros((deviation.size, inner.shape[1]))
    factor[moving] = inner
    return factor


def _explained(factor: FloatArray, response: FloatArray, parts: Sequence[Sequence[int]]) -> FloatArray:
    """Var(E[w | X_S]) of every subset S of the parts, indexed by its bit mask, shape (2**parts, outputs).

    Knowing X_S means knowing the directions that its rows span, so the explained variance is the squared length of the
    projection of the response onto them.
    """
    explained = np.zeros((1 << len(parts), response.shape[1]))
    for subset in range(1, len(explained)):
        rows = [row for part, members in enumerate(parts) if subset >> part & 1 for row in members]
        _, length, directions = np.linalg.svd(factor[rows], full_matrices=False)
        explained[subset] = np.sum(np.square(directions[length > _NO_DIRECTION] @ response), axis=0)
    return explained

"""The radius about the true distance that contains a given share of measurements of depth."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from tradestudy.optics.arrays import BoolArray, FloatArray

_FARTHEST_SCORE: Final = 9.0  # the probability beyond it is below 1e-18
_SECTIONS: Final = 16
_ROUNDS: Final = 5  # to 1e-5 of a standard deviation, with linear interpolation within
_ROUNDING: Final = 1e-12  # of a distance, by which depth misses it without any error


def error_radius(read: Callable[[FloatArray], FloatArray], distance: FloatArray, share: float) -> FloatArray:
    """Quantile of |depth − truth| of measurements that one standard normal score determines.

    The measurements within the radius r are those between a far depth at the score u and a near depth at the score v,
    with Φ(v) − Φ(u) equal to the share and both depths equally far from the truth.

    Parameters
    ----------
    read
        Depth [m] at scores (scores, distances), the smaller the larger the score; +∞ or NaN is a failure.
    distance
        True distances [m].
    share
        Share of all measurements within the radius; from 1 on, the radius is infinite.

    Returns
    -------
    array (distances,)
        Radius [m]; +∞ where failures leave too few measurements.
    """
    from scipy.special import ndtr, ndtri

    if share >= 1.0:
        return np.full(distance.shape, np.inf)

    def beyond(far: FloatArray) -> tuple[FloatArray, FloatArray]:
        """How far the depth at the far score exceeds the truth, and how far that at the near score falls short."""
        near = np.minimum(-ndtri(np.maximum(1.0 - share - ndtr(far), 0.0)), _FARTHEST_SCORE)
        depths = read(np.concatenate([far, near]))
        depths = np.where(np.isnan(depths), np.inf, depths)
        with np.errstate(invalid="ignore"):
            above, below = depths[: len(far)] - distance, np.abs(distance - depths[len(far) :])
        return above, below

    low, high = last_scores(
        np.full(distance.shape, -_FARTHEST_SCORE),
        np.full(distance.shape, ndtri(1.0 - share)),
        lambda far: np.greater(*beyond(far)),
        rounds=_ROUNDS,
    )
    above, below = beyond(np.stack([low, high]))
    with np.errstate(invalid="ignore", divide="ignore"):
        excess = above - below
        to_high = np.clip(excess[0] / (excess[0] - excess[1]), 0.0, 1.0)
        between = above[0] + to_high * (above[1] - above[0])
    crossed = np.isfinite(between) & (excess[0] > 0.0) & (excess[1] < 0.0)
    return without_rounding(np.where(crossed, between, np.maximum(above, below)[1]), distance)


def without_rounding(error: FloatArray, distance: FloatArray) -> FloatArray:
    """Errors of depth [m], 0 where they are no larger than rounding makes them."""
    return np.asarray(np.where(error <= _ROUNDING * distance, 0.0, error))


def last_scores(
    low: FloatArray,
    high: FloatArray,
    holds: Callable[[FloatArray], BoolArray],
    *,
    rounds: int,
) -> tuple[FloatArray, FloatArray]:
    """Narrow brackets (distances,) of the last scores at which a condition holds, by subdivision into 16 per round.

    The condition, of scores (scores, distances), holds at ``low`` and not at ``high``; if it does not hold at ``low``
    or holds at ``high``, the bracket narrows towards that end.
    """
    shares, columns = np.linspace(0.0, 1.0, _SECTIONS + 1)[:, np.newaxis], np.arange(low.size)
    for _ in range(rounds):
        scores = low + shares * (high - low)
        last = np.sum(np.logical_and.accumulate(holds(scores[1:-1]), axis=0), axis=0)
        low, high = scores[last, columns], scores[last + 1, columns]
    return low, high

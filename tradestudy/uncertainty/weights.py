"""Uncertain weights of criteria: uniform on the simplex, within ranges or in an order."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from tradestudy.errors import OutOfRangeError
from tradestudy.uncertainty.distributions import FloatArray
from tradestudy.uncertainty.streams import UniformStream

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
            found = sum(part.shape[1] for part, _ in kept)
            raise OutOfRangeError(
                "ranges of weights",
                value=f"{found} of {_MOST_BATCHES * count} sets of weights lie within",
                limit=f"at least 1 in {_MOST_BATCHES}",
                remedy="fix the weights with the narrowest ranges, or widen those ranges",
            )
        weights, others = (np.concatenate(parts, axis=1) for parts in zip(*kept, strict=True))
        return self._ordered(weights), others

    def _weights(self, points: FloatArray) -> FloatArray:
        free, count = list(self.free), points.shape[1]
        low, high = np.array(self.low), np.array(self.high)
        weights = np.repeat(low[:, np.newaxis], count, axis=1)
        if not free:
            return weights
        rest = 1.0 - math.fsum(low[k] for k in range(len(low)) if k not in free)
        own_low, own_high = low[free][:, np.newaxis], high[free][:, np.newaxis]
        widths = (own_high - own_low)[:, 0]
        above, below = rest - float(own_low.sum()), float(own_high.sum()) - rest
        dimensions, widest = len(free) - 1, int(np.argmax(widths))
        volumes = [
            max(above, 0.0) ** dimensions / math.factorial(dimensions),
            max(below, 0.0) ** dimensions / math.factorial(dimensions),
            math.prod(np.delete(widths, widest)),
        ]
        match int(np.argmin(volumes)):
            case 0:
                weights[free] = own_low + above * _simplex(points)
            case 1:
                weights[free] = own_high - below * _simplex(points)
            case _:
                others = np.delete(np.arange(len(free)), widest)
                own = np.empty((len(free), count))
                own[others] = own_low[others] + widths[others][:, np.newaxis] * points
                own[widest] = rest - own[others].sum(axis=0)
                weights[free] = own
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
    left = np.ones(points.shape[1])
    for number, row in enumerate(points):
        share = -np.expm1(np.log1p(-row) / (len(points) - number))
        shares.append(left * share)
        left = left * (1.0 - share)
    return np.stack([*shares, left])


def range_mistake(low: Sequence[float], high: Sequence[float]) -> str:
    """The mistake in ranges of weights, with the numbers; empty if some weights satisfy them."""
    if math.fsum(low) > 1.0 + _ROUNDING:
        return f"the minimum weights sum to {math.fsum(low):g}; all weights sum to 1, so at most 1 is expected"
    if math.fsum(high) < 1.0 - _ROUNDING:
        return f"the maximum weights sum to {math.fsum(high):g}; all weights sum to 1, so at least 1 is expected"
    return ""

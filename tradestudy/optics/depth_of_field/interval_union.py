"""Several depths of field together: what they cover, where they overlap, what they leave out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.depth_of_field.limits import DepthOfField

# Limits closer than this, relative to their distance, touch: designs that just touch must not show gaps of rounding.
TOUCHING: Final = 1e-9


@dataclass(frozen=True, kw_only=True)
class IntervalUnion:
    """Union of intervals of distance; every array has rows (from, to) in order of distance [m]."""

    covered: FloatArray
    """Where at least one is sharp."""
    gaps: FloatArray
    """Between the nearest and the farthest limit, where none is."""
    overlaps: FloatArray
    """Where at least two are."""

    @property
    def complete(self) -> bool:
        """Whether one interval covers everything from the nearest to the farthest limit."""
        return len(self.covered) == 1


def union(slices: DepthOfField) -> IntervalUnion:
    """Join depths of field given as one-dimensional arrays of limits; empty ones add nothing.

    Neighbours whose limits agree to 1e-9 of their distance touch: they leave no gap and no overlap.
    """
    near, far = (limit[~slices.empty.ravel()] for limit in (slices.near.ravel(), slices.far.ravel()))
    return IntervalUnion(
        covered=_stretches(near, far, depth=1),
        overlaps=_stretches(near, far, depth=2),
        gaps=_between(_stretches(near, far, depth=1)),
    )


def _stretches(near: FloatArray, far: FloatArray, *, depth: int) -> FloatArray:
    """Stretches of distance that at least so many intervals hold.

    Going outward, a near limit raises the count and a far limit lowers it. Where two limits touch, the near
    one comes first for the union (no gap) and the far one for overlaps (no overlap).
    """
    margin = 1 - TOUCHING if depth == 1 else 1 + TOUCHING
    places = np.concatenate((near, far))
    rank = np.concatenate((near * margin, far))
    step = np.concatenate((np.ones(len(near)), -np.ones(len(far))))
    order = np.lexsort((-step if depth == 1 else step, rank))
    count = np.cumsum(step[order])
    enters = (count == depth) & (step[order] > 0)
    leaves = (count == depth - 1) & (step[order] < 0)
    return np.stack((places[order][enters], places[order][leaves]), axis=-1).reshape(-1, 2)


def _between(covered: FloatArray) -> FloatArray:
    """Give what lies between neighbouring stretches."""
    return np.stack((covered[:-1, 1], covered[1:, 0]), axis=-1).reshape(-1, 2)

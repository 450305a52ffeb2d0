"""In which order the lenses around one lens come closer to a point that moves away from it along a ray."""

from __future__ import annotations

import math

import numpy as np

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.microlens_coverage.lattice import Lattice

# Angles closer than this are one angle seen with different rounding.
_SAME_ANGLE = 1e-12


def distance_to_bisector(positions: FloatArray, direction: FloatArray) -> FloatArray:
    """Distance along each direction (rows) from which each lens (columns) beats the origin: |g|²/(2 g·u).

    Infinite for a lens that never is.
    """
    along = np.cos(direction)[:, np.newaxis] * positions[:, 0] + np.sin(direction)[:, np.newaxis] * positions[:, 1]
    squared = np.sum(positions**2, axis=-1)
    never = np.full(along.shape, np.inf)
    return np.asarray(np.divide(squared, 2 * along, out=never, where=along > 1e-9))


def order_changes(lattice: Lattice, positions: FloatArray, *, within: float) -> FloatArray:
    """Angles in the wedge at which two lenses come closer at the same distance, if that is within a radius.

    The ends of the wedge are the first and the last of the angles. At g and h this is where |g|²/(g·u) =
    |h|²/(h·u).
    """
    near = positions[np.sum(positions**2, axis=-1) <= (2 * within) ** 2]
    i, j = np.triu_indices(len(near), k=1)
    squared = np.sum(near**2, axis=-1)[:, np.newaxis]
    normal = squared[i] * near[j] - squared[j] * near[i]
    crossing = np.arctan2(-normal[:, 0], normal[:, 1]) % math.pi
    along = np.cos(crossing) * near[i, 0] + np.sin(crossing) * near[i, 1]
    reached = 2 * within * along >= squared[i, 0]
    in_wedge = (crossing > _SAME_ANGLE) & (crossing < lattice.wedge - _SAME_ANGLE)
    angles = np.sort(crossing[reached & in_wedge])
    distinct = angles[np.diff(angles, prepend=-1.0) > _SAME_ANGLE]
    return np.concatenate(([0.0], distinct, [lattice.wedge]))

"""What both cameras of a pair see."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.optics.arrays import FloatArray


def shared_view(distance: ArrayLike, baseline: float, field_of_view: float, convergence_angle: float) -> FloatArray:
    """Share of each picture's width at a distance that the other camera sees too; ``1 − B/W`` for parallel axes.

    W = 2 Z tan(FOV/2). Zero where the views do not meet. Converging axes map a plane unevenly; the share is that of the
    picture, not of the plane.

    Parameters
    ----------
    distance
        Z [m] from the baseline.
    baseline
        B [m].
    field_of_view, convergence_angle
        Full angles [rad]: across one picture, and between the axes.
    """
    z = np.asarray(distance, dtype=np.float64)
    half, t = field_of_view / 2.0, convergence_angle / 2.0

    def mirrored(edge: float) -> FloatArray:
        """Direction from the left camera to where the right camera's edge of view meets the plane."""
        if abs(edge) >= math.pi / 2.0:  # that edge never meets the plane: the view has no end on this side
            return np.full(z.shape, -math.copysign(math.pi / 2.0, edge))
        return np.arctan(baseline / z - math.tan(edge))

    if abs(t) - half >= math.pi / 2.0:
        return np.zeros_like(z)
    low = np.maximum(max(t - half, -math.pi / 2.0), mirrored(t + half))
    high = np.minimum(min(t + half, math.pi / 2.0), mirrored(t - half))
    # From directions to the picture, where a direction beyond the picture's own edges does not occur.
    shared = np.tan(np.clip(high - t, -half, half)) - np.tan(np.clip(low - t, -half, half))
    return np.asarray(np.clip(shared / (2.0 * math.tan(half)), 0.0, 1.0))

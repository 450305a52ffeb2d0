"""The overlap of the views of a pair."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.picture_field import edge_angle, place_across
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.lens_model import LensModel

_RIGHT_ANGLE = math.pi / 2.0


def shared_view(
    distance: ArrayLike, baseline: float, half_width: float, convergence_angle: float, lens: LensModel
) -> FloatArray:
    """Share of each picture's width at a distance that the other camera also sees; ``1 − B/W`` for parallel pinholes.

    W = 2 Z w with w half the picture's width. Zero where the views do not overlap. Converging axes and lenses with
    distortion image a plane unevenly; the share refers to the picture, not to the plane.

    Parameters
    ----------
    distance
        Z [m] from the baseline.
    baseline
        B [m].
    half_width
        Half the width of the normalised picture [1].
    convergence_angle
        Full angle between the axes [rad].
    lens
        Lens model of both cameras.
    """
    z = np.asarray(distance, dtype=np.float64)
    t = convergence_angle / 2.0
    first, last = -edge_angle(lens, -half_width, 0.0), edge_angle(lens, half_width, 0.0)

    def met(edge: float) -> FloatArray:
        """Direction from the left camera to the line in which an edge of the right camera's view meets the plane."""
        if abs(edge) >= _RIGHT_ANGLE:  # this edge never meets the plane: the view is unbounded on this side
            return np.full(z.shape, math.copysign(_RIGHT_ANGLE, edge))
        return np.arctan(baseline / z + math.tan(edge))

    low = np.maximum(max(t + first, -_RIGHT_ANGLE), met(first - t))
    high = np.minimum(min(t + last, _RIGHT_ANGLE), met(last - t))
    # Directions are clipped to the edges of the picture.
    places = place_across(
        lens, np.clip([high - t, low - t, np.full(z.shape, last), np.full(z.shape, first)], first, last)
    )[..., 0]
    return np.asarray(np.clip((places[0] - places[1]) / (places[2] - places[3]), 0.0, 1.0))

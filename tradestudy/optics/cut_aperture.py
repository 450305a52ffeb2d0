"""Centroid of the light through a round aperture that a second one cuts."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.quadrature import gauss_legendre

_NODES = 64


def centroid_of_common_part(apart: ArrayLike, radius: float, other_radius: float) -> FloatArray:
    """Distance [m] from the centre of the first of two discs to the centroid of their overlap, towards the second.

    Parameters
    ----------
    apart
        Distance between the centres [m], any shape.
    radius, other_radius
        Radii of the discs [m].

    Returns
    -------
    FloatArray
        Distance; 0 where the first disc lies within the second, NaN where they do not overlap.
    """
    s = np.asarray(apart, dtype=np.float64)[..., np.newaxis]
    low, high = np.maximum(-radius, s - other_radius), np.minimum(radius, s + other_radius)
    t, weight = gauss_legendre(_NODES)
    # Nodes cluster at both ends, where the outline is steep.
    x = low + (high - low) * np.square(np.sin(0.5 * np.pi * t))
    height = np.minimum(radius**2 - np.square(x), other_radius**2 - np.square(x - s))
    area = weight * np.sin(np.pi * t) * np.sqrt(np.maximum(height, 0.0))
    with np.errstate(invalid="ignore"):  # no overlap
        return np.asarray(
            np.where(high > low, (area * x).sum(-1, keepdims=True) / area.sum(-1, keepdims=True), np.nan)
        )[..., 0]

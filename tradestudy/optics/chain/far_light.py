"""Light that an edge throws farther than it is followed: known in amount by energy, in shape by its law.

Far from where rays land, the wave from the rim of an aperture brings a mean irradiance ∝ 1/r³ (of a focused circular
lens the share 2/(π v) falls beyond v = 2π R r/(λ b)). Microlenses interfere there as well, which the points of a
source average out.
"""

from __future__ import annotations

import math

import numpy as np

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain.scene import PixelGrid

_OUTSIDE_SQUARE = 4.0 * math.sqrt(2.0)  # ∬ dx dy/r³ outside a square, times its half side


def far_light(grid: PixelGrid, middles: FloatArray, half_side: float, power: FloatArray) -> FloatArray:
    """Spread what leaves square patches over the pixels beyond them, as 1/r³ from the middle.

    Parameters
    ----------
    grid
        The detector; a pixel belongs to a patch if its centre does.
    middles
        Middles (x, y) of the patches [m], shape (n, 2).
    half_side
        Half the side of a patch [m].
    power
        What leaves each patch, of which most misses the detector, shape (n,).

    Returns
    -------
    ndarray
        Power on every pixel, shape (rows, columns).
    """
    x, y = ((edges[1:] + edges[:-1]) / 2 for edges in (grid.edges_x, grid.edges_y))
    total = np.zeros(grid.shape)
    for (middle_x, middle_y), leaving in zip(middles, power, strict=True):
        across, along = np.abs(x - middle_x), np.abs(y - middle_y)[:, None]
        beyond = np.maximum(across, along) > half_side
        distance = np.hypot(across, along)[beyond]
        total[beyond] += leaving * half_side / _OUTSIDE_SQUARE * grid.pitch**2 / distance**3
    return total

"""Integration over a square pixel."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.optics.arrays import FloatArray


def square_transfer(frequency_x: ArrayLike, frequency_y: ArrayLike, width: ArrayLike) -> FloatArray:
    """Transfer of a square of side w: ``sinc(w ν_x) sinc(w ν_y)`` with sinc t = sin(πt)/(πt).

    Parameters
    ----------
    frequency_x, frequency_y
        Along the sides [cycles/m].
    width
        Side of the active, evenly sensitive part of the pixel [m]; 0 samples at a point.
    """
    w = np.asarray(width, dtype=np.float64)
    return np.asarray(np.sinc(w * np.asarray(frequency_x)) * np.sinc(w * np.asarray(frequency_y)))

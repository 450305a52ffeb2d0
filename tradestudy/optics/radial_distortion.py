"""Radial distortion of a lens, forwards and backwards: ``r_d = r (1 + k₁ r² + k₂ r⁴)``."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.optics.arrays import BoolArray, FloatArray

_NEWTON_STEPS = 6
_SETTLED = 1e-12
_LARGEST_SCALE = 4.0  # beyond, a Newton step has left the field in which the coefficients describe a lens


def distort(x: ArrayLike, y: ArrayLike, k1: ArrayLike, k2: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Where a lens with radial distortion puts a point that an ideal one would put at (x, y).

    Parameters
    ----------
    x, y
        Coordinates from the centre of distortion, in the unit that k₁ and k₂ refer to; they broadcast.
    k1, k2
        Coefficients of r² and r⁴ [1].

    Notes
    -----
    D. C. Brown, "Close-range camera calibration", Photogrammetric Engineering 37 (1971) 855, radial terms only.
    """
    x, y = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    square = x * x + y * y
    factor = 1.0 + square * (np.asarray(k1) + square * np.asarray(k2))
    return x * factor, y * factor


def undistort(x: ArrayLike, y: ArrayLike, k1: ArrayLike, k2: ArrayLike) -> tuple[FloatArray, FloatArray, BoolArray]:
    """The inverse of `distort`, by Newton's method on the scale g = r/r_d.

    ``g + k₁ r_d² g³ + k₂ r_d⁴ g⁵ = 1``, from g = 1.

    Returns
    -------
    x, y
        Ideal coordinates; meaningless where not valid.
    valid
        False where the polynomial has no inverse that is connected with the centre: outside the field in which the
        coefficients describe a lens.
    """
    x, y = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    square = x * x + y * y
    a, b = np.asarray(k1) * square, np.asarray(k2) * square * square
    scale = np.ones(np.broadcast_shapes(np.shape(a), np.shape(b)))
    valid = np.ones(scale.shape, dtype=bool)
    step = np.zeros_like(scale)
    for _ in range(_NEWTON_STEPS):
        g2 = scale * scale
        slope = 1.0 + g2 * (3.0 * a + 5.0 * b * g2)
        valid &= slope > 0.0
        step = (scale * (1.0 + g2 * (a + b * g2)) - 1.0) / np.where(slope > 0.0, slope, 1.0)
        scale = np.clip(scale - step, 0.0, _LARGEST_SCALE)
        if not np.any(np.abs(step) > _SETTLED):
            break
    valid &= np.abs(step) <= _SETTLED
    return x * scale, y * scale, valid

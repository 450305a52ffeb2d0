"""Interpolation between samples by cubics."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.optics.arrays import FloatArray


def cubic_weights(fraction: ArrayLike) -> FloatArray:
    """Weights of the samples at −1, 0, 1 and 2 for a position t from 0 to 1, shape (…, 4); exact for cubics.

    They are Lagrange's polynomials: each is 1 at its own sample and 0 at the other three.
    """
    t = np.asarray(fraction, dtype=np.float64)
    return np.stack(
        [
            -t * (t - 1.0) * (t - 2.0) / 6.0,
            (t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0,
            -(t + 1.0) * t * (t - 2.0) / 2.0,
            (t + 1.0) * t * (t - 1.0) / 6.0,
        ],
        axis=-1,
    )

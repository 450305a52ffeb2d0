"""Interpolation between samples by cubic convolution."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.optics.arrays import FloatArray


def cubic_weights(fraction: ArrayLike) -> FloatArray:
    """Weights of the samples at −1, 0, 1 and 2 for a place from 0 to 1, shape (…, 4); exact for parabolas.

    R. G. Keys, "Cubic convolution interpolation for digital image processing", IEEE Trans. ASSP 29, 1153 (1981).
    """
    t = np.asarray(fraction, dtype=np.float64)
    return np.stack(
        [
            ((2.0 - t) * t - 1.0) * t / 2.0,
            ((3.0 * t - 5.0) * t * t + 2.0) / 2.0,
            ((4.0 - 3.0 * t) * t + 1.0) * t / 2.0,
            (t - 1.0) * t * t / 2.0,
        ],
        axis=-1,
    )

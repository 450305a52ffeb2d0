"""Defocus by rays: a uniform disc."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.optics.arrays import FloatArray

# Below this argument the series 1 − q²/8 is exact to the last digit.
_SMALL = 1e-4


def disc_transfer(frequency: ArrayLike, blur_diameter: ArrayLike) -> FloatArray:
    """Transfer of a uniform disc of diameter c: ``2 J₁(q)/q, q = π c ν``.

    Parameters
    ----------
    frequency
        ν ≥ 0 [cycles/m], any shape.
    blur_diameter
        c ≥ 0 [m] in the same plane, broadcast.

    Returns
    -------
    FloatArray
        1 for c = 0; its first zero is at ν = 1.22/c and it is negative behind. The law of rays: right where the blur is
        wide against the diffraction spot; together with `airy_transfer` as a product it loses too much contrast, see
        `tradestudy.imaging.picture`.

    References
    ----------
    J. W. Goodman, *Introduction to Fourier Optics*, section 6.4.4, the geometrical limit.
    """
    from scipy.special import j1

    q = np.pi * np.asarray(blur_diameter, dtype=np.float64) * np.asarray(frequency, dtype=np.float64)
    small = np.abs(q) < _SMALL
    return np.asarray(np.where(small, 1.0 - q * q / 8.0, 2.0 * j1(q) / np.where(small, 1.0, q)))

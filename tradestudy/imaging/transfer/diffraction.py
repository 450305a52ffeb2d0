"""Diffraction in focus: the Airy pattern."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.optics.arrays import FloatArray


def airy_transfer(frequency: ArrayLike, wavelength: float, f_number: ArrayLike) -> FloatArray:
    """Transfer of a circular pupil in focus: ``(2/π)(arccos s − s √(1 − s²)), s = λ N ν``.

    Parameters
    ----------
    frequency
        ν ≥ 0 [cycles/m].
    wavelength
        λ [m].
    f_number
        Working f-number N: image distance over pupil diameter; broadcast against the frequency.

    Returns
    -------
    FloatArray
        0 beyond the cut-off 1/(λ N). Paraxial, incoherent light.

    References
    ----------
    J. W. Goodman, *Introduction to Fourier Optics*, eq. 6-31.
    """
    s = np.minimum(wavelength * np.asarray(f_number, dtype=np.float64) * np.asarray(frequency, dtype=np.float64), 1.0)
    return np.asarray((2.0 / np.pi) * (np.arccos(s) - s * np.sqrt(1.0 - s * s)))

"""Air between lens and object: its refractive index, and what it does to the focal length of a lens."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.optics.arrays import FloatArray

STANDARD_TEMPERATURE = 288.15  # K
STANDARD_PRESSURE = 101_325.0  # Pa


def air_refractive_index(wavelength: float, temperature: ArrayLike, pressure: ArrayLike) -> FloatArray:
    """``n − 1 = (n_s − 1) (p/p_s)(T_s/T)``, with n_s for dry air at 15 °C and 101 325 Pa by Edlén's formula.

    Parameters
    ----------
    wavelength
        Vacuum wavelength [m], 0.2 to 2 µm.
    temperature, pressure
        T [K] and p [Pa], broadcast against each other; p = 0 is vacuum, with n = 1.

    Notes
    -----
    B. Edlén, "The refractive index of air", Metrologia 2 (1966) 71, eq. 1. The ideal gas law stands in for eq. 12;
    between 0 and 1.1 bar and from −20 to 50 °C they differ by less than 1e-6 in n.
    """
    square = (1e-6 / wavelength) ** 2  # wave number squared, per µm²
    refractivity = 1e-8 * (8342.13 + 2_406_030.0 / (130.0 - square) + 15_997.0 / (38.9 - square))
    density = np.asarray(pressure) / STANDARD_PRESSURE * (STANDARD_TEMPERATURE / np.asarray(temperature))
    return np.asarray(1.0 + refractivity * density)


def focal_length_change_with_medium(glass_index: float, index_before: ArrayLike, index_after: ArrayLike) -> FloatArray:
    """Ratio of a thin lens's focal lengths after and before the medium changes: ``f'/f = (n_g/n − 1)/(n_g/n' − 1)``.

    Parameters
    ----------
    glass_index
        n_g of the glass against vacuum.
    index_before, index_after
        n and n' of the medium, before and after the change.

    Notes
    -----
    The lensmaker's equation, with the index of the glass relative to the medium. In vacuum, the focal length
    of a lens of n_g = 1.52 is 0.08 % shorter than in air.
    """
    before = glass_index / np.asarray(index_before) - 1.0
    return np.asarray(before / (glass_index / np.asarray(index_after) - 1.0))

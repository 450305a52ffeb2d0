"""Surface texture: what there is to match."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.parts import require_positive
from tradestudy.optics.arrays import FloatArray


@dataclass(frozen=True, kw_only=True)
class Texture:
    """A stationary, isotropic, Gaussian texture whose autocorrelation falls off as ``exp(−r/ℓ)``.

    The exponential is chosen because its spectrum ends in a power law, ν⁻³ in the plane, as those of natural surfaces
    and scenes do (amplitude close to 1/ν: D. J. Field, J. Opt. Soc. Am. A 4, 2379, 1987). A Gaussian autocorrelation
    would leave nothing at all to match beyond a sharp band, and make the answer depend on that band alone.

    Parameters
    ----------
    contrast
        Standard deviation of the radiance over its mean c.
    correlation_length
        ℓ [m] on the object: where the autocorrelation is down to 1/e.

    Raises
    ------
    OutOfRangeError
        For values that are not finite and above zero.
    """

    contrast: float
    correlation_length: float

    def __post_init__(self) -> None:
        require_positive("contrast of the texture", self.contrast, "")
        require_positive("correlation length of the texture", self.correlation_length)


def texture_spectrum(frequency: ArrayLike, contrast: ArrayLike, correlation_length: ArrayLike) -> FloatArray:
    """Power spectrum of the relative radiance: ``S(ν) = 2π c² ℓ² (1 + (2π ℓ ν)²)^(−3/2)``.

    Parameters
    ----------
    frequency
        |ν| [cycles per unit of length].
    contrast
        c.
    correlation_length
        ℓ in that unit: imaged with magnification m, ``m ℓ``.

    Returns
    -------
    FloatArray
        Two-sided in the plane, [unit²]: its integral over all frequencies is c².
    """
    length = np.asarray(correlation_length, dtype=np.float64)
    argument = 1.0 + np.square(2.0 * np.pi * length * np.asarray(frequency, dtype=np.float64))
    return np.asarray(2.0 * np.pi * np.square(np.asarray(contrast) * length) / (argument * np.sqrt(argument)))


def share_beyond(frequency: ArrayLike, correlation_length: ArrayLike) -> FloatArray:
    """Share of the variance at frequencies above |ν|: ``(1 + (2π ℓ ν)²)^(−1/2)``."""
    return np.asarray(1.0 / np.hypot(1.0, 2.0 * np.pi * np.asarray(correlation_length) * np.asarray(frequency)))

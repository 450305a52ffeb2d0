"""Transfer functions of each step of a picture, in closed form: defocus, diffraction, the pixel.

All are on the axis and rotationally symmetric unless stated otherwise. They take spatial frequencies [cycles/m] in the
plane in which the blur is measured, and are 1 at frequency 0; negative values are contrast reversals.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.errors import UnaffordableError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.quadrature import gauss_legendre

# Below this argument the series 1 − q²/8 is exact to the last digit.
_SMALL = 1e-4
# Numbers of nodes of Fresnel's integral.
_MOST_NODES = 2000
_STEP = 8  # node counts are multiples of this, so that few rules serve all pictures
_AT_ONCE = 16_000  # values: enough to keep the loop cheap, few enough for a processor's cache


def disc_transfer(frequency: ArrayLike, blur_diameter: ArrayLike) -> FloatArray:
    """Transfer function of a uniform disc of diameter c: ``2 J₁(q)/q, q = π c ν``.

    Parameters
    ----------
    frequency
        ν ≥ 0 [cycles/m], any shape.
    blur_diameter
        c ≥ 0 [m] in the same plane, broadcast.

    Returns
    -------
    FloatArray
        1 for c = 0; the first zero is at ν = 1.22/c, beyond which values are negative. This is geometrical optics,
        correct if the blur is wide compared with the diffraction spot. Its product with `airy_transfer` underestimates
        contrast; see `tradestudy.imaging.picture`.

    References
    ----------
    J. W. Goodman, *Introduction to Fourier Optics*, section 6.4.4, the geometrical limit.
    """
    from scipy.special import j1

    q = np.pi * np.asarray(blur_diameter, dtype=np.float64) * np.asarray(frequency, dtype=np.float64)
    small = np.abs(q) < _SMALL
    return np.asarray(np.where(small, 1.0 - q * q / 8.0, 2.0 * j1(q) / np.where(small, 1.0, q)))


def airy_transfer(frequency: ArrayLike, wavelength: float, f_number: ArrayLike) -> FloatArray:
    """Transfer function of a circular pupil in focus: ``(2/π)(arccos s − s √(1 − s²)), s = λ N ν``.

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
        0 beyond the cut-off 1/(λ N). Valid for paraxial, incoherent light.

    References
    ----------
    J. W. Goodman, *Introduction to Fourier Optics*, eq. 6-31.
    """
    s = np.minimum(wavelength * np.asarray(f_number, dtype=np.float64) * np.asarray(frequency, dtype=np.float64), 1.0)
    return np.asarray((2.0 / np.pi) * (np.arccos(s) - s * np.sqrt(1.0 - s * s)))


def square_transfer(frequency_x: ArrayLike, frequency_y: ArrayLike, width: ArrayLike) -> FloatArray:
    """Transfer function of a square of side w: ``sinc(w ν_x) sinc(w ν_y)`` with sinc t = sin(πt)/(πt).

    Parameters
    ----------
    frequency_x, frequency_y
        Along the sides [cycles/m].
    width
        Side of the active, evenly sensitive part of the pixel [m]; 0: a point.
    """
    w = np.asarray(width, dtype=np.float64)
    return np.asarray(np.sinc(w * np.asarray(frequency_x)) * np.sinc(w * np.asarray(frequency_y)))


def fresnel_transfer(
    frequency: ArrayLike, wavelength: float, f_number: ArrayLike, blur_diameter: ArrayLike
) -> FloatArray:
    """Transfer function of a circular pupil out of focus: ``(4/π) ∫₀^{arccos s} sin²φ cos(α (cos φ − s)) dφ``.

    Here s = λ N ν and α = π c ν = 4 k W₂₀ s, with the defocus W₂₀ = c/(8 N) at the rim of the pupil.

    Parameters
    ----------
    frequency
        ν ≥ 0 [cycles/m].
    wavelength
        λ [m].
    f_number
        Working f-number N.
    blur_diameter
        c ≥ 0 [m]: diameter of the geometric blur, which measures the defocus.

    Returns
    -------
    FloatArray
        Broadcast over frequency, f-number and blur; `airy_transfer` at c = 0, `disc_transfer` for c ≫ λ N, and 0 beyond
        the cut-off. The Gauss–Legendre rule has enough nodes for the largest phase; rounding errors of 1e-14 remain.

    Raises
    ------
    UnaffordableError
        The defocus exceeds about a thousand waves.

    References
    ----------
    H. H. Hopkins, "The frequency response of a defocused optical system", Proc. R. Soc. A 231, 91 (1955).
    """
    nu, N, c = (np.asarray(value, dtype=np.float64) for value in (frequency, f_number, blur_diameter))
    if not np.any(c):
        return airy_transfer(np.broadcast_to(nu, np.broadcast_shapes(nu.shape, c.shape)), wavelength, N)
    with np.errstate(invalid="ignore"):  # 0 · ∞ is NaN, the correct result there
        # At the cut-off and beyond, the two sheared pupils no longer overlap and the integral vanishes.
        s, alpha = np.minimum(wavelength * N * nu, 1.0), np.pi * (c * nu)
    return _within_the_cutoff(s, alpha)


def _within_the_cutoff(s: FloatArray, alpha: FloatArray) -> FloatArray:
    """The integral for s ≤ 1, broadcast; terms of s alone are computed before broadcasting.

    The phase between the two sheared pupils is k (W(x + s) − W(x − s)) = 4 k W₂₀ s x = α x.
    """
    phase = alpha * (1.0 - s)
    largest = float(np.max(phase, initial=0.0, where=~np.isnan(phase)))
    needed = 10.0 + 1.2 * math.sqrt(largest) + 0.42 * largest  # found by trial to give 14 digits up to 2000 rad
    count = _STEP * math.ceil(needed / _STEP)
    if count > _MOST_NODES:
        raise UnaffordableError(
            "nodes of the transfer function of a defocused pupil",
            value=str(count),
            limit=f"at most {_MOST_NODES}",
            remedy="use the disc of rays, which is exact for so large a blur",
        )
    span = np.arccos(s)
    total = np.zeros_like(phase)
    axes = tuple(range(1, phase.ndim + 1))
    nodes, weights = (np.expand_dims(rule, axes) for rule in gauss_legendre(count))
    block = max(1, _AT_ONCE // max(1, phase.size))
    for first in range(0, count, block):
        cosine = _cos(span * nodes[first : first + block])
        values = weights[first : first + block] * (1.0 - cosine * cosine) * _cos(alpha * (cosine - s))
        total += np.sum(values, axis=0)
    return np.asarray((4.0 / np.pi) * span * total)


def _cos(x: FloatArray) -> FloatArray:
    """cos x = 2/(1 + tan² x/2) − 1, accurate to the last digit but one: numpy vectorises tangents but not cosines.

    It takes a third of the time of numpy's cosine on processors with wide vectors.
    """
    half = np.tan(0.5 * x)
    return np.asarray(2.0 / (1.0 + half * half) - 1.0)

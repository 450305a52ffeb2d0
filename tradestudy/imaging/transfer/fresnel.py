"""Diffraction and defocus together, in Fresnel's approximation: the autocorrelation of the pupil."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.errors import UnaffordableError
from tradestudy.imaging.transfer.diffraction import airy_transfer
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.quadrature import gauss_legendre

_MOST_NODES = 2000
_STEP = 8  # so that few rules serve all pictures
_AT_ONCE = 16_000  # values: enough to keep the loop cheap, few enough for a processor's cache


def fresnel_transfer(
    frequency: ArrayLike, wavelength: float, f_number: ArrayLike, blur_diameter: ArrayLike
) -> FloatArray:
    """Transfer of a circular pupil out of focus: ``(4/π) ∫₀^{arccos s} sin²φ cos(α (cos φ − s)) dφ``.

    s = λ N ν and α = π c ν (1/s) s = 4 k W₂₀ s, with the defocus W₂₀ = c/(8 N) at the rim of the pupil.

    Parameters
    ----------
    frequency
        ν ≥ 0 [cycles/m].
    wavelength
        λ [m].
    f_number
        Working f-number N.
    blur_diameter
        c ≥ 0 [m]: diameter of the geometric blur, which says how far out of focus the plane is.

    Returns
    -------
    FloatArray
        Broadcast over the last three; `airy_transfer` at c = 0, `disc_transfer` for c ≫ λ N; 0 beyond the cut-off.
        Gauss–Legendre with nodes for the largest phase: rounding only, 1e-14.

    Raises
    ------
    UnaffordableError
        For a defocus of more than about a thousand waves.

    References
    ----------
    H. H. Hopkins, "The frequency response of a defocused optical system", Proc. R. Soc. A 231, 91 (1955).
    """
    nu, N, c = (np.asarray(value, dtype=np.float64) for value in (frequency, f_number, blur_diameter))
    if not np.any(c):
        return airy_transfer(np.broadcast_to(nu, np.broadcast_shapes(nu.shape, c.shape)), wavelength, N)
    with np.errstate(invalid="ignore"):  # 0 ∞ is NaN, which is the answer there
        # At the cut-off the two sheared pupils part and the integral is empty; so it is beyond.
        s, alpha = np.minimum(wavelength * N * nu, 1.0), np.pi * (c * nu)
    return _within_the_cutoff(s, alpha)


def _within_the_cutoff(s: FloatArray, alpha: FloatArray) -> FloatArray:
    """The integral for s ≤ 1, broadcast; what depends on s alone is computed in its own shape.

    The phase between the two sheared pupils is k (W(x + s) − W(x − s)) = 4 k W₂₀ s x = α x.
    """
    phase = alpha * (1.0 - s)
    largest = float(np.max(phase, initial=0.0, where=~np.isnan(phase)))
    needed = 10.0 + 1.2 * math.sqrt(largest) + 0.42 * largest  # for 14 digits, by trial up to 2000 rad
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
    """cos x = 2/(1 + tan² x/2) − 1, to the last digit but one: numpy has the tangent in vectors, the cosine has it not.

    That takes a third of the time where the processor has wide vectors.
    """
    half = np.tan(0.5 * x)
    return np.asarray(2.0 / (1.0 + half * half) - 1.0)

"""Band-limited samples to a finer grid: a sinc under a Kaiser window, one axis at a time."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.special

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.propagation.direct import ComplexArray

_LEAST_OVERSAMPLING = 1.7  # of the coarse samples; nearer to 1 the window gets wide


@dataclass(frozen=True, kw_only=True)
class Upsampling:
    """Coarse samples of one axis, and the matrix from them to the fine ones.

    Attributes
    ----------
    step
        Fine samples per coarse one; 1 where nothing is to be gained.
    first, count
        The coarse samples lie at fine indices ``first + step * arange(count)``; they overhang the fine ones.
    matrix
        Fine from coarse, shape (fine, count).
    """

    step: int
    first: int
    count: int
    matrix: FloatArray


def upsampling(*, fine_count: int, oversampling: float, tolerance: float) -> Upsampling | None:
    """Plan for an axis whose `fine_count` samples are `oversampling` times finer than Nyquist's; None if no gain.

    The window's half-width in coarse samples is ln(1/tolerance)/(π (1 − 1/σ)) for coarse samples σ times finer than
    Nyquist's (J. J. Knab, "Interpolation of band-limited functions using the approximate prolate series", 1979).
    """
    step = int(oversampling / _LEAST_OVERSAMPLING) if math.isfinite(oversampling) else fine_count
    if step < 2:
        return None
    gap = 1 - step / oversampling
    half = math.ceil(math.log(1 / tolerance) / (math.pi * gap)) + 1
    count = math.ceil((fine_count - 1) / step) + 1 + 2 * half
    if count > 0.7 * fine_count:
        return None
    first = -half * step
    distance = (np.arange(fine_count)[:, None] - (first + step * np.arange(count))) / step
    window = np.sqrt(np.clip(1 - (distance / half) ** 2, 0.0, None))
    shape = math.pi * half * gap
    kernel = np.sinc(distance) * scipy.special.i0(shape * window) / scipy.special.i0(shape)
    return Upsampling(step=step, first=first, count=count, matrix=np.where(np.abs(distance) <= half, kernel, 0.0))


def apply_along_rows(matrix: FloatArray, values: ComplexArray) -> ComplexArray:
    """Real matrix times complex array, without turning the matrix complex."""
    plain = np.ascontiguousarray(values).view(np.float64)
    return np.asarray((matrix @ plain).view(np.complex128))

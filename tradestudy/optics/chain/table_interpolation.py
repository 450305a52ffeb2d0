"""Interpolation of a complex table by the kernel of a nonuniform Fourier transform.

The kernel is a prolate wave function made for waves of a known band. It follows them close to the sampling limit, where
splines fail, and finufft evaluates it several times faster. As with splines, coefficients reproduce the table.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import finufft
import numpy as np
import scipy.fft

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.phasors import ComplexArray

_WIDEST = 16  # half width of the widest kernel [samples]
_FINEST, _COARSEST = 1e-7, 1e-3
_SINGLE_FROM = 2e-5  # tolerance from which on 32-bit numbers are exact enough
_SETTLING = 128  # samples within which coefficients settle


@dataclass(frozen=True)
class TableKernel:
    """Kernel for one band and tolerance.

    Attributes
    ----------
    oversampling
        Oversampling of the waves relative to Nyquist's rate, > 1.
    tolerance
        Error allowed relative to the waves, in 1e-7 … 1e-3.
    """

    oversampling: float
    tolerance: float

    @classmethod
    def within(cls, oversampling: float, tolerance: float) -> TableKernel:
        """Kernel made for the tolerance nearest to the one requested."""
        return cls(oversampling, min(max(tolerance, _FINEST), _COARSEST))

    @property
    def single(self) -> bool:
        """Whether 32-bit numbers are exact enough."""
        return self.tolerance >= _SINGLE_FROM

    @property
    def end_effect(self) -> int:
        """Samples at each end of a table where the coefficients have not settled to the tolerance."""
        settled = np.abs(np.fft.ifft(1 / _response(self, 2 * math.pi * np.arange(_SETTLING) / _SETTLING)))
        return int(np.argmax(settled[: _SETTLING // 2] <= self.tolerance * settled[0]))

    def coefficients(self, table: ComplexArray) -> ComplexArray:
        """Coefficients with which the kernel reproduces a table, mirrored at its ends."""
        along = [_response(self, math.pi * np.arange(count) / (count - 1)) for count in table.shape]
        spectrum = scipy.fft.dctn(table, type=1)
        spectrum /= np.multiply.outer(*along)
        found = scipy.fft.idctn(spectrum, type=1, overwrite_x=True)
        return np.asarray(found.astype(np.complex64 if self.single else np.complex128))

    def interpolated(self, coefficients: ComplexArray, rows: FloatArray, columns: FloatArray) -> ComplexArray:
        """Values at positions counted in samples from the first one; zero outside the table."""
        last_row, last_column = (count - 1 for count in coefficients.shape)
        turns = [
            2 * math.pi / count * at.ravel() - math.pi
            for count, at in zip(coefficients.shape, (rows, columns), strict=True)
        ]
        values = _summed(self, coefficients, *turns).reshape(rows.shape)
        beyond = (np.minimum(rows, columns) < 0) | (rows > last_row) | (columns > last_column)
        if beyond.any():
            values[beyond] = 0.0
        return values


def fast_count(least: float) -> int:
    """Smallest side of a table, in samples, that is no less than `least` and whose coefficients are found fast.

    It spans at least two of the widest kernels, without which no position can be read.
    """
    return int(scipy.fft.next_fast_len(max(math.ceil(least) - 1, 2 * _WIDEST), real=True)) + 1


def _summed(kernel: TableKernel, coefficients: ComplexArray, y: FloatArray, x: FloatArray) -> ComplexArray:
    """Sum of the kernel times the coefficients about each position, given in radians of a turn about the middle."""
    real = np.float32 if coefficients.dtype == np.complex64 else np.float64
    return np.asarray(
        finufft.nufft2d2(
            y.astype(real),
            x.astype(real),
            coefficients,
            eps=kernel.tolerance,
            upsampfac=kernel.oversampling,
            spreadinterponly=1,
            spread_sort=0,  # positions are sorted
            nthreads=1,
        )
    )


def _response(kernel: TableKernel, phases: FloatArray) -> FloatArray:
    """Factor by which the kernel changes waves of a given phase per sample."""
    whole = _at_whole_samples(kernel)
    turns = np.multiply.outer(phases, np.arange(1, whole.size))
    return np.asarray(whole[0] + 2.0 * np.cos(turns) @ whole[1:])


@lru_cache(maxsize=16)
def _at_whole_samples(kernel: TableKernel) -> FloatArray:
    """Kernel at whole samples from its middle outwards, along one axis."""
    one = np.zeros((4 * _WIDEST, 4 * _WIDEST), dtype=np.complex64 if kernel.single else np.complex128)
    one[2 * _WIDEST, 2 * _WIDEST] = 1.0
    away = 2 * math.pi / len(one) * np.arange(_WIDEST, dtype=np.float64)
    along = _summed(kernel, one, away, np.zeros_like(away)).real.astype(np.float64)
    return np.asarray(along / math.sqrt(along[0]))

"""Few samples of a band-limited field to a finer grid, one axis at a time: windowed sinc, or Chebyshev points."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy.special

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.propagation.direct import ComplexArray
from tradestudy.optics.propagation.sampling import bessel_margin
from tradestudy.optics.propagation.targets import TargetGrid

_UNTHREADED = 250_000  # multiplications in one product that BLAS does on one thread
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


@lru_cache(maxsize=16)  # both axes of a square grid, and every wave on the same grid, share one
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
    matrix = np.where(np.abs(distance) <= half, kernel, 0.0)
    matrix.setflags(write=False)
    return Upsampling(step=step, first=first, count=count, matrix=matrix)


def apply_along_rows(matrix: FloatArray, values: ComplexArray) -> ComplexArray:
    """Real matrix times complex array, without turning the matrix complex.

    In blocks below the size from which BLAS starts threads: for products this small they cost more than they save,
    and very much more where cores are shared.
    """
    plain = np.ascontiguousarray(values).view(np.float64)
    product = np.empty((matrix.shape[0], plain.shape[1]))
    rows = max(1, _UNTHREADED // plain.size)
    for start in range(0, matrix.shape[0], rows):
        np.matmul(matrix[start : start + rows], plain, out=product[start : start + rows])
    return np.asarray(product.view(np.complex128))


def chebyshev_points(values: FloatArray, count: int) -> FloatArray:
    """Chebyshev points of the first kind on the range of `values`."""
    middle, half = 0.5 * (values.min() + values.max()), 0.5 * np.ptp(values)
    return np.asarray(middle + half * _unit_chebyshev(count))


@lru_cache(maxsize=32)
def _unit_chebyshev(count: int) -> FloatArray:
    return np.cos(np.pi * (np.arange(count) + 0.5) / count)


def lagrange(values: FloatArray, count: int, box: FloatArray | None = None) -> FloatArray:
    """Values of the Lagrange polynomials of the Chebyshev points, shape (values, count).

    By the barycentric formula, which stays accurate next to a point, where one term outweighs all others
    (N. J. Higham, "The numerical stability of barycentric Lagrange interpolation", 2004).
    """
    over = values if box is None else box
    if count == 1:
        return np.ones((values.size, 1))
    difference = np.subtract.outer(values, chebyshev_points(over, count))
    hits = np.argwhere(difference == 0)
    difference[tuple(hits.T)] = 1.0
    order = np.arange(count)
    weights = np.where(order % 2 == 0, 1.0, -1.0) * np.sin(np.pi * (order + 0.5) / count)
    terms = weights / difference
    terms /= terms.sum(axis=1, keepdims=True)
    for row, column in hits:
        terms[row] = order == column
    return terms


@dataclass(frozen=True, kw_only=True)
class ChebyshevGrid:
    """Chebyshev points in the box of a grid, for fields that can be evaluated anywhere.

    Attributes
    ----------
    x, y
        Points of each axis [m].
    on_x, on_y
        Matrices from the points to the columns and rows of the grid.
    """

    x: FloatArray
    y: FloatArray
    on_x: FloatArray
    on_y: FloatArray

    def points(self) -> tuple[FloatArray, FloatArray]:
        """Flat positions of the tensor product, x running fastest."""
        return np.tile(self.x, self.y.size), np.repeat(self.y, self.x.size)

    def interpolate(self, values: ComplexArray) -> ComplexArray:
        """From values at `points` to the grid."""
        rows = apply_along_rows(self.on_y, values.reshape(self.y.size, self.x.size))
        return apply_along_rows(self.on_x, rows.T).T


def chebyshev_grid(grid: TargetGrid, *, wavenumber: float, tolerance: float) -> ChebyshevGrid | None:
    """Chebyshev points enough for a field of at most `wavenumber` [rad/m] along each axis; None if no gain.

    A plane wave of m radians over half the axis needs as many points as a Bessel function of argument m has orders
    above the tolerance.
    """
    counts = [
        max(2, math.ceil(turns + bessel_margin(turns, tolerance)))
        for turns in (
            wavenumber * grid.x_pitch * (grid.x_count - 1) / 2,
            wavenumber * grid.y_pitch * (grid.y_count - 1) / 2,
        )
    ]
    if counts[0] * counts[1] > 0.7 * grid.x_count * grid.y_count or min(grid.x_count, grid.y_count) < 2:
        return None
    x, y = grid.x_axis, grid.y_axis
    return ChebyshevGrid(
        x=chebyshev_points(x, counts[0]),
        y=chebyshev_points(y, counts[1]),
        on_x=lagrange(x, counts[0]),
        on_y=lagrange(y, counts[1]),
    )

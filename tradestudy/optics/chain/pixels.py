"""Integration of a finely sampled intensity over square pixels, or one sample of it for each."""

from __future__ import annotations

import math

import numpy as np

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain.scene import PixelGrid

MARGIN = 3  # samples beyond the window on each side that the correction needs
_CELL_AVERAGE = ((0.0, 1 / 24, -17 / 5760, 367 / 967680), (0.0, 1 / 24, -17 / 5760, 0.0))


def refuse_pixel_centres(grid: PixelGrid) -> None:
    """Refuse rays at the centres of pixels.

    Raises
    ------
    OutOfRangeError
        If pixels are not to integrate.
    """
    if not grid.integrated:
        raise OutOfRangeError(
            "rays at the centre of a pixel",
            value="not integrated, with rays behind the microlenses",
            limit="rays come as areas over whole pixels",
            remedy="integrate over pixels, or use waves",
        )


def samples_per_pixel(grid: PixelGrid, needed: float) -> int:
    """At least three along a pixel; an odd number where the one at its centre is asked for."""
    count = max(3, math.ceil(needed))
    return count if grid.integrated else count + 1 - count % 2


def light_on_pixels(intensity: FloatArray, grid: PixelGrid, *, per_pixel: int) -> tuple[FloatArray, float]:
    """Integrals over pixels and their relative L2 error as `integrate_pixels` has it, or centre samples, without."""
    spacing = grid.pitch / per_pixel
    if grid.integrated:
        return integrate_pixels(intensity, per_pixel=per_pixel, spacing=spacing)
    first, (rows, columns) = MARGIN + per_pixel // 2, grid.shape
    centres = intensity[first::per_pixel, first::per_pixel][:rows, :columns]
    return np.asarray(centres * grid.pitch**2, dtype=np.float64), 0.0


def integrate_pixels(intensity: FloatArray, *, per_pixel: int, spacing: float) -> tuple[FloatArray, float]:
    """Integrate samples at cell centres over pixels of ``per_pixel``² cells; also say how much the last term changed.

    The mean over a cell is the sample plus δ²/24 − 17 δ⁴/5760 + 367 δ⁶/967680 along each axis, δ the central
    difference.

    Parameters
    ----------
    intensity
        Samples, shape (rows·per_pixel + 6, columns·per_pixel + 6): three more on every side.
    per_pixel
        Samples along a pixel.
    spacing
        Distance of samples [m].

    Returns
    -------
    tuple
        Integrals, shape (rows, columns), and the relative L2 change by the last term: the error of the one before.
    """
    best, lower = (
        _summed(_averaged(_averaged(intensity, terms, 0), terms, 1), per_pixel) * spacing**2 for terms in _CELL_AVERAGE
    )
    change = float(np.linalg.norm(best - lower))
    return best, change / float(np.linalg.norm(best)) if change > 0 else 0.0  # no light is no error


def _averaged(samples: FloatArray, terms: tuple[float, ...], axis: int) -> FloatArray:
    """Mean over the cell about each sample along one axis; three samples are used up on each side."""
    moved = np.moveaxis(samples, axis, 0)
    difference, result = moved, moved[MARGIN:-MARGIN].copy()
    for order, term in enumerate(terms):
        if order:
            difference = difference[2:] - 2 * difference[1:-1] + difference[:-2]
            cut = MARGIN - order
            result += term * (difference[cut : difference.shape[0] - cut])
    return np.moveaxis(result, 0, axis)


def _summed(cells: FloatArray, per_pixel: int) -> FloatArray:
    """Sum blocks of cells."""
    rows, columns = cells.shape[0] // per_pixel, cells.shape[1] // per_pixel
    return np.asarray(cells.reshape(rows, per_pixel, columns, per_pixel).sum(axis=(1, 3)))

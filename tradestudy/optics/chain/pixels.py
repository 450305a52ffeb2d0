"""Light on square pixels: integrals of finely sampled intensity, and far light, beyond the sampled patches.

Conservation of energy gives the amount of far light, and the wave from the rim of an aperture its distribution. That
wave brings an irradiance ∝ 1/d² at the distance d from the edge of the rays' disc, and two points of the rim send light
to every point. Averaged over the fringes, E(r) ∝ [1/(r − a)² + 1/(r + a)²]/r about a disc of radius a. In focus a = 0,
and the law is Airy's: a circular lens sends the share 2/(π v) beyond v = 2π R r/(λ b). Interference between different
microlenses averages out there over the points of a source.
"""

from __future__ import annotations

import math

import numpy as np

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain.scene import PixelGrid

MARGIN = 3  # samples beyond the window on each side that the correction needs
_CELL_AVERAGE = ((1.0, 1 / 24, -17 / 5760, 367 / 967680), (1.0, 1 / 24, -17 / 5760, 0.0))
_STEEPNESS = 4.0  # samples between the edge of the rays and the edge of the patch, where the law is steepest


def refuse_pixel_centres(grid: PixelGrid) -> None:
    """Refuse rays at the centres of pixels.

    Raises
    ------
    OutOfRangeError
        If the pixels do not integrate.
    """
    if not grid.integrated:
        raise OutOfRangeError(
            "rays at the centre of a pixel",
            value="rays behind the microlenses",
            limit="integrals over whole pixels",
            remedy="integrate over pixels, or use waves",
        )


def samples_per_pixel(grid: PixelGrid, needed: float) -> int:
    """Samples along a pixel, at least three; an odd number if the pixel uses only the one at its centre."""
    count = max(3, math.ceil(needed))
    return count if grid.integrated else count + 1 - count % 2


def light_on_pixels(intensity: FloatArray, grid: PixelGrid, *, per_pixel: int) -> tuple[FloatArray, float]:
    """Integrals over pixels with their relative L2 error by `integrate_pixels`, or centre samples with error 0."""
    spacing = grid.pitch / per_pixel
    if grid.integrated:
        return integrate_pixels(intensity, per_pixel=per_pixel, spacing=spacing)
    first, (rows, columns) = MARGIN + per_pixel // 2, grid.shape
    centres = intensity[first::per_pixel, first::per_pixel][:rows, :columns]
    return np.asarray(centres * grid.pitch**2, dtype=np.float64), 0.0


def integrate_pixels(intensity: FloatArray, *, per_pixel: int, spacing: float) -> tuple[FloatArray, float]:
    """Integrate samples at cell centres over pixels of ``per_pixel``² cells; the last term of the rule gives the error.

    The mean over a cell is the sample plus δ²/24 − 17 δ⁴/5760 + 367 δ⁶/967680 along each axis, where δ is the central
    difference.

    Parameters
    ----------
    intensity
        Samples, shape (rows·per_pixel + 6, columns·per_pixel + 6): three extra on every side.
    per_pixel
        Samples along a pixel.
    spacing
        Distance between samples [m].

    Returns
    -------
    tuple
        Integrals, shape (rows, columns), and their relative L2 change by the last term: the error without it.
    """
    best, lower = (
        _over_pixels(_over_pixels(intensity, weights, per_pixel).T, weights, per_pixel).T * spacing**2
        for weights in (np.convolve(_cell_average(terms), np.ones(per_pixel)) for terms in _CELL_AVERAGE)
    )
    change = float(np.linalg.norm(best - lower))
    return best, change / float(np.linalg.norm(best)) if change > 0 else 0.0  # no light, no error


def _cell_average(terms: tuple[float, ...]) -> FloatArray:
    """Weights of the samples about a cell, `MARGIN` on either side, in the mean over the cell."""
    weights, difference = np.zeros(2 * MARGIN + 1), np.ones(1)
    for order, term in enumerate(terms):
        weights[MARGIN - order : MARGIN + order + 1] += term * difference
        difference = np.convolve(difference, [1.0, -2.0, 1.0])
    return weights


def _over_pixels(samples: FloatArray, weights: FloatArray, per_pixel: int) -> FloatArray:
    """Weighted sums of the samples that each pixel reaches, along the first axis."""
    count = (samples.shape[0] - 2 * MARGIN) // per_pixel
    total = np.zeros((count, *samples.shape[1:]))
    for first, weight in enumerate(weights):
        total += weight * samples[first : first + per_pixel * count : per_pixel]
    return total


def far_light(
    grid: PixelGrid, middles: FloatArray, half_side: float, power: FloatArray, radii: FloatArray
) -> FloatArray:
    """Distribute the light that leaves square patches over the pixels outside, by the law of an edge.

    Parameters
    ----------
    grid
        The detector.
    middles
        Middles (x, y) of the patches [m], shape (n, 2).
    half_side
        Half the side of a patch [m].
    power
        Power that leaves each patch, shape (n,); most of it misses the detector.
    radii
        Radius of the disc of rays in each patch, less than half its side [m], shape (n,).

    Returns
    -------
    ndarray
        Power on every pixel, shape (rows, columns).
    """
    # Each sample represents a part of a pixel, and belongs to a patch if its middle does.
    parts = max(1, math.ceil(_STEEPNESS * grid.pitch / float(np.min(half_side - radii, initial=math.inf))))
    spacing = grid.pitch / parts
    x, y = (edges[0] + spacing * (np.arange(parts * (edges.size - 1)) + 0.5) for edges in (grid.edges_x, grid.edges_y))
    total = np.zeros((y.size, x.size))
    outside = _outside_square(half_side, radii)
    for (middle_x, middle_y), radius, share in zip(middles, radii, power / outside, strict=True):
        across, along = np.abs(x - middle_x), np.abs(y - middle_y)[:, None]
        beyond = np.maximum(across, along) > half_side
        squared = (across**2 + along**2)[beyond]
        law = (squared + radius**2) / (np.sqrt(squared) * (squared - radius**2) ** 2)
        total[beyond] += share * spacing**2 * law
    rows, columns = grid.shape
    return np.asarray(total.reshape(rows, parts, columns, parts).sum(axis=(1, 3)))


def _outside_square(half_side: float, radii: FloatArray) -> FloatArray:
    """∬ (r² + a²)/(r (r² − a²)²) dx dy outside a square of half side H [1/m].

    Along a radius, the integral of (r² + a²)/(r² − a²)² is −r/(r² − a²); around an eighth of the square there remains ∫
    H ds/(H² − a² + a² s²) over the sine s of the azimuth, up to 1/√2.
    """
    rest = half_side**2 - radii**2
    turn = radii / np.sqrt(2.0 * rest)
    slowed = np.divide(np.arctan(turn), turn, out=np.ones_like(turn), where=turn > 0)
    return np.asarray(8.0 * half_side / (np.sqrt(2.0) * rest) * slowed)

"""Light that an edge throws farther than it is followed: known in amount by energy, in shape by its law.

Far from where rays land, the wave from the rim of an aperture brings an irradiance ∝ 1/d² of the distance d from the
edge of the rays' disc, and two points of the rim send light to every point: on average over the fringes
E(r) ∝ [1/(r − a)² + 1/(r + a)²]/r about a disc of radius a. In focus a = 0 and the law is Airy's: of a circular lens
the share 2/(π v) falls beyond v = 2π R r/(λ b). Microlenses interfere there as well, which the points of a source
average out.
"""

from __future__ import annotations

import math

import numpy as np

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain.scene import PixelGrid

_STEEPNESS = 4.0  # samples along the way from the edge of the rays to that of the patch, where the law is steepest


def far_light(
    grid: PixelGrid, middles: FloatArray, half_side: float, power: FloatArray, radii: FloatArray
) -> FloatArray:
    """Spread what leaves square patches over the pixels beyond them, by the law of an edge.

    Parameters
    ----------
    grid
        The detector.
    middles
        Middles (x, y) of the patches [m], shape (n, 2).
    half_side
        Half the side of a patch [m].
    power
        What leaves each patch, of which most misses the detector, shape (n,).
    radii
        Of the disc of rays in each patch, less than half its side [m], shape (n,).

    Returns
    -------
    ndarray
        Power on every pixel, shape (rows, columns).
    """
    # Each sample stands for a part of a pixel, and belongs to a patch if its middle does.
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

    Along a radius the integral of (r² + a²)/(r² − a²)² is −r/(r² − a²); around an eighth of the square what is left is
    ∫ H ds/(H² − a² + a² s²) over the sine s of the azimuth, up to 1/√2.
    """
    rest = half_side**2 - radii**2
    turn = radii / np.sqrt(2.0 * rest)
    slowed = np.divide(np.arctan(turn), turn, out=np.ones_like(turn), where=turn > 0)
    return np.asarray(8.0 * half_side / (np.sqrt(2.0) * rest) * slowed)

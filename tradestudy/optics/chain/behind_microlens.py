"""The pixels behind each microlens, and how finely the light on them is modulated."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from tradestudy.optics.arrays import FloatArray, IndexArray
from tradestudy.optics.chain.scene import LightPath, PixelGrid

_EQUALLY_NEAR = 4  # largest number of microlenses equally near to a pixel, on a square array


def nearest_microlens(path: LightPath) -> IndexArray:
    """Index of each pixel's microlens, shape (rows, columns): the one whose projected centre is nearest."""
    x, y = pixel_centres(path.pixels)
    projected = path.microlenses.centres * projection(path)
    pixels = np.stack(np.broadcast_arrays(x, y[:, None]), axis=-1)
    distance, index = cKDTree(projected).query(pixels, k=np.arange(1, 1 + min(_EQUALLY_NEAR, len(projected))))
    # A slight preference for the first, so that rounding does not decide for pixels midway between two.
    first = np.argmin(distance + 1e-9 * path.microlenses.pitch * index, axis=-1)
    return np.asarray(np.take_along_axis(index, first[..., None], axis=-1)[..., 0])


def projection(path: LightPath) -> float:
    """Size of the array projected from the centre of the main lens onto the detector, over its size: 1 + b_L/z."""
    return 1.0 + path.detector_distance / path.array_distance


def pixel_centres(grid: PixelGrid) -> tuple[FloatArray, FloatArray]:
    """Centres of the columns along x and of the rows along y [m]."""
    x, y = (np.asarray((edge[1:] + edge[:-1]) / 2) for edge in (grid.edges_x, grid.edges_y))
    return x, y


def fourier_sum(pixels: FloatArray, grid: PixelGrid, frequency: FloatArray, angle: float) -> FloatArray:
    """Magnitude of Σ p exp(−2πi f·x) over the pixels p, in the shape of the frequencies f [1/m] along a direction."""
    along_x, along_y = (
        np.exp(-2j * np.pi * np.multiply.outer(frequency.ravel() * share, centres))
        for share, centres in zip((np.cos(angle), np.sin(angle)), pixel_centres(grid), strict=True)
    )
    return np.asarray(np.abs(np.einsum("fr,fr->f", along_y, along_x @ pixels.T))).reshape(frequency.shape)

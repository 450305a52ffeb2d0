"""What samples add to the band from beyond it: replicas of a radial spectrum, as weights of its values."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from tradestudy.imaging.matching_bound import BandNodes
from tradestudy.imaging.transfer import square_transfer
from tradestudy.optics.arrays import FloatArray

REPLICAS = 3
"""How many replicas of the spectrum are summed to every side, each one by itself."""
_RADII = 193


def alias_radii() -> FloatArray:
    """Radii [cycles/sample] between which everything that the replicas reach lies."""
    return np.linspace(0.5, (REPLICAS + 0.5) * np.sqrt(2.0), _RADII)


@lru_cache(maxsize=64)
def alias_weights(nodes: BandNodes, width: float, every: int) -> FloatArray:
    """What every replica of a radial spectrum adds at the nodes, as weights of its values at the alias radii.

    Linear between the radii, of which each ``every``-th counts, times the pixel's square transfer.
    """
    radii = alias_radii()[::every]
    step = radii[1] - radii[0]
    shifts = np.arange(-REPLICAS, REPLICAS + 1)[:, np.newaxis]
    x, y = nodes.x + shifts, nodes.y + shifts
    beside = np.delete(np.arange(shifts.size**2), shifts.size**2 // 2)  # the middle one is no replica
    position = (np.hypot(x, y[:, np.newaxis]).reshape(-1, nodes.x.size)[beside] - radii[0]) / step
    below = np.clip(position.astype(np.intp), 0, radii.size - 2)
    # A square's transfer is a product of one along x and one along y.
    along = square_transfer(x, 0.0, width) * square_transfer(0.0, y, width)[:, np.newaxis]
    share, passed = position - below, np.square(along.reshape(-1, nodes.x.size)[beside])
    place = below * nodes.x.size + np.arange(nodes.x.size)  # in the matrix, row by row
    places = np.concatenate([place, place + nodes.x.size])
    weights = np.concatenate([(1.0 - share) * passed, share * passed])
    matrix = np.bincount(places.ravel(), weights.ravel(), radii.size * nodes.x.size).reshape(radii.size, -1)
    matrix.setflags(write=False)
    return np.asarray(matrix, dtype=np.float64)


@lru_cache(maxsize=64)
def ring_weights(width: float) -> FloatArray:
    """The mean over the outermost ring of alias radii and over directions, the pixel's square transfer included."""
    radii = alias_radii()
    angle = np.linspace(0.0, np.pi / 2.0, 33)
    seen = np.square(square_transfer(np.outer(radii, np.cos(angle)), np.outer(radii, np.sin(angle)), width))
    ring = radii > REPLICAS
    weights = np.where(ring, seen.mean(axis=1), 0.0) / np.count_nonzero(ring)
    weights.setflags(write=False)
    return weights

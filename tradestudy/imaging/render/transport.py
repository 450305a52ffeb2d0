"""Nodes that represent a spread of light, transported from the nodes of a disc."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.two_apertures import Spread

_LAGS: Final = 24
_WIDTHS: Final = 33


def disc_quantiles(disc: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Fractions of the unit disc to the left of each node, and of its column above it; shape (nodes,) each.

    ``½ + (a √(1 − a²) + arcsin a)/π`` and ``½ (1 + b/√(1 − a²))``.
    """
    across, beside = disc.T
    height = np.sqrt(np.maximum(1.0 - across * across, 1e-12))
    left = 0.5 + (across * height + np.arcsin(across)) / math.pi
    return left, np.clip(0.5 * (1.0 + beside / height), 0.0, 1.0)


def transported(spread: Spread, left: FloatArray, above: FloatArray) -> FloatArray:
    """Places [1/m] with given fractions of a spread to their left, and above them in their own column.

    For uniform discs of different size the map is a scaling (H. Knothe, Michigan Math. J. 4, 39, 1957).

    Parameters
    ----------
    spread
        The spread.
    left, above
        Results of `disc_quantiles`, shape (nodes,).

    Returns
    -------
    FloatArray
        Shape (nodes, 2).
    """
    place = spread.place
    step = place[1] - place[0]
    edges = np.append(place, place[-1] + step) - step / 2.0
    x = _place_of(left[None], spread.sums[:1], edges)[0]
    column = np.clip((x - place[0]) / step, 0.0, place.size - 1.001)
    first = column.astype(np.intp)
    share = (column - first)[:, None]
    needed, number = np.unique(np.concatenate([first, first + 1]), return_inverse=True)
    before, after = spread.columns(needed)[number.reshape(2, -1)]
    y = _place_of(above[:, None], (1.0 - share) * before + share * after, edges)[:, 0]
    return np.stack([x, y], axis=-1)


def _place_of(share: FloatArray, density: FloatArray, edges: FloatArray) -> FloatArray:
    """Positions with given fractions of a row's sum to their left, shape (rows, fractions)."""
    total = np.cumsum(density, axis=1)
    total = np.concatenate([np.zeros_like(total[:, :1]), total], axis=1)
    return np.stack([np.interp(own * all_of[-1], all_of, edges) for own, all_of in zip(share, total, strict=True)])


def transfer(spread: Spread, band: float) -> FloatArray:
    """Transfer functions of a spread along x and y, at the frequencies of `filter_width`; shape (2, frequencies)."""
    wave = np.exp(-2j * np.pi * np.multiply.outer(_frequencies(band), spread.place))
    return np.asarray(spread.sums @ wave.T)


def filter_width(whole: FloatArray, nodes: FloatArray, band: float) -> float:
    """Standard deviation of the Gaussian that, placed on every node, best approximates a spread.

    It is the best fit to the transfer functions along both axes up to a band, with frequencies weighted by ν⁻², for the
    spectra of textures and the number of frequencies.

    Parameters
    ----------
    whole
        `transfer` of the spread.
    nodes
        Equally weighted places that represent the spread, shape (nodes, 2).
    band
        Highest frequency [1/unit of place].
    """
    frequency = _frequencies(band)
    by_nodes = np.exp(-2j * np.pi * frequency[:, None] * nodes.T[:, None]).mean(axis=-1)
    widest = float(np.max(np.std(nodes, axis=0)))
    widths = widest * np.linspace(0.0, 1.5, _WIDTHS)
    gauss = np.exp(-2.0 * np.square(np.pi * np.multiply.outer(widths, frequency)))[:, None]
    miss = np.sum(np.square(np.abs(whole - by_nodes * gauss)) / np.square(frequency), axis=(1, 2))
    return float(widths[np.argmin(miss)])


def _frequencies(band: float) -> FloatArray:
    return np.asarray(band * (np.arange(_LAGS) + 0.5) / _LAGS)

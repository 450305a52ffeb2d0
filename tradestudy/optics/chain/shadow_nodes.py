"""Quadrature nodes of a microlens that the edge of a shadow cuts, fitted to what of it is lit."""

from __future__ import annotations

import math

import numpy as np

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain.microlens_nodes import CellNodes
from tradestudy.optics.chain.regions import Disc, Region, aperture_region, cell_region, on_segments, pieces, resolving
from tradestudy.optics.chain.scene import Microlenses


def lit_share(lenses: Microlenses, shadow: Disc) -> FloatArray:
    """How each microlens's cell lies to the lit disc, shape (lenses,): 1 inside, 0 beside, 0.5 cut by its edge."""
    apart = np.hypot(lenses.centres[:, 0] - shadow.x, lenses.centres[:, 1] - shadow.y)
    inside = apart + lenses.cell_reach <= shadow.radius
    beside = apart - lenses.cell_reach >= shadow.radius
    return np.where(inside, 1.0, np.where(beside, 0.0, 0.5))


def lit_nodes(lenses: Microlenses, lit: Disc, *, cycles: float) -> CellNodes:
    """Nodes on the part of a cell inside a disc given relative to its centre; none where nothing is lit.

    The part is cut into columns between the corners of its outline, where the integrand is as smooth as the wave:
    the rule converges as fast as that of a whole aperture, however the edge cuts it.

    Parameters
    ----------
    lenses
        Shapes of aperture and cell.
    lit
        Disc outside which there is no light, relative to the centre of the microlens.
    cycles
        Cycles over a half width of the aperture of the plane wave that the nodes integrate, as for `cell_nodes`.
    """
    frequency = cycles / (lenses.aperture_width / 2)
    aperture = aperture_region(lenses, 0.0, 0.0)
    outlines = [aperture]
    if lenses.gaps == "clear":
        outlines.append(cell_region(lenses, 0.0, 0.0))
    breaks = np.concatenate(
        [lit.breaks, *(part for one in outlines for part in (one.breaks, one.meeting(lit)))]
        + ([outlines[1].meeting(aperture)] if isinstance(aperture, Disc) and len(outlines) > 1 else [])
    )
    outer = outlines[-1]
    low, high = (float(f([g(outer.breaks), g(lit.breaks)])) for f, g in ((max, np.min), (min, np.max)))
    if high <= low:
        return _joined([])
    start, stop = pieces(breaks, low, high)
    count = resolving(math.pi / 2 * (stop - start), frequency)
    columns = on_segments(start, stop, count, bend=np.ones(start.shape, dtype=bool))
    x = columns.points
    bottom, top = _common(aperture, lit, x)
    parts = [_in_columns(x, columns.weights, bottom, top, frequency, in_lens=True)]
    if lenses.gaps == "clear":
        under, over = _common(outer, lit, x)
        dark = top <= bottom
        parts.append(_in_columns(x, columns.weights, under, np.where(dark, over, bottom), frequency, in_lens=False))
        parts.append(_in_columns(x, columns.weights, np.where(dark, over, top), over, frequency, in_lens=False))
    return _joined(parts)


def padded(cells: list[CellNodes]) -> CellNodes:
    """Nodes of several cells side by side, shape (cells, nodes); what is missing lies at the centre without weight."""
    most = max(1, *(cell.x.size for cell in cells))
    x, y, weights = (
        np.stack([np.pad(getattr(cell, name), (0, most - cell.x.size)) for cell in cells])
        for name in ("x", "y", "weights")
    )
    in_lens = np.stack([np.pad(cell.in_lens, (0, most - cell.x.size)) for cell in cells])
    return CellNodes(x=x, y=y, weights=weights, in_lens=in_lens)


def _common(one: Region, other: Region, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """What of a column lies in both."""
    (low, high), (lower, upper) = one.span(x), other.span(x)
    return np.maximum(low, lower), np.minimum(high, upper)


def _in_columns(
    x: FloatArray, widths: FloatArray, low: FloatArray, high: FloatArray, frequency: float, *, in_lens: bool
) -> CellNodes:
    """Nodes along y in each column."""
    along = on_segments(low, high, resolving(high - low, frequency))
    return CellNodes(
        x=x[along.owner],
        y=along.points,
        weights=widths[along.owner] * along.weights,
        in_lens=np.full(along.points.size, in_lens),
    )


def _joined(parts: list[CellNodes]) -> CellNodes:
    """All parts as one set."""
    x, y, weights = (
        np.concatenate([np.empty(0), *(getattr(part, name) for part in parts)]) for name in ("x", "y", "weights")
    )
    in_lens = np.concatenate([np.empty(0, dtype=bool), *(part.in_lens for part in parts)])
    return CellNodes(x=x, y=y, weights=weights, in_lens=in_lens)

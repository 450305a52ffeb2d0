"""Apertures and cells of microlenses as regions, and quadrature nodes on them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields
from itertools import pairwise

import numpy as np

from tradestudy.optics.arrays import BoolArray, FloatArray, IndexArray
from tradestudy.optics.chain.scene import Microlenses
from tradestudy.optics.quadrature import QuadratureNodes, disc_nodes, gauss_legendre, rectangle_nodes

_THINNEST = 1e-13  # of the largest segment: thinner ones count as empty


@dataclass(frozen=True, kw_only=True)
class Disc:
    """A disc in the plane."""

    x: float
    y: float
    radius: float

    @property
    def breaks(self) -> FloatArray:
        """Both ends along x [m]."""
        return np.array([self.x - self.radius, self.x + self.radius])

    def span(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest y over x; equal outside the area."""
        half = np.sqrt(np.maximum((self.radius - (x - self.x)) * (self.radius + (x - self.x)), 0.0))
        return self.y - half, self.y + half

    def on_line(self, y: FloatArray) -> FloatArray:
        """Where along x the outline meets horizontal lines."""
        half = np.sqrt(np.maximum(self.radius**2 - (y - self.y) ** 2, 0.0))
        return np.concatenate([self.x - half, self.x + half])

    def meeting(self, disc: Disc) -> FloatArray:
        """Where along x the outline meets that of a disc."""
        apart = math.hypot(disc.x - self.x, disc.y - self.y)
        if not abs(self.radius - disc.radius) < apart < self.radius + disc.radius:
            return np.empty(0)
        # (r² − R²) as a product, since the shadow may be far larger than what it cuts.
        along = (apart + (self.radius - disc.radius) * (self.radius + disc.radius) / apart) / 2
        half = math.sqrt(max(self.radius**2 - along**2, 0.0))
        ex, ey = (disc.x - self.x) / apart, (disc.y - self.y) / apart
        return np.array([self.x + along * ex - half * ey, self.x + along * ex + half * ey])


@dataclass(frozen=True, kw_only=True)
class Cell:
    """A square, or a hexagon with two sides along y, given by its half heights over the corners."""

    x: float
    y: float
    corners: tuple[float, ...]
    heights: tuple[float, ...]

    @property
    def breaks(self) -> FloatArray:
        """Ends and corners."""
        return self.x + np.array(self.corners)

    def span(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest y over x; equal outside the area."""
        half = np.interp(x - self.x, self.corners, self.heights, left=0.0, right=0.0)
        return self.y - half, self.y + half

    def on_line(self, y: FloatArray) -> FloatArray:
        """Where along x the outline meets horizontal lines."""
        crossings = [np.empty(0)]
        for (x0, h0), (x1, h1) in self._sides():
            if h0 != h1:
                t = (np.abs(y - self.y) - h0) / (h1 - h0)
                crossings.append(self.x + x0 + (x1 - x0) * t[(t > 0) & (t < 1)])
        return np.concatenate(crossings)

    def meeting(self, disc: Disc) -> FloatArray:
        """Where along x the outline meets that of a disc."""
        crossings = []
        for (x0, h0), (x1, h1) in self._sides():
            for sign in (1.0, -1.0):
                start = np.array([self.x + x0 - disc.x, self.y + sign * h0 - disc.y])
                step = np.array([x1 - x0, sign * (h1 - h0)])
                a, b = float(step @ step), float(start @ step)
                root = b**2 - a * (float(start @ start) - disc.radius**2)
                if root > 0:
                    crossings += [(-b + s * math.sqrt(root)) / a * (x1 - x0) + self.x + x0 for s in (-1, 1)]
        return np.array(crossings)

    def _sides(self) -> list[tuple[tuple[float, float], tuple[float, float]]]:
        """Upper sides from corner to corner."""
        points = list(zip(self.corners, self.heights, strict=True))
        return list(pairwise(points))


Region = Disc | Cell
"""A convex area."""


def aperture_region(lenses: Microlenses, x: float, y: float) -> Region:
    """Aperture of a microlens centred at (x, y)."""
    half = lenses.aperture_width / 2
    if lenses.aperture == "circular":
        return Disc(x=x, y=y, radius=half)
    return Cell(x=x, y=y, corners=(-half, half), heights=(half, half))


def cell_region(lenses: Microlenses, x: float, y: float) -> Region:
    """Cell of a microlens centred at (x, y)."""
    half = lenses.pitch / 2
    if lenses.layout == "square":
        return Cell(x=x, y=y, corners=(-half, half), heights=(half, half))
    side = half * 2 / math.sqrt(3)
    return Cell(x=x, y=y, corners=(-half, 0.0, half), heights=(side / 2, side, side / 2))


def cell_parts(lenses: Microlenses, focal_length: float, x: float, y: float) -> Iterator[tuple[Region, float, float]]:
    """Regions of a cell at (x, y), each with lens power [1/m] and sign; a clear gap is the cell minus its aperture."""
    aperture = aperture_region(lenses, x, y)
    yield aperture, 1 / focal_length, 1.0
    if lenses.gaps == "clear":
        yield cell_region(lenses, x, y), 0.0, 1.0
        yield aperture, 0.0, -1.0


@dataclass(frozen=True, kw_only=True)
class Segments:
    """Gauss–Legendre nodes on many segments, each with as many as it needs.

    Attributes
    ----------
    points, weights
        Nodes and length weights [m], shape (n,).
    owner
        Segment of each node.
    """

    points: FloatArray
    weights: FloatArray
    owner: IndexArray


def on_segments(low: FloatArray, high: FloatArray, count: IndexArray, *, bend: BoolArray | None = None) -> Segments:
    """Place nodes between `low` and `high`; segments that end before they begin get none.

    Where `bend` is set, nodes are spaced like a sine, so that outlines that end vertically, as √x does, cost no
    accuracy.
    """
    length = high - low
    kept = length > _THINNEST * float(np.max(length, initial=0.0))
    bent = np.zeros(low.shape, dtype=bool) if bend is None else bend
    points, weights, owners = [np.empty(0)], [np.empty(0)], [np.empty(0, dtype=int)]
    for n, bending in {(int(n), bool(b)) for n, b in zip(count[kept], bent[kept], strict=True)}:
        mine = np.flatnonzero(kept & (count == n) & (bent == bending))
        t, w = gauss_legendre(n)
        if bending:
            angle = math.pi * (t - 0.5)
            t, w = (1 + np.sin(angle)) / 2, w * math.pi / 2 * np.cos(angle)
        points.append((low[mine, None] + length[mine, None] * t).ravel())
        weights.append((length[mine, None] * w).ravel())
        owners.append(np.repeat(mine, n))
    return Segments(points=np.concatenate(points), weights=np.concatenate(weights), owner=np.concatenate(owners))


def resolving(length: FloatArray, frequency: float, *, tolerance: float = 1e-6, spare: int = 2) -> IndexArray:
    """Number of nodes that integrate a plane wave of this frequency [1/m] over each length, and `spare` more.

    The wave's degree is its phase z over half a length plus the orders z^⅓ (3/2 ln 1/tolerance)^⅔/2^⅓. Large numbers
    are rounded up by at most an eighth, so that few different rules are needed.
    """
    phase = math.pi * frequency * np.maximum(length, 0.0)
    beyond = np.cbrt((1.5 * math.log(1 / tolerance)) ** 2 / 2 * np.maximum(phase, 1.0))
    count = np.asarray(np.ceil(phase + beyond), dtype=int) // 2 + 1 + spare
    step = np.exp2(np.maximum(np.floor(np.log2(count)) - 3, 0)).astype(int)
    return np.asarray(-(-count // step) * step)


def subintervals(breaks: FloatArray, low: float, high: float) -> tuple[FloatArray, FloatArray]:
    """Beginnings and ends of the parts of an interval between breaks."""
    inside = np.unique(np.concatenate([[low, high], breaks[(breaks > low) & (breaks < high)]]))
    return inside[:-1], inside[1:]


@dataclass(frozen=True, kw_only=True)
class CellNodes:
    """Area rule on one cell, relative to the centre of its microlens; the same for every microlens.

    Attributes
    ----------
    x, y
        Positions [m], shape (n,).
    weights
        Area weights [m²], shape (n,).
    in_lens
        Whether the lens acts there; elsewhere the gap is clear.
    """

    x: FloatArray
    y: FloatArray
    weights: FloatArray
    in_lens: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]


def cell_nodes(lenses: Microlenses, *, cycles: float) -> CellNodes:
    """Place nodes that integrate a plane wave with this many cycles over a half width of the aperture.

    A plane wave of phase z at the rim is a polynomial of degree z + 6 z^⅓ up to rounding (its Bessel coefficients
    J_n(z) die out beyond), which fixes the number of nodes of every rule.
    """
    half = lenses.aperture_width / 2
    if lenses.aperture == "circular":
        phase = 2 * math.pi * cycles
        lens = tapered_disc_nodes(radius=half, radial_phase=phase, angular_phase=phase)
    else:
        count = _nodes_across(cycles)
        lens = rectangle_nodes(width=2 * half, height=2 * half, counts=(count, count))
    x, y, weights = lens.x, lens.y, lens.weights
    if lenses.gaps == "opaque":
        return CellNodes(x=x, y=y, weights=weights, in_lens=np.ones(x.size, dtype=bool))
    gaps = [_nodes_of(sector) for sector in _sectors(lenses, cycles / half)]
    joined = [np.concatenate(columns) for columns in zip((x, y, weights), *gaps, strict=True)]
    return CellNodes(x=joined[0], y=joined[1], weights=joined[2], in_lens=np.arange(joined[0].size) < x.size)


def cell_node_count(lenses: Microlenses, *, cycles: float) -> int:
    """Number of nodes that `cell_nodes` places, for plans that do not need the nodes."""
    if lenses.aperture == "circular":
        phase = 2 * math.pi * cycles
        in_lens = int(_nodes_on_rings(phase, phase).sum())
    else:
        in_lens = _nodes_across(cycles) ** 2
    if lenses.gaps == "opaque":
        return in_lens
    return in_lens + sum(sector.count for sector in _sectors(lenses, cycles / (lenses.aperture_width / 2)))


def tapered_disc_nodes(
    *, radius: float, radial_phase: float, angular_phase: float, centre: tuple[float, float] = (0.0, 0.0)
) -> QuadratureNodes:
    """Nodes on a disc for a wave whose phase changes by this much from centre to rim, and along the rim.

    Along a smaller ring the phase changes less, and fewer nodes suffice.
    """
    angles = _nodes_on_rings(radial_phase, angular_phase)
    return disc_nodes(radius=radius, radial_count=angles.size, angular_count=angles, centre=centre)


def tapered_disc_count(radial_phase: float, angular_phase: float) -> float:
    """Number of nodes that `tapered_disc_nodes` places, from below and to about a tenth, for plans without them."""
    return (plane_wave_degree(radial_phase) // 4 + 2) * (2 / 3 * angular_phase + 3)  # ∫ √t dt = 2/3


def plane_wave_degree(phase: float) -> int:
    """Polynomial degree that represents exp(i phase t), −1 ≤ t ≤ 1, to about 1e-6."""
    return int(plane_wave_degrees(phase))


def plane_wave_degrees(phases: FloatArray | float) -> IndexArray:
    """`plane_wave_degree` of many waves."""
    return np.ceil(phases + 6 * np.cbrt(np.maximum(phases, 1.0))).astype(int)


def _nodes_on_rings(radial_phase: float, angular_phase: float) -> IndexArray:
    """Number of nodes of each ring of a disc, from the innermost."""
    relative = np.sqrt(gauss_legendre(plane_wave_degree(radial_phase) // 4 + 2)[0])
    return plane_wave_degrees(angular_phase * relative) + 3


def _nodes_across(cycles: float) -> int:
    """Nodes along a side of a square aperture, for a wave that may run along its diagonal."""
    return plane_wave_degree(2 * math.pi * cycles * math.sqrt(2)) // 2 + 2


@dataclass(frozen=True, kw_only=True)
class _Sector:
    """A gap between two angles, within which both boundaries are smooth."""

    angle: FloatArray  # of the nodes [rad]
    angular_weights: FloatArray
    inner: FloatArray  # radius of the aperture's side at each [m]
    outer: FloatArray  # and of the cell's [m]
    radial_count: int

    @property
    def count(self) -> int:
        """Number of nodes."""
        return self.angle.size * self.radial_count


def _sectors(lenses: Microlenses, frequency: float) -> list[_Sector]:
    """Sectors between the corners of aperture and cell."""
    sides = 4 if lenses.layout == "square" else 6
    corners = [math.pi / sides * (2 * j + 1) for j in range(sides)]
    if lenses.aperture == "square":  # the inner boundary has corners too
        corners += [math.pi / 4 * (2 * j + 1) for j in range(4)]
    breaks = sorted({round(angle, 12) for angle in corners})
    ends = pairwise([*breaks, breaks[0] + 2 * math.pi])
    return [_sector(lenses, frequency, 2 * math.pi / sides, start, stop) for start, stop in ends]


def _sector(lenses: Microlenses, frequency: float, step: float, start: float, stop: float) -> _Sector:
    """Nodes of one sector in angle, and the boundaries there; sides of the cell are an angle `step` apart."""
    phase = 2 * math.pi * frequency * lenses.cell_reach * (stop - start) / 2
    t, w = gauss_legendre(plane_wave_degree(phase) // 2 + 6)
    angle = start + (stop - start) * t
    outer = lenses.pitch / 2 / np.cos(angle - step * np.round((start + stop) / 2 / step))
    inner = np.full_like(angle, lenses.aperture_width / 2)
    if lenses.aperture == "square":
        inner /= np.maximum(np.abs(np.cos(angle)), np.abs(np.sin(angle)))
    inner = np.minimum(inner, outer)
    depth = float(np.max(outer - inner))
    return _Sector(
        angle=angle,
        angular_weights=(stop - start) * w,
        inner=inner,
        outer=outer,
        radial_count=plane_wave_degree(math.pi * frequency * depth) // 2 + 4,
    )


def _nodes_of(sector: _Sector) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Positions and area weights."""
    s, v = gauss_legendre(sector.radial_count)
    across = sector.outer - sector.inner
    radius = sector.inner[:, None] + across[:, None] * s
    weights = (sector.angular_weights * across)[:, None] * v * radius
    return (
        (radius * np.cos(sector.angle)[:, None]).ravel(),
        (radius * np.sin(sector.angle)[:, None]).ravel(),
        weights.ravel(),
    )


def lit_share(lenses: Microlenses, shadow: Disc) -> FloatArray:
    """Position of each cell relative to the lit disc, shape (lenses,): 1 inside, 0 outside, 0.5 cut by its edge."""
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
        Cycles, over a half width of the aperture, of the plane wave that the nodes integrate, as for `cell_nodes`.
    """
    frequency = cycles / (lenses.aperture_width / 2)
    aperture = aperture_region(lenses, 0.0, 0.0)
    outlines = [aperture]
    if lenses.gaps == "clear":
        outlines.append(cell_region(lenses, 0.0, 0.0))
    breaks = np.concatenate(
        [lit.breaks, *(part for outline in outlines for part in (outline.breaks, outline.meeting(lit)))]
        + ([outlines[1].meeting(aperture)] if isinstance(aperture, Disc) and len(outlines) > 1 else [])
    )
    outer = outlines[-1]
    low, high = (float(f([g(outer.breaks), g(lit.breaks)])) for f, g in ((max, np.min), (min, np.max)))
    if high <= low:
        return _joined([])
    start, stop = subintervals(breaks, low, high)
    count = resolving(math.pi / 2 * (stop - start), frequency)
    columns = on_segments(start, stop, count, bend=np.ones(start.shape, dtype=bool))
    x = columns.points
    bottom, top = _common(aperture, lit, x)
    parts = [_in_columns(x, columns.weights, bottom, top, frequency, in_lens=True)]
    if lenses.gaps == "clear":
        under, over = _common(outer, lit, x)
        # A column that misses the aperture belongs to the first of the two parts as a whole; the second is then empty.
        dark = top <= bottom
        parts.append(_in_columns(x, columns.weights, under, np.where(dark, over, bottom), frequency, in_lens=False))
        parts.append(_in_columns(x, columns.weights, np.where(dark, over, top), over, frequency, in_lens=False))
    return _joined(parts)


def padded(cells: list[CellNodes]) -> CellNodes:
    """Nodes of several cells side by side, shape (cells, nodes); padding lies at the centre, with weight 0."""
    most = max(1, *(cell.x.size for cell in cells))
    return CellNodes(
        **{
            member.name: np.stack([np.pad(getattr(cell, member.name), (0, most - cell.x.size)) for cell in cells])
            for member in fields(CellNodes)
        }
    )


def _common(first: Region, second: Region, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Part of each column that lies in both regions."""
    (low, high), (lower, upper) = first.span(x), second.span(x)
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

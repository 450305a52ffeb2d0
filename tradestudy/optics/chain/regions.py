"""Areas between arcs and straight sides, cut into columns and rows within which every boundary is smooth."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tradestudy.optics.arrays import BoolArray, FloatArray, IndexArray
from tradestudy.optics.chain.microlenses import Microlenses
from tradestudy.optics.quadrature import gauss_legendre

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
        found = [np.empty(0)]
        for (x0, h0), (x1, h1) in self._sides():
            if h0 != h1:
                t = (np.abs(y - self.y) - h0) / (h1 - h0)
                found.append(self.x + x0 + (x1 - x0) * t[(t > 0) & (t < 1)])
        return np.concatenate(found)

    def meeting(self, disc: Disc) -> FloatArray:
        """Where along x the outline meets that of a disc."""
        found = []
        for (x0, h0), (x1, h1) in self._sides():
            for sign in (1.0, -1.0):
                start = np.array([self.x + x0 - disc.x, self.y + sign * h0 - disc.y])
                step = np.array([x1 - x0, sign * (h1 - h0)])
                a, b = float(step @ step), float(start @ step)
                root = b**2 - a * (float(start @ start) - disc.radius**2)
                if root > 0:
                    found += [(-b + s * math.sqrt(root)) / a * (x1 - x0) + self.x + x0 for s in (-1, 1)]
        return np.array(found)

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

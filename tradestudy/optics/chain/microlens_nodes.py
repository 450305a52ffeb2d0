"""Quadrature nodes of one microlens and, where gaps are clear, of what lies around it in its cell."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tradestudy.optics.arrays import FloatArray, IndexArray
from tradestudy.optics.chain.scene import Microlenses
from tradestudy.optics.quadrature import QuadratureNodes, disc_nodes, gauss_legendre, rectangle_nodes


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

    A plane wave of phase z at the rim has the degree z + 6 z^⅓ up to rounding (its Bessel coefficients J_n(z) die
    beyond), which fixes the number of nodes of every rule.
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
    gap = _gap_nodes(lenses, cycles / half)
    joined = (np.concatenate(pair) for pair in zip((x, y, weights), gap, strict=True))
    return CellNodes(
        **dict(zip(("x", "y", "weights"), joined, strict=True)), in_lens=np.arange(x.size + gap[0].size) < x.size
    )


def cell_node_count(lenses: Microlenses, *, cycles: float) -> int:
    """How many nodes `cell_nodes` places, for plans that need no more of them."""
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
    """Nodes on a disc for a wave whose phase at the rim is this much along a radius and along the rim.

    On a smaller ring the phase turns less often, and fewer nodes do.
    """
    angles = _nodes_on_rings(radial_phase, angular_phase)
    return disc_nodes(radius=radius, radial_count=angles.size, angular_count=angles, centre=centre)


def plane_wave_degree(phase: float) -> int:
    """Polynomial degree that holds exp(i phase t), −1 ≤ t ≤ 1, to about 1e-6."""
    return int(plane_wave_degrees(phase))


def plane_wave_degrees(phases: FloatArray | float) -> IndexArray:
    """The same of many waves."""
    return np.ceil(phases + 6 * np.cbrt(np.maximum(phases, 1.0))).astype(int)


def _nodes_on_rings(radial_phase: float, angular_phase: float) -> IndexArray:
    """Number of nodes of each ring of a disc, from the innermost."""
    relative = np.sqrt(gauss_legendre(plane_wave_degree(radial_phase) // 4 + 2)[0])
    return plane_wave_degrees(angular_phase * relative) + 3


def _nodes_across(cycles: float) -> int:
    """Nodes along a side of a square aperture, across whose diagonal a wave may turn."""
    return plane_wave_degree(2 * math.pi * cycles * math.sqrt(2)) // 2 + 2


def _gap_nodes(lenses: Microlenses, frequency: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Gauss–Legendre rules in angle and radius between the aperture and the sides of the cell."""
    parts = [_nodes_of(sector) for sector in _sectors(lenses, frequency)]
    x, y, weights = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    return x, y, weights


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
    """Between the corners of aperture and cell."""
    sides = 4 if lenses.layout == "square" else 6
    corners = [math.pi / sides * (2 * j + 1) for j in range(sides)]
    if lenses.aperture == "square":  # the inner boundary has corners too
        corners += [math.pi / 4 * (2 * j + 1) for j in range(4)]
    breaks = sorted({round(angle, 12) for angle in corners})
    ends = pairwise([*breaks, breaks[0] + 2 * math.pi])
    return [_sector(lenses, frequency, 2 * math.pi / sides, start, stop) for start, stop in ends]


def _sector(lenses: Microlenses, frequency: float, step: float, start: float, stop: float) -> _Sector:
    """Angles and boundaries; the cell's sides are a step apart."""
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

"""Quadrature nodes of one microlens and, where gaps are clear, of what lies around it in its cell."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tradestudy.optics.arrays import FloatArray
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
        count = plane_wave_degree(2 * math.pi * cycles * math.sqrt(2)) // 2 + 2
        lens = rectangle_nodes(width=2 * half, height=2 * half, counts=(count, count))
    x, y, weights = lens.x, lens.y, lens.weights
    if lenses.gaps == "opaque":
        return CellNodes(x=x, y=y, weights=weights, in_lens=np.ones(x.size, dtype=bool))
    gap = _gap_nodes(lenses, cycles / half)
    joined = (np.concatenate(pair) for pair in zip((x, y, weights), gap, strict=True))
    return CellNodes(
        **dict(zip(("x", "y", "weights"), joined, strict=True)), in_lens=np.arange(x.size + gap[0].size) < x.size
    )


def tapered_disc_nodes(
    *, radius: float, radial_phase: float, angular_phase: float, centre: tuple[float, float] = (0.0, 0.0)
) -> QuadratureNodes:
    """Nodes on a disc for a wave whose phase at the rim is this much along a radius and along the rim.

    On a smaller ring the phase turns less often, and fewer nodes do.
    """
    rings = plane_wave_degree(radial_phase) // 4 + 2
    relative = np.sqrt(gauss_legendre(rings)[0])
    angles = np.array([plane_wave_degree(angular_phase * float(ring)) + 3 for ring in relative])
    return disc_nodes(radius=radius, radial_count=rings, angular_count=angles, centre=centre)


def plane_wave_degree(phase: float) -> int:
    """Polynomial degree that holds exp(i phase t), −1 ≤ t ≤ 1, to about 1e-6."""
    return math.ceil(phase + 6 * math.cbrt(max(phase, 1.0)))


def _gap_nodes(lenses: Microlenses, frequency: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Gauss–Legendre rules in angle and radius between the aperture and the sides of the cell."""
    sides = 4 if lenses.layout == "square" else 6
    corners = [math.pi / sides * (2 * j + 1) for j in range(sides)]
    if lenses.aperture == "square":  # the inner boundary has corners too
        corners += [math.pi / 4 * (2 * j + 1) for j in range(4)]
    breaks = sorted({round(angle, 12) for angle in corners})
    parts = [_sector(lenses, frequency, sides, a, b) for a, b in pairwise([*breaks, breaks[0] + 2 * math.pi])]
    x, y, weights = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    return x, y, weights


def _sector(
    lenses: Microlenses, frequency: float, sides: int, start: float, stop: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Nodes between two angles, within which both boundaries are smooth."""
    phase = 2 * math.pi * frequency * lenses.cell_reach * (stop - start) / 2
    t, w = gauss_legendre(plane_wave_degree(phase) // 2 + 6)
    angle = start + (stop - start) * t
    step = 2 * math.pi / sides
    outer = lenses.pitch / 2 / np.cos(angle - step * np.round((start + stop) / 2 / step))
    inner = np.full_like(angle, lenses.aperture_width / 2)
    if lenses.aperture == "square":
        inner /= np.maximum(np.abs(np.cos(angle)), np.abs(np.sin(angle)))
    inner = np.minimum(inner, outer)
    depth = float(np.max(outer - inner))
    s, v = gauss_legendre(plane_wave_degree(math.pi * frequency * depth) // 2 + 4)
    radius = inner[:, None] + (outer - inner)[:, None] * s
    weights = ((stop - start) * w * (outer - inner))[:, None] * v * radius
    return (
        (radius * np.cos(angle)[:, None]).ravel(),
        (radius * np.sin(angle)[:, None]).ravel(),
        weights.ravel(),
    )

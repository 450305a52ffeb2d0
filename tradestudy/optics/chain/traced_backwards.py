"""A disc traced backwards: the irradiance of detector points is an integral over every microlens.

The phases of the lenses turn the line from a detector point σ to a lens point x towards a pupil point u and a source
point s, and it carries light where both lie within their discs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tradestudy.optics.arrays import FloatArray, IndexArray
from tradestudy.optics.chain.exact_lines import Plane, power_of_points, turned, volume
from tradestudy.optics.chain.microlens_nodes import CellNodes, cell_node_count, cell_nodes
from tradestudy.optics.chain.scene import LightPath
from tradestudy.optics.chain.sources import DiscSource, lens_orbits, moved_image, symmetries

_SAMPLES = 4.0  # across a pixel
_CYCLES = 0.7  # see `cell_nodes`
_AT_ONCE = 400_000  # rays in a block


def traced_backwards(path: LightPath, source: DiscSource, density: float) -> FloatArray:
    """Share of the light on each pixel, from a grid of detector points, several to each, and all nodes of microlenses.

    `density` is a factor on the numbers of points across a pixel and of nodes along a microlens.
    """
    pixels = path.pixels
    across = _samples_across(density)
    nodes = cell_nodes(path.microlenses, cycles=_CYCLES * density)
    trace = _Trace(
        path=path, source=source, nodes=nodes, spacing=pixels.pitch / across, power=power_of_points(path, source)
    )
    columns, rows = _detector_points(path, across)
    total = np.zeros(pixels.shape)
    for index, copies in lens_orbits(path.microlenses.centres, symmetries(path, source)):
        seen_x, seen_y = _seen(path, index, columns, rows)
        light = np.zeros((rows.size, columns.size))
        light[np.ix_(seen_y, seen_x)] = trace.irradiance(index, columns[seen_x], rows[seen_y])
        shape = (pixels.shape[0], across, pixels.shape[1], across)
        image = light.reshape(shape).mean(axis=(1, 3)) * pixels.pitch**2
        total += sum(moved_image(image, one) for one in copies)
    return np.asarray(total / (math.pi * (source.diameter / 2.0) ** 2))


def backward_rays(path: LightPath, source: DiscSource, density: float) -> float:
    """How many these are."""
    nodes = cell_node_count(path.microlenses, cycles=_CYCLES * density)
    lines = _detector_points(path, _samples_across(density))
    distinct = (index for index, _ in lens_orbits(path.microlenses.centres, symmetries(path, source)))
    return float(nodes * sum(math.prod(seen.size for seen in _seen(path, one, *lines)) for one in distinct))


def _samples_across(density: float) -> int:
    """Points across a pixel."""
    return max(2, round(_SAMPLES * density))


def _detector_points(path: LightPath, across: int) -> tuple[FloatArray, FloatArray]:
    """Columns and rows [m], evenly spaced, so that fading edges add up to their areas."""
    pixels, middles = path.pixels, (np.arange(across) + 0.5) / across
    columns, rows = ((edges[:-1, None] + pixels.pitch * middles).ravel() for edges in (pixels.edges_x, pixels.edges_y))
    return columns, rows


def _seen(path: LightPath, index: int, columns: FloatArray, rows: FloatArray) -> tuple[IndexArray, IndexArray]:
    """Columns and rows that light of a microlens reaches."""
    middle = path.microlenses.centres[index] * (1.0 + path.detector_distance / path.array_distance)
    reach = _reach_on_detector(path)
    seen_x, seen_y = (
        np.flatnonzero(np.abs(line - m) <= reach) for line, m in zip((columns, rows), middle, strict=True)
    )
    return seen_x, seen_y


@dataclass(frozen=True, kw_only=True)
class _Trace:
    """From detector points through all nodes of a microlens to pupil and source.

    Attributes
    ----------
    path, source
        Camera and disc.
    nodes
        On a cell.
    spacing
        Of the detector points [m].
    power
        See `power_of_points`.
    """

    path: LightPath
    source: DiscSource
    nodes: CellNodes
    spacing: float
    power: tuple[FloatArray, FloatArray]

    def irradiance(self, index: int, columns: FloatArray, rows: FloatArray) -> FloatArray:
        """∫ d²x (d²s d²u/d²x d²σ) (a/r²)²/P over the part of a cell that sees the source, shape (rows, columns)."""
        block = max(1, _AT_ONCE // (self.nodes.x.size * max(columns.size, 1)))
        parts = [self._rows(index, columns, rows[i : i + block]) for i in range(0, rows.size, block)]
        return np.concatenate(parts) if parts else np.zeros((0, columns.size))

    def _rows(self, index: int, columns: FloatArray, rows: FloatArray) -> FloatArray:
        """Of some rows of detector points.

        Edges of pupil and source fall between nodes: they fade over what neighbouring nodes and detector points are
        apart, by paraxial rays t = t_σ + x/f_L, u = x − z t, s = u (1 − a/f) − a t.
        """
        path, source, nodes = self.path, self.source, self.nodes
        a, z, b = source.distance, path.array_distance, path.detector_distance
        lens, main = path.microlenses.lens(index), path.main_lens
        centre = path.microlenses.centres[index]
        offset = Plane(x=nodes.x, y=nodes.y)
        x = Plane(x=nodes.x + centre[0], y=nodes.y + centre[1])
        leaving = Plane(x=(columns[:, None] - x.x) / b, y=(rows[:, None, None] - x.y) / b)
        arriving = turned(lens, offset, leaving, backward=True)
        if not nodes.in_lens.all():
            arriving = Plane(
                x=np.where(nodes.in_lens, arriving.x, leaving.x), y=np.where(nodes.in_lens, arriving.y, leaving.y)
            )
        u = x.plus(arriving, -z)
        turn = np.where(nodes.in_lens, 1.0 / lens.focal_length, 0.0) - 1.0 / b
        from_u = 1.0 - a / main.focal_length
        apart = np.sqrt(nodes.weights)
        u_width = np.hypot((1.0 - z * turn) * apart, z / b * self.spacing)
        s_width = np.hypot((from_u * (1.0 - z * turn) - a * turn) * apart, (from_u * z + a) / b * self.spacing)
        passed = _covered(u, main.radius, u_width)
        lit = passed > 0.0  # often a small part, and only they are followed further
        leaving, arriving, u = (one.over(lit.shape).where(lit) for one in (leaving, arriving, u))
        towards = turned(main, u, arriving, backward=True)
        s = u.plus(towards, -a)
        aside = s.beside(source.x, source.y)
        share = passed[lit] * _covered(aside, source.diameter / 2.0, np.broadcast_to(s_width, lit.shape)[lit])
        # d²s d²u = (a²/b²) d²x d²σ but for what lenses change, and (a/r²)² = cos⁴α/a².
        share *= volume(lens, arriving, leaving) * volume(main, towards, arriving)
        share /= (1.0 + towards.squared) ** 2 * np.interp(s.squared, *self.power)
        passed[lit] = share
        return np.asarray(passed @ nodes.weights / b**2)


def _covered(at: Plane, edge: float, width: FloatArray) -> FloatArray:
    """Share of a spacing about a point that lies within a disc, seen as a straight edge."""
    return np.asarray(np.clip(0.5 + (edge - np.sqrt(at.squared)) / np.maximum(width, 1e-9 * edge), 0.0, 1.0))


def _reach_on_detector(path: LightPath) -> float:
    """Farthest light from where the line through the middle of the pupil and of its microlens lands [m].

    Paraxial rays from the rim of the pupil through the rim of the cell; a tenth more for those that are not.
    """
    b, cell = path.detector_distance, path.microlenses.cell_reach
    bent = max(abs(1.0 + b / path.array_distance - b * p) for p in (0.0, *(1.0 / path.microlenses.focal_lengths)))
    return 1.1 * float(cell * bent + b * path.main_lens.radius / path.array_distance)

"""The image by rays of exact directions: everything of Kirchhoff's image but diffraction and interference.

A disc is traced backwards: the phases of the lenses turn the line from a detector point σ to a lens point x towards a
pupil point u and a source point s, and it carries light where both lie within their discs. The volume d²s d²u per
d²x d²σ makes the irradiance of σ an integral over the lens: gaps and perfect lenses keep the volume of position times
slope, lenses of a fixed phase that of position times direction cosine. A point is traced forwards from all over the
pupil.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.optics.chain.accuracy import ChainAccuracy, ChainImage
from tradestudy.optics.chain.microlens_nodes import CellNodes, cell_nodes
from tradestudy.optics.chain.pixels import refuse_pixel_centres
from tradestudy.optics.chain.scene import LightPath, Microlenses
from tradestudy.optics.chain.sources import DiscSource, lens_orbits, moved_image, symmetries
from tradestudy.optics.propagation.lens import CircularLens, PointSource, image_distance
from tradestudy.optics.quadrature import disc_nodes

_COARSER = 0.7
_SAFETY = 2.0
_MOST_REFINEMENTS = 2
_TOLERANCE_OF_ONE = 1e-2  # that a density of 1 meets
_WIDTH_OF_ONE = 2.0  # radius of such an image [pixels]
_LEAST_DENSITY = 0.75  # three samples across a pixel against two
_SAMPLES = 4.0  # across a pixel
_CYCLES = 0.7  # see `cell_nodes`
_RAYS = 1e6  # from all over the pupil, where they are traced forwards
_FEWEST_PIXELS = 2.0  # from the middle of the image of a disc to its edge, to be traced backwards
_PLASTIC = 1.32471795724474602596  # x³ = x + 1: multiples of 1/x and 1/x² fill a square evenly
_AT_ONCE = 400_000  # rays in a block
_GOLDEN = math.pi * (3.0 - math.sqrt(5.0))
_NOWHERE = 1e12


@dataclass(frozen=True, kw_only=True)
class _Plane:
    """Transverse coordinates of many points, or slopes (dx/dz, dy/dz) of many lines."""

    x: FloatArray
    y: FloatArray

    @property
    def squared(self) -> FloatArray:
        """x² + y²."""
        return np.asarray(self.x**2 + self.y**2)

    def plus(self, other: _Plane, times: FloatArray | float = 1.0) -> _Plane:
        """Sum with a multiple of other points."""
        return _Plane(x=self.x + times * other.x, y=self.y + times * other.y)

    def scaled(self, times: FloatArray | float) -> _Plane:
        """Multiple."""
        return _Plane(x=times * self.x, y=times * self.y)


def exact_ray_image(path: LightPath, source: PointSource | DiscSource, *, accuracy: ChainAccuracy) -> ChainImage:
    """Share of the pupil's light on each pixel by rays that the exact phases of the lenses turn.

    Parameters
    ----------
    path
        The camera.
    source
        Point, or disc whose points radiate on their own.
    accuracy
        What to aim at; `source_sampling` refines all samples.

    Returns
    -------
    ChainImage
        ``numerical_error`` is twice the change against 0.7 times the samples. Where it misses the tolerance, samples
        are refined twice at most: edges of gaps or of far-off light fall worse between them than those of a disc.

    Raises
    ------
    OutOfRangeError
        If pixels are not to integrate.
    """
    refuse_pixel_centres(path.pixels)
    density = ray_density(path, source, accuracy)
    traced = ray_count(path, source, accuracy)
    coarse, fine = (_shares(path, source, density * factor) for factor in (_COARSER, 1.0))
    change = _stated(fine, coarse)
    for _ in range(_MOST_REFINEMENTS):
        if change <= accuracy.tolerance:
            break
        density /= _COARSER
        traced += _rays(path, source, density)
        coarse, fine = fine, _shares(path, source, density)
        change = _stated(fine, coarse)
    return ChainImage(
        pixels=fine,
        numerical_error=change,
        error_terms={"coarser computation": change},
        direct_check={},
        microlens_share=math.nan,
        effort={"rays": round(traced)},
    )


def _stated(fine: FloatArray, coarse: FloatArray) -> float:
    """Error of the finer of two pictures, relative L2."""
    size = float(np.linalg.norm(fine))
    return _SAFETY * float(np.linalg.norm(fine - coarse)) / size if size > 0.0 else 0.0


def ray_density(path: LightPath, source: PointSource | DiscSource, accuracy: ChainAccuracy) -> float:
    """Factor on the numbers of samples across a pixel and of nodes on a microlens, or of rays from the source.

    Edges of pupil and source that fall between samples leave an error that falls with its square, about, and with the
    width of the image, of which edges are a smaller part.
    """
    wide = max(1.0, _image_radius(path, source) / _WIDTH_OF_ONE) if isinstance(source, DiscSource) else 1.0
    needed = math.sqrt(_TOLERANCE_OF_ONE / accuracy.tolerance / wide)
    return accuracy.source_sampling * max(_LEAST_DENSITY, needed)


def ray_count(path: LightPath, source: PointSource | DiscSource, accuracy: ChainAccuracy) -> float:
    """Rays that are traced before any refinement, the coarser computation included."""
    return sum(_rays(path, source, ray_density(path, source, accuracy) * factor) for factor in (1.0, _COARSER))


def _rays(path: LightPath, source: PointSource | DiscSource, density: float) -> float:
    if isinstance(source, PointSource) or not is_wide(path, source):
        return _RAYS * density
    lenses, across = path.microlenses, max(2, round(_SAMPLES * density))
    distinct = sum(1 for _ in lens_orbits(lenses.centres, symmetries(path, source)))
    seen = min(2.0 * _reach_on_detector(path) / path.pixels.pitch, float(min(path.pixels.shape)))
    return distinct * (seen * across) ** 2 * cell_nodes(lenses, cycles=_CYCLES * density).x.size


def _shares(path: LightPath, source: PointSource | DiscSource, density: float) -> FloatArray:
    if isinstance(source, DiscSource) and is_wide(path, source):
        return _traced_backwards(path, source, density)
    return _traced_forwards(path, source, density)


def is_wide(path: LightPath, source: DiscSource) -> bool:
    """Whether the image of a disc behind a microlens is wide enough for detector points to sample."""
    return _image_radius(path, source) >= _FEWEST_PIXELS


def _image_radius(path: LightPath, source: DiscSource) -> float:
    """Of a disc behind a microlens [pixels], no larger than the image of the pupil may be."""
    _, _, depth = path.image_at_array(source.centre)
    at_main_image = source.diameter / 2.0 * abs(path.array_distance - depth) / source.distance
    largest = path.main_lens.radius / path.array_distance
    seen = largest if at_main_image >= largest * abs(depth) else at_main_image / abs(depth)
    return path.detector_distance / path.pixels.pitch * seen


def _traced_backwards(path: LightPath, source: DiscSource, density: float) -> FloatArray:
    """Irradiance of a grid of detector points, several to a pixel, from all nodes of every microlens."""
    pixels = path.pixels
    across = max(2, round(_SAMPLES * density))
    middles = (np.arange(across) + 0.5) / across  # evenly spaced, so that fading edges add up to their areas
    columns, rows = ((edges[:-1, None] + pixels.pitch * middles).ravel() for edges in (pixels.edges_x, pixels.edges_y))
    nodes = cell_nodes(path.microlenses, cycles=_CYCLES * density)
    trace = _BackwardTrace(
        path=path, source=source, nodes=nodes, spacing=pixels.pitch / across, power=_power_of_points(path, source)
    )
    reach = _reach_on_detector(path)
    group = symmetries(path, source)
    total = np.zeros(pixels.shape)
    for index, copies in lens_orbits(path.microlenses.centres, group):
        middle = path.microlenses.centres[index] * (1.0 + path.detector_distance / path.array_distance)
        seen_x, seen_y = (
            np.flatnonzero(np.abs(line - m) <= reach) for line, m in zip((columns, rows), middle, strict=True)
        )
        light = np.zeros((rows.size, columns.size))
        light[np.ix_(seen_y, seen_x)] = trace.irradiance(index, columns[seen_x], rows[seen_y])
        shape = (pixels.shape[0], across, pixels.shape[1], across)
        image = light.reshape(shape).mean(axis=(1, 3)) * pixels.pitch**2
        total += sum(moved_image(image, one) for one in copies)
    return np.asarray(total / (math.pi * (source.diameter / 2.0) ** 2))


@dataclass(frozen=True, kw_only=True)
class _BackwardTrace:
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
        See `_power_of_points`.
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
        offset = _Plane(x=nodes.x, y=nodes.y)
        x = _Plane(x=nodes.x + centre[0], y=nodes.y + centre[1])
        leaving = _Plane(x=(columns[:, None] - x.x) / b, y=(rows[:, None, None] - x.y) / b)
        arriving = _turned(lens, offset, leaving, backward=True)
        if not nodes.in_lens.all():
            arriving = _Plane(
                x=np.where(nodes.in_lens, arriving.x, leaving.x), y=np.where(nodes.in_lens, arriving.y, leaving.y)
            )
        u = x.plus(arriving, -z)
        towards = _turned(main, u, arriving, backward=True)
        s = u.plus(towards, -a)
        turn = np.where(nodes.in_lens, 1.0 / lens.focal_length, 0.0) - 1.0 / b
        from_u = 1.0 - a / main.focal_length
        apart = np.sqrt(nodes.weights)
        u_width = np.hypot((1.0 - z * turn) * apart, z / b * self.spacing)
        s_width = np.hypot((from_u * (1.0 - z * turn) - a * turn) * apart, (from_u * z + a) / b * self.spacing)
        aside = _Plane(x=s.x - source.x, y=s.y - source.y)
        passed = _covered(u, main.radius, u_width) * _covered(aside, source.diameter / 2.0, s_width)
        # d²s d²u = (a²/b²) d²x d²σ but for what lenses change, and (a/r²)² = cos⁴α/a².
        passed *= _volume(lens, arriving, leaving) * _volume(main, towards, arriving)
        passed /= (1.0 + towards.squared) ** 2 * np.interp(s.squared, *self.power)
        return np.asarray(passed @ nodes.weights / b**2)


def _volume(lens: CircularLens, before: _Plane, behind: _Plane) -> FloatArray | float:
    """Volume of slopes before a lens per volume behind it: cos⁴ behind over cos⁴ before, but for perfect lenses."""
    if lens.lens_phase == "perfect":
        return 1.0
    return np.asarray(((1.0 + before.squared) / (1.0 + behind.squared)) ** 2)


def _covered(at: _Plane, edge: float, width: FloatArray) -> FloatArray:
    """Share of a spacing about a point that lies within a disc, seen as a straight edge."""
    return np.asarray(np.clip(0.5 + (edge - np.sqrt(at.squared)) / np.maximum(width, 1e-9 * edge), 0.0, 1.0))


def _reach_on_detector(path: LightPath) -> float:
    """Farthest light from where the line through the middle of the pupil and of its microlens lands [m].

    Paraxial rays from the rim of the pupil through the rim of the cell; a tenth more for those that are not.
    """
    b, cell = path.detector_distance, path.microlenses.cell_reach
    bent = max(abs(1.0 + b / path.array_distance - b * p) for p in (0.0, *(1.0 / path.microlenses.focal_lengths)))
    return 1.1 * float(cell * bent + b * path.main_lens.radius / path.array_distance)


def _power_of_points(path: LightPath, source: PointSource | DiscSource) -> tuple[FloatArray, FloatArray]:
    """Squared distances from the axis of points of the source [m²], rising, and ∫ a²/r⁴ d²u over the pupil for each."""
    centre = math.hypot(source.x, source.y)
    width = source.diameter if isinstance(source, DiscSource) else path.main_lens.radius
    nodes = disc_nodes(radius=path.main_lens.radius, radial_count=8, angular_count=24)
    at = np.linspace(max(0.0, centre - width), centre + width, 33)
    squared = source.distance**2 + (nodes.x - at[:, None]) ** 2 + nodes.y**2
    return at**2, np.asarray((source.distance**2 / squared**2) @ nodes.weights)


def _turned(lens: CircularLens, at: _Plane, slope: _Plane, *, backward: bool) -> _Plane:
    """Slopes behind a thin lens of lines that reach it at points relative to its centre; or before it, of those behind.

    The gradient of the lens's path adds to direction cosines; a perfect lens keeps t − r/f, which images sharply.
    """
    f, sign = lens.focal_length, 1.0 if backward else -1.0
    if lens.lens_phase == "perfect":
        return slope.plus(at, sign / f)
    cosines = slope.scaled(1.0 / np.sqrt(1.0 + slope.squared))
    if lens.lens_phase == "parabolic":
        cosines = cosines.plus(at, sign / f)
    else:
        assert lens.focus_distance is not None  # the lens's own promise
        for a in (lens.focus_distance, image_distance(f, lens.focus_distance)):
            cosines = cosines.plus(at, sign * math.copysign(1.0, a) / np.sqrt(at.squared + a**2))
    squared = cosines.squared
    # Steeper than any line: so far aside that nothing lies there.
    return cosines.scaled(np.where(squared < 1.0, 1.0 / np.sqrt(1.0 - np.minimum(squared, 1.0 - 1e-12)), _NOWHERE))


def _traced_forwards(path: LightPath, source: PointSource | DiscSource, density: float) -> FloatArray:
    """Rays from all over source and pupil, each with its power, to the pixels where they land."""
    count = round(_RAYS * density)
    power = _power_of_points(path, source)
    total = np.zeros(path.pixels.shape)
    for start in range(0, count, _AT_ONCE):
        index = np.arange(start, min(start + _AT_ONCE, count), dtype=np.float64) + 0.5
        total += _landed(path, source, np.asarray(index), count, power)
    return total


def _landed(
    path: LightPath,
    source: PointSource | DiscSource,
    index: FloatArray,
    count: int,
    power_of_points: tuple[FloatArray, FloatArray],
) -> FloatArray:
    """Some of so many rays."""
    pixels, lenses = path.pixels, path.microlenses
    u = _on_disc(path.main_lens.radius, index / count, np.asarray(_GOLDEN * index))
    towards = _Plane(x=u.x - source.x, y=u.y - source.y)
    power = np.full(index.size, math.pi * path.main_lens.radius**2 / count)
    if isinstance(source, DiscSource):
        aside = _on_disc(
            source.diameter / 2.0, np.asarray(index / _PLASTIC % 1.0), np.asarray(2.0 * math.pi / _PLASTIC**2 * index)
        )
        towards = towards.plus(aside, -1.0)
    power *= source.distance**2 / (source.distance**2 + towards.squared) ** 2  # of the paper's amplitude a/r²
    power /= np.interp(u.plus(towards, -1.0).squared, *power_of_points)
    arriving = _turned(path.main_lens, u, towards.scaled(1.0 / source.distance), backward=False)
    x = u.plus(arriving, path.array_distance)
    total = np.zeros(pixels.shape)
    for k, (cx, cy) in enumerate(lenses.centres):
        offset = _Plane(x=x.x - cx, y=x.y - cy)
        in_lens = _in_aperture(lenses, offset)
        parts = [(in_lens, True)]
        if lenses.gaps == "clear":
            parts.append((_in_cell(lenses, offset) & ~in_lens, False))
        for inside, acting in parts:
            here, slope = (_Plane(x=one.x[inside], y=one.y[inside]) for one in (offset, arriving))
            leaving = _turned(lenses.lens(k), here, slope, backward=False) if acting else slope
            landing = here.plus(leaving, path.detector_distance)
            edges = (pixels.edges_y, pixels.edges_x)
            total += np.histogram2d(landing.y + cy, landing.x + cx, bins=edges, weights=power[inside])[0]
    return total


def _on_disc(radius: float, area: FloatArray, angle: FloatArray) -> _Plane:
    """Points at shares of the area of a disc from its middle, and at angles [rad]."""
    distance = radius * np.sqrt(area)
    return _Plane(x=distance * np.cos(angle), y=distance * np.sin(angle))


def _in_aperture(lenses: Microlenses, offset: _Plane) -> BoolArray:
    half = lenses.aperture_width / 2.0
    if lenses.aperture == "circular":
        return np.asarray(offset.squared <= half**2)
    return np.asarray(np.maximum(np.abs(offset.x), np.abs(offset.y)) <= half)


def _in_cell(lenses: Microlenses, offset: _Plane) -> BoolArray:
    half, x, y = lenses.pitch / 2.0, np.abs(offset.x), np.abs(offset.y)
    if lenses.layout == "square":
        return np.asarray(np.maximum(x, y) <= half)
    return np.asarray(np.maximum(x, x / 2.0 + y * math.sqrt(3.0) / 2.0) <= half)

"""Image by rays in exact directions, which sample it evenly: all of Kirchhoff's image but diffraction and interference.

The image is an integral over pairs of source and pupil points. Its volume element d²s d²u can be carried to any other
pair of planes: gaps and perfect lenses conserve the volume of position times slope, lenses of a fixed phase that of
position times direction cosine. Rays start where the fewest of them are lost: at the detector, at the array or at the
source.

For rays from the detector, the irradiance at σ is an integral over every microlens. The phases of the lenses turn the
line from σ through a lens point x towards a pupil point u and a source point s; the line carries light if u and s both
lie within their discs.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from tradestudy.optics.arrays import BoolArray, FloatArray, IndexArray
from tradestudy.optics.chain.accuracy import ChainAccuracy, ChainImage, refuse_pixel_centres
from tradestudy.optics.chain.behind_microlens import projection
from tradestudy.optics.chain.microlens_nodes import CellNodes, cell_node_count, cell_nodes
from tradestudy.optics.chain.scene import LightPath, Microlenses, PixelGrid
from tradestudy.optics.chain.sources import DiscSource, lens_orbits, moved_image, symmetries
from tradestudy.optics.propagation.lens import CircularLens, PointSource, finite_image_distance
from tradestudy.optics.quadrature import disc_nodes

_NOWHERE = 1e12
AT_ONCE = 100_000  # rays in a block
Tracer = Callable[[int, int, int], FloatArray]
"""Sum over the rays of a shifted sequence from one member to another, shape of the pixels."""


@dataclass(frozen=True, kw_only=True)
class Plane:
    """Transverse coordinates of many points, or slopes (dx/dz, dy/dz) of many lines."""

    x: FloatArray
    y: FloatArray

    @property
    def squared(self) -> FloatArray:
        """x² + y²."""
        return np.asarray(self.x**2 + self.y**2)

    def plus(self, other: Plane, times: FloatArray | float = 1.0) -> Plane:
        """Sum with a multiple of other coordinates."""
        return Plane(x=self.x + times * other.x, y=self.y + times * other.y)

    def scaled(self, times: FloatArray | float) -> Plane:
        """Coordinates times a factor."""
        return Plane(x=times * self.x, y=times * self.y)

    def beside(self, x: float, y: float) -> Plane:
        """Coordinates relative to a point."""
        return Plane(x=self.x - x, y=self.y - y)

    def over(self, shape: tuple[int, ...]) -> Plane:
        """Coordinates repeated to fill a shape."""
        return Plane(x=np.broadcast_to(self.x, shape), y=np.broadcast_to(self.y, shape))

    def where(self, chosen: BoolArray) -> Plane:
        """Coordinates of the chosen points only."""
        return Plane(x=self.x[chosen], y=self.y[chosen])


def turned(lens: CircularLens, points: Plane, slope: Plane, *, backward: bool) -> Plane:
    """Slopes behind a thin lens of lines that reach it at given points; with `backward`, slopes in front of it.

    Points are relative to the centre of the lens. The gradient of its path adds to direction cosines; a perfect lens
    keeps t − r/f, which images sharply.
    """
    f, sign = lens.focal_length, 1.0 if backward else -1.0
    if lens.lens_phase == "perfect":
        return slope.plus(points, sign / f)
    cosines = slope.scaled(1.0 / np.sqrt(1.0 + slope.squared))
    if lens.lens_phase == "parabolic":
        cosines = cosines.plus(points, sign / f)
    else:
        assert lens.focus_distance is not None  # guaranteed by CircularLens
        for a in (lens.focus_distance, finite_image_distance(lens.focus_distance, f)):
            cosines = cosines.plus(points, sign * math.copysign(1.0, a) / np.sqrt(points.squared + a**2))
    squared = cosines.squared
    # Steeper than any real line: it misses everything.
    return cosines.scaled(np.where(squared < 1.0, 1.0 / np.sqrt(1.0 - np.minimum(squared, 1.0 - 1e-12)), _NOWHERE))


def volume(lens: CircularLens, before: Plane, behind: Plane) -> FloatArray | float:
    """Volume of slopes before a lens per volume behind it: cos⁴ behind over cos⁴ before; 1 for perfect lenses."""
    if lens.lens_phase == "perfect":
        return 1.0
    return np.asarray(((1.0 + before.squared) / (1.0 + behind.squared)) ** 2)


def power_of_points(path: LightPath, source: PointSource | DiscSource) -> tuple[FloatArray, FloatArray]:
    """Squared distances of source points from the axis [m²], ascending, and ∫ a²/r⁴ d²u over the pupil for each."""
    centre = math.hypot(source.x, source.y)
    width = source.diameter if isinstance(source, DiscSource) else path.main_lens.radius
    nodes = disc_nodes(radius=path.main_lens.radius, radial_count=8, angular_count=24)
    away = np.linspace(max(0.0, centre - width), centre + width, 33)
    squared = source.distance**2 + (nodes.x - away[:, None]) ** 2 + nodes.y**2
    return away**2, np.asarray((source.distance**2 / squared**2) @ nodes.weights)


def even_numbers(dimensions: int, shifted: int, start: int, stop: int) -> FloatArray:
    """Members of a sequence that fills the unit cube evenly, however many are used; shape (dimensions, n).

    Multiples of 1/g, 1/g², … for g^(d+1) = g + 1: a golden ratio in d dimensions. The errors of its shifts are
    independent, as if drawn at random: √p j² modulo 1 for prime p has no period that a step could share.
    """
    g = 2.0
    for _ in range(60):
        g = math.pow(1.0 + g, 1.0 / (dimensions + 1))
    steps = np.power(g, -np.arange(1.0, dimensions + 1))
    shift = np.sqrt([2.0, 3.0, 5.0, 7.0][:dimensions]) * (shifted + 1) ** 2
    return np.asarray((shift[:, None] + np.arange(start, stop) * steps[:, None]) % 1.0)


def on_disc(radius: float, area: FloatArray, turn: FloatArray) -> Plane:
    """Points at given fractions of the area of a disc, from its middle outwards, and of a full turn."""
    distance, angle = radius * np.sqrt(area), 2.0 * math.pi * turn
    return Plane(x=distance * np.cos(angle), y=distance * np.sin(angle))


def through_microlens(path: LightPath, index: int, offset: Plane, arriving: Plane, power: FloatArray) -> FloatArray:
    """Light on the pixels from rays that reach the plane of a microlens at points relative to its centre."""
    lenses = path.microlenses
    in_lens = in_aperture(lenses, offset)
    parts = [(in_lens, True)]
    if lenses.gaps == "clear":
        parts.append((in_cell(lenses, offset) & ~in_lens, False))
    total = np.zeros(path.pixels.shape)
    x, y = lenses.centres[index]
    for inside, refracts in parts:
        point, slope = offset.where(inside), arriving.where(inside)
        leaving = turned(lenses.lens(index), point, slope, backward=False) if refracts else slope
        landing = point.plus(leaving, path.detector_distance)
        total += _on_pixels(path.pixels, landing.beside(-x, -y), power[inside])
    return total


def _on_pixels(pixels: PixelGrid, landing: Plane, power: FloatArray) -> FloatArray:
    """Sum of the power that lands on each pixel."""
    rows, columns = pixels.shape
    left, low = pixels.corner
    column, row = (landing.x - left) / pixels.pitch, (landing.y - low) / pixels.pitch
    hit = (column >= 0.0) & (column < columns) & (row >= 0.0) & (row < rows)
    flat = row[hit].astype(np.intp) * columns + column[hit].astype(np.intp)
    sums = np.bincount(flat, weights=power[hit], minlength=rows * columns)
    return np.asarray(sums.reshape(rows, columns), dtype=np.float64)  # integers if there are no rays


def in_aperture(lenses: Microlenses, offset: Plane) -> BoolArray:
    """Whether points relative to the centre of a microlens lie on it."""
    half = lenses.aperture_width / 2.0
    if lenses.aperture == "circular":
        return np.asarray(offset.squared <= half**2)
    return np.asarray(np.maximum(np.abs(offset.x), np.abs(offset.y)) <= half)


def in_cell(lenses: Microlenses, offset: Plane) -> BoolArray:
    """Whether points relative to the centre of a microlens lie in its cell."""
    half, x, y = lenses.pitch / 2.0, np.abs(offset.x), np.abs(offset.y)
    if lenses.layout == "square":
        return np.asarray(np.maximum(x, y) <= half)
    return np.asarray(np.maximum(x, x / 2.0 + y * math.sqrt(3.0) / 2.0) <= half)


def forward_tracer(path: LightPath, source: PointSource | DiscSource) -> Tracer:
    """Function that sums over rays; the mean is the fraction of the pupil's light on each pixel."""
    power_at = power_of_points(path, source)
    main, a = path.main_lens, source.distance

    def trace(shifted: int, start: int, stop: int) -> FloatArray:
        numbers = even_numbers(4 if isinstance(source, DiscSource) else 2, shifted, start, stop)
        u = on_disc(main.radius, *numbers[:2])
        towards = u.beside(source.x, source.y)
        if isinstance(source, DiscSource):
            towards = towards.plus(on_disc(source.diameter / 2.0, *numbers[2:]), -1.0)
        power = math.pi * main.radius**2 * a**2 / (a**2 + towards.squared) ** 2  # of the paper's amplitude a/r²
        power /= np.interp(u.plus(towards, -1.0).squared, *power_at)
        arriving = turned(main, u, towards.scaled(1.0 / a), backward=False)
        x = u.plus(arriving, path.array_distance)
        total = np.zeros(path.pixels.shape)
        centres, reach = path.microlenses.centres, path.microlenses.cell_reach
        low, high = (np.array([end(x.x), end(x.y)]) for end in (np.min, np.max))
        near = np.abs(centres - (low + high) / 2.0) <= (high - low) / 2.0 + reach
        for index in np.flatnonzero(np.all(near, axis=1)):
            total += through_microlens(path, int(index), x.beside(*centres[index]), arriving, power)
        return total

    return trace


def array_tracer(path: LightPath, source: DiscSource) -> Tracer:
    """Function that sums over rays of each microlens; the mean is the fraction of the pupil's light on each pixel."""
    orbits = list(lens_orbits(path.microlenses.centres, symmetries(path, source)))
    power_at = power_of_points(path, source)

    def trace(shifted: int, start: int, stop: int) -> FloatArray:
        numbers = even_numbers(4, shifted, start, stop)
        u, offset = on_disc(path.main_lens.radius, *numbers[:2]), _on_cell(path.microlenses, *numbers[2:])
        total = np.zeros(path.pixels.shape)
        for index, copies in orbits:
            image = _through(path, source, index, u, offset, power_at)
            total += sum(moved_image(image, symmetry) for symmetry in copies)
        return total

    return trace


def _through(
    path: LightPath,
    source: DiscSource,
    index: int,
    u: Plane,
    offset: Plane,
    power_at: tuple[FloatArray, FloatArray],
) -> FloatArray:
    """Rays through one microlens: d²s d²u = (a²/z²) d²x d²u apart from what the main lens changes."""
    a, z, main = source.distance, path.array_distance, path.main_lens
    arriving = u.scaled(-1.0).plus(offset).beside(*(-path.microlenses.centres[index])).scaled(1.0 / z)
    towards = turned(main, u, arriving, backward=True)
    s = u.plus(towards, -a)
    lit = np.asarray(s.beside(source.x, source.y).squared <= (source.diameter / 2.0) ** 2)
    offset, arriving, towards, s = (coordinates.where(lit) for coordinates in (offset, arriving, towards, s))
    # (a²/z²) (a/r²)² = cos⁴α/z², per area of the disc
    power = volume(main, towards, arriving) / (1.0 + towards.squared) ** 2 / np.interp(s.squared, *power_at)
    power *= 4.0 * main.radius**2 * cell_area(path.microlenses) / (z * source.diameter) ** 2
    return through_microlens(path, index, offset, arriving, power)


def cell_area(lenses: Microlenses) -> float:
    """Area [m²] over which points of a microlens are drawn: its aperture, or a rectangle about its cell."""
    if lenses.gaps == "opaque":
        return lenses.aperture_width**2 * (math.pi / 4.0 if lenses.aperture == "circular" else 1.0)
    return lenses.pitch**2 * (1.0 if lenses.layout == "square" else 2.0 / math.sqrt(3.0))


def _on_cell(lenses: Microlenses, first: FloatArray, second: FloatArray) -> Plane:
    """Points spread over `cell_area`."""
    if lenses.gaps == "opaque" and lenses.aperture == "circular":
        return on_disc(lenses.aperture_width / 2.0, first, second)
    width = lenses.aperture_width if lenses.gaps == "opaque" else lenses.pitch
    return Plane(x=width * (first - 0.5), y=cell_area(lenses) / width * (second - 0.5))


_SAMPLES = 4.0  # across a pixel, where lines start at the detector
_CYCLES = 0.7  # see `cell_nodes`
_LINES_AT_ONCE = 400_000  # in a block, from the detector
StartOfRays = Literal["detector", "array", "source"]
_COARSER = 0.7
SHIFTS = 8  # random shifts of the sequence that places sampled rays
_SAFETY = 2.5  # factor on the change with sampling: errors may fall only in proportion to the spacing
_STANDARD_ERRORS = 3.0  # in the stated error: shifts are few, and a picture may be a single number
_MOST_REFINEMENTS = 2
_TOLERANCE_OF_ONE = 2e-2  # tolerance that a density of 1 meets
_WIDTH_OF_ONE = 2.0  # radius of an image where it does [pixels]
_LEAST_DENSITY = 0.75  # compares three samples across a pixel with two
_FEWEST_PIXELS = 2.0  # least radius of a disc's image that is traced from the detector [pixels]
_PILOT_RAYS = 2**13
_ORDER = 0.6  # errors of sampled rays fall about as this power of their number, or a little faster
_WHERE_DARK = 2**20  # rays if none of the pilot's reaches a pixel
_MOST_RAYS = 1e8


def traced_backwards(path: LightPath, source: DiscSource, density: float) -> FloatArray:
    """Fraction of the light on each pixel, traced from several detector points per pixel through all microlens nodes.

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
        total += sum(moved_image(image, symmetry) for symmetry in copies)
    return np.asarray(total / (math.pi * (source.diameter / 2.0) ** 2))


def backward_rays(path: LightPath, source: DiscSource, density: float) -> float:
    """Number of lines that `traced_backwards` follows."""
    nodes = cell_node_count(path.microlenses, cycles=_CYCLES * density)
    lines = _detector_points(path, _samples_across(density))
    distinct = (index for index, _ in lens_orbits(path.microlenses.centres, symmetries(path, source)))
    return float(nodes * sum(math.prod(line.size for line in _seen(path, index, *lines)) for index in distinct))


def _samples_across(density: float) -> int:
    """Detector points across a pixel."""
    return max(2, round(_SAMPLES * density))


def _detector_points(path: LightPath, across: int) -> tuple[FloatArray, FloatArray]:
    """Columns and rows of detector points [m], evenly spaced so that fading edges add up to the right areas."""
    pixels, middles = path.pixels, (np.arange(across) + 0.5) / across
    columns, rows = ((edges[:-1, None] + pixels.pitch * middles).ravel() for edges in (pixels.edges_x, pixels.edges_y))
    return columns, rows


def _seen(path: LightPath, index: int, columns: FloatArray, rows: FloatArray) -> tuple[IndexArray, IndexArray]:
    """Columns and rows that light of a microlens reaches."""
    b, z, lenses = path.detector_distance, path.array_distance, path.microlenses
    middle = lenses.centres[index] * (1.0 + b / z)
    # From paraxial rays through the rims of pupil and cell, with a tenth added for rays that are not paraxial.
    bent = max(abs(1.0 + b / z - b * power) for power in (0.0, *(1.0 / lenses.focal_lengths)))
    reach = 1.1 * float(lenses.cell_reach * bent + b * path.main_lens.radius / z)
    seen_x, seen_y = (
        np.flatnonzero(np.abs(line - m) <= reach) for line, m in zip((columns, rows), middle, strict=True)
    )
    return seen_x, seen_y


@dataclass(frozen=True, kw_only=True)
class _Trace:
    """Lines from detector points through all nodes of a microlens to pupil and source.

    Attributes
    ----------
    path, source
        Camera and disc.
    nodes
        Nodes on a cell.
    spacing
        Distance between detector points [m].
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
        block = max(1, _LINES_AT_ONCE // (self.nodes.x.size * max(columns.size, 1)))
        parts = [self._rows(index, columns, rows[i : i + block]) for i in range(0, rows.size, block)]
        return np.concatenate(parts) if parts else np.zeros((0, columns.size))

    def _rows(self, index: int, columns: FloatArray, rows: FloatArray) -> FloatArray:
        """Irradiance at some rows of detector points.

        Edges of pupil and source fall between nodes. They fade over the distance between the lines of neighbouring
        nodes and detector points, by paraxial rays t = t_σ + x/f_L, u = x − z t, s = u (1 − a/f) − a t.
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
        leaving, arriving, u = (coordinates.over(lit.shape).where(lit) for coordinates in (leaving, arriving, u))
        towards = turned(main, u, arriving, backward=True)
        s = u.plus(towards, -a)
        aside = s.beside(source.x, source.y)
        share = passed[lit] * _covered(aside, source.diameter / 2.0, np.broadcast_to(s_width, lit.shape)[lit])
        # d²s d²u = (a²/b²) d²x d²σ apart from what lenses change, and (a/r²)² = cos⁴α/a².
        share *= volume(lens, arriving, leaving) * volume(main, towards, arriving)
        share /= (1.0 + towards.squared) ** 2 * np.interp(s.squared, *self.power)
        passed[lit] = share
        return np.asarray(passed @ nodes.weights / b**2)


def _covered(point: Plane, edge: float, width: FloatArray) -> FloatArray:
    """Fraction of a spacing about a point that lies within a disc, whose edge counts as straight."""
    return np.asarray(np.clip(0.5 + (edge - np.sqrt(point.squared)) / np.maximum(width, 1e-9 * edge), 0.0, 1.0))


def exact_ray_image(path: LightPath, source: PointSource | DiscSource, *, accuracy: ChainAccuracy) -> ChainImage:
    """Fraction of the pupil's light on each pixel, by rays that the exact phases of the lenses turn.

    Parameters
    ----------
    path
        The camera.
    source
        Point or incoherent disc.
    accuracy
        Tolerance and sampling; `source_sampling` refines all samples.

    Returns
    -------
    ChainImage
        ``numerical_error`` is 3 standard errors of eight shifts of the rays; for rays from the detector, it is 2.5
        times the change from 0.7 times the samples. If it misses the tolerance, more rays are traced, at most twice.

    Raises
    ------
    OutOfRangeError
        If the pixels do not integrate.
    """
    refuse_pixel_centres(path.pixels)
    if isinstance(source, DiscSource) and start_of_rays(path, source) == "detector":
        pixels, change, traced = _from_detector(path, source, accuracy)
    else:
        pixels, change, traced = _sampled(path, source, accuracy)
    return ChainImage(
        pixels=pixels,
        numerical_error=change,
        error_terms={"coarser computation": change},
        direct_check={},
        microlens_share=math.nan,
        effort={"rays": round(traced)},
    )


def start_of_rays(path: LightPath, source: PointSource | DiscSource) -> StartOfRays:
    """Plane from which rays start.

    An image that is wide compared with its pixels is traced from the detector. Rays from the source count if they meet
    the array, and rays through the array if they meet the source: fewer are lost if they start at the smaller of the
    two areas, as seen through the middle of the pupil.
    """
    if isinstance(source, PointSource):
        return "source"
    if _image_radius(path, source) >= _FEWEST_PIXELS:
        return "detector"
    array = path.microlenses.count * cell_area(path.microlenses) * (source.distance / path.array_distance) ** 2
    return "array" if array < math.pi * (source.diameter / 2.0) ** 2 else "source"


def ray_count(path: LightPath, source: PointSource | DiscSource, accuracy: ChainAccuracy) -> float:
    """Number of rays traced before any refinement, those for the error estimate included."""
    if isinstance(source, DiscSource) and start_of_rays(path, source) == "detector":
        density = _density(path, source, accuracy)
        return sum(backward_rays(path, source, density * factor) for factor in (1.0, _COARSER))
    return _lenses_traced(path, source) * _needed(path, source, accuracy) + _PILOT_RAYS


def _from_detector(path: LightPath, source: DiscSource, accuracy: ChainAccuracy) -> tuple[FloatArray, float, float]:
    """Picture, its error, and the number of rays."""
    density = _density(path, source, accuracy)
    traced = ray_count(path, source, accuracy)
    coarse, fine = (traced_backwards(path, source, density * factor) for factor in (_COARSER, 1.0))
    change = _against(coarse, fine)
    for _ in range(_MOST_REFINEMENTS):
        if change <= accuracy.tolerance:
            break
        density /= _COARSER
        traced += backward_rays(path, source, density)
        coarse, fine = fine, traced_backwards(path, source, density)
        change = _against(coarse, fine)
    return fine, change, traced


def _density(path: LightPath, source: DiscSource, accuracy: ChainAccuracy) -> float:
    """Factor on the numbers of samples across a pixel and of nodes on a microlens.

    Edges of pupil and source that fall between samples leave an error that falls about as the square of this factor,
    and with the width of the image, in which edges then take a smaller part.
    """
    wide = max(1.0, _image_radius(path, source) / _WIDTH_OF_ONE)
    needed = math.sqrt(_TOLERANCE_OF_ONE / accuracy.tolerance / wide)
    return accuracy.source_sampling * max(_LEAST_DENSITY, needed)


def _sampled(
    path: LightPath, source: PointSource | DiscSource, accuracy: ChainAccuracy
) -> tuple[FloatArray, float, float]:
    """Picture, its error, and the number of rays."""
    trace = _tracer(path, source)
    per_shift = _needed(path, source, accuracy) // SHIFTS
    sums = np.stack([_sum(trace, shifted, 0, per_shift) for shifted in range(SHIFTS)])
    for _ in range(_MOST_REFINEMENTS):
        if _scatter(sums) <= accuracy.tolerance or 2 * SHIFTS * per_shift > _MOST_RAYS:
            break
        sums += np.stack([_sum(trace, shifted, per_shift, 2 * per_shift) for shifted in range(SHIFTS)])
        per_shift *= 2
    traced = _lenses_traced(path, source) * SHIFTS * per_shift + _PILOT_RAYS
    return np.asarray(sums.mean(axis=0) / per_shift), _scatter(sums), traced


def _needed(path: LightPath, source: PointSource | DiscSource, accuracy: ChainAccuracy) -> int:
    """Number of rays to trace (per microlens, if they start at the array), from the error of a few of them."""
    if start_of_rays(path, source) == "array":
        path = _typical_microlens(path, source)
    trace = _tracer(path, source)
    change = _scatter(np.stack([trace(shifted, 0, _PILOT_RAYS // SHIFTS) for shifted in range(SHIFTS)]))
    needed = _PILOT_RAYS * math.pow(change / accuracy.tolerance, 1.0 / _ORDER) if change > 0.0 else _WHERE_DARK
    return round(min(max(accuracy.source_sampling * needed, _PILOT_RAYS), _MOST_RAYS))


def _typical_microlens(path: LightPath, source: PointSource | DiscSource) -> LightPath:
    """The camera with one microlens only: the one nearest to the chief ray, preferably among those that pixels see."""
    lenses, pixels = path.microlenses, path.pixels
    middles = lenses.centres * projection(path)
    half = np.array(pixels.shape[::-1]) * pixels.pitch / 2.0
    visible = np.all(np.abs(middles - pixels.centre) <= half, axis=1)
    place = source.centre if isinstance(source, DiscSource) else source
    aside = np.linalg.norm(lenses.centres - path.chief_point(place), axis=1)
    index = int(np.argmin(np.where(visible, aside, aside + (np.ptp(aside) + lenses.pitch))))
    return replace(path, microlenses=lenses.only(index))


def _lenses_traced(path: LightPath, source: PointSource | DiscSource) -> int:
    """Number of microlenses through which rays are traced one after another."""
    if isinstance(source, PointSource) or start_of_rays(path, source) != "array":
        return 1
    return sum(1 for _ in lens_orbits(path.microlenses.centres, symmetries(path, source)))


def _tracer(path: LightPath, source: PointSource | DiscSource) -> Tracer:
    if isinstance(source, DiscSource) and start_of_rays(path, source) == "array":
        return array_tracer(path, source)
    return forward_tracer(path, source)


def _sum(trace: Tracer, shifted: int, start: int, stop: int) -> FloatArray:
    """Sum over a long range of rays, block by block."""
    first, *rest = (trace(shifted, begin, min(begin + AT_ONCE, stop)) for begin in range(start, stop, AT_ONCE))
    return sum(rest, first)


def _scatter(sums: FloatArray) -> float:
    """Relative L2 error of the mean of pictures with independent errors, from their scatter."""
    mean = sums.mean(axis=0)
    size = math.sqrt(float(np.sum(mean**2)))
    count = sums.shape[0]
    scatter = math.sqrt(float(np.sum((sums - mean) ** 2)) / (count * (count - 1)))
    return _STANDARD_ERRORS * scatter / size if size > 0.0 else 0.0


def _against(coarse: FloatArray, fine: FloatArray) -> float:
    """Relative L2 error of the finer of two pictures traced from the detector."""
    size = float(np.linalg.norm(fine))
    return _SAFETY * float(np.linalg.norm(fine - coarse)) / size if size > 0.0 else 0.0


def _image_radius(path: LightPath, source: DiscSource) -> float:
    """Radius of a disc's image behind a microlens [pixels], at most that of the image of the pupil."""
    _, _, depth = path.image_at_array(source.centre)
    at_main_image = source.diameter / 2.0 * abs(path.array_distance - depth) / source.distance
    largest = path.main_lens.radius / path.array_distance
    radius = largest if at_main_image >= largest * abs(depth) else at_main_image / abs(depth)
    return path.detector_distance / path.pixels.pitch * radius

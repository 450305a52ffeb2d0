"""Rays in exact directions that sample a picture evenly, from all of the source or through all of pupil and array."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.optics.chain.microlenses import Microlenses
from tradestudy.optics.chain.scene import LightPath, PixelGrid
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


def turned(lens: CircularLens, at: Plane, slope: Plane, *, backward: bool) -> Plane:
    """Slopes behind a thin lens of lines that reach it at given points; with `backward`, slopes in front of it.

    Points are relative to the centre of the lens. The gradient of its path adds to direction cosines; a perfect lens
    keeps t − r/f, which images sharply.
    """
    f, sign = lens.focal_length, 1.0 if backward else -1.0
    if lens.lens_phase == "perfect":
        return slope.plus(at, sign / f)
    cosines = slope.scaled(1.0 / np.sqrt(1.0 + slope.squared))
    if lens.lens_phase == "parabolic":
        cosines = cosines.plus(at, sign / f)
    else:
        assert lens.focus_distance is not None  # guaranteed by CircularLens
        for a in (lens.focus_distance, finite_image_distance(lens.focus_distance, f)):
            cosines = cosines.plus(at, sign * math.copysign(1.0, a) / np.sqrt(at.squared + a**2))
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
    at = np.linspace(max(0.0, centre - width), centre + width, 33)
    squared = source.distance**2 + (nodes.x - at[:, None]) ** 2 + nodes.y**2
    return at**2, np.asarray((source.distance**2 / squared**2) @ nodes.weights)


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
        here, slope = offset.where(inside), arriving.where(inside)
        leaving = turned(lenses.lens(index), here, slope, backward=False) if refracts else slope
        landing = here.plus(leaving, path.detector_distance)
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
            total += sum(moved_image(image, one) for one in copies)
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
    offset, arriving, towards, s = (one.where(lit) for one in (offset, arriving, towards, s))
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

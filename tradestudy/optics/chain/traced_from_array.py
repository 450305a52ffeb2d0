"""Rays through all pairs of points of pupil and microlenses, followed to both ends.

They serve discs that are wider than what the microlenses see: rays from all over such a disc would miss the array.
"""

from __future__ import annotations

import math

import numpy as np

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain.exact_lines import Plane, power_of_points, turned, volume
from tradestudy.optics.chain.sampled_rays import Tracer, even_numbers, on_disc, through_microlens
from tradestudy.optics.chain.scene import LightPath, Microlenses
from tradestudy.optics.chain.sources import DiscSource, lens_orbits, moved_image, symmetries


def array_tracer(path: LightPath, source: DiscSource) -> Tracer:
    """Sum over rays of each microlens whose mean is the share of the pupil's light on each pixel."""
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
    """Rays through one microlens: d²s d²u = (a²/z²) d²x d²u but for what the main lens changes."""
    a, z, main = source.distance, path.array_distance, path.main_lens
    arriving = u.scaled(-1.0).plus(offset).beside(*(-path.microlenses.centres[index])).scaled(1.0 / z)
    towards = turned(main, u, arriving, backward=True)
    s = u.plus(towards, -a)
    lit = np.asarray(s.beside(source.x, source.y).squared <= (source.diameter / 2.0) ** 2)
    offset, arriving, towards, s = (one.where(lit) for one in (offset, arriving, towards, s))
    # (a²/z²) (a/r²)² = cos⁴α/z², of the area of the disc
    power = volume(main, towards, arriving) / (1.0 + towards.squared) ** 2 / np.interp(s.squared, *power_at)
    power *= 4.0 * main.radius**2 * cell_area(path.microlenses) / (z * source.diameter) ** 2
    return through_microlens(path, index, offset, arriving, power)


def cell_area(lenses: Microlenses) -> float:
    """Area [m²] over which points of a microlens are drawn: its aperture, or a rectangle about its cell."""
    if lenses.gaps == "opaque":
        return lenses.aperture_width**2 * (math.pi / 4.0 if lenses.aperture == "circular" else 1.0)
    return lenses.pitch**2 * (1.0 if lenses.layout == "square" else 2.0 / math.sqrt(3.0))


def _on_cell(lenses: Microlenses, first: FloatArray, second: FloatArray) -> Plane:
    """Points all over that area."""
    if lenses.gaps == "opaque" and lenses.aperture == "circular":
        return on_disc(lenses.aperture_width / 2.0, first, second)
    width = lenses.aperture_width if lenses.gaps == "opaque" else lenses.pitch
    return Plane(x=width * (first - 0.5), y=cell_area(lenses) / width * (second - 0.5))

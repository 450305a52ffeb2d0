"""Rays traced forwards, from all over a source through all over the pupil."""

from __future__ import annotations

import math

import numpy as np

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain.exact_lines import Plane, power_of_points, turned
from tradestudy.optics.chain.rays import blur_radius
from tradestudy.optics.chain.sampled_rays import Tracer, even_numbers, on_disc, through_microlens
from tradestudy.optics.chain.scene import LightPath
from tradestudy.optics.chain.sources import DiscSource
from tradestudy.optics.propagation.lens import PointSource


def forward_tracer(path: LightPath, source: PointSource | DiscSource) -> Tracer:
    """Sum over rays whose mean is the share of the pupil's light on each pixel."""
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
        middle, half = _box(x)
        for index in np.flatnonzero(np.all(np.abs(centres - middle) <= half + reach, axis=1)):
            total += through_microlens(path, int(index), x.beside(*centres[index]), arriving, power)
        return total

    return trace


def reached_microlenses(path: LightPath, source: PointSource | DiscSource) -> int:
    """Microlenses about which rays are asked, by paraxial ones."""
    if isinstance(source, DiscSource):
        centre, aside = source.centre, source.diameter / 2.0 * path.array_distance / source.distance
    else:
        centre, aside = source, 0.0
    half = blur_radius(path, centre) + aside + path.microlenses.cell_reach
    chief = np.asarray(path.chief_point(centre))
    return int(np.sum(np.all(np.abs(path.microlenses.centres - chief) <= half, axis=1)))


def _box(points: Plane) -> tuple[FloatArray, FloatArray]:
    """Middle and half the sides of the rectangle about points."""
    low, high = (np.array([end(points.x), end(points.y)]) for end in (np.min, np.max))
    return (low + high) / 2.0, (high - low) / 2.0

"""Rays traced forwards, from all over a source through all over the pupil."""

from __future__ import annotations

import math

import numpy as np

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain.exact_lines import power_of_points, turned
from tradestudy.optics.chain.sampled_rays import Tracer, even_numbers, on_disc, through_microlens
from tradestudy.optics.chain.scene import LightPath
from tradestudy.optics.chain.sources import DiscSource
from tradestudy.optics.propagation.lens import PointSource


def forward_tracer(path: LightPath, source: PointSource | DiscSource) -> Tracer:
    """Sum over rays whose mean is the share of the pupil's light on each pixel."""
    power_at = power_of_points(path, source)
    main, a = path.main_lens, source.distance

    def trace(start: int, stop: int) -> FloatArray:
        numbers = even_numbers(4 if isinstance(source, DiscSource) else 2, start, stop)
        u = on_disc(main.radius, *numbers[:2])
        towards = u.beside(source.x, source.y)
        if isinstance(source, DiscSource):
            towards = towards.plus(on_disc(source.diameter / 2.0, *numbers[2:]), -1.0)
        power = math.pi * main.radius**2 * a**2 / (a**2 + towards.squared) ** 2  # of the paper's amplitude a/r²
        power /= np.interp(u.plus(towards, -1.0).squared, *power_at)
        arriving = turned(main, u, towards.scaled(1.0 / a), backward=False)
        x = u.plus(arriving, path.array_distance)
        total = np.zeros(path.pixels.shape)
        for index, (cx, cy) in enumerate(path.microlenses.centres):
            total += through_microlens(path, index, x.beside(cx, cy), arriving, power)
        return total

    return trace

"""Straight lines in exact directions: where they go, how lenses turn them, and what light they carry."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.optics.chain.scene import LightPath
from tradestudy.optics.chain.sources import DiscSource
from tradestudy.optics.propagation.lens import CircularLens, PointSource, finite_image_distance
from tradestudy.optics.quadrature import disc_nodes

_NOWHERE = 1e12


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
        """Sum with a multiple of other points."""
        return Plane(x=self.x + times * other.x, y=self.y + times * other.y)

    def scaled(self, times: FloatArray | float) -> Plane:
        """Multiple."""
        return Plane(x=times * self.x, y=times * self.y)

    def beside(self, x: float, y: float) -> Plane:
        """Relative to a point."""
        return Plane(x=self.x - x, y=self.y - y)

    def over(self, shape: tuple[int, ...]) -> Plane:
        """Repeated to fill a shape."""
        return Plane(x=np.broadcast_to(self.x, shape), y=np.broadcast_to(self.y, shape))

    def where(self, chosen: BoolArray) -> Plane:
        """Only some."""
        return Plane(x=self.x[chosen], y=self.y[chosen])


def turned(lens: CircularLens, at: Plane, slope: Plane, *, backward: bool) -> Plane:
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
        for a in (lens.focus_distance, finite_image_distance(lens.focus_distance, f)):
            cosines = cosines.plus(at, sign * math.copysign(1.0, a) / np.sqrt(at.squared + a**2))
    squared = cosines.squared
    # Steeper than any line: so far aside that nothing lies there.
    return cosines.scaled(np.where(squared < 1.0, 1.0 / np.sqrt(1.0 - np.minimum(squared, 1.0 - 1e-12)), _NOWHERE))


def volume(lens: CircularLens, before: Plane, behind: Plane) -> FloatArray | float:
    """Volume of slopes before a lens per volume behind it: cos⁴ behind over cos⁴ before, but for perfect lenses."""
    if lens.lens_phase == "perfect":
        return 1.0
    return np.asarray(((1.0 + before.squared) / (1.0 + behind.squared)) ** 2)


def power_of_points(path: LightPath, source: PointSource | DiscSource) -> tuple[FloatArray, FloatArray]:
    """Squared distances from the axis of points of the source [m²], rising, and ∫ a²/r⁴ d²u over the pupil for each."""
    centre = math.hypot(source.x, source.y)
    width = source.diameter if isinstance(source, DiscSource) else path.main_lens.radius
    nodes = disc_nodes(radius=path.main_lens.radius, radial_count=8, angular_count=24)
    at = np.linspace(max(0.0, centre - width), centre + width, 33)
    squared = source.distance**2 + (nodes.x - at[:, None]) ** 2 + nodes.y**2
    return at**2, np.asarray((source.distance**2 / squared**2) @ nodes.weights)

"""Surfaces whose intersections with rays have a closed form: flat faces and spheres."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from tradestudy.errors import OutOfRangeError
from tradestudy.imaging.scenes.surface import Nearby, PatternSource
from tradestudy.optics.arrays import FloatArray

Vector = tuple[float, float, float]
_EDGE_ON: Final = 1e-6  # a face seen at a smaller cosine to its normal is not met


@dataclass(frozen=True, kw_only=True)
class Flat:
    """A flat face: ``centre + u first + v second`` with |u| and |v| at most half its size.

    Parameters
    ----------
    centre
        Its centre [m].
    first, second
        Unit vectors in the face, perpendicular to each other.
    size
        Size along both [m]; may be infinite.
    pattern
        Pattern on it, in u and v from ``origin``.
    origin
        Position of the centre on the pattern [m].

    Raises
    ------
    OutOfRangeError
        The vectors are not perpendicular unit vectors.
    """

    centre: Vector
    first: Vector
    second: Vector
    size: tuple[float, float]
    pattern: PatternSource
    origin: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        frame = np.array([self.first, self.second])
        if not np.allclose(frame @ frame.T, np.eye(2), atol=1e-9):
            raise OutOfRangeError("directions of a face", value=f"{self.first}, {self.second}", limit="orthonormal")

    @cached_property
    def _normal(self) -> FloatArray:
        return np.cross(self.first, self.second)

    @property
    def extent(self) -> tuple[float, float]:
        """See `Surface`."""
        reach = sum(
            abs(vector[2]) * size / 2.0
            for vector, size in zip((self.first, self.second), self.size, strict=True)
            if math.isfinite(size)
        )
        return self.centre[2] - reach, self.centre[2] + reach

    def approach(self, start: FloatArray, slope: FloatArray, spread: float) -> tuple[FloatArray, None]:  # noqa: ARG002 - a closed form needs no help
        """See `Surface`."""
        return self.depth(start, slope, None), None

    def depth(self, start: FloatArray, slope: FloatArray, nearby: Nearby | None) -> FloatArray:  # noqa: ARG002 - as above
        """``n·(c − s)/n·(m, 1)``."""
        kind = start.dtype.type
        nx, ny, nz = (kind(one) for one in self._normal)
        offset = kind(float(self._normal @ np.array(self.centre)))
        along = nx * slope[0] + ny * slope[1] + nz
        along = np.where(np.abs(along) < _EDGE_ON, kind(math.nan), along)
        found = (offset - nx * start[0] - ny * start[1]) / along
        met = found > 0
        if any(math.isfinite(size) for size in self.size):
            u, v = self._coordinates(start + found * slope, found)
            met &= (np.abs(u) <= self.size[0] / 2.0) & (np.abs(v) <= self.size[1] / 2.0)
        return np.where(met, found, kind(math.inf))

    def _coordinates(self, at: FloatArray, depth: FloatArray) -> tuple[FloatArray, FloatArray]:
        kind = at.dtype.type
        x, y, z = at[0] - kind(self.centre[0]), at[1] - kind(self.centre[1]), depth - kind(self.centre[2])
        u, v = (kind(vector[0]) * x + kind(vector[1]) * y + kind(vector[2]) * z for vector in (self.first, self.second))
        return u, v

    def place(self, at: FloatArray, depth: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See `Surface`."""
        u, v = self._coordinates(at, depth)
        return u + at.dtype.type(self.origin[0]), v + at.dtype.type(self.origin[1])

    def pattern_scale(self, depth: FloatArray) -> float:  # noqa: ARG002 - the same everywhere
        """Geometric mean of the scales in both directions, since a slanted face is longer along its slope."""
        return 1.0 / math.sqrt(max(abs(float(self._normal[2])), 0.1))


@dataclass(frozen=True, kw_only=True)
class Sphere:
    """A sphere; its pattern is mapped by arc length from the point nearest to the camera's plane.

    Parameters
    ----------
    centre, radius
        [m].
    pattern
        Its texture.
    """

    centre: Vector
    radius: float
    pattern: PatternSource

    @property
    def extent(self) -> tuple[float, float]:
        """See `Surface`; depths of the visible half."""
        return self.centre[2] - self.radius, self.centre[2]

    def approach(self, start: FloatArray, slope: FloatArray, spread: float) -> tuple[FloatArray, None]:  # noqa: ARG002 - a closed form needs no help
        """See `Surface`."""
        return self.depth(start, slope, None), None

    def depth(self, start: FloatArray, slope: FloatArray, nearby: Nearby | None) -> FloatArray:  # noqa: ARG002 - as above
        """The smaller root of ``|s + z (m, 1) − c| = r``, computed from the ray's point at the depth of the centre."""
        kind = start.dtype.type
        x, y, z = (kind(one) for one in self.centre)
        square = slope[0] * slope[0] + slope[1] * slope[1] + kind(1)
        # Relative to the centre, so that no digits are lost for a small, distant sphere.
        at_x, at_y = start[0] + z * slope[0] - x, start[1] + z * slope[1] - y
        half = (at_x * slope[0] + at_y * slope[1]) / square
        under = half * half - (at_x * at_x + at_y * at_y - kind(self.radius**2)) / square
        found = z - half - np.sqrt(np.maximum(under, 0))
        return np.where((under > 0) & (found > 0), found, kind(math.inf))

    def place(self, at: FloatArray, depth: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See `Surface`."""
        kind = at.dtype.type
        x, y = at[0] - kind(self.centre[0]), at[1] - kind(self.centre[1])
        off_axis = np.hypot(x, y)
        arc = kind(self.radius) * np.arctan2(off_axis, kind(self.centre[2]) - depth)
        stretch = np.where(off_axis > 0, arc / np.where(off_axis > 0, off_axis, 1), 1)
        return x * stretch, y * stretch

    def pattern_scale(self, depth: FloatArray) -> FloatArray:
        """As for a slanted face."""
        cosine = (self.centre[2] - depth) / self.radius
        return np.asarray(1.0 / np.sqrt(np.maximum(cosine, 0.1)))

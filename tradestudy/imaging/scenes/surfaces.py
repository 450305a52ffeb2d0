"""Surfaces of a scene, and where rays meet them: flat faces, spheres, and depths on a grid.

Between samples, depth is interpolated bilinearly. A ray at a gap g in front of the surface crosses s samples per metre;
if the depth changes by at most L from sample to sample, it cannot meet the surface within ``g/(1 + L s)``. It advances
by that distance or to the next sample. Once it has passed the surface, regula falsi finds the point.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from tradestudy.errors import OutOfRangeError
from tradestudy.imaging.scenes.pattern import PicturePattern, RandomPattern, between_samples
from tradestudy.optics.arrays import BoolArray, FloatArray

PatternSource = RandomPattern | PicturePattern


@dataclass(frozen=True, kw_only=True, eq=False)
class Nearby:
    """What following one ray reveals about nearby rays.

    Parameters
    ----------
    safe
        Depth [m] up to which no nearby ray meets the surface, shape (rays,).
    met
        Depth [m] at which the followed ray meets it.
    direct
        Whether both depths are so close that nearby rays also meet the surface there and not earlier.
    """

    safe: FloatArray
    met: FloatArray
    direct: BoolArray


class Surface(Protocol):
    """A surface in the frame of the scene: x to the right, y down, z into it [m].

    A ray passes ``start + z slope`` at depth z; starts and slopes have shape (2, rays), depths (rays,).
    """

    @property
    def pattern(self) -> PatternSource:
        """Pattern on the surface."""

    @property
    def extent(self) -> tuple[float, float]:
        """Nearest and farthest depth of the surface [m]; of an infinite plane, the depth at which the axis meets it."""

    def approach(self, start: FloatArray, slope: FloatArray, spread: float) -> tuple[FloatArray, Nearby | None]:
        """Depth at which rays first meet the surface [m], infinite if never, and what that reveals about nearby rays.

        Nearby rays pass within ``spread`` [m] of the given ones at every depth. None means that `depth` needs no help.
        """

    def depth(self, start: FloatArray, slope: FloatArray, nearby: Nearby | None) -> FloatArray:
        """Depth at which rays first meet the surface [m], given what is known about them."""

    def place(self, points: FloatArray, depth: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions on the pattern, in its unit, of points given by lateral positions (2, points) and depths."""

    def pattern_scale(self, depth: FloatArray) -> FloatArray | float:
        """Lengths on the pattern relative to lengths across the line of sight."""


Vector = tuple[float, float, float]
_EDGE_ON: Final = 1e-6  # a face seen at a smaller cosine to its normal is not met


class ClosedForm(ABC):
    """A surface whose intersections with rays have a closed form, and which is its own declaration."""

    @abstractmethod
    def depth(self, start: FloatArray, slope: FloatArray, nearby: Nearby | None) -> FloatArray:
        """See `Surface`; nothing need be known about rays."""

    def approach(self, start: FloatArray, slope: FloatArray, spread: float) -> tuple[FloatArray, None]:  # noqa: ARG002 - a closed form needs no help
        """See `Surface`."""
        return self.depth(start, slope, None), None

    def build(self) -> Self:
        """Return the surface itself."""
        return self


@dataclass(frozen=True, kw_only=True)
class Flat(ClosedForm):
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

    def depth(self, start: FloatArray, slope: FloatArray, nearby: Nearby | None) -> FloatArray:  # noqa: ARG002 - as above
        """``n·(c − s)/n·(m, 1)``."""
        kind = start.dtype.type
        nx, ny, nz = (kind(component) for component in self._normal)
        offset = kind(float(self._normal @ np.array(self.centre)))
        along = nx * slope[0] + ny * slope[1] + nz
        along = np.where(np.abs(along) < _EDGE_ON, kind(math.nan), along)
        depth = (offset - nx * start[0] - ny * start[1]) / along
        met = depth > 0
        if any(math.isfinite(size) for size in self.size):
            u, v = self._coordinates(start + depth * slope, depth)
            met &= (np.abs(u) <= self.size[0] / 2.0) & (np.abs(v) <= self.size[1] / 2.0)
        return np.where(met, depth, kind(math.inf))

    def _coordinates(self, points: FloatArray, depth: FloatArray) -> tuple[FloatArray, FloatArray]:
        kind = points.dtype.type
        x, y, z = points[0] - kind(self.centre[0]), points[1] - kind(self.centre[1]), depth - kind(self.centre[2])
        u, v = (kind(vector[0]) * x + kind(vector[1]) * y + kind(vector[2]) * z for vector in (self.first, self.second))
        return u, v

    def place(self, points: FloatArray, depth: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See `Surface`."""
        u, v = self._coordinates(points, depth)
        return u + points.dtype.type(self.origin[0]), v + points.dtype.type(self.origin[1])

    def pattern_scale(self, depth: FloatArray) -> float:  # noqa: ARG002 - the same everywhere
        """Geometric mean of the scales in both directions, since a slanted face is longer along its slope."""
        return 1.0 / math.sqrt(max(abs(float(self._normal[2])), 0.1))


@dataclass(frozen=True, kw_only=True)
class Sphere(ClosedForm):
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

    def depth(self, start: FloatArray, slope: FloatArray, nearby: Nearby | None) -> FloatArray:  # noqa: ARG002 - as above
        """The smaller root of ``|s + z (m, 1) − c| = r``, computed from the ray's point at the depth of the centre."""
        kind = start.dtype.type
        x, y, z = (kind(coordinate) for coordinate in self.centre)
        square = slope[0] * slope[0] + slope[1] * slope[1] + kind(1)
        # Relative to the centre, so that no digits are lost for a small, distant sphere.
        at_x, at_y = start[0] + z * slope[0] - x, start[1] + z * slope[1] - y
        half = (at_x * slope[0] + at_y * slope[1]) / square
        under = half * half - (at_x * at_x + at_y * at_y - kind(self.radius**2)) / square
        depth = z - half - np.sqrt(np.maximum(under, 0))
        return np.where((under > 0) & (depth > 0), depth, kind(math.inf))

    def place(self, points: FloatArray, depth: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See `Surface`."""
        kind = points.dtype.type
        x, y = points[0] - kind(self.centre[0]), points[1] - kind(self.centre[1])
        off_axis = np.hypot(x, y)
        arc = kind(self.radius) * np.arctan2(off_axis, kind(self.centre[2]) - depth)
        stretch = np.where(off_axis > 0, arc / np.where(off_axis > 0, off_axis, 1), 1)
        return x * stretch, y * stretch

    def pattern_scale(self, depth: FloatArray) -> FloatArray:
        """As for a slanted face."""
        cosine = (self.centre[2] - depth) / self.radius
        return np.asarray(1.0 / np.sqrt(np.maximum(cosine, 0.1)))


_REFINEMENTS: Final = 4
_CLOSE: Final = 3.0  # in lengths of the last step; within them, a ray meets nothing else
_LEFT: Final = 0.05  # samples; two steps that end farther from the surface were not enough
_SLOWEST: Final = 1e-6  # samples per metre, so that even a ray along the axis reaches a next sample, far away


@dataclass(frozen=True, kw_only=True, eq=False)
class HeightField:
    """Depths on a grid.

    Parameters
    ----------
    depths
        [m], shape (rows, columns), rows down.
    corner
        Position of the first sample: x and y [m], or the slopes x/z and y/z if the map is in perspective.
    step
        Distance between samples, in the same unit.
    perspective
        Whether the grid is that of a pinhole at the origin, not of parallel lines of sight.
    repeats
        Whether the grid repeats endlessly, which requires powers of two of rows and columns; otherwise there is nothing
        beyond its edge.
    pattern
        Pattern in the unit of the grid, or in samples if ``pattern_in_samples``.
    pattern_in_samples
        Whether the pattern has one sample for each grid sample.
    """

    depths: NDArray[np.float32]
    corner: tuple[float, float]
    step: float
    perspective: bool
    repeats: bool
    pattern: PatternSource
    pattern_in_samples: bool = False
    steepest: float = field(init=False)
    padded: NDArray[np.float32] = field(init=False, repr=False)
    extent: tuple[float, float] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "extent", (float(self.depths.min()), float(self.depths.max())))
        # Then every sample has a successor along both axes.
        beyond = np.pad(self.depths, (0, 1), mode="wrap" if self.repeats else "edge")
        object.__setattr__(self, "padded", beyond)
        # Within a cell, both slopes lie between those of its edges.
        across, down = np.abs(np.diff(self.depths, axis=1)), np.abs(np.diff(self.depths, axis=0))
        steepest = np.hypot(np.maximum(across[1:], across[:-1]), np.maximum(down[:, 1:], down[:, :-1]))
        object.__setattr__(self, "steepest", float(steepest.max()))

    def approach(self, start: FloatArray, slope: FloatArray, spread: float) -> tuple[FloatArray, Nearby]:
        """See `Surface`."""
        near = self.extent[0]
        margin = self.steepest * spread / (self.step * (near if self.perspective else 1.0))
        begin = np.full(start.shape[1], near * (1.0 - 1e-6), start.dtype)
        depth, safe = self._march(start, slope, begin, margin)
        close = depth - safe <= _CLOSE * (margin + 1.0 / self._speed(start, slope))
        return depth, Nearby(safe=safe, met=depth, direct=np.isfinite(depth) & close)

    def depth(self, start: FloatArray, slope: FloatArray, nearby: Nearby | None) -> FloatArray:
        """See `Surface`."""
        if nearby is None:
            return self.approach(start, slope, 0.0)[0]
        # Two steps suffice for most rays near one whose depth is known; the others march from where they are safe.
        guess, near = nearby.met, nearby.direct
        if not near.all():
            guess = np.where(near, guess, nearby.safe)
        depth, remaining = self._directly(start, slope, guess)
        far = np.flatnonzero(~near | (remaining > self.step * (self.extent[0] if self.perspective else 1.0) * _LEFT))
        if far.size:
            depth[far] = self._march(start[:, far], slope[:, far], nearby.safe[far], 0.0)[0]
        return depth

    def _directly(self, start: FloatArray, slope: FloatArray, first: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Where rays meet the surface, by a step across the gap at a first guess and a second one along the secant.

        Returns
        -------
        depth
            The depth found, corrected once more by the remaining gap.
        left
            Distance from the surface at which the second step ended [m].
        """
        gap = self._gap(start, slope, first)
        second = first + gap
        next_gap = self._gap(start, slope, second)
        change = next_gap - gap
        steady = np.abs(change) > np.abs(gap) * start.dtype.type(0.1)
        third = np.where(steady, second - next_gap * gap / np.where(steady, change, 1), second + next_gap)
        remaining = self._gap(start, slope, third)
        return self._where_there_is_any(start, slope, third + remaining), np.abs(remaining)

    def place(self, points: FloatArray, depth: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See `Surface`."""
        if self.pattern_in_samples:
            i, j = self._grid(points, depth)
            half = points.dtype.type(0.5)  # a sample of the pattern is centred half its size from its corner
            return i + half, j + half
        return points[0], points[1]

    def pattern_scale(self, depth: FloatArray) -> FloatArray | float:
        """See `Surface`; the slopes of the surface itself are neglected."""
        if not self.pattern_in_samples:
            return 1.0
        return 1.0 / (self.step * depth) if self.perspective else 1.0 / self.step

    def _grid(self, points: FloatArray, depth: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Position of a point on the grid, in samples."""
        kind = points.dtype.type
        scale = kind(1.0 / self.step)
        if self.perspective:
            points = points / depth
        return (points[0] - kind(self.corner[0])) * scale, (points[1] - kind(self.corner[1])) * scale

    def _speed(self, start: FloatArray, slope: FloatArray) -> FloatArray:
        """Samples that rays cross per metre."""
        kind = start.dtype.type
        if self.perspective:
            speed = np.hypot(start[0], start[1]) / kind(self.extent[0] ** 2)
        else:
            speed = np.hypot(slope[0], slope[1])
        return np.asarray(np.maximum(speed / kind(self.step), kind(_SLOWEST)))

    def _gap(self, start: FloatArray, slope: FloatArray, z: FloatArray) -> FloatArray:
        """Distance from depth z [m] to the surface along the axis."""
        i, j = self._grid(start + z * slope, z)
        rows, columns = self.depths.shape
        if not self.repeats:
            i, j = np.clip(i, 0, columns - 1), np.clip(j, 0, rows - 1)
        left, top = np.floor(i), np.floor(j)
        i -= left
        j -= top
        first, row = left.astype(np.intp), top.astype(np.intp)
        if self.repeats:
            first &= columns - 1
            row &= rows - 1
        row *= columns + 1
        first += row
        return between_samples(self.padded, first, columns + 1, i, j) - z

    def _march(
        self, start: FloatArray, slope: FloatArray, begin: FloatArray, margin: float
    ) -> tuple[FloatArray, FloatArray]:
        """Where rays meet the surface, and the depth up to which each stays farther from it than the margin."""
        kind = start.dtype.type
        far = self.extent[1]
        speed = self._speed(start, slope)
        end = kind(far * (1.0 + 1e-6))
        gap = self._gap(start, slope, begin)
        behind = np.flatnonzero(gap < 0)  # these are behind the surface, so begin in front of all of it
        if behind.size:
            begin = begin.copy()
            begin[behind] = self.extent[0] * (1.0 - 1e-6)
            gap[behind] = self._gap(start.take(behind, axis=1), slope.take(behind, axis=1), begin[behind])
        safe, ray, z = begin.copy(), np.arange(begin.size), begin
        close = gap <= margin
        passed = []
        lines = start, slope
        while ray.size:
            # The margin matters only until the first nearby ray may meet the surface.
            reach = np.where(close, gap, gap - kind(margin)) / (kind(1) + kind(self.steepest) * speed)
            following = np.minimum(z + np.maximum(reach, kind(1) / speed), end)
            next_gap = self._gap(*lines, following)
            met = next_gap <= 0
            if np.any(met):
                passed.append([values[met] for values in (ray, z, gap, following, next_gap)])
            close |= next_gap <= margin
            going = ~close
            safe[ray[going]] = following[going]
            on = np.flatnonzero(~met & (following < end))
            if on.size < ray.size:
                ray, close, speed = ray.take(on), close.take(on), speed.take(on)
                following, next_gap = following.take(on), next_gap.take(on)
                lines = lines[0].take(on, axis=1), lines[1].take(on, axis=1)
            z, gap = following, next_gap
        depth = np.full(begin.size, math.inf, begin.dtype)
        if passed:
            met, *bracket = (np.concatenate(parts) for parts in zip(*passed, strict=True))
            depth[met] = self._between(start.take(met, axis=1), slope.take(met, axis=1), *bracket)
        return depth, safe

    def _between(
        self,
        start: FloatArray,
        slope: FloatArray,
        z: FloatArray,
        gap: FloatArray,
        beyond: FloatArray,
        beyond_gap: FloatArray,
    ) -> FloatArray:
        """Regula falsi between a depth in front of the surface and one behind it; infinite beyond the grid's edge."""
        for _ in range(_REFINEMENTS):
            middle = z + (beyond - z) * (gap / (gap - beyond_gap))
            middle_gap = self._gap(start, slope, middle)
            before = middle_gap > 0
            z, gap = np.where(before, middle, z), np.where(before, middle_gap, gap)
            beyond, beyond_gap = np.where(before, beyond, middle), np.where(before, beyond_gap, middle_gap)
        middle = z + (beyond - z) * (gap / np.maximum(gap - beyond_gap, start.dtype.type(1e-30)))
        return self._where_there_is_any(start, slope, middle)

    def _where_there_is_any(self, start: FloatArray, slope: FloatArray, depth: FloatArray) -> FloatArray:
        """Depths within the grid; infinite beyond its edge."""
        if self.repeats:
            return np.array(depth)
        i, j = self._grid(start + depth * slope, depth)
        rows, columns = self.depths.shape
        within = (i >= -0.5) & (i <= columns - 0.5) & (j >= -0.5) & (j <= rows - 0.5)
        return np.where(within, depth, start.dtype.type(math.inf))

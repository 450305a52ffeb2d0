"""Where the field is wanted: any set of points, or a regular grid in a plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray


@dataclass(frozen=True, kw_only=True)
class TargetPoints:
    """Any set of points behind the lens plane.

    Parameters
    ----------
    x, y
        Positions [m], any shapes that broadcast.
    distance
        Distance behind the lens plane [m], > 0; a number or an array that broadcasts with x and y, so that tilted or
        curved surfaces are points too.

    Raises
    ------
    OutOfRangeError
        A coordinate is not finite, a distance is not positive, or there is no point.
    """

    x: npt.ArrayLike
    y: npt.ArrayLike
    distance: npt.ArrayLike

    def __post_init__(self) -> None:
        _check(*self.coordinates())

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the results."""
        return np.broadcast_shapes(np.shape(self.x), np.shape(self.y), np.shape(self.distance))

    def coordinates(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Flat x, y, distance of every point."""
        arrays = np.broadcast_arrays(*(np.asarray(v, dtype=float) for v in (self.x, self.y, self.distance)))
        x, y, z = (np.ascontiguousarray(v).ravel() for v in arrays)
        return x, y, z


@dataclass(frozen=True, kw_only=True)
class TargetGrid:
    """A regular grid in one plane, the fast case.

    Results have shape (y count, x count): row i lies at ``y_start + i * y_pitch``, column j at
    ``x_start + j * x_pitch``; nothing is mirrored.

    Parameters
    ----------
    x_start, y_start
        Position of element [0, 0] [m].
    x_pitch, y_pitch
        Steps [m], > 0.
    x_count, y_count
        Numbers of columns and rows, ≥ 1.
    distance
        Distance behind the lens plane [m], > 0.

    Raises
    ------
    OutOfRangeError
        A coordinate is not finite, a pitch or the distance is not positive, or a count is below 1.
    """

    x_start: float
    y_start: float
    x_pitch: float
    y_pitch: float
    x_count: int
    y_count: int
    distance: float

    def __post_init__(self) -> None:
        if self.x_count < 1 or self.y_count < 1:
            raise OutOfRangeError("target grid", value=f"{self.x_count} × {self.y_count} points", limit="≥ 1 × 1")
        if not (self.x_pitch > 0 and self.y_pitch > 0):
            raise OutOfRangeError("target pitch", value=f"{self.x_pitch:g}, {self.y_pitch:g} m", limit="> 0")
        _check(self.x_axis, self.y_axis, np.asarray([self.distance], dtype=float))

    @classmethod
    def centred(cls, *, centre: tuple[float, float], pitch: float, count: int, distance: float) -> TargetGrid:
        """Square grid of `count` × `count` points, its middle at `centre`, as pixels lie about a sensor's middle."""
        half = pitch * (count - 1) / 2
        return cls(
            x_start=centre[0] - half,
            y_start=centre[1] - half,
            x_pitch=pitch,
            y_pitch=pitch,
            x_count=count,
            y_count=count,
            distance=distance,
        )

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the results: rows (y), columns (x)."""
        return self.y_count, self.x_count

    @property
    def x_axis(self) -> FloatArray:
        """Positions of the columns [m]."""
        return self.x_start + self.x_pitch * np.arange(self.x_count, dtype=float)

    @property
    def y_axis(self) -> FloatArray:
        """Positions of the rows [m]."""
        return self.y_start + self.y_pitch * np.arange(self.y_count, dtype=float)

    def coordinates(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Flat x, y, distance of every point, row by row."""
        x = np.tile(self.x_axis, self.y_count)
        return x, np.repeat(self.y_axis, self.x_count), np.full(x.size, self.distance)


Targets = TargetPoints | TargetGrid


def _check(x: FloatArray, y: FloatArray, z: FloatArray) -> None:
    if x.size == 0:
        raise OutOfRangeError("targets", value="none", limit="at least one point", remedy="give a point")
    if not (np.isfinite(x).all() and np.isfinite(y).all() and np.isfinite(z).all() and z.min() > 0):
        raise OutOfRangeError(
            "targets",
            value=f"nearest at {np.min(z):g} m behind the lens plane",
            limit="finite coordinates, distance > 0",
            remedy="measure the distance along the light, from the lens plane",
        )

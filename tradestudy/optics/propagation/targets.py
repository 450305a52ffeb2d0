"""Targets of a propagation: any points behind the lens plane, or a regular grid."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tradestudy.errors import OutOfRangeError, UnaffordableError
from tradestudy.optics.argument_types import checked, checked_fields
from tradestudy.optics.arrays import FloatArray, IndexArray

_MOST_ON_AXIS = 10**7


@checked_fields
@dataclass(frozen=True, kw_only=True)
class TargetPoints:
    """Targets, that is, points at which a field is computed, anywhere behind the lens plane.

    x, y and distance are numbers or arrays, which are broadcast together.

    Parameters
    ----------
    x, y
        Transverse coordinates of the points [m].
    distance
        Distances of the points from the lens plane [m], > 0. An array places them on a tilted or curved surface.

    Raises
    ------
    OutOfRangeError
        The shapes do not broadcast, a coordinate is not finite, a distance is not positive, or there are no points.

    Examples
    --------
    Eleven points on the axis, up to 50 µm in front of and behind a focus:

    >>> import numpy as np
    >>> from tradestudy import optics
    >>> points = optics.TargetPoints(x=0.0, y=0.0, distance=50e-3 + np.linspace(-50e-6, 50e-6, 11))
    >>> points.shape, points.coordinates()[2].size, points.corners().size
    ((11,), 11, 4)
    >>> print(f"from {points.box()[2][0]:.5f} m; the last one at {points.at(np.array([10]))[2][0]:.5f} m")
    from 0.04995 m; the last one at 0.05005 m
    """

    x: npt.ArrayLike
    y: npt.ArrayLike
    distance: npt.ArrayLike

    def __post_init__(self) -> None:
        shapes = np.shape(self.x), np.shape(self.y), np.shape(self.distance)
        try:
            np.broadcast_shapes(*shapes)
        except ValueError:
            raise OutOfRangeError(
                "shapes of x, y and distance",
                value=", ".join(map(str, shapes)),
                limit="shapes that broadcast",
                remedy="give arrays of one shape, or single numbers",
            ) from None
        _check(*self.coordinates())

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of fields computed at these points, to which x, y and distance broadcast."""
        return np.broadcast_shapes(np.shape(self.x), np.shape(self.y), np.shape(self.distance))

    def coordinates(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return x, y and distance of every point [m], as three flat arrays."""
        arrays = np.broadcast_arrays(*(np.asarray(v, dtype=float) for v in (self.x, self.y, self.distance)))
        x, y, z = (np.ascontiguousarray(v).ravel() for v in arrays)
        return x, y, z

    def at(self, index: IndexArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the positions of selected points.

        Parameters
        ----------
        index
            Indices into the flat arrays of `coordinates`, shape (n,).

        Returns
        -------
        tuple
            x, y and distance [m], shape (n,) each.
        """
        x, y, z = self.coordinates()
        return x[index], y[index], z[index]

    def box(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the smallest and the largest value of x, y and distance [m], as three arrays of shape (2,)."""
        x, y, z = (np.array([np.min(c), np.max(c)], dtype=float) for c in (self.x, self.y, self.distance))
        return x, y, z

    def corners(self) -> IndexArray:
        """Return the indices, as for `at`, of the points with the extreme values of x + y and x − y, shape (4,)."""
        x, y, _ = self.coordinates()
        rising, falling = x + y, x - y
        return np.array([np.argmin(rising), np.argmin(falling), np.argmax(falling), np.argmax(rising)])


@checked_fields
@dataclass(frozen=True, kw_only=True)
class TargetGrid:
    """Targets, that is, points at which a field is computed, on a regular grid parallel to the lens plane.

    Fields on such a grid are computed faster than at scattered `TargetPoints`. They have the shape (y_count, x_count):
    row i lies at y = ``y_start + i * y_pitch``, and column j at x = ``x_start + j * x_pitch``.

    Parameters
    ----------
    x_start
        x of the first column [m].
    y_start
        y of the first row [m].
    x_pitch
        Distance between neighbouring columns [m], > 0.
    y_pitch
        Distance between neighbouring rows [m], > 0.
    x_count
        Number of columns, from 1 to 10⁷.
    y_count
        Number of rows, from 1 to 10⁷.
    distance
        Distance of the grid from the lens plane [m], > 0.

    Raises
    ------
    OutOfRangeError
        A coordinate is not finite, a pitch or the distance is not positive, or a count is below 1.
    UnaffordableError
        A count is above 10⁷.

    Examples
    --------
    >>> from tradestudy import optics
    >>> grid = optics.TargetGrid.centred(centre=(0.0, 0.0), pitch=0.5e-6, count=65, distance=50e-3)
    >>> grid.shape, f"{grid.x_axis[0]:.3g}"
    ((65, 65), '-1.6e-05')
    >>> x, y, distance = grid.at(grid.corners())
    >>> print(f"x of the corners: {x * 1e6} µm; smallest y: {grid.box()[1][0] * 1e6:.3g} µm")
    x of the corners: [-16. -16.  16.  16.] µm; smallest y: -16 µm
    >>> print(f"{grid.coordinates()[0].size} points")
    4225 points
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
            raise OutOfRangeError(
                "target grid",
                value=f"{self.x_count} × {self.y_count} points",
                limit="≥ 1 × 1",
                remedy="raise the counts",
            )
        if not (0 < self.x_pitch < math.inf and 0 < self.y_pitch < math.inf):
            raise OutOfRangeError(
                "target pitch",
                value=f"{self.x_pitch:g}, {self.y_pitch:g} m",
                limit="> 0, finite",
                remedy="give steps in metres",
            )
        if max(self.x_count, self.y_count) > _MOST_ON_AXIS:
            raise UnaffordableError(
                "target grid",
                value=f"{self.x_count} × {self.y_count} points",
                limit=f"at most {_MOST_ON_AXIS} along an axis",
                remedy="lower the counts",
            )
        _check(*self.box())

    @classmethod
    @checked
    def centred(cls, *, centre: tuple[float, float], pitch: float, count: int, distance: float) -> TargetGrid:
        """Return a square grid about a centre.

        Parameters
        ----------
        centre
            Centre of the grid (x, y) [m].
        pitch
            Distance between neighbouring points [m], > 0.
        count
            Number of points along a side, from 1 to 10⁷.
        distance
            Distance of the grid from the lens plane [m], > 0.

        Returns
        -------
        TargetGrid
            Grid of ``count`` × ``count`` points.

        Raises
        ------
        OutOfRangeError
            A coordinate is not finite, the pitch or the distance is not positive, or the count is below 1.
        UnaffordableError
            The count is above 10⁷.
        """
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
        """Shape of fields computed on this grid, (y_count, x_count)."""
        return self.y_count, self.x_count

    @property
    def x_axis(self) -> FloatArray:
        """x of every column [m], shape (x_count,)."""
        return self.x_start + self.x_pitch * np.arange(self.x_count, dtype=float)

    @property
    def y_axis(self) -> FloatArray:
        """y of every row [m], shape (y_count,)."""
        return self.y_start + self.y_pitch * np.arange(self.y_count, dtype=float)

    def coordinates(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return x, y and distance of every point [m], row by row, as three flat arrays."""
        x = np.tile(self.x_axis, self.y_count)
        return x, np.repeat(self.y_axis, self.x_count), np.full(x.size, self.distance)

    def at(self, index: IndexArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the positions of selected points.

        Parameters
        ----------
        index
            Indices into the flat arrays of `coordinates`, shape (n,).

        Returns
        -------
        tuple
            x, y and distance [m], shape (n,) each.
        """
        row, column = np.divmod(index, self.x_count)
        return self.x_axis[column], self.y_axis[row], np.full(index.size, self.distance)

    def box(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the smallest and the largest value of x, y and distance [m], as three arrays of shape (2,)."""
        return (
            self.x_start + self.x_pitch * np.array([0.0, self.x_count - 1.0]),
            self.y_start + self.y_pitch * np.array([0.0, self.y_count - 1.0]),
            np.array([self.distance, self.distance]),
        )

    def corners(self) -> IndexArray:
        """Return the indices of the four corners of the grid, as for `at`, shape (4,)."""
        last = self.x_count - 1, self.x_count * (self.y_count - 1)
        return np.array([0, last[1], last[0], last[0] + last[1]])


Targets = TargetPoints | TargetGrid


def _check(x: FloatArray, y: FloatArray, z: FloatArray) -> None:
    if x.size == 0:
        raise OutOfRangeError("targets", value="none", limit="at least one point", remedy="give a point")
    if not (np.isfinite(x).all() and np.isfinite(y).all() and np.isfinite(z).all() and z.min() > 0):
        raise OutOfRangeError(
            "targets",
            value=f"nearest at {np.min(z):g} m behind the lens plane",
            limit="finite coordinates, distance > 0",
            remedy="measure the distance from the lens plane in the direction of the light",
        )

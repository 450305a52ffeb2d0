"""Targets at which a field is computed, and interpolation on their grids and rings from fewer points.

A field that hardly changes around the chief ray has few harmonics in the angle; its radius uses Chebyshev points.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import scipy.special

from tradestudy.errors import OutOfRangeError, UnaffordableError
from tradestudy.optics.arguments import checked
from tradestudy.optics.arrays import ComplexArray, FloatArray, IndexArray
from tradestudy.optics.propagation.sampling import bessel_margin

_MOST_ON_AXIS = 10**7


@checked
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


@checked
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


_UNTHREADED = 250_000  # multiplications in a product that BLAS still computes on one thread
_LEAST_OVERSAMPLING = 1.7  # of the coarse samples; closer to 1 the window gets wide
_FEWEST_ANGLES = 12
_TAIL = 3.0  # times the tolerance: limit for the last harmonics on the ring with the strongest ones
_CUBIC = 0.024  # interpolation through four points errs by this times the fourth power of the phase per step
FieldAt = Callable[[FloatArray, FloatArray], ComplexArray | None]


@dataclass(frozen=True, kw_only=True)
class Upsampling:
    """Coarse samples of one axis, and the matrix from them to the fine ones.

    Attributes
    ----------
    step
        Fine samples per coarse sample; 1 where upsampling gains nothing.
    first, count
        The coarse samples lie at fine indices ``first + step * arange(count)``, and extend beyond the fine ones.
    matrix
        Matrix from coarse to fine samples, shape (fine, count).
    """

    step: int
    first: int
    count: int
    matrix: FloatArray

    def apply(self, values: ComplexArray) -> ComplexArray:
        """Fine samples from coarse ones, along the rows of `values`; each fine sample depends on few coarse ones."""
        plain = np.ascontiguousarray(values).view(np.float64)
        fine, overhang = self.matrix.shape[0], -2 * self.first // self.step
        result = np.empty((fine, plain.shape[1]))
        most = max(1, min(4 * self.step, _UNTHREADED // ((overhang + 5) * plain.shape[1])))
        for start in range(0, fine, most):
            rows = slice(start, min(start + most, fine))
            near = slice(start // self.step, (rows.stop - 1) // self.step + overhang + 1)
            np.matmul(self.matrix[rows, near], plain[near], out=result[rows])
        return np.asarray(result.view(np.complex128))


@lru_cache(maxsize=16)  # both axes of a square grid, and every wave on the same grid, share one
def upsampling(*, fine_count: int, oversampling: float, tolerance: float) -> Upsampling | None:
    """Plan for an axis with `fine_count` samples, `oversampling` times finer than Nyquist's; None if there is no gain.

    The window's half-width in coarse samples is ln(1/tolerance)/(π (1 − 1/σ)) for coarse samples σ times finer than
    Nyquist's (J. J. Knab, "Interpolation of band-limited functions using the approximate prolate series", 1979).
    """
    step = int(oversampling / _LEAST_OVERSAMPLING) if math.isfinite(oversampling) else fine_count
    if step < 2:
        return None
    gap = 1 - step / oversampling
    half = math.ceil(math.log(1 / tolerance) / (math.pi * gap)) + 1
    count = math.ceil((fine_count - 1) / step) + 1 + 2 * half
    if count > 0.7 * fine_count:
        return None
    first = -half * step
    distance = (np.arange(fine_count)[:, None] - (first + step * np.arange(count))) / step
    window = np.sqrt(np.clip(1 - (distance / half) ** 2, 0.0, None))
    shape = math.pi * half * gap
    kernel = np.sinc(distance) * scipy.special.i0(shape * window) / scipy.special.i0(shape)
    matrix = np.where(np.abs(distance) <= half, kernel, 0.0)
    matrix.setflags(write=False)
    return Upsampling(step=step, first=first, count=count, matrix=matrix)


def apply_along_rows(matrix: FloatArray, values: ComplexArray) -> ComplexArray:
    """Real matrix times complex array, without a complex copy of the matrix.

    Blocks are smaller than the size from which BLAS starts threads: for products this small, threads cost more than
    they save, and far more where cores are shared.
    """
    plain = np.ascontiguousarray(values).view(np.float64)
    product = np.empty((matrix.shape[0], plain.shape[1]))
    rows = max(1, _UNTHREADED // plain.size)
    for start in range(0, matrix.shape[0], rows):
        np.matmul(matrix[start : start + rows], plain, out=product[start : start + rows])
    return np.asarray(product.view(np.complex128))


def chebyshev_points(values: FloatArray, count: int) -> FloatArray:
    """Chebyshev points of the first kind on the range of `values`."""
    middle, half = 0.5 * (values.min() + values.max()), 0.5 * np.ptp(values)
    return np.asarray(middle + half * _unit_chebyshev(count))


@lru_cache(maxsize=32)
def _unit_chebyshev(count: int) -> FloatArray:
    return np.cos(np.pi * (np.arange(count) + 0.5) / count)


def lagrange(values: FloatArray, count: int, box: FloatArray | None = None) -> FloatArray:
    """Values of the Lagrange polynomials of the Chebyshev points, shape (values, count).

    By the barycentric formula, which stays accurate next to a point, where one term outweighs all others
    (N. J. Higham, "The numerical stability of barycentric Lagrange interpolation", 2004).
    """
    over = values if box is None else box
    if count == 1:
        return np.ones((values.size, 1))
    difference = np.subtract.outer(values, chebyshev_points(over, count))
    hits = np.argwhere(difference == 0)
    difference[tuple(hits.T)] = 1.0
    order = np.arange(count)
    weights = np.where(order % 2 == 0, 1.0, -1.0) * np.sin(np.pi * (order + 0.5) / count)
    terms = weights / difference
    terms /= terms.sum(axis=1, keepdims=True)
    for row, column in hits:
        terms[row] = order == column
    return terms


@dataclass(frozen=True, kw_only=True)
class ChebyshevGrid:
    """Chebyshev points in the box of a grid, for fields that can be evaluated anywhere.

    Attributes
    ----------
    x, y
        Points of each axis [m].
    on_x, on_y
        Matrices from the points to the columns and rows of the grid.
    """

    x: FloatArray
    y: FloatArray
    on_x: FloatArray
    on_y: FloatArray

    def points(self) -> tuple[FloatArray, FloatArray]:
        """Flat positions of the tensor product, x running fastest."""
        return np.tile(self.x, self.y.size), np.repeat(self.y, self.x.size)

    def interpolate(self, values: ComplexArray) -> ComplexArray:
        """Values on the grid from values at `points`."""
        rows = apply_along_rows(self.on_y, values.reshape(self.y.size, self.x.size))
        return apply_along_rows(self.on_x, rows.T).T


def chebyshev_grid(grid: TargetGrid, *, wavenumber: float, tolerance: float) -> ChebyshevGrid | None:
    """Enough Chebyshev points for a field of at most `wavenumber` [rad/m] along each axis; None if no gain.

    A plane wave of m radians over half the axis needs as many points as a Bessel function of argument m has orders
    above the tolerance.
    """
    counts = [
        max(2, math.ceil(turns + bessel_margin(turns, tolerance)))
        for turns in (
            wavenumber * grid.x_pitch * (grid.x_count - 1) / 2,
            wavenumber * grid.y_pitch * (grid.y_count - 1) / 2,
        )
    ]
    if counts[0] * counts[1] > 0.7 * grid.x_count * grid.y_count or min(grid.x_count, grid.y_count) < 2:
        return None
    x, y = grid.x_axis, grid.y_axis
    return ChebyshevGrid(
        x=chebyshev_points(x, counts[0]),
        y=chebyshev_points(y, counts[1]),
        on_x=lagrange(x, counts[0]),
        on_y=lagrange(y, counts[1]),
    )


@dataclass(frozen=True, kw_only=True)
class PolarField:
    """A smooth field about a centre, Σ g_j(r) exp(i j φ).

    Attributes
    ----------
    centre
        Centre of the disc [m].
    radius
        Radius up to which the field is known [m].
    harmonics
        Azimuthal orders j, shape (harmonics,).
    table
        g_j at equal steps of the radius, one step beyond either end, shape (steps + 3, harmonics).
    """

    centre: tuple[float, float]
    radius: float
    harmonics: FloatArray
    table: ComplexArray

    def at(self, x: FloatArray, y: FloatArray) -> ComplexArray:
        """Field at points, interpolated from four neighbouring radii; `x` and `y` broadcast."""
        a, b = np.broadcast_arrays(x - self.centre[0], y - self.centre[1])
        a, b = a.ravel(), b.ravel()
        r = np.hypot(a, b)
        steps = self.table.shape[0] - 3
        place = r * (steps / self.radius)
        cell = np.minimum(place.astype(int), steps - 1)
        t = place - cell
        # Lagrange's cubic through the radii −1, 0, 1 and 2 steps from the cell: the table begins a step early.
        weights = (
            t * (t - 1) * (2 - t) / 6,
            (t + 1) * (t - 1) * (t - 2) / 2,
            t * (t + 1) * (2 - t) / 2,
            t * (t * t - 1) / 6,
        )
        turn = np.where(r > 0, a + 1j * b, 1.0) / np.where(r > 0, r, 1.0)
        middle = self.harmonics.size // 2
        # Products replace an exponential of every harmonic at every point; negative orders are their conjugates.
        power = [np.ones_like(turn)]
        for _ in range(middle):
            power.append(power[-1] * turn)
        total = np.zeros(r.size, dtype=np.complex128)
        columns = np.ascontiguousarray(self.table.T)
        for j, column in zip(range(-middle, middle + 1), columns, strict=True):
            value = sum(w * column[cell + i] for i, w in enumerate(weights))
            total += value * (power[j] if j >= 0 else power[-j].conj())
        return total


def polar_field(
    field: FieldAt, *, centre: tuple[float, float], radius: float, wavenumber: float, tolerance: float, most: int
) -> PolarField | None:
    """Sample a field on rings about a centre; None if that takes more than `most` points or a value is missing.

    Parameters
    ----------
    field
        Function that returns the field at flat points, or None where it cannot be computed.
    centre
        Centre about which the field changes little with the angle [m].
    radius
        Radius of the disc [m].
    wavenumber
        Largest wavenumber of the field along any direction [rad/m]: a plane wave of m radians over the radius needs as
        many Chebyshev points on the diameter as a Bessel function of argument m has orders above the tolerance.
    tolerance
        Tolerance relative to the largest field found.
    most
        Number of points above which rings do not pay off.
    """
    turns = wavenumber * radius
    steps = math.ceil(turns * (_CUBIC / tolerance) ** 0.25) + 4
    # Out to the last step of the table: polynomials of this degree magnify errors one step beyond their points.
    reach = 1 + 1 / steps
    half = math.ceil((reach * turns + bessel_margin(reach * turns, tolerance)) / 2) + 1
    rings = reach * radius * np.cos(np.pi * (np.arange(half) + 0.5) / (2 * half))
    coefficients = _harmonics(field, centre, rings, _TAIL * tolerance, most)
    if coefficients is None:
        return None
    harmonics = np.arange(coefficients.shape[1]) - coefficients.shape[1] // 2
    # The radius −r is the radius r at the opposite angle: odd harmonics change sign.
    onto = lagrange(np.arange(-1, steps + 2) / steps, 2 * half, np.array([-reach, reach]))
    sign = np.where(harmonics % 2 == 0, 1.0, -1.0)
    table = apply_along_rows(onto, np.concatenate([coefficients, coefficients[::-1] * sign]))
    return PolarField(centre=centre, radius=radius, harmonics=harmonics.astype(float), table=table)


def _harmonics(
    field: FieldAt, centre: tuple[float, float], radii: FloatArray, tolerance: float, most: int
) -> ComplexArray | None:
    """Angular Fourier coefficients −m … m on rings, shape (rings, 2m + 1), m doubled until the last two are small."""
    values: ComplexArray = np.zeros((radii.size, 0), dtype=np.complex128)
    angles = _FEWEST_ANGLES
    while radii.size * angles <= most:
        # The previous angles are every other one of these.
        new = np.arange(angles) if values.size == 0 else np.arange(1, angles, 2)
        angle = 2 * np.pi * new / angles
        x = centre[0] + np.multiply.outer(radii, np.cos(angle))
        y = centre[1] + np.multiply.outer(radii, np.sin(angle))
        flat = field(x.ravel(), y.ravel())
        if flat is None:
            return None
        added: ComplexArray = flat.reshape(x.shape)
        values = np.stack([values, added], axis=2).reshape(radii.size, angles) if values.size else added
        coefficients = np.fft.fft(values, axis=1) / angles
        size = np.abs(coefficients).max(axis=0)
        half = angles // 2
        # These three are the highest harmonics; harmonics beyond them would be aliased onto these first.
        if size[[half - 1, half, half + 1]].max() <= tolerance * size.max():
            return np.asarray(np.roll(coefficients, half - 1, axis=1)[:, : 2 * half - 1])
        angles *= 2
    return None

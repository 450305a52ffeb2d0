"""A sampled point-spread function: interpolation, peak, disc moments, and the errors of numbers computed from it.

The intensity is sampled on a uniform grid and interpolated by a quintic spline. Each number is computed three
times: from all samples, from every second and from every fourth. The changes give its numerical error.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arguments import checked
from tradestudy.optics.arrays import FloatArray, require

if TYPE_CHECKING:
    from scipy.interpolate import RectBivariateSpline
from tradestudy.optics.propagation.result import ApertureField
from tradestudy.optics.propagation.targets import TargetGrid, Targets

_LEAST_SAMPLES = 33  # along a side; every fourth of them still supports a quintic spline
_FEW_VALUES = 4  # number of values up to which all are written out
_BEST_REDUCTION = 1 / 16  # of the error when the spacing is halved; a quintic spline approaches 1/64


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class Measured(np.lib.mixins.NDArrayOperatorsMixin):
    """A number or an array of numbers, each with its numerical error.

    It is used like a number or an array: ``float``, formats such as ``.3f``, comparisons and ``np.asarray`` take the
    values. Arithmetic and elementwise functions of NumPy, such as ``np.sqrt``, return a `Measured` whose error is the
    largest change that the errors of the operands cause, to first order. The changes by different operands are added,
    because their errors may have the same cause. Sums and other reductions by NumPy return the values alone.
    ``str`` shows each value to the digits that its error supports.

    Attributes
    ----------
    value, error
        Values and their errors, arrays of the same shape [unit of the quantity]; shape () for a single number.

    Raises
    ------
    OutOfRangeError
        `value` and `error` have different shapes.

    Examples
    --------
    >>> import numpy as np
    >>> from tradestudy.optics import Measured
    >>> width = Measured(value=np.array(4.709640e-6), error=np.array(3e-11))
    >>> print(width)
    4.70964e-06 ± 3e-11
    >>> print(f"{1e6 * width} µm; half of it is {1e6 * width / 2:.3f} µm; below 5 µm: {width < 5e-6}")
    4.70964 ± 3e-05 µm; half of it is 2.355 µm; below 5 µm: True
    """

    value: FloatArray
    error: FloatArray

    def __post_init__(self) -> None:
        if self.value.shape != self.error.shape:
            raise OutOfRangeError(
                "error of a value",
                value=f"shape {self.error.shape} for values of shape {self.value.shape}",
                limit="one shape",
                remedy="give an error for each value",
            )

    def __repr__(self) -> str:
        if self.value.size <= _FEW_VALUES:
            return f"Measured({self})"
        if np.isnan(self.value).all():
            return f"Measured({self.value.shape}, not numbers)"
        low, high = np.nanmin(self.value), np.nanmax(self.value)
        return f"Measured({self.value.shape}, {low:.6g} to {high:.6g}, errors up to {np.nanmax(self.error):.1g})"

    def __array__(self, dtype: npt.DTypeLike | None = None, copy: bool | None = None) -> npt.NDArray[Any]:
        return np.array(self.value, dtype=dtype, copy=copy)

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **kwargs: Any) -> Any:
        values = [operand.value if isinstance(operand, Measured) else operand for operand in inputs]
        result = getattr(ufunc, method)(*values, **kwargs)
        comparison = getattr(result, "dtype", None) != np.float64
        if comparison or method != "__call__" or "out" in kwargs:
            return result
        error = np.zeros_like(result)
        with np.errstate(all="ignore"):  # a function may end within the error, as √ does at 0
            for place, operand in enumerate(inputs):
                if isinstance(operand, Measured):
                    moved = [[*values[:place], end, *values[place + 1 :]] for end in operand._ends]
                    error = error + np.fmax(*(np.abs(ufunc(*arguments, **kwargs) - result) for arguments in moved))
        return Measured(value=np.asarray(result), error=np.asarray(error))

    @property
    def _ends(self) -> tuple[FloatArray, FloatArray]:
        return np.asarray(self.value - self.error), np.asarray(self.value + self.error)

    def __float__(self) -> float:
        return float(self.value)

    def __round__(self, digits: int | None = None) -> float:
        return round(float(self), digits)

    def __bool__(self) -> bool:
        return bool(self.value)

    def __len__(self) -> int:
        return len(self.value)

    def __getitem__(self, index: Any) -> Measured:
        return Measured(value=np.asarray(self.value[index]), error=np.asarray(self.error[index]))

    def __iter__(self) -> Iterator[Measured]:
        return (self[place] for place in range(len(self)))

    def __format__(self, spec: str) -> str:
        return format(self.value[()], spec) if spec else str(self)

    def __str__(self) -> str:
        return ", ".join(_with_error(v, e) for v, e in zip(np.ravel(self.value), np.ravel(self.error), strict=True))


def _with_error(value: float, error: float) -> str:
    """Value, printed to the digit at which its error starts, and error."""
    digits = 6
    if error > 0 and value != 0 and np.isfinite(error) and np.isfinite(value):
        digits = int(np.clip(np.floor(np.log10(abs(value))) - np.floor(np.log10(error)) + 1, 1, 15))
    return f"{value:.{digits}g} ± {error:.1g}"


@checked
@dataclass(frozen=True, kw_only=True)
class PointSpread:
    """Intensity of the image of a point, sampled on a uniform grid.

    The rectangle that the samples cover is called the window.

    Attributes
    ----------
    x, y
        Positions of the samples [m], increasing and equally spaced. Their number along each axis is 4 n + 1 for a whole
        number n, and at least 33.
    intensity
        Intensity I of the samples [W/m²], ≥ 0, shape (len(y), len(x)).
    pupil_power
        Power through the pupil [W], > 0. Metrics such as the encircled energy are fractions of this power.
    relative_error
        Stated relative L2 error of the intensity over the samples [1]. The errors of all metrics take it into account.
        Default: 0, for exact samples.

    Raises
    ------
    OutOfRangeError
        If an array or a number does not meet the conditions above.

    Examples
    --------
    A Gaussian spot with a standard deviation of 2 µm: its width along x, its intensity 2 µm from the centre, and the
    power within 2 µm and on a square of 4 µm:

    >>> import numpy as np
    >>> from tradestudy import optics
    >>> x = np.linspace(-10e-6, 10e-6, 129)
    >>> spot = np.exp(-(x**2 + x[:, None] ** 2) / (2 * (2e-6) ** 2))
    >>> psf = optics.PointSpread(x=x, y=x, intensity=spot, pupil_power=2 * np.pi * (2e-6) ** 2)
    >>> width = optics.full_width_at_half_maximum(psf, angle=0.0)
    >>> print(f"{width.value:.4e} m, numerical error below 1e-12 m: {width.error < 1e-12}")
    4.7096e-06 m, numerical error below 1e-12 m: True
    >>> moment = psf.moments((0.0, 0.0), 5e-6)
    >>> print(f"{psf.at(2e-6, 0.0):.5f} W/m²; {moment(2e-6, 0):.3e} W")
    0.60653 W/m²; 9.889e-12 W
    >>> print(f"{psf.power_in(x=(-2e-6, 2e-6), y=(-2e-6, 2e-6)):.3e} W")
    1.171e-11 W
    """

    x: FloatArray
    y: FloatArray
    intensity: FloatArray
    pupil_power: float
    relative_error: float = 0.0

    def __post_init__(self) -> None:
        if self.intensity.shape != self.y.shape + self.x.shape or self.intensity.ndim != 2:
            raise OutOfRangeError(
                "shape of the intensity",
                value=f"{self.intensity.shape} for y of shape {self.y.shape} and x of shape {self.x.shape}",
                limit=f"(len(y), len(x)) = ({self.y.size}, {self.x.size})",
                remedy="give a row for each y and a column for each x",
            )
        for name, axis in (("x", self.x), ("y", self.y)):
            if axis.size < _LEAST_SAMPLES or axis.size % 4 != 1:
                raise OutOfRangeError(
                    f"number of samples along {name}",
                    value=str(axis.size),
                    limit=f"4 n + 1, at least {_LEAST_SAMPLES}",
                    remedy="choose a number that the error estimate can halve twice within the same window",
                )
            step = (axis[-1] - axis[0]) / (axis.size - 1)
            if not step > 0 or not np.allclose(np.diff(axis), step, rtol=1e-6, atol=0):
                raise OutOfRangeError(
                    f"sample positions along {name}",
                    value=f"{axis[0]:g} to {axis[-1]:g} m",
                    limit="increasing, equally spaced",
                    remedy="sample on a regular grid",
                )
        if not np.all(np.isfinite(self.intensity)) or np.any(self.intensity < 0):
            raise OutOfRangeError(
                "intensity",
                value=f"from {self.intensity.min():g} to {self.intensity.max():g} W/m²",
                limit="≥ 0 and finite",
                remedy="rays give infinite intensity in focus: use wave optics, or a plane out of focus",
            )
        if not (self.pupil_power > 0 and np.isfinite(self.pupil_power)):
            raise OutOfRangeError(
                "pupil power",
                value=f"{self.pupil_power:g} W",
                limit="positive and finite",
                remedy="check that the pupil passes light",
            )
        if not 0 <= self.relative_error < np.inf:
            raise OutOfRangeError(
                "relative error of the samples",
                value=f"{self.relative_error:g}",
                limit="≥ 0, finite",
                remedy="state the relative L2 error of the samples",
            )

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self._summary()})"

    def _summary(self) -> str:
        """Shape, spacing and stated error of the samples."""
        rows, columns = self.intensity.shape
        x, y = (f"{spacing:.3g}" for spacing in self.spacings)
        return (
            f"{rows} × {columns} samples, spacing {x if x == y else f'{x}, {y}'} m, "
            f"relative error {self.relative_error:.1g}"
        )

    @property
    def spacings(self) -> tuple[float, float]:
        """Distances between neighbouring samples along x and along y [m]."""
        x, y = (float((axis[-1] - axis[0]) / (axis.size - 1)) for axis in (self.x, self.y))
        return x, y

    @property
    def spacing(self) -> float:
        """The smaller of the two `spacings` [m]."""
        return min(self.spacings)

    @property
    def intensity_error(self) -> float:
        """Stated L2 error of the intensity over the window [W/m], which is `relative_error` times √(∫∫ I² dA)."""
        dx, dy = self.spacings
        return self.relative_error * float(np.linalg.norm(self.intensity)) * float(np.sqrt(dx * dy))

    @property
    def sample_error(self) -> float:
        """Largest possible error of a single sample [W/m²], reached if the whole stated error falls on it."""
        return self.relative_error * float(np.linalg.norm(self.intensity))

    @cached_property
    def _spline(self) -> RectBivariateSpline:
        """Quintic spline through the samples [W/m²], called as ``spline(y, x)``."""
        from scipy.interpolate import RectBivariateSpline  # loads more slowly than most fields are computed

        return RectBivariateSpline(self.y, self.x, self.intensity, kx=5, ky=5)

    @checked
    def at(self, x: FloatArray | float, y: FloatArray | float, *, order: tuple[int, int] = (0, 0)) -> FloatArray:
        """Intensity or one of its derivatives, interpolated by a quintic spline.

        Parameters
        ----------
        x, y
            Positions within the window [m], broadcast together.
        order
            Orders of the derivative along (x, y), each from 0 to 4.

        Returns
        -------
        ndarray
            Intensity [W/m²], or its derivative of total order n [W/m² per mⁿ], in the shape of the positions. Each
            sample errs by at most `sample_error`; interpolation adds an error that this method does not state.

        Raises
        ------
        OutOfRangeError
            A position is outside the window.
        """
        for name, places, axis in (("x", np.asarray(x), self.x), ("y", np.asarray(y), self.y)):
            slack = 1e-9 * (axis[-1] - axis[0])
            require(
                (places >= axis[0] - slack) & (places <= axis[-1] + slack),
                f"{name} of a position",
                places,
                limit=f"{axis[0]:g} to {axis[-1]:g} m",
                remedy="widen the window or keep within it",
            )
        return np.asarray(self._spline(np.asarray(y), np.asarray(x), dx=order[1], dy=order[0], grid=False))

    @checked
    def power_in(self, x: tuple[float, float], y: tuple[float, float]) -> float:
        """Power on a rectangle, by integrating the interpolated intensity.

        Parameters
        ----------
        x, y
            First and last position of the rectangle along each axis, within the window [m].

        Returns
        -------
        float
            Power [W], without an error. To estimate the error, compare the result with those of `coarser`.

        Raises
        ------
        OutOfRangeError
            The rectangle leaves the window, or ends before it begins.
        """
        for name, (first, last), axis in (("x", x, self.x), ("y", y, self.y)):
            slack = 1e-9 * (axis[-1] - axis[0])
            if not axis[0] - slack <= first <= last <= axis[-1] + slack:
                raise OutOfRangeError(
                    f"{name} of the rectangle",
                    value=f"{first:g} to {last:g} m",
                    limit=f"increasing, within {axis[0]:g} to {axis[-1]:g} m",
                    remedy="widen the window or choose a smaller rectangle",
                )
        return float(self._spline.integral(*y, *x))

    @cached_property
    def coarser(self) -> tuple[PointSpread, PointSpread]:
        """The same window with every second sample, and with every fourth, for estimates of the error."""
        grids = []
        for step in (2, 4):
            grid = object.__new__(PointSpread)  # coarser grids may fall below the least number of samples
            for name, value in (
                ("x", self.x[::step]),
                ("y", self.y[::step]),
                ("intensity", self.intensity[::step, ::step]),
                ("pupil_power", self.pupil_power),
                ("relative_error", self.relative_error),
            ):
                object.__setattr__(grid, name, value)
            grids.append(grid)
        return grids[0], grids[1]

    @checked
    def moments(self, centre: tuple[float, float], reach: float) -> DiscMoments:
        """Moments ∫ rⁿ I dA of the intensity over discs about one centre, where r is the distance from the centre.

        Parameters
        ----------
        centre
            Centre (x, y) of the discs [m].
        reach
            Radius of the largest disc [m].

        Returns
        -------
        DiscMoments
            Function that returns the moment [W mⁿ], given the radius of the disc [m] and n ≥ 0.
        """
        known = self._known_moments
        if (centre, reach) not in known:
            known[centre, reach] = DiscMoments(self, centre, reach)
        return known[centre, reach]

    @cached_property
    def _known_moments(self) -> dict[tuple[tuple[float, float], float], DiscMoments]:
        """Moments that were computed before, by centre and reach."""
        return {}


def measured(
    psf: PointSpread, metric: Callable[[PointSpread], FloatArray | float], *, carried: FloatArray | float
) -> Measured:
    """Evaluate a metric on the three grids and estimate its error from the changes.

    The error is the last change times the reduction that the last halving showed, which is trusted down to
    `_BEST_REDUCTION`. `carried` is added: the largest change of the metric that the stated error of the intensity
    allows.
    """
    fine, middle, coarse = (np.asarray(metric(grid), dtype=np.float64) for grid in (psf, *psf.coarser))
    last, before = np.abs(fine - middle), np.abs(middle - coarse)
    with np.errstate(divide="ignore", invalid="ignore"):  # without an earlier change, the ratio is not needed
        reduction = np.where(before > 0, last / before, 1.0)
    error = last * np.clip(reduction, _BEST_REDUCTION, 1.0) + 8 * np.finfo(float).eps * np.abs(fine) + carried
    return Measured(value=fine, error=error)


def peak_position(psf: PointSpread) -> tuple[float, float]:
    """Position (x, y) of the largest intensity [m], between samples.

    Newton's iteration on the spline from the brightest sample, within one spacing of it.

    Raises
    ------
    OutOfRangeError
        If the brightest sample lies on the edge of the window: the peak may be outside.
    """
    row, column = np.unravel_index(int(np.argmax(psf.intensity)), psf.intensity.shape)
    if row in (0, psf.y.size - 1) or column in (0, psf.x.size - 1):
        raise OutOfRangeError(
            "brightest sample on the rim of the window",
            value=f"({psf.x[column]:g}, {psf.y[row]:g}) m",
            limit="inside",
            remedy="move or widen the window",
        )
    start = np.array([psf.x[column], psf.y[row]])
    position = start.copy()
    for _ in range(30):
        gradient = np.array([psf.at(*position, order=(1, 0)), psf.at(*position, order=(0, 1))])
        cross = psf.at(*position, order=(1, 1))
        hessian = np.array([[psf.at(*position, order=(2, 0)), cross], [cross, psf.at(*position, order=(0, 2))]])
        if np.linalg.det(hessian) <= 0:  # a ridge or a plateau: the brightest sample is as good as any point
            return float(start[0]), float(start[1])
        moved = np.clip(position - np.linalg.solve(hessian, gradient), start - psf.spacing, start + psf.spacing)
        if np.max(np.abs(moved - position)) < 1e-12 * psf.spacing:
            break
        position = moved
    return float(position[0]), float(position[1])


class DiscMoments:
    """∫ rⁿ I dA over discs about one centre: Gauss–Legendre panels in radius, trapezoid in angle.

    The azimuthal means are computed once. Where a disc ends inside a panel, the polynomial through the panel's nodes is
    integrated.

    Parameters
    ----------
    psf
        Samples to integrate.
    centre
        Centre of the discs (x, y) [m].
    reach
        Radius of the largest disc [m].

    Examples
    --------
    The power of a uniform intensity of 1 W/m² on a disc of a metre:

    >>> import numpy as np
    >>> from tradestudy import optics
    >>> axis = np.linspace(-2.0, 2.0, 33)
    >>> psf = optics.PointSpread(x=axis, y=axis, intensity=np.ones((33, 33)), pupil_power=16.0)
    >>> print(f"{psf.moments((0.0, 0.0), 1.0)(1.0):.6f} W")
    3.141593 W
    """

    _ORDER = 6

    def __init__(self, psf: PointSpread, centre: tuple[float, float], reach: float) -> None:
        self._edges = np.linspace(0, reach, 1 + max(1, int(np.ceil(reach / (2 * psf.spacing)))))
        nodes, _ = np.polynomial.legendre.leggauss(self._ORDER)
        half = self._edges[1] / 2
        self._radii = self._edges[:-1, None] + half * (1 + nodes)
        self._means = _azimuthal_means(psf, centre, self._radii.ravel()).reshape(self._radii.shape)
        self._to_legendre = np.linalg.inv(np.polynomial.legendre.legvander(nodes, self._ORDER - 1))

    def __repr__(self) -> str:
        return f"DiscMoments(radii up to {self._edges[-1]:.3g} m)"

    def __call__(self, radius: float, power: int = 0) -> float:
        """∫ rⁿ I dA over a disc.

        Parameters
        ----------
        radius
            Radius of the disc [m], at most the reach given.
        power
            n ≥ 0; 0 gives the power in the disc.

        Returns
        -------
        float
            Moment [W mⁿ]; its error is found by comparison with coarser samples.
        """
        half = self._edges[1] / 2
        coefficients = (2 * np.pi * self._means * self._radii ** (power + 1)) @ self._to_legendre.T
        panel = min(int(np.searchsorted(self._edges, radius, side="right")) - 1, self._radii.shape[0] - 1)
        full = 2 * half * coefficients[:panel, 0].sum()
        primitive = np.polynomial.legendre.legint(coefficients[panel], lbnd=-1)
        rest = np.polynomial.legendre.legval((radius - self._edges[panel]) / half - 1, primitive)
        return float(full + half * rest)


def _azimuthal_means(psf: PointSpread, centre: tuple[float, float], radii: FloatArray) -> FloatArray:
    """Mean intensity on circles; the trapezoid rule resolves everything that the samples resolve."""
    counts = 16 + np.ceil(2 * np.pi * radii / psf.spacing).astype(int)
    starts = np.cumsum(counts) - counts
    angles = 2 * np.pi * (np.arange(counts.sum()) - np.repeat(starts, counts)) / np.repeat(counts, counts)
    around = np.repeat(radii, counts)
    values = psf.at(centre[0] + around * np.cos(angles), centre[1] + around * np.sin(angles))
    return np.asarray(np.add.reduceat(values, starts) / counts)


SpreadField = PointSpread | ApertureField


@checked
def as_point_spread(field: SpreadField) -> PointSpread:
    """Convert a field on a regular grid to the `PointSpread` from which metrics are computed.

    The error estimates of the metrics need 4 n + 1 rows and 4 m + 1 columns, where n and m are whole numbers. From
    other grids, up to three of the last rows and of the last columns are dropped.

    Parameters
    ----------
    field
        `ApertureField` on a `TargetGrid`, or on `TargetPoints` that form a regular grid at one distance; or a
        `PointSpread`.

    Returns
    -------
    PointSpread
        The intensity of the field at the points of the grid, the pupil power, and the relative error of the intensity.
        A `PointSpread` is returned unchanged.

    Raises
    ------
    OutOfRangeError
        The targets do not form a regular grid at one distance, they have fewer than 33 rows or columns, an intensity is
        infinite, as with rays at a focus, or the error of the intensity is NaN, as in a result of `propagate_samples`.

    References
    ----------
    No formula: the intensity is copied, not interpolated.

    Examples
    --------
    >>> from tradestudy import optics
    >>> field = optics.aperture_field(
    ...     source=optics.PointSource(distance=0.5),
    ...     lens=optics.CircularLens(radius=2e-3, focal_length=25e-3, lens_phase="perfect"),
    ...     targets=optics.TargetGrid.centred(centre=(0.0, 0.0), pitch=0.5e-6, count=64, distance=0.5 * 25e-3 / 0.475),
    ...     wavelength=550e-9,
    ...     method="kirchhoff",
    ...     accuracy=optics.FieldAccuracy(tolerance=1e-6),
    ... )
    >>> optics.as_point_spread(field).intensity.shape
    (61, 61)
    """
    if isinstance(field, PointSpread):
        return field
    x, y = _axes(field.targets)
    rows, columns = (4 * ((axis.size - 1) // 4) + 1 for axis in (y, x))
    return PointSpread(
        x=x[:columns],
        y=y[:rows],
        intensity=field.intensity.reshape(y.size, x.size)[:rows, :columns],
        pupil_power=field.pupil_power,
        relative_error=field.error.intensity,
    )


def _axes(targets: Targets) -> tuple[FloatArray, FloatArray]:
    """Positions of columns and rows [m]."""
    if isinstance(targets, TargetGrid):
        return targets.x_axis, targets.y_axis
    if len(targets.shape) == 2:
        x, y, z = (c.reshape(targets.shape) for c in targets.coordinates())
        if not (np.ptp(x, axis=0).any() or np.ptp(y, axis=1).any() or np.ptp(z)):
            return x[0], y[:, 0]
    raise OutOfRangeError(
        "field on scattered points",
        value=f"targets of shape {targets.shape}",
        limit="a regular grid in one plane",
        remedy="compute the field on a TargetGrid",
    )

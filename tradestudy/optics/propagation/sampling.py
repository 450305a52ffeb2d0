"""Targets of a propagation, and the number of nodes that an aperture needs for them, from the net path's slope."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from tradestudy.errors import OutOfRangeError, UnaffordableError
from tradestudy.optics.argument_types import checked, checked_fields
from tradestudy.optics.arrays import FloatArray, IndexArray
from tradestudy.optics.propagation.kernels import Kernel
from tradestudy.optics.propagation.paths import PathSum
from tradestudy.optics.quadrature import gauss_legendre

_BYTES_PER_NODE = 16 * 40  # complex terms of the largest low-rank factor, and the nodes themselves
_BYTES_PER_TARGET = 16 * 40
_MOST_ON_AXIS = 10**7
_WIDEST_MARGIN, _LEAST_MARGIN = 10.0, 3.0  # of `bessel_margin` at rounding errors, over the cube root, and apart
_NEWTON_STEPS = 12  # from the cube root that leaves out the linear term, to rounding at any number of nodes
_PAIRS_PER_SECOND = 2.0e7  # node–target pairs of the direct check on a slow core
_TERMS_PER_SECOND = 4.0e5  # (nodes + targets) × 10 terms of the fast path on a slow core


@checked_fields
@dataclass(frozen=True, kw_only=True)
class TargetPoints:
    """Any set of points behind the lens plane.

    Parameters
    ----------
    x, y
        Positions [m], any shapes that broadcast.
    distance
        Distance behind the lens plane [m], > 0; a number or an array that broadcasts with x and y, so the points may
        lie on tilted or curved surfaces.

    Raises
    ------
    OutOfRangeError
        Shapes do not broadcast, a coordinate is not finite, a distance is not positive, or there are no points.

    Examples
    --------
    Points on the axis, before and behind a focus:

    >>> import numpy as np
    >>> from tradestudy import optics
    >>> optics.TargetPoints(x=0.0, y=0.0, distance=50e-3 + np.linspace(-50e-6, 50e-6, 11)).shape
    (11,)
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
        """Shape of the results."""
        return np.broadcast_shapes(np.shape(self.x), np.shape(self.y), np.shape(self.distance))

    def coordinates(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Flat x, y, distance of every point."""
        arrays = np.broadcast_arrays(*(np.asarray(v, dtype=float) for v in (self.x, self.y, self.distance)))
        x, y, z = (np.ascontiguousarray(v).ravel() for v in arrays)
        return x, y, z

    def at(self, index: IndexArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """x, y, distance of some points, by their flat indices."""
        x, y, z = self.coordinates()
        return x[index], y[index], z[index]

    def box(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Least and largest x, y and distance."""
        x, y, z = (np.array([np.min(c), np.max(c)], dtype=float) for c in (self.x, self.y, self.distance))
        return x, y, z

    def corners(self) -> IndexArray:
        """Flat indices of the points farthest along the four diagonals."""
        x, y, _ = self.coordinates()
        rising, falling = x + y, x - y
        return np.array([np.argmin(rising), np.argmin(falling), np.argmax(falling), np.argmax(rising)])


@checked_fields
@dataclass(frozen=True, kw_only=True)
class TargetGrid:
    """A regular grid of targets in one plane, for which propagation is fast.

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

    Examples
    --------
    >>> from tradestudy import optics
    >>> grid = optics.TargetGrid.centred(centre=(0.0, 0.0), pitch=0.5e-6, count=65, distance=50e-3)
    >>> grid.shape, f"{grid.x_axis[0]:.3g}"
    ((65, 65), '-1.6e-05')
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
        """Square grid of `count` × `count` points centred on `centre`, as pixel centres lie on a sensor."""
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
        """Shape of the results, rows (y) by columns (x)."""
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

    def at(self, index: IndexArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """x, y, distance of some points, by their flat indices."""
        row, column = np.divmod(index, self.x_count)
        return self.x_axis[column], self.y_axis[row], np.full(index.size, self.distance)

    def box(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Least and largest x, y and distance."""
        return (
            self.x_start + self.x_pitch * np.array([0.0, self.x_count - 1.0]),
            self.y_start + self.y_pitch * np.array([0.0, self.y_count - 1.0]),
            np.array([self.distance, self.distance]),
        )

    def corners(self) -> IndexArray:
        """Flat indices of the four corners."""
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


@checked_fields
@dataclass(frozen=True, kw_only=True)
class Limits:
    """Resources that a computation may use; it is refused in advance if it needs more.

    Parameters
    ----------
    nodes
        Quadrature nodes on one aperture.
    memory_bytes
        Peak memory.
    seconds
        Wall time in total: set-up, computation, check and every refinement.

    Raises
    ------
    OutOfRangeError
        A limit is not positive.

    Examples
    --------
    >>> from tradestudy import optics
    >>> optics.Limits(seconds=60.0).memory_bytes
    2000000000.0
    """

    nodes: int = 20_000_000
    memory_bytes: float = 2.0e9
    seconds: float = 600.0

    def __post_init__(self) -> None:
        for name, value in (("nodes", self.nodes), ("memory_bytes", self.memory_bytes), ("seconds", self.seconds)):
            if not value > 0:
                raise OutOfRangeError(f"limit of {name}", value=f"{value:g}", limit="> 0", remedy="raise the limit")


@checked_fields
@dataclass(frozen=True, kw_only=True)
class NodeCounts:
    """Rings of quadrature nodes on a disc, and nodes on its rim; at least one of each.

    Inner rings have fewer nodes, because the phase completes fewer turns on them.

    Examples
    --------
    >>> from tradestudy import optics
    >>> optics.NodeCounts(radial=20, angular=40).total
    800
    """

    radial: int
    angular: int

    def __post_init__(self) -> None:
        if self.radial < 1 or self.angular < 1:
            raise OutOfRangeError(
                "node counts", value=f"{self.radial} × {self.angular}", limit="≥ 1 × 1", remedy="raise the counts"
            )

    @property
    def total(self) -> int:
        """Number of nodes at most."""
        return self.radial * self.angular

    @property
    def on_rings(self) -> IndexArray:
        """Nodes of every ring, from the innermost, shape (radial,).

        Of those on the rim, `bessel_margin` is taken to be as much as the tightest tolerance makes it: the rest, which
        is the phase that turns, shrinks faster with the radius.
        """
        relative = np.sqrt(gauss_legendre(self.radial)[0])
        turns = _turns(self.angular)
        needed = turns * relative + _WIDEST_MARGIN * np.cbrt(turns * relative) + _LEAST_MARGIN
        return np.asarray(np.minimum(np.ceil(needed).astype(int), self.angular))

    def scaled(self, factor: float) -> NodeCounts:
        """Both counts times a factor, rounded up."""
        return NodeCounts(radial=math.ceil(self.radial * factor), angular=math.ceil(self.angular * factor))


def _turns(angular: int) -> float:
    """Highest angular frequency t that so many nodes resolve: t + margin · t^⅓ and the least margin."""
    # The cubic in t^⅓ rises from below zero at 0 and is convex there: Newton's steps come down from above.
    spare = max(angular - _LEAST_MARGIN, 0.0)
    root = spare ** (1 / 3)
    for _ in range(_NEWTON_STEPS):
        root -= (root**3 + _WIDEST_MARGIN * root - spare) / (3 * root**2 + _WIDEST_MARGIN)
    return float(root**3)


def needed_nodes(
    paths: PathSum,
    kernel: Kernel,
    *,
    radius: float,
    x: FloatArray,
    y: FloatArray,
    z: FloatArray,
    tolerance: float,
) -> NodeCounts:
    """Node counts that resolve the wave times the kernel on a disc for every given target.

    A ring needs more nodes than the highest angular frequency on it; the rings need half as many nodes as the phase
    turns along the squared radius. Both get the margin m^⅓ (3/2 ln 1/tolerance)^⅔/2^⅓ over which a Bessel function
    of argument m falls to the tolerance.

    Parameters
    ----------
    paths
        Path of the wave behind the aperture, in coordinates relative to its centre.
    kernel
        Gives the path on to the targets, to second order or exactly.
    radius
        Radius of the aperture [m].
    x, y, z
        Targets relative to the centre of the aperture [m]; the outline of the set is enough.
    tolerance
        Error allowed, relative to the largest field that the aperture could produce.

    Returns
    -------
    NodeCounts
        Counts for `tradestudy.optics.quadrature.disc_nodes`.
    """
    half_range, turns = net_phase(paths, kernel, radius=radius, x=x, y=y, z=z)
    return NodeCounts(
        radial=math.ceil((half_range + bessel_margin(half_range, tolerance)) / 2) + 1,
        angular=math.ceil(turns + bessel_margin(turns, tolerance)) + 1,
    )


def net_phase(
    paths: PathSum, kernel: Kernel, *, radius: float, x: FloatArray, y: FloatArray, z: FloatArray
) -> tuple[float, float]:
    """Half the range of the net phase over the squared radius, and its largest angular frequency on the rim [rad].

    Parameters as for `needed_nodes`.
    """
    ring = radius * (np.arange(24) + 1.0) / 24.0
    angle = 2 * np.pi * np.arange(48) / 48.0
    u = np.multiply.outer(ring, np.cos(angle))
    v = np.multiply.outer(ring, np.sin(angle))
    p_x, p_y = paths.slope(u, v)
    onward = kernel.slope_at_target(u, v, *(c[:, None, None] for c in (x, y, z)))
    slope_x, slope_y = p_x - onward[0], p_y - onward[1]
    wavenumber = kernel.wavenumber
    radial = slope_x * np.cos(angle) + slope_y * np.sin(angle)
    tangential = slope_y * np.cos(angle) - slope_x * np.sin(angle)
    turns = wavenumber * radius * float(np.max(np.abs(tangential) * (ring / radius)[:, None]))
    relative = np.maximum(ring / radius, 0.5)[:, None]
    return wavenumber * radius * float(np.max(np.abs(radial) / (4 * relative))), turns


def edge_node_count(
    paths: PathSum,
    kernel: Kernel,
    *,
    radius: float,
    x: FloatArray,
    y: FloatArray,
    z: FloatArray,
    tolerance: float,
) -> int:
    """Nodes that resolve the wave times the kernel on the edge of a disc; parameters as for `needed_nodes`."""
    angle = 2 * np.pi * np.arange(64) / 64.0
    u, v = radius * np.cos(angle), radius * np.sin(angle)
    p_x, p_y = paths.slope(u, v)
    onward = kernel.slope_at_target(u, v, *(c[:, None] for c in (x, y, z)))
    slope_x, slope_y = p_x - onward[0], p_y - onward[1]
    along = slope_y * np.cos(angle) - slope_x * np.sin(angle)
    turns = kernel.wavenumber * radius * float(np.max(np.abs(along)))
    return math.ceil(turns + bessel_margin(turns, tolerance)) + 1


def outline(x: FloatArray, y: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Corners, edge middles and centre of the box around targets, where path slopes are extreme."""
    mesh = np.meshgrid(*(_three(c) for c in (x, y, z)), indexing="ij")
    return mesh[0].ravel(), mesh[1].ravel(), mesh[2].ravel()


def check_affordable(counts: NodeCounts, *, targets: int, check_targets: int, limits: Limits) -> None:
    """Refuse a computation that exceeds the limits of nodes, memory or time.

    Raises
    ------
    UnaffordableError
        With the node count, the bytes, the seconds and the setting to change.
    """
    memory = _BYTES_PER_NODE * counts.total + _BYTES_PER_TARGET * targets
    seconds = (counts.total + targets) / _TERMS_PER_SECOND + 5.0 * counts.total * check_targets / _PAIRS_PER_SECOND
    if counts.total > limits.nodes or memory > limits.memory_bytes or seconds > limits.seconds:
        raise UnaffordableError(
            "the computation needs more nodes, memory or time than the limits allow",
            value=f"{counts.radial} × {counts.angular} = {counts.total} nodes for {targets} targets, "
            f"{memory:.3g} bytes, {seconds:.3g} s",
            limit=f"{limits.nodes} nodes, {limits.memory_bytes:.3g} bytes, {limits.seconds:.3g} s",
            remedy="raise limits=Limits(nodes, memory_bytes, seconds), or use fewer or less distant targets; "
            "method='boundary_wave' has nodes on the edge only",
        )


def check_time(
    *, spent: float, needed: float, limits: Limits, what: str = "the refinement that the tolerance needs"
) -> None:
    """Refuse a step that would end beyond the time allowed.

    Raises
    ------
    UnaffordableError
        With the seconds spent and the seconds predicted for the next round from the last one.
    """
    if spent + needed >= limits.seconds:
        raise UnaffordableError(
            f"{what} takes longer than the limits allow",
            value=f"{spent:.3g} s spent, {needed:.3g} s more",
            limit=f"{limits.seconds:.3g} s",
            remedy="raise limits=Limits(seconds) or the tolerance, or use fewer targets",
        )


def time_left(limits: Limits, spent: float) -> Limits:
    """Limits of what remains after the seconds spent.

    Raises
    ------
    UnaffordableError
        No time is left.
    """
    check_time(spent=spent, needed=0.0, limits=limits, what="the computation")
    return replace(limits, seconds=limits.seconds - spent)


def refuse_near_zone(*, width: float, nearest: float, wavelength: float) -> None:
    """Refuse apertures and targets that scalar diffraction does not describe.

    Parameters
    ----------
    width
        Width of the aperture [m].
    nearest
        Distance of the nearest target [m].
    wavelength
        Wavelength [m].

    Raises
    ------
    OutOfRangeError
        The wavelength exceeds the width of the aperture, or a target lies within one wavelength of its plane, where the
        field depends on polarisation and on the screen.
    """
    if wavelength > width:
        raise OutOfRangeError(
            "wavelength",
            value=f"{wavelength:g} m",
            limit=f"at most the width of the aperture, {width:g} m",
            remedy="check the units; smaller apertures need vector diffraction",
        )
    if nearest < wavelength:
        raise OutOfRangeError(
            "distance of the nearest target from the aperture",
            value=f"{nearest:g} m",
            limit=f"at least one wavelength, {wavelength:g} m",
            remedy="check the units; nearer targets need vector diffraction",
        )


def bessel_margin(turns: float, tolerance: float) -> float:
    """Orders beyond the argument until a Bessel function has fallen to the tolerance."""
    decay = math.log(1.0 / tolerance)
    airy = (1.5 * decay) ** (2.0 / 3.0) / 2.0 ** (1.0 / 3.0) * max(turns, 1.0) ** (1.0 / 3.0)
    return float(airy + 2.0)


def _three(values: FloatArray) -> FloatArray:
    low, high = float(values.min()), float(values.max())
    return np.asarray([low]) if low == high else np.asarray([low, 0.5 * (low + high), high])

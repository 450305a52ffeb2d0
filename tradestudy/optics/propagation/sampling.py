"""The number of nodes that an aperture needs for its targets, from the slope of the net path, and its limits."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tradestudy.errors import OutOfRangeError, UnaffordableError
from tradestudy.optics.arguments import checked
from tradestudy.optics.arrays import FloatArray, IndexArray
from tradestudy.optics.propagation.kernels import Kernel
from tradestudy.optics.propagation.paths import PathSum
from tradestudy.optics.quadrature import gauss_legendre

_BYTES_PER_NODE = 16 * 40  # complex terms of the largest low-rank factor, and the nodes themselves
_BYTES_PER_TARGET = 16 * 40
_WIDEST_MARGIN, _LEAST_MARGIN = 10.0, 3.0  # of `bessel_margin` at rounding errors: per cube root, and constant
_NEWTON_STEPS = 12  # from the cube root without the linear term down to rounding, for any number of nodes
_PAIRS_PER_SECOND = 2.0e7  # node–target pairs of the direct check on a slow core
_TERMS_PER_SECOND = 4.0e5  # (nodes + targets) × 10 terms of the fast path on a slow core


@checked
@dataclass(frozen=True, kw_only=True)
class Limits:
    """Limits on the resources that a computation may use.

    A computation that needs more raises ``UnaffordableError`` before it starts, or before the refinement that would
    exceed them.

    Parameters
    ----------
    nodes
        Largest number of quadrature nodes on one aperture.
    memory_bytes
        Largest peak memory [bytes].
    seconds
        Largest wall time [s] for set-up, computation, check and all refinements together.

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


@checked
@dataclass(frozen=True, kw_only=True)
class NodeCounts:
    """Numbers of quadrature nodes on a disc: how many rings, and how many nodes on a ring at the edge.

    Rings nearer to the centre have fewer nodes, because the phase varies less along them.

    Parameters
    ----------
    radial
        Number of rings, ≥ 1.
    angular
        Number of nodes that a ring at the edge of the disc would have, ≥ 1.

    Raises
    ------
    OutOfRangeError
        If a count is below 1.

    Examples
    --------
    >>> from tradestudy import optics
    >>> counts = optics.NodeCounts(radial=20, angular=40)
    >>> counts.total, counts.scaled(1.5)
    (800, NodeCounts(radial=30, angular=60))
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
        """Upper bound on the total number of nodes, `radial` times `angular`."""
        return self.radial * self.angular

    @property
    def on_rings(self) -> IndexArray:
        """Number of nodes on each ring, from the innermost, shape (radial,).

        A ring along which the phase completes t turns gets t + 10 t^⅓ + 3 nodes, rounded up. The number t is
        proportional to the radius of the ring; its value at the edge of the disc is the one for which the formula gives
        `angular`.
        """
        relative = np.sqrt(gauss_legendre(self.radial)[0])
        turns = _turns(self.angular)
        needed = turns * relative + _WIDEST_MARGIN * np.cbrt(turns * relative) + _LEAST_MARGIN
        return np.asarray(np.minimum(np.ceil(needed).astype(int), self.angular))

    def scaled(self, factor: float) -> NodeCounts:
        """Both counts times a factor, rounded up.

        Parameters
        ----------
        factor
            Factor [1], > 0.

        Returns
        -------
        NodeCounts
            The counts, each at least 1.
        """
        return NodeCounts(radial=math.ceil(self.radial * factor), angular=math.ceil(self.angular * factor))


def _turns(angular: int) -> float:
    """Highest angular frequency t that this many nodes resolve: t + margin · t^⅓ + least margin of them."""
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
        Propagation law, which gives the path on to the targets, to second order or exactly.
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
    # Towards the centre, the derivative of a tilt with respect to the squared radius grows without limit; its value at
    # half the radius gives half the range of the tilt.
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
        If the limits do not suffice; the message gives the nodes, bytes and seconds needed and the setting to change.
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
        If the limit would be exceeded; the message gives the seconds spent, and those predicted for the next round.
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
    """Refuse wavelengths and targets for which scalar diffraction does not hold.

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
    """Number of orders beyond the argument at which a Bessel function has fallen to the tolerance."""
    decay = math.log(1.0 / tolerance)
    airy = (1.5 * decay) ** (2.0 / 3.0) / 2.0 ** (1.0 / 3.0) * max(turns, 1.0) ** (1.0 / 3.0)
    return float(airy + 2.0)


def _three(values: FloatArray) -> FloatArray:
    low, high = float(values.min()), float(values.max())
    return np.asarray([low]) if low == high else np.asarray([low, 0.5 * (low + high), high])

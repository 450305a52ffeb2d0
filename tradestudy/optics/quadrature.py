"""Quadrature nodes fitted to the shape of an aperture, so that its hard edge costs no accuracy."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arguments import checked
from tradestudy.optics.arrays import FloatArray, unit_phasor


@checked
@dataclass(frozen=True, kw_only=True)
class QuadratureNodes:
    """Nodes and weights for integrals over an area: ∬ g dA ≈ ``sum(weights * g(x, y))`` for any smooth function g.

    Parameters
    ----------
    x, y
        Positions of the nodes [m], shape (n,).
    weights
        Weights [m²], shape (n,). They sum to the area.
    centre
        Centre of the area (x, y) [m].
    half_extent
        Half the longer side of the smallest rectangle around the area, with sides along x and y [m], > 0.

    Raises
    ------
    OutOfRangeError
        x, y and weights are not flat arrays of the same length, the centre is not finite, or ``half_extent`` is
        not positive and finite.

    Examples
    --------
    >>> from tradestudy import optics
    >>> nodes = optics.disc_nodes(radius=1e-3, radial_count=3, angular_count=8)
    >>> print(f"{nodes.count} nodes, area {nodes.weights.sum() * 1e6:.6f} mm²")
    24 nodes, area 3.141593 mm²
    """

    x: FloatArray
    y: FloatArray
    weights: FloatArray
    centre: tuple[float, float]
    half_extent: float

    def __post_init__(self) -> None:
        if not (all(map(math.isfinite, self.centre)) and 0 < self.half_extent < math.inf):
            raise OutOfRangeError(
                "centre and half extent of quadrature nodes",
                value=f"{self.centre}, {self.half_extent:g} m",
                limit="finite, the extent > 0",
                remedy="give the box around the area in metres",
            )
        if not (self.x.ndim == 1 and self.x.shape == self.y.shape == self.weights.shape and self.x.size > 0):
            raise OutOfRangeError(
                "quadrature nodes need x, y and weights of one length",
                value=f"shapes {self.x.shape}, {self.y.shape}, {self.weights.shape}",
                limit="three arrays of shape (n,), n ≥ 1",
                remedy="use disc_nodes or rectangle_nodes",
            )

    @property
    def count(self) -> int:
        """Number of nodes."""
        return int(self.x.size)


@checked
def disc_nodes(
    *,
    radius: float,
    radial_count: int,
    angular_count: int | npt.NDArray[np.int_],
    centre: tuple[float, float] = (0.0, 0.0),
) -> QuadratureNodes:
    """Quadrature nodes on a disc: rings at Gauss–Legendre points in the squared radius, each with equally spaced nodes.

    The rule is exact for monomials x^i y^j with i + j < ``angular_count`` (its smallest entry, for an array) and
    i + j ≤ 4 ``radial_count`` − 2. For other smooth functions, the error falls faster than any power of the counts.

    Parameters
    ----------
    radius
        Radius of the disc [m], > 0.
    radial_count
        Number of rings, ≥ 1.
    angular_count
        Number of nodes on each ring, ≥ 1. An array of shape (radial_count,) sets the number for each ring, from the
        innermost outwards: smaller rings need fewer nodes.
    centre
        Centre of the disc (x, y) [m].

    Returns
    -------
    QuadratureNodes
        The nodes, ring by ring from the innermost.

    Raises
    ------
    OutOfRangeError
        The radius is not positive and finite, a count is below 1, or the array of counts has the wrong shape.

    References
    ----------
    R. Cools and K. J. Kim, "A survey of known and new cubature formulas for the unit disk", 2000.

    Examples
    --------
    >>> import numpy as np
    >>> from tradestudy import optics
    >>> nodes = optics.disc_nodes(radius=2.0, radial_count=3, angular_count=8)
    >>> print(f"{nodes.weights @ nodes.x**2 / np.pi:.12f}")  # ∬ x² dA/π = R⁴/4
    4.000000000000
    """
    _check_positive("radius of the disc", radius)
    _check_counts(radial_count, int(np.min(angular_count, initial=1)))
    if np.shape(angular_count) not in ((), (radial_count,)):
        raise OutOfRangeError(
            "angular_count",
            value=f"shape {np.shape(angular_count)}",
            limit=f"a number, or shape ({radial_count},)",
            remedy="give one count for each ring",
        )
    t, w = gauss_legendre(radial_count)
    counts = np.broadcast_to(angular_count, t.shape)
    ring = np.repeat(radius * np.sqrt(t), counts)
    direction = unit_phasor(ring_angles(counts))
    return QuadratureNodes(
        x=centre[0] + ring * direction.real,
        y=centre[1] + ring * direction.imag,
        weights=np.repeat(np.pi * radius**2 * w / counts, counts),
        centre=centre,
        half_extent=radius,
    )


def ring_angles(counts: npt.NDArray[np.int_]) -> FloatArray:
    """Equally spaced angles of the nodes of each ring, ring by ring, starting at 0 [rad]."""
    place = np.arange(int(counts.sum())) - np.repeat(np.cumsum(counts) - counts, counts)
    return np.asarray(2.0 * np.pi * place / np.repeat(counts, counts))


@checked
def rectangle_nodes(
    *, width: float, height: float, counts: tuple[int, int], centre: tuple[float, float] = (0.0, 0.0)
) -> QuadratureNodes:
    """Quadrature nodes on a rectangle: the product of Gauss–Legendre rules along x and along y.

    Parameters
    ----------
    width
        Side along x [m], > 0.
    height
        Side along y [m], > 0.
    counts
        Numbers of nodes along x and along y, each ≥ 1. n nodes along x integrate polynomials in x up to degree 2n − 1
        exactly, and likewise along y.
    centre
        Centre of the rectangle (x, y) [m].

    Returns
    -------
    QuadratureNodes
        The nodes, row by row: x varies fastest.

    Raises
    ------
    OutOfRangeError
        A side is not positive and finite, or a count is below 1.

    References
    ----------
    P. J. Davis and P. Rabinowitz, *Methods of Numerical Integration*, section 2.7.

    Examples
    --------
    >>> from tradestudy import optics
    >>> nodes = optics.rectangle_nodes(width=2.0, height=1.0, counts=(3, 3))
    >>> print(f"{nodes.weights @ nodes.x**2:.12f}")  # ∬ x² dA = height · width³/12
    0.666666666667
    """
    _check_positive("width of the rectangle", width)
    _check_positive("height of the rectangle", height)
    _check_counts(*counts)
    tx, wx = gauss_legendre(counts[0])
    ty, wy = gauss_legendre(counts[1])
    x = np.tile(centre[0] + width * (tx - 0.5), counts[1])
    y = np.repeat(centre[1] + height * (ty - 0.5), counts[0])
    weights = width * height * np.multiply.outer(wy, wx).ravel()
    return QuadratureNodes(x=x, y=y, weights=weights, centre=centre, half_extent=max(width, height) / 2)


@lru_cache(maxsize=64)
def gauss_legendre(count: int) -> tuple[FloatArray, FloatArray]:
    """Nodes and weights of the Gauss–Legendre rule of `count` points on the interval [0, 1].

    The returned arrays are shared and read-only.
    """
    from scipy.special import roots_legendre  # checking a study needs no rule

    x, w = roots_legendre(count)
    nodes, weights = np.asarray(0.5 * (1.0 + x), dtype=np.float64), np.asarray(0.5 * w, dtype=np.float64)
    nodes.setflags(write=False)
    weights.setflags(write=False)
    return nodes, weights


def _check_positive(what: str, value: float) -> None:
    if not (np.isfinite(value) and value > 0.0):
        raise OutOfRangeError(what, value=f"{value:g} m", limit="> 0, finite", remedy="give a length in metres")


def _check_counts(*counts: int) -> None:
    if min(counts) < 1:
        raise OutOfRangeError("number of quadrature nodes", value=f"{counts}", limit="≥ 1", remedy="raise it")

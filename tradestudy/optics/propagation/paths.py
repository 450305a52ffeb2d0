"""Optical paths over a lens plane: spherical waves, parabolas, and their sums.

Every term is a path *difference* from the vertex of the plane, in a form that does not cancel:
√(d² + |q − c|²) − √(d² + |c|²) = (|q|² − 2 q·c) / (their sum). The formulas are analytic, so that positions may be
complex: the boundary-diffracted wave looks for poles near the real axis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import reduce
from operator import add
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]


@dataclass(frozen=True, kw_only=True)
class Expansion:
    """A path with its first and second derivatives at points; arrays in the shape of the points.

    Attributes
    ----------
    value
        Path [m].
    p_x, p_y
        Its gradient [1].
    xx, xy, yy
        Its second derivatives [1/m].

    Examples
    --------
    >>> from tradestudy import optics
    >>> (path,) = optics.Pupil(zernikes={4: 100e-9}).path_terms(1e-3)
    >>> expansion = path.expansion(0.0, 0.0)
    >>> print(f"{expansion.value * 1e9:.1f} nm, curvature {expansion.xx:.4f} 1/m")
    -173.2 nm, curvature 0.6928 1/m
    """

    value: Array
    p_x: Array
    p_y: Array
    xx: Array
    xy: Array
    yy: Array

    def __add__(self, other: Expansion) -> Expansion:
        return Expansion(
            value=self.value + other.value,
            p_x=self.p_x + other.p_x,
            p_y=self.p_y + other.p_y,
            xx=self.xx + other.xx,
            xy=self.xy + other.xy,
            yy=self.yy + other.yy,
        )


class PathTerm(Protocol):
    """One path over a lens plane, relative to its centre."""

    def value(self, x: Array, y: Array) -> Array:
        """Path [m]."""

    def slope(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Gradient of the path."""

    def expansion(self, x: Array, y: Array) -> Expansion:
        """Path, gradient and second derivatives [1/m]."""


@dataclass(frozen=True, kw_only=True)
class SphericalPath:
    """Path of a spherical wave from a point at (x, y), at a signed distance in front of the plane.

    Parameters
    ----------
    x, y
        Transverse position of the centre of the wave [m].
    distance
        Distance from the centre to the plane [m]; > 0 for light diverging from a point in front of the plane, < 0 for
        light converging to one behind it.
    weight
        +1 to add the path, −1 to subtract it (a lens that cancels it).
    """

    x: float
    y: float
    distance: float
    weight: float = 1.0

    def value(self, x: Array, y: Array) -> Array:
        """Path relative to the vertex [m]."""
        vertex = math.hypot(self.distance, self.x, self.y)
        # r² − r₀² over r + r₀: the difference r − r₀ of two long distances would lose digits.
        return self._sign() * ((x - 2 * self.x) * x + (y - 2 * self.y) * y) / (self._range(x, y) + vertex)

    def slope(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Gradient of the path: transverse direction cosines."""
        scale = self._sign() / self._range(x, y)
        return scale * (x - self.x), scale * (y - self.y)

    def expansion(self, x: Array, y: Array) -> Expansion:
        """Path, gradient and second derivatives [1/m], together at the cost of one square root."""
        r = self._range(x, y)
        sign = self._sign()
        vertex = math.hypot(self.distance, self.x, self.y)
        cos_x, cos_y = (x - self.x) / r, (y - self.y) / r
        scale = sign / r
        return Expansion(
            value=sign * ((x - 2 * self.x) * x + (y - 2 * self.y) * y) / (r + vertex),
            p_x=sign * cos_x,
            p_y=sign * cos_y,
            xx=scale * (1 - cos_x * cos_x),
            xy=-scale * cos_x * cos_y,
            yy=scale * (1 - cos_y * cos_y),
        )

    def _range(self, x: Array, y: Array) -> Array:
        return np.asarray(np.sqrt(self.distance**2 + (x - self.x) ** 2 + (y - self.y) ** 2))

    def _sign(self) -> float:
        return math.copysign(self.weight, self.weight * self.distance)


@dataclass(frozen=True, kw_only=True)
class ParabolicPath:
    """The second-order path of a spherical wave: (|q|² − 2 q·c)/(2 d); a thin parabolic lens has d = −f, c = 0.

    Parameters
    ----------
    x, y
        Transverse position of the centre of the wave [m].
    distance
        Signed distance from the centre to the plane [m], as in `SphericalPath`.
    """

    x: float
    y: float
    distance: float

    def value(self, x: Array, y: Array) -> Array:
        """Path relative to the vertex [m]."""
        return ((x - 2 * self.x) * x + (y - 2 * self.y) * y) / (2 * self.distance)

    def slope(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Gradient of the path: transverse direction cosines."""
        return (x - self.x) / self.distance, (y - self.y) / self.distance

    def expansion(self, x: Array, y: Array) -> Expansion:
        """Path, gradient and second derivatives [1/m]."""
        p_x, p_y = self.slope(x, y)
        constant = np.full(np.broadcast(x, y).shape, 1.0 / self.distance)
        return Expansion(value=self.value(x, y), p_x=p_x, p_y=p_y, xx=constant, xy=np.zeros_like(constant), yy=constant)


@dataclass(frozen=True, kw_only=True)
class PathSum:
    """The sum of path terms over one lens plane."""

    terms: tuple[PathTerm, ...]

    def value(self, x: Array, y: Array) -> Array:
        """Path relative to the vertex [m]."""
        return np.asarray(sum(term.value(x, y) for term in self.terms))

    def slope(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Gradient of the path: transverse direction cosines."""
        parts = [term.slope(x, y) for term in self.terms]
        return np.asarray(sum(p[0] for p in parts)), np.asarray(sum(p[1] for p in parts))

    def expansion(self, x: Array, y: Array) -> Expansion:
        """Path, gradient and second derivatives [1/m]."""
        return reduce(add, (term.expansion(x, y) for term in self.terms))

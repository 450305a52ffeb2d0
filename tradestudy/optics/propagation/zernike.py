"""Zernike polynomials in Noll's order, as the path of a wave over an aperture."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial.polynomial import polyder, polyval2d

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.propagation.paths import Array, Expansion

_LARGEST_INDEX = 153  # radial order 16: at higher orders the coefficients cancel digits that a tolerance may need


def noll_order(index: int) -> tuple[int, int]:
    """Radial order n and azimuthal order m of the Zernike polynomial with Noll index j.

    Parameters
    ----------
    index
        Noll index j, a whole number from 1 to 153.

    Returns
    -------
    tuple
        (n, m). The polynomial contains cos mθ if m > 0 (even j), and sin |m|θ if m < 0 (odd j); θ is the angle from the
        x axis.

    Raises
    ------
    OutOfRangeError
        The index is not a whole number from 1 to 153.

    References
    ----------
    R. J. Noll, "Zernike polynomials and atmospheric turbulence", 1976, table I.

    Examples
    --------
    Defocus, coma along y, coma along x, and spherical aberration:

    >>> from tradestudy import optics
    >>> [optics.noll_order(j) for j in (4, 7, 8, 11)]
    [(2, 0), (3, -1), (3, 1), (4, 0)]
    """
    if not (isinstance(index, (int, np.integer)) and 1 <= index <= _LARGEST_INDEX):
        raise OutOfRangeError(
            "Noll index",
            value=repr(index),
            limit=f"a whole number from 1 to {_LARGEST_INDEX}",
            remedy="give Noll's j instead of (n, m): 4 is defocus, 7 and 8 are coma, 11 is spherical aberration",
        )
    index = int(index)  # NumPy's small integers would overflow
    n = math.ceil((math.sqrt(8 * index + 1) - 3) / 2)
    place = index - n * (n + 1) // 2 - 1  # within its order
    m = 2 * ((place + 1 + n % 2) // 2) - n % 2
    return n, m if index % 2 == 0 else -m


@dataclass(frozen=True, kw_only=True)
class ZernikePath:
    """Σ a_j Z_j(x/R, y/R), as a polynomial in p = (x + i y)/R and q = (x − i y)/R.

    Parameters
    ----------
    zernikes
        a_j [m rms] by Noll's index.
    radius
        R [m].

    Examples
    --------
    Defocus of 100 nm rms, which adds 2√3 times as much from centre to rim:

    >>> from tradestudy import optics
    >>> (path,) = optics.Pupil(zernikes={4: 100e-9}).path_terms(1e-3)
    >>> print(f"{(path.value(1e-3, 0.0) - path.value(0.0, 0.0)) * 1e9:.1f} nm, slope {path.slope(1e-3, 0.0)[0]:.3e}")
    346.4 nm, slope 6.928e-04
    >>> print(f"curvature {path.expansion(0.0, 0.0).xx:.4f} 1/m")
    curvature 0.6928 1/m
    """

    zernikes: Mapping[int, float]
    radius: float

    @cached_property
    def _polynomial(self) -> Array:
        """Coefficients of p^i q^j: ρⁿ cos mθ = (p^m + q^m)(p q)^((n − m)/2)/2, ρⁿ sin mθ likewise by (p^m − q^m)/i."""
        largest = max(noll_order(index)[0] for index in self.zernikes)
        total = np.zeros((largest + 1, largest + 1), dtype=np.complex128)
        for index, coefficient in self.zernikes.items():
            n, signed = noll_order(index)
            m = abs(signed)
            norm = coefficient * math.sqrt((n + 1) * (2 if m else 1))
            for k in range((n - m) // 2 + 1):
                radial = (-1) ** k * math.comb(n - k, k) * math.comb(n - 2 * k, (n - m) // 2 - k)
                pairs = (n - m) // 2 - k
                total[pairs + m, pairs] += norm * radial * (0.5 if signed >= 0 else -0.5j)
                total[pairs, pairs + m] += norm * radial * (0.5 if signed >= 0 else 0.5j)
        return total

    def value(self, x: Array, y: Array) -> Array:
        """Path [m].

        Parameters
        ----------
        x, y
            Positions relative to the centre of the aperture [m], broadcast against each other.
        """
        return self._at(self._polynomial, x, y)

    def slope(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Gradient of the path [1], ∂x = ∂p + ∂q and ∂y = i (∂p − ∂q); positions as in `ZernikePath.value`."""
        p, q = self._derivative(1, 0), self._derivative(0, 1)
        return self._at(p + q, x, y), self._at(1j * (p - q), x, y)

    def expansion(self, x: Array, y: Array) -> Expansion:
        """Path [m], gradient [1] and second derivatives [1/m]; positions as in `ZernikePath.value`."""
        pp, pq, qq = self._derivative(2, 0), self._derivative(1, 1), self._derivative(0, 2)
        p_x, p_y = self.slope(x, y)
        return Expansion(
            value=self.value(x, y),
            p_x=p_x,
            p_y=p_y,
            xx=self._at(pp + 2 * pq + qq, x, y),
            xy=self._at(1j * (pp - qq), x, y),
            yy=self._at(2 * pq - pp - qq, x, y),
        )

    def _derivative(self, along_p: int, along_q: int) -> Array:
        """Coefficients of a derivative, in an array as large as that of the polynomial [1/mⁿ]."""
        size = self._polynomial.shape[0]
        found = polyder(polyder(self._polynomial, along_p, axis=0), along_q, axis=1)[:size, :size]
        padded = np.pad(found, [(0, size - n) for n in found.shape])
        return np.asarray(padded / self.radius ** (along_p + along_q))

    def _at(self, polynomial: Array, x: Array, y: Array) -> Array:
        """Value of a polynomial at (x, y); real at real positions."""
        x, y = np.broadcast_arrays(x, y)
        found = np.asarray(polyval2d((x + 1j * y) / self.radius, (x - 1j * y) / self.radius, polynomial))
        return found if np.iscomplexobj(x) or np.iscomplexobj(y) else found.real

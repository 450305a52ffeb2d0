"""Amplitude and path that an aperture adds to a wave besides the lens phase, as Zernike coefficients or as maps."""

from __future__ import annotations

import math
import numbers
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.polynomial.polynomial import polyder, polyval2d

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arguments import check_wavelength, checked
from tradestudy.optics.arrays import FloatArray
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
        derivative = polyder(polyder(self._polynomial, along_p, axis=0), along_q, axis=1)[:size, :size]
        padded = np.pad(derivative, [(0, size - n) for n in derivative.shape])
        return np.asarray(padded / self.radius ** (along_p + along_q))

    def _at(self, polynomial: Array, x: Array, y: Array) -> Array:
        """Value of a polynomial at (x, y); real at real positions."""
        x, y = np.broadcast_arrays(x, y)
        value = np.asarray(polyval2d((x + 1j * y) / self.radius, (x - 1j * y) / self.radius, polynomial))
        return value if np.iscomplexobj(x) or np.iscomplexobj(y) else value.real


PupilMap = Callable[[FloatArray, FloatArray], FloatArray] | FloatArray
_LARGEST_COEFFICIENT = 1e40  # m: squares of larger paths overflow
_LEAST_SAMPLES = 6  # a side of a map, for a quintic spline
_STEP = 1e-4  # of the radius, for the slope of a function: fourth-order differences are then accurate to 1e-12


@checked
@dataclass(frozen=True, kw_only=True)
class Pupil:
    """Amplitude transmission and aberrations of an aperture.

    In addition to the lens phase, the aperture multiplies the wave by t exp(i k W), where t is the amplitude
    transmission, W the added path and k = 2π/λ for the wavelength λ. A positive W delays the wave. W is the sum of
    `zernikes` and `path`.

    Positions are given as (x/R, y/R): x and y are measured from the centre of the aperture, along the axes of source
    and targets, and R is its radius. As arrays, `path` and `amplitude` have shape (n, n), n ≥ 6, and cover the square
    around the aperture: row i lies at y/R = −1 + 2 i/(n − 1), column j at x/R = −1 + 2 j/(n − 1). A quintic spline
    interpolates the values, so they must continue smoothly beyond the edge of the aperture. Functions must be smooth,
    too: with a step inside the aperture, quadrature converges slowly and may miss the tolerance. A dark centre costs no
    accuracy if `obscuration` declares it. With the methods ``geometric`` and ``boundary_wave``, `aperture_field` and
    `point_spread` accept only Zernike coefficients, and `chain_image` accepts no pupil.

    Parameters
    ----------
    zernikes
        Zernike coefficients of W, by Noll's index from 1 to 153 [m rms]. Each must be smaller in magnitude than the
        radius R of the lens that gets the pupil. The polynomials have unit variance over the disc.
    path
        Further part of W [m], as a function of (x/R, y/R) or an array. Default: 0.
    amplitude
        Amplitude transmission t [1], as a function of (x/R, y/R) or an array. Default: 1.
    obscuration
        Radius of a central dark disc relative to R [1], in [0, 1); for main lenses only.

    Raises
    ------
    OutOfRangeError
        A Noll index is unknown, a coefficient is not finite, or an array or the obscuration does not meet the
        conditions above.

    References
    ----------
    R. J. Noll, "Zernike polynomials and atmospheric turbulence", 1976.

    Examples
    --------
    A tenth of a wave (rms) of coma along x; and a Gaussian beam whose intensity falls to 1/e² at the edge of the
    aperture:

    >>> import numpy as np
    >>> from tradestudy import optics
    >>> coma = optics.Pupil.from_waves({8: 0.1}, wavelength=550e-9)
    >>> print(f"{coma.zernikes[8]:.3g} m")
    5.5e-08 m
    >>> gaussian = optics.Pupil(amplitude=lambda x, y: np.exp(-(x**2 + y**2)))
    >>> (term,) = coma.path_terms(1e-3)
    >>> print(f"path at the edge {term.value(1e-3, 0.0):.3g} m; Gaussian: {gaussian.path_terms(1e-3)}")
    path at the edge 1.56e-07 m; Gaussian: ()
    """

    zernikes: Mapping[int, float] = field(default_factory=dict)
    path: PupilMap | None = None
    amplitude: PupilMap | None = None
    obscuration: float = 0.0

    def __post_init__(self) -> None:
        for index, coefficient in self.zernikes.items():
            noll_order(index)
            whole, real = isinstance(coefficient, int), isinstance(coefficient, numbers.Real)
            if not (real and abs(coefficient if whole else float(coefficient)) <= _LARGEST_COEFFICIENT):
                raise OutOfRangeError(
                    f"Zernike coefficient {index}",
                    value=repr(coefficient),
                    limit=f"a number, at most {_LARGEST_COEFFICIENT:g} m in magnitude",
                    remedy="give it in metres, or in waves to Pupil.from_waves",
                )
        # Numbers of Python: NumPy's in single precision would round the path.
        object.__setattr__(self, "zernikes", {int(index): float(value) for index, value in self.zernikes.items()})
        if not 0 <= self.obscuration < 1:
            raise OutOfRangeError(
                "obscuration of the pupil",
                value=f"{self.obscuration:g}",
                limit="in [0, 1)",
                remedy="give it relative to the radius",
            )
        for name in ("path", "amplitude"):
            pupil_map = getattr(self, name)
            if pupil_map is None or callable(pupil_map):
                continue
            if pupil_map.ndim != 2 or pupil_map.shape[0] != pupil_map.shape[1] or pupil_map.shape[0] < _LEAST_SAMPLES:
                raise OutOfRangeError(
                    f"{name} of the pupil",
                    value=f"shape {pupil_map.shape}",
                    limit=f"(n, n), n ≥ {_LEAST_SAMPLES}",
                    remedy="sample the square around the aperture, or give a function",
                )
            if not np.isfinite(pupil_map).all():
                raise OutOfRangeError(
                    f"{name} of the pupil",
                    value="not finite",
                    limit="finite over the whole square",
                    remedy="continue the values smoothly beyond the rim",
                )

    @classmethod
    @checked
    def from_waves(
        cls,
        zernikes: Mapping[int, float],
        *,
        wavelength: float,
        path: PupilMap | None = None,
        amplitude: PupilMap | None = None,
        obscuration: float = 0.0,
    ) -> Pupil:
        """Return a pupil whose Zernike coefficients and path are given in waves.

        Parameters
        ----------
        zernikes
            Zernike coefficients of W, by Noll's index from 1 to 153 [waves rms].
        wavelength
            Wavelength that converts waves to metres [m], > 0. The resulting path in metres does not depend on the
            wavelength of the light.
        path
            Further part of W [waves], as a function of (x/R, y/R) or an array. Default: 0.
        amplitude
            Amplitude transmission t [1], as a function of (x/R, y/R) or an array. Default: 1.
        obscuration
            Radius of a central dark disc relative to R [1], in [0, 1); for main lenses only.

        Returns
        -------
        Pupil
            Pupil with its path in metres.

        Raises
        ------
        OutOfRangeError
            The wavelength is not positive and finite, a Noll index is unknown, a coefficient is not a finite number, or
            an array or the obscuration does not meet the conditions of `Pupil`.
        """
        check_wavelength(wavelength)
        for index, waves in zernikes.items():
            if not isinstance(waves, numbers.Real):
                raise OutOfRangeError(
                    f"Zernike coefficient {index}",
                    value=repr(waves),
                    limit="a number",
                    remedy="give waves rms by Noll's index, as in {8: 0.1}",
                )
        return cls(
            zernikes={index: wavelength * waves for index, waves in zernikes.items()},
            path=None if path is None else scaled(path, wavelength),
            amplitude=amplitude,
            obscuration=obscuration,
        )

    @property
    def aberrated(self) -> bool:
        """Whether the pupil adds a path to the wave."""
        return self.path is not None or any(self.zernikes.values())

    @property
    def evenly_lit(self) -> bool:
        """Whether the whole aperture transmits the full amplitude."""
        return self.amplitude is None and self.obscuration == 0.0

    @property
    def round(self) -> bool:
        """Whether there is no `path` and no `amplitude`, and every Zernike term has azimuthal order 0."""
        even = all(noll_order(index)[1] == 0 for index, coefficient in self.zernikes.items() if coefficient)
        return even and self.path is None and self.amplitude is None

    def path_terms(self, radius: float) -> tuple[ZernikePath | MapPath, ...]:
        """Return the terms whose sum is the path W over an aperture.

        Parameters
        ----------
        radius
            Radius R of the aperture [m].

        Returns
        -------
        tuple
            One term for the Zernike polynomials and one for `path`, each only if given. The method ``value(x, y)`` of a
            term returns the path [m] at positions relative to the centre of the aperture [m].

        Raises
        ------
        OutOfRangeError
            A coefficient is not smaller than R, probably because waves were given as metres, or the wavelength was not
            in metres.
        """
        for index, coefficient in self.zernikes.items():
            if not abs(coefficient) < radius:
                raise OutOfRangeError(
                    f"Zernike coefficient {index}",
                    value=f"{coefficient:g} m",
                    limit=f"smaller than the aperture's radius of {radius:g} m",
                    remedy="give waves to Pupil.from_waves, with the wavelength in metres",
                )
        terms: list[ZernikePath | MapPath] = []
        if any(self.zernikes.values()):
            terms.append(ZernikePath(zernikes=self.zernikes, radius=radius))
        if self.path is not None:
            terms.append(MapPath(map=pupil_function(self.path), radius=radius))
        return tuple(terms)

    @cached_property
    def transmission(self) -> Callable[[FloatArray, FloatArray], FloatArray] | None:
        """Amplitude transmission t [1] as a function of (x/R, y/R); None if it is 1 everywhere."""
        return None if self.amplitude is None else pupil_function(self.amplitude)


def scaled(pupil_map: PupilMap, factor: float) -> PupilMap:
    """Return a map times a factor."""
    if callable(pupil_map):
        return lambda x, y: factor * np.asarray(pupil_map(x, y))
    return np.asarray(factor * pupil_map)


def pupil_function(pupil_map: PupilMap) -> Callable[[FloatArray, FloatArray], FloatArray]:
    """A map as a function of relative positions: the function itself, or the quintic spline through the array."""
    if callable(pupil_map):
        return pupil_map
    axis = np.linspace(-1.0, 1.0, pupil_map.shape[0])
    from scipy.interpolate import RectBivariateSpline  # loads more slowly than most fields are computed

    spline = RectBivariateSpline(axis, axis, pupil_map, kx=5, ky=5)
    return lambda x, y: np.asarray(spline(y, x, grid=False))


@dataclass(frozen=True, kw_only=True)
class MapPath:
    """Any path over an aperture, with its slope by differences.

    Parameters
    ----------
    map
        Path [m] as a function of (x/R, y/R).
    radius
        R [m].

    Examples
    --------
    A tilt of 100 nm from centre to rim:

    >>> from tradestudy import optics
    >>> (path,) = optics.Pupil(path=lambda x, y: 100e-9 * x).path_terms(1e-3)
    >>> print(f"{path.value(1e-3, 0.0) * 1e9:.1f} nm, slope {path.slope(0.0, 0.0)[0]:.1e}")
    100.0 nm, slope 1.0e-04
    >>> path.expansion(0.0, 0.0)
    Traceback (most recent call last):
    tradestudy.errors.OutOfRangeError: rays or boundary waves behind a pupil: a path given as a function or an array
    (allowed: a path of Zernike coefficients); fit Zernike coefficients to the path, or use method 'fresnel' or
    'kirchhoff'
    """

    map: Callable[[FloatArray, FloatArray], FloatArray]
    radius: float

    def value(self, x: Array, y: Array) -> Array:
        """Path [m]; positions as in `ZernikePath.value`.

        Raises
        ------
        OutOfRangeError
            The function does not return one finite number for each position.
        """
        x, y = np.broadcast_arrays(x, y)
        return checked_map(self.map(x / self.radius, y / self.radius), x, "path")

    def slope(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Gradient of the path [1] by differences; positions as in `ZernikePath.value`.

        It is taken slightly inside each position, because a spline ends at the rim.
        """
        h = _STEP * self.radius
        inside = 1 - 2 * _STEP
        x, y = inside * x, inside * y
        along_x, along_y = (
            (8 * (self.value(x + a, y + b) - self.value(x - a, y - b)))
            - (self.value(x + 2 * a, y + 2 * b) - self.value(x - 2 * a, y - 2 * b))
            for a, b in ((h, 0.0), (0.0, h))
        )
        return along_x / (12 * h), along_y / (12 * h)

    def expansion(self, x: Array, y: Array) -> Expansion:  # noqa: ARG002  (one signature for all paths)
        """Refuse, as only Zernike coefficients have second derivatives [1/m]; positions as in `ZernikePath.value`.

        Raises
        ------
        OutOfRangeError
            Always.
        """
        raise OutOfRangeError(
            "rays or boundary waves behind a pupil",
            value="a path given as a function or an array",
            limit="a path of Zernike coefficients",
            remedy="fit Zernike coefficients to the path, or use method 'fresnel' or 'kirchhoff'",
        )


def checked_map(returned: object, x: Array, name: str) -> FloatArray:
    """Values of a pupil's function, refused unless there is one finite real number for each position."""
    values = np.asarray(returned)
    if values.dtype.kind not in "buif":
        raise OutOfRangeError(
            f"{name} of the pupil",
            value=f"values of type {values.dtype}",
            limit="real numbers",
            remedy="give the phase of a complex amplitude as a path [m], and its magnitude as the amplitude",
        )
    if values.shape not in ((), x.shape) or not np.isfinite(values).all():
        raise OutOfRangeError(
            f"{name} of the pupil",
            value=f"shape {values.shape} for positions of shape {x.shape}"
            + ("" if np.isfinite(values).all() else ", not finite"),
            limit="one finite number for each position",
            remedy="return an array of the shape of x and y",
        )
    return np.broadcast_to(values.astype(np.float64, copy=False), x.shape)

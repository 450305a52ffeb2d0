"""Laws of propagation from an aperture to a target: Kirchhoff's integral with its variants, and Fresnel's."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tradestudy.optics.argument_types import check_wavelength, checked_fields
from tradestudy.optics.propagation.lens import Obliquity, check_obliquity
from tradestudy.optics.propagation.paths import Array


@checked_fields
@dataclass(frozen=True, kw_only=True)
class KirchhoffKernel:
    """U(P) = ∬ U(q) exp(i k s)/(iλ s) · obliquity dq with the exact path s = |P − q|.

    * ``paper``: z/s, the single cosine of eqs. 9–16. The paper calls it Kirchhoff; in the literature it is the
      far-zone form of the first Rayleigh–Sommerfeld integral.
    * ``textbook``: (cos θ of the arriving wave + z/s)/2, the Fresnel–Kirchhoff obliquity.
    * ``rayleigh-sommerfeld-1``: z/s (1 + i/(k s)), exact for a known field in the plane.

    The textbook law uses the direction of the wave behind the lens; the boundary-diffracted wave is exact only for this
    law. In focus behind an f/3.8 microlens, the intensity differs from the paper's by 1e-5 (textbook) and 1e-7
    (Rayleigh–Sommerfeld) in the L2 norm; at a distance a quarter greater, by 5e-4 and 2e-7. The phase of the
    Rayleigh–Sommerfeld field differs by 1/(k s), which is 2e-4 there. With the direction in front of the lens, the
    textbook intensity in focus would be 0.4 % above the paper's.

    Parameters
    ----------
    wavelength
        Wavelength [m].
    obliquity
        One of the three laws above.

    Raises
    ------
    OutOfRangeError
        The wavelength is not positive and finite, or the obliquity is unknown.

    References
    ----------
    "Diffraction model of a plenoptic camera for in-situ space exploration", eqs. 9–16; M. Born and E. Wolf,
    "Principles of Optics", 8.3.2; J. W. Goodman, "Introduction to Fourier Optics", 3.4–3.5.

    Examples
    --------
    >>> from tradestudy import optics
    >>> kernel = optics.KirchhoffKernel(wavelength=550e-9, obliquity="textbook")
    >>> node, target = (1e-3, 0.0), (0.0, 0.0, 0.1)
    >>> change, spreading = kernel.path_and_spreading(*node, 1.0, *target)
    >>> print(spreading == kernel.spreading(*node, 1.0, *target))
    True
    >>> print(f"{kernel.wavenumber:.4g} rad/m, path {kernel.path(*target)} m, {change * 1e6:.5f} µm more from the node")
    1.142e+07 rad/m, path 0.1 m, 4.99988 µm more from the node
    >>> print(f"{spreading:.5f} 1/m, amplitude {abs(kernel.amplitude(*node, 1.0, *target)):.4e} 1/m²")
    9.99925 1/m, amplitude 1.8180e+07 1/m²
    >>> print(f"slope {kernel.slope_at_target(*node, *target)[0]:.7f}")
    slope -0.0099995
    >>> print(f"{kernel.beyond_linear(*node, 1.0, target, 1e-5, 0.0, 0.0)[0] * 1e9:.4f} nm beyond 10 µm of that slope")
    0.4999 nm beyond 10 µm of that slope
    """

    wavelength: float
    obliquity: Obliquity

    def __post_init__(self) -> None:
        check_wavelength(self.wavelength)
        check_obliquity(self.obliquity)

    @property
    def wavenumber(self) -> float:
        """2π/λ [rad/m]."""
        return 2 * math.pi / self.wavelength

    def path(self, x: Array, y: Array, z: Array) -> Array:
        """Path from the centre of the aperture to a target.

        Parameters
        ----------
        x, y, z
            Coordinates of the targets relative to the centre of the aperture [m], broadcast against each other.

        Returns
        -------
        ndarray
            √(x² + y² + z²) [m].
        """
        return np.asarray(np.sqrt(x * x + y * y + z * z))

    def slope_at_target(
        self, u: Array, v: Array, x: Array | float, y: Array | float, z: Array | float
    ) -> tuple[Array, Array, Array]:
        """Gradient of the path with respect to the target.

        Parameters
        ----------
        u, v
            Coordinates of the nodes relative to the centre of the aperture [m].
        x, y, z
            Coordinates of the targets relative to the centre of the aperture [m]; all arrays are broadcast together.

        Returns
        -------
        tuple
            Direction cosines [1] from the node to the target.
        """
        a, b = x - u, y - v
        s = np.sqrt(a * a + b * b + z * z)
        return a / s, b / s, z / s

    def path_and_spreading(
        self, u: Array, v: Array, cosine: Array | None, x: Array, y: Array, z: Array
    ) -> tuple[Array, Array]:
        """Path from a node minus the path from the centre, free of cancellation, and `spreading`.

        Parameters
        ----------
        u, v
            Coordinates of the nodes relative to the centre of the aperture [m].
        cosine
            Cosine of the angle between the axis and the wave that arrives at each node [1]; only the textbook
            obliquity uses it.
        x, y, z
            Coordinates of the targets relative to the centre of the aperture [m]; all arrays are broadcast together.

        Returns
        -------
        tuple
            Difference of the paths [m], and spreading [1/m].
        """
        squared = x * x + y * y + z * z
        change = np.asarray(u * (u - 2 * x))
        change += v * (v - 2 * y)
        to_node = np.asarray(squared + change)
        total = np.asarray(np.sqrt(to_node))
        total += np.sqrt(squared)
        change /= total
        return change, self._spreading(cosine, to_node, z)

    def beyond_linear(
        self,
        u: Array,
        v: Array,
        cosine: Array | None,
        base: tuple[float, float, float],
        dx: Array,
        dy: Array,
        dz: Array,
    ) -> tuple[Array, Array]:
        """Nonlinear change of the path when the target moves from `base` by d, and `spreading` at the new target.

        The change leaves out the part linear in dx and dy. Let e be the unit vector from the node to the base, and
        s and t the paths from the node to base and target. Then t − s − e·d = (|d|² − (e·d)(t − s))/(s + t), which
        avoids cancellation; the part linear in dz is added to this.

        Parameters
        ----------
        u, v
            Coordinates of the nodes relative to the centre of the aperture [m].
        cosine
            Cosine of the angle between the axis and the wave that arrives at each node [1]; only the textbook
            obliquity uses it.
        base
            Base target (x, y, z) relative to the centre of the aperture [m].
        dx, dy, dz
            Offset d of the targets from the base [m].

        Returns
        -------
        tuple
            Nonlinear change of the path [m], and spreading [1/m].
        """
        a, b, c = base[0] - u, base[1] - v, base[2]
        s = np.sqrt(a * a + b * b + c * c)
        along = np.asarray((a / s) * dx)
        along += (b / s) * dy
        along += (c / s) * dz
        squared = dx * dx + dy * dy + dz * dz
        to_node = np.asarray((a + dx) ** 2)
        to_node += (b + dy) ** 2
        to_node += (c + dz) ** 2
        total = np.asarray(np.sqrt(to_node))
        total += s
        rest = along * (2 * s)
        rest += squared
        rest /= total  # t − s
        rest *= -along
        rest += squared
        rest /= total
        rest += (c / s) * dz
        return rest, self._spreading(cosine, to_node, c + dz)

    def amplitude(self, u: Array, v: Array, cosine: Array | None, x: Array, y: Array, z: Array) -> Array:
        """Everything but the phase: obliquity/(iλ s).

        Parameters
        ----------
        u, v
            Coordinates of the nodes relative to the centre of the aperture [m].
        cosine
            Cosine of the angle between the axis and the wave that arrives at each node [1]; only the textbook
            obliquity uses it.
        x, y, z
            Coordinates of the targets relative to the centre of the aperture [m]; all arrays are broadcast together.

        Returns
        -------
        ndarray
            Amplitude [1/m²].
        """
        return np.asarray(-1j / self.wavelength * self.spreading(u, v, cosine, x, y, z))

    def spreading(self, u: Array, v: Array, cosine: Array | None, x: Array, y: Array, z: Array) -> Array:
        """Obliquity factor over the path s from node to target; complex for Rayleigh–Sommerfeld, real otherwise.

        Parameters
        ----------
        u, v
            Coordinates of the nodes relative to the centre of the aperture [m].
        cosine
            Cosine of the angle between the axis and the wave that arrives at each node [1]; only the textbook
            obliquity uses it.
        x, y, z
            Coordinates of the targets relative to the centre of the aperture [m]; all arrays are broadcast together.

        Returns
        -------
        ndarray
            Spreading [1/m].
        """
        a, b = x - u, y - v
        return self._spreading(cosine, np.asarray(a * a + b * b + z * z), z)

    def _spreading(self, cosine: Array | None, squared: Array, z: Array) -> Array:
        """Obliquity/s from s²."""
        if self.obliquity == "paper":
            return np.asarray(z / squared)
        s = np.sqrt(squared)
        if self.obliquity == "textbook":
            assert cosine is not None  # guaranteed by ApertureSamples
            return np.asarray((cosine / s + z / squared) / 2)
        return np.asarray(z / squared * (1 + 1j / (self.wavenumber * s)))


@checked_fields
@dataclass(frozen=True, kw_only=True)
class FresnelKernel:
    """U(P) = exp(i k z)/(iλ z) ∬ U(q) exp(i k |P − q|²/(2 z)) dq.

    Parameters
    ----------
    wavelength
        Wavelength [m].

    Raises
    ------
    OutOfRangeError
        The wavelength is not positive and finite.

    References
    ----------
    "Diffraction model of a plenoptic camera for in-situ space exploration", eqs. 17–22.

    Examples
    --------
    >>> from tradestudy import optics
    >>> kernel = optics.FresnelKernel(wavelength=550e-9)
    >>> node, target = (1e-3, 0.0), (0.0, 0.0, 0.1)
    >>> change, spreading = kernel.path_and_spreading(*node, None, *target)
    >>> print(spreading == kernel.spreading(*node, None, *target))
    True
    >>> print(f"{kernel.wavenumber:.4g} rad/m, path {kernel.path(*target)} m, {change * 1e6:.5f} µm more from the node")
    1.142e+07 rad/m, path 0.1 m, 5.00000 µm more from the node
    >>> print(f"{spreading:.5f} 1/m, amplitude {abs(kernel.amplitude(*node, None, *target)):.4e} 1/m²")
    10.00000 1/m, amplitude 1.8182e+07 1/m²
    >>> print(f"slope {kernel.slope_at_target(*node, *target)[0]:.7f}")
    slope -0.0100000
    >>> print(f"{kernel.beyond_linear(*node, None, target, 1e-5, 0.0, 0.0)[0] * 1e9:.4f} nm beyond 10 µm of that slope")
    0.5000 nm beyond 10 µm of that slope
    """

    wavelength: float

    def __post_init__(self) -> None:
        check_wavelength(self.wavelength)

    @property
    def wavenumber(self) -> float:
        """2π/λ [rad/m]."""
        return 2 * math.pi / self.wavelength

    def path(self, x: Array, y: Array, z: Array) -> Array:
        """Path from the centre of the aperture to a target, z + (x² + y²)/(2 z) [m]; as in `KirchhoffKernel.path`."""
        return np.asarray(z + (x * x + y * y) / (2 * z))

    def slope_at_target(
        self, u: Array, v: Array, x: Array | float, y: Array | float, z: Array | float
    ) -> tuple[Array, Array, Array]:
        """Gradient of the path with respect to the target [1]; as in `KirchhoffKernel.slope_at_target`."""
        a, b = x - u, y - v
        return a / z, b / z, 1 - (a * a + b * b) / (2 * z * z)

    def path_and_spreading(
        self, u: Array, v: Array, cosine: Array | None, x: Array, y: Array, z: Array
    ) -> tuple[Array, Array]:
        """Difference of paths [m] and spreading [1/m], as in `KirchhoffKernel.path_and_spreading`."""
        change = np.asarray(u * (u - 2 * x))
        change += v * (v - 2 * y)
        change /= 2 * z
        return change, self.spreading(u, v, cosine, x, y, z)

    def beyond_linear(
        self,
        u: Array,
        v: Array,
        cosine: Array | None,
        base: tuple[float, float, float],
        dx: Array,
        dy: Array,
        dz: Array,
    ) -> tuple[Array, Array]:
        """Change of the path [m] and spreading [1/m], as in `KirchhoffKernel.beyond_linear`."""
        a, b, c = base[0] - u, base[1] - v, base[2]
        squared = (a + dx) ** 2 + (b + dy) ** 2
        rest = dz + (dx * dx + dy * dy) / (2 * c) - squared * (dz / (2 * c * (c + dz)))
        return np.asarray(rest), self.spreading(u, v, cosine, base[0] + dx, base[1] + dy, c + dz)

    def amplitude(self, u: Array, v: Array, cosine: Array | None, x: Array, y: Array, z: Array) -> Array:
        """Everything but the phase, 1/(iλ z) [1/m²]; as in `KirchhoffKernel.amplitude`."""
        return np.asarray(-1j / self.wavelength * self.spreading(u, v, cosine, x, y, z))

    def spreading(self, u: Array, v: Array, cosine: Array | None, x: Array, y: Array, z: Array) -> Array:
        """1/z [1/m], in the shape of z; as in `KirchhoffKernel.spreading`."""
        del u, v, cosine, x, y  # one signature for all kernels
        return np.asarray(1 / z)


Kernel = KirchhoffKernel | FresnelKernel
"""Law of the path and the amplitude between a node (u, v) of an aperture and a target."""

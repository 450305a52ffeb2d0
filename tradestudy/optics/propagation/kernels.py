"""Laws of propagation from an aperture to a target: Kirchhoff's integral with its variants, and Fresnel's."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arguments import check_wavelength, checked
from tradestudy.optics.arrays import ComplexArray, FloatArray, phasor_sum
from tradestudy.optics.propagation.lens import Obliquity, check_obliquity
from tradestudy.optics.propagation.paths import Array
from tradestudy.optics.quadrature import QuadratureNodes


@checked
@dataclass(frozen=True, kw_only=True)
class KirchhoffKernel:
    """Kirchhoff's integral with exact paths: U(P) = ∬ U(q) C exp(i k s)/(iλ s) dq, where s = |P − q|.

    U is the field at the points q of an aperture and at the target P, which lies at the distance z behind the plane of
    the aperture; λ is the wavelength, k = 2π/λ, and C one of three obliquity factors:

    * ``paper``: z/s, the cosine of the angle between the axis and the path, as in eqs. 9–16 of the paper under
      References. The paper calls the integral Kirchhoff's; in the literature it is the far-zone form of the first
      Rayleigh–Sommerfeld integral.
    * ``textbook``: (c + z/s)/2, the Fresnel–Kirchhoff obliquity, where c is the cosine of the angle between the axis
      and the direction of the wave at q, directly behind the lens. For this factor and a spherical wave, the method
      ``boundary_wave`` is exact, apart from terms of the order of the wavelength divided by the distances; for other
      factors and waves, it is an approximation.
    * ``rayleigh-sommerfeld-1``: z/s (1 + i/(k s)), which is exact if the field in the aperture is known exactly.

    The differences are small. In the image plane of an f/3.8 microlens, the intensity with ``textbook`` deviates by
    1e-5 from that with ``paper``, and the intensity with ``rayleigh-sommerfeld-1`` by 1e-7 (relative L2 difference). At
    1.25 times the image distance, the differences are 5e-4 and 2e-7. The phases with ``rayleigh-sommerfeld-1`` and
    ``paper`` differ by 1/(k s), which is 2e-4 rad for this microlens.

    Parameters
    ----------
    wavelength
        Wavelength λ [m].
    obliquity
        Obliquity factor C: ``paper``, ``textbook`` or ``rayleigh-sommerfeld-1``.

    Raises
    ------
    OutOfRangeError
        The wavelength is not positive and finite, or the obliquity is unknown.

    References
    ----------
    "Diffraction model of a plenoptic camera for in-situ space exploration", eqs. 9–16; M. Born and E. Wolf,
    "Principles of Optics", section 8.3.2; J. W. Goodman, "Introduction to Fourier Optics", sections 3.4–3.5.

    Examples
    --------
    >>> from tradestudy import optics
    >>> kernel = optics.KirchhoffKernel(wavelength=550e-9, obliquity="textbook")
    >>> node, target = (1e-3, 0.0), (0.0, 0.0, 0.1)
    >>> change, spreading = kernel.path_and_spreading(*node, 1.0, *target)
    >>> print(spreading == kernel.spreading(*node, 1.0, *target))
    True
    >>> print(f"path {kernel.path(*target)} m from the centre, {change * 1e6:.5f} µm longer from the node")
    path 0.1 m from the centre, 4.99988 µm longer from the node
    >>> print(f"spreading {spreading:.5f} 1/m, wavenumber {kernel.wavenumber:.4g} rad/m")
    spreading 9.99925 1/m, wavenumber 1.142e+07 rad/m
    >>> print(f"magnitude of the amplitude {abs(kernel.amplitude(*node, 1.0, *target)):.4e} 1/m²")
    magnitude of the amplitude 1.8180e+07 1/m²
    >>> print(f"slope along x {kernel.slope_at_target(*node, *target)[0]:.7f}")
    slope along x -0.0099995
    >>> beyond, _ = kernel.beyond_linear(*node, 1.0, target, 1e-5, 0.0, 0.0)
    >>> print(f"nonlinear change {beyond * 1e9:.4f} nm when the target moves by 10 µm")
    nonlinear change 0.4999 nm when the target moves by 10 µm
    """

    wavelength: float
    obliquity: Obliquity

    def __post_init__(self) -> None:
        check_wavelength(self.wavelength)
        check_obliquity(self.obliquity)

    @property
    def wavenumber(self) -> float:
        """Wavenumber k = 2π/λ [rad/m]."""
        return 2 * math.pi / self.wavelength

    def path(self, x: Array, y: Array, z: Array) -> Array:
        """Length of the path from the centre of the aperture to a target.

        Parameters
        ----------
        x, y, z
            Coordinates of the targets relative to the centre of the aperture [m]; all arrays are broadcast together.

        Returns
        -------
        ndarray
            √(x² + y² + z²) [m].
        """
        return np.asarray(np.sqrt(x * x + y * y + z * z))

    def slope_at_target(
        self, u: Array, v: Array, x: Array | float, y: Array | float, z: Array | float
    ) -> tuple[Array, Array, Array]:
        """Gradient of the path s from a node to a target, with respect to the position of the target.

        Parameters
        ----------
        u, v
            Coordinates of the nodes relative to the centre of the aperture [m].
        x, y, z
            Coordinates of the targets relative to the centre of the aperture [m]; all arrays are broadcast together.

        Returns
        -------
        tuple
            ∂s/∂x, ∂s/∂y and ∂s/∂z [1], which are the direction cosines from the node to the target.
        """
        a, b = x - u, y - v
        s = np.sqrt(a * a + b * b + z * z)
        return a / s, b / s, z / s

    def path_and_spreading(
        self, u: Array, v: Array, cosine: Array | None, x: Array, y: Array, z: Array
    ) -> tuple[Array, Array]:
        """Path from a node to a target minus that from the aperture's centre, and the ratio C/s.

        The difference of the paths is computed without cancellation.

        Parameters
        ----------
        u, v
            Coordinates of the nodes relative to the centre of the aperture [m].
        cosine
            Cosine of the angle between the axis and the direction of the wave at each node [1]. Only the obliquity
            ``textbook`` needs it.
        x, y, z
            Coordinates of the targets relative to the centre of the aperture [m]; all arrays are broadcast together.

        Returns
        -------
        tuple
            Difference of the paths [m], and C/s [1/m].
        """
        squared = x * x + y * y + z * z
        # s² − s₀² multiplied out; divided by s + s₀, it becomes s − s₀.
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
        """Change of the path when the target moves, without its terms linear in dx and dy, and the new `spreading`.

        The target moves from `base` by d = (dx, dy, dz), so that its path from the node changes from s to t. With the
        unit vector e from the node to `base`, the returned change is t − s − e_x dx − e_y dy; the term linear in dz is
        kept. It is computed without cancellation, as (|d|² − (e·d)(t − s))/(s + t) + e_z dz.

        Parameters
        ----------
        u, v
            Coordinates of the nodes relative to the centre of the aperture [m].
        cosine
            Cosine of the angle between the axis and the direction of the wave at each node [1]. Only the obliquity
            ``textbook`` needs it.
        base
            Position (x, y, z) of the target before it moves, relative to the centre of the aperture [m].
        dx, dy, dz
            Displacement d of the target from `base` [m]; all arrays are broadcast together.

        Returns
        -------
        tuple
            Change of the path without these two terms [m], and C/t [1/m].
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
        """Factor by which the field at a node and exp(i k s) are multiplied in the integral: C/(iλ s).

        Parameters
        ----------
        u, v
            Coordinates of the nodes relative to the centre of the aperture [m].
        cosine
            Cosine of the angle between the axis and the direction of the wave at each node [1]. Only the obliquity
            ``textbook`` needs it.
        x, y, z
            Coordinates of the targets relative to the centre of the aperture [m]; all arrays are broadcast together.

        Returns
        -------
        ndarray
            C/(iλ s) [1/m²].
        """
        return np.asarray(-1j / self.wavelength * self.spreading(u, v, cosine, x, y, z))

    def spreading(self, u: Array, v: Array, cosine: Array | None, x: Array, y: Array, z: Array) -> Array:
        """Ratio C/s of the obliquity factor to the path from a node to a target.

        Parameters
        ----------
        u, v
            Coordinates of the nodes relative to the centre of the aperture [m].
        cosine
            Cosine of the angle between the axis and the direction of the wave at each node [1]. Only the obliquity
            ``textbook`` needs it.
        x, y, z
            Coordinates of the targets relative to the centre of the aperture [m]; all arrays are broadcast together.

        Returns
        -------
        ndarray
            C/s [1/m]; complex for ``rayleigh-sommerfeld-1``, real otherwise.
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


@checked
@dataclass(frozen=True, kw_only=True)
class FresnelKernel:
    """Fresnel's integral: U(P) = exp(i k z)/(iλ z) ∬ U(q) exp(i k ρ²/(2 z)) dq.

    U is the field at the points q of an aperture and at the target P, which lies at the distance z behind the plane of
    the aperture; ρ is the transverse distance between P and q, λ the wavelength, and k = 2π/λ. It has the methods of
    `KirchhoffKernel`, with the path s = z + ρ²/(2 z) and with C/s replaced by 1/z.

    Parameters
    ----------
    wavelength
        Wavelength λ [m].

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
    >>> print(f"path {kernel.path(*target)} m from the centre, {change * 1e6:.5f} µm longer from the node")
    path 0.1 m from the centre, 5.00000 µm longer from the node
    >>> print(f"spreading {spreading:.5f} 1/m, wavenumber {kernel.wavenumber:.4g} rad/m")
    spreading 10.00000 1/m, wavenumber 1.142e+07 rad/m
    >>> print(f"magnitude of the amplitude {abs(kernel.amplitude(*node, None, *target)):.4e} 1/m²")
    magnitude of the amplitude 1.8182e+07 1/m²
    >>> print(f"slope along x {kernel.slope_at_target(*node, *target)[0]:.7f}")
    slope along x -0.0100000
    >>> beyond, _ = kernel.beyond_linear(*node, None, target, 1e-5, 0.0, 0.0)
    >>> print(f"nonlinear change {beyond * 1e9:.4f} nm when the target moves by 10 µm")
    nonlinear change 0.5000 nm when the target moves by 10 µm
    """

    wavelength: float

    def __post_init__(self) -> None:
        check_wavelength(self.wavelength)

    @property
    def wavenumber(self) -> float:
        """Wavenumber k = 2π/λ [rad/m]."""
        return 2 * math.pi / self.wavelength

    def path(self, x: Array, y: Array, z: Array) -> Array:
        """Path from the centre of the aperture to a target [m], z + (x² + y²)/(2 z).

        The arguments are as in `KirchhoffKernel.path`.
        """
        return np.asarray(z + (x * x + y * y) / (2 * z))

    def slope_at_target(
        self, u: Array, v: Array, x: Array | float, y: Array | float, z: Array | float
    ) -> tuple[Array, Array, Array]:
        """Gradient of the path s from a node to a target, with respect to the position of the target [1].

        The arguments are as in `KirchhoffKernel.slope_at_target`.
        """
        a, b = x - u, y - v
        return a / z, b / z, 1 - (a * a + b * b) / (2 * z * z)

    def path_and_spreading(
        self, u: Array, v: Array, cosine: Array | None, x: Array, y: Array, z: Array
    ) -> tuple[Array, Array]:
        """Path from a node to a target minus that from the centre of the aperture [m], and 1/z [1/m].

        The arguments are as in `KirchhoffKernel.path_and_spreading`.
        """
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
        """Change of the path when the target moves, without its terms linear in dx and dy [m], and the new 1/z [1/m].

        The arguments are as in `KirchhoffKernel.beyond_linear`.
        """
        a, b, c = base[0] - u, base[1] - v, base[2]
        squared = (a + dx) ** 2 + (b + dy) ** 2
        rest = dz + (dx * dx + dy * dy) / (2 * c) - squared * (dz / (2 * c * (c + dz)))
        return np.asarray(rest), self.spreading(u, v, cosine, base[0] + dx, base[1] + dy, c + dz)

    def amplitude(self, u: Array, v: Array, cosine: Array | None, x: Array, y: Array, z: Array) -> Array:
        """Factor by which the field at a node and exp(i k s) are multiplied in the integral: 1/(iλ z) [1/m²].

        The arguments are as in `KirchhoffKernel.amplitude`.
        """
        return np.asarray(-1j / self.wavelength * self.spreading(u, v, cosine, x, y, z))

    def spreading(self, u: Array, v: Array, cosine: Array | None, x: Array, y: Array, z: Array) -> Array:
        """Inverse distance 1/z [1/m], in the shape of z.

        The arguments are as in `KirchhoffKernel.spreading`.
        """
        del u, v, cosine, x, y  # one signature for all kernels
        return np.asarray(1 / z)


Kernel = KirchhoffKernel | FresnelKernel
"""Law of the path and the amplitude between a node (u, v) of an aperture and a target."""


_PAIRS_AT_ONCE = 16_000  # node–target pairs per block: a few blocks of this size stay in the cache


@checked
@dataclass(frozen=True, kw_only=True)
class ApertureSamples:
    """A wave sampled on the quadrature nodes of an aperture.

    Parameters
    ----------
    nodes
        The n quadrature nodes: their positions and area weights.
    field
        Complex field at the nodes, directly behind the aperture [any unit], shape (n,). The field that is propagated
        from these samples has the same unit.
    axial_cosine
        Cosine of the angle between the axis and the direction of the wave at each node [1], shape (n,). Only the
        obliquity ``textbook`` of `KirchhoffKernel` needs it.

    Raises
    ------
    OutOfRangeError
        The shape of an array differs from (n,), or a value is not finite.

    Examples
    --------
    A plane wave on a disc with a diameter of 1 mm:

    >>> import numpy as np
    >>> from tradestudy import optics
    >>> nodes = optics.disc_nodes(radius=0.5e-3, radial_count=20, angular_count=40)
    >>> samples = optics.ApertureSamples(nodes=nodes, field=np.ones(nodes.count, dtype=complex))
    >>> x, y, strength = samples.local()
    >>> print(f"{samples.field.size} nodes, ∫ U dA = {strength.sum().real * 1e6:.4f} mm²")
    800 nodes, ∫ U dA = 0.7854 mm²
    """

    nodes: QuadratureNodes
    field: ComplexArray
    axial_cosine: FloatArray | None = None

    def __post_init__(self) -> None:
        arrays = (self.field,) if self.axial_cosine is None else (self.field, self.axial_cosine)
        for array in arrays:
            if array.shape != self.nodes.x.shape:
                raise OutOfRangeError(
                    "samples on an aperture",
                    value=f"shape {array.shape}",
                    limit=f"shape {self.nodes.x.shape}",
                    remedy="give one value for each node",
                )
            if not np.isfinite(array).all():
                raise OutOfRangeError(
                    "samples on an aperture", value="not finite", limit="finite", remedy="give a number for each node"
                )

    def local(self) -> tuple[FloatArray, FloatArray, ComplexArray]:
        """Node positions relative to the centre of the aperture, and field times area weight.

        Returns
        -------
        tuple
            x [m], y [m], and the product of field and area weight [m² times the unit of the field], each of shape (n,).
        """
        x, y = self.nodes.x - self.nodes.centre[0], self.nodes.y - self.nodes.centre[1]
        return x, y, np.asarray(self.field * self.nodes.weights, dtype=np.complex128)


def check_cosine(samples: ApertureSamples, kernel: Kernel) -> None:
    """Refuse the textbook obliquity where the direction of the arriving wave is not given."""
    needs = isinstance(kernel, KirchhoffKernel) and kernel.obliquity == "textbook"
    if needs and samples.axial_cosine is None:
        raise OutOfRangeError(
            "textbook obliquity needs the direction of the arriving wave",
            value="axial_cosine = None",
            limit="one cosine per node",
            remedy="give axial_cosine, or choose obliquity 'paper' or 'rayleigh-sommerfeld-1'",
        )


def direct_sum(samples: ApertureSamples, kernel: Kernel, x: FloatArray, y: FloatArray, z: FloatArray) -> ComplexArray:
    """Sum the field of every node at every target: U(P) = Σ w U(q) K(q, P).

    Parameters
    ----------
    samples
        Field on the aperture.
    kernel
        `KirchhoffKernel` or `FresnelKernel`.
    x, y, z
        Flat target coordinates [m], shape (m,).

    Returns
    -------
    ndarray
        Complex field, shape (m,). Rounding error about 1e-13 of the largest field that the nodes would give in phase.

    Raises
    ------
    OutOfRangeError
        The kernel needs directions that `samples` does not have.
    """
    check_cosine(samples, kernel)
    u, v, strength = samples.local()
    x, y = x - samples.nodes.centre[0], y - samples.nodes.centre[1]
    rows = max(1, _PAIRS_AT_ONCE // u.size)
    columns = min(u.size, _PAIRS_AT_ONCE)
    field = np.zeros(x.size, dtype=np.complex128)
    for i in range(0, x.size, rows):
        block = slice(i, i + rows)
        for j in range(0, u.size, columns):
            part = slice(j, j + columns)
            cosine = None if samples.axial_cosine is None else samples.axial_cosine[part]
            path, spreading = kernel.path_and_spreading(
                u[part], v[part], cosine, x[block, None], y[block, None], z[block, None]
            )
            path *= kernel.wavenumber
            field[block] += phasor_sum(path, spreading, strength[part])
    return field * (-1j / kernel.wavelength * np.exp(1j * kernel.wavenumber * kernel.path(x, y, z)))

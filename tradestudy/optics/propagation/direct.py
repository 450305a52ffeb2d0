"""Light on an aperture as samples, and its field on targets by direct summation: the reference for the fast path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.argument_types import checked_fields
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.phasors import ComplexArray, phasor_sum
from tradestudy.optics.propagation.kernels import Kernel, KirchhoffKernel
from tradestudy.optics.quadrature import QuadratureNodes

_PAIRS_AT_ONCE = 16_000  # node–target pairs per block: a few blocks of this size stay in the cache


@checked_fields
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
        given = (self.field,) if self.axial_cosine is None else (self.field, self.axial_cosine)
        for array in given:
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
        at = slice(i, i + rows)
        for j in range(0, u.size, columns):
            part = slice(j, j + columns)
            cosine = None if samples.axial_cosine is None else samples.axial_cosine[part]
            path, spreading = kernel.path_and_spreading(u[part], v[part], cosine, x[at, None], y[at, None], z[at, None])
            path *= kernel.wavenumber
            field[at] += phasor_sum(path, spreading, strength[part])
    return field * (-1j / kernel.wavelength * np.exp(1j * kernel.wavenumber * kernel.path(x, y, z)))

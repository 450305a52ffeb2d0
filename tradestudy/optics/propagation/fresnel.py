"""The Fresnel integral: paths to second order, unit cosines."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tradestudy.optics.propagation.paths import Array


@dataclass(frozen=True, kw_only=True)
class FresnelKernel:
    """U(P) = exp(i k z)/(iλ z) ∬ U(q) exp(i k |P − q|²/(2 z)) dq.

    Parameters
    ----------
    wavelength
        Wavelength [m].

    References
    ----------
    "Diffraction model of a plenoptic camera for in-situ space exploration", eqs. 17–22.
    """

    wavelength: float

    @property
    def wavenumber(self) -> float:
        """2π/λ [rad/m]."""
        return 2 * math.pi / self.wavelength

    def path(self, x: Array, y: Array, z: Array) -> Array:
        """Path from the centre of the aperture to a target [m]."""
        return np.asarray(z + (x * x + y * y) / (2 * z))

    def path_from_node(self, u: Array, v: Array, x: Array, y: Array, z: Array) -> Array:
        """Path from a node less the path from the centre [m]."""
        return np.asarray((u * (u - 2 * x) + v * (v - 2 * y)) / (2 * z))

    def slope_at_target(self, u: Array, v: Array, x: float, y: float, z: float) -> tuple[Array, Array, Array]:
        """Gradient of the path with respect to the target."""
        a, b = x - u, y - v
        return a / z, b / z, 1 - (a * a + b * b) / (2 * z * z)

    def path_beyond_linear(
        self, u: Array, v: Array, base: tuple[float, float, float], dx: Array, dy: Array, dz: Array
    ) -> Array:
        """Change of the path from `base` to `base` + d beyond its transverse linear part [m]."""
        a, b, c = base[0] - u, base[1] - v, base[2]
        squared = (a + dx) ** 2 + (b + dy) ** 2
        return np.asarray(dz + (dx * dx + dy * dy) / (2 * c) - squared * dz / (2 * c * (c + dz)))

    def amplitude(self, u: Array, v: Array, cosine: Array | None, x: Array, y: Array, z: Array) -> Array:
        """Everything but the phase: 1/(iλ z) [1/m²]; the distance alone enters."""
        del cosine  # one signature for all kernels
        shape = np.broadcast_shapes(np.shape(u), np.shape(v), np.shape(x), np.shape(y), np.shape(z))
        return np.broadcast_to(-1j / (self.wavelength * z), shape)

"""The double sphere model of fisheye lenses, with a closed inverse."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.lens_models.lens_model import Coefficient, LensModel


@dataclass(frozen=True, kw_only=True)
class DoubleSphere(LensModel):
    """``u = x/(α d₂ + (1 − α) w)`` with d₁ = |(x, y, z)|, ``w = ξ d₁ + z`` and ``d₂ = √(x² + y² + w²)``; v likewise.

    Parameters
    ----------
    xi
        How far the centre of the second sphere lies behind that of the first: ξ [1], in radii; above −1 and at most
        1. If it is negative, the second sphere lies in front of the first.
    alpha
        Parameter α [1], from 0 to 1: the pinhole lies α/(1 − α) radii behind the centre of the second sphere.

    Notes
    -----
    V. Usenko, N. Demmel, D. Cremers, "The double sphere camera model", 3DV 2018, equations 40 to 52.
    """

    name: ClassVar[str] = "double-sphere"

    xi: Coefficient
    alpha: Coefficient

    def __post_init__(self) -> None:
        self._require("xi", above=-1.0, high=1.0)
        self._require("alpha", low=0.0, high=1.0)

    @property
    def widest(self) -> FloatArray:
        """Angle at which the law of the two spheres ends [rad]: ``z > −w₂ d₁``."""
        xi, alpha = np.broadcast_arrays(np.asarray(self.xi, dtype=np.float64), np.asarray(self.alpha))
        w1 = np.minimum(alpha, 1.0 - alpha) / np.maximum(alpha, 1.0 - alpha)
        return np.asarray(np.arccos(-np.clip((w1 + xi) / np.sqrt(2.0 * w1 * xi + xi * xi + 1.0), -1.0, 1.0)))

    def image(self, x: ArrayLike, y: ArrayLike, z: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """See `LensModel.image`; NaN for directions behind the plane of the pinhole."""
        x, y, z, alpha = np.asarray(x), np.asarray(y), np.asarray(z), np.asarray(self.alpha)
        square = x * x + y * y
        w = self.xi * np.sqrt(square + z * z) + z
        below = alpha * np.sqrt(square + w * w) + (1.0 - alpha) * w
        below = np.where(np.real(below) > 0.0, below, np.nan)
        return x / below, y / below

    def ray(self, u: ArrayLike, v: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """See `LensModel.ray`; in closed form, as unit vectors."""
        u, v = np.asarray(u, dtype=np.float64), np.asarray(v, dtype=np.float64)
        xi, alpha = np.asarray(self.xi), np.asarray(self.alpha)
        square = u * u + v * v
        with np.errstate(all="ignore"):  # positions without an inverse become NaN
            root = np.sqrt(1.0 - (2.0 * alpha - 1.0) * square)
            m = (1.0 - alpha * alpha * square) / (alpha * root + 1.0 - alpha)
            reach = (m * xi + np.sqrt(m * m + (1.0 - xi * xi) * square)) / (m * m + square)
            x, y, z = reach * u, reach * v, reach * m - xi
        found = self._inside(x, y, z)
        return np.where(found, x, np.nan), np.where(found, y, np.nan), np.where(found, z, np.nan)

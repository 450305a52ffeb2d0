"""The extended unified model of fisheye lenses: an ellipsoid instead of the sphere, with a closed inverse."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.lens_models.lens_model import Coefficient, LensModel


@dataclass(frozen=True, kw_only=True)
class ExtendedUnified(LensModel):
    """``u = x/(α d + (1 − α) z)`` with ``d = √(β (x² + y²) + z²)``; v likewise.

    Parameters
    ----------
    alpha
        Parameter α [1], from 0 to 1: the pinhole lies α/(1 − α) axial semi-axes behind the ellipsoid's centre.
    beta
        Squared ratio β [1] of the axial to the lateral semi-axis of the ellipsoid, above 0; 1 makes it a sphere.

    Notes
    -----
    B. Khomutenko, G. Garcia, P. Martinet, "An enhanced unified camera model", IEEE Robotics and Automation Letters 1
    (2016) 137.
    """

    name: ClassVar[str] = "eucm"

    alpha: Coefficient
    beta: Coefficient

    def __post_init__(self) -> None:
        self._require("alpha", low=0.0, high=1.0)
        self._require("beta", above=0.0)

    @property
    def widest(self) -> FloatArray:
        """Angle at which the law ends [rad]: ``z > −w d`` with ``w = min(α, 1 − α)/max(α, 1 − α)``."""
        alpha, beta = np.broadcast_arrays(np.asarray(self.alpha, dtype=np.float64), np.asarray(self.beta))
        w = np.minimum(alpha, 1.0 - alpha) / np.maximum(alpha, 1.0 - alpha)
        return np.asarray(np.arctan2(np.sqrt(np.maximum(1.0 - w * w, 0.0)), -w * np.sqrt(beta)))

    def image(self, x: ArrayLike, y: ArrayLike, z: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """See `LensModel.image`; NaN for directions behind the plane of the pinhole."""
        x, y, z, alpha = np.asarray(x), np.asarray(y), np.asarray(z), np.asarray(self.alpha)
        below = alpha * np.sqrt(self.beta * (x * x + y * y) + z * z) + (1.0 - alpha) * z
        below = np.where(np.real(below) > 0.0, below, np.nan)
        return x / below, y / below

    def ray(self, u: ArrayLike, v: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """See `LensModel.ray`; in closed form."""
        u, v = np.asarray(u, dtype=np.float64), np.asarray(v, dtype=np.float64)
        alpha, beta = np.asarray(self.alpha), np.asarray(self.beta)
        square = u * u + v * v
        with np.errstate(all="ignore"):  # positions without an inverse become NaN
            root = np.sqrt(1.0 - (2.0 * alpha - 1.0) * beta * square)
            z = (1.0 - beta * alpha * alpha * square) / (alpha * root + 1.0 - alpha)
        found = np.isfinite(z) & self._inside(u, v, z)
        return np.where(found, u, np.nan), np.where(found, v, np.nan), np.where(found, z, np.nan)

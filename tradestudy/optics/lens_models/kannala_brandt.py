"""The fisheye model whose image radius is an odd polynomial of the angle."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Final

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.lens_models.lens_model import Coefficient, LensModel, angle_from_axis

_NEWTON_STEPS: Final = 30
_SETTLED: Final = 1e-14  # rad
_TABLE: Final = 512


@dataclass(frozen=True, kw_only=True)
class KannalaBrandt(LensModel):
    """``r = θ (1 + k₁θ² + k₂θ⁴ + k₃θ⁶ + k₄θ⁸)``, where θ is the angle from the axis, up to 180°.

    Parameters
    ----------
    k1
        Coefficient of θ³ [1] in the image radius.
    k2
        Coefficient of θ⁵ [1] in the image radius.
    k3
        Coefficient of θ⁷ [1] in the image radius.
    k4
        Coefficient of θ⁹ [1] in the image radius.

    Notes
    -----
    J. Kannala, S. Brandt, IEEE PAMI 28 (2006) 1335, its radially symmetric part; also OpenCV's fisheye model and
    Kalibr's "equidistant".
    """

    name: ClassVar[str] = "kannala-brandt"

    k1: Coefficient = 0.0
    k2: Coefficient = 0.0
    k3: Coefficient = 0.0
    k4: Coefficient = 0.0

    @property
    def widest(self) -> FloatArray:
        """π [rad]."""
        return np.full(np.broadcast_shapes(*(np.shape(getattr(self, n)) for n in self.coefficient_names())), np.pi)

    def _radius(self, angle: FloatArray) -> tuple[FloatArray, FloatArray]:
        """r and its derivative with respect to the angle."""
        k1, k2, k3, k4 = (np.asarray(getattr(self, f"k{n}")) for n in range(1, 5))
        q = angle * angle
        radius = angle * (1.0 + q * (k1 + q * (k2 + q * (k3 + q * k4))))
        return radius, 1.0 + q * (3.0 * k1 + q * (5.0 * k2 + q * (7.0 * k3 + q * 9.0 * k4)))

    def image(self, x: ArrayLike, y: ArrayLike, z: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """See `LensModel.image`."""
        x, y, z = np.asarray(x), np.asarray(y), np.asarray(z)
        across = np.sqrt(x * x + y * y)
        radius = self._radius(angle_from_axis(across, z))[0]
        axial = across == 0.0
        scale = np.where(axial, 1.0 / np.where(z == 0.0, np.nan, z), radius / np.where(axial, 1.0, across))
        return x * scale, y * scale

    def ray(self, u: ArrayLike, v: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """See `LensModel.ray`; unit vectors, by Newton's method on the angle, which starts from a table."""
        u, v = np.asarray(u, dtype=np.float64), np.asarray(v, dtype=np.float64)
        radius = np.hypot(u, v)
        with np.errstate(all="ignore"):  # positions without an inverse become NaN
            angle = np.interp(radius, *self._table) if self._single else radius
            step = np.zeros(())
            for _ in range(_NEWTON_STEPS):
                reached, slope = self._radius(angle)
                step = (reached - radius) / slope
                angle = angle - step
                if not np.any(np.abs(step) > _SETTLED):
                    break
            found = (np.abs(step) <= 4.0 * _SETTLED) & (slope > 0.0) & (angle >= 0.0) & (angle <= np.pi)
            scale = np.where(radius > 0.0, np.sin(angle) / np.where(radius > 0.0, radius, 1.0), 1.0)
            x, y, z = u * scale, v * scale, np.cos(angle)
        found &= self._inside(x, y, z)
        return np.where(found, x, np.nan), np.where(found, y, np.nan), np.where(found, z, np.nan)

    @cached_property
    def _table(self) -> tuple[FloatArray, FloatArray]:
        """Radii over the valid field, and the angles that belong to them."""
        angle = np.linspace(0.0, float(self.valid_field), _TABLE)
        return self._radius(angle)[0], angle

"""The unified model of omnidirectional cameras: a unit sphere, a second centre, then polynomial distortion."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.lens_models.lens_model import Coefficient, LensModel
from tradestudy.optics.lens_models.rational import Rational


@dataclass(frozen=True, kw_only=True)
class Omnidirectional(LensModel):
    """Slopes ``x/(z + ξ d)`` with d = |(x, y, z)|, then radial and tangential distortion as in `Rational`.

    Parameters
    ----------
    xi
        Distance ξ [1] from the centre of the unit sphere to the second centre of projection; 0 or more.
    k1
        Coefficient of r² [1] in the radial distortion.
    k2
        Coefficient of r⁴ [1] in the radial distortion.
    p1
        Coefficient p₁ of tangential distortion [1], which adds 2p₁xy to x and p₁(r² + 2y²) to y.
    p2
        Coefficient p₂ of tangential distortion [1], which adds p₂(r² + 2x²) to x and 2p₂xy to y.

    Notes
    -----
    C. Mei, P. Rives, "Single view point omnidirectional camera calibration from planar grids", ICRA 2007. One-to-one up
    to ``cos θ = −min(ξ, 1/ξ)`` at most.
    """

    name: ClassVar[str] = "omni"

    xi: Coefficient
    k1: Coefficient = 0.0
    k2: Coefficient = 0.0
    p1: Coefficient = 0.0
    p2: Coefficient = 0.0

    def __post_init__(self) -> None:
        self._require("xi", low=0.0)

    @property
    def widest(self) -> FloatArray:
        """Angle at which rays through the second centre touch the sphere or become parallel to the picture [rad]."""
        xi = np.asarray(self.xi) + sum(0.0 * np.asarray(getattr(self, name)) for name in ("k1", "k2", "p1", "p2"))
        return np.asarray(np.arccos(-np.minimum(xi, 1.0 / np.where(xi > 0.0, xi, np.inf) + (xi == 0.0))))

    @property
    def symmetric(self) -> bool:
        """Whether there is no tangential distortion."""
        return self._distortion.symmetric

    @cached_property
    def _distortion(self) -> Rational:
        return Rational(k1=self.k1, k2=self.k2, p1=self.p1, p2=self.p2)

    def image(self, x: ArrayLike, y: ArrayLike, z: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """See `LensModel.image`; NaN for directions behind the plane of the second centre."""
        x, y, z, xi = np.asarray(x), np.asarray(y), np.asarray(z), np.asarray(self.xi)
        square = x * x + y * y
        reach = xi * np.sqrt(square + z * z)
        # Behind the centre of the sphere the sum cancels; the difference of the squares then loses fewer digits.
        behind = (np.real(z) < 0.0) & (np.real(xi) > 0.0)
        apart = np.where(behind, reach - z, 1.0)
        along = np.where(behind, (xi * xi * square - (1.0 - xi * xi) * z * z) / apart, z + reach)
        return self._distortion.image(x, y, along)

    def ray(self, u: ArrayLike, v: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """See `LensModel.ray`; distortion by Newton's method, the sphere in closed form, as unit vectors."""
        a, b, _ = self._distortion.ray(u, v)
        xi, square = np.asarray(self.xi), a * a + b * b
        with np.errstate(invalid="ignore"):
            reach = (xi + np.sqrt(1.0 + (1.0 - xi * xi) * square)) / (1.0 + square)
        x, y, z = reach * a, reach * b, reach - xi
        found = self._inside(x, y, z)
        return np.where(found, x, np.nan), np.where(found, y, np.nan), np.where(found, z, np.nan)

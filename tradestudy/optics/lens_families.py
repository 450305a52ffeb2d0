"""Lens models of fisheye, wide-angle and omnidirectional cameras; all families by the names that studies use."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Final

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.lens_model import Coefficient, LensModel, Rational, angle_from_axis, slopes


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
        return self._kept(x, y, z)


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
        return self._kept(u, v, z, np.isfinite(z))


@dataclass(frozen=True, kw_only=True)
class FieldOfView(LensModel):
    """``r = atan(2 r_u tan(w/2))/w``, where r_u is the tangent of the angle from the axis, up to 90°.

    Parameters
    ----------
    w
        Coefficient w [rad], above 0° and below 180°: the larger w is, the stronger the distortion. The coefficient need
        not equal the field of view of the lens.

    Notes
    -----
    F. Devernay, O. Faugeras, "Straight lines have to be straight", Machine Vision and Applications 13 (2001) 14.
    """

    name: ClassVar[str] = "fov"

    w: Coefficient

    def __post_init__(self) -> None:
        self._require("w", above=0.0, high=np.nextafter(np.pi, 0.0))

    @property
    def widest(self) -> FloatArray:
        """π/2 [rad]."""
        return np.full(np.shape(self.w), np.pi / 2.0)

    def image(self, x: ArrayLike, y: ArrayLike, z: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """See `LensModel.image`; NaN for points beside or behind the camera."""
        a, b = slopes(x, y, z)
        slope = np.sqrt(a * a + b * b)
        w = np.asarray(self.w)
        twice = 2.0 * np.tan(w / 2.0)
        axial = slope == 0.0
        scale = np.where(axial, twice / w, np.arctan(twice * slope) / (w * np.where(axial, 1.0, slope)))
        return a * scale, b * scale

    def ray(self, u: ArrayLike, v: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """See `LensModel.ray`; ``r_u = tan(w r)/(2 tan(w/2))``, as unit vectors."""
        u, v = np.asarray(u, dtype=np.float64), np.asarray(v, dtype=np.float64)
        w = np.asarray(self.w)
        radius = np.hypot(u, v)
        turned = w * radius
        # Sine and cosine instead of the tangent, so that no digits are lost near 90°.
        across, z = np.sin(turned), 2.0 * np.tan(w / 2.0) * np.cos(turned)
        scale = np.where(radius > 0.0, across / np.where(radius > 0.0, radius, 1.0), w)
        x, y = u * scale, v * scale
        return self._kept(x, y, z, turned < np.pi / 2.0)


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
            valid = (np.abs(step) <= 4.0 * _SETTLED) & (slope > 0.0) & (angle >= 0.0) & (angle <= np.pi)
            scale = np.where(radius > 0.0, np.sin(angle) / np.where(radius > 0.0, radius, 1.0), 1.0)
            x, y, z = u * scale, v * scale, np.cos(angle)
        return self._kept(x, y, z, valid)

    @cached_property
    def _table(self) -> tuple[FloatArray, FloatArray]:
        """Radii over the valid field, and the angles that belong to them."""
        angle = np.linspace(0.0, float(self.valid_field), _TABLE)
        return self._radius(angle)[0], angle


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
        return self._kept(x, y, z)


FAMILIES: Final[Mapping[str, type[LensModel]]] = {
    family.name: family
    for family in (Rational, KannalaBrandt, FieldOfView, Omnidirectional, DoubleSphere, ExtendedUnified)
}
ANGLES: Final = ("tau_x", "tau_y", "w")
"""Coefficients in rad; the others are numbers."""
STARTS: Final[Mapping[str, Mapping[str, float]]] = {
    FieldOfView.name: {"w": 0.9},
    Omnidirectional.name: {"xi": 1.0},
    DoubleSphere.name: {"xi": 0.0, "alpha": 0.5},
    ExtendedUnified.name: {"alpha": 0.5, "beta": 1.0},
}
"""Coefficients that fits start from, in the middle of what lenses have; those of the other families are zero."""

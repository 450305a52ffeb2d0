"""The rational model of slopes, with tangential distortion, thin prism and tilted sensor."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Final

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.optics.lens_models.lens_model import Coefficient, LensModel, slopes

_NEWTON_STEPS: Final = 30
_SETTLED: Final = 1e-12
_ROUNDING: Final = 1e-15  # of both sides of the equation; where its slope is small, so many digits are lost
_LARGEST_SCALE: Final = 4.0  # beyond, a Newton step for a draw has left the field of the lens
_TABLE: Final = 512
_WIDE: Final = 1.5  # rad; beyond, slopes grow so fast that their logarithms are tabulated


@dataclass(frozen=True, kw_only=True)
class Rational(LensModel):
    """``g = (1 + k₁r² + k₂r⁴ + k₃r⁶)/(1 + k₄r² + k₅r⁴ + k₆r⁶)``, x = X/Z, y = Y/Z, r² = x² + y².

    ``x' = x g + 2p₁xy + p₂(r² + 2x²) + s₁r² + s₂r⁴``, ``y' = y g + p₁(r² + 2y²) + 2p₂xy + s₃r² + s₄r⁴``; a sensor
    tilted by τ_x, then τ_y, then sees ``(u, v, 1) ∝ [[R₃₃, 0, −R₁₃], [0, R₃₃, −R₂₃], [0, 0, 1]] R (x', y', 1)``.

    Parameters
    ----------
    k1
        Coefficient of r² [1] in the numerator of the radial distortion.
    k2
        Coefficient of r⁴ [1] in the numerator of the radial distortion.
    k3
        Coefficient of r⁶ [1] in the numerator of the radial distortion.
    k4
        Coefficient of r² [1] in the denominator of the radial distortion.
    k5
        Coefficient of r⁴ [1] in the denominator of the radial distortion.
    k6
        Coefficient of r⁶ [1] in the denominator of the radial distortion.
    p1
        Coefficient p₁ of tangential distortion [1], which adds 2p₁xy to x and p₁(r² + 2y²) to y.
    p2
        Coefficient p₂ of tangential distortion [1], which adds p₂(r² + 2x²) to x and 2p₂xy to y.
    s1
        Coefficient s₁ of thin-prism distortion [1], which adds s₁r² to x.
    s2
        Coefficient s₂ of thin-prism distortion [1], which adds s₂r⁴ to x.
    s3
        Coefficient s₃ of thin-prism distortion [1], which adds s₃r² to y.
    s4
        Coefficient s₄ of thin-prism distortion [1], which adds s₄r⁴ to y.
    tau_x
        Tilt of the sensor about its x axis [rad].
    tau_y
        Tilt of the sensor about its y axis [rad].

    Notes
    -----
    Radial and tangential: D. C. Brown, "Close-range camera calibration", Photogrammetric Engineering 37 (1971) 855.
    Thin prism: J. Weng et al., IEEE PAMI 14 (1992) 965. Rational: D. Claus, A. Fitzgibbon, CVPR 2005; coefficients and
    tilt in the order of OpenCV. Fields below 90° from the axis.
    """

    name: ClassVar[str] = "rational"

    k1: Coefficient = 0.0
    k2: Coefficient = 0.0
    p1: Coefficient = 0.0
    p2: Coefficient = 0.0
    k3: Coefficient = 0.0
    k4: Coefficient = 0.0
    k5: Coefficient = 0.0
    k6: Coefficient = 0.0
    s1: Coefficient = 0.0
    s2: Coefficient = 0.0
    s3: Coefficient = 0.0
    s4: Coefficient = 0.0
    tau_x: Coefficient = 0.0
    tau_y: Coefficient = 0.0

    def __post_init__(self) -> None:
        for name in ("tau_x", "tau_y"):
            self._require(name, above=-np.pi / 2.0, high=np.pi / 2.0)

    @property
    def widest(self) -> FloatArray:
        """π/2 [rad]."""
        return np.full(np.broadcast_shapes(*(np.shape(getattr(self, n)) for n in self.coefficient_names())), np.pi / 2)

    @cached_property
    def symmetric(self) -> bool:
        """Whether there is neither tangential distortion, nor thin prism, nor tilt."""
        return not (self._oblique or self._tilted)

    @cached_property
    def _oblique(self) -> bool:
        return self._has("p1", "p2", "s1", "s2", "s3", "s4")

    @cached_property
    def _tilted(self) -> bool:
        return self._has("tau_x", "tau_y")

    @cached_property
    def _undistorting(self) -> bool:
        return self.symmetric and self._polynomial and not self._has("k1", "k2")

    @cached_property
    def _polynomial(self) -> bool:
        """Whether k₃ to k₆ are zero."""
        return not self._has("k3", "k4", "k5", "k6")

    def _has(self, *names: str) -> bool:
        """Whether one of these coefficients is not zero."""
        values = [getattr(self, name) for name in names]
        # Computations build many models, and numpy is slow at plain numbers.
        return any(value != 0.0 if isinstance(value, float) else np.any(value) for value in values)

    def image(self, x: ArrayLike, y: ArrayLike, z: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """See `LensModel.image`; NaN for points beside or behind the camera."""
        a, b = slopes(x, y, z)
        if self._undistorting:
            return a, b
        u, v = self._distorted(a, b)
        return self._on_tilted(u, v) if self._tilted else (u, v)

    def sees(self, x: FloatArray, y: FloatArray, z: FloatArray) -> BoolArray:
        """See `LensModel.sees`; compares slopes rather than angles."""
        end = np.asarray(self.valid_field)
        whole = end >= np.pi / 2.0
        if np.all(whole):
            return np.asarray(z > 0.0)
        return np.asarray((z > 0.0) & (whole | (np.hypot(x, y) <= np.tan(end) * z)))

    def _distorted(self, a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions in the picture before the tilt of the sensor."""
        square = a * a + b * b
        g = self._factor(square)[0]
        u, v = a * g, b * g
        if self._oblique:
            p1, p2 = np.asarray(self.p1), np.asarray(self.p2)
            u = u + 2.0 * p1 * a * b + p2 * (square + 2.0 * a * a) + square * (self.s1 + self.s2 * square)
            v = v + p1 * (square + 2.0 * b * b) + 2.0 * p2 * a * b + square * (self.s3 + self.s4 * square)
        return u, v

    def _factor(self, square: FloatArray) -> tuple[FloatArray, FloatArray]:
        """g and its derivative with respect to r²."""
        k1, k2, k3, k4, k5, k6 = (np.asarray(getattr(self, f"k{n}")) for n in range(1, 7))
        if self._polynomial:
            return 1.0 + square * (k1 + square * k2), k1 + 2.0 * square * k2
        above = 1.0 + square * (k1 + square * (k2 + square * k3))
        below = 1.0 + square * (k4 + square * (k5 + square * k6))
        g = above / below
        rise = k1 + square * (2.0 * k2 + 3.0 * square * k3)
        return g, (rise - g * (k4 + square * (2.0 * k5 + 3.0 * square * k6))) / below

    def ray(self, u: ArrayLike, v: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """See `LensModel.ray`; returns (x, y, 1), with the tilt in closed form and the rest by Newton's method."""
        a, b = np.asarray(u, dtype=np.float64), np.asarray(v, dtype=np.float64)
        if self._undistorting:
            return a, b, np.ones(())
        with np.errstate(all="ignore"):  # positions without an inverse become NaN
            if self._tilted:
                a, b = self._before_tilt(a, b)
            scale, found = self._radial_inverse(a, b)
            x, y = a * scale, b * scale
            if self._oblique:
                x, y, found = self._oblique_inverse(x, y, a, b)
            found &= self._inside(x, y, np.ones(()))
        return np.where(found, x, np.nan), np.where(found, y, np.nan), np.ones(())

    def _radial_inverse(self, a: FloatArray, b: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Scale r/r_d of positions before the tilt, by radial distortion alone, and whether it is on the rising branch.

        Solves ``s g(s² r_d²) = 1``, starting from a table for single coefficients, and from 1 for draws.
        """
        square = a * a + b * b
        scale = self._first_scale(square) if self._single else np.ones(())
        found = np.ones((), dtype=bool)
        step, settled = np.zeros(()), np.zeros(())
        for _ in range(_NEWTON_STEPS):
            inner = scale * scale * square
            g, rise = self._factor(inner)
            slope = g + 2.0 * inner * rise
            found = found & (slope > 0.0)
            step = (scale * g - 1.0) / np.where(slope > 0.0, slope, 1.0)
            scale = np.clip(scale - step, 0.0, _LARGEST_SCALE if not self._single else np.inf)
            settled = (_SETTLED + _ROUNDING / np.where(slope > 0.0, slope, np.inf)) * scale
            if not np.any(np.abs(step) > settled):
                break
        return scale, found & (np.abs(step) <= settled)

    def _first_scale(self, square: FloatArray) -> FloatArray:
        """Interpolated scale r/r_d, from which the solution starts."""
        radius, picture = self._table
        distorted = np.sqrt(square)
        return np.where(square > 0.0, np.interp(distorted, picture, radius) / np.where(square > 0.0, distorted, 1.0), 1)

    @cached_property
    def _table(self) -> tuple[FloatArray, FloatArray]:
        """Radii before and after radial distortion alone, over the part of the field where both rise."""
        end = float(replace(self, **dict.fromkeys(_NOT_RADIAL, 0.0)).valid_field)
        radius = np.tan(np.linspace(0.0, min(end, _WIDE), _TABLE))
        if end > _WIDE:
            radius = np.concatenate(
                [radius, np.geomspace(radius[-1], np.tan(min(end, np.pi / 2.0 - 1e-9)), _TABLE)[1:]]
            )
        return radius, radius * self._factor(radius * radius)[0]

    def _oblique_inverse(
        self, x: FloatArray, y: FloatArray, a: FloatArray, b: FloatArray
    ) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Slopes imaged at (a, b) before the tilt, by Newton's method from those of radial distortion alone."""
        p1, p2, s1, s2, s3, s4 = (np.asarray(getattr(self, name)) for name in _OBLIQUE)
        size = np.zeros(())
        for _ in range(_NEWTON_STEPS):
            square = x * x + y * y
            g, rise = self._factor(square)
            seen_a, seen_b = self._distorted(x, y)
            prism_a, prism_b = 2.0 * (s1 + 2.0 * s2 * square), 2.0 * (s3 + 2.0 * s4 * square)
            mixed = 2.0 * (x * y * rise + p1 * x + p2 * y)
            aa = g + 2.0 * x * x * rise + 2.0 * p1 * y + 6.0 * p2 * x + prism_a * x
            bb = g + 2.0 * y * y * rise + 6.0 * p1 * y + 2.0 * p2 * x + prism_b * y
            ab, ba = mixed + prism_a * y, mixed + prism_b * x
            determinant = aa * bb - ab * ba
            off_a, off_b = a - seen_a, b - seen_b
            step_x, step_y = (bb * off_a - ab * off_b) / determinant, (aa * off_b - ba * off_a) / determinant
            x, y = x + step_x, y + step_y
            size = np.hypot(step_x, step_y) / (1.0 + np.hypot(x, y))
            if not np.any(size > _SETTLED):
                break
        return x, y, (size <= _SETTLED) & (determinant > 0.0)

    def _on_tilted(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions on the tilted sensor of positions in the untilted picture."""
        (cx, sx), (cy, sy) = ((np.cos(t), np.sin(t)) for t in (np.asarray(self.tau_x), np.asarray(self.tau_y)))
        # Rows of R = R_y(τ_y) R_x(τ_x).
        first, second = cy * x + sy * sx * y - sy * cx, cx * y + sx
        third = sy * x - cy * sx * y + cy * cx
        r13, r23, r33 = -sy * cx, sx, cy * cx
        ahead = np.where(np.real(third) > 0.0, third, np.nan)
        return (r33 * first - r13 * third) / ahead, (r33 * second - r23 * third) / ahead

    def _before_tilt(self, u: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Inverse of `_on_tilted`: the inverse projective map, then the transposed rotation."""
        (cx, sx), (cy, sy) = ((np.cos(t), np.sin(t)) for t in (np.asarray(self.tau_x), np.asarray(self.tau_y)))
        r13, r23, r33 = -sy * cx, sx, cy * cx
        first, second = (u + r13) / r33, (v + r23) / r33
        depth = -sy * cx * first + sx * second + cy * cx
        return (cy * first + sy) / depth, (sy * sx * first + cx * second - cy * sx) / depth


_OBLIQUE: Final = ("p1", "p2", "s1", "s2", "s3", "s4")
_NOT_RADIAL: Final = (*_OBLIQUE, "tau_x", "tau_y")
IDEAL: Final = Rational()
"""A pinhole."""

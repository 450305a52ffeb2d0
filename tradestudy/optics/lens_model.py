"""Lens models: what all have in common, and the rational model of OpenCV."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import MISSING, dataclass, fields, replace
from functools import cached_property, lru_cache
from typing import ClassVar, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import BoolArray, FloatArray

Coefficient = float | FloatArray
LEAST_SCALE: Final = 0.01
"""Where the picture's radial scale has fallen to this share of that on the axis, the valid field ends: nearer to the
fold the inverse loses digits."""
_ANGLES: Final = 1024  # steps of the search for the end of the field
_AZIMUTHS: Final = 72
_NEARER: Final = 64  # of the search near the azimuth where it ends
_SECTIONS: Final = 128  # of the step in which the field ends, refined as often as rounding allows
_DIRECTIONS: Final = 4608  # at a time
_STEP: Final = 1e-30  # of complex steps: derivatives are exact to rounding
_ROUNDING: Final = 1e-12  # rad


@dataclass(frozen=True, kw_only=True)
class LensModel(ABC):
    """A law that maps directions to positions in the normalised picture.

    Pixel positions from the principal point are these times the focal lengths. Coefficients are dimensionless (angles
    in rad). Each is a number, or an array that broadcasts with the coordinates: draws from a calibration.
    """

    name: ClassVar[str]
    """Name of the family in studies and files."""

    @property
    @abstractmethod
    def widest(self) -> FloatArray:
        """Angle from the axis [rad] beyond which the law is meaningless, whatever its other coefficients are."""

    @property
    def symmetric(self) -> bool:
        """Whether the law is rotationally symmetric."""
        return True

    @abstractmethod
    def image(self, x: ArrayLike, y: ArrayLike, z: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Positions of directions in the normalised picture [1], by the bare law: beyond the valid field it may fold.

        Parameters
        ----------
        x, y, z
            Components of the directions, of any length: right, down, along the axis; broadcast against each other.
        """

    @abstractmethod
    def ray(self, u: ArrayLike, v: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Direction, of any positive length, that is imaged at a position: the inverse of `image`.

        Returns
        -------
        x, y, z
            Components of the directions. NaN for positions outside the picture of the valid field; for array
            coefficients, NaN where no inverse is found on the rising branch.
        """

    @classmethod
    def coefficient_names(cls) -> tuple[str, ...]:
        """Names of the coefficients, in order."""
        return tuple(field.name for field in fields(cls))

    @classmethod
    def optional_names(cls) -> tuple[str, ...]:
        """Names of the coefficients that may be left out; they are then zero."""
        return tuple(field.name for field in fields(cls) if field.default is not MISSING)

    def with_radial_error(self, k1: FloatArray, k2: FloatArray) -> LensModel:
        """Return the same lens with these changes added to its k₁ and k₂.

        Raises
        ------
        OutOfRangeError
            If the family has no such coefficients and the changes are not zero.
        """
        if not (np.any(k1) or np.any(k2)):
            return self
        if not {"k1", "k2"} <= {*self.coefficient_names()}:
            raise OutOfRangeError(
                "errors of radial distortion",
                value=f"a lens of the model {self.name}, which has no k1 and k2",
                remedy="leave them out, or declare the lens by a model that has them",
            )
        changed = {name: np.asarray(getattr(self, name)) + by for name, by in (("k1", k1), ("k2", k2))}
        return replace(self, **changed)

    def coefficients(self) -> dict[str, float]:
        """Coefficients by name; for draws, only those that are single numbers."""
        return {name: float(getattr(self, name)) for name in self.coefficient_names()}

    def project(self, points: FloatArray) -> FloatArray:
        """Positions in the normalised picture [1], shape (..., 2), of points (..., 3) at any distance.

        NaN outside the valid field.
        """
        x, y, z = points[..., 0], points[..., 1], points[..., 2]
        with np.errstate(all="ignore"):  # points outside the domain of the law become NaN
            u, v = self.image(x, y, z)
        visible = self.sees(x, y, z)
        return np.stack(np.broadcast_arrays(np.where(visible, u, np.nan), np.where(visible, v, np.nan)), axis=-1)

    def sees(self, x: FloatArray, y: FloatArray, z: FloatArray) -> BoolArray:
        """Whether directions lie in the valid field."""
        return np.asarray(np.arctan2(np.hypot(x, y), z) <= self.valid_field)

    def has_ray(self, u: FloatArray, v: FloatArray) -> BoolArray:
        """Whether `ray` finds a direction; true for positions that are NaN already."""
        return np.asarray(~np.isnan(self.ray(u, v)[0]) | np.isnan(u) | np.isnan(v))

    def unproject(self, image: FloatArray) -> FloatArray:
        """Unit directions (..., 3) of positions (..., 2) in the normalised picture; NaN outside the valid field."""
        rays = np.stack(np.broadcast_arrays(*self.ray(image[..., 0], image[..., 1])), axis=-1)
        directions: FloatArray = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
        return directions

    def derivatives(self, points: FloatArray, names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
        """Derivatives of the image with respect to the points, (..., 2, 3), and to the named coefficients, (..., 2, P).

        By complex steps, W. Squire and G. Trapp, SIAM Review 40 (1998) 110: exact to rounding.
        """
        x, y, z = points[..., 0], points[..., 1], points[..., 2]
        step = 1j * _STEP
        moved = [self.image(x + step, y, z), self.image(x, y + step, z), self.image(x, y, z + step)]
        changed = [replace(self, **{name: getattr(self, name) + step}).image(x, y, z) for name in names]
        by_points, by_coefficients = (
            np.stack([np.stack([np.imag(component) for component in pair], axis=-1) for pair in pairs], axis=-1) / _STEP
            if pairs
            else np.zeros((*x.shape, 2, 0))
            for pairs in (moved, changed)
        )
        return by_points, by_coefficients

    @property
    def scale_on_axis(self) -> float:
        """Derivative of normalised image coordinates with respect to slope on the axis: 1 for most models."""
        return float(self.derivatives(np.array([0.0, 0.0, 1.0]), ())[0][0, 0])

    @cached_property
    def valid_field(self) -> FloatArray:
        """Largest angle from the axis [rad] up to which the map is safely one-to-one in every azimuth.

        It ends where the picture's radial scale falls to `LEAST_SCALE` of that on the axis, where the images of circles
        about the axis no longer enclose its image, or at `widest`. The search takes steps of a thousandth of `widest`,
        then refines the one it found: a narrower fold goes unnoticed. The result has the shape of the coefficients.
        """
        if not self._single:
            names = self.coefficient_names()
            values = np.broadcast_arrays(*(getattr(self, name) for name in names))
            rows = zip(*(value.ravel().tolist() for value in values), strict=True)
            ends = [replace(self, **dict(zip(names, row, strict=True))).valid_field for row in rows]
            return np.reshape(ends, values[0].shape)
        plain = {name: np.asarray(getattr(self, name)).item() for name in self.coefficient_names()}
        return np.asarray(_remembered_field(replace(self, **plain)))

    def _searched_field(self) -> float:
        """The valid field, for coefficients that are single numbers."""
        widest = float(self.widest)
        angles = np.linspace(0.0, widest * (1.0 - 1e-9), _ANGLES + 1)  # the widest itself may be imaged at infinity
        around = np.linspace(0.0, 2.0 * np.pi, 1 if self.symmetric else _AZIMUTHS, endpoint=False)
        end, azimuth = self._end_of_field(angles, around)
        if end == angles[-1]:
            return widest
        # Between the azimuths the field may end sooner: look closely around the one where it ended, at angles that
        # become denser towards that end.
        if not self.symmetric:
            near = azimuth + np.linspace(-1.0, 1.0, _AZIMUTHS) * 2.0 * np.pi / _AZIMUTHS
            end, _ = self._end_of_field(end * (1.0 - np.geomspace(1.0, _ROUNDING, _NEARER)), near)
        return end

    def _end_of_field(self, angles: FloatArray, azimuths: FloatArray) -> tuple[float, float]:
        """The angle up to which all azimuths are well imaged, and the azimuth where they no longer are.

        The angles increase from one up to which they are; the field ends at the last one at the latest.
        """
        block = _DIRECTIONS // len(azimuths)
        for start in range(1, len(angles), block):
            good = self._well_imaged(angles[start : start + block], azimuths[:, None])
            if not np.all(good):
                break
        else:
            return float(angles[-1]), float(azimuths[0])
        first = int(np.argmin(np.all(good, axis=0)))
        low, high = angles[start + first - 1 : start + first + 1]
        # Up to the next angle, all other azimuths are well imaged: only these can end the field within the step.
        azimuths = azimuths[~good[:, first]]
        if high - low <= 2.0 * np.spacing(high):
            return float(low), float(azimuths[0])
        return self._end_of_field(np.linspace(low, high, _SECTIONS + 1), azimuths)

    def _well_imaged(self, angle: FloatArray, azimuth: FloatArray) -> BoolArray:
        """Whether directions at angles (N,) and azimuths (M, 1) are imaged outwards, unmirrored, not too compressed."""
        with np.errstate(all="ignore"):
            moved = self._moved(angle, azimuth, by=0)
            place, out = np.real(moved), np.imag(moved)
            around = np.imag(self._moved(angle, azimuth, by=1))
            on_axis = np.imag(self._moved(np.full(1, 1e-9), azimuth, by=0))
            scale = (out[0] * around[1] - out[1] * around[0]) / np.hypot(*around)
            turns = place[0] * around[1] - place[1] * around[0]
            outward = place[0] * np.cos(azimuth) + place[1] * np.sin(azimuth)
            return np.asarray((scale > LEAST_SCALE * np.hypot(*on_axis)) & (turns > 0.0) & (outward > 0.0))

    def _moved(self, angle: FloatArray, azimuth: FloatArray, *, by: int) -> NDArray[np.complex128]:
        """Images of directions moved by a complex step: the imaginary part is `_STEP` times the derivative."""
        turned, around = angle + 1j * _STEP * (by == 0), azimuth + 1j * _STEP * (by == 1)
        across = np.sin(turned)
        along = np.cos(turned) + 0.0 * np.real(around)
        moved = self.image(across * np.cos(around), across * np.sin(around), along)
        return np.array(np.broadcast_arrays(*moved))

    @cached_property
    def _single(self) -> bool:
        """Whether every coefficient is a single number."""
        return all(np.ndim(getattr(self, name)) == 0 for name in self.coefficient_names())

    def _kept(
        self, x: FloatArray, y: FloatArray, z: FloatArray, solved: BoolArray | bool = True
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Rays found by an inverse; NaN where it did not solve or the ray lies outside the valid field."""
        valid = solved & self._inside(x, y, z)
        return np.where(valid, x, np.nan), np.where(valid, y, np.nan), np.where(valid, z, np.nan)

    def _inside(self, x: FloatArray, y: FloatArray, z: FloatArray) -> BoolArray:
        """Whether rays found by an inverse lie in the valid field; for draws, the inverse itself decides."""
        if not self._single:
            return np.ones(np.broadcast_shapes(np.shape(x), np.shape(y), np.shape(z)), dtype=bool)
        return np.asarray(np.arctan2(np.hypot(x, y), z) <= self.valid_field + _ROUNDING)

    def _require(self, name: str, *, above: float = -np.inf, low: float = -np.inf, high: float = np.inf) -> None:
        """Refuse a coefficient outside its range, or one that is not finite."""
        value = np.real(getattr(self, name))
        allowed = (value > above) & (value >= low) & (value <= high) & (abs(value) < np.inf)
        if allowed is not True and not np.all(allowed):  # numpy is slow at plain numbers
            ends = [f"above {above:g}"] if np.isfinite(above) else []
            ends += [f"at least {low:g}"] if np.isfinite(low) else []
            ends += [f"at most {high:g}"] if np.isfinite(high) else []
            raise OutOfRangeError(
                f"the coefficient {name} of the lens model {self.name}",
                value=f"{np.ravel(value)[0]:g}",
                limit=" and ".join(["finite", *ends]),
                remedy="correct the coefficient",
            )


@lru_cache(maxsize=256)
def _remembered_field(lens: LensModel) -> float:
    """The valid field; the lenses of a study are made anew each time it is read."""
    return lens._searched_field()


def angle_from_axis(distance: FloatArray, z: FloatArray) -> FloatArray:
    """Angle [rad] whose tangent is distance over z, from 0 to π; analytic, so that complex steps pass through it."""
    near = np.real(z) >= np.real(distance)
    ratio = np.where(near, distance, z) / np.where(near, z, np.where(distance == 0.0, 1.0, distance))
    turned = np.arctan(ratio)
    return np.where(near, turned, np.pi / 2.0 - turned)


def slopes(x: ArrayLike, y: ArrayLike, z: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """x/z and y/z of directions; NaN for points beside or behind the camera."""
    ahead = np.where(np.real(z) > 0.0, z, np.nan)
    return np.asarray(np.asarray(x) / ahead), np.asarray(np.asarray(y) / ahead)


_NEWTON_STEPS: Final = 30
_SETTLED: Final = 1e-12
_RELATIVE_ROUNDING: Final = 1e-15  # of both sides of the equation; where its slope is small, so many digits are lost
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
        k1, k2 = self.k1, self.k2
        if self._polynomial:
            return 1.0 + square * (k1 + square * k2), k1 + 2.0 * square * k2
        k3, k4, k5, k6 = self.k3, self.k4, self.k5, self.k6
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
            scale, valid = self._radial_inverse(a, b)
            x, y = a * scale, b * scale
            if self._oblique:
                x, y, valid = self._oblique_inverse(x, y, a, b)
            valid &= self._inside(x, y, np.ones(()))
        return np.where(valid, x, np.nan), np.where(valid, y, np.nan), np.ones(())

    def _radial_inverse(self, a: FloatArray, b: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Scale r/r_d of positions before the tilt, by radial distortion alone, and whether it is on the rising branch.

        Solves ``s g(s² r_d²) = 1``, starting from a table for single coefficients, and from 1 for draws.
        """
        square = a * a + b * b
        scale = np.ones(())
        if self._single:
            radius, picture = self._table
            distorted = np.sqrt(square)
            held = square > 0.0
            scale = np.where(held, np.interp(distorted, picture, radius) / np.where(held, distorted, 1.0), 1)
        rising = np.ones((), dtype=bool)
        step, settled = np.zeros(()), np.zeros(())
        for _ in range(_NEWTON_STEPS):
            inner = scale * scale * square
            g, rise = self._factor(inner)
            slope = g + 2.0 * inner * rise
            # An iterate on a falling part of the curve may lead to a position beyond the fold.
            rising = rising & (slope > 0.0)
            step = (scale * g - 1.0) / np.where(slope > 0.0, slope, 1.0)
            scale = np.clip(scale - step, 0.0, _LARGEST_SCALE if not self._single else np.inf)
            settled = (_SETTLED + _RELATIVE_ROUNDING / np.where(slope > 0.0, slope, np.inf)) * scale
            if not np.any(np.abs(step) > settled):
                break
        return scale, rising & (np.abs(step) <= settled)

    @cached_property
    def _table(self) -> tuple[FloatArray, FloatArray]:
        """Radii before and after radial distortion alone, over the part of the field where both rise."""
        radial = self if self.symmetric else replace(self, **dict.fromkeys(_NOT_RADIAL, 0.0))
        end = float(radial.valid_field)
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
        # Beyond the fold of the distortion, the picture is mirrored, and the determinant is negative.
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

"""Base of all lens models: projection, its inverse, its derivatives, and the field in which it is one-to-one."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import MISSING, dataclass, fields, replace
from functools import cached_property
from typing import ClassVar, Final, Self

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
_SECTIONS: Final = 64  # of the step in which the field ends, refined as often as rounding allows
_REFINEMENTS: Final = 9
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
        seen = self.sees(x, y, z)
        return np.stack(np.broadcast_arrays(np.where(seen, u, np.nan), np.where(seen, v, np.nan)), axis=-1)

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
            np.stack([np.stack([np.imag(one) for one in pair], axis=-1) for pair in pairs], axis=-1) / _STEP
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
        top = np.asarray(self.widest) * (1.0 - 1e-9)  # the widest directions themselves may be imaged at infinity
        if self.symmetric:
            return self._end_of_field(top, np.zeros(1))[1]
        azimuth, _ = self._end_of_field(top, np.linspace(0.0, 2.0 * np.pi, _AZIMUTHS, endpoint=False))
        near = np.linspace(-1.0, 1.0, _AZIMUTHS) * 2.0 * np.pi / _AZIMUTHS
        return self._end_of_field(top, azimuth[..., None] + near)[1]

    def _end_of_field(self, top: FloatArray, azimuths: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The azimuth (...) in which the field ends first, and the angle at which it ends."""
        share = np.linspace(0.0, 1.0, _ANGLES + 1)[1:]
        angles = top[..., None, None] * share
        good = self._well_imaged(np.broadcast_to(angles, (*np.shape(top), 1, _ANGLES)), azimuths[..., None])
        whole = np.all(good, axis=-1)
        step = top[..., None] / _ANGLES
        low = np.argmin(good, axis=-1) * step
        for _ in range(0 if np.all(whole) else _REFINEMENTS):
            step = step / _SECTIONS
            angles = low[..., None] + step[..., None] * np.arange(1, _SECTIONS)
            good = self._well_imaged(angles, azimuths[..., None])
            low = low + step * np.where(np.all(good, axis=-1), _SECTIONS - 1, np.argmin(good, axis=-1))
        ends = np.where(whole, np.asarray(self.widest)[..., None], low)
        least = np.argmin(ends, axis=-1)[..., None]
        azimuth = np.take_along_axis(np.broadcast_to(azimuths, ends.shape), least, axis=-1)[..., 0]
        return azimuth, np.take_along_axis(ends, least, axis=-1)[..., 0]

    def _well_imaged(self, angle: FloatArray, azimuth: FloatArray) -> BoolArray:
        """Whether directions, shape (..., azimuths, angles), are imaged outwards, unmirrored and not too compressed."""
        lens = self._spread(2)
        with np.errstate(all="ignore"):
            moved = lens._moved(angle, azimuth, by=0)
            place, out = np.real(moved), np.imag(moved)
            around = np.imag(lens._moved(angle, azimuth, by=1))
            on_axis = np.imag(lens._moved(np.full_like(angle[..., :1], 1e-9), azimuth, by=0))
            scale = (out[0] * around[1] - out[1] * around[0]) / np.hypot(*around)
            turns = place[0] * around[1] - place[1] * around[0]
            outward = place[0] * np.cos(azimuth) + place[1] * np.sin(azimuth)
            return np.asarray((scale > LEAST_SCALE * np.hypot(*on_axis)) & (turns > 0.0) & (outward > 0.0))

    def _moved(self, angle: FloatArray, azimuth: FloatArray, *, by: int) -> NDArray[np.complex128]:
        """Images of directions moved by a complex step: the imaginary part is `_STEP` times the derivative."""
        step = 1j * _STEP
        moved = self.image(*_direction(np.add(angle, step * (by == 0)), np.add(azimuth, step * (by == 1))))
        return np.array(np.broadcast_arrays(*moved))

    def _spread(self, axes: int) -> Self:
        """The same model with this many axes appended to those of its coefficients."""
        values = {name: np.asarray(getattr(self, name)) for name in self.coefficient_names()}
        wide = {name: value[(..., *[None] * axes)] for name, value in values.items() if value.ndim}
        return replace(self, **wide) if wide else self

    @property
    def _single(self) -> bool:
        """Whether every coefficient is a single number."""
        return all(np.ndim(getattr(self, name)) == 0 for name in self.coefficient_names())

    def _inside(self, x: FloatArray, y: FloatArray, z: FloatArray) -> BoolArray:
        """Whether rays found by an inverse lie in the valid field; for draws, the inverse itself decides."""
        if not self._single:
            return np.ones(np.broadcast_shapes(np.shape(x), np.shape(y), np.shape(z)), dtype=bool)
        return np.asarray(np.arctan2(np.hypot(x, y), z) <= self.valid_field + _ROUNDING)

    def _require(self, name: str, *, above: float = -np.inf, low: float = -np.inf, high: float = np.inf) -> None:
        """Refuse a coefficient outside its range, or one that is not finite."""
        value = np.real(np.asarray(getattr(self, name)))
        if not np.all(np.isfinite(value) & (value > above) & (value >= low) & (value <= high)):
            ends = [f"above {above:g}"] if np.isfinite(above) else []
            ends += [f"at least {low:g}"] if np.isfinite(low) else []
            ends += [f"at most {high:g}"] if np.isfinite(high) else []
            raise OutOfRangeError(
                f"the coefficient {name} of the lens model {self.name}",
                value=f"{value.ravel()[0]:g}",
                limit=" and ".join(["finite", *ends]),
                remedy="correct the coefficient",
            )


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


def _direction(angle: FloatArray, azimuth: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    across = np.sin(angle)
    return across * np.cos(azimuth), across * np.sin(azimuth), np.cos(angle) + 0.0 * np.real(azimuth)

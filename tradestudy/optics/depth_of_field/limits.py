"""What a depth of field is: a near and a far limit, or the reason why there is none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import BoolArray, FloatArray


@dataclass(frozen=True, kw_only=True)
class DepthOfField:
    """Distances from the lens between which the blur meets its criterion.

    Where nothing meets it, both limits are NaN, ``empty`` is true and ``reason`` says why in words.
    """

    near: FloatArray
    """Near limit [m]."""
    far: FloatArray
    """Far limit [m]; +∞ where everything beyond the near limit is sharp."""
    reason: str = ""
    """Why there is none, if there is none somewhere; with the values at the worst place."""

    @property
    def empty(self) -> BoolArray:
        """Where nothing is sharp."""
        return np.asarray(np.isnan(self.near))

    @property
    def extent(self) -> FloatArray:
        """Far less near [m]; 0 where nothing is sharp, ∞ where the far limit is."""
        deep = self.far > self.near
        return np.subtract(self.far, self.near, out=np.zeros(np.shape(deep)), where=deep)

    def contains(self, distance: ArrayLike) -> BoolArray:
        """Tell whether distances [m] are sharp (broadcast against the limits)."""
        a = np.asarray(distance, dtype=np.float64)
        return np.asarray((a >= self.near) & (a <= self.far))


def intersection(first: DepthOfField, second: DepthOfField) -> DepthOfField:
    """What is sharp for both, as for the two lenses of a stereo rig: the farther near and the nearer far limit."""
    near, far = np.maximum(first.near, second.near), np.minimum(first.far, second.far)
    apart = near > far
    reasons = [reason for reason in (first.reason, second.reason) if reason]
    if np.any(apart):
        reasons.append("the two depths of field do not meet")
    return DepthOfField(
        near=np.where(apart, np.nan, near), far=np.where(apart, np.nan, far), reason="; ".join(dict.fromkeys(reasons))
    )


def as_floats(*values: ArrayLike) -> tuple[FloatArray, ...]:
    """Give arguments as arrays."""
    return tuple(np.asarray(value, dtype=np.float64) for value in values)


def require(condition: ArrayLike, what: str, value: FloatArray, *, limit: str, remedy: str, unit: str = "m") -> None:
    """Refuse an argument with its first value that breaks a condition."""
    holds = np.asarray(condition)
    if not np.all(holds):
        value, holds = np.broadcast_arrays(value, holds)
        raise OutOfRangeError(what, value=f"{value[~holds].flat[0]:g} {unit}".strip(), limit=limit, remedy=remedy)

"""The calibrated correction of depth by a quadratic function, as in calibrations by libpleno."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.parts import require_positive
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray


@dataclass(frozen=True, kw_only=True)
class DepthScaling:
    """Metric depth ``M = a Z² + b Z + c`` of the depth Z by eq. 8, in libpleno's ``PlenopticCamera::mla2obj``.

    Source: https://github.com/comsee-research/libpleno, pleno/geometry/camera/plenoptic.cpp. Valid where M > 0 and
    ``dM/dZ = 2 a Z + b > 0``, which is ``√(b² + 4 a (M − c))``.

    Parameters
    ----------
    quadratic, linear, offset
        a [1/m], b [1], above 0, and c [m].

    Raises
    ------
    OutOfRangeError
        b is not positive, or a or c is not finite.
    """

    quadratic: float = 0.0
    linear: float = 1.0
    offset: float = 0.0

    def __post_init__(self) -> None:
        require_positive("linear coefficient of the depth scaling", self.linear, "")
        if not (math.isfinite(self.quadratic) and math.isfinite(self.offset)):
            raise OutOfRangeError(
                "coefficients of the depth scaling", value=f"{self.quadratic:g} 1/m, {self.offset:g} m", limit="finite"
            )

    @cached_property
    def is_identity(self) -> bool:
        """Whether depth is not corrected."""
        return (self.quadratic, self.linear, self.offset) == (0.0, 1.0, 0.0)

    @property
    def words(self) -> str:
        """The law with its coefficients in metres."""
        return f"{self.quadratic:g}/m Z² + {self.linear:g} Z + {self.offset:g} m"

    @cached_property
    def farthest(self) -> float:
        """The Z [m] from which on M no longer grows; infinite unless a < 0."""
        return -self.linear / (2.0 * self.quadratic) if self.quadratic < 0.0 else math.inf

    def modelled(self, metric: ArrayLike) -> FloatArray:
        """The Z [m] of metric distances M [m]; 0 where M ≤ c, infinity for infinity.

        Raises
        ------
        OutOfRangeError
            For a finite M that no Z gives, or where ``dM/dZ ≤ 0``.
        """
        m = np.asarray(metric, dtype=np.float64)
        if self.is_identity:
            return m
        a, b, c = self.quadratic, self.linear, self.offset
        beyond_c = np.where(np.isfinite(m), np.maximum(m - c, 0.0), 0.0)
        square = b * b + 4.0 * a * beyond_c
        if np.any(square <= 0.0):
            raise OutOfRangeError(
                "distance of an object beyond the largest depth that the camera's depth.scaling can measure",
                value=f"{np.max(m[square <= 0.0]):g} m",
                limit=f"below {c - b * b / (4.0 * a):g} m, where 2 a Z + b is zero",
                remedy="reduce the distances, or use a scaling that was calibrated for them",
            )
        return np.asarray(np.where(np.isfinite(m), 2.0 * beyond_c / (b + np.sqrt(square)), m))

    def metric(self, modelled: ArrayLike) -> FloatArray:
        """The metric depth M [m] of depths Z [m]: 0 instead of less, and infinity from `farthest` on."""
        z = np.asarray(modelled, dtype=np.float64)
        if self.is_identity:
            return z
        near = np.where(z < self.farthest, z, 0.0)
        m = np.maximum((self.quadratic * near + self.linear) * near + self.offset, 0.0)
        return np.asarray(np.where(np.isnan(z), np.nan, np.where(z < self.farthest, m, np.inf)))

    def slope(self, modelled: ArrayLike) -> FloatArray:
        """``dM/dZ = 2 a Z + b``, the factor by which the scaling multiplies depth uncertainty [1]."""
        z = np.asarray(modelled, dtype=np.float64)
        steepening = 2.0 * self.quadratic * z if self.quadratic else np.zeros_like(z)
        return np.asarray(steepening + self.linear)

    def metric_inverse(self, inverse: FloatArray) -> FloatArray:
        """``1/M = w²/(a + b w + c w²)`` [1/m] of ``w = 1/Z`` [1/m]; NaN where M ≤ 0.

        Where Z is at or beyond `farthest`, or beyond infinity, no depth is measured: 0 or less, falling on with w.
        """
        if self.is_identity:
            return inverse
        least = 1.0 / self.farthest
        w = np.where(inverse > least, inverse, np.nan)
        below = self.quadratic + self.linear * w + self.offset * np.square(w)
        found = np.where(below > 0.0, np.square(w) / np.where(below > 0.0, below, 1.0), np.nan)
        return np.asarray(np.where(inverse <= least, (inverse - least) / self.linear, found))


NO_SCALING: Final = DepthScaling()

"""One requirement held against one camera: the answer, its margin and its place."""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist


@dataclass(frozen=True, kw_only=True)
class Held:
    """One requirement held against one camera.

    Parameters
    ----------
    camera
        Its name.
    met
        Whether it holds over all distances, its guard band included; None where there is no value.
    value, bound
        The worst value, and what it is held against, in the SI unit of the quantity.
    place
        Where the worst value lies [m].
    error
        Estimated error of the worst value.
    margin
        By which share the worst value could be worse and still keep the bound, negative where it is broken. Where the
        camera cannot be used everywhere it is at most minus the share of the distances, on a logarithmic scale, where
        it cannot.
    unusable
        That share.
    reason
        In words.
    """

    camera: str
    met: bool | None
    value: float
    bound: float
    place: float
    error: float
    margin: float
    unusable: float
    reason: str

    @property
    def margin_in_errors(self) -> float:
        """Distance of the worst value from its bound in standard errors, negative where it is broken; NaN without."""
        if not self.error > 0.0 or self.unusable > 0.0 or not math.isfinite(self.value):
            return math.nan
        return math.copysign(abs(self.bound - self.value) / self.error, self.margin)

    @property
    def conformity(self) -> float:
        """Probability that the true worst value keeps the bound, its error taken as normal; NaN without a value."""
        if self.met is None or math.isnan(self.margin):
            return math.nan
        in_errors = self.margin_in_errors
        if not math.isnan(in_errors):
            return NormalDist().cdf(in_errors)
        return float(bool(self.met) if self.margin == 0.0 else self.margin > 0.0)  # at its bound, the bound decides

    @classmethod
    def unknown(cls, camera: str, bound: float, reason: str) -> Held:
        """Of a camera that has no value: nothing is decided."""
        nan = math.nan
        return cls(
            camera=camera,
            met=None,
            value=nan,
            bound=bound,
            place=nan,
            error=nan,
            margin=nan,
            unusable=nan,
            reason=reason,
        )

"""The answer of one camera to one requirement, with its margin and its worst distance."""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist

from tradestudy.cameras.depth_measurement import FieldPosition


@dataclass(frozen=True, kw_only=True)
class RequirementAnswer:
    """The answer of one camera to one requirement.

    Parameters
    ----------
    camera
        Name of the camera.
    met
        Whether the requirement is met at all distances, including its guard band; None if there is no value.
    value, bound
        The worst value and its bound, in the SI unit of the quantity.
    place
        Distance of the worst value [m].
    field
        Position of the worst value in the picture.
    error
        Estimated error of the worst value.
    margin
        The fraction by which the worst value could worsen and still meet the bound, negative if it misses the bound. If
        the camera is not usable everywhere, the margin is at most minus the unusable share of the distances.
    unusable
        The unusable share of the distances, on a logarithmic scale.
    reason
        The reason, in words.
    limit
        Name of the limit of the usable range that decides the answer; empty if the value does.
    value_margin
        The margin of the worst value, usable or not; None if `margin` is the same.
    end_shift
        The smallest relative shift of ends of usable ranges that changes whether the camera is usable everywhere;
        infinite if no shift does.
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
    limit: str = ""
    value_margin: float | None = None
    end_shift: float = math.inf
    field: FieldPosition = 0.0

    def could_be_overturned(self, of_value: float, of_ends: float) -> bool:
        """Whether relative changes of this size in the worst value and in the usable ends could reverse the answer."""
        margin = self.margin if self.value_margin is None else self.value_margin
        by_value, by_ends = abs(margin) <= of_value, self.end_shift <= of_ends
        if self.met or self.value_margin is None or self.unusable == 0.0:
            return by_value or (self.met is True and by_ends)
        return by_ends and (by_value or margin > 0.0)

    @property
    def margin_in_errors(self) -> float:
        """Distance of the worst value from its bound in standard errors, negative if it misses; NaN without errors."""
        if not self.error > 0.0 or self.unusable > 0.0 or not math.isfinite(self.value):
            return math.nan
        return math.copysign(abs(self.bound - self.value) / self.error, self.margin)

    @property
    def conformity(self) -> float:
        """Probability that the true worst value meets the bound, for a normal error; NaN without a value."""
        if self.met is None or math.isnan(self.margin):
            return math.nan
        in_errors = self.margin_in_errors
        if not math.isnan(in_errors):
            return NormalDist().cdf(in_errors)
        return float(bool(self.met) if self.margin == 0.0 else self.margin > 0.0)  # exactly at the bound, `met` decides

    @classmethod
    def unknown(cls, camera: str, bound: float, reason: str) -> RequirementAnswer:
        """An undecided answer, for a camera without a value."""
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

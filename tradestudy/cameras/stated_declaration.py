"""Values that a source states about a camera in addition to those that determine it."""

from __future__ import annotations

from collections.abc import Iterator
from statistics import NormalDist
from typing import Annotated, Final, Literal

from pydantic import Field

from tradestudy.declarations.part import MistakeAt, Part
from tradestudy.declarations.quantities import (
    ObjectDistance,
    PositiveAngle,
    PositiveFraction,
    PositiveLength,
    PositivePhotons,
    PositiveShare,
    Text,
)

_SMALLEST_SHARE: Final = 0.01


class StatedAccuracyPart(Part):
    """An accuracy of depth that the maker of a camera states, with the conditions under which it is stated."""

    says: Text = Field(description="The statement in words.")
    metric: Literal["error", "standard_deviation", "plane_deviation", "unstated"] = Field(
        description="What is stated: a bound on the depth error, its standard deviation, or that about the best plane."
    )
    relative: PositiveFraction | None = Field(default=None, description="Its value, relative to the distance.")
    absolute: PositiveLength | None = Field(default=None, description="Instead of `relative`: its value.")
    share: PositiveShare | None = Field(
        default=None,
        description="Fraction of measurements for which it holds; default: not stated.",
    )
    up_to: ObjectDistance = Field(description="Distance up to which it holds.")
    mode: Text = Field(description="Mode of the camera, or `not stated`.")
    target: Text = Field(description="What is measured, or `not stated`.")
    gives: Literal["nothing", "disparity_error"] = Field(
        default="nothing",
        description="Whether the camera's disparity error was derived from this statement, which then checks nothing.",
    )

    def _mistakes(self) -> Iterator[MistakeAt]:
        if (self.relative is None) == (self.absolute is None):
            yield MistakeAt((), "give exactly one of relative and absolute")
        if self.share is not None and self.share < _SMALLEST_SHARE:
            yield MistakeAt(("share",), f"{self.share:g} says nothing about the error; 1 % to 100 % is expected")

    @property
    def standard_deviation(self) -> float:
        """Standard deviation of depth at the distance `up_to` [m] if its error is normal, with mean 0.

        A bound v on the error of a share p of measurements means the standard deviation v / z, with the standard normal
        quantile z of (1 + p)/2. Where the source states no share, v counts as the standard deviation.
        """
        bound = self.absolute if self.absolute is not None else (self.relative or 0.0) * self.up_to
        if self.share is None or self.share == 1.0:
            return bound
        return -bound / NormalDist().inv_cdf((1.0 - self.share) / 2.0)  # exact also for shares near 1


AccuracyName = Annotated[str, Field(pattern=r"^[a-z][\w-]*$", max_length=60)]


class StatedPart(Part):
    """Values that a source states besides those of other keys; the report lists contradictions between them."""

    field_of_view: PositiveAngle | None = Field(
        default=None,
        description="Full field of view across the width or the diagonal of the sensor; either is accepted.",
    )
    projector: Literal["on", "off", "none"] | None = Field(
        default=None,
        description="Whether the projector of the camera lights the scene with a pattern; `none` if it has none.",
    )
    nearest_distance: PositiveLength | None = Field(
        default=None,
        description="Nearest distance that a stereo rig measures with its `depth.disparity_range`.",
    )
    accuracy: dict[AccuracyName, StatedAccuracyPart] = Field(
        default={}, description="Accuracies that the maker states, by names that you choose."
    )
    microlens_gap: PositiveLength | None = Field(
        default=None, description="Distance from the microlens array to the sensor."
    )
    mla_distance: PositiveLength | None = Field(
        default=None, description="Distance from the main lens to the microlens array."
    )
    hyperfocal_distance: PositiveLength | None = Field(
        default=None, description="Hyperfocal distance for a blur of one pixel."
    )
    absolute_sensitivity_threshold: PositivePhotons | None = Field(
        default=None,
        description="Absolute sensitivity threshold (EMVA 1288: μ_p.min): the number of photons at which signal and "
        "noise are equal.",
    )
    depth_of_field: PositiveLength | None = Field(
        default=None, description="Depth of field of one picture by a conventional camera, for a blur of one pixel."
    )

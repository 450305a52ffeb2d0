"""What a study requires of its cameras: a quantity, its bound, and the distances over which it has to hold."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from tradestudy.declarations.mistakes import MistakeAt
from tradestudy.declarations.part import Part
from tradestudy.declarations.quantities import PositiveFraction, PositiveLength, PositiveNumber, Share
from tradestudy.declarations.words import CameraName, Span, Text

Risk = Annotated[PositiveFraction, Field(lt=0.5)]


class BoundOverPart(Part):
    """An upper bound of the depth uncertainty, absolute or relative to the distance, over a range of distances."""

    below: PositiveLength | None = Field(default=None, description="Absolute bound.")
    below_relative: PositiveFraction | None = Field(default=None, description="Bound as a share of the distance.")
    over: Span

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if (self.below is None) == (self.below_relative is None):
            raise MistakeAt((), "give exactly one of below and below_relative")
        return self

    @property
    def is_relative(self) -> bool:
        """Whether the bound is a share of the distance."""
        return self.below is None

    @property
    def limit(self) -> float:
        """The bound, in metres or as a share."""
        return self.below if self.below is not None else self.below_relative or 0.0


class UsablePart(Part):
    """A range of distances over which the camera has to be usable."""

    over: Span


class ShareAbovePart(Part):
    """A least share, over a range of distances."""

    above: Share
    over: Span


class ShareBelowPart(Part):
    """A largest share, over a range of distances."""

    below: PositiveFraction
    over: Span


class LengthBelowPart(Part):
    """A largest length, over a range of distances."""

    below: PositiveLength
    over: Span


class GuardBandPart(Part):
    """How far a value has to stay inside its bound: so many of its standard errors, or by the risk that it leaves."""

    standard_errors: PositiveNumber | None = None
    risk: Risk | None = Field(default=None, description="Probability that the bound is broken although it seems kept.")

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if (self.standard_errors is None) == (self.risk is None):
            raise MistakeAt((), "give exactly one of standard_errors and risk")
        return self

    @property
    def width(self) -> float:
        """In standard errors of the value."""
        if self.standard_errors is not None:
            return self.standard_errors
        from statistics import NormalDist

        assert self.risk is not None  # one of the two is given
        return -NormalDist().inv_cdf(self.risk)


_QUANTITIES = ("depth_uncertainty", "usable", "overlap", "lateral_resolution", "failed_fraction")
Required = BoundOverPart | UsablePart | ShareAbovePart | ShareBelowPart | LengthBelowPart


class RequirementPart(Part):
    """What a camera must do; ``any`` asks whether at least one camera does it, ``all`` whether every one does."""

    says: Text
    camera: CameraName = Field(description="A camera, any or all.")
    priority: Literal["must", "should"] = Field(
        default="must", description="What --strict insists on, or what is only wished for."
    )
    depth_uncertainty: BoundOverPart | None = None
    usable: UsablePart | None = Field(default=None, description="The usable range reaches at least from here to there.")
    overlap: ShareAbovePart | None = Field(default=None, description="Least common share of two stereo views.")
    lateral_resolution: LengthBelowPart | None = Field(
        default=None, description="Size of detail on the object that blur and samples still resolve."
    )
    failed_fraction: ShareBelowPart | None = Field(
        default=None, description="Share of measurements that end beyond infinity or are false matches."
    )
    guard_band: GuardBandPart | None = None

    @model_validator(mode="after")
    def _one_quantity(self) -> Self:
        if sum(getattr(self, name) is not None for name in _QUANTITIES) != 1:
            raise MistakeAt((), f"give exactly one of {', '.join(_QUANTITIES[:-1])} and {_QUANTITIES[-1]}")
        return self

    @property
    def quantity(self) -> str:
        """The one that is given."""
        return next(name for name in _QUANTITIES if getattr(self, name) is not None)

    @property
    def required(self) -> Required:
        """What is required of it."""
        found: Required = getattr(self, self.quantity)
        return found

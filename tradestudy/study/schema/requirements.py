"""Requirements of a study on its cameras: a quantity, its bound and, for most quantities, the distances that count."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from tradestudy.declarations.part import MistakeAt, Part
from tradestudy.declarations.quantities import (
    CameraName,
    ObjectDistance,
    PositiveFraction,
    PositiveLength,
    PositiveNumber,
    PositiveShare,
    QuantityText,
    Share,
    Span,
    Text,
)

Risk = Annotated[PositiveFraction, Field(lt=0.5)]


_AT = "Instead of `over`: the only distance at which the requirement must hold."


class _OverOrAtPart(Part):
    """The distances that count: a range, or a single one."""

    over: Span | None = Field(
        default=None, description="Nearest and farthest of the distances at which the requirement must hold."
    )
    at: ObjectDistance | None = Field(default=None, description=_AT)

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        if (self.over is None) == (self.at is None):
            raise MistakeAt((), "give exactly one of over (a range of distances) and at (a single distance)")
        return self

    @property
    def distances(self) -> tuple[float, ...]:
        """Nearest and farthest distance that count [m]; a single one is both."""
        return _ends(self.over, self.at)


def _ends(over: tuple[float, ...] | None, at: float | None) -> tuple[float, ...]:
    return over or (() if at is None else (at, at))


class BoundOverPart(_OverOrAtPart):
    """An upper bound on the depth uncertainty, absolute or relative to the distance."""

    below: PositiveLength | None = Field(default=None, description="Value below which the depth uncertainty must stay.")
    below_relative: PositiveFraction | None = Field(
        default=None, description="Instead of `below`: the bound as a fraction of the distance."
    )

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if (self.below is None) == (self.below_relative is None):
            raise MistakeAt((), "give exactly one of below and below_relative")
        return self

    @property
    def is_relative(self) -> bool:
        """Whether the bound is a fraction of the distance."""
        return self.below is None

    @property
    def limit(self) -> float:
        """The bound, in metres or as a fraction of the distance."""
        return self.below if self.below is not None else self.below_relative or 0.0


class UsablePart(_OverOrAtPart):
    """The distances at which the camera must be usable."""


class ShareAbovePart(_OverOrAtPart):
    """A lower bound on a fraction."""

    above: Share = Field(description="Smallest fraction that meets the requirement.")


class ShareBelowPart(_OverOrAtPart):
    """An upper bound on a fraction."""

    below: PositiveShare = Field(description="Value below which the fraction must stay.")


class LengthBelowPart(_OverOrAtPart):
    """An upper bound on a length."""

    below: PositiveLength = Field(description="Value below which the length must stay.")


class SharpPart(Part):
    """The distances that must be sharp, or the smallest total depth of field that meets the requirement."""

    over: Span | None = Field(
        default=None, description="Nearest and farthest distance of the range that must be sharp throughout."
    )
    at: ObjectDistance | None = Field(default=None, description=_AT)
    above: PositiveLength | None = Field(
        default=None, description="Instead of `over`: smallest total depth of field that meets the requirement."
    )
    criterion: Text | None = Field(
        default=None,
        description="Name of one of the blur criteria that the top-level key depth_of_field lists under `criteria`; "
        "default: the first.",
    )

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if sum(one is not None for one in (self.over, self.at, self.above)) != 1:
            raise MistakeAt(
                (),
                "give exactly one of over (a range that must be sharp), at (a distance that must be sharp) and above "
                "(a smallest depth of field)",
            )
        return self

    @property
    def distances(self) -> tuple[float, ...]:
        """Nearest and farthest distance that must be sharp [m]; empty for a smallest depth of field."""
        return _ends(self.over, self.at)


class CriterionPart(Part):
    """A bound on a criterion that cameras declare under attributes.others, or that the program derives."""

    name: Text = Field(
        description="Name of the criterion: one of attributes.others or, in a study with `relief`, one that the "
        "program derives: `moving parts`, `images per scene`, `time per scene`, `data per depth map`, `resolved "
        "samples`, `aperture`, `light gathered`, `hidden beside a step` or `foreshortening`."
    )
    below: QuantityText | None = Field(
        default=None, description="Value below which the criterion must stay, with its unit."
    )
    above: QuantityText | None = Field(
        default=None,
        description="Instead of `below`: smallest value of the criterion that meets the requirement, with its unit.",
    )

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if (self.below is None) == (self.above is None):
            raise MistakeAt((), "give exactly one of below and above")
        return self

    @property
    def side(self) -> str:
        """The key of the bound: the side on which the value must lie."""
        return "below" if self.below is not None else "above"

    @property
    def bound(self) -> str:
        """The bound with its unit."""
        return self.below if self.below is not None else self.above or ""


class GuardBandPart(Part):
    """How far a value must stay from its bound.

    It is given as a number of standard errors of the value, or as the largest acceptable risk that a requirement counts
    as met although its bound is violated.

    It affects requirements on depth_uncertainty and failed_fraction, but not those on `usable`, `overlap` or
    lateral_resolution; a requirement on depth_of_field or on a `criterion` does not accept it.
    """

    standard_errors: PositiveNumber | None = Field(
        default=None, description="Width of the guard band, in standard errors of the value."
    )
    risk: Risk | None = Field(
        default=None,
        description="Instead of standard_errors: largest probability, below 50 %, that the bound is violated "
        "although the requirement counts as met.",
    )

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if (self.standard_errors is None) == (self.risk is None):
            raise MistakeAt((), "give exactly one of standard_errors and risk")
        return self

    @property
    def width(self) -> float:
        """Width of the guard band, in standard errors of the value."""
        if self.standard_errors is not None:
            return self.standard_errors
        from statistics import NormalDist

        assert self.risk is not None  # one of the two is given
        return -NormalDist().inv_cdf(self.risk)


_WITHOUT_USABLE_RANGE = ("depth_of_field", "criterion")
_OF_ANY_CAMERA = ("lateral_resolution", *_WITHOUT_USABLE_RANGE)
_QUANTITIES = ("depth_uncertainty", "usable", "overlap", "failed_fraction", *_OF_ANY_CAMERA)
MeasuredPart = BoundOverPart | ShareAbovePart | ShareBelowPart | LengthBelowPart
Required = MeasuredPart | UsablePart | SharpPart | CriterionPart


class RequirementPart(Part):
    """A requirement on one quantity, to be met by a named camera, by at least one camera, or by every camera."""

    says: Text = Field(description="The requirement in words.")
    camera: CameraName = Field(
        description="Name of the camera that must meet the requirement, `any` if at least one camera must, or "
        "`all` if every camera must."
    )
    priority: Literal["must", "should"] = Field(
        default="must",
        description="Whether the requirement is binding (`must`), so that a run with `--strict` fails if it is not "
        "met, or only desirable (`should`).",
    )
    depth_uncertainty: BoundOverPart | None = None
    usable: UsablePart | None = Field(default=None, description="Distances at which the camera must be usable.")
    overlap: ShareAbovePart | None = Field(
        default=None, description="Bound on the overlap of the two pictures of a stereo rig."
    )
    lateral_resolution: LengthBelowPart | None = Field(
        default=None,
        description="Bound on the size of the smallest detail on the object that the camera resolves: the largest "
        "of lateral sample, blur and radius of the Airy disc (Rayleigh's criterion), each projected to the object. "
        "Cameras that measure no depth can meet it too.",
    )
    failed_fraction: ShareBelowPart | None = Field(
        default=None,
        description="Bound on the fraction of measurements that fail; see usable_range.failed_fraction.",
    )
    depth_of_field: SharpPart | None = Field(
        default=None, description="Bound on the depth of field, also for cameras that measure no depth."
    )
    criterion: CriterionPart | None = Field(
        default=None,
        description="Bound on a criterion such as mass, power or moving parts, also for cameras that measure no depth.",
    )
    guard_band: GuardBandPart | None = None
    field: Share | None = Field(
        default=None,
        description="Part of the picture that counts for depth_uncertainty and failed_fraction: the rectangle around "
        "its middle whose corners lie at this fraction of the way to the corners of the sensor. 0 % is the optical "
        "axis, 100 % the whole picture. Default: the axis and the places of propagation.field_places.",
    )

    @model_validator(mode="after")
    def _one_quantity(self) -> Self:
        if sum(getattr(self, name) is not None for name in _QUANTITIES) != 1:
            raise MistakeAt((), f"give exactly one of {', '.join(_QUANTITIES[:-1])} and {_QUANTITIES[-1]}")
        if self.guard_band is not None and not self.needs_usable_range:
            raise MistakeAt(
                ("guard_band",), f"{self.quantity} has no standard error, so a guard band does not apply; remove it"
            )
        return self

    @model_validator(mode="after")
    def _field_of_errors(self) -> Self:
        if self.field is not None and not self.varies_over_picture:
            raise MistakeAt(
                ("field",), f"{self.quantity} is judged for the picture as a whole or on its axis; remove field"
            )
        return self

    @property
    def varies_over_picture(self) -> bool:
        """Whether the requirement is on a quantity that is judged at several places of the picture."""
        return self.quantity in ("depth_uncertainty", "failed_fraction")

    @property
    def asks_for_depth(self) -> bool:
        """Whether the requirement applies only to cameras that measure depth."""
        return self.quantity not in _OF_ANY_CAMERA

    @property
    def needs_usable_range(self) -> bool:
        """Whether a camera that measures depth must also be usable at the distances of the requirement."""
        return self.quantity not in _WITHOUT_USABLE_RANGE

    @property
    def over(self) -> tuple[float, ...]:
        """Nearest and farthest distance that count [m], equal if only one does; empty if there are none."""
        return () if isinstance(self.required, CriterionPart) else self.required.distances

    @property
    def quantity(self) -> str:
        """The required quantity."""
        return next(name for name in _QUANTITIES if getattr(self, name) is not None)

    @property
    def required(self) -> Required:
        """The bound on the quantity."""
        found: Required = getattr(self, self.quantity)
        return found

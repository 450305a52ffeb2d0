"""Questions of a study: decisions, readings of its assumptions, inverse questions, claims and sweeps."""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from tradestudy.cameras.depth_camera import UsableCriteria
from tradestudy.declarations.mistakes import MistakeAt
from tradestudy.declarations.part import Part
from tradestudy.declarations.quantities import (
    FNumber,
    ObjectDistance,
    PositiveFraction,
    PositiveLength,
    PositiveNumber,
    PositivePixels,
    PositiveWavelength,
    QuantityText,
    Share,
)
from tradestudy.declarations.words import CameraName, ErrorSources, Pair, Scalar, Span, Text, distinct
from tradestudy.study.schema.depth_of_field import BlurPart, Diffraction
from tradestudy.study.schema.light_spot import MethodName
from tradestudy.study.schema.wave_optics import ElementName, LensPhaseName, PositiveWaves, PsfMetric


class UsableRangePart(Part):
    """Limits of the usable range; a limit that is left out does not apply."""

    overlap: Share | None = Field(
        default=None, description="Smallest overlap of the two stereo views; default: any above 0 %."
    )
    availability: Share | None = Field(
        default=None,
        description="Smallest fraction of points that two microlenses of the estimator see; default: any above 0 %.",
    )
    virtual_depth: PositiveNumber | None = Field(
        default=None, description="Smallest magnitude of the virtual depth; it is 2 at the total covering plane."
    )
    blur: PositivePixels | None = Field(default=None, description="Largest geometric blur.")
    disparity_step: PositivePixels | None = Field(
        default=None, description="Smallest difference between the disparity at a usable distance and that at infinity."
    )
    failed_fraction: Share | None = Field(
        default=None, description="Largest fraction of measurements that end beyond infinity or are false matches."
    )
    relative_uncertainty: PositiveFraction | None = Field(
        default=None, description="Largest depth uncertainty, relative to the distance."
    )

    def criteria(self) -> UsableCriteria:
        """The limits in SI."""
        return UsableCriteria(
            overlap=self.overlap,
            availability=self.availability,
            virtual_depth=self.virtual_depth,
            blur_px=self.blur,
            disparity_step_px=self.disparity_step,
            failed_fraction=self.failed_fraction,
            relative_uncertainty=self.relative_uncertainty,
        )


class DecisionPart(Part):
    """The two cameras of the main question, and the distances at which the best camera is named."""

    between: Pair = Field(description="The two cameras of the main question.")
    at: Annotated[tuple[ObjectDistance, ...], Field(min_length=1, max_length=20), AfterValidator(distinct)] = Field(
        description="Distances at which the best camera is named."
    )
    compare: Annotated[tuple[Pair, ...], Field(max_length=20), AfterValidator(distinct)] = Field(
        default=(),
        description="Pairs for which the probability of ranking first is computed; default: that of the main question.",
    )
    candidates: Annotated[tuple[CameraName, ...], Field(min_length=1)] | None = Field(
        default=None,
        description="Cameras among which the best is named; default: all. Name each device once.",
    )

    @property
    def compared(self) -> tuple[Pair, ...]:
        """Pairs of cameras for which the probability of ranking first is computed."""
        return self.compare or (self.between,)


class ReadingPart(Part):
    """Another reading of the assumptions: values that replace those of the study."""

    says: Text = Field(description="What this reading assumes, in words.")
    set: Annotated[dict[str, Scalar], Field(min_length=1)] = Field(
        description="Values that replace those of the study, by path."
    )


class SolvePart(Part):
    """The values for which two cameras are equally certain, one is certain enough, or a requirement is met."""

    says: Text = Field(description="The question in words.")
    vary: Text | Annotated[tuple[Text, ...], Field(min_length=2, max_length=20), AfterValidator(distinct)] = Field(
        description="Path of the value to vary; several paths all take the same value."
    )
    low: QuantityText = Field(description="Smallest value to try.")
    high: QuantityText = Field(description="Largest value to try.")
    equal: Pair | None = Field(default=None, description="Two cameras that must be equally certain.")
    camera: CameraName | None = Field(
        default=None,
        description="Instead of equal: the camera that must reach the depth uncertainty given by relative or "
        "uncertainty.",
    )
    relative: PositiveFraction | None = Field(
        default=None, description="Depth uncertainty that the camera must reach, relative to the distance."
    )
    uncertainty: PositiveLength | None = Field(
        default=None, description="Instead of relative: the depth uncertainty that the camera must reach."
    )
    requirement: CameraName | None = Field(
        default=None, description="Instead of equal: the requirement to meet, on any quantity."
    )
    at: ObjectDistance | None = Field(
        default=None,
        description="Distance at which the cameras are compared or one must reach its uncertainty; omit it for a "
        "requirement.",
    )
    errors: ErrorSources = Field(default="both", description="Error sources to include.")

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if sum(one is not None for one in (self.equal, self.camera, self.requirement)) != 1:
            raise MistakeAt(
                (), "give one of equal (two cameras), camera (with relative or uncertainty) and requirement (a name)"
            )
        if (self.at is None) == (self.requirement is None):
            raise MistakeAt((), "equal and camera need at; a requirement has its own distances")
        goals = (self.relative is not None) + (self.uncertainty is not None)
        if goals != (self.camera is not None):
            raise MistakeAt(
                (), "camera and one of relative (uncertainty over distance) and uncertainty belong together"
            )
        return self

    @property
    def place(self) -> float:
        """Distance of the question [m]; NaN for a requirement, which has its own distances."""
        return math.nan if self.at is None else self.at

    @property
    def goal(self) -> float:
        """Depth uncertainty that the camera must reach [m]."""
        return self.uncertainty if self.uncertainty is not None else (self.relative or 0.0) * self.place

    @property
    def paths(self) -> tuple[str, ...]:
        """Paths of the values to vary."""
        return (self.vary,) if isinstance(self.vary, str) else self.vary


class ExpectPart(Part):
    """The expected value of a claim: a value or a bound."""

    about: QuantityText | None = Field(default=None, description="The expected value.")
    within: PositiveFraction | None = Field(default=None, description="Relative tolerance on the expected value.")
    above: QuantityText | None = Field(default=None, description="The result is expected to exceed this.")
    below: QuantityText | None = Field(default=None, description="The result is expected to stay below this.")

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if sum(part is not None for part in (self.about, self.above, self.below)) != 1:
            raise MistakeAt((), "give exactly one of about, above and below")
        if (self.about is None) != (self.within is None):
            raise MistakeAt((), "about and within belong together")
        return self


class _ClaimPart(Part):
    says: Text = Field(description="The claim in the words of its source.")
    source: Text = Field(description="Where the claim was published.")
    tolerance_reason: Text = Field(description="Why this expectation and tolerance follow from the source's wording.")
    expect: ExpectPart
    reading: CameraName | None = Field(
        default=None, description="The reading on which the claim rests; default: the study as declared."
    )
    under: tuple[CameraName, ...] | Literal["all"] = Field(
        default=(), description="Readings under which the claim is tested as well; all: every reading of the study."
    )


class LimitDistanceClaim(_ClaimPart):
    """Distance at which one limit of the usable range begins or ceases to hold, regardless of the others."""

    quantity: Literal["limit_distance"]
    camera: CameraName = Field(description="Camera that the claim is about.")
    limit: Literal[
        "overlap", "availability", "total_covering_plane", "focus", "last_disparity_step", "failed_fraction",
        "relative_uncertainty", "saturation", "matching",
    ] = Field(description="Limit whose distance is claimed.")  # fmt: skip
    end: Literal["near", "far"] = Field(description="Near or far end of the range.")


class UncertaintyRatioClaim(_ClaimPart):
    """Largest ratio of one camera's depth uncertainty to another's over a range of distances."""

    quantity: Literal["uncertainty_ratio"]
    camera: CameraName = Field(description="Camera whose uncertainty is the numerator.")
    against: CameraName = Field(description="Camera whose uncertainty is the denominator.")
    over: Span = Field(description="Distances that the claim covers: from, to.")
    errors: ErrorSources = Field(default="both", description="Error sources to include.")


class ShareBetterClaim(_ClaimPart):
    """Fraction of a range, on a log scale, where one camera is usable and the other is unusable or less certain."""

    quantity: Literal["share_better"]
    camera: CameraName = Field(description="Camera claimed to be more certain.")
    against: CameraName = Field(description="Camera that it is compared with.")
    over: Span = Field(description="Distances that the claim covers: from, to.")
    errors: ErrorSources = Field(default="both", description="Error sources to include.")


class RelativeUncertaintyDistanceClaim(_ClaimPart):
    """The distance beyond which depth uncertainty stays above a given fraction of the distance."""

    quantity: Literal["relative_uncertainty_distance"]
    camera: CameraName = Field(description="Camera that the claim is about.")
    threshold: PositiveFraction = Field(description="Depth uncertainty over distance.")
    errors: ErrorSources = Field(default="both", description="Error sources to include.")


class DepthOfFieldClaim(_ClaimPart, BlurPart):
    """Total depth of field of a camera: the sum of all ranges in which it is sharp."""

    quantity: Literal["depth_of_field"]
    camera: CameraName = Field(description="Camera that the claim is about.")


class DepthOfFieldRatioClaim(_ClaimPart):
    """Ratio of one camera's depth of field to another's, at equal blur or at equal resolution."""

    quantity: Literal["depth_of_field_ratio"]
    camera: CameraName = Field(description="Camera whose depth of field is the numerator.")
    against: CameraName = Field(description="Camera whose depth of field is the denominator.")
    blur: PositivePixels | None = Field(default=None, description="Blur on each sensor, as in depth_of_field.criteria.")
    diffraction: Diffraction | None = Field(
        default=None, description="Measure of the diffraction spot, with blur only; default: none."
    )
    resolution: PositiveLength | None = Field(
        default=None, description="Instead of blur: size of detail on the object that geometrical optics must resolve."
    )
    over: Span | None = Field(default=None, description="Distances that count; default: all.")

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if (self.blur is None) == (self.resolution is None):
            raise MistakeAt((), "give exactly one of blur and resolution")
        if self.diffraction is not None and self.blur is None:
            raise MistakeAt(("diffraction",), "belongs to blur; resolution is compared geometrically")
        return self


class PsfErrorClaim(_ClaimPart):
    """How far Fresnel's point-spread function on axis is from Kirchhoff's at one f-number."""

    quantity: Literal["psf_error"]
    element: ElementName = Field(description="Lens of fresnel_validity that the claim is about.")
    f_number: FNumber = Field(description="F-number at which the error is claimed.")
    wavelength: PositiveWavelength = Field(description="Wavelength at which the error is claimed.")
    lens_phase: LensPhaseName = Field(description="Phase of that lens.")
    metric: PsfMetric = Field(description="Metric that compares two point-spread functions.")
    window: PositiveNumber = Field(description="Radius of the compared window, in Airy radii.")


class FresnelFNumberClaim(_ClaimPart):
    """The minimum f-number from which Fresnel's point-spread function on axis errs by no more than a limit."""

    quantity: Literal["fresnel_f_number"]
    element: ElementName = Field(description="Lens of fresnel_validity that the claim is about.")
    error: PositiveFraction = Field(
        description="Largest error of Fresnel's point-spread function from that f-number on."
    )
    wavelength: PositiveWavelength = Field(description="Wavelength of the claim.")
    lens_phase: LensPhaseName = Field(description="Phase of that lens.")
    metric: PsfMetric = Field(description="Metric that compares two point-spread functions.")
    window: PositiveNumber = Field(description="Radius of the compared window, in Airy radii.")


class CriterionFNumberClaim(_ClaimPart):
    """The minimum f-number for Fresnel by one of the closed-form criteria."""

    quantity: Literal["criterion_f_number"]
    element: ElementName = Field(description="Lens of fresnel_validity that the claim is about.")
    criterion: Literal["paper-eq27-first-zero", "paper-eq27-second-zero", "path-error", "goodman"] = Field(
        description="Rule that gives the f-number."
    )
    wavelength: PositiveWavelength = Field(description="Wavelength of the claim.")
    path_error: PositiveWaves | None = Field(default=None, description="Path error, for the criterion path-error only.")

    @model_validator(mode="after")
    def _path_error_where_it_belongs(self) -> Self:
        if (self.criterion == "path-error") != (self.path_error is not None):
            raise MistakeAt(("path_error",), "is needed by the criterion path-error, and only by that one")
        return self


class ImageDifferenceClaim(_ClaimPart):
    """Sum of absolute differences between two pictures of the light spot, over the sum of the second."""

    quantity: Literal["image_difference"]
    method: MethodName = Field(description="Method whose picture is judged.")
    reference: MethodName = Field(description="Method whose picture it is compared with.")


class LitPixelsClaim(_ClaimPart):
    """Ratio of the numbers of pixels that two methods light, above a given fraction of the brightest pixel."""

    quantity: Literal["lit_pixels_ratio"]
    method: MethodName = Field(description="Method whose lit pixels are the numerator.")
    reference: MethodName = Field(description="Method whose lit pixels are the denominator.")
    above: PositiveFraction = Field(
        description="Fraction of the brightest pixel's light above which a pixel counts as lit."
    )


ClaimPart = Annotated[
    LimitDistanceClaim
    | UncertaintyRatioClaim
    | ShareBetterClaim
    | RelativeUncertaintyDistanceClaim
    | DepthOfFieldClaim
    | DepthOfFieldRatioClaim
    | PsfErrorClaim
    | FresnelFNumberClaim
    | CriterionFNumberClaim
    | ImageDifferenceClaim
    | LitPixelsClaim,
    Field(discriminator="quantity"),
]


SweepValues = Annotated[tuple[Scalar, ...], Field(min_length=1, max_length=1000)]


class SweepRangePart(Part):
    """Values from one end to another, on a linear or logarithmic scale; both ends are written with units."""

    start: QuantityText = Field(alias="from", description="First value.")
    stop: QuantityText = Field(alias="to", description="Last value.")
    points: Annotated[int, Field(ge=2, le=1000, strict=True)] = Field(
        description="How many values, both ends included."
    )
    spacing: Literal["log", "linear"] = Field(
        default="linear", description="Equal ratios (log) or equal differences (linear)."
    )

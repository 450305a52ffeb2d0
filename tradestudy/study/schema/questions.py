"""Questions of a study: decisions, readings of its assumptions, inverse questions, claims and sweeps."""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from tradestudy.cameras.depth_camera import UsableCriteria
from tradestudy.declarations.part import MistakeAt, Part
from tradestudy.declarations.quantities import (
    CameraName,
    ErrorSources,
    FNumber,
    ObjectDistance,
    Pair,
    PositiveFraction,
    PositiveLength,
    PositiveNumber,
    PositivePixels,
    PositiveWavelength,
    QuantityText,
    Scalar,
    Share,
    Span,
    Text,
    distinct,
)
from tradestudy.study.schema.depth_of_field import BlurPart, Diffraction
from tradestudy.study.schema.light_spot import MethodName
from tradestudy.study.schema.wave_optics import ElementName, LensPhaseName, PositiveWaves, PsfMetric


class UsableRangePart(Part):
    """Limits of the usable range. A limit that is left out does not apply, unless it has a default."""

    overlap: Share | None = Field(
        default=None, description="Smallest overlap of the two pictures of a stereo rig; default: any above 0 %."
    )
    availability: Share | None = Field(
        default=None,
        description="Smallest availability of a focused plenoptic camera. Availability is the fraction of object "
        "points that are seen by at least two of the microlenses that its estimator uses. Default: any above 0 %.",
    )
    virtual_depth: PositiveNumber | None = Field(
        default=None,
        description="Smallest magnitude of the virtual depth of a focused plenoptic camera; at the total covering "
        "plane, this magnitude is 2.",
    )
    blur: PositivePixels | None = Field(
        default=None,
        description="Largest diameter of the geometric blur, in pixels; for an unfocused plenoptic camera, 1 px here "
        "means one microlens. With several types of microlenses, this limit applies to the least sharp type that the "
        "estimator needs. A derived disparity error already contains defocus and needs no such limit.",
    )
    disparity_step: PositivePixels | None = Field(
        default=None,
        description="Smallest difference between the disparity at a usable distance and that at infinity.",
    )
    failed_fraction: Share | None = Field(
        default=None,
        description="Largest fraction of measurements that may fail. A measurement fails if its errors push the depth "
        "beyond infinity, or if its match is false.",
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
    """Two cameras to compare with each other, and the distances at which they are compared.

    At these distances, the report also names the best of all candidates.
    """

    between: Pair = Field(
        description="Two cameras for which the report gives the ratio of the first one's depth uncertainty to the "
        "second one's, and the crossovers."
    )
    at: Annotated[tuple[ObjectDistance, ...], Field(min_length=1, max_length=20), AfterValidator(distinct)] = Field(
        description="Distances at which the best candidate is named, and the two cameras are compared."
    )
    compare: Annotated[tuple[Pair, ...], Field(max_length=20), AfterValidator(distinct)] = Field(
        default=(),
        description="Pairs of cameras; for each camera of a pair, the program computes the probability that its "
        "depth error is the smaller one. Default: the pair in `between`.",
    )
    candidates: Annotated[tuple[CameraName, ...], Field(min_length=1), AfterValidator(distinct)] | None = Field(
        default=None,
        description="Cameras among which the best is chosen; default: all that measure depth. Of several cameras that "
        "model the same device, list only one.",
    )

    @property
    def compared(self) -> tuple[Pair, ...]:
        """Pairs of cameras for which the probability of ranking first is computed."""
        return self.compare or (self.between,)


class ReadingPart(Part):
    """Another reading of the study's assumptions: values that replace the declared ones."""

    says: Text = Field(description="What this reading assumes, in words.")
    set: Annotated[dict[str, Scalar], Field(min_length=1)] = Field(
        description="The new values, each under the path of the value that it replaces; `null` removes the value at "
        "that path."
    )


RequirementNames = Annotated[tuple[CameraName, ...], Field(min_length=2, max_length=20), AfterValidator(distinct)]


class SolvePart(Part):
    """The values of an input at which a condition holds.

    The condition is that two cameras have the same depth uncertainty, that one camera has a given depth uncertainty, or
    that a requirement begins or ceases to be met.
    """

    says: Text = Field(description="The question in words.")
    vary: Text | Annotated[tuple[Text, ...], Field(min_length=2, max_length=20), AfterValidator(distinct)] = Field(
        description="Path of the value to vary, or paths of several values, which are kept equal."
    )
    low: QuantityText = Field(description="Smallest value to try, above 0, with its unit.")
    high: QuantityText = Field(description="Largest value to try, with its unit.")
    equal: Pair | None = Field(default=None, description="Two cameras that must have the same depth uncertainty.")
    camera: CameraName | None = Field(
        default=None,
        description="Instead of `equal`: the camera that must reach the depth uncertainty given by `relative` or "
        "`uncertainty`.",
    )
    relative: PositiveFraction | None = Field(
        default=None, description="Depth uncertainty that the camera must reach, relative to the distance."
    )
    uncertainty: PositiveLength | None = Field(
        default=None, description="Instead of `relative`: the depth uncertainty that the camera must reach."
    )
    requirement: CameraName | RequirementNames | None = Field(
        default=None,
        description="Instead of `equal` or `camera`: name of the requirement to meet, or names of several that must "
        "all be met.",
    )
    at: ObjectDistance | None = Field(
        default=None,
        description="Distance at which the two cameras are compared, or at which the camera must reach the depth "
        "uncertainty; a requirement has its own distances.",
    )
    errors: ErrorSources = Field(
        default="both",
        description="Error sources that count: noise, calibration errors, or both. For a requirement, both count.",
    )

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
    def requirements(self) -> tuple[str, ...]:
        """Names of the requirements to meet; empty for another condition."""
        return (self.requirement,) if isinstance(self.requirement, str) else self.requirement or ()

    @property
    def paths(self) -> tuple[str, ...]:
        """Paths of the values to vary."""
        return (self.vary,) if isinstance(self.vary, str) else self.vary


class ExpectPart(Part):
    """The result to be expected if the claim is true: a value with a tolerance, or a bound."""

    about: QuantityText | None = Field(default=None, description="Expected value, with its unit.")
    within: PositiveFraction | None = Field(
        default=None, description="Relative tolerance on the expected value; needed with `about`."
    )
    above: QuantityText | None = Field(
        default=None, description="Instead of `about`: value that the result is expected to exceed, with its unit."
    )
    below: QuantityText | None = Field(
        default=None, description="Instead of `about`: value below which the result is expected to stay, with its unit."
    )

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
    tolerance_reason: Text = Field(
        description="Why the expected result and its tolerance follow from the wording of the source."
    )
    expect: ExpectPart
    reading: CameraName | None = Field(
        default=None, description="Reading under which the claim is tested; default: the study as declared."
    )
    under: tuple[CameraName, ...] | Literal["all"] = Field(
        default=(),
        description="Further readings under which the claim is tested; `all` stands for every reading of the study.",
    )


class LimitDistanceClaim(_ClaimPart):
    """A claim about the distance from which, or up to which, a camera meets one limit of the usable range.

    The other limits are ignored.
    """

    quantity: Literal["limit_distance"]
    camera: CameraName = Field(description="Camera that the claim is about.")
    limit: Literal[
        "overlap", "availability", "total_covering_plane", "focus", "last_disparity_step", "disparity_range",
        "failed_fraction", "relative_uncertainty", "saturation", "matching",
    ] = Field(
        description="Limit that the claim is about. Some names differ from those in usable_range: "
        "`total_covering_plane` is the limit on virtual_depth, `focus` that on blur, and `last_disparity_step` that on "
        "disparity_step. `disparity_range` is the limit on the disparities that the matcher of a rig searches. "
        "The limits `saturation` and `matching` apply only to a derived disparity error. `saturation` "
        "is met where no pixel saturates. `matching` is met where a real matcher can come close to the Cramér–Rao "
        "bound on the disparity error: where this bound is at most 0.25 px, and the matching window is large enough "
        "for the blur and the texture."
    )  # fmt: skip
    end: Literal["near", "far"] = Field(
        description="Whether the distance is the one from which (`near`) or up to which (`far`) the limit is met."
    )


class UncertaintyRatioClaim(_ClaimPart):
    """A claim about the largest ratio of one camera's depth uncertainty to another's over a range of distances."""

    quantity: Literal["uncertainty_ratio"]
    camera: CameraName = Field(description="Camera whose uncertainty is the numerator.")
    against: CameraName = Field(description="Camera whose uncertainty is the denominator.")
    over: Span = Field(description="Nearest and farthest distance that the claim covers.")
    errors: ErrorSources = Field(
        default="both", description="Error sources that count: noise, calibration errors, or both."
    )


class ShareBetterClaim(_ClaimPart):
    """A claim about the fraction of a range of distances over which one camera is better than another.

    The first is better where it is usable and the other is either unusable or has the larger depth uncertainty. The
    fraction is measured on a logarithmic scale of distance.
    """

    quantity: Literal["share_better"]
    camera: CameraName = Field(description="Camera that is claimed to be better.")
    against: CameraName = Field(description="The other camera.")
    over: Span = Field(description="Nearest and farthest distance that the claim covers.")
    errors: ErrorSources = Field(
        default="both", description="Error sources that count: noise, calibration errors, or both."
    )


class RelativeUncertaintyDistanceClaim(_ClaimPart):
    """A claim about the distance beyond which the relative depth uncertainty exceeds a threshold.

    If it does so at no distance of the study, or at all of them, the distance is sought beyond these, down to 1 mm and
    out to 100 km.
    """

    quantity: Literal["relative_uncertainty_distance"]
    camera: CameraName = Field(description="Camera that the claim is about.")
    threshold: PositiveFraction = Field(
        description="Threshold for the depth uncertainty, as a fraction of the distance."
    )
    errors: ErrorSources = Field(
        default="both", description="Error sources that count: noise, calibration errors, or both."
    )


class DepthOfFieldClaim(_ClaimPart, BlurPart):
    """A claim about the total depth of field of a camera: the summed lengths of all ranges in which it is sharp."""

    quantity: Literal["depth_of_field"]
    camera: CameraName = Field(description="Camera that the claim is about.")


class DepthOfFieldRatioClaim(_ClaimPart):
    """A claim about the ratio of one camera's depth of field to another's, at equal blur or at equal resolution."""

    quantity: Literal["depth_of_field_ratio"]
    camera: CameraName = Field(description="Camera whose depth of field is the numerator.")
    against: CameraName = Field(description="Camera whose depth of field is the denominator.")
    blur: PositivePixels | None = Field(
        default=None, description="Largest blur for both cameras, as in depth_of_field.criteria."
    )
    diffraction: Diffraction | None = Field(
        default=None,
        description="How the diffraction spot counts, as in depth_of_field.criteria; only with `blur`. Default: "
        "`none`.",
    )
    resolution: PositiveLength | None = Field(
        default=None,
        description="Instead of `blur`: size of the smallest detail on the object that both cameras must resolve "
        "according to geometrical optics.",
    )
    over: Span | None = Field(
        default=None, description="Nearest and farthest of the distances that count; default: all distances."
    )

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if (self.blur is None) == (self.resolution is None):
            raise MistakeAt((), "give exactly one of blur and resolution")
        if self.diffraction is not None and self.blur is None:
            raise MistakeAt(("diffraction",), "belongs to blur; resolution is compared geometrically")
        return self


_METRIC = (
    "Measure of the error: the difference in intensity at the image point, relative to Kirchhoff's intensity there "
    "(`peak`); the absolute difference integrated over the window, relative to the integral of Kirchhoff's intensity "
    "(`l1`); or the largest difference in the window, relative to Kirchhoff's largest intensity there (`largest`)."
)


class PsfErrorClaim(_ClaimPart):
    """A claim about the error of the point-spread function in Fresnel's approximation, on axis at one f-number.

    The error is relative to the point-spread function that Kirchhoff's integral gives.
    """

    quantity: Literal["psf_error"]
    element: ElementName = Field(description="Lens that the claim is about, by its name in fresnel_validity.elements.")
    f_number: FNumber = Field(description="F-number at which the error is claimed.")
    wavelength: PositiveWavelength = Field(description="Wavelength at which the error is claimed.")
    lens_phase: LensPhaseName = Field(
        description="Phase that this lens adds; see light_spot.main_lens.lens_phase for the meaning of the names."
    )
    metric: PsfMetric = Field(description=_METRIC)
    window: PositiveNumber = Field(
        description="Radius of the window around the image point, in Airy radii; no effect on the metric `peak`."
    )


class FresnelFNumberClaim(_ClaimPart):
    """A claim about the smallest f-number at which Fresnel's approximation is still accurate enough, on axis.

    Accuracy is judged by the error of the point-spread function in Fresnel's approximation, relative to the
    point-spread function that Kirchhoff's integral gives.
    """

    quantity: Literal["fresnel_f_number"]
    element: ElementName = Field(description="Lens that the claim is about, by its name in fresnel_validity.elements.")
    error: PositiveFraction = Field(
        description="Largest acceptable error of the point-spread function at the claimed f-number and above."
    )
    wavelength: PositiveWavelength = Field(description="Wavelength to which the claim applies.")
    lens_phase: LensPhaseName = Field(
        description="Phase that this lens adds; see light_spot.main_lens.lens_phase for the meaning of the names."
    )
    metric: PsfMetric = Field(description=_METRIC)
    window: PositiveNumber = Field(
        description="Radius of the window around the image point, in Airy radii; no effect on the metric `peak`."
    )


class CriterionFNumberClaim(_ClaimPart):
    """A claim about the minimum f-number that a closed-form criterion gives for Fresnel's approximation."""

    quantity: Literal["criterion_f_number"]
    element: ElementName = Field(description="Lens that the claim is about, by its name in fresnel_validity.elements.")
    criterion: Literal["paper-eq27-first-zero", "paper-eq27-second-zero", "path-error", "goodman"] = Field(
        description="Criterion that gives the f-number: `paper-eq27-first-zero` (the solution of the paper's equation "
        "27 with the smallest aperture, and thus the largest f-number of all its solutions), `paper-eq27-second-zero` "
        "(the solution with the next larger aperture), `path-error` (a bound on the optical path that the "
        "approximation neglects) or `goodman` (Goodman's condition)."
    )
    wavelength: PositiveWavelength = Field(description="Wavelength to which the claim applies.")
    path_error: PositiveWaves | None = Field(
        default=None,
        description="Largest optical path that may be neglected; needed with the criterion "
        "`path-error`, and only with it.",
    )

    @model_validator(mode="after")
    def _path_error_where_it_belongs(self) -> Self:
        if (self.criterion == "path-error") != (self.path_error is not None):
            raise MistakeAt(("path_error",), "is needed by the criterion path-error, and only by that one")
        return self


class ImageDifferenceClaim(_ClaimPart):
    """A claim about the difference between two pictures of the light spot.

    The difference is the sum of the absolute differences of pixel values, relative to the sum of the values of the
    second picture.
    """

    quantity: Literal["image_difference"]
    method: MethodName = Field(
        description="Method to be tested, which computes the first picture; see light_spot.methods."
    )
    reference: MethodName = Field(description="Method of the second picture.")


class LitPixelsClaim(_ClaimPart):
    """A claim about the number of lit pixels in one method's picture, divided by the number in another method's."""

    quantity: Literal["lit_pixels_ratio"]
    method: MethodName = Field(
        description="Method whose number of lit pixels is the numerator; see light_spot.methods."
    )
    reference: MethodName = Field(description="Method whose number of lit pixels is the denominator.")
    above: PositiveFraction = Field(
        description="A pixel counts as lit if it gets more than this fraction of the light of the brightest pixel in "
        "its picture."
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
    """A range of values of one input, in linear or logarithmic steps. The key is the path of the input."""

    start: QuantityText = Field(alias="from", description="First value, with its unit.")
    stop: QuantityText = Field(alias="to", description="Last value, with its unit.")
    points: Annotated[int, Field(ge=2, le=1000, strict=True)] = Field(
        description="Number of values, including both ends."
    )
    spacing: Literal["log", "linear"] = Field(
        default="linear", description="Spacing of the values: equal ratios (log) or equal differences (linear)."
    )

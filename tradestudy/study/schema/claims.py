"""Claims of a study: published statements, the results by which they would be true, and what they need."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Literal

from pydantic import Field

from tradestudy.declarations.part import MistakeAt, Part, nearest_name
from tradestudy.declarations.quantities import (
    CameraName,
    ErrorSources,
    FNumber,
    PositiveFraction,
    PositiveLength,
    PositiveNumber,
    PositivePixels,
    PositiveWavelength,
    QuantityText,
    Span,
    Text,
)
from tradestudy.study.schema.questions import BlurPart, Diffraction
from tradestudy.study.schema.wave_optics import (
    ElementName,
    FresnelValidityPart,
    LensPhaseName,
    LightSpotPart,
    MethodName,
    PositiveWaves,
    PsfMetric,
)
from tradestudy.units import FRACTION, LENGTH, NUMBER, Dimension, parse


class ExpectPart(Part):
    """The result to be expected if the claim is true: a value with a tolerance, or a bound."""

    exactly_one = (("about", "above", "below"),)

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

    def _mistakes(self) -> Iterator[MistakeAt]:
        if (self.about is None) != (self.within is None):
            yield MistakeAt((), "about and within belong together")


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

    exactly_one = (("blur", "resolution"),)

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

    def _mistakes(self) -> Iterator[MistakeAt]:
        if self.diffraction is not None and self.blur is None:
            yield MistakeAt(("diffraction",), "belongs to blur; resolution is compared geometrically")


class _ErrorOfPsfPart(_ClaimPart):
    """A claim about the error of a point-spread function in Fresnel's approximation."""

    element: ElementName = Field(description="Lens that the claim is about, by its name in fresnel_validity.elements.")
    lens_phase: LensPhaseName = Field(
        description="Phase that this lens adds; see light_spot.main_lens.lens_phase for the meaning of the names."
    )
    metric: PsfMetric = Field(
        description="Measure of the error: the difference in intensity at the image point, relative to Kirchhoff's "
        "intensity there (`peak`); the absolute difference integrated over the window, relative to the integral of "
        "Kirchhoff's intensity (`l1`); or the largest difference in the window, relative to Kirchhoff's largest "
        "intensity there (`largest`)."
    )
    window: PositiveNumber = Field(
        description="Radius of the window around the image point, in Airy radii; no effect on the metric `peak`."
    )


class PsfErrorClaim(_ErrorOfPsfPart):
    """A claim about the error of the point-spread function in Fresnel's approximation, on axis at one f-number.

    The error is relative to the point-spread function that Kirchhoff's integral gives.
    """

    quantity: Literal["psf_error"]
    f_number: FNumber = Field(description="F-number at which the error is claimed.")
    wavelength: PositiveWavelength = Field(description="Wavelength at which the error is claimed.")


class FresnelFNumberClaim(_ErrorOfPsfPart):
    """A claim about the smallest f-number at which Fresnel's approximation is still accurate enough, on axis.

    Accuracy is judged by the error of the point-spread function in Fresnel's approximation, relative to the
    point-spread function that Kirchhoff's integral gives.
    """

    quantity: Literal["fresnel_f_number"]
    error: PositiveFraction = Field(
        description="Largest acceptable error of the point-spread function at the claimed f-number and above."
    )
    wavelength: PositiveWavelength = Field(description="Wavelength to which the claim applies.")


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

    def _mistakes(self) -> Iterator[MistakeAt]:
        if (self.criterion == "path-error") != (self.path_error is not None):
            yield MistakeAt(("path_error",), "is needed by the criterion path-error, and only by that one")


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


def claim_dimension(claim: ClaimPart) -> Dimension:
    """The dimension of a claim's value."""
    match claim:
        case LimitDistanceClaim() | RelativeUncertaintyDistanceClaim() | DepthOfFieldClaim():
            return LENGTH
        case UncertaintyRatioClaim() | DepthOfFieldRatioClaim():
            return NUMBER
        case ShareBetterClaim() | PsfErrorClaim() | ImageDifferenceClaim():
            return FRACTION
        case FresnelFNumberClaim() | CriterionFNumberClaim() | LitPixelsClaim():
            return NUMBER


def expectation_bounds(claim: ClaimPart) -> float:
    """The expected value or bound of a claim in the SI unit of its quantity.

    Raises
    ------
    UnitError
        If it is not a value of that quantity.
    """
    expect = claim.expect
    text = next(text for text in (expect.about, expect.above, expect.below) if text is not None)
    return parse(text, claim_dimension(claim))


def wave_claim_mistakes(
    claims: Mapping[str, ClaimPart], fresnel: FresnelValidityPart | None, spot: LightSpotPart | None
) -> list[MistakeAt]:
    """Claims that name lenses or methods missing from the study."""
    elements = () if fresnel is None else tuple(fresnel.elements)
    methods = () if spot is None else spot.methods
    mistakes: list[MistakeAt] = []
    for key, claim in claims.items():
        if isinstance(claim, PsfErrorClaim | FresnelFNumberClaim | CriterionFNumberClaim):
            if claim.element not in elements:
                what = f"fresnel_validity has no element {claim.element!r}{nearest_name(claim.element, elements)}"
                mistakes.append(MistakeAt(("claims", key, "element"), what))
        elif isinstance(claim, ImageDifferenceClaim | LitPixelsClaim):
            mistakes += [
                MistakeAt(("claims", key, word), f"{name!r} is not one of light_spot.methods")
                for word, name in (("method", claim.method), ("reference", claim.reference))
                if name not in methods
            ]
    return mistakes

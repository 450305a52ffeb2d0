"""Cameras as a study file describes them."""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from tradestudy.declarations.mistakes import MistakeAt
from tradestudy.declarations.part import Part
from tradestudy.declarations.quantities import (
    Angle,
    Baseline,
    Count,
    DetailSize,
    FNumber,
    FocalLength,
    Length,
    LensToSensor,
    MicrolensPitch,
    ObjectDistance,
    ObjectDistanceOrInfinity,
    PixelPitch,
    PositiveAngle,
    PositiveCount,
    PositiveDuration,
    PositiveLength,
    PositivePixels,
    ThermalExpansion,
)

AttributeName = Annotated[str, Field(pattern=r"^[a-z][\w -]*$", max_length=60)]
PixelCount = Annotated[int, Field(ge=1, le=1_000_000, strict=True)]


class LensPart(Part):
    """A lens: its focal length, or the field of view that gives it, and its f-number."""

    focal_length: FocalLength | None = Field(default=None, description="Focal length f.")
    field_of_view: PositiveAngle | None = Field(
        default=None, description="Full angle when focused at infinity, instead of a focal length."
    )
    across: Literal["width", "diagonal"] | None = Field(
        default=None, description="What of the sensor the field of view covers."
    )
    f_number: FNumber = Field(description="Focal length over pupil diameter.")

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if (self.focal_length is None) == (self.field_of_view is None):
            raise MistakeAt((), "give exactly one of focal_length and field_of_view (null takes an inherited one back)")
        if (self.field_of_view is None) != (self.across is None):
            raise MistakeAt((), "field_of_view and across (width or diagonal) belong together")
        if self.field_of_view is not None and not self.field_of_view < math.pi:
            raise MistakeAt(("field_of_view",), "a flat sensor sees less than 180°")
        return self


class SensorPart(Part):
    """A pixel array."""

    pixels: tuple[PixelCount, PixelCount] = Field(description="Columns and rows.")
    pixel_pitch: PixelPitch = Field(description="Distance of neighbouring pixel centres.")


class MicrolensesPart(Part):
    """The microlens array."""

    layout: Literal["hexagonal", "square"]
    pitch: MicrolensPitch = Field(description="Distance of neighbouring microlens centres.")
    gap: LensToSensor | Literal["f-number-matching"] = Field(
        description="Array to sensor; f-number-matching makes it pitch × mla_distance / pupil diameter."
    )
    types: Literal[1, 3] = Field(default=1, description="Kinds of microlenses, by focal length.")
    focal_lengths: tuple[FocalLength, ...] | None = Field(
        default=None,
        description="One per type; left out, they are designed so that their depths of field touch, at one "
        "pixel of blur, from the total covering plane on.",
    )
    aperture_diameter: MicrolensPitch | None = Field(default=None, description="Of one microlens; default: the pitch.")

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.focal_lengths is not None and len(self.focal_lengths) != self.types:
            raise MistakeAt(
                ("focal_lengths",),
                f"{len(self.focal_lengths)} focal lengths for {self.types} types: give one for each type",
            )
        if self.layout == "square" and self.types != 1:
            raise MistakeAt(("types",), "three types do not tile a square array evenly; use layout: hexagonal")
        if self.aperture_diameter is not None and self.aperture_diameter > self.pitch:
            raise MistakeAt(("aperture_diameter",), "the microlenses overlap: at most the pitch")
        return self


class FocusPart(Part):
    """Where the array stands: directly, or by the plane from which a pair of microlenses sees every point."""

    mla_distance: LensToSensor | None = Field(default=None, description="Main lens to array z.")
    total_covering_plane: ObjectDistanceOrInfinity | None = Field(
        default=None, description="Object distance at which |virtual depth| is 2; may be infinity."
    )
    relay: Literal["keplerian", "galilean"] | None = Field(
        default=None, description="Image of the main lens before (keplerian) or behind (galilean) the array."
    )

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if (self.mla_distance is None) == (self.total_covering_plane is None):
            raise MistakeAt((), "give exactly one of mla_distance and total_covering_plane")
        if (self.total_covering_plane is None) != (self.relay is None):
            raise MistakeAt((), "total_covering_plane and relay belong together")
        return self


class DisparityPart(Part):
    """How well disparity is measured."""

    disparity_error: PositivePixels | Literal["derived"] = Field(
        description="Standard deviation of one measurement; derived: the Cramér–Rao bound of matching in the picture "
        "of the scene's texture (scene.picture)."
    )
    error_of: Literal["disparity", "coordinate"] = Field(
        default="disparity",
        description="Whether the error is that of the disparity or of each image coordinate (× √2).",
    )
    discrimination_step: PositivePixels = Field(description="Disparity step of the depth discrimination.")

    @model_validator(mode="after")
    def _derived_is_of_the_disparity(self) -> Self:
        if self.disparity_error == "derived" and self.error_of == "coordinate":
            raise MistakeAt(("error_of",), "a derived error is that of the disparity; leave error_of out")
        return self

    @property
    def declared_error_px(self) -> float | None:
        """Of the disparity [px], whichever way it was given; None where it is derived."""
        if self.disparity_error == "derived":
            return None
        return self.disparity_error * (math.sqrt(2.0) if self.error_of == "coordinate" else 1.0)


class UnfocusedMicrolensesPart(Part):
    """The microlens array of an unfocused plenoptic camera, one focal length before the sensor."""

    layout: Literal["hexagonal", "square"]
    pitch: MicrolensPitch = Field(description="Distance of neighbouring microlens centres: the lateral sample.")
    focal_length: FocalLength | Literal["f-number-matching"] = Field(
        description="Also the distance to the sensor; f-number-matching makes it pitch × mla_distance / pupil diameter."
    )
    aperture_diameter: MicrolensPitch | None = Field(default=None, description="Of one microlens; default: the pitch.")
    f_number: FNumber | None = Field(
        default=None, description="Of one microlens, focal length over aperture diameter, instead of that diameter."
    )

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if self.aperture_diameter is not None and self.f_number is not None:
            raise MistakeAt((), "give at most one of aperture_diameter and f_number")
        return self


class UnfocusedFocusPart(Part):
    """Where an unfocused plenoptic camera is focused."""

    distance: ObjectDistance = Field(description="Object distance whose image falls on the microlenses.")


class ReferenceScalePart(Part):
    """What a data sheet says of one focus: it tells where the principal plane lies behind the front of the lens."""

    working_distance: ObjectDistance = Field(description="From the front of the lens.")
    image_scale: DetailSize = Field(description="Size that one pixel covers on the object.")


class FocusStackPart(Part):
    """A stack of images at different focus, as few as cover the range but no more than it may have."""

    start: ObjectDistance = Field(alias="from", description="Nearest distance to cover.")
    stop: ObjectDistanceOrInfinity = Field(alias="to", description="Farthest distance to cover; may be infinity.")
    images: PositiveCount = Field(description="The most images of one stack.")
    time_per_image: PositiveDuration | None = Field(
        default=None, description="From one image to the next, refocusing included."
    )

    @model_validator(mode="after")
    def _increasing(self) -> Self:
        if not self.start < self.stop:
            raise MistakeAt(("to",), "must lie beyond from")
        return self


class ConventionalFocusPart(Part):
    """Where a conventional camera is focused: by distance, by image scale, or by a working distance of a data sheet."""

    distance: ObjectDistanceOrInfinity | None = Field(
        default=None, description="Object to the principal plane of the lens."
    )
    image_scale: DetailSize | None = Field(
        default=None, description="Size that one pixel covers on the object in focus."
    )
    working_distance: ObjectDistance | None = Field(
        default=None, description="Object to the front of the lens; needs a reference."
    )
    reference: ReferenceScalePart | None = None
    stack: FocusStackPart | None = Field(default=None, description="A focus stack instead of a single image.")

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        ways = (self.distance, self.image_scale, self.working_distance)
        if sum(way is not None for way in ways) != 1:
            raise MistakeAt((), "give exactly one of distance, image_scale and working_distance")
        if self.working_distance is not None and self.reference is None:
            raise MistakeAt(
                ("working_distance",),
                "counts from the front of the lens; give a reference (working_distance and image_scale at one focus)",
            )
        return self


class PlenopticDepthPart(DisparityPart):
    """Depth by micro-images."""

    estimator: Literal["adjacent-pair", "same-type-pair", "widest-pair", "least-squares"]
    lenses: Literal["all", "sharpest-type"] | None = Field(
        default=None,
        description="Microlenses that widest-pair and least-squares use; default: sharpest-type.",
    )

    @model_validator(mode="after")
    def _choice(self) -> Self:
        if self.lenses is not None and self.estimator in ("adjacent-pair", "same-type-pair"):
            raise MistakeAt(("lenses",), f"the estimator {self.estimator} has no choice of lenses; leave it out")
        return self


class UnfocusedDepthPart(DisparityPart):
    """Depth by the views through parts of the pupil; a px of disparity is one microlens, the sample of a view."""

    estimator: Literal["outermost-views", "least-squares"]


class StereoDepthPart(DisparityPart):
    """Depth by two cameras."""

    estimator: Literal["disparity", "midpoint"]


class _ErrorPart(Part):
    @model_validator(mode="after")
    def _one_shape(self) -> Self:
        values = self.model_dump()
        if (values["standard_deviation"] is None) == (values["half_width"] is None):
            raise MistakeAt((), "give standard_deviation (a normal error) or half_width (a uniform one)")
        return self


class LengthErrorPart(_ErrorPart):
    """An error of a length: normal by its standard deviation, or uniform by its half width."""

    standard_deviation: PositiveLength | None = None
    half_width: PositiveLength | None = None


class AngleErrorPart(_ErrorPart):
    """An error of an angle: normal by its standard deviation, or uniform by its half width."""

    standard_deviation: PositiveAngle | None = None
    half_width: PositiveAngle | None = None


class NormalLengthErrorPart(Part):
    """A normal error of a length."""

    standard_deviation: PositiveLength


class PlenopticCalibrationPart(Part):
    """Calibration errors of a plenoptic camera; none may be left out, for none is zero."""

    mla_distance: NormalLengthErrorPart
    focal_length: NormalLengthErrorPart
    correlation: Annotated[float, Field(ge=-1.0, le=1.0, strict=True)] = Field(
        description="Between mla_distance and focal_length: calibration fixes their difference best."
    )
    microlens_gap: LengthErrorPart


class StereoCalibrationPart(Part):
    """Calibration errors of a stereo rig, each one draw per rig."""

    yaw: AngleErrorPart
    pitch: AngleErrorPart | None = None
    roll: AngleErrorPart | None = None
    baseline: LengthErrorPart | None = None
    focal_length: LengthErrorPart | None = Field(
        default=None, description="Of the common principal distance, as a calibration in pixels gives it."
    )
    principal_point: LengthErrorPart | None = None


class StatedPart(Part):
    """What a data sheet or paper states and the other values already decide: cross-checked, never used."""

    field_of_view: Angle | None = None
    microlens_gap: Length | None = None
    mla_distance: Length | None = None
    hyperfocal_distance: Length | None = None
    depth_of_field: PositiveLength | None = Field(default=None, description="Of one image of a conventional camera.")


class AttributesPart(Part):
    """What decides a trade besides curves, declared; what is left out is derived where the other inputs allow it."""

    moving_parts: Count | None = Field(
        default=None, description="Default: one for each lens that is refocused by a mechanism."
    )
    bits_per_pixel: PositiveCount | None = Field(default=None, description="Of a raw image; data volumes need it.")
    envelope: tuple[PositiveLength, PositiveLength, PositiveLength] | None = Field(
        default=None, description="Length, width and height of the whole instrument."
    )
    others: dict[AttributeName, Annotated[str, Field(min_length=1, max_length=200)]] = Field(
        default={}, description="Anything else worth a row of the comparison, in words."
    )


class _CameraPart(Part):
    title: str = Field(min_length=1, max_length=80, description="Name in figures and tables.")
    note: str | None = Field(default=None, max_length=2000, description="What a reader should know about it.")
    stated: StatedPart | None = None
    attributes: AttributesPart = AttributesPart()


class FocusedPlenopticPart(_CameraPart):
    """A focused plenoptic camera (plenoptic II), of one or of several microlens types."""

    kind: Literal["focused-plenoptic"]
    main_lens: LensPart
    sensor: SensorPart
    microlenses: MicrolensesPart
    focus: FocusPart
    depth: PlenopticDepthPart
    calibration: PlenopticCalibrationPart
    thermal_expansion: ThermalExpansion | None = Field(
        default=None, description="Of what holds its parts apart; default: that of scene.temperature."
    )


class UnfocusedPlenopticPart(_CameraPart):
    """An unfocused plenoptic camera (plenoptic I)."""

    kind: Literal["unfocused-plenoptic"]
    main_lens: LensPart
    sensor: SensorPart
    microlenses: UnfocusedMicrolensesPart
    focus: UnfocusedFocusPart
    depth: UnfocusedDepthPart
    calibration: PlenopticCalibrationPart
    thermal_expansion: ThermalExpansion | None = Field(
        default=None, description="Of what holds its parts apart; default: that of scene.temperature."
    )


class ConventionalPart(_CameraPart):
    """A conventional camera of fixed focus, or with a mechanism that takes a focus stack; it measures no depth."""

    kind: Literal["conventional"]
    lens: LensPart
    sensor: SensorPart
    focus: ConventionalFocusPart


class StereoPart(_CameraPart):
    """A stereo rig of two equal cameras."""

    kind: Literal["stereo"]
    lenses: LensPart
    sensor: SensorPart
    baseline: Baseline
    axes_meet_at: ObjectDistanceOrInfinity = Field(description="Where the optical axes meet; infinity is parallel.")
    focus_distance: ObjectDistanceOrInfinity | Literal["every-object"] = Field(
        description="Where the lenses are focused; every-object: a mechanism refocuses them."
    )
    principal_distance: Literal["focal_length", "focused"] = Field(
        default="focal_length",
        description="Lens to sensor, which turns disparity into depth: the focal length (as of a calibration in "
        "pixels, or focused at infinity), or the image distance of focus_distance.",
    )
    depth: StereoDepthPart
    calibration: StereoCalibrationPart
    thermal_expansion: ThermalExpansion | None = Field(
        default=None, description="Of what holds its parts apart; default: that of scene.temperature."
    )

    @model_validator(mode="after")
    def _one_focus(self) -> Self:
        if self.principal_distance == "focused" and self.focus_distance == "every-object":
            raise MistakeAt(
                ("principal_distance",),
                "lenses that refocus on every object have no one distance to the sensor; give a focus_distance, or "
                "focal_length here",
            )
        return self


CameraPart = Annotated[
    FocusedPlenopticPart | UnfocusedPlenopticPart | StereoPart | ConventionalPart, Field(discriminator="kind")
]


def measures_depth(part: CameraPart) -> bool:
    """Whether a camera measures depth by triangulation."""
    return not isinstance(part, ConventionalPart)

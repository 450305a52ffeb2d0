"""Cameras as a study file describes them."""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from tradestudy.study.mistakes import MistakeAt
from tradestudy.study.schema.base import Part
from tradestudy.study.schema.quantities import (
    Angle,
    Length,
    PositiveAngle,
    PositiveLength,
    PositiveLengthOrInfinity,
    PositiveNumber,
    PositivePixels,
)

PixelCount = Annotated[int, Field(ge=1, le=100_000, strict=True)]


class LensPart(Part):
    """A lens: its focal length, or the field of view that gives it, and its f-number."""

    focal_length: PositiveLength | None = Field(default=None, description="Focal length f.")
    field_of_view: PositiveAngle | None = Field(default=None, description="Full angle, instead of a focal length.")
    across: Literal["width", "diagonal"] | None = Field(
        default=None, description="What of the sensor the field of view covers."
    )
    f_number: PositiveNumber = Field(description="Focal length over pupil diameter.")

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
    pixel_pitch: PositiveLength = Field(description="Distance of neighbouring pixel centres.")


class MicrolensesPart(Part):
    """The microlens array."""

    layout: Literal["hexagonal", "square"]
    pitch: PositiveLength = Field(description="Distance of neighbouring microlens centres.")
    gap: PositiveLength | Literal["f-number-matching"] = Field(
        description="Array to sensor; f-number-matching makes it pitch × mla_distance / pupil diameter."
    )
    types: Literal[1, 3] = Field(default=1, description="Kinds of microlenses, by focal length.")
    focal_lengths: tuple[PositiveLength, ...] | None = Field(
        default=None,
        description="One per type; left out, they are designed so that their depths of field touch, at one "
        "pixel of blur, from the total covering plane on.",
    )
    aperture_diameter: PositiveLength | None = Field(default=None, description="Of one microlens; default: the pitch.")

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

    mla_distance: PositiveLength | None = Field(default=None, description="Main lens to array z.")
    total_covering_plane: PositiveLengthOrInfinity | None = Field(
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

    disparity_error: PositivePixels = Field(description="Standard deviation of one measurement.")
    error_of: Literal["disparity", "coordinate"] = Field(
        default="disparity",
        description="Whether the error is that of the disparity or of each image coordinate (× √2).",
    )
    discrimination_step: PositivePixels = Field(description="Disparity step of the depth discrimination.")

    @property
    def disparity_error_px(self) -> float:
        """Of the disparity [px], whichever way it was given."""
        return self.disparity_error * (math.sqrt(2.0) if self.error_of == "coordinate" else 1.0)


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
    correlation: Annotated[float, Field(ge=-1.0, le=1.0)] = Field(
        description="Between mla_distance and focal_length: calibration fixes their difference best."
    )
    microlens_gap: LengthErrorPart


class StereoCalibrationPart(Part):
    """Calibration errors of a stereo rig, each one draw per rig."""

    yaw: AngleErrorPart
    pitch: AngleErrorPart | None = None
    roll: AngleErrorPart | None = None
    baseline: LengthErrorPart | None = None
    focal_length: LengthErrorPart | None = None
    principal_point: LengthErrorPart | None = None


class StatedPart(Part):
    """What a data sheet or paper states and the other values already decide: cross-checked, never used."""

    field_of_view: Angle | None = None
    microlens_gap: Length | None = None
    mla_distance: Length | None = None
    hyperfocal_distance: Length | None = None


class _CameraPart(Part):
    title: str = Field(min_length=1, max_length=80, description="Name in figures and tables.")
    note: str | None = Field(default=None, max_length=2000, description="What a reader should know about it.")
    stated: StatedPart | None = None


class FocusedPlenopticPart(_CameraPart):
    """A focused plenoptic camera (plenoptic II), of one or of several microlens types."""

    kind: Literal["focused-plenoptic"]
    main_lens: LensPart
    sensor: SensorPart
    microlenses: MicrolensesPart
    focus: FocusPart
    depth: PlenopticDepthPart
    calibration: PlenopticCalibrationPart


class StereoPart(_CameraPart):
    """A stereo rig of two equal cameras."""

    kind: Literal["stereo"]
    lenses: LensPart
    sensor: SensorPart
    baseline: PositiveLength
    axes_meet_at: PositiveLengthOrInfinity = Field(description="Where the optical axes meet; infinity is parallel.")
    focus_distance: PositiveLengthOrInfinity | Literal["every-object"] = Field(
        description="Where the lenses are focused; every-object: a mechanism refocuses them."
    )
    depth: StereoDepthPart
    calibration: StereoCalibrationPart


CameraPart = Annotated[FocusedPlenopticPart | StereoPart, Field(discriminator="kind")]

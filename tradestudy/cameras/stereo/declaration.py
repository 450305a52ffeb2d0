"""What a study declares of a stereo rig."""

from __future__ import annotations

import math
from typing import ClassVar, Literal, Self

from pydantic import Field, model_validator

from tradestudy.cameras.declaration import (
    AngleErrorPart,
    DepthCameraDeclaration,
    DisparityPart,
    LengthErrorPart,
    LensPart,
    SensorPart,
    error_of,
)
from tradestudy.cameras.depth_camera import DisparityErrorLaw
from tradestudy.cameras.stereo.design import StereoRig
from tradestudy.cameras.stereo.errors import StereoCalibration
from tradestudy.declarations.mistakes import MistakeAt
from tradestudy.declarations.part import Part
from tradestudy.declarations.quantities import (
    Baseline,
    ObjectDistanceOrInfinity,
)


class StereoDepthPart(DisparityPart):
    """Depth by two cameras."""

    estimator: Literal["disparity", "midpoint"]


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


class StereoDeclaration(DepthCameraDeclaration):
    """A stereo rig of two equal cameras."""

    camera: ClassVar[type[StereoRig]] = StereoRig

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

    @model_validator(mode="after")
    def _one_focus(self) -> Self:
        if self.principal_distance == "focused" and self.focus_distance == "every-object":
            raise MistakeAt(
                ("principal_distance",),
                "lenses that refocus on every object have no one distance to the sensor; give a focus_distance, or "
                "focal_length here",
            )
        return self

    def design(self, picture_law: DisparityErrorLaw | None) -> StereoRig:
        """The rig in SI; axes that meet at Z₀ converge by ``2 atan(B / 2Z₀)``."""
        sensor, errors = self.sensor.sensor(), self.calibration
        return StereoRig(
            lens=self.lenses.lens(sensor),
            sensor=sensor,
            focus_distance=None if self.focus_distance == "every-object" else self.focus_distance,
            principal_distance_rule=self.principal_distance,
            baseline=self.baseline,
            convergence_angle=2.0 * math.atan(self.baseline / (2.0 * self.axes_meet_at)),
            triangulation=self.depth.estimator,
            disparity_error_px=self.depth.error(picture_law),
            discrimination_step_px=self.depth.discrimination_step,
            calibration=StereoCalibration(
                yaw=error_of(errors.yaw),
                pitch=error_of(errors.pitch),
                roll=error_of(errors.roll),
                baseline=error_of(errors.baseline),
                focal_length=error_of(errors.focal_length),
                principal_point=error_of(errors.principal_point),
            ),
        )

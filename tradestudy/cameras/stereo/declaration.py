"""What a study declares of a stereo rig."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, ClassVar, Literal, Self

from pydantic import Field, model_validator

from tradestudy.cameras.calibration_declaration import CalibrationPart, calibration_part
from tradestudy.cameras.declaration import DepthCameraDeclaration, DisparityPart, LensPart, SensorPart
from tradestudy.cameras.depth_camera import DisparityErrorLaw
from tradestudy.cameras.depth_map import DepthReaderOfKind
from tradestudy.cameras.stereo.depth_reading import PairReader
from tradestudy.cameras.stereo.design import StereoRig
from tradestudy.declarations.lens_models import AnyLensModel
from tradestudy.declarations.mistakes import MistakeAt
from tradestudy.declarations.quantities import Baseline, ObjectDistanceOrInfinity
from tradestudy.optics.lens_models.rational import IDEAL


class StereoDepthPart(DisparityPart):
    """Depth by two cameras."""

    estimator: Literal["disparity", "midpoint"] = Field(
        description="Depth from the disparity along the baseline, or from the midpoint between both rays."
    )


if TYPE_CHECKING:
    StereoCalibration = CalibrationPart
else:
    StereoCalibration = calibration_part(StereoRig, "stereo")


class StereoDeclaration(DepthCameraDeclaration):
    """A stereo rig of two equal cameras."""

    camera: ClassVar[type[StereoRig]] = StereoRig
    reader: ClassVar[DepthReaderOfKind | None] = PairReader

    kind: Literal["stereo"]
    lenses: LensPart
    sensor: SensorPart
    baseline: Baseline = Field(description="Distance between the two centres of projection.")
    convergence_distance: ObjectDistanceOrInfinity = Field(
        description="Where the optical axes meet; infinity is parallel."
    )
    focus_distance: ObjectDistanceOrInfinity | Literal["autofocus"] = Field(
        description="Where the lenses are focused; autofocus: a mechanism focuses them on every object."
    )
    principal_distance: Literal["focal_length", "focused"] = Field(
        default="focal_length",
        description="Lens to sensor, which turns disparity into depth: the focal length (as of a calibration in "
        "pixels, or focused at infinity), or the image distance of focus_distance.",
    )
    depth: StereoDepthPart
    distortion: AnyLensModel | None = Field(
        default=None, description="Lens model of both cameras, without errors; left out: none."
    )
    calibration: StereoCalibration = Field(default_factory=StereoCalibration)

    @model_validator(mode="after")
    def _one_focus(self) -> Self:
        if self.principal_distance == "focused" and self.focus_distance == "autofocus":
            raise MistakeAt(
                ("principal_distance",),
                "lenses that refocus on every object have no one distance to the sensor; give a focus_distance, or "
                "focal_length here",
            )
        return self

    @model_validator(mode="after")
    def _one_lens_model(self) -> Self:
        if self.distortion is None:
            return self
        if self.lenses.field_of_view is not None:
            raise MistakeAt(
                ("lenses", "field_of_view"), "of lenses that distort it follows from distortion; give a focal_length"
            )
        known = {"k1", "k2"} <= {*self.distortion.family.coefficient_names()}
        errors = {"errors": self.calibration.errors, "ageing": self.calibration.stability.ageing}
        radial = [(where, name) for where, part in errors.items() for name in part.given() if "_distortion_k" in name]
        if radial and not known:
            where = ("calibration", *(("stability",) if radial[0][0] == "ageing" else ()), *radial[0])
            raise MistakeAt(where, f"a lens of the model {self.distortion.model} has no k1 and k2; leave it out")
        return self

    def design(self, picture_law: DisparityErrorLaw | None) -> StereoRig:
        """The rig in SI; axes that meet at Z₀ converge by ``2 atan(B / 2Z₀)``."""
        sensor = self.sensor.sensor()
        return StereoRig(
            lens=self.lenses.lens(sensor),
            sensor=sensor,
            focus_distance=None if self.focus_distance == "autofocus" else self.focus_distance,
            principal_distance_rule=self.principal_distance,
            baseline=self.baseline,
            convergence_angle=2.0 * math.atan(self.baseline / (2.0 * self.convergence_distance)),
            triangulation=self.depth.estimator,
            distortion=IDEAL if self.distortion is None else self.distortion.lens_model(),
            disparity_error_px=self.depth.error(picture_law),
            discrimination_step_px=self.depth.discrimination_step,
        )

"""Laser triangulation, a kind of camera that the program does not have: one camera, and a line projected beside it.

It lives in one file. `test_kinds.py` puts it into a copy of the package, with an entry in the tuple of kinds, and
nothing else changes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Final, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from tradestudy.cameras.calibration_declaration import calibration_part
from tradestudy.cameras.camera import Contradiction, DerivedValue, Properties, lens_contradictions
from tradestudy.cameras.declaration import DepthCameraDeclaration, DisparityPart, LensPart, SensorPart
from tradestudy.cameras.depth_camera import DepthCamera, DisparityErrorLaw, Formula, Method
from tradestudy.cameras.depth_measurement import (
    NOISE_PARAMETER,
    PIXEL_NOISE,
    Environment,
    ErrorParameter,
    Errors,
    ErrorVocabulary,
    MeasuredInverseDepth,
    require_known,
    shares_of,
    value_of,
)
from tradestudy.cameras.depth_measurement import Field as FieldOfPicture
from tradestudy.cameras.focus import SingleLensFocus
from tradestudy.cameras.parts import Lens, require_positive
from tradestudy.cameras.picture_geometry import PictureGeometry
from tradestudy.cameras.single_lens import picture_through_lens
from tradestudy.declarations.quantities import Angle, Baseline, ObjectDistanceOrInfinity
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.optics.triangulation import depth_of_inverse
from tradestudy.units import ANGLE, LENGTH

if TYPE_CHECKING:
    from tradestudy.cameras.stated_declaration import StatedPart

ERRORS: Final[ErrorVocabulary] = {
    "baseline": ErrorParameter(unit="m", part="relative position", meaning="Distance from camera to projector."),
    "projector_angle": ErrorParameter(unit="rad", part="relative rotation", meaning="Turn of the sheet of light."),
    "focal_length": ErrorParameter(unit="m", part="interior orientation", meaning="Principal distance of the camera."),
    PIXEL_NOISE: NOISE_PARAMETER,
}


@dataclass(frozen=True, kw_only=True)
class LaserScanner(DepthCamera):
    """A camera that sees the line which a projector, a baseline beside it and turned towards it, draws on the scene.

    The sheet of light is ``X = B − Z tan θ``: the line appears at ``u = f (B/Z − tan θ)``.
    """

    family: ClassVar[str] = "laser"
    error_vocabulary: ClassVar[ErrorVocabulary] = ERRORS
    method: ClassVar[Method] = Method(
        name="laser",
        title="Depth from a projected line",
        statements=(
            "A sheet of light from a projector at a baseline *B*, turned by θ, is seen at *u*.",
            Formula(typst="1 / Z = (u / f + tan theta) / B", alt="one over Z is u over f plus tan theta, over B"),
        ),
    )

    lens: Lens
    focus_distance: float
    baseline: float
    projector_angle: float

    def __post_init__(self) -> None:
        require_positive("baseline", self.baseline)
        super().__post_init__()

    @property
    def gathering_lens(self) -> Lens:
        return self.lens

    @property
    def separation(self) -> float:
        return self.baseline

    @property
    def focus(self) -> SingleLensFocus:
        pitch = self.sensor.pixel_pitch
        return SingleLensFocus(lens=self.lens, focus_distance=self.focus_distance, sample_pitch=pitch, name="the lens")

    def depth_behind_lens(self, nearest: float) -> float:
        return self.lens.focal_length

    def disparity(self, distance: ArrayLike) -> FloatArray:
        inverse = 1.0 / np.asarray(distance, dtype=np.float64)
        return np.asarray(self.lens.focal_length * (self.baseline * inverse - math.tan(self.projector_angle)))

    def inverse_depth(self, place: ArrayLike, errors: Errors) -> FloatArray:
        """The one law: ``1/Z = (u/f + tan θ)/B``, read with a calibration that is off by ``errors``."""
        slope = (np.asarray(place) + value_of(errors, PIXEL_NOISE)) / (
            self.lens.focal_length + value_of(errors, "focal_length")
        )
        turned = np.tan(self.projector_angle + value_of(errors, "projector_angle"))
        return np.asarray((slope + turned) / (self.baseline + value_of(errors, "baseline")))

    def depth_of_disparity(self, disparity: ArrayLike, distance: ArrayLike) -> FloatArray:
        return depth_of_inverse(self.inverse_depth(disparity, {}))

    def equivalent_baseline(self, distance: ArrayLike) -> FloatArray:
        return np.full(np.shape(distance), self.baseline)

    def picture_geometry(self, distance: ArrayLike) -> PictureGeometry:
        a = np.asarray(distance, dtype=np.float64)
        a = np.where(self.images(a), a, np.nan)
        return picture_through_lens(a, self.lens, self.sensor, np.full_like(a, self.focus_distance))

    def field_angle(self, field: float) -> float:
        return math.atan(field * self.sensor.diagonal / 2.0 / self.lens.focal_length)

    def read(
        self, distance: FloatArray, field: FieldOfPicture, errors: Errors, environment: Environment | None = None
    ) -> MeasuredInverseDepth:
        require_known(errors, ERRORS, "a laser scanner")
        shares_of(field)  # refuses a position beyond the sensor; depth is the same across the picture
        place = self.disparity(distance)
        seen = np.abs(place) <= self.sensor.width / 2.0
        believed = self.baseline + value_of(errors, "baseline")
        inverse = self.inverse_depth(place, errors)
        return MeasuredInverseDepth(inverse_depth=inverse, no_overlap=~seen, out_of_range=np.asarray(believed <= 0.0))

    def observe_target(self, errors: Errors, x: ArrayLike, y: ArrayLike, z: ArrayLike) -> tuple[FloatArray, ...]:
        f = self.lens.focal_length + value_of(errors, "focal_length")
        turned = np.tan(self.projector_angle + value_of(errors, "projector_angle"))
        return (np.asarray(f * ((self.baseline + value_of(errors, "baseline")) / np.asarray(z) - turned)),)

    def target_noise_px(self, corner_noise_px: float) -> FloatArray:
        return np.array([corner_noise_px])

    def seen_on_sensor(self, observed_px: FloatArray) -> BoolArray:
        return np.asarray(np.abs(observed_px) <= self.sensor.columns / 2.0)

    def properties(self) -> Properties:
        return (
            ("focal length", DerivedValue(self.lens.focal_length, LENGTH)),
            ("baseline", DerivedValue(self.baseline, LENGTH)),
            ("angle of the projector", DerivedValue(self.projector_angle, ANGLE)),
        )

    def contradictions(self, stated: StatedPart | None, tolerance: float) -> Sequence[Contradiction]:
        return lens_contradictions(self.lens, self.sensor, stated)


LaserCalibration = calibration_part(LaserScanner, "laser-triangulation")


class LaserDeclaration(DepthCameraDeclaration):
    """A camera and a projected line."""

    camera: ClassVar[type[LaserScanner]] = LaserScanner

    kind: Literal["laser-triangulation"]
    lens: LensPart
    sensor: SensorPart
    baseline: Baseline
    projector_angle: Angle
    focus_distance: ObjectDistanceOrInfinity
    depth: DisparityPart
    calibration: LaserCalibration = Field(default_factory=LaserCalibration)

    def design(self, picture_law: DisparityErrorLaw | None) -> LaserScanner:
        sensor = self.sensor.sensor()
        return LaserScanner(
            lens=self.lens.lens(sensor),
            sensor=sensor,
            baseline=self.baseline,
            projector_angle=self.projector_angle,
            focus_distance=self.focus_distance,
            disparity_error_px=self.depth.error(picture_law),
            discrimination_step_px=self.depth.discrimination_step,
        )

"""The geometry of a calibrated pair, declared in a study or imported from a calibration file."""

from __future__ import annotations

from typing import Self

import numpy as np
from pydantic import Field, model_validator

from tradestudy.cameras.calibrated_pair import RADIAL, CalibratedPair
from tradestudy.declarations.lens_models import AnyLensModel
from tradestudy.declarations.mistakes import MistakeAt
from tradestudy.declarations.part import Part
from tradestudy.declarations.quantities import Angle, Length, Pixels, PositivePixels
from tradestudy.optics.lens_models.lens_model import LensModel
from tradestudy.optics.lens_models.rational import IDEAL


class CalibratedCameraPart(Part):
    """One camera of a calibrated pair. In its picture, (0, 0) is the centre of the top left pixel; y points down."""

    focal_length: tuple[PositivePixels, PositivePixels] = Field(description="Horizontal and vertical focal length.")
    principal_point: tuple[Pixels, Pixels] = Field(
        description="Point (x, y) of the picture that the optical axis meets."
    )
    distortion: AnyLensModel | None = Field(
        default=None, description="Lens model of this camera; default: no distortion."
    )

    def lens_model(self) -> LensModel:
        """The lens model in SI."""
        return IDEAL if self.distortion is None else self.distortion.lens_model()

    def values(self, free: tuple[str, ...]) -> tuple[float, ...]:
        """Focal lengths and principal point [px], then the free coefficients of the lens model."""
        known = self.lens_model().coefficients()
        return (*self.focal_length, *self.principal_point, *(known[name] for name in free))


class GeometryPart(Part):
    """Calibrated geometry of two cameras.

    A point at X in the frame of the left camera is at RX + t in that of the right camera. In both frames, x points
    right, y down and z along the optical axis.
    """

    left: CalibratedCameraPart = Field(description="The left camera.")
    right: CalibratedCameraPart = Field(description="The right camera.")
    rotation: tuple[Angle, Angle, Angle] = Field(
        default=(0.0, 0.0, 0.0),
        description="Rotation R as a rotation vector: axis times angle.",
    )
    translation: tuple[Length, Length, Length] = Field(
        description="Translation t: position of the left camera in the frame of the right one; its first component "
        "is about −baseline."
    )

    @model_validator(mode="after")
    def _side_by_side(self) -> Self:
        x, y, z = self.translation
        if not np.hypot(y, z) < -x:
            where = "to the left of" if x > 0.0 else "not beside"
            raise MistakeAt(
                ("translation",),
                f"places the right camera {where} the left one; exchange the cameras, or check the direction of the "
                "transform",
            )
        return self

    @property
    def focal_length_px(self) -> float:
        """Mean of the four focal lengths [px]."""
        return float(np.mean([*self.left.focal_length, *self.right.focal_length]))

    @property
    def baseline(self) -> float:
        """Distance |t| between the centres of projection [m]."""
        return float(np.linalg.norm(self.translation))

    @property
    def convergence_angle(self) -> float:
        """Angle between the optical axes in the plane of the baseline [rad]; positive if they meet in front."""
        from scipy.spatial.transform import Rotation

        right_axis = Rotation.from_rotvec(self.rotation).as_matrix()[2]  # in the left camera's frame
        return float(np.arctan2(-right_axis[0], right_axis[2]))

    @property
    def pair(self) -> CalibratedPair:
        """The pair in SI; k1 and k2 are free coefficients if both lens models have them."""
        lenses = (self.left.lens_model(), self.right.lens_model())
        free = RADIAL if all({*RADIAL} <= {*lens.coefficient_names()} for lens in lenses) else ()
        parameters = (*self.left.values(free), *self.right.values(free), *self.rotation, *self.translation)
        return CalibratedPair(parameters=parameters, lenses=lenses, free=free)

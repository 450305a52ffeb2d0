"""The geometry of a calibrated pair, declared in a study or imported from a calibration file."""

from __future__ import annotations

from typing import Self

import numpy as np
from pydantic import Field, model_validator

from tradestudy.cameras.calibrated_pair import RADIAL, CalibratedPair
from tradestudy.cameras.declaration import CalibratedCameraPart
from tradestudy.declarations.part import MistakeAt, Part
from tradestudy.declarations.quantities import Angle, Length


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

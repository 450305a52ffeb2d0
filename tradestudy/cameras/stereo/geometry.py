"""The geometry of a calibrated pair, as a study declares it or a calibration file states it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, Self

import numpy as np
from pydantic import Field, model_validator

from tradestudy.cameras.imported import LensModelName
from tradestudy.declarations.mistakes import MistakeAt
from tradestudy.declarations.part import Part
from tradestudy.declarations.quantities import Angle, Length, Number, Pixels, PositivePixels
from tradestudy.optics.arrays import FloatArray

_CARRIED: Final = ("k1", "k2")


class CalibratedCameraPart(Part):
    """One camera of a calibrated pair; the centre of the first pixel is (0, 0), x to the right and y down."""

    focal_length: tuple[PositivePixels, PositivePixels] = Field(description="Across and down.")
    principal_point: tuple[Pixels, Pixels] = Field(description="Where the optical axis meets the picture.")
    lens_model: LensModelName = Field(default="rational", description="From slopes of rays to the picture.")
    coefficients: dict[str, Number] = Field(default={}, description="Of the lens model, by name.")

    @model_validator(mode="after")
    def _is_carried(self) -> Self:
        if mistakes := [*self._beyond_what_is_carried()]:
            raise MistakeAt.several(mistakes)
        return self

    def _beyond_what_is_carried(self) -> Iterator[MistakeAt]:
        rectified = "k1 and k2 of the radial polynomial are; take the rectified pictures of the pair instead"
        if self.lens_model != "rational":
            yield MistakeAt(("lens_model",), f"the lens model '{self.lens_model}' is not supported yet; {rectified}")
            return
        acting = [name for name, value in self.coefficients.items() if name not in _CARRIED and value != 0.0]
        for name in acting:
            what = f"{name} = {self.coefficients[name]:g} is not supported yet; {rectified}"
            yield MistakeAt(("coefficients", name), what)

    def values(self) -> tuple[float, ...]:
        """Focal lengths, principal point [px], k1 and k2, as `calibration.projection` takes them."""
        k1, k2 = (self.coefficients.get(name, 0.0) for name in _CARRIED)
        return (*self.focal_length, *self.principal_point, k1, k2)


class GeometryPart(Part):
    """Two cameras as calibrated; ``x_right = R x_left + t``."""

    left: CalibratedCameraPart
    right: CalibratedCameraPart
    rotation: tuple[Angle, Angle, Angle] = Field(
        default=(0.0, 0.0, 0.0), description="Rotation vector of R, from the left camera's frame to the right one's."
    )
    translation: tuple[Length, Length, Length] = Field(
        description="t: where the left camera stands in the right one's frame; its first component is about −baseline."
    )

    @model_validator(mode="after")
    def _side_by_side(self) -> Self:
        x, y, z = self.translation
        if not np.hypot(y, z) < -x:
            where = "to the left of" if x > 0.0 else "not beside"
            raise MistakeAt(
                ("translation",),
                f"puts the right camera {where} the left one; exchange the cameras, or check the direction of the "
                "transform",
            )
        return self

    @property
    def focal_length_px(self) -> float:
        """Mean of the four focal lengths [px]."""
        return float(np.mean([*self.left.focal_length, *self.right.focal_length]))

    @property
    def baseline(self) -> float:
        """Distance of the centres of projection |t| [m]."""
        return float(np.linalg.norm(self.translation))

    @property
    def convergence_angle(self) -> float:
        """By which the optical axes turn towards each other in the plane of the baseline [rad]."""
        from scipy.spatial.transform import Rotation

        right_axis = Rotation.from_rotvec(self.rotation).as_matrix()[2]  # in the left camera's frame
        return float(np.arctan2(-right_axis[0], right_axis[2]))

    @property
    def shared(self) -> FloatArray:
        """All 18 parameters: left and right camera, rotation vector [rad], translation [m]."""
        return np.array([*self.left.values(), *self.right.values(), *self.rotation, *self.translation])

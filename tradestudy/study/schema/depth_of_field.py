"""What must be sharp, what counts as sharp, and the relief against which trade criteria are worked out."""

from __future__ import annotations

import math
from typing import Annotated, Final, Literal, Self

from pydantic import Field, model_validator

from tradestudy.cameras.focus import BlurCriterion
from tradestudy.declarations.mistakes import MistakeAt
from tradestudy.declarations.part import Part
from tradestudy.declarations.quantities import NonNegativeAngle, PositiveLength, PositivePixels

CriterionName = Annotated[str, Field(pattern=r"^[\w][\w.+-]*$", max_length=60)]
PROBLEM: Final = "depth-of-field"
"""Name of the problem that models are chosen for."""
Diffraction = Literal["none", "airy-diameter", "fwhm"]


class BlurPart(Part):
    """What counts as sharp: the largest blur, and the diffraction spot that adds to it in quadrature."""

    blur: PositivePixels = Field(
        description="Largest blur, in lateral samples: pixels, or microlenses of an unfocused plenoptic camera."
    )
    diffraction: Diffraction = Field(
        default="none",
        description="Measured width of the diffraction spot: none, first dark ring, or full width at half maximum.",
    )

    def criterion(self, wavelength: float) -> BlurCriterion:
        """What counts as sharp in light of a wavelength [m]."""
        return BlurCriterion(blur_px=self.blur, measure=self.diffraction, wavelength=wavelength)


class DepthOfFieldPart(Part):
    """The depth of field of every camera."""

    range: tuple[PositiveLength, PositiveLength] = Field(
        description="Nearest and farthest distance that must be sharp."
    )
    criteria: Annotated[dict[CriterionName, BlurPart], Field(min_length=1, max_length=20)] = Field(
        description="Blur criteria by name; the answer uses the first one."
    )
    equal_resolution: PositiveLength | None = Field(
        default=None, description="Size of detail on the object at which depths of field are also compared."
    )

    @model_validator(mode="after")
    def _increasing(self) -> Self:
        if not self.range[0] < self.range[1]:
            raise MistakeAt(("range", 1), "must lie beyond the first")
        return self


class ReliefPart(Part):
    """The relief for which scalar trade criteria are derived, in the middle of the range that must be sharp."""

    step_height: PositiveLength = Field(
        description="Height of a depth step that hides a strip beside it from one view."
    )
    surface_tilt: NonNegativeAngle = Field(
        description="Tilt of a surface that two views see foreshortened by different amounts."
    )

    @model_validator(mode="after")
    def _below_a_quarter_turn(self) -> Self:
        if not self.surface_tilt < math.pi / 2.0:
            raise MistakeAt(("surface_tilt",), "a surface tilted by 90° shows only its edge")
        return self

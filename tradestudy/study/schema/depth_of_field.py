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
PIECE: Final = "depth-of-field"
"""Under which name models are chosen for it."""
Diffraction = Literal["none", "airy-diameter", "fwhm"]


class BlurPart(Part):
    """What counts as sharp: geometric blur and the diffraction spot in quadrature stay below this."""

    blur: PositivePixels = Field(
        description="In lateral samples: pixels, or microlenses of an unfocused plenoptic camera."
    )
    diffraction: Diffraction = Field(
        default="none",
        description="How wide the diffraction spot counts: not at all, to its first dark ring, or at half maximum.",
    )

    def criterion(self, wavelength: float) -> BlurCriterion:
        """What counts as sharp in light of a wavelength [m]."""
        return BlurCriterion(blur_px=self.blur, measure=self.diffraction, wavelength=wavelength)


class DepthOfFieldPart(Part):
    """What every camera keeps in focus."""

    range: tuple[PositiveLength, PositiveLength] = Field(
        description="Nearest and farthest distance that must be sharp."
    )
    criteria: Annotated[dict[CriterionName, BlurPart], Field(min_length=1, max_length=20)] = Field(
        description="Blur criteria; the first one is that of the answer."
    )
    equal_resolution: PositiveLength | None = Field(
        default=None, description="Size of detail on the object at which depths of field are compared besides."
    )

    @model_validator(mode="after")
    def _increasing(self) -> Self:
        if not self.range[0] < self.range[1]:
            raise MistakeAt(("range", 1), "must lie beyond the first")
        return self


class ReliefPart(Part):
    """The relief by which trade criteria that are not curves are worked out, in the middle of what must be sharp."""

    step_height: PositiveLength = Field(description="Height of a depth step, beside which a strip is hidden.")
    surface_tilt: NonNegativeAngle = Field(description="Tilt of a surface, which two views see foreshortened.")

    @model_validator(mode="after")
    def _below_a_quarter_turn(self) -> Self:
        if not self.surface_tilt < math.pi / 2.0:
            raise MistakeAt(("surface_tilt",), "a surface tilted by 90° shows only its edge")
        return self

"""What must be sharp, what counts as sharp, and the relief for which trade criteria are derived."""

from __future__ import annotations

import math
from typing import Annotated, Final, Literal, Self

from pydantic import Field, model_validator

from tradestudy.cameras.focus import BlurCriterion
from tradestudy.declarations.part import MistakeAt, Part
from tradestudy.declarations.quantities import NonNegativeAngle, PositiveLength, PositivePixels

CriterionName = Annotated[str, Field(pattern=r"^[\w][\w.+-]*$", max_length=60)]
PROBLEM: Final = "depth-of-field"
"""Name of the problem for which models are chosen."""
Diffraction = Literal["none", "airy-diameter", "fwhm"]


class BlurPart(Part):
    """What counts as sharp: an upper bound on geometric blur and diffraction spot together, added in quadrature."""

    blur: PositivePixels = Field(
        description="Largest diameter that counts as sharp: blur and diffraction spot added in quadrature, in pixels "
        "or, for an unfocused plenoptic camera, in microlenses."
    )
    diffraction: Diffraction = Field(
        default="none",
        description="How the diffraction spot counts: not at all (`none`), with the diameter of its first dark ring "
        "(`airy-diameter`), or with its full width at half maximum (`fwhm`).",
    )

    def criterion(self, wavelength: float) -> BlurCriterion:
        """The criterion for light of a wavelength [m]."""
        return BlurCriterion(blur_px=self.blur, measure=self.diffraction, wavelength=wavelength)


class DepthOfFieldPart(Part):
    """The depth of field of every camera, and the range of distances that must be sharp."""

    range: tuple[PositiveLength, PositiveLength] = Field(
        description="Nearest and farthest distance of the range that must be sharp."
    )
    criteria: Annotated[dict[CriterionName, BlurPart], Field(min_length=1, max_length=20)] = Field(
        description="Blur criteria by name; the report's answer rests on the first."
    )
    equal_resolution: PositiveLength | None = Field(
        default=None,
        description="Size of a detail on the object; the report also compares the distances at which each camera "
        "resolves it.",
    )

    @model_validator(mode="after")
    def _increasing(self) -> Self:
        if not self.range[0] < self.range[1]:
            raise MistakeAt(("range", 1), "must lie beyond the first")
        return self


class ReliefPart(Part):
    """A depth step and a tilted surface in the middle of depth_of_field.range.

    From them, the program derives further criteria for comparing the cameras, such as the width of the strip that the
    step hides.
    """

    step_height: PositiveLength = Field(
        description="Height of the depth step, which hides a strip beside it from one of the two outermost viewpoints "
        "of a camera (the two lenses of a stereo rig, or opposite edges of a plenoptic camera's pupil)."
    )
    surface_tilt: NonNegativeAngle = Field(
        description="Angle between the surface and the plane perpendicular to the optical axis. The surface is tilted "
        "so that its distance changes along the baseline; the two outermost viewpoints therefore see it foreshortened "
        "by different amounts."
    )

    @model_validator(mode="after")
    def _below_a_quarter_turn(self) -> Self:
        if not self.surface_tilt < math.pi / 2.0:
            raise MistakeAt(("surface_tilt",), "a surface tilted by 90° shows only its edge")
        return self

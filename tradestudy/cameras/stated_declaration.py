"""Values that a source states about a camera in addition to those that determine it."""

from __future__ import annotations

from pydantic import Field

from tradestudy.declarations.part import Part
from tradestudy.declarations.quantities import PositiveAngle, PositiveLength, PositivePhotons


class StatedPart(Part):
    """Values that a data sheet or paper states; the program only compares each with what the other keys imply."""

    field_of_view: PositiveAngle | None = Field(
        default=None,
        description="Full field of view that the data sheet states, across the width or the diagonal of the sensor.",
    )
    microlens_gap: PositiveLength | None = Field(
        default=None, description="Distance from microlenses to sensor that the data sheet states."
    )
    mla_distance: PositiveLength | None = Field(
        default=None, description="Distance from main lens to microlens array that the data sheet states."
    )
    hyperfocal_distance: PositiveLength | None = Field(
        default=None, description="Hyperfocal distance that the data sheet states."
    )
    absolute_sensitivity_threshold: PositivePhotons | None = Field(
        default=None,
        description="Absolute sensitivity threshold that the data sheet states (EMVA 1288: μ_p.min): the number of "
        "photons at which signal and noise are equal.",
    )
    depth_of_field: PositiveLength | None = Field(
        default=None, description="Depth of field that the data sheet states for one image of a conventional camera."
    )

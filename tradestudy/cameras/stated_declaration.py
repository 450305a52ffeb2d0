"""Values that a source states about a camera in addition to those that determine it."""

from __future__ import annotations

from pydantic import Field

from tradestudy.declarations.part import Part
from tradestudy.declarations.quantities import Angle, Length, PositiveLength, PositivePhotons


class StatedPart(Part):
    """Values of a data sheet or paper that others already determine; they are checked against these and never used."""

    field_of_view: Angle | None = Field(default=None, description="Full field of view that the data sheet states.")
    microlens_gap: Length | None = Field(
        default=None, description="Distance from microlenses to sensor that the data sheet states."
    )
    mla_distance: Length | None = Field(
        default=None, description="Distance from main lens to microlens array that the data sheet states."
    )
    hyperfocal_distance: Length | None = Field(
        default=None, description="Hyperfocal distance that the data sheet states."
    )
    absolute_sensitivity_threshold: PositivePhotons | None = Field(
        default=None,
        description="Stated EMVA 1288 threshold μ_p.min: the number of photons at which signal and noise are equal.",
    )
    depth_of_field: PositiveLength | None = Field(
        default=None, description="Stated depth of field of one image of a conventional camera."
    )

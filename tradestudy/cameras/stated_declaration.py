"""Values that a source states about a camera in addition to those that determine it."""

from __future__ import annotations

from pydantic import Field

from tradestudy.declarations.part import Part
from tradestudy.declarations.quantities import PositiveAngle, PositiveLength, PositivePhotons


class StatedPart(Part):
    """Values that a data sheet or paper states; the report lists those that contradict the values of other keys."""

    field_of_view: PositiveAngle | None = Field(
        default=None,
        description="Full field of view across the width or the diagonal of the sensor; either is accepted.",
    )
    microlens_gap: PositiveLength | None = Field(
        default=None, description="Distance from the microlens array to the sensor."
    )
    mla_distance: PositiveLength | None = Field(
        default=None, description="Distance from the main lens to the microlens array."
    )
    hyperfocal_distance: PositiveLength | None = Field(
        default=None, description="Hyperfocal distance for a blur of one pixel."
    )
    absolute_sensitivity_threshold: PositivePhotons | None = Field(
        default=None,
        description="Absolute sensitivity threshold (EMVA 1288: μ_p.min): the number of photons at which signal and "
        "noise are equal.",
    )
    depth_of_field: PositiveLength | None = Field(
        default=None, description="Depth of field of one picture by a conventional camera, for a blur of one pixel."
    )

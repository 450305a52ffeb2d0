"""What a source states of a camera beside the values that decide it."""

from __future__ import annotations

from pydantic import Field

from tradestudy.declarations.part import Part
from tradestudy.declarations.quantities import Angle, Length, PositiveLength


class StatedPart(Part):
    """What a data sheet or paper states and the other values already decide: cross-checked, never used."""

    field_of_view: Angle | None = None
    microlens_gap: Length | None = None
    mla_distance: Length | None = None
    hyperfocal_distance: Length | None = None
    depth_of_field: PositiveLength | None = Field(default=None, description="Of one image of a conventional camera.")

"""The scene: at which distances, in which light."""

from __future__ import annotations

import itertools
from typing import Annotated, Self

from pydantic import Field, model_validator

from tradestudy.declarations.distances import MOST_DISTANCES, DistanceRangePart
from tradestudy.declarations.mistakes import MistakeAt
from tradestudy.declarations.part import Part
from tradestudy.declarations.quantities import (
    NonNegativeTemperatureDifference,
    ObjectDistance,
    PositiveWavelength,
    ThermalExpansion,
)
from tradestudy.study.schema.picture import PicturePart


class TemperaturePart(Part):
    """How far the temperature may be from that of the calibration, and what that does to lengths."""

    deviation: NonNegativeTemperatureDifference = Field(description="One standard deviation.")
    expansion: ThermalExpansion = Field(description="Of cameras that declare none: their baseline, or lens to array.")


class ScenePart(Part):
    """What is looked at."""

    distances: DistanceRangePart | Annotated[tuple[ObjectDistance, ...], Field(min_length=2, max_length=MOST_DISTANCES)]
    wavelength: PositiveWavelength
    picture: PicturePart | None = Field(
        default=None, description="Texture, light and sensor: what derived disparity errors follow from."
    )
    temperature: TemperaturePart | None = Field(default=None, description="Default: that of the calibration.")

    @model_validator(mode="after")
    def _sorted(self) -> Self:
        values = self.distance_values()
        if any(not a < b for a, b in itertools.pairwise(values)):
            raise MistakeAt(("distances",), "must increase")
        return self

    def distance_values(self) -> tuple[float, ...]:
        """The distances [m], increasing."""
        return self.distances.values() if isinstance(self.distances, DistanceRangePart) else self.distances

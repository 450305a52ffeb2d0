"""The scene: at which distances, in which light."""

from __future__ import annotations

import itertools
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from tradestudy.study.mistakes import MistakeAt
from tradestudy.study.schema.base import Part
from tradestudy.study.schema.picture import PicturePart
from tradestudy.study.schema.quantities import (
    NonNegativeTemperatureDifference,
    ObjectDistance,
    PositiveWavelength,
    ThermalExpansion,
)

MOST_DISTANCES = 100_000


class DistanceRangePart(Part):
    """Distances on a scale."""

    start: ObjectDistance = Field(alias="from")
    stop: ObjectDistance = Field(alias="to")
    points: Annotated[int, Field(ge=2, le=MOST_DISTANCES, strict=True)]
    spacing: Literal["log", "linear"] = "log"

    @model_validator(mode="after")
    def _increasing(self) -> Self:
        if not self.start < self.stop:
            raise MistakeAt(("to",), "must lie beyond from")
        return self

    def values(self) -> tuple[float, ...]:
        """The distances [m]; the ends exactly as written."""
        space = np.geomspace if self.spacing == "log" else np.linspace
        return tuple(float(value) for value in space(self.start, self.stop, self.points))


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

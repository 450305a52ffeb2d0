"""Ranges of distances, as studies declare them."""

from __future__ import annotations

from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from tradestudy.declarations.part import MistakeAt, Part
from tradestudy.declarations.quantities import ObjectDistance

MOST_DISTANCES = 100_000


class DistanceRangePart(Part):
    """A range of distances with logarithmic or linear spacing."""

    start: ObjectDistance = Field(alias="from", description="Nearest distance.")
    stop: ObjectDistance = Field(alias="to", description="Farthest distance.")
    points: Annotated[int, Field(ge=2, le=MOST_DISTANCES, strict=True)] = Field(
        description="Number of distances, including both ends."
    )
    spacing: Literal["log", "linear"] = Field(
        default="log", description="Spacing of the distances: equal ratios (log) or equal differences (linear)."
    )

    @model_validator(mode="after")
    def _increasing(self) -> Self:
        if not self.start < self.stop:
            raise MistakeAt(("to",), "must lie beyond from")
        return self

    def values(self) -> tuple[float, ...]:
        """The distances [m]; the ends are exactly as declared."""
        space = np.geomspace if self.spacing == "log" else np.linspace
        return tuple(float(value) for value in space(self.start, self.stop, self.points))

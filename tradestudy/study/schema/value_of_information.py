"""What a study does not know for sure, over which ranges, and what a wrong choice of camera costs."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import AfterValidator, Field, model_validator

from tradestudy.declarations.mistakes import MistakeAt
from tradestudy.declarations.part import Part
from tradestudy.declarations.quantities import ObjectDistance, PositiveFraction, QuantityText
from tradestudy.declarations.words import Text, distinct


class AssumptionPart(Part):
    """A value of the study that could be anything between two ends, equally likely on a logarithmic scale."""

    says: Text | None = Field(default=None, description="What it is called in reports; default: its path.")
    vary: Text | Annotated[tuple[Text, ...], Field(min_length=2, max_length=20), AfterValidator(distinct)] = Field(
        description="Path of the value; of several paths, all take the same value."
    )
    low: QuantityText
    high: QuantityText

    @property
    def paths(self) -> tuple[str, ...]:
        """Of every value that is varied."""
        return (self.vary,) if isinstance(self.vary, str) else self.vary


class ValueOfInformationPart(Part):
    """How much better the choice among the candidates becomes by knowing each assumption.

    A choice is worth less the larger the depth uncertainty over the distance, averaged over the distances.
    """

    assumptions: Annotated[dict[str, AssumptionPart], Field(min_length=1, max_length=40)]
    at: Annotated[tuple[ObjectDistance, ...], Field(min_length=1, max_length=20), AfterValidator(distinct)] | None = (
        Field(default=None, description="Distances that count alike; default: those of the decision.")
    )
    unusable: PositiveFraction = Field(
        default=1.0, description="What a distance counts at which the camera is not usable, instead of its uncertainty."
    )
    draws: Annotated[int, Field(ge=64, le=2**14, strict=True)] = Field(
        default=256, description="Combinations of values that are tried; a power of two is balanced best."
    )

    @model_validator(mode="after")
    def _each_value_once(self) -> Self:
        owners: dict[str, str] = {}
        for name, one in self.assumptions.items():
            for path in one.paths:
                key = path.removeprefix("cameras.")
                if key in owners:
                    raise MistakeAt(("assumptions", name, "vary"), f"{path} is varied by '{owners[key]}' already")
                owners[key] = name
        return self

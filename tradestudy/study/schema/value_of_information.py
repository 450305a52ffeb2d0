"""What a study does not know for sure, over which ranges, and what a wrong choice of camera costs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Self

from pydantic import AfterValidator, Field, model_validator

from tradestudy.declarations.mistakes import MistakeAt
from tradestudy.declarations.part import Part
from tradestudy.declarations.quantities import ObjectDistance, PositiveFraction, QuantityText
from tradestudy.declarations.words import CameraName, Text, distinct


class AssumptionPart(Part):
    """What a study does not know: a value between two ends, equally likely on a logarithmic scale, or which reading."""

    says: Text | None = Field(default=None, description="What it is called in reports; default: its path.")
    vary: Text | Annotated[tuple[Text, ...], Field(min_length=2, max_length=20), AfterValidator(distinct)] = Field(
        default=(), description="Path of the value; of several paths, all take the same value."
    )
    low: QuantityText = Field(default="", description="Smallest value that the assumption may have.")
    high: QuantityText = Field(default="", description="Largest value that the assumption may have.")
    readings: Annotated[tuple[CameraName, ...], Field(min_length=1, max_length=20), AfterValidator(distinct)] | None = (
        Field(default=None, description="Instead: readings that are as likely as the study as declared.")
    )

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if len({self.readings is None, bool(self.vary), bool(self.low), bool(self.high)}) > 1:
            raise MistakeAt((), "give either vary, low and high, or readings")
        return self

    @property
    def paths(self) -> tuple[str, ...]:
        """Of every value that is varied; those of readings are theirs."""
        return (self.vary,) if isinstance(self.vary, str) else self.vary


class ValueOfInformationPart(Part):
    """How much better the choice among the candidates becomes by knowing each assumption.

    A choice is worth less the larger the depth uncertainty over the distance, averaged over the distances.
    """

    assumptions: Annotated[dict[str, AssumptionPart], Field(min_length=1, max_length=40)] = Field(
        description="Assumptions by path or name, each with its range or readings."
    )
    at: Annotated[tuple[ObjectDistance, ...], Field(min_length=1, max_length=20), AfterValidator(distinct)] | None = (
        Field(default=None, description="Distances that count alike; default: those of the decision.")
    )
    unusable: PositiveFraction = Field(
        default=1.0, description="What a distance counts at which the camera is not usable, instead of its uncertainty."
    )
    draws: Annotated[int, Field(ge=64, le=2**14, strict=True)] = Field(
        default=256, description="Combinations of values that are tried; a power of two is balanced best."
    )

    def mistakes_of_owners(self, readings: Mapping[str, Sequence[str]]) -> list[MistakeAt]:
        """Values that two assumptions vary; of every reading of the study, its paths are given."""
        owners: dict[str, str] = {}
        mistakes = []
        for name, one in self.assumptions.items():
            word = "vary" if one.readings is None else "readings"
            every = [*one.paths, *(path for reading in one.readings or () for path in readings.get(reading, ()))]
            for path in dict.fromkeys(path.removeprefix("cameras.") for path in every):
                if path in owners:
                    place = ("assumptions", name, word)
                    what = f"{path} is varied by '{owners[path]}' already"
                    mistakes.append(MistakeAt(("value_of_information", *place), what))
                owners.setdefault(path, name)
        return mistakes

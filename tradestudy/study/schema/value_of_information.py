"""Value of information: uncertain assumptions, their ranges, and the cost of choosing the wrong camera."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Self

from pydantic import AfterValidator, Field, model_validator

from tradestudy.declarations.part import MistakeAt, Part
from tradestudy.declarations.quantities import (
    CameraName,
    ObjectDistance,
    PositiveFraction,
    QuantityText,
    Text,
    distinct,
)


class AssumptionPart(Part):
    """An uncertain assumption: a value with a log-uniform distribution, or a choice among equally likely readings."""

    says: Text | None = Field(
        default=None,
        description="Name of the assumption in reports; default: the first path in `vary` or, for `readings`, the name "
        "of this entry.",
    )
    vary: Text | Annotated[tuple[Text, ...], Field(min_length=2, max_length=20), AfterValidator(distinct)] = Field(
        default=(), description="Path of the value to vary, or paths of several values, which are kept equal."
    )
    low: QuantityText = Field(default="", description="Smallest possible value, above 0, with its unit.")
    high: QuantityText = Field(default="", description="Largest possible value, with its unit.")
    readings: Annotated[tuple[CameraName, ...], Field(min_length=1, max_length=20), AfterValidator(distinct)] | None = (
        Field(
            default=None,
            description="Instead of `vary`, `low` and `high`, which belong together: names of readings, each as likely "
            "as the declared study.",
        )
    )

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if len({self.readings is None, bool(self.vary), bool(self.low), bool(self.high)}) > 1:
            raise MistakeAt((), "give either vary, low and high, or readings")
        return self

    @property
    def paths(self) -> tuple[str, ...]:
        """Paths of the values to vary; empty for readings."""
        return (self.vary,) if isinstance(self.vary, str) else self.vary


class ValueOfInformationPart(Part):
    """For each assumption, by how much knowing its true value would raise the expected utility of the best choice.

    The utility of a camera is the negative of its relative depth uncertainty, averaged over distances.
    """

    assumptions: Annotated[dict[str, AssumptionPart], Field(min_length=1, max_length=40)] = Field(
        description="Uncertain assumptions, by names that you choose."
    )
    at: Annotated[tuple[ObjectDistance, ...], Field(min_length=1, max_length=20), AfterValidator(distinct)] | None = (
        Field(
            default=None,
            description="Distances over which the relative depth uncertainty is averaged. Default: "
            "decision.at or, without it, up to four of the distances in scene.distances, from the nearest to the "
            "farthest, spaced about evenly on a logarithmic scale.",
        )
    )
    unusable: PositiveFraction = Field(
        default=1.0,
        description="Relative depth uncertainty to assume for a camera where it is unusable. Where it is usable, an "
        "uncertainty larger than this value is replaced by it.",
    )
    draws: Annotated[int, Field(ge=64, le=2**14, strict=True)] = Field(
        default=256, description="Number of combinations of values to draw; powers of two cover the ranges most evenly."
    )

    def mistakes_of_owners(self, readings: Mapping[str, Sequence[str]]) -> list[MistakeAt]:
        """Values that two assumptions vary; ``readings`` gives the paths that each reading of the study sets."""
        owners: dict[str, str] = {}
        mistakes = []
        for name, one in self.assumptions.items():
            word = "vary" if one.readings is None else "readings"
            every = [*one.paths, *(path for reading in one.readings or () for path in readings.get(reading, ()))]
            for path in dict.fromkeys(path.removeprefix("cameras.") for path in every):
                if path in owners:
                    place = ("assumptions", name, word)
                    what = f"'{owners[path]}' already varies {path}"
                    mistakes.append(MistakeAt(("value_of_information", *place), what))
                owners.setdefault(path, name)
        return mistakes

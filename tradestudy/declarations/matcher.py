"""A real matcher as a study declares it, for the whole scene or for one camera."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

from pydantic import Field, WithJsonSchema

from tradestudy import units
from tradestudy.declarations.part import MistakeAt, Part
from tradestudy.declarations.quantities import quantity

NoiseFactor = Annotated[float, *quantity(units.NUMBER, at_least=1.0)]
NoiseFloor = Annotated[float, *quantity(units.PIXELS, at_least=0.0)]
LockingAmplitude = Annotated[float, *quantity(units.PIXELS, at_least=0.0, at_most=0.5)]
_read, _schema = quantity(units.FRACTION, at_least=0.0, at_most=1.0)
FalseShare = Annotated[
    float,
    _read,
    Field(lt=1.0),
    WithJsonSchema({**(_schema.json_schema or {}), "title": "a fraction from 0 % to below 100 %"}),
]


class MatcherPart(Part):
    """By how much the errors of a real matcher exceed the Cramér–Rao bound on the disparity error."""

    factor: NoiseFactor | None = Field(
        default=None, description="Factor that multiplies the Cramér–Rao bound; default: 1."
    )
    floor: NoiseFloor | None = Field(
        default=None,
        description="Standard deviation of the part of the matching noise that more light does not reduce; it adds to "
        "the rest in quadrature.",
    )
    pixel_locking: LockingAmplitude | None = Field(
        default=None,
        description="Amplitude of a bias that is a sine of the disparity with a period of one pixel. Its phase is "
        "unknown, so amplitude/√2 adds to the noise in quadrature. The bias is the same in all measurements at one "
        "distance, so averaging them does not reduce it.",
    )
    false_matches: FalseShare | None = Field(
        default=None, description="Fraction of all matches that are false; they count as failed measurements."
    )

    def _mistakes(self) -> Iterator[MistakeAt]:
        if not self.given():
            names = list(type(self).model_fields)
            yield MistakeAt((), f"give at least one of {', '.join(names[:-1])} and {names[-1]}")

    def given(self) -> dict[str, float]:
        """The given values by name, in SI and pixels."""
        return {name: value for name in type(self).model_fields if (value := getattr(self, name)) is not None}

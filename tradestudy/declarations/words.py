"""The words that questions of a study are put in: names of cameras, spans of distance, which errors count."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from tradestudy.declarations.mistakes import MistakeAt
from tradestudy.declarations.quantities import ObjectDistance


def increasing(span: tuple[float, ...]) -> tuple[float, ...]:
    """Refuse a range that does not go from near to far."""
    if not span[0] < span[-1]:
        raise MistakeAt((), "a range goes from near to far")
    return span


def different(pair: tuple[str, ...]) -> tuple[str, ...]:
    """Refuse to compare a camera with itself."""
    if len(set(pair)) < len(pair):
        raise MistakeAt((), "two different cameras are expected")
    return pair


Way = Literal["noise", "calibration", "both"]
Span = Annotated[tuple[ObjectDistance, ...], Field(min_length=2, max_length=2), AfterValidator(increasing)]
Text = Annotated[str, Field(min_length=1, max_length=2000)]
CameraName = Annotated[str, Field(min_length=1, max_length=80)]
Pair = Annotated[tuple[CameraName, ...], Field(min_length=2, max_length=2), AfterValidator(different)]
Scalar = str | int | float | bool | None

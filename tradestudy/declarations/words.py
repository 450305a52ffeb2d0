"""Types shared by the questions of a study: camera names, distance ranges, kinds of error."""

from __future__ import annotations

from collections.abc import Hashable
from typing import Annotated, Literal, TypeVar

from pydantic import AfterValidator, Field

from tradestudy.declarations.mistakes import MistakeAt
from tradestudy.declarations.quantities import ObjectDistance

Item = TypeVar("Item", bound=Hashable)


def increasing(span: tuple[float, ...]) -> tuple[float, ...]:
    """Refuse a range that does not go from near to far."""
    if not span[0] < span[-1]:
        raise MistakeAt((), "a range must go from near to far")
    return span


def different(pair: tuple[str, ...]) -> tuple[str, ...]:
    """Refuse to compare a camera with itself."""
    if len(set(pair)) < len(pair):
        raise MistakeAt((), "two different cameras are expected")
    return pair


def distinct(values: tuple[Item, ...]) -> tuple[Item, ...]:
    """Refuse a list with duplicates."""
    if twice := [MistakeAt((i,), "is listed twice") for i, value in enumerate(values) if value in values[:i]]:
        raise MistakeAt.several(twice)
    return values


ErrorSources = Literal["noise", "calibration", "both"]
Span = Annotated[tuple[ObjectDistance, ...], Field(min_length=2, max_length=2), AfterValidator(increasing)]
Text = Annotated[str, Field(min_length=1, max_length=2000)]
CameraName = Annotated[str, Field(min_length=1, max_length=80)]
Pair = Annotated[tuple[CameraName, ...], Field(min_length=2, max_length=2), AfterValidator(different)]
Seed = Annotated[int, Field(ge=0, le=2**64 - 1, strict=True)]
Scalar = str | int | float | bool | None

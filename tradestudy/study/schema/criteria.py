"""Criteria of cameras by name: numbers of one dimension, derived for a relief or declared as attributes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

from tradestudy.cameras.declaration import AttributesPart
from tradestudy.declarations.quantities import common_dimension
from tradestudy.units import DATA, DURATION, FRACTION, LENGTH, NUMBER, SOLID_ANGLE, Dimension

DERIVED: Final[Mapping[str, Dimension | None]] = {
    "moving parts": NUMBER,
    "images per scene": NUMBER,
    "time per scene": DURATION,
    "data per depth map": DATA,
    "resolved samples": NUMBER,
    "aperture": LENGTH,
    "light gathered": SOLID_ANGLE,
    "size": None,  # text with three lengths
    "hidden beside a step": LENGTH,
    "foreshortening": NUMBER,
}
"""Criteria derived for every camera of a study that has a relief, with their dimensions."""


def criterion_names(attributes: Iterable[AttributesPart], *, relief: bool) -> list[str]:
    """Names of all criteria of a study: those derived for its relief, if any, and those that cameras declare."""
    declared = [name for part in attributes for name in part.others]
    return list(dict.fromkeys([*(DERIVED if relief else ()), *declared]))


def criterion_dimension(name: str, attributes: Iterable[AttributesPart]) -> Dimension | None:
    """The dimension of a criterion; None for text, or for numbers with units of different kinds."""
    if name in DERIVED:
        return DERIVED[name]
    numbers = [part.others[name] for part in attributes if is_number(part.others.get(name, ""))]
    found = common_dimension(*numbers) if numbers else None
    # Plain numbers are shown as such, not in per cent.
    return NUMBER if found is FRACTION and all(text.strip()[-1] in "0123456789." for text in numbers) else found


def weighed_dimension(name: str, quantity: str | None, attributes: Iterable[AttributesPart]) -> Dimension:
    """The dimension of a criterion in a valid trade-off: a length if the criterion is computed."""
    found = LENGTH if quantity is not None else criterion_dimension(name, attributes)
    assert found is not None
    return found


def is_number(text: str) -> bool:
    """Whether a declared attribute is a finite number, with or without a unit, and not text."""
    return text[:1] in "+-.0123456789" and text != "" and common_dimension(text) is not None

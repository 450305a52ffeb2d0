"""Criteria of cameras by name: those derived for a relief, and what cameras declare, as numbers of one dimension."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

from tradestudy.cameras.declaration import AttributesPart
from tradestudy.declarations.dimensions import common_dimension
from tradestudy.units import DATA, DURATION, FRACTION, LENGTH, NUMBER, SOLID_ANGLE, Dimension

DERIVED: Final[Mapping[str, Dimension | None]] = {
    "moving parts": NUMBER,
    "images per scene": NUMBER,
    "time per scene": DURATION,
    "data per depth map": DATA,
    "resolved samples": NUMBER,
    "aperture": LENGTH,
    "light gathered": SOLID_ANGLE,
    "size": None,  # in words: three lengths
    "hidden beside a step": LENGTH,
    "foreshortening": NUMBER,
}
"""What is worked out for every camera of a study that has a relief, and what its number measures."""


def criterion_names(attributes: Iterable[AttributesPart], *, relief: bool) -> list[str]:
    """Every criterion of a study: derived ones, where it has a relief, and those that some camera declares."""
    declared = [name for part in attributes for name in part.others]
    return list(dict.fromkeys([*(DERIVED if relief else ()), *declared]))


def criterion_dimension(name: str, attributes: Iterable[AttributesPart]) -> Dimension | None:
    """What the numbers of a criterion measure; None for words, or numbers with units of different kinds."""
    if name in DERIVED:
        return DERIVED[name]
    numbers = [part.others[name] for part in attributes if is_number(part.others.get(name, ""))]
    found = common_dimension(*numbers) if numbers else None
    # Shown as a number, not in per cent, where nobody writes it so.
    return NUMBER if found is FRACTION and all(text.strip()[-1] in "0123456789." for text in numbers) else found


def weighed_dimension(name: str, quantity: str | None, attributes: Iterable[AttributesPart]) -> Dimension:
    """What a criterion of a trade-off without mistakes measures: a length where it is computed."""
    found = LENGTH if quantity is not None else criterion_dimension(name, attributes)
    assert found is not None
    return found


def is_number(text: str) -> bool:
    """Whether a declared attribute is a finite number, with a unit or without; else it is in words."""
    return text[:1] in "+-.0123456789" and text != "" and common_dimension(text) is not None

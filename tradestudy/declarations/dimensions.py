"""The dimension of values whose key does not determine it: swept values, ends of ranges, criteria."""

from __future__ import annotations

from tradestudy.units import (
    ANGLE,
    DATA,
    DURATION,
    ELECTRONS,
    EXPANSION,
    FRACTION,
    INVERSE_LENGTH,
    LENGTH,
    MASS,
    NUMBER,
    PIXELS,
    POWER,
    PRESSURE,
    SOLID_ANGLE,
    TEMPERATURE_DIFFERENCE,
    Dimension,
    UnitError,
    parse,
)

# A number without a unit is a plain number; only a percent sign makes it a fraction.
_DIMENSIONS: tuple[Dimension, ...] = (
    LENGTH, ANGLE, PIXELS, FRACTION, NUMBER, ELECTRONS, TEMPERATURE_DIFFERENCE, PRESSURE, EXPANSION, DURATION,
    INVERSE_LENGTH, MASS, POWER, DATA, SOLID_ANGLE,
)  # fmt: skip


def common_dimension(*texts: str) -> Dimension | None:
    """The first dimension in which all texts are valid, or None."""
    plain = not any("%" in text for text in texts)
    for dimension in (one for one in _DIMENSIONS if not (plain and one is FRACTION)):
        try:
            for text in texts:
                parse(text, dimension)
        except UnitError:
            continue
        return dimension
    return None

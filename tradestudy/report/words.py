"""Numbers and names of the results in words, as sentences and tables write them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tradestudy.units import FRACTION, LENGTH, pretty, significant
from tradestudy.wording import distance


def in_words(name: str) -> str:
    """Write a name of the results as words."""
    return name.replace("_", " ")


def or_dash(value: float, write: Callable[[float], str] = significant) -> str:
    """Write a number, or a dash where there is none."""
    return "—" if np.isnan(value) else write(value)


def length(value: float) -> str:
    """Write a length with the unit a person expects, not broken between number and unit."""
    return pretty(value, LENGTH).replace(" ", "\N{NO-BREAK SPACE}")


def interval(low: float, high: float) -> str:
    """Write the ends of an interval of distances [m], in one unit, with the digits that tell them apart."""
    if not np.isfinite([low, high]).all():
        return f"{distance(low)} – {distance(high)}"
    size, unit = (1.0, "m") if high >= 0.1 else (1e-3, "mm")
    width = (high - low) / size
    finest = min(width, low / size)
    decimals = max(0, 1 - int(np.floor(np.log10(finest)))) if finest > 0 else 3
    return f"{low / size:.{decimals}f} – {high / size:.{decimals}f}\N{NO-BREAK SPACE}{unit}"


def share(value: float) -> str:
    """Write a fraction in per cent."""
    return pretty(value, FRACTION).replace(" ", "\N{NO-BREAK SPACE}")

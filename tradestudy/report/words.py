"""Numbers and names of the results in words, as sentences and tables write them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from tradestudy.units import FRACTION, LENGTH, pretty, significant
from tradestudy.wording import distance

_NEGLIGIBLE = 0.01  # of a value: an error that the tolerance of most studies leaves


def in_words(name: str) -> str:
    """Write a name of the results as words."""
    return name.replace("_", " ")


_PARTS: Final[Mapping[str, str]] = {
    "noise": "matching noise",
    "interior orientation": "focal length and principal point",
    "array": "microlens positions",
    "ageing": "changes since calibration",
}


def part_words(name: str) -> str:
    """Describe a part of the error to a reader who has read nothing else."""
    return _PARTS.get(name, in_words(name))


def or_dash(value: float, write: Callable[[float], str] = significant) -> str:
    """Write a number, or a dash where there is none."""
    return "—" if np.isnan(value) else write(value)


def length(value: float, digits: int = 3) -> str:
    """Write a length with the usual unit, not broken between number and unit."""
    return pretty(value, LENGTH, digits).replace(" ", "\N{NO-BREAK SPACE}")


def with_error(value: float, error: float, write: Callable[[float, int], str] = length) -> str:
    """Write a value, and its error where that is not negligible."""
    if not np.isfinite([value, error]).all() or error <= _NEGLIGIBLE * abs(value):
        return write(value, 3)
    return f"{write(value, 3)} ± {write(error, 1)}"


def interval(low: float, high: float) -> str:
    """Write the ends of an interval of distances [m], in one unit, with the digits that distinguish them."""
    if np.isnan([low, high]).any():
        return "—"
    if not np.isfinite([low, high]).all():
        return f"{distance(low)} – {distance(high)}"
    size, unit = (1.0, "m") if high >= 0.1 else (1e-3, "mm")
    width = (high - low) / size
    finest = min(width, low / size)
    decimals = max(0, 1 - int(np.floor(np.log10(finest)))) if finest > 0 else 3
    return f"{low / size:.{decimals}f} – {high / size:.{decimals}f}\N{NO-BREAK SPACE}{unit}"


def share(value: float, digits: int = 3) -> str:
    """Write a fraction in per cent."""
    return pretty(value, FRACTION, digits).replace(" ", "\N{NO-BREAK SPACE}")

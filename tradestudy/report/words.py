"""Numbers and names of the results, as sentences and tables write them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from tradestudy.units import (
    ANGLE,
    FRACTION,
    LENGTH,
    NUMBER,
    PIXELS,
    Dimension,
    pretty,
    pretty_with_error,
    shows_error,
    significant,
    to_digit_of_error,
)
from tradestudy.wording import distance, in_words

_NEGLIGIBLE = 0.01  # of a value: most studies tolerate such an error


_PARTS: Final[Mapping[str, str]] = {
    "noise": "matching noise",
    "interior orientation": "errors in focal length and principal point",
    "array": "errors in the positions of the microlenses",
    "ageing": "changes since calibration",
    "relative rotation": "errors in the relative rotation of its two cameras",
    "relative position": "errors in the relative position of its two cameras",
}
_LENGTHS: Final = (
    "baseline",
    "focal_length",
    "principal_point",
    "mla_distance",
    "microlens",
    "array_offset",
    "pupil_distance",
    "field_curvature",
    "relative_translation",
    "board",
    "motion_scale",
)
_ANGLES: Final = ("yaw", "pitch", "roll", "array_tilt", "array_rotation", "baseline_direction", "relative_rotation")


def part_words(name: str) -> str:
    """Name a part of the error in words that need no explanation."""
    return _PARTS.get(name, in_words(name))


def parameter_dimension(name: str) -> Dimension:
    """The dimension of an inferred parameter, by its name in the results; a plain number where none is known."""
    if name.startswith("log_"):
        return NUMBER
    if name.endswith("_px"):
        return PIXELS
    plain = name.removeprefix("left_").removeprefix("right_")
    return ANGLE if plain.startswith(_ANGLES) else LENGTH if plain.startswith(_LENGTHS) else NUMBER


def or_dash(value: float, write: Callable[[float], str] = significant) -> str:
    """Write a number, or a dash if it is NaN."""
    return "—" if np.isnan(value) else write(value)


def length(value: float, digits: int = 3) -> str:
    """Write a length in its usual unit, with a no-break space."""
    return pretty(value, LENGTH, digits).replace(" ", "\N{NO-BREAK SPACE}")


def with_error(value: float, error: float, dimension: Dimension = LENGTH, negligible: float = _NEGLIGIBLE) -> str:
    """Write a value, and its error where that is not negligible, with no-break spaces."""
    return pretty_with_error(value, error, dimension, negligible).replace(" ", "\N{NO-BREAK SPACE}")


def distance_with_error(value: float, error: float) -> str:
    """Write a distance [m] in the unit of sentences, and its error where that is not negligible."""
    if not shows_error(value, error, LENGTH, _NEGLIGIBLE):
        return distance(value)
    size, unit = (1.0, "m") if abs(value) >= 0.1 else (1e-3, "mm")
    return f"{' ± '.join(to_digit_of_error(value / size, error / size))} {unit}".replace(" ", "\N{NO-BREAK SPACE}")


def interval(low: float, high: float) -> str:
    """Write the ends of an interval of distances [m] in one unit, with as many digits as distinguish them."""
    if np.isnan([low, high]).any():
        return "—"
    if not np.isfinite([low, high]).all():
        return f"{distance(low)} – {distance(high)}"
    size, unit = (1.0, "m") if high >= 0.1 else (1e-3, "mm")
    width = (high - low) / size
    finest = min(width, low / size)  # the smaller of both shows two digits
    decimals = max(0, 1 - int(np.floor(np.log10(finest)))) if finest > 0 else 3
    return f"{low / size:.{decimals}f} – {high / size:.{decimals}f}\N{NO-BREAK SPACE}{unit}"


def percent(value: float) -> str:
    """Write a fraction in per cent, however small, to two digits."""
    return f"{significant(100.0 * value, 2)}\N{NO-BREAK SPACE}%"


def share(value: float, digits: int = 3) -> str:
    """Write a fraction in per cent, or in ppm if it is small."""
    return pretty(value, FRACTION, digits).replace(" ", "\N{NO-BREAK SPACE}")

"""Results in words: their names, values, and places in an array."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import xarray as xr

from tradestudy.results.views.depth import field_words
from tradestudy.results.views.designs import path_words
from tradestudy.units import ANGLE, ELECTRONS, LENGTH, NUMBER, PIXELS, Dimension, pretty, significant
from tradestudy.wording import distance, fewest_digits, in_words

_BY_UNIT: Final[Mapping[str, Dimension]] = {
    "m": LENGTH, "rad": ANGLE, "px": PIXELS, "1": NUMBER, "electrons": ELECTRONS,
}  # fmt: skip
_LABELS: Final[Mapping[tuple[str, str], str]] = {
    ("side", "nearer"): "to the nearer side",
    ("side", "farther"): "to the farther side",
    ("error_source", "noise"): "noise only",
    ("error_source", "calibration"): "calibration only",
    ("error_source", "both"): "noise and calibration",
}
_UNNAMED_GROUPS: Final = ("depth", "depth_at_places", "disparity_causes")
_MOST_PERCENT: Final = 1000.0


def result_words(variable: str) -> str:
    """A variable of the results as words."""
    return in_words(variable)


def group_words(name: str) -> str:
    """The group of a variable in brackets, where the variable's name alone is ambiguous."""
    return "" if name in _UNNAMED_GROUPS else f" ({name.replace('_', ' ')})"


def known_dimension(array: xr.DataArray) -> Dimension | None:
    """The dimension of an array; None if its unit is not a known one."""
    return _BY_UNIT.get(str(array.attrs.get("units", "")))


def values_in_words(values: Sequence[float], dimension: Dimension | None) -> tuple[str, ...]:
    """Values with their unit and the digits that distinguish different ones; "none" for NaN."""
    different = len({value for value in values if not math.isnan(value)}) + any(map(math.isnan, values))

    def written(digits: int) -> tuple[str, ...]:
        return tuple(_written(value, dimension, digits) for value in values)

    return written(fewest_digits(lambda digits: len(set(written(digits))) >= different))


def _written(value: float, dimension: Dimension | None, digits: int) -> str:
    if math.isnan(value):
        return "none"
    return significant(value, digits) if dimension is None else pretty(value, dimension, digits)


def changes_in_words(values: Sequence[float]) -> str:
    """How much each value differs from the first, in brackets."""
    return f"({', '.join(_percent(values[0], value) for value in values[1:])})"


def _percent(before: float, after: float) -> str:
    """A change in per cent; beyond 1000 %, as a factor."""
    percent = 100.0 * (after / before - 1.0)
    if abs(percent) > _MOST_PERCENT:
        return f"{significant(after / before)} times"
    text = f"{percent:+.0f}" if abs(percent) >= 100.0 else f"{percent:+.2g}"
    return f"{text.replace('-', '−')} %"


def place_in_words(tree: xr.DataTree, values: xr.DataArray, at: tuple[int, ...], titles: Mapping[str, str]) -> str:
    """A place in an array, in words, without coordinates that do not matter: "at 2 m, noise only", "for f number 2"."""
    parts = [
        _coordinate(tree, dim, values[dim], at[axis], titles)
        for axis, dim in enumerate(map(str, values.dims))
        if dim.endswith("distance") or varies(values, axis, at)
    ]
    parts.sort(key=lambda part: not part.startswith("at "))
    return ("" if not parts or parts[0].startswith("at ") else "for ") + ", ".join(parts)


def varies(values: xr.DataArray, axis: int, at: tuple[int, ...]) -> bool:
    """Whether the values at a place vary along an axis."""
    here = np.moveaxis(np.asarray(values.values, dtype=np.float64), axis, -1)[(*at[:axis], *at[axis + 1 :])]
    return len(set(here[~np.isnan(here)].tolist())) > 1


def _coordinate(tree: xr.DataTree, dim: str, coordinate: xr.DataArray, position: int, titles: Mapping[str, str]) -> str:
    if dim not in coordinate.coords:
        return f"{dim.replace('_', ' ')} {position + 1}"
    label: Any = coordinate.values[position]
    if dim == "field":
        return field_words(float(label))
    if dim == "corner":
        return f"towards the {label} corner"
    name = path_words(tree, dim) if "." in dim else result_words(dim)  # swept
    if isinstance(label, str):
        return _LABELS.get((dim, label), f"{name} {titles.get(label, label)}")
    if dim.endswith("distance"):
        return f"at {distance(float(label))}"
    return f"{name} {values_in_words((float(label),), known_dimension(coordinate))[0]}"

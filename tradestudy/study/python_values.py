"""Values from Python as a study file has them: arrays as lists, quantities with units as text."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

import numpy as np

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.document import Value
from tradestudy.units import LENGTH, parse


def plain_value(value: Any) -> Value:
    """A value of Python as plain text, number, list or mapping.

    Quantities of pint, and arrays of xarray whose attribute ``units`` names a unit, become text with that unit.
    """
    if isinstance(value, str | bool | int | float) and not isinstance(value, np.generic):
        return value
    if isinstance(value, Mapping):
        return {key: plain_value(item) for key, item in value.items()}
    if isinstance(value, list | tuple | range):
        return [plain_value(item) for item in value]
    unit, numbers = _unit_and_numbers(value)
    return _with_unit(numbers, unit)


def in_metres(distance: Any) -> FloatArray:
    """Distances of any shape [m] from numbers [m], text with a unit, quantities of pint or arrays of xarray.

    Raises
    ------
    OutOfRangeError
        If they are no positive, finite lengths.
    """
    unit, numbers = _unit_and_numbers(distance)
    try:
        if isinstance(numbers, str):
            metres = np.asarray(parse(numbers, LENGTH))
        else:
            metres = np.asarray(numbers, dtype=np.float64) * (
                parse(f"1 {unit}", LENGTH) if unit not in ("", "m") else 1.0
            )
    except (TypeError, ValueError) as error:
        raise OutOfRangeError("this is not a distance", value=f"{distance!r:.60}", remedy=str(error)) from None
    wrong = metres[~((metres > 0.0) & np.isfinite(metres))]
    if wrong.size:
        raise OutOfRangeError("distance", value=f"{wrong[0]:g} m", limit="positive and finite")
    return metres


def _unit_and_numbers(value: Any) -> tuple[str, Any]:
    """The unit of a quantity or of an array with units, "" without one; and its numbers in plain lists."""
    if hasattr(value, "magnitude") and hasattr(value, "units"):
        return f"{value.units:~C}", _unit_and_numbers(value.magnitude)[1]
    unit = str(getattr(value, "attrs", {}).get("units", ""))
    return ("" if unit == "1" else unit), value.tolist() if hasattr(value, "tolist") else _listed(value)


def _listed(value: Any) -> Any:
    return value.to_numpy().tolist() if hasattr(value, "to_numpy") else value


def _with_unit(numbers: Any, unit: str) -> Value:
    if isinstance(numbers, list):
        return [_with_unit(number, unit) for number in numbers]
    return f"{numbers!r} {unit}" if unit else cast(Value, numbers)

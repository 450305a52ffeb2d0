"""Arguments of public functions: a wrong type raises TypeError by name, lists become arrays; wavelengths and angles."""

from __future__ import annotations

import math
import numbers
import types
import typing
from collections.abc import Sequence
from functools import cache, wraps
from inspect import signature
from typing import Any, Final, TypeVar

import numpy as np
import numpy.typing as npt

from tradestudy.errors import OutOfRangeError

T = TypeVar("T", bound=Any)
_SI: Final = ("", "1", "m", "1/m", "rad")
_HINTS: Final = {
    "a PointSource": "; give PointSource(distance=…) or PointSource.at_infinity()",
    "a Pupil": "; give Pupil.from_waves({8: 0.1}, wavelength=550e-9) for a tenth of a wave of coma",
    "a Legs": "; give KIRCHHOFF, KIRCHHOFF_FRESNEL, FRESNEL, GEOMETRIC, EXACT_RAYS or Legs(…)",
}


def checked(target: T) -> T:
    """Fit the arguments of a function, or of a dataclass, to its annotations.

    Whole numbers become real ones and numbers of NumPy become Python's; lists become arrays.

    Raises
    ------
    TypeError
        Raised by the returned function or class, if an argument does not fit.
    """
    if isinstance(target, type):
        target.__init__ = checked(target.__init__)  # type: ignore[misc]
        return target
    names = tuple(signature(target).parameters)

    @cache  # at the first call, because annotations may name classes that are defined further down
    def hints() -> dict[str, Any]:
        return typing.get_type_hints(target)

    def fitting(name: str, value: Any) -> Any:
        hint = hints().get(name, Any)
        if hint is Any or type(value) is hint:
            return value
        try:
            return _fit(hint, value)
        except (TypeError, ValueError, OverflowError) as unfit:
            shown = repr(value) if len(repr(value)) <= 60 else f"a {type(value).__name__}"
            hint = next((hint for kind, hint in _HINTS.items() if kind in str(unfit)), "")
            raise TypeError(f"{name} must be {unfit}, not {shown}{hint}") from None

    @wraps(target)
    def call(*args: Any, **kwargs: Any) -> Any:
        placed = [fitting(*pair) for pair in zip(names, args, strict=False)]
        named = {name: fitting(name, value) for name, value in kwargs.items()}
        return target(*placed, *args[len(placed) :], **named)  # Python itself refuses more arguments than names

    return typing.cast(T, call)


def _fit(hint: Any, value: Any) -> Any:
    """The value in the type of the hint; the error says what the value must be."""
    origin, parts = typing.get_origin(hint), typing.get_args(hint)
    if hint == npt.ArrayLike or origin in (np.ndarray, Sequence):
        return _array(parts[1] if origin is np.ndarray else None, value)
    if origin in (typing.Union, types.UnionType):
        refusals = []
        for part in parts:
            try:
                return value if type(value) is part else _fit(part, value)
            except (TypeError, ValueError, OverflowError) as unfit:
                refusals.append(str(unfit))
        raise TypeError(" or ".join(dict.fromkeys(refusals)))
    if hint in (float, int):
        return _number(hint, value)
    if origin is tuple and parts[-1] is not Ellipsis:
        values = value.tolist() if isinstance(value, np.ndarray) else value
        if not isinstance(values, (tuple, list)) or len(values) != len(parts):
            raise TypeError(f"{len(parts)} values, ({', '.join('abcdef'[: len(parts)])})")
        return tuple(map(_fit, parts, values))
    kind = hint if origin is None else origin
    checkable = isinstance(kind, type) and kind is not Any and not getattr(kind, "_is_protocol", False)
    if checkable and not isinstance(value, kind):
        raise TypeError("None" if kind is types.NoneType else f"a {kind.__name__}")
    return value


def _number(kind: type, value: Any) -> Any:
    """A number of Python: of NumPy's, whole ones overflow silently and those of single precision round."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value.item()
    if isinstance(value, bool) or not isinstance(value, numbers.Real if kind is float else numbers.Integral):
        raise TypeError("a number in SI units" if kind is float else "a whole number")
    try:
        return kind(value)
    except OverflowError:
        raise OverflowError("a number below 1.8e308") from None


def _array(dtype: Any, value: Any) -> Any:
    """Array of the type; whole numbers become real ones, and real ones complex, but never the reverse."""
    (kind,) = typing.get_args(dtype) or (np.float64,)
    expected = np.dtype(kind if isinstance(kind, type) and issubclass(kind, np.generic) else np.float64)
    if isinstance(value, np.ma.MaskedArray) and value.mask.any():
        raise ValueError("an array without masked values")
    held = value.data if hasattr(value, "attrs") and hasattr(value, "data") else value  # of an array of xarray
    unit = getattr(held, "units", getattr(value, "attrs", {}).get("units", "1"))  # NumPy would drop it silently
    if str(unit) not in _SI:
        raise TypeError("a number, a list or an array of numbers in SI units")
    try:
        array = np.asarray(value)
    except (TypeError, ValueError):
        array = np.empty(1, dtype=object)  # ragged, or quantities
    if array.size == 0 and array.dtype == np.float64:
        return array.astype(expected)
    if array.dtype.kind not in "buifc" or not np.can_cast(array.dtype, expected, casting="same_kind"):
        raise TypeError("a number, a list or an array of numbers in SI units")
    return array.astype(expected, copy=False)


def check_wavelength(wavelength: float) -> None:
    """Refuse a wavelength that is not positive and finite [m].

    Raises
    ------
    OutOfRangeError
        If the wavelength is not positive and finite.
    """
    if not 0 < wavelength < math.inf:
        raise OutOfRangeError(
            "wavelength",
            value=f"{wavelength:g} m",
            limit="> 0, finite",
            remedy="give it in metres: 550 nm are 550e-9",
        )


def check_angle(angle: float) -> None:
    """Refuse a direction [rad] of more than a full turn, such as one given in degrees.

    Raises
    ------
    OutOfRangeError
        If the angle exceeds a full turn.
    """
    if not abs(angle) <= math.tau:
        raise OutOfRangeError(
            "angle",
            value=f"{angle:g} rad",
            limit="between −2π and 2π",
            remedy="measure it from the x axis in radians: 90° are 1.5708",
        )

"""Check arguments: wrong types, impossible wavelengths and angles are refused by name; lists become arrays."""

from __future__ import annotations

import math
import numbers
import types
import typing
from collections.abc import Callable, Mapping, Sequence
from functools import cache, wraps
from inspect import signature
from typing import Any, Final, ParamSpec, TypeVar

import numpy as np
import numpy.typing as npt

from tradestudy.errors import OutOfRangeError

P = ParamSpec("P")
R = TypeVar("R")
C = TypeVar("C")

_NUMBER: Final = ("a number", "give one number, in SI units: 50 mm are 50e-3")
_WHOLE: Final = ("a whole number", "give one whole number, such as 3")
_REMEDIES: Final = {
    "PointSource": "give PointSource(distance=…) or PointSource.at_infinity()",
    "Pupil": "give Pupil.from_waves({8: 0.1}, wavelength=550e-9) for a tenth of a wave of coma",
    "Legs": "give KIRCHHOFF, KIRCHHOFF_FRESNEL, FRESNEL, GEOMETRIC, EXACT_RAYS or Legs(…)",
}
_NUMBERS: Final = ("an array of numbers", "give a number, a list or an array of numbers in SI units")


class _UnfitError(Exception):
    """A value does not fit its type annotation; carries what is allowed and the remedy."""

    def __init__(self, limit: str, remedy: str) -> None:
        self.limit, self.remedy = limit, remedy


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """Check the arguments of a function or method against its annotations.

    Raises
    ------
    OutOfRangeError
        Raised by the returned function, if an argument has the wrong type.
    """
    parameters = signature(function)

    @cache
    def hints() -> dict[str, Any]:
        return typing.get_type_hints(function)

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            given = parameters.bind(*args, **kwargs)
        except TypeError:
            return function(*args, **kwargs)  # Python names the missing or unknown argument
        _check_all(given.arguments, hints())
        return function(*given.args, **given.kwargs)

    return call


def checked_fields(cls: type[C]) -> type[C]:
    """Check the arguments of a dataclass against its fields.

    Raises
    ------
    OutOfRangeError
        Raised by the class, if an argument has the wrong type.
    """
    made = cls.__init__

    @cache
    def hints() -> dict[str, Any]:
        return typing.get_type_hints(cls)

    @wraps(made)
    def init(self: C, *args: Any, **kwargs: Any) -> None:
        if type(self) is cls:
            _check_all(kwargs, hints())
        made(self, *args, **kwargs)

    cls.__init__ = init  # type: ignore[method-assign, assignment]
    return cls


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


def _check_all(arguments: dict[str, Any], hints: Mapping[str, Any]) -> None:
    for name, value in arguments.items():
        if type(value) is not hints.get(name, object):
            try:
                arguments[name] = _taken(hints.get(name, Any), value)
            except _UnfitError as unfit:
                raise OutOfRangeError(name, value=_shown(value), limit=unfit.limit, remedy=unfit.remedy) from None


def _shown(value: object) -> str:
    return repr(value) if len(repr(value)) <= 60 else f"a {type(value).__name__}"


def _taken(hint: Any, value: Any) -> Any:
    """Return the value in the type of the annotation, or raise `_UnfitError`."""
    origin, parts = typing.get_origin(hint), typing.get_args(hint)
    if hint == npt.ArrayLike or origin is np.ndarray:
        return _array(value, parts[1] if origin is np.ndarray else None)
    if origin in (typing.Union, types.UnionType):
        return _one_of(parts, value)
    if hint is float or hint is int:
        return _number(hint, value)
    if origin is tuple:
        return _tuple(parts, value)
    if origin is Sequence:
        return _array(value, np.dtype[np.float64])
    if origin is Mapping:
        if not isinstance(value, Mapping):
            raise _UnfitError("a dictionary", "give it as {8: 0.1}")
        return value
    if origin is Callable:
        if not callable(value):
            raise _UnfitError("a function", "give a function")
        return value
    checkable = isinstance(hint, type) and hint is not Any and not getattr(hint, "_is_protocol", False)
    if checkable and not isinstance(value, hint):
        remedy = _REMEDIES.get(hint.__name__, f"give {hint.__name__}(…); see its help")
        raise _UnfitError(f"a {hint.__name__}", remedy)
    return value


def _one_of(hints: Sequence[Any], value: Any) -> Any:
    if type(value) in hints:
        return value
    unfit = []
    for hint in hints:
        try:
            return _taken(hint, value)
        except _UnfitError as one:
            if hint is not types.NoneType:
                unfit.append(one)
    raise _UnfitError(" or ".join(dict.fromkeys(one.limit for one in unfit)), unfit[0].remedy)


def _number(hint: type, value: Any) -> Any:
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value.item()
    if not isinstance(value, numbers.Real if hint is float else numbers.Integral):
        raise _UnfitError(*(_NUMBER if hint is float else _WHOLE))
    return value


def _tuple(hints: Sequence[Any], value: Any) -> Any:
    if hints[-1] is Ellipsis:
        return value
    if not isinstance(value, (tuple, list, np.ndarray)) or len(value) != len(hints):
        raise _UnfitError(f"{len(hints)} values", f"give them as ({', '.join('abcdef'[: len(hints)])})")
    return tuple(_taken(hint, one) for hint, one in zip(hints, value, strict=True))


def _array(value: Any, dtype: Any) -> Any:
    """Convert to an array; whole numbers become real ones, and real ones complex, but never the reverse."""
    (kind,) = typing.get_args(dtype) or (np.float64,)
    try:
        found = np.asarray(value)
    except ValueError:
        raise _UnfitError(*_NUMBERS) from None
    expected = np.dtype(kind) if isinstance(kind, type) and issubclass(kind, np.generic) else np.dtype(np.float64)
    if found.size == 0 and found.dtype == np.float64:
        return found.astype(expected)
    if found.dtype.kind not in "buifc" or not np.can_cast(found.dtype, expected, casting="same_kind"):
        raise _UnfitError(*_NUMBERS)
    return found.astype(expected, copy=False)

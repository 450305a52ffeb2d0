"""Check arguments: wrong types, impossible wavelengths and angles are refused by name; lists become arrays."""

from __future__ import annotations

import math
import numbers
import sys
import types
import typing
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial, wraps
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
    names = tuple(signature(function).parameters)

    @cache
    def rules() -> dict[str, _Rule]:
        return _rules(typing.get_type_hints(function))

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        known = rules()
        if args:
            placed = dict(zip(names, args, strict=False))  # Python refuses more arguments than there are names
            _check_all(placed, known)
            args = (*placed.values(), *args[len(names) :])  # type: ignore[assignment]
        _check_all(kwargs, known)
        return function(*args, **kwargs)

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
    def rules() -> dict[str, _Rule]:
        return _rules(typing.get_type_hints(cls))

    @wraps(made)
    def init(self: C, *args: Any, **kwargs: Any) -> None:
        if type(self) is cls:
            _check_all(kwargs, rules())
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


@dataclass(frozen=True)
class _Rule:
    """What an argument may be: values of `at_once` as they are, others as `taken` returns them."""

    at_once: frozenset[type]
    taken: Callable[[Any], Any]


def _rules(hints: Mapping[str, Any]) -> dict[str, _Rule]:
    return {name: _rule(hint) for name, hint in hints.items() if name != "return"}


def _check_all(arguments: dict[str, Any], rules: Mapping[str, _Rule]) -> None:
    for name, value in arguments.items():
        rule = rules.get(name)
        if rule is None or type(value) in rule.at_once:
            continue
        try:
            arguments[name] = rule.taken(value)
        except _UnfitError as unfit:
            raise OutOfRangeError(name, value=_shown(value), limit=unfit.limit, remedy=unfit.remedy) from None


def _shown(value: object) -> str:
    return repr(value) if len(repr(value)) <= 60 else f"a {type(value).__name__}"


@cache
def _rule(hint: Any) -> _Rule:
    """Rule of a hint; its function raises `_UnfitError`."""
    origin, parts = typing.get_origin(hint), typing.get_args(hint)
    if hint == npt.ArrayLike or origin in (np.ndarray, Sequence):
        return _Rule(frozenset(), partial(_array, _number_type(parts[1] if origin is np.ndarray else None)))
    if origin in (typing.Union, types.UnionType):
        at_once = frozenset[type]().union(*(_rule(part).at_once for part in parts))
        return _Rule(at_once, partial(_one_of, [_rule(part).taken for part in parts if part is not types.NoneType]))
    if hint is float or hint is int:
        return _Rule(frozenset([hint]), partial(_number, hint))
    if origin is tuple and parts[-1] is not Ellipsis:
        return _Rule(frozenset(), partial(_tuple, [_rule(part) for part in parts]))
    if origin is Mapping:
        return _Rule(frozenset(), partial(_instance, Mapping, "a dictionary", "give it as {8: 0.1}"))
    if origin is Callable:
        return _Rule(frozenset([types.FunctionType]), _function)
    if isinstance(hint, type) and hint is not Any and not getattr(hint, "_is_protocol", False):
        remedy = _REMEDIES.get(hint.__name__, f"give {hint.__name__}(…); see its help")
        return _Rule(frozenset([hint]), partial(_instance, hint, f"a {hint.__name__}", remedy))
    return _Rule(frozenset(), lambda value: value)


def _one_of(choices: Sequence[Callable[[Any], Any]], value: Any) -> Any:
    unfit = []
    for taken in choices:
        try:
            return taken(value)
        except _UnfitError as one:
            unfit.append(one)
    raise _UnfitError(" or ".join(dict.fromkeys(one.limit for one in unfit)), unfit[0].remedy)


def _number(hint: Callable[[Any], Any], value: Any) -> Any:
    """A number of Python: of NumPy's, whole ones overflow silently and those of single precision round."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value.item()
    if isinstance(value, bool) or not isinstance(value, numbers.Real if hint is float else numbers.Integral):
        raise _UnfitError(*(_NUMBER if hint is float else _WHOLE))
    try:
        return hint(value)
    except OverflowError:
        raise _UnfitError(f"at most {sys.float_info.max:.3g}", _NUMBER[1]) from None


def _tuple(rules: Sequence[_Rule], value: Any) -> Any:
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if not isinstance(value, (tuple, list)) or len(value) != len(rules):
        raise _UnfitError(f"{len(rules)} values", f"give them as ({', '.join('abcdef'[: len(rules)])})")
    return tuple(one if type(one) in rule.at_once else rule.taken(one) for rule, one in zip(rules, value, strict=True))


def _function(value: Any) -> Any:
    if not callable(value):
        raise _UnfitError("a function", "give a function")
    return value


def _instance(hint: type, limit: str, remedy: str, value: Any) -> Any:
    if not isinstance(value, hint):
        raise _UnfitError(limit, remedy)
    return value


def _number_type(dtype: Any) -> np.dtype[Any]:
    """Type of numbers of an array; real in double precision where the hint leaves it open."""
    (kind,) = typing.get_args(dtype) or (np.float64,)
    return np.dtype(kind if isinstance(kind, type) and issubclass(kind, np.generic) else np.float64)


def _array(expected: np.dtype[Any], value: Any) -> Any:
    """Array of the type; whole numbers become real ones, and real ones complex, but never the reverse."""
    if type(value) is np.ndarray and value.dtype == expected:
        return value
    if isinstance(value, np.ma.MaskedArray) and value.mask.any():
        raise _UnfitError("an array without masked values", "fill or leave out the masked values")
    try:
        found = np.asarray(value)
    except ValueError:
        raise _UnfitError(*_NUMBERS) from None
    if found.size == 0 and found.dtype == np.float64:
        return found.astype(expected)
    if found.dtype.kind not in "buifc" or not np.can_cast(found.dtype, expected, casting="same_kind"):
        raise _UnfitError(*_NUMBERS)
    return found.astype(expected, copy=False)

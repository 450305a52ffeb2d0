"""Hashes of everything that determines a value to the bit: the content of its point, the code and the libraries."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache, partial
from importlib.metadata import version
from pathlib import PurePath
from types import FunctionType, MethodType
from typing import Any

import numpy as np

from tradestudy.provenance import code_hash

_COMPUTING = ("numpy", "scipy", "finufft", "emcee", "arviz-stats")


def fingerprint(*values: object) -> bytes:
    """SHA-256 of numbers, strings, arrays, ordered mappings, lists, dataclasses, module-level functions and classes.

    Pickles are unsuitable: their bytes depend on object identities and on the order of sets.

    Raises
    ------
    TypeError
        For any other value, since different values must never share a hash.
    """
    parts: list[bytes] = []
    _tell(values, parts)
    return hashlib.sha256(b"".join(parts)).digest()


def _tell(value: Any, parts: list[bytes]) -> None:
    kind = type(value)
    if value is None or kind in (bool, int, float):
        parts.append(f"{kind.__name__} {value!r};".encode())
    elif kind in (str, bytes):
        content = value.encode() if kind is str else value
        parts += (f"{kind.__name__} {len(content)}:".encode(), content)
    elif kind in (tuple, list):
        parts.append(f"{kind.__name__} {len(value)}:".encode())
        for item in value:
            _tell(item, parts)
    elif isinstance(value, np.ndarray | np.generic) and not value.dtype.hasobject:
        parts += (f"{value.dtype.str} {value.shape}:".encode(), value.tobytes())
    elif isinstance(value, Enum):
        parts.append(f"{_name(kind)}.{value.name};".encode())
    elif isinstance(value, Mapping):
        parts.append(f"mapping {len(value)}:".encode())
        for item in value.items():
            _tell(item, parts)
    elif isinstance(value, FunctionType | type) and "<" not in value.__qualname__:
        parts.append(f"{_name(value)};".encode())
    elif isinstance(value, PurePath):
        _tell(("path", str(value)), parts)
    else:
        inside = _inside(value)
        if inside is None:
            raise TypeError(f"{_name(kind)} has no fingerprint")
        parts.append(f"{_name(kind)} {len(inside)}:".encode())
        for item in inside:
            _tell(item, parts)


def _inside(value: Any) -> list[Any] | None:
    """The parts of an object; None if they are unknown."""
    names = _fields_of(value.__class__)
    if names is not None:
        return [getattr(value, name) for name in names]
    if isinstance(value, partial):
        return [value.func, value.args, value.keywords]
    if isinstance(value, MethodType):
        return [value.__self__, value.__func__]
    return None


@cache
def _fields_of(kind: type) -> tuple[str, ...] | None:
    if is_dataclass(kind):
        return tuple(one.name for one in fields(kind))
    if hasattr(kind, "model_fields"):  # parts of a study file
        return tuple(kind.model_fields)
    return None


def _name(what: type | FunctionType) -> str:
    return f"{what.__module__}.{what.__qualname__}"


@cache
def environment() -> dict[str, str]:
    """Hash of this package's sources, and the versions of Python and of the libraries that compute numbers."""
    return {
        "tradestudy": code_hash(),
        "python": platform.python_version(),
        **{name: version(name) for name in _COMPUTING},
    }

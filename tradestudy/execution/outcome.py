"""What became of one point: its value, or the error that it raised, fit to travel between processes."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

Point = TypeVar("Point")
Value = TypeVar("Value")


@dataclass(frozen=True)
class Raised:
    """An error on its way to whoever asked; its traceback travels as a note, for ``--debug``."""

    error: Exception

    def __reduce__(self) -> tuple[Any, ...]:
        trace = "".join(traceback.format_exception(self.error))
        return _raised_elsewhere, (type(self.error), self.error.args, dict(self.error.__dict__), trace)


def _raised_elsewhere(kind: type[Exception], arguments: tuple[Any, ...], state: dict[str, Any], trace: str) -> Raised:
    # Not through the constructor: those of this package take keywords, which the standard way of exceptions drops.
    error = kind.__new__(kind, *arguments)
    error.args = arguments
    error.__dict__.update(state)
    error.add_note(f"where it was computed:\n{trace}")
    return Raised(error)


def attempt(function: Callable[[Point], Value], point: Point) -> Value | Raised:
    """Compute one point."""
    try:
        return function(point)
    except Exception as error:
        return Raised(error)

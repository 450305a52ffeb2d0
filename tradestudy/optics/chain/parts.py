"""Independent parts of an image, computed one after another here or on the caller's workers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

Part = Callable[[], Any]
"""A ``functools.partial`` of a module's function and plain arguments, so that other processes can compute it."""


class ComputeParts(Protocol):
    """Function that computes parts; the values must not depend on where it computes them."""

    def __call__(self, parts: Sequence[Part], progress: Callable[[float], None]) -> list[Any]:
        """Values of the parts in their order; ``progress`` is called with the completed share."""
        ...


def in_turn(parts: Sequence[Part], progress: Callable[[float], None]) -> list[Any]:
    """Compute parts in this process, one after another."""
    values = []
    for number, part in enumerate(parts, start=1):
        values.append(part())
        progress(number / len(parts))
    return values


def call(part: Part) -> Any:
    """Compute one part; defined at module level so that workers can load it."""
    return part()

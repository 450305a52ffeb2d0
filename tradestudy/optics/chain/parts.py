"""Independent parts of an image: computed here one after another, or wherever the caller has them computed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

Part = Callable[[], Any]
"""A ``functools.partial`` of a module's function and plain arguments, so that other processes can compute it."""


class ComputeParts(Protocol):
    """What computes parts; the values must not depend on where."""

    def __call__(self, parts: Sequence[Part], told: Callable[[float], None]) -> list[Any]:
        """Values of the parts in their order; ``told`` hears what share of them is done."""
        ...


def in_turn(parts: Sequence[Part], told: Callable[[float], None]) -> list[Any]:
    """Compute parts here, one after another."""
    values = []
    for number, part in enumerate(parts, start=1):
        values.append(part())
        told(number / len(parts))
    return values


def call(part: Part) -> Any:
    """Compute one part: the function of a module that workers need."""
    return part()

"""Probability distributions of uncertain quantities, and their propagation through any function.

`propagate_through` takes a function and one of these distributions for each of its inputs.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tradestudy.uncertainty.any_function import Spread, propagate_through
    from tradestudy.uncertainty.distributions import (
        Arcsine,
        CurvilinearTrapezoid,
        Empirical,
        Normal,
        StudentT,
        Triangular,
        Uniform,
    )

__all__ = [
    "Arcsine",
    "CurvilinearTrapezoid",
    "Empirical",
    "Normal",
    "Spread",
    "StudentT",
    "Triangular",
    "Uniform",
    "propagate_through",
]


def __getattr__(name: str) -> Any:
    # Loading each module on first use keeps imports fast.
    if name in __all__:
        module = "any_function" if name in ("Spread", "propagate_through") else "distributions"
        return getattr(importlib.import_module(f"tradestudy.uncertainty.{module}"), name)
    raise AttributeError(f"module 'tradestudy.uncertainty' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__

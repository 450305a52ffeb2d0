"""How a computation tells how far it is."""

from __future__ import annotations

from collections.abc import Callable

# Called with the name of a step and the share of it that is done, 0 … 1.
Progress = Callable[[str, float], None]

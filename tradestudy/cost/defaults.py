"""What a measurement of cost takes unless said otherwise; apart, so that the command line knows it without numpy."""

from __future__ import annotations

from typing import Final

FEWEST_REPEATS: Final = 3
# Seven minutes take the next digit of the largest picture of a shipped study, and what it is held against [s].
DEFAULT_BUDGET: Final = 480.0

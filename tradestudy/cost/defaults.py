"""What a measurement of cost takes unless said otherwise; apart, so that the command line knows it without numpy."""

from __future__ import annotations

from typing import Final

FEWEST_REPEATS: Final = 3
# Of seconds: four minutes take the next digit of the largest picture of a shipped study.
DEFAULT_BUDGET: Final = 480.0

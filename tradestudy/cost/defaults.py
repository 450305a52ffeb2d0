"""What a measurement of cost takes unless said otherwise; apart, so that the command line knows it without numpy."""

from __future__ import annotations

from typing import Final

FEWEST_REPEATS: Final = 3
DEFAULT_BUDGET: Final = 300.0  # seconds

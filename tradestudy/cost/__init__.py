"""What accuracy costs: error against seconds, measured, for sets of models and settings that can answer a question."""

from typing import Final

DEFAULT_BUDGET: Final = 120.0
"""Time for all measurements of a study [s] unless said otherwise; here, so that the command line needs no numpy."""

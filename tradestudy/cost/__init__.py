"""What accuracy costs: measured error against time for every set of models and settings that can answer a question."""

from typing import Final

DEFAULT_BUDGET: Final = 120.0
"""Default time for all measurements of a study [s]; defined here so that the command line need not import numpy."""

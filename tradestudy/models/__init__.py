"""Which models a study calls for: the answers with and without them, and what accuracy costs."""

from typing import Final

DEFAULT_BUDGET: Final = 120.0
"""Default time for all measurements of accuracy [s]; here, so that the command line need not import numpy."""

"""How a variable of the results is declared."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

PAPER: Final = "Diffraction model of a plenoptic camera for in-situ space exploration"
ROUNDING: Final = "closed form; rounding only"
SEE_ERROR: Final = "see depth_uncertainty_error"


@dataclass(frozen=True, kw_only=True)
class Variable:
    """One variable of the results.

    Parameters
    ----------
    dims
        Dimensions after those of the study's sweep.
    units
        SI, "1" for a plain number, "" for text.
    long_name
        What it is.
    symbol, reference
        In the equations, and where they stand.
    error
        Where its error estimate is found, or why it is exact.
    """

    dims: tuple[str, ...]
    units: str
    long_name: str
    symbol: str = ""
    reference: str = ""
    error: str = ""

"""The declaration of a variable of the results."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

PAPER: Final = "Diffraction model of a plenoptic camera for in-situ space exploration"
ROUNDING: Final = "rounding only"
EXACT: Final = "none: exact"
DECLARED: Final = "none: declared"
COUNTED: Final = "none: a count"
ESTIMATE: Final = "itself an error estimate"
SEE_ERROR: Final = "see depth_uncertainty_error"


@dataclass(frozen=True, kw_only=True)
class Variable:
    """One variable of the results.

    Parameters
    ----------
    dims
        Dimensions, after those of the study's sweep.
    units
        SI unit, "1" for a plain number, "" for text.
    long_name
        What the variable is.
    symbol, reference
        Its symbol, and the source of its equation.
    error
        The variable with its error estimate, or why it is exact. `compare` reads it, and the words "standard error" in
        the ``long_name`` of that variable.
    """

    dims: tuple[str, ...]
    units: str
    long_name: str
    symbol: str = ""
    reference: str = ""
    error: str = ""

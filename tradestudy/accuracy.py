"""Tolerances on the changes that simplifications may cause in a study's answers, and the time limit of a run."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal, get_args

from tradestudy.errors import OutOfRangeError

Quantity = Literal["depth_uncertainty", "usable_range", "depth_noise", "depth_of_field", "pixel_intensity", "psf_width"]
QUANTITIES: Final[tuple[Quantity, ...]] = get_args(Quantity)
IN_WORDS: Final[Mapping[Quantity, str]] = {
    "depth_uncertainty": "depth uncertainty",
    "usable_range": "ends of the usable range",
    "depth_noise": "depth uncertainty from noise alone",
    "depth_of_field": "ends of the depth of field",
    "pixel_intensity": "pixel intensity (relative RMS over the picture)",
    "psf_width": "width of a point's image",
}


@dataclass(frozen=True, kw_only=True)
class Accuracy:
    """The tolerance on each quantity's relative change due to omitted effects, and the time limit of the run.

    Parameters
    ----------
    tolerances
        Largest relative change that all omissions together may cause: in the depth uncertainty, the ends of usable
        ranges, the depth uncertainty from noise alone (only where a study asks for it), the ends of the depth of field,
        pixel intensities (L2 over the picture), and the width of a point's image.
    time_limit
        Time limit [s]; infinite for none.

    Raises
    ------
    OutOfRangeError
        If a tolerance is not positive and finite, or the time limit is not positive.
    """

    tolerances: Mapping[Quantity, float]
    time_limit: float = math.inf

    def __post_init__(self) -> None:
        for name, value in self.tolerances.items():
            if not 0.0 < value < math.inf:
                raise OutOfRangeError(f"tolerance of {name}", value=f"{value:g}", limit="> 0, finite")
        if not self.time_limit > 0.0:
            raise OutOfRangeError("time limit", value=f"{self.time_limit:g} s", limit="> 0 s")

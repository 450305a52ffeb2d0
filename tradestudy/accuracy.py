"""How far simplifications may move the answers of a study, per quantity, and how long a run may take."""

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
    "depth_noise": "depth uncertainty by noise alone",
    "depth_of_field": "ends of the depth of field",
    "pixel_intensity": "pixel intensity (relative L2 over the picture)",
    "psf_width": "width of a point's image",
}


@dataclass(frozen=True, kw_only=True)
class Accuracy:
    """The relative change that each quantity may suffer from what is left out, and the time that all may take.

    Parameters
    ----------
    tolerances
        Largest relative change that all omissions together may make: of the depth uncertainty, of the ends of usable
        ranges, of the part of the uncertainty that noise makes (only where a study asks for it), of the ends of the
        depth of field, of pixel intensities (L2 over the picture), of the width of a point's image.
    time_limit
        Seconds; infinite where time is no concern.

    Raises
    ------
    OutOfRangeError
        If a tolerance or the time limit is not positive.
    """

    tolerances: Mapping[Quantity, float]
    time_limit: float = math.inf

    def __post_init__(self) -> None:
        for name, value in self.tolerances.items():
            if not 0.0 < value < math.inf:
                raise OutOfRangeError(f"tolerance of {name}", value=f"{value:g}", limit="> 0, finite")
        if not self.time_limit > 0.0:
            raise OutOfRangeError("time limit", value=f"{self.time_limit:g} s", limit="> 0 s")

    @classmethod
    def of_all(cls, tolerance: float, time_limit: float = math.inf) -> Accuracy:
        """One tolerance for every quantity, noise by itself among them."""
        return cls(tolerances=dict.fromkeys(QUANTITIES, tolerance), time_limit=time_limit)

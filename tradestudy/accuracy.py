"""How accurate the answers shall be, per quantity, and how long they may take."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal, get_args

from tradestudy.errors import OutOfRangeError

Quantity = Literal["depth_uncertainty", "depth_of_field", "pixel_intensity", "psf_width"]
QUANTITIES: Final[tuple[Quantity, ...]] = get_args(Quantity)


@dataclass(frozen=True, kw_only=True)
class Accuracy:
    """The relative error that each quantity may have through what is left out, and the time that all may take.

    Parameters
    ----------
    relative
        Largest relative change that all omissions together may make, for every quantity: of the depth uncertainty, of
        the ends of the depth of field, of the pixel intensities (L2 over the picture), of the width of a point's image.
    budget
        Seconds; infinite where time is no concern.

    Raises
    ------
    OutOfRangeError
        If a quantity is missing, an error is not positive, or the budget is not positive.
    """

    relative: Mapping[Quantity, float]
    budget: float = math.inf

    def __post_init__(self) -> None:
        if set(self.relative) != set(QUANTITIES):
            raise OutOfRangeError("accuracy", value=", ".join(self.relative), limit=", ".join(QUANTITIES))
        for name, value in self.relative.items():
            if not 0.0 < value < math.inf:
                raise OutOfRangeError(f"relative error wanted of {name}", value=f"{value:g}", limit="> 0, finite")
        if not self.budget > 0.0:
            raise OutOfRangeError("time budget", value=f"{self.budget:g} s", limit="> 0 s")

    @classmethod
    def of_all(cls, relative: float, budget: float = math.inf) -> Accuracy:
        """The same relative error for every quantity."""
        return cls(relative=dict.fromkeys(QUANTITIES, relative), budget=budget)

"""What a value of a criterion is worth, between a worst and a best that do not depend on who competes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tradestudy.uncertainty.distributions import FloatArray


@dataclass(frozen=True, kw_only=True)
class ValueScale:
    """A linear value function of one criterion with fixed end points, whatever the alternatives are.

    Parameters
    ----------
    worst, best
        Values of the criterion that are worth 0 and 1; what lies beyond them is worth as much as they.
    """

    worst: float
    best: float

    def value(self, measured: FloatArray) -> FloatArray:
        """0 … 1; what is not known is worth nothing."""
        with np.errstate(invalid="ignore"):
            value = np.clip((measured - self.worst) / (self.best - self.worst), 0.0, 1.0)
        return np.where(np.isnan(value), 0.0, value)

    def clips(self, measured: FloatArray) -> npt.NDArray[np.bool_]:
        """Which values lie beyond the ends."""
        low, high = sorted((self.worst, self.best))
        return np.asarray((measured < low) | (measured > high))

"""The worth of values of a criterion, on a scale whose ends do not depend on the alternatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tradestudy.uncertainty.distributions import FloatArray


@dataclass(frozen=True, kw_only=True)
class ValueScale:
    """A linear value function of one criterion, with end points that do not depend on the alternatives.

    Parameters
    ----------
    worst, best
        Values of the criterion that are worth 0 and 1; values beyond them also count as 0 and 1.
    """

    worst: float
    best: float

    def value(self, measured: FloatArray) -> FloatArray:
        """Worth from 0 to 1; unknown values are worth 0."""
        with np.errstate(invalid="ignore"):
            value = np.clip((measured - self.worst) / (self.best - self.worst), 0.0, 1.0)
        return np.where(np.isnan(value), 0.0, value)

    def clips(self, measured: FloatArray) -> npt.NDArray[np.bool_]:
        """Whether each value lies beyond the ends."""
        low, high = sorted((self.worst, self.best))
        return np.asarray((measured < low) | (measured > high))

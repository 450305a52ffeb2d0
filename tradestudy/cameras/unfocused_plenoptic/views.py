"""The views that an estimator compares, through the whole or a vignetted pupil."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from tradestudy.cameras.picture_geometry import MatchedPairs
from tradestudy.optics.arrays import FloatArray

ViewEstimator = Literal["outermost-views", "least-squares"]


def baseline_of_views(estimator: ViewEstimator, positions: FloatArray) -> float:
    """Baseline Δu [m] of a pair of views as precise as the estimator, for views at positions [m].

    It is the distance between the outermost views in a row, or √(2 Σ|u − ū|²) for least squares over both coordinates
    of all views with equal errors; 0 for fewer than two views.
    """
    if not len(positions):
        return 0.0
    if estimator == "outermost-views":
        return float(np.ptp(positions[:, 0]))
    return math.sqrt(2.0 * float(np.sum((positions - positions.mean(axis=0)) ** 2)))


@dataclass(frozen=True, kw_only=True, eq=False)
class ComparedViews:
    """Views through parts of the pupil, each of the whole sensor.

    Off the axis, the rims of other stops vignette the pupil: they remove whole views and do not dim the others. The
    fraction of the width that remains along the radius of the field is applied in all directions, the worst case.

    Parameters
    ----------
    estimator
        The estimator.
    positions
        Centres of all views in the pupil [m], shape (views, 2).
    pupil_diameter
        Diameter of the part of the pupil that contains them [m].
    side_px
        Side of the largest square that the outermost views share [samples], over distance.
    """

    stops_dim: ClassVar[bool] = False

    estimator: ViewEstimator
    positions: FloatArray
    pupil_diameter: float
    side_px: FloatArray

    @property
    def widest_px(self) -> float:
        """Side of the largest window that the views share, near focus [samples]."""
        return float(np.max(self.side_px))

    def through(self, width: float) -> MatchedPairs:
        """One pair, weighted by the ratio of the remaining views' information to that of all views."""
        left = np.hypot(*self.positions.T) <= width * self.pupil_diameter / 2.0 * (1.0 + 1e-12)
        left_of_all = baseline_of_views(self.estimator, self.positions[left]) / baseline_of_views(
            self.estimator, self.positions
        )
        side = self.side_px[np.newaxis]
        return MatchedPairs(largest_px=side, apart_px=np.zeros_like(side), weight=np.full_like(side, left_of_all**2))

    def at(self, index: NDArray[np.intp]) -> ComparedViews:
        """Select some of the distances, by index."""
        return replace(self, side_px=self.side_px[index])

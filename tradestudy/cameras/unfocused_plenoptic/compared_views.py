"""The views that an estimator compares, and what the rims of stops leave of them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from tradestudy.cameras.matched_windows import MatchedPairs
from tradestudy.optics.arrays import FloatArray

ViewEstimator = Literal["outermost-views", "least-squares"]


def baseline_of_views(estimator: ViewEstimator, positions: FloatArray) -> float:
    """The distance Δu [m] of two views that would measure as well as the estimator with views at positions [m].

    That of the outermost views along a row; √(2 Σ|u − ū|²) for least squares over both coordinates of all views, each
    with the error of one coordinate. 0 for fewer than two.
    """
    if not len(positions):
        return 0.0
    if estimator == "outermost-views":
        return float(np.ptp(positions[:, 0]))
    return math.sqrt(2.0 * float(np.sum((positions - positions.mean(axis=0)) ** 2)))


@dataclass(frozen=True, kw_only=True, eq=False)
class ComparedViews:
    """Views through parts of the pupil, each of the whole sensor.

    Rims of other stops that narrow the pupil off the axis take whole views, and no light from those that they leave.
    The share of the width that is left along the radius of the field is taken in all directions, which leaves least.

    Parameters
    ----------
    estimator
        What measures.
    positions
        Centres of all views in the pupil [m], shape (views, 2).
    pupil_diameter
        Of the part of the pupil in which they lie [m].
    side_px
        Of the largest square that the outermost views share [samples], over distance.
    """

    stops_dim: ClassVar[bool] = False

    estimator: ViewEstimator
    positions: FloatArray
    pupil_diameter: float
    side_px: FloatArray

    @property
    def widest_px(self) -> float:
        """That of the views, of which the outermost share the most near focus."""
        return float(np.max(self.side_px))

    def through(self, width: float) -> MatchedPairs:
        """One pair, which tells what the views that are left do over the baseline of all."""
        left = np.hypot(*self.positions.T) <= width * self.pupil_diameter / 2.0 * (1.0 + 1e-12)
        left_of_all = baseline_of_views(self.estimator, self.positions[left]) / baseline_of_views(
            self.estimator, self.positions
        )
        side = self.side_px[np.newaxis]
        return MatchedPairs(largest_px=side, apart_px=np.zeros_like(side), weight=np.full_like(side, left_of_all**2))

    def at(self, index: NDArray[np.intp]) -> ComparedViews:
        """The same at some of the distances."""
        return replace(self, side_px=self.side_px[index])

"""What the pictures that an estimator compares share of an object: the windows that a matcher can have."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tradestudy.optics.arrays import FloatArray


def largest_common_square(diameter: ArrayLike, apart: ArrayLike) -> FloatArray:
    """Side of the largest square in what two equal discs share: ``w = (√(2 n² − d²) − d)/2``, 0 where d ≥ n.

    What two discs share is convex and the same seen from either side, so some largest square has the same centre. Its
    corners lie r = w/√2 from there, the one farthest along the line of centres at an angle α ≤ 45° to it, and
    that one stays in the farther disc while ``r² + r d cos α + d²/4 ≤ n²/4``. The square is the largest at α = 45°,
    with two sides along the line of centres; w/2 on both axes then gives the equation above. It falls from n/√2 for
    the same disc to 0 for two that touch.

    Parameters
    ----------
    diameter
        n of the discs.
    apart
        d between their centres, in the same unit; broadcast.
    """
    n, d = np.asarray(diameter, dtype=np.float64), np.asarray(apart, dtype=np.float64)
    within = np.minimum(d, n)
    return np.asarray((np.sqrt(2.0 * n * n - within * within) - within) / 2.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class MatchedWindow:
    """The window that stands for all pairs of an estimator; arrays over distance.

    Parameters
    ----------
    side_px
        Side of the square [samples].
    apart_px
        How far the two pictures are apart where their textures coincide [samples]; the window lies halfway.
    """

    side_px: FloatArray
    apart_px: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class MatchedPairs:
    """Pairs of pictures that an estimator compares; arrays (pairs, distances).

    Parameters
    ----------
    largest_px
        Side of the largest square that both show [samples].
    apart_px
        As of `MatchedWindow`.
    weight
        What each pair adds to the information on the disparity of the estimator, over that by a window of the same
        size in which all of its pairs are compared through the whole pupil: there they sum to 1.
    """

    largest_px: FloatArray
    apart_px: FloatArray
    weight: FloatArray

    def window(self, asked_px: ArrayLike) -> MatchedWindow:
        """The window of one pair that tells as much: ``W² = Σ_j g_j min(w_j, w)²``, w the side asked for.

        Information on a disparity grows with the area of the window; that of all pairs adds up.
        """
        area = np.square(np.minimum(self.largest_px, np.asarray(asked_px, dtype=np.float64)))
        information = self.weight * area
        whole = np.sum(information, axis=0)
        known = np.where(whole > 0.0, whole, 1.0)
        apart = np.sqrt(np.sum(information * np.square(self.apart_px), axis=0) / known)
        return MatchedWindow(side_px=np.sqrt(whole), apart_px=apart)


class ComparedPictures(Protocol):
    """What an estimator compares, over distances."""

    @property
    def stops_dim(self) -> bool:
        """Whether every pixel looks through the whole pupil, so that stops that cut it take light from all of them.

        Pixels behind microlenses look through parts of it: some lose their part, the others nothing.
        """
        ...

    @property
    def widest_px(self) -> float:
        """Side of the largest square in one picture, whatever it shares with another [samples]."""
        ...

    def through(self, width: float) -> MatchedPairs:
        """The pairs where so much is left of the pupil's width."""
        ...

    def at(self, index: NDArray[np.intp]) -> Self:
        """The same at some of the distances."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class WholePictures:
    """Two pictures of whole sensors.

    Parameters
    ----------
    side_px
        Of the largest square in them [samples], over distance.
    """

    stops_dim: ClassVar[bool] = True

    side_px: FloatArray

    @property
    def widest_px(self) -> float:
        """The side."""
        return float(np.max(self.side_px))

    def through(self, width: float) -> MatchedPairs:  # noqa: ARG002 - whatever the pupil, the pictures are as large
        """One pair."""
        side = self.side_px[np.newaxis]
        return MatchedPairs(largest_px=side, apart_px=np.zeros_like(side), weight=np.ones_like(side))

    def at(self, index: NDArray[np.intp]) -> WholePictures:
        """The same at some of the distances."""
        return WholePictures(side_px=self.side_px[index])

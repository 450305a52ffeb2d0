"""The windows that a matcher can use: the parts of an object that all compared pictures show."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tradestudy.optics.arrays import FloatArray


def largest_common_square(diameter: ArrayLike, apart: ArrayLike) -> FloatArray:
    """Side of the largest square in the overlap of two equal discs: ``w = (√(2 n² − d²) − d)/2``, 0 where d ≥ n.

    The overlap is convex and symmetric, so some largest square has the same centre. Its corners lie r = w/√2 from the
    centre. The corner farthest along the line of centres is at an angle α ≤ 45° to it, and stays in the farther disc
    while ``r² + r d cos α + d²/4 ≤ n²/4``. The square is largest at α = 45°, with two sides parallel to the line of
    centres; w/2 on both axes then gives the equation above. It falls from n/√2 for identical discs to 0 for discs that
    touch.

    Parameters
    ----------
    diameter
        Diameter n of the discs.
    apart
        Distance d between their centres, in the same unit; both are broadcast together.
    """
    n, d = np.asarray(diameter, dtype=np.float64), np.asarray(apart, dtype=np.float64)
    within = np.minimum(d, n)
    return np.asarray((np.sqrt(2.0 * n * n - within * within) - within) / 2.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class MatchedWindow:
    """The window equivalent to all pairs of an estimator, as arrays over distance.

    Parameters
    ----------
    side_px
        Side of the square [samples].
    apart_px
        Offset of the two pictures when their textures coincide [samples]; the window lies halfway between them.
    """

    side_px: FloatArray
    apart_px: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class MatchedPairs:
    """Pairs of pictures that an estimator compares, as arrays of shape (pairs, distances).

    Parameters
    ----------
    largest_px
        Side of the largest square that both pictures show [samples].
    apart_px
        As in `MatchedWindow`.
    weight
        Contribution of each pair to the information on the estimator's disparity, relative to that of all pairs through
        the whole pupil in a window of the same size. Through the whole pupil, the weights sum to 1.
    """

    largest_px: FloatArray
    apart_px: FloatArray
    weight: FloatArray

    def window(self, asked_px: ArrayLike) -> MatchedWindow:
        """The window of a single pair with the same information: ``W² = Σ_j g_j min(w_j, w)²``, w the requested side.

        Information on a disparity is proportional to the area of the window and adds up over pairs.
        """
        area = np.square(np.minimum(self.largest_px, np.asarray(asked_px, dtype=np.float64)))
        information = self.weight * area
        whole = np.sum(information, axis=0)
        known = np.where(whole > 0.0, whole, 1.0)
        apart = np.sqrt(np.sum(information * np.square(self.apart_px), axis=0) / known)
        return MatchedWindow(side_px=np.sqrt(whole), apart_px=apart)


class ComparedPictures(Protocol):
    """The pictures that an estimator compares, as arrays over distance."""

    @property
    def stops_dim(self) -> bool:
        """Whether every pixel sees the whole pupil, so that vignetting dims all pixels.

        Pixels behind microlenses see parts of the pupil: vignetting takes all light from some, and none from others.
        """
        ...

    @property
    def widest_px(self) -> float:
        """Side of the largest square in one picture alone [samples]."""
        ...

    def through(self, width: float) -> MatchedPairs:
        """The pairs where vignetting leaves a fraction `width` of the pupil's width."""
        ...

    def at(self, index: NDArray[np.intp]) -> Self:
        """Select some of the distances, by index."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class WholePictures:
    """Two pictures of whole sensors.

    Parameters
    ----------
    side_px
        Side of the largest square that they share [samples], over distance.
    """

    stops_dim: ClassVar[bool] = True

    side_px: FloatArray

    @property
    def widest_px(self) -> float:
        """Side of the largest square at any distance [samples]."""
        return float(np.max(self.side_px))

    def through(self, width: float) -> MatchedPairs:  # noqa: ARG002 - the size of these pictures does not depend on the pupil
        """The two pictures, which are the only pair."""
        side = self.side_px[np.newaxis]
        return MatchedPairs(largest_px=side, apart_px=np.zeros_like(side), weight=np.ones_like(side))

    def at(self, index: NDArray[np.intp]) -> WholePictures:
        """Select some of the distances, by index."""
        return WholePictures(side_px=self.side_px[index])

"""Depth maps from the pictures of one camera: what goes in, what comes out, and who makes one of the other."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import BoolArray, FloatArray, Samples


@dataclass(frozen=True, kw_only=True, eq=False)
class FlatPicture:
    """A picture over the light that an even white scene would give every pixel.

    Parameters
    ----------
    values
        Brightness, shape (rows, columns); NaN where hardly any light comes.
    variance
        Of the noise of each pixel.
    pure
        Where the light of one lens is nearly all: what several microlenses send is no picture.
    """

    values: Samples
    variance: Samples
    pure: BoolArray


@dataclass(frozen=True, kw_only=True)
class DepthSearch:
    """What depth is looked for.

    Parameters
    ----------
    near, far
        Distances searched [m].
    window_px
        Side of the matching window [samples].
    largest_deviation_px
        Standard deviation of a disparity above which a window has too little texture [samples].

    Raises
    ------
    OutOfRangeError
        For distances that are no range.
    """

    near: float
    far: float
    window_px: float
    largest_deviation_px: float = 0.3

    def __post_init__(self) -> None:
        if not 0.0 < self.near < self.far:
            raise OutOfRangeError(
                "depth is searched", value=f"from {self.near:g} to {self.far:g} m", limit="0 < near < far"
            )

    @property
    def distances(self) -> FloatArray:
        """Evenly spaced in inverse distance from near to far [m], for tables."""
        return np.asarray(1.0 / np.linspace(1.0 / self.near, 1.0 / self.far, 513))


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthMap:
    """Depth as a camera measured it, upright, in the pixels of what it was measured in.

    Parameters
    ----------
    depth
        Along the axis [m]; NaN where none was measured.
    deviation
        Standard deviation that the noise of the pictures gives it, from the texture of each window [m].
    disparity_deviation
        The same of the disparity over the estimator's baseline [samples]; NaN throughout where depth comes without one.
    reason
        `Reason` of each pixel.
    """

    depth: Samples
    deviation: Samples
    disparity_deviation: Samples
    reason: NDArray[np.uint8]


@dataclass(frozen=True, kw_only=True, eq=False)
class TrueDepth:
    """What a depth map should say.

    Parameters
    ----------
    depth
        In the frame and the pixels of the map [m]; NaN or infinite where nothing is seen.
    measurable
        Where the estimator sees the point at all: two pictures of it, neither hidden by what stands before it.
    """

    depth: Samples
    measurable: BoolArray


class DepthReader(ABC):
    """One camera, as it was designed, set up to measure depth from its pictures."""

    @abstractmethod
    def read(self, pictures: Mapping[str, FlatPicture]) -> DepthMap:
        """Depth from all pictures, by their names."""

    @abstractmethod
    def truth(self, depths: Mapping[str, Samples], pure: Mapping[str, BoolArray]) -> TrueDepth:
        """True depth of the map from that of every picture, and from where these are pure, by their names."""

    def made_of(self, pictures: Mapping[str, FlatPicture], found: DepthMap, middle: float) -> dict[str, Samples]:  # noqa: ARG002 - none unless the kind makes some
        """Pictures that the camera makes of its own with their depth, by name: brightness, NaN where there is none.

        ``middle`` is the distance of the middle of the scene [m], which one may be refocused on.
        """
        return {}


class DepthReaderOfKind(Protocol):
    """Sets up a reader for a camera of one kind."""

    def __call__(self, *, camera: Any, search: DepthSearch) -> DepthReader:
        """For a design of that kind.

        Raises
        ------
        OutOfRangeError
            Where such a camera cannot measure depth in its pictures.
        """

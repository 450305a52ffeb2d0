"""Depth maps from the pictures of one camera: the inputs, the result, and the reader that measures depth."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from tradestudy.cameras.light_cones import Description
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import BoolArray, FloatArray, Samples

_ROUNDING: Final = 1e-4
"""Relative error of a true depth: it is in single precision, and interpolated between pixels if it is rectified."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FlatPicture:
    """A flat-field-corrected picture: every pixel is divided by the light that it receives from a uniform white scene.

    Parameters
    ----------
    values
        Brightness, shape (rows, columns); NaN where hardly any light arrives.
    variance
        Noise variance of each pixel.
    pure
        Where nearly all light comes from one lens; light from several microlenses does not form a picture.
    """

    values: Samples
    variance: Samples
    pure: BoolArray


@dataclass(frozen=True, kw_only=True)
class DepthSearch:
    """The settings of a search for depth.

    Parameters
    ----------
    near, far
        Range of distances searched [m].
    window_px
        Side of the matching window [samples].
    largest_deviation_px
        Standard deviation of a disparity above which a window has too little texture [samples].

    Raises
    ------
    OutOfRangeError
        If the distances are not a range.
    """

    near: float
    far: float
    window_px: float
    largest_deviation_px: float = 0.3

    def __post_init__(self) -> None:
        if not 0.0 < self.near < self.far:
            raise OutOfRangeError(
                "search range of depth", value=f"{self.near:g} to {self.far:g} m", limit="0 < near < far"
            )

    @property
    def distances(self) -> FloatArray:
        """Distances from near to far [m], and just beyond, evenly spaced in inverse distance, for tables."""
        near, far = _with_rounding(self.near, self.far)
        return np.asarray(1.0 / np.linspace(1.0 / near, 1.0 / far, 513))

    def includes(self, depth: Samples) -> BoolArray:
        """Whether true depths [m] are searched; see `lies_within`."""
        return lies_within(depth, self.near, self.far)


def lies_within(depth: Samples, near: float, far: float) -> BoolArray:
    """Whether true depths lie between two distances [m], which depths at the ends do in spite of rounding."""
    low, high = _with_rounding(near, far)
    return np.asarray((depth >= low) & (depth <= high))


def _with_rounding(near: float, far: float) -> tuple[float, float]:
    return near * (1.0 - _ROUNDING), far * (1.0 + _ROUNDING)


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthMap:
    """Measured depth, upright, in the pixels of the picture in which it was measured.

    Parameters
    ----------
    depth
        Depth along the axis [m]; NaN where none was measured.
    deviation
        Standard deviation of depth from the noise of the pictures and the texture of each window [m].
    disparity_deviation
        The same for the disparity over the estimator's baseline [samples]; NaN if depth is measured without a baseline.
    reason
        `Reason` of each pixel.
    """

    depth: Samples
    deviation: Samples
    disparity_deviation: Samples
    reason: NDArray[np.uint8]


@dataclass(frozen=True, kw_only=True, eq=False)
class TrueDepth:
    """The depth that a map should show.

    Parameters
    ----------
    depth
        True depth in the frame and the pixels of the map [m]; NaN or infinite where nothing is seen.
    measurable
        Where the estimator sees the point: two pictures show it, neither occluded by nearer objects.
    """

    depth: Samples
    measurable: BoolArray


class DepthReader(ABC):
    """Measures depth from the pictures of one camera, as designed."""

    @abstractmethod
    def read(self, pictures: Mapping[str, FlatPicture]) -> DepthMap:
        """Depth measured from all pictures, given by name."""

    @abstractmethod
    def truth(self, depths: Mapping[str, Samples], pure: Mapping[str, BoolArray]) -> TrueDepth:
        """True depth for the map, from the true depth and the pure pixels of every picture, by name."""

    def frame(self) -> Description:
        """The pinhole camera that the map belongs to, if it is not that of a picture, in the terms of its description.

        Centre and rotation place its rays in the scene; principal distance and principal point are in metres.
        """
        return {}

    def made_of(self, pictures: Mapping[str, FlatPicture], depth_map: DepthMap, middle: float) -> dict[str, Samples]:  # noqa: ARG002 - used only by kinds that make some
        """Brightness of pictures computed from the camera's pictures and depth, by name; NaN where there is none.

        ``middle`` is the distance of the middle of the scene [m]; pictures can be refocused there.
        """
        return {}


class DepthReaderOfKind(Protocol):
    """Sets up a reader for a camera of one kind."""

    def __call__(self, *, camera: Any, search: DepthSearch) -> DepthReader:
        """Set up a reader for a design of that kind.

        Raises
        ------
        OutOfRangeError
            If such a camera cannot measure depth in its pictures.
        """

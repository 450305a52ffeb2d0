"""The geometry of a camera's pictures: the quantities that blur, noise and matching window depend on."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Literal, Protocol, Self

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
        divisor = np.where(whole > 0.0, whole, 1.0)
        apart = np.sqrt(np.sum(information * np.square(self.apart_px), axis=0) / divisor)
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


@dataclass(frozen=True, kw_only=True, eq=False)
class LensStage:
    """One lens of a camera as it forms a picture; fields are arrays over distance unless noted otherwise.

    Parameters
    ----------
    aperture_diameter
        Aperture of the lens, or of the part of it that one view uses [m]; one number.
    focal_length
        Focal length [m].
    object_distance
        Distance from its object to the lens [m]; negative for a virtual object behind it, formed by the preceding lens.
    plane_distance
        Distance from the lens to its picture plane [m].
    blur_diameter
        Diameter of the geometric blur in that plane [m].
    relay
        Magnification from that plane to the sensor: 1, or that of the microlenses.
    """

    aperture_diameter: float
    focal_length: FloatArray
    object_distance: FloatArray
    plane_distance: FloatArray
    blur_diameter: FloatArray
    relay: FloatArray

    @cached_property
    def f_number(self) -> FloatArray:
        """Working f-number: distance of the picture plane divided by the aperture."""
        return np.asarray(self.plane_distance / self.aperture_diameter)

    @cached_property
    def columns(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Magnification to the sensor, f-number and blur [m], as columns that broadcast with a row of frequencies."""
        return column(self.relay), column(self.f_number), column(self.blur_diameter)

    def finest_period(self, wavelength: float) -> float:
        """Shortest period on the sensor [m] that the lens transmits at any distance; infinite without a picture."""
        period = wavelength * self.f_number * self.relay
        return float(np.min(period, initial=np.inf, where=period > 0.0))

    def defocus(self, wavelength: float) -> FloatArray:
        """Signed path error at the rim, ``A²/8 (1/a + 1/b − 1/f)/λ`` [waves]."""
        vergence = 1.0 / self.object_distance + 1.0 / self.plane_distance - 1.0 / self.focal_length
        return np.asarray(self.aperture_diameter**2 / 8.0 * vergence / wavelength)

    def at(self, index: NDArray[np.intp]) -> LensStage:
        """Select some of the distances, by index."""
        return LensStage(
            aperture_diameter=self.aperture_diameter,
            focal_length=self.focal_length[index],
            object_distance=self.object_distance[index],
            plane_distance=self.plane_distance[index],
            blur_diameter=self.blur_diameter[index],
            relay=self.relay[index],
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class PictureGeometry:
    """How a camera pictures objects at given distances; fields are arrays over distance unless noted otherwise.

    Parameters
    ----------
    distance
        Distances of the objects [m]; NaN in all arrays where the camera forms no picture.
    magnification
        Ratio of size on the sensor to size on the object.
    sample_pitch
        Distance between neighbouring samples of the matched picture [m]: the pixel pitch, or the microlens pitch for
        views with one sample per microlens. One number, as for all that follow except stages and ``light_f_number``.
    sample_width
        Side of the square, or diameter of the disc, from which a sample collects light [m].
    sample_shape
        ``square`` for pixels, ``disc`` for microlenses.
    pixel_pitch
        Pixel pitch of the sensor [m]; its pixels collect the electrons.
    compared
        The pictures that the estimator compares, with the windows that they share.
    light_f_number
        f-number of the cone that reaches a pixel, over distance.
    pupil_diameter
        Pupil of the main lens [m].
    main_lens, microlens
        The stages of the picture; no microlens if none blurs it.
    micro_image_diameter
        Diameter of the light behind one microlens [m]; infinite for a picture of the whole sensor.
    """

    distance: FloatArray
    magnification: FloatArray
    sample_pitch: float
    sample_width: float
    sample_shape: Literal["square", "disc"]
    pixel_pitch: float
    compared: ComparedPictures
    light_f_number: FloatArray
    pupil_diameter: float
    main_lens: LensStage
    microlens: LensStage | None
    micro_image_diameter: float = math.inf

    @property
    def blur_px(self) -> FloatArray:
        """Sum of the geometric blurs of the stages [samples]."""
        stages = [stage for stage in (self.main_lens, self.microlens) if stage is not None]
        return np.asarray(sum(stage.blur_diameter * stage.relay for stage in stages) / self.sample_pitch)

    def at(self, index: NDArray[np.intp]) -> PictureGeometry:
        """Select some of the distances, by index."""
        return replace(
            self,
            distance=self.distance[index],
            magnification=self.magnification[index],
            compared=self.compared.at(index),
            light_f_number=self.light_f_number[index],
            main_lens=self.main_lens.at(index),
            microlens=None if self.microlens is None else self.microlens.at(index),
        )


def column(values: FloatArray) -> FloatArray:
    """Values over distance as a column that broadcasts with a row of frequencies; one number if all are equal."""
    as_column = values[:, np.newaxis]
    return as_column[:1] if values.size and np.all(values == values[0]) else as_column

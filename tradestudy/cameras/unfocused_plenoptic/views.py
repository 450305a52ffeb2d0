"""Observation and inverse depth with two views, with errors in all parameters.

The two pixels of a pair of views lie N apart under every microlens, measured from the centre of its white image, which
is the image of the exit pupil at a distance z_p in front of the array. A pixel at a distance o from that centre, under
a microlens at x, looks along the slope ``o/b_L + x/z_p``. The rays of both views through an image at a_L in front of
the array therefore meet the array d' apart, ``d' (1 − a_L/z_p) = N a_L/b_L``. The disparity is d = −d', positive for
points nearer than the focus.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tradestudy.cameras.depth_measurement import Errors, value_of
from tradestudy.cameras.microlens_exposure import ArrayGeometry, Observation, PlaceOnArray, disparity_error
from tradestudy.cameras.picture_geometry import MatchedPairs
from tradestudy.optics.arrays import BoolArray, FloatArray

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


def views_observation(
    geometry: ArrayGeometry, pixels_apart: float, errors: Errors, x: ArrayLike, y: ArrayLike, z: ArrayLike
) -> Observation:
    """The observation of a point by a camera that deviates from its design by ``errors``.

    Parameters
    ----------
    geometry
        The design.
    pixels_apart
        N [m]: distance between the pixels of the two views.
    errors
        True minus designed values, by the names of `PLENOPTIC_ERRORS`, without pixel noise and without the scatter of
        the microlens centres, which varies over the array.
    x, y, z
        The point [m] from the centre of the main lens; upright coordinates.

    Returns
    -------
    Observation
        Disparity, in microlenses of the design, and the position of the point. Exact for thin lenses; NaN for points
        that the main lens does not image.
    """
    place = geometry.place_of(errors, x, y, z)
    a_L = geometry.microlens_object_distance(errors, place, z)
    shift = -pixels_apart * a_L / (place.gap * (1.0 - a_L / _pupil_distance(errors, place)))
    return shift / geometry.pitch_scale(errors), *place.on_sensor


def between_known_centres(
    geometry: ArrayGeometry, pixels_apart: float, changed: Errors, seen: Observation, scale: FloatArray
) -> Observation:
    """The observation by pixels that have grown by a factor, with the centres of the micro-images as calibrated.

    A pixel chosen by the centre c that was calibrated for its microlens lies ``o = (c + o₀) s − c m`` from the true
    centre, where ``c = x (1 + b_L/z)``, s and m are the factors of pixels and array, and b_L/z is unchanged. With
    ``r = m/s`` and N as calibrated, two views through one image are therefore ``d = g/(r + (1 − r)(1 + b_L/z) g/N)``
    apart, where g is the disparity between the true centres, in pitches that have grown with the array.

    Parameters
    ----------
    geometry, pixels_apart
        See `views_observation`.
    changed
        Changes since the calibration, to which ``seen`` belongs.
    seen
        From `views_observation`: disparity between views relative to the true centres.
    scale
        Factor s.

    Returns
    -------
    Observation
        The disparity in microlenses of the design, and the position in pixels of the design, both as lengths.
    """
    shift, x, y = seen
    array = geometry.pitch_scale(changed)
    g, r = shift * array, array / scale
    kept = g / (r + (1.0 - r) * (1.0 + geometry.gap / geometry.mla_distance) * g / pixels_apart)
    return kept, x / scale, y / scale


def views_inverse_depth(
    geometry: ArrayGeometry, pixels_apart: float, errors: Errors, seen: Observation
) -> tuple[FloatArray, BoolArray]:
    """The inverse depth that a calibration with ``errors`` computes.

    ``a_L = −d/(N/b_L − d/z_p)``, ``b = z − a_L``, ``1/a = 1/f − 1/b``; where the pupil lies in the main lens,
    ``1/a = 1/f − 1/z + d b_L/(N z²)``.

    Parameters
    ----------
    geometry, pixels_apart
        The design.
    errors
        Calibrated minus designed values, by the names of `PLENOPTIC_ERRORS`.
    seen
        From `views_observation`.

    Returns
    -------
    inverse_depth
        [1/m]; zero at infinity and negative beyond.
    valid
        False where a calibrated length is not positive, the calibrated distortion has no inverse, or the two rays do
        not meet behind the main lens.
    """
    shift, seen_x, seen_y = seen
    place = geometry.place_seen(errors, seen_x, seen_y)
    turned = geometry.pitch_scale(errors) * np.cos(value_of(errors, "array_rotation"))
    d = shift * turned + disparity_error(errors)
    pupil = _pupil_distance(errors, place)
    opening = pixels_apart / place.gap - d / pupil
    image_times_opening = place.flat_distance * opening + place.stretch * d
    meet = ~(image_times_opening <= 0.0)
    inverse = 1.0 / geometry.focal_length_with(errors) - opening / np.where(meet, image_times_opening, np.nan)
    return inverse, place.valid & (turned > 0.0) & (pupil > 0.0) & meet


def _pupil_distance(errors: Errors, place: PlaceOnArray) -> FloatArray:
    """Distance z_p from the exit pupil to the array [m]; by design the pupil lies in the main lens."""
    return place.distance + value_of(errors, "pupil_distance")

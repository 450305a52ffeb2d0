"""Observation and inverse depth with two micro-images, with errors in all parameters."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.depth_measurement import Errors, value_of
from tradestudy.cameras.plenoptic_geometry import ArrayGeometry, Observation, disparity_error
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.optics.triangulation import plenoptic_focus_shift


def relay_observation(
    geometry: ArrayGeometry, baseline: ArrayLike, errors: Errors, x: ArrayLike, y: ArrayLike, z: ArrayLike
) -> Observation:
    """The observation of a point by a camera that deviates from its design by ``errors``.

    Two microlenses Δx apart relay the image at a_L in front of the array: ``Δu = Δx (1 + b_L/a_L)`` (eq. 4 in absolute
    coordinates on the detector).

    Parameters
    ----------
    geometry
        The design.
    baseline
        Δx [m]: distance between the two microlenses as designed.
    errors
        True minus designed values, by the names of `PLENOPTIC_ERRORS`, without pixel noise and without the scatter of
        the microlens centres, which varies over the array.
    x, y, z
        The point [m] from the centre of the main lens; upright coordinates.

    Returns
    -------
    Observation
        Distance between the two micro-images, and their position. Exact for thin lenses; infinite where the main lens
        images onto the array, NaN for points that it does not image.
    """
    place = geometry.place_of(errors, x, y, z)
    a_L = geometry.microlens_object_distance(errors, place, z)
    with np.errstate(divide="ignore"):  # an image on the array is a pole, documented above
        apart = np.asarray(baseline) * _grid_scale(geometry, errors) * (1.0 + place.gap / a_L)
    return apart, *place.on_sensor


def relay_inverse_depth(
    geometry: ArrayGeometry, baseline: ArrayLike, errors: Errors, seen: Observation
) -> tuple[FloatArray, BoolArray]:
    """The inverse depth that a calibration with ``errors`` computes: eq. 8 with coordinates on the detector.

    ``Δσ = Δu cos φ + error − Δx``, ``a_L = b_L Δx/Δσ``, ``b = z − a_L``, ``1/a = (b − f)/(f b)``.

    Parameters
    ----------
    geometry, baseline
        The design.
    errors
        Calibrated minus designed values, by the names of `PLENOPTIC_ERRORS`.
    seen
        From `relay_observation`.

    Returns
    -------
    inverse_depth
        [1/m]. Beyond infinity it continues smoothly down to −1/f. A disparity of the wrong sign gives −1/f for a
        Keplerian relay, and the front focal point (1/f) for a Galilean one. NaN where the estimator has no
        microlenses.
    valid
        False where a calibrated length is not positive or the calibrated distortion has no inverse.
    """
    apart, seen_x, seen_y = seen
    f, place = geometry.focal_length_with(errors), geometry.place_seen(errors, seen_x, seen_y)
    spacing = np.asarray(baseline) * _grid_scale(geometry, errors)
    sigma = apart * np.cos(value_of(errors, "array_rotation")) + disparity_error(errors) - spacing
    shift = plenoptic_focus_shift(
        sigma,
        spacing,
        mla_distance=place.flat_distance,
        microlens_gap=place.gap * place.stretch,
        focal_length=f,
    )
    inverse = np.maximum(shift, -f) / (f * (f + np.maximum(shift, 0.0)))
    sign = np.sign(apart - np.asarray(baseline))  # 1 for a Keplerian relay, −1 for a Galilean one
    return np.where(sigma * sign <= 0.0, -sign / f, inverse), place.valid & (spacing > 0.0)


def _grid_scale(geometry: ArrayGeometry, errors: Errors) -> FloatArray:
    """Ratio of actual to designed distance of microlens centres, from the pitch and the pupil that locates them."""
    z, gap = geometry.mla_distance, geometry.gap
    through_pupil = (1.0 + gap / z) / (1.0 + gap / (z + value_of(errors, "pupil_distance")))
    return geometry.pitch_scale(errors) * through_pupil

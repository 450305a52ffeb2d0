"""A focused plenoptic camera with every parameter in error: what it sees of a point, and the inverse depth read."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.error_models.environment import Environment
from tradestudy.cameras.error_models.reading import (
    Errors,
    InverseDepthReading,
    require_field,
    require_known,
    value_of,
)
from tradestudy.cameras.focused_plenoptic import FocusedPlenoptic
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.optics.radial_distortion import distort, undistort
from tradestudy.optics.thin_lens import focus_shift

PLENOPTIC_ERRORS: Final[Mapping[str, str]] = {
    "mla_distance": "m",
    "focal_length": "m",
    "microlens_gap": "m",
    "microlens_pitch": "m",
    "array_rotation": "rad",
    "array_tilt_x": "rad",
    "array_tilt_y": "rad",
    "array_offset_x": "m",
    "array_offset_y": "m",
    "pupil_distance": "m",
    "field_curvature": "m",
    "depth_distortion": "1",
    "distortion_k1": "1",
    "distortion_k2": "1",
    "pixel_noise": "m",
}
"""Errors of a focused plenoptic camera with their units.

``array_tilt_x`` is the slope of the array along x against the sensor: it adds to z and takes from b_L what it takes.
``pupil_distance`` is that of the exit pupil, by which microlens centres follow from the centres of their white images.
``field_curvature`` and ``depth_distortion`` are those in the corner of the sensor and grow with the square of the
distance from the axis: the first moves the image of the main lens along the axis, the second stretches its distance
from the array (O. Johannsen et al., "On the calibration of focused plenoptic cameras", 2013). k₁ and k₂ refer to the
lateral position over z. ``pixel_noise`` is that of the disparity [m on the sensor]."""

Observation = tuple[FloatArray, FloatArray, FloatArray]
"""Distance of the two micro-images of a point on the sensor, and where on the array they lie, x and y [m]."""


def plenoptic_observation(
    camera: FocusedPlenoptic, errors: Errors, x: ArrayLike, y: ArrayLike, z: ArrayLike
) -> Observation:
    """What a camera that deviates from its design by ``errors`` sees of a point.

    Two microlenses Δx apart repeat the image at a_L before the array: ``Δu = Δx (1 + b_L/a_L)`` (eq. 4 in absolute
    coordinates of the detector).

    Parameters
    ----------
    camera
        The design; its estimator says how far the two microlenses are apart.
    errors
        What the camera is less what its design says, by the names of `PLENOPTIC_ERRORS`, without pixel noise.
    x, y, z
        The point [m] from the centre of the main lens; upright coordinates.

    Returns
    -------
    Observation
        Exact for thin lenses; infinite where the main lens images onto the array, NaN for points that it does not
        image.
    """
    x, y, a = (np.asarray(value, dtype=np.float64) for value in (x, y, z))
    f = camera.main_lens.focal_length + value_of(errors, "focal_length")
    k1, k2 = value_of(errors, "distortion_k1"), value_of(errors, "distortion_k2")
    slope_x, slope_y = distort(x / a, y / a, k1, k2)
    distance = camera.mla_distance + value_of(errors, "mla_distance")
    on_x, on_y = slope_x * distance, slope_y * distance
    array, gap, square = _array_at(camera, errors, on_x, on_y)
    image = f + focus_shift(np.where(a > f, a, np.nan), f)
    stretch = 1.0 + value_of(errors, "depth_distortion") * square
    a_L = (array - image - value_of(errors, "field_curvature") * square) / stretch
    spacing = camera.estimator_baseline(a) * _grid_scale(camera, errors)
    with np.errstate(divide="ignore"):  # an image on the array is a pole, documented above
        apart = spacing * (1.0 + gap / a_L)
    return apart, on_x + value_of(errors, "array_offset_x"), on_y + value_of(errors, "array_offset_y")


def plenoptic_inverse_depth(
    camera: FocusedPlenoptic, errors: Errors, observation: Observation, distance: ArrayLike
) -> tuple[FloatArray, BoolArray]:
    """The inverse depth that a calibration which is off by ``errors`` reads: eq. 8 from the detector's coordinates.

    ``Δσ = Δu cos φ + noise − Δx``, ``a_L = b_L Δx/Δσ``, ``b = z − a_L``, ``1/a = (b − f)/(f b)``.

    Parameters
    ----------
    camera
        The design.
    errors
        What the calibration says less what the design says, by the names of `PLENOPTIC_ERRORS`.
    observation
        From `plenoptic_observation`.
    distance
        True distance [m], from which the design knows the two microlenses and the sign of the disparity.

    Returns
    -------
    inverse_depth
        [1/m]. Below infinity it goes on smoothly to −1/f, where it stays; a disparity that has crossed zero is there
        for a Keplerian relay, at the front focal point (1/f) for a Galilean one. NaN where the estimator has no
        microlenses.
    valid
        False where a believed length is not positive or the believed distortion has no inverse.
    """
    apart, seen_x, seen_y = observation
    f = camera.main_lens.focal_length + value_of(errors, "focal_length")
    on_x, on_y = seen_x - value_of(errors, "array_offset_x"), seen_y - value_of(errors, "array_offset_y")
    array, gap, square = _array_at(camera, errors, on_x, on_y)
    spacing = camera.estimator_baseline(distance) * _grid_scale(camera, errors)
    sigma = apart * np.cos(value_of(errors, "array_rotation")) + value_of(errors, "pixel_noise") - spacing
    sign = np.sign(camera.virtual_depth(distance))
    crossed = ~(sigma * sign > 0.0)
    a_L = gap * spacing / np.where(crossed, sign, sigma)
    image = array - a_L * (1.0 + value_of(errors, "depth_distortion") * square)
    shift = image - value_of(errors, "field_curvature") * square - f
    inverse = np.maximum(shift, -f) / (f * (f + np.maximum(shift, 0.0)))
    inverse = np.where(crossed, -sign / f, inverse)
    k1, k2 = value_of(errors, "distortion_k1"), value_of(errors, "distortion_k2")
    invertible = undistort(on_x / array, on_y / array, k1, k2)[2]
    valid = (f > 0.0) & (gap > 0.0) & (array > 0.0) & (spacing > 0.0) & invertible
    return np.where(np.isnan(sigma), np.nan, inverse), valid


def plenoptic_reading(
    camera: FocusedPlenoptic,
    distance: FloatArray,
    field: float,
    errors: Errors,
    environment: Environment | None = None,
) -> InverseDepthReading:
    """Inverse depths read by a camera in changed surroundings with a calibration that is off by ``errors``.

    Parameters
    ----------
    camera
        The camera as designed: what it is at calibration.
    distance
        True distances [m] from the main lens, shape (distances,).
    field
        Where the point is seen: 0 on the axis, 1 in the corner of the sensor.
    errors
        By the names of `PLENOPTIC_ERRORS` and `SESSION_CHANGES`, arrays of shape (draws, 1).
    environment
        How the camera answers to its surroundings; None: not at all. z, b_L and the pitch grow with the housing; the
        focal length of the main lens has its own drift and follows the index of the air.

    Raises
    ------
    OutOfRangeError
        For an error that the camera does not have, or a place beyond the sensor.
    """
    require_known(errors, PLENOPTIC_ERRORS, "a focused plenoptic camera")
    require_field(field)
    a, sensor = np.asarray(distance, dtype=np.float64), camera.sensor
    changed: dict[str, ArrayLike] = {}
    if environment is not None and ("temperature_change" in errors or "pressure_change" in errors):
        growth = environment.length_factor(errors) - 1.0
        changed = {
            "mla_distance": camera.mla_distance * growth,
            "microlens_gap": camera.microlenses.gap * growth,
            "microlens_pitch": camera.microlenses.pitch * growth,
            "focal_length": camera.main_lens.focal_length * (environment.focal_length_factor(errors) - 1.0),
        }
    right = field * sensor.width / 2.0 / camera.mla_distance
    down = field * sensor.height / 2.0 / camera.mla_distance
    observation = plenoptic_observation(camera, changed, right * a, down * a, a)
    inverse, valid = plenoptic_inverse_depth(camera, errors, observation, a)
    return InverseDepthReading(
        inverse_depth=inverse,
        no_overlap=np.zeros((1, 1), dtype=bool),
        out_of_range=~(valid & (a > camera.main_lens.focal_length)),
    )


def _array_at(
    camera: FocusedPlenoptic, errors: Errors, x: FloatArray, y: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Distance of the array and its gap where a point is seen, and the square of its share of the corner's radius."""
    tilt = value_of(errors, "array_tilt_x") * x + value_of(errors, "array_tilt_y") * y
    array = camera.mla_distance + value_of(errors, "mla_distance") + tilt
    gap = camera.microlenses.gap + value_of(errors, "microlens_gap") - tilt
    return array, gap, (x * x + y * y) / (camera.sensor.diagonal / 2.0) ** 2


def _grid_scale(camera: FocusedPlenoptic, errors: Errors) -> FloatArray:
    """Distance of the microlens centres over that of the design: pitch, and the pupil through which they are found."""
    z, gap = camera.mla_distance, camera.microlenses.gap
    through_pupil = (1.0 + gap / z) / (1.0 + gap / (z + value_of(errors, "pupil_distance")))
    return (1.0 + value_of(errors, "microlens_pitch") / camera.microlenses.pitch) * through_pupil

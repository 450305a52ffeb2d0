"""Main lens, array and detector, every parameter in error: what they see, and which inverse depth follows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.reading import Errors, value_of
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.optics.radial_distortion import distort, undistort
from tradestudy.optics.thin_lens import focus_shift
from tradestudy.optics.triangulation import plenoptic_focus_shift

Observation = tuple[FloatArray, FloatArray, FloatArray]
"""Distance of the two micro-images of a point on the sensor, and where on the array they lie, x and y [m]."""


@dataclass(frozen=True, kw_only=True)
class Relay:
    """The geometry of main lens, array and detector as designed.

    Parameters
    ----------
    focal_length
        Of the main lens f_M [m].
    mla_distance
        Main lens to array z [m].
    gap
        Array to detector b_L [m].
    pitch
        Of the microlenses [m].
    corner
        From the axis to the corner of the sensor [m].
    """

    focal_length: float
    mla_distance: float
    gap: float
    pitch: float
    corner: float


def relay_observation(
    relay: Relay, baseline: ArrayLike, errors: Errors, x: ArrayLike, y: ArrayLike, z: ArrayLike
) -> Observation:
    """What a camera that deviates from its design by ``errors`` sees of a point.

    Two microlenses Δx apart repeat the image at a_L before the array: ``Δu = Δx (1 + b_L/a_L)`` (eq. 4 in absolute
    coordinates of the detector).

    Parameters
    ----------
    relay
        The design.
    baseline
        Δx [m]: how far the two microlenses of the design are apart.
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
    f = relay.focal_length + value_of(errors, "focal_length")
    k1, k2 = value_of(errors, "distortion_k1"), value_of(errors, "distortion_k2")
    slope_x, slope_y = distort(x / a, y / a, k1, k2)
    distance = relay.mla_distance + value_of(errors, "mla_distance")
    on_x, on_y = slope_x * distance, slope_y * distance
    array, gap, square = _array_at(relay, errors, on_x, on_y)
    image = f + focus_shift(np.where(a > f, a, np.nan), f)
    stretch = 1.0 + value_of(errors, "depth_distortion") * square
    a_L = (array - image - value_of(errors, "field_curvature") * square) / stretch
    spacing = np.asarray(baseline) * _grid_scale(relay, errors)
    with np.errstate(divide="ignore"):  # an image on the array is a pole, documented above
        apart = spacing * (1.0 + gap / a_L)
    return apart, on_x + value_of(errors, "array_offset_x"), on_y + value_of(errors, "array_offset_y")


def relay_inverse_depth(
    relay: Relay, baseline: ArrayLike, errors: Errors, observation: Observation, sign: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """The inverse depth that a calibration which is off by ``errors`` reads: eq. 8 from the detector's coordinates.

    ``Δσ = Δu cos φ + noise − Δx``, ``a_L = b_L Δx/Δσ``, ``b = z − a_L``, ``1/a = (b − f)/(f b)``.

    Parameters
    ----------
    relay, baseline
        The design.
    errors
        What the calibration says less what the design says, by the names of `PLENOPTIC_ERRORS`.
    observation
        From `relay_observation`.
    sign
        Of the disparity by design: 1 for a Keplerian relay, −1 for a Galilean one.

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
    f = relay.focal_length + value_of(errors, "focal_length")
    on_x, on_y = seen_x - value_of(errors, "array_offset_x"), seen_y - value_of(errors, "array_offset_y")
    array, gap, square = _array_at(relay, errors, on_x, on_y)
    spacing = np.asarray(baseline) * _grid_scale(relay, errors)
    sigma = apart * np.cos(value_of(errors, "array_rotation")) + value_of(errors, "pixel_noise") - spacing
    crossed = ~(sigma * sign > 0.0)
    shift = plenoptic_focus_shift(
        np.where(crossed, sign, sigma),
        spacing,
        mla_distance=array - value_of(errors, "field_curvature") * square,
        microlens_gap=gap * (1.0 + value_of(errors, "depth_distortion") * square),
        focal_length=f,
    )
    inverse = np.maximum(shift, -f) / (f * (f + np.maximum(shift, 0.0)))
    inverse = np.where(crossed, -sign / f, inverse)
    k1, k2 = value_of(errors, "distortion_k1"), value_of(errors, "distortion_k2")
    invertible = undistort(on_x / array, on_y / array, k1, k2)[2]
    valid = (f > 0.0) & (gap > 0.0) & (array > 0.0) & (spacing > 0.0) & invertible
    return np.where(np.isnan(sigma), np.nan, inverse), valid


def _array_at(relay: Relay, errors: Errors, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Distance of the array and its gap where a point is seen, and the square of its share of the corner's radius."""
    tilt = value_of(errors, "array_tilt_x") * x + value_of(errors, "array_tilt_y") * y
    array = relay.mla_distance + value_of(errors, "mla_distance") + tilt
    gap = relay.gap + value_of(errors, "microlens_gap") - tilt
    return array, gap, (x * x + y * y) / relay.corner**2


def _grid_scale(relay: Relay, errors: Errors) -> FloatArray:
    """Distance of the microlens centres over that of the design: pitch, and the pupil through which they are found."""
    z, gap = relay.mla_distance, relay.gap
    through_pupil = (1.0 + gap / z) / (1.0 + gap / (z + value_of(errors, "pupil_distance")))
    return (1.0 + value_of(errors, "microlens_pitch") / relay.pitch) * through_pupil

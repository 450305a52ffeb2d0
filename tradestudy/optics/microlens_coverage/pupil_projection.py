"""The disc that the main lens's pupil throws through an image point onto the microlens array."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray


def projected_radius_over_pitch(
    *,
    microlens_object_distance: ArrayLike,
    mla_distance: ArrayLike,
    pupil_diameter: ArrayLike,
    microlens_pitch: ArrayLike,
) -> FloatArray:
    """Radius of the disc of light on the array, over the pitch: |a_L| A / (2 b p) with b = z − a_L.

    Parameters
    ----------
    microlens_object_distance
        Signed distance a_L from the main lens's image to the array [m]: positive for an image before the
        array (Keplerian), negative for one behind it (Galilean), −∞ for an object in the main lens's front
        focal plane.
    mla_distance
        Main lens to array, z > 0 [m].
    pupil_diameter
        Diameter A of the main lens's pupil, in the plane of the lens [m].
    microlens_pitch
        Distance of neighbouring lenses, p > 0 [m].

    Returns
    -------
    Radius over pitch [1], broadcast; |v| z / (2 b) when the f-numbers match as b_L/p = z/A. It is 0 for an
    image on the array and A/(2p) for one at infinity behind it.

    Raises
    ------
    OutOfRangeError
        For an image that is not behind the main lens (a_L ≥ z), and for lengths that are not positive.
    """
    a_L = np.asarray(microlens_object_distance, dtype=np.float64)
    z, A, p = _positive(mla_distance, pupil_diameter, microlens_pitch)
    if not np.all(a_L < z):
        raise OutOfRangeError(
            "image of the main lens relative to the array",
            value=f"{np.max(a_L):g} m before the array",
            limit="less than the distance from main lens to array",
            remedy="move the object beyond the front focal point of the main lens",
        )
    # a_L/(z − a_L) written so that an image at infinity behind the array gives its limit −1.
    with np.errstate(divide="ignore"):
        ratio = np.where(a_L == 0, 0.0, 1 / (z / a_L - 1))
    return np.asarray(np.abs(ratio) * A / (2 * p))


def covering_microlens_object_distance(
    radius_over_pitch: ArrayLike,
    *,
    keplerian: bool,
    mla_distance: ArrayLike,
    pupil_diameter: ArrayLike,
    microlens_pitch: ArrayLike,
) -> FloatArray:
    """Signed a_L at which the disc of light has a given radius: a_L = ±2 r z / (A ± 2 r), the total covering plane.

    The inverse of `projected_radius_over_pitch` for one sign of the relay. With the radius from
    `covering_radius_over_pitch` it is the plane from which every point has the lenses asked for: farther
    images for a Keplerian relay (nearer the array there are fewer), and for a Galilean one images farther
    behind the array.

    Parameters
    ----------
    radius_over_pitch
        Radius of the disc over the pitch [1].
    keplerian
        Whether the image lies before the array.
    mla_distance, pupil_diameter, microlens_pitch
        As in `projected_radius_over_pitch` [m].

    Returns
    -------
    Signed distance [m], broadcast; −∞ for a Galilean relay where 2 r p reaches the pupil diameter exactly.

    Raises
    ------
    OutOfRangeError
        For a Galilean relay whose pupil is smaller than the disc asked for: no image behind the array reaches
        it.
    """
    z, A, p = _positive(mla_distance, pupil_diameter, microlens_pitch)
    disc = 2 * np.asarray(radius_over_pitch, dtype=np.float64) * p
    if keplerian:
        return np.asarray(disc * z / (A + disc))
    if np.any(disc > A):
        raise OutOfRangeError(
            "diameter of the disc of light on the array",
            value=f"{np.max(disc):g} m",
            limit=f"≤ {np.min(A):g} m, the pupil diameter, for a Galilean relay",
            remedy="open the aperture or take a smaller microlens pitch",
        )
    with np.errstate(divide="ignore"):  # the image at infinity is a limit that is meant
        return np.asarray(-disc * z / (A - disc))


def _positive(*lengths: ArrayLike) -> tuple[FloatArray, ...]:
    """Give lengths as arrays, or refuse one that is not positive."""
    arrays = tuple(np.asarray(length, dtype=np.float64) for length in lengths)
    for array in arrays:
        if not np.all(array > 0):
            raise OutOfRangeError(
                "length of the camera",
                value=f"{np.min(array):g} m",
                limit="> 0 m",
                remedy="check the unit and the sign",
            )
    return arrays

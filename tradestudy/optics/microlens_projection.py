"""From an object point to the micro-images of a focused plenoptic camera, and back (eqs. 3–7 of the paper).

The paper is "Diffraction model of a plenoptic camera for in-situ space exploration". All detector coordinates here are
*local*: measured from the centre of the microlens that forms the image. Equation 6 of the paper writes them as if they
were coordinates of the whole detector; used that way in eq. 8, they turn 300 mm into about 100 mm.

Every function works for one transverse coordinate; the other obeys the same law.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.thin_lens import focus_shift


def main_lens_image_coordinate(
    object_coordinate: ArrayLike, object_distance: ArrayLike, focal_length: ArrayLike
) -> FloatArray:
    """Eq. 3: the main lens images ξ to ``x' = −ξ f / (a − f) = −ξ s / f`` [m], inverted.

    Parameters
    ----------
    object_coordinate
        ξ [m].
    object_distance, focal_length
        a and f_M [m].
    """
    f = np.asarray(focal_length, dtype=np.float64)
    return np.asarray(-np.asarray(object_coordinate, dtype=np.float64) * (focus_shift(object_distance, f) / f))


def microlens_object_distance(
    object_distance: ArrayLike, mla_distance: ArrayLike, focal_length: ArrayLike
) -> FloatArray:
    """``a_L = z − b_M = (z − f) − s`` [m], signed: positive Keplerian (image in front), negative Galilean.

    Parameters
    ----------
    object_distance, mla_distance, focal_length
        a_M, z and f_M [m].

    Returns
    -------
    FloatArray
        Near a_L = 0 the difference keeps the absolute, not the relative, accuracy of its inputs.
    """
    f = np.asarray(focal_length, dtype=np.float64)
    return np.asarray((np.asarray(mla_distance, dtype=np.float64) - f) - focus_shift(object_distance, f))


def virtual_depth(
    object_distance: ArrayLike, mla_distance: ArrayLike, microlens_gap: ArrayLike, focal_length: ArrayLike
) -> FloatArray:
    """``v = a_L / b_L``, signed like a_L: how many micro-images per axis show a point."""
    return np.asarray(
        microlens_object_distance(object_distance, mla_distance, focal_length)
        / np.asarray(microlens_gap, dtype=np.float64)
    )


def object_distance_of_virtual_depth(
    virtual_depth: ArrayLike, mla_distance: ArrayLike, microlens_gap: ArrayLike, focal_length: ArrayLike
) -> FloatArray:
    """Object distance a_M [m] whose image has the virtual depth v: Newton's law with ``s = (z − f) − v b_L``.

    Returns
    -------
    FloatArray
        +infinity where s = 0; NaN where s < 0, because no object in front of the camera gives that virtual depth.
    """
    v, z, gap, f = (
        np.asarray(value, dtype=np.float64) for value in (virtual_depth, mla_distance, microlens_gap, focal_length)
    )
    s = (z - f) - v * gap
    with np.errstate(divide="ignore"):
        a = f + f * (f / np.abs(s))
    return np.asarray(np.where(s < 0.0, np.nan, a))


def project_to_detector(
    object_coordinate: ArrayLike,
    object_distance: ArrayLike,
    microlens_center: ArrayLike,
    *,
    mla_distance: ArrayLike,
    microlens_gap: ArrayLike,
    focal_length: ArrayLike,
) -> FloatArray:
    """Eqs. 4–6: the local image coordinate ``σ_i = (x_off,i − x') b_L / a_L`` [m] under microlens i.

    Parameters
    ----------
    object_coordinate, object_distance
        ξ and a_M [m].
    microlens_center
        x_off,i [m] from the optical axis.
    mla_distance, microlens_gap, focal_length
        z, b_L and f_M [m].

    Returns
    -------
    FloatArray
        Local coordinate [m]; ±infinity where the main lens images onto the array (a_L = 0). NaN if the image then falls
        on the very centre of the microlens, whose whole micro-image is lit.
    """
    x_image = main_lens_image_coordinate(object_coordinate, object_distance, focal_length)
    a_L = microlens_object_distance(object_distance, mla_distance, focal_length)
    with np.errstate(divide="ignore", invalid="ignore"):  # a_L = 0 is a pole of the law, documented above
        return np.asarray(
            (np.asarray(microlens_center, dtype=np.float64) - x_image)
            * (np.asarray(microlens_gap, dtype=np.float64) / a_L)
        )


def project_to_object(
    local_image_coordinate: ArrayLike,
    object_distance: ArrayLike,
    microlens_center: ArrayLike,
    *,
    mla_distance: ArrayLike,
    microlens_gap: ArrayLike,
    focal_length: ArrayLike,
) -> FloatArray:
    """Eq. 7: the object coordinate ξ [m] at distance a_M that microlens i images to σ_i.

    All points that a pixel can show lie on one straight line ``ξ = c₁ + a_M c₂``; this is its value at one distance,
    computed as ``x' = x_off − v σ`` and ``ξ = −x' f / s`` instead of the paper's expanded sum, whose terms cancel.

    Parameters
    ----------
    local_image_coordinate
        σ_i [m].
    object_distance, microlens_center, mla_distance, microlens_gap, focal_length
        As in `project_to_detector`.

    Returns
    -------
    FloatArray
        ξ [m]; grows without bound with a_M, along the line of sight.
    """
    f = np.asarray(focal_length, dtype=np.float64)
    v = virtual_depth(object_distance, mla_distance, microlens_gap, f)
    x_image = np.asarray(microlens_center, dtype=np.float64) - v * np.asarray(local_image_coordinate, dtype=np.float64)
    return np.asarray(-x_image * ((np.asarray(object_distance, dtype=np.float64) - f) / f))

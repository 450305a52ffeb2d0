"""From what a data sheet of a close-up camera says to the distance the lens equation means."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.depth_of_field.limits import as_floats, require


def object_distance_of_magnification(focal_length: ArrayLike, magnification: ArrayLike) -> FloatArray:
    """Object to principal plane: a = f (1 + 1/m).

    A data sheet's working distance counts from the front of the lens instead, which is not where the thin
    lens is. The scale is the safe way to a: m is the pixel pitch over the size of a pixel on the object.

    Parameters
    ----------
    focal_length
        f > 0 [m].
    magnification
        m > 0 [1], without sign.

    Returns
    -------
    a [m], broadcast; a → ∞ as m → 0.

    Raises
    ------
    OutOfRangeError
        For values that are not positive.
    """
    f, m = as_floats(focal_length, magnification)
    require(f > 0, "focal length", f, limit="> 0 m", remedy="check unit and sign")
    require(m > 0, "magnification", m, limit="> 0", remedy="give its size without sign", unit="")
    return np.asarray(f * (1 + 1 / m))


def object_distance_of_working_distance(
    working_distance: ArrayLike, *, reference_working_distance: ArrayLike, reference_object_distance: ArrayLike
) -> FloatArray:
    """Object to principal plane for another working distance: a = w + (a_ref − w_ref).

    Supposes that the principal plane keeps its distance from the front of the lens; a lens that focuses by
    moving its glass inside breaks this away from the reference.

    Parameters
    ----------
    working_distance
        w > 0, from the front of the lens [m].
    reference_working_distance, reference_object_distance
        A pair known at one focus [m], the latter from `object_distance_of_magnification`.

    Returns
    -------
    a [m], broadcast.

    Raises
    ------
    OutOfRangeError
        For a working distance that is not positive.
    """
    w, w_ref, a_ref = as_floats(working_distance, reference_working_distance, reference_object_distance)
    require(w > 0, "working distance", w, limit="> 0 m", remedy="count from the front of the lens")
    return np.asarray(w + (a_ref - w_ref))

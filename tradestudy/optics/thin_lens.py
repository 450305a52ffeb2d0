"""The thin lens, written in the focus shift ``s = b − f`` so that no digit is lost for far objects.

The textbook pair ``b = a f / (a − f)``, ``a = b f / (b − f)`` loses eight of sixteen digits in a round trip at
``a = 1e8 m`` with ``f = 50 mm``, because ``b`` then differs from ``f`` only in its last digits. Newton's form keeps
that difference as the variable.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.optics.arrays import FloatArray


def focus_shift(object_distance: ArrayLike, focal_length: ArrayLike) -> FloatArray:
    """Newton's law: the image lies ``s = f² / (a − f)`` behind the focal plane.

    Parameters
    ----------
    object_distance
        Distance a from object to lens [m], any shape; infinity is allowed.
    focal_length
        f [m], broadcast against it.

    Returns
    -------
    FloatArray
        s [m]; 0 for an object at infinity, infinite for one in the front focal plane, below −f (a virtual image) for
        one inside the focal length. Relative error: a few units in the last place of ``a − f``.

    Notes
    -----
    The image equation b = a f/(a − f) of section 4.1.1 of "Diffraction model of a plenoptic camera for in-situ space
    exploration", minus f.
    """
    a, f = np.asarray(object_distance, dtype=np.float64), np.asarray(focal_length, dtype=np.float64)
    with np.errstate(divide="ignore"):  # an object in the focal plane is imaged to infinity, as documented
        return np.asarray(f * (f / (a - f)))


def object_distance(focus_shift: ArrayLike, focal_length: ArrayLike) -> FloatArray:
    """Newton's law, inverted: ``a = f + f² / s``.

    Parameters
    ----------
    focus_shift
        s = b − f [m], any shape.
    focal_length
        f [m], broadcast against it.

    Returns
    -------
    FloatArray
        a [m]; +infinity at s = 0. For a negative shift the law still applies: −f < s < 0 gives a point behind the
        camera (a < 0), s < −f the object of a virtual image (0 < a < f); the caller must interpret these.
    """
    s, f = np.asarray(focus_shift, dtype=np.float64), np.asarray(focal_length, dtype=np.float64)
    with np.errstate(divide="ignore"):  # an image in the focal plane comes from infinity
        return np.asarray(f + f * (f / np.where(s == 0.0, 0.0, s)))  # −0.0 would come from minus infinity


def image_distance(object_distance: ArrayLike, focal_length: ArrayLike) -> FloatArray:
    """The lens equation: ``b = f a / (a − f)`` [m]; see `focus_shift` for arguments and limits.

    Accurate to rounding even for an object close to the lens, where ``f + s`` would cancel.
    """
    a, f = np.asarray(object_distance, dtype=np.float64), np.asarray(focal_length, dtype=np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):  # infinity over infinity is 1, inserted below
        return np.asarray(np.where(np.isinf(a), f, f * (a / (a - f))))


def blur_diameter(
    object_distance: ArrayLike, focus_distance: ArrayLike, focal_length: ArrayLike, pupil_diameter: ArrayLike
) -> FloatArray:
    """Blur circle of a lens focused elsewhere: ``c = A f |a − a₀| / (a (a₀ − f))``.

    Parameters
    ----------
    object_distance, focus_distance
        a and a₀ [m]; both may be infinite.
    focal_length, pupil_diameter
        f and A [m].

    Returns
    -------
    FloatArray
        c [m] on the sensor. With the sensor at S = f + s₀, it is ``A S |1/a − 1/a₀|``, by similar triangles behind the
        lens. It has no pole, not even for an object in the front focal plane or nearer, whose rays leave the lens
        parallel or diverging.
    """
    a, a0, f, pupil = (
        np.asarray(value, dtype=np.float64) for value in (object_distance, focus_distance, focal_length, pupil_diameter)
    )
    sensor = f + focus_shift(a0, f)
    # (a − a₀)/(a a₀) keeps digits that 1/a − 1/a₀ loses near the focus; if one distance is infinite, 1/a of the other
    # remains.
    with np.errstate(invalid="ignore"):  # infinity minus infinity, replaced below
        difference = np.where(np.isinf(a0), 1.0 / a, np.where(np.isinf(a), 1.0 / a0, (a - a0) / a / a0))
    both = np.isinf(a) & np.isinf(a0)
    return np.asarray(np.where(both, 0.0, pupil * sensor * np.abs(difference)))

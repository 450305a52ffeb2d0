"""Paraxial imaging: the thin lens, a microlens behind it, and air in front of it.

The textbook pair ``b = a f / (a − f)``, ``a = b f / (b − f)`` loses eight of sixteen digits in a round trip at
``a = 1e8 m`` with ``f = 50 mm``, because ``b`` then differs from ``f`` only in its last digits. Newton's form keeps
that difference as the variable.

The paper is "Diffraction model of a plenoptic camera for in-situ space exploration". All detector coordinates here are
*local*: measured from the centre of the microlens that forms the image. Equation 6 of the paper writes them as if they
were coordinates of the whole detector; used that way in eq. 8, they turn 300 mm into about 100 mm.

Every function works for one transverse coordinate; the other obeys the same law.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.optics.arrays import FloatArray, as_floats


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
    a, a0, f, pupil = as_floats(object_distance, focus_distance, focal_length, pupil_diameter)
    sensor = f + focus_shift(a0, f)
    # (a − a₀)/(a a₀) keeps digits that 1/a − 1/a₀ loses near the focus; if one distance is infinite, 1/a of the other
    # remains.
    with np.errstate(invalid="ignore"):  # infinity minus infinity, replaced below
        difference = np.where(np.isinf(a0), 1.0 / a, np.where(np.isinf(a), 1.0 / a0, (a - a0) / a / a0))
    both_infinite = np.isinf(a) & np.isinf(a0)
    return np.asarray(np.where(both_infinite, 0.0, pupil * sensor * np.abs(difference)))


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
    v, z, gap, f = as_floats(virtual_depth, mla_distance, microlens_gap, focal_length)
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


STANDARD_TEMPERATURE = 288.15  # K
STANDARD_PRESSURE = 101_325.0  # Pa


def air_refractive_index(wavelength: float, temperature: ArrayLike, pressure: ArrayLike) -> FloatArray:
    """``n − 1 = (n_s − 1) (p/p_s)(T_s/T)``, with n_s for dry air at 15 °C and 101 325 Pa by Edlén's formula.

    Parameters
    ----------
    wavelength
        Vacuum wavelength [m], 0.2 to 2 µm.
    temperature, pressure
        T [K] and p [Pa], broadcast against each other; p = 0 is vacuum, with n = 1.

    Notes
    -----
    B. Edlén, "The refractive index of air", Metrologia 2 (1966) 71, eq. 1. The ideal gas law stands in for eq. 12;
    between 0 and 1.1 bar and from −20 to 50 °C they differ by less than 1e-6 in n.
    """
    square = (1e-6 / wavelength) ** 2  # wave number squared, per µm²
    refractivity = 1e-8 * (8342.13 + 2_406_030.0 / (130.0 - square) + 15_997.0 / (38.9 - square))
    density = np.asarray(pressure) / STANDARD_PRESSURE * (STANDARD_TEMPERATURE / np.asarray(temperature))
    return np.asarray(1.0 + refractivity * density)


def focal_length_change_with_medium(glass_index: float, index_before: ArrayLike, index_after: ArrayLike) -> FloatArray:
    """Ratio of a thin lens's focal lengths after and before the medium changes: ``f'/f = (n_g/n − 1)/(n_g/n' − 1)``.

    Parameters
    ----------
    glass_index
        n_g of the glass against vacuum.
    index_before, index_after
        n and n' of the medium, before and after the change.

    Notes
    -----
    The lensmaker's equation, with the index of the glass relative to the medium. In vacuum, the focal length
    of a lens of n_g = 1.52 is 0.08 % shorter than in air.
    """
    before = glass_index / np.asarray(index_before) - 1.0
    return np.asarray(before / (glass_index / np.asarray(index_after) - 1.0))

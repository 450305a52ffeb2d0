"""The unfocused plenoptic camera (plenoptic I): microlenses focused at infinity, the main image on the array.

Each pixel under a microlens sees the scene through its own part of the main lens's pupil, of width B = p_px
z/f_L. Images taken through neighbouring parts are shifted against each other and added to refocus.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.depth_of_field.single_lens import DepthOfField, as_floats, depth_of_field, require
from tradestudy.optics.thin_lens import focus_shift, image_distance


def view_pupil_diameter(
    focus_distance: ArrayLike,
    *,
    focal_length: ArrayLike,
    pixel_pitch: ArrayLike,
    microlens_focal_length: ArrayLike,
) -> FloatArray:
    """Part of the main lens's pupil that one pixel sees through: B = p_px z/f_L, z the image distance of the focus.

    Parameters
    ----------
    focus_distance, focal_length
        a₀ > f: where the array is in focus, and f of the main lens [m].
    pixel_pitch, microlens_focal_length
        p_px and f_L > 0 [m].

    Returns
    -------
    Width [m], broadcast: also the baseline of neighbouring views. Geometric; diffraction at the microlens
    widens it.

    Raises
    ------
    OutOfRangeError
        For a focus inside the focal length and for lengths that are not positive.
    """
    a0, f, p_px, f_L = as_floats(focus_distance, focal_length, pixel_pitch, microlens_focal_length)
    require(a0 > f, "focus distance", a0, limit="beyond the focal length", remedy="focus farther away")
    for name, length in (("focal length", f), ("pixel pitch", p_px), ("microlens focal length", f_L)):
        require(length > 0, name, length, limit="> 0 m", remedy="check unit and sign")
    return np.asarray(p_px * (image_distance(a0, f) / f_L))


def refocus_distance(
    shift: ArrayLike,
    focus_distance: ArrayLike,
    *,
    focal_length: ArrayLike,
    view_pupil_diameter: ArrayLike,
    microlens_pitch: ArrayLike,
) -> FloatArray:
    """Object distance that shifting neighbouring views by so many microlenses brings into focus.

    The image distance is b = z B/(B − α p), so that the focus shift is s = s₀ + z α p/(B − α p), and a = f +
    f²/s.

    Parameters
    ----------
    shift
        α, shift between views of neighbouring pixels [microlenses], any real number; positive refocuses
        nearer.
    focus_distance, focal_length
        a₀ > f, where the array is in focus, and f [m].
    view_pupil_diameter
        B, from `view_pupil_diameter` [m].
    microlens_pitch
        p > 0 [m].

    Returns
    -------
    a [m] from the main lens, broadcast; ∞ for the shift that refocuses on infinity and all beyond it, f for
    shifts of B/p and more, beyond which no real image is left.

    Notes
    -----
    For a pupil in the plane of a thin main lens. The chief-ray model of C. Hahne et al., "Refocusing distance
    of a standard plenoptic camera", Optics Express 24 (2016), gives the same distances if its exit pupil is
    put there.

    Raises
    ------
    OutOfRangeError
        As `view_pupil_diameter`.
    """
    shifts, a0, f, B, p = as_floats(shift, focus_distance, focal_length, view_pupil_diameter, microlens_pitch)
    require(a0 > f, "focus distance", a0, limit="beyond the focal length", remedy="focus farther away")
    for name, length in (("focal length", f), ("pupil of a view", B), ("microlens pitch", p)):
        require(length > 0, name, length, limit="> 0 m", remedy="check unit and sign")
    travel = shifts * p
    with np.errstate(divide="ignore"):  # a shift of a whole view puts the image at infinity
        moved = np.where(travel < B, image_distance(a0, f) * travel / np.where(travel < B, B - travel, 1.0), np.inf)
        s = focus_shift(a0, f) + moved
        return np.asarray(np.where(s > 0, f + f * (f / np.where(s > 0, s, 1.0)), np.inf))


def refocused_depth_of_field(
    refocused_distance: ArrayLike,
    focus_distance: ArrayLike,
    *,
    focal_length: ArrayLike,
    pupil_diameter: ArrayLike,
    blur_diameter: ArrayLike,
) -> DepthOfField:
    """Depth of field of one refocused image: A z |1/b − 1/b_α| ≤ c, the blur measured on the array.

    Parameters
    ----------
    refocused_distance
        Distance a_α the image is refocused on, > f [m]; ∞ is allowed.
    focus_distance
        a₀ > f: where the array is in focus [m].
    focal_length, pupil_diameter
        f and A of the main lens [m].
    blur_diameter
        Geometric blur c ≥ 0 that counts as sharp, on the array [m]; the microlens pitch, since that is the
        lateral sample.

    Returns
    -------
    The limits, broadcast. Adding views shifted for a_α acts like a lens refocused there and scaled back to
    the array, so this is a conventional depth of field with the blur c b_α/z. It supposes a_α within
    `view_depth_of_field`.

    Raises
    ------
    OutOfRangeError
        As `depth_of_field`.
    """
    a0, a_refocused, f, c = as_floats(focus_distance, refocused_distance, focal_length, blur_diameter)
    require(a0 > f, "focus distance", a0, limit="beyond the focal length", remedy="focus farther away")
    require(a_refocused > f, "refocused distance", a_refocused, limit="beyond the focal length", remedy="shift less")
    scale = image_distance(a_refocused, f) / image_distance(a0, f)
    return depth_of_field(a_refocused, f, pupil_diameter, c * scale)


def view_depth_of_field(
    focus_distance: ArrayLike,
    *,
    focal_length: ArrayLike,
    view_pupil_diameter: ArrayLike,
    blur_diameter: ArrayLike,
) -> DepthOfField:
    """Distances at which each single view is sharp, so those the camera can refocus on: a lens of pupil B.

    Parameters
    ----------
    focus_distance, focal_length
        a₀ > f and f [m].
    view_pupil_diameter
        B, from `view_pupil_diameter` [m].
    blur_diameter
        Geometric blur c that counts as sharp, on the array [m]; with the microlens pitch the ends are the
        shifts ∓1.

    Returns
    -------
    The limits, broadcast; as many times deeper (in inverse image distance) than without refocusing as there
    are views across.

    Raises
    ------
    OutOfRangeError
        As `depth_of_field`.
    """
    return depth_of_field(focus_distance, focal_length, view_pupil_diameter, blur_diameter)

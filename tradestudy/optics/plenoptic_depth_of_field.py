"""Depth of field of plenoptic cameras: of a focused one by types of microlenses, of an unfocused one by views.

Focused: a microlens of aperture D at the gap b_L in front of the detector, focused at virtual depth v₀, blurs a point
at virtual depth v to the diameter D |1/v − 1/v₀|, so depth of field is symmetric in 1/v. All signs follow v: positive
for a Keplerian relay (image of the main lens in front of the array), negative for a Galilean one (image behind it).

Unfocused (plenoptic I): microlenses are focused at infinity, and the main image lies on the array. Each pixel under a
microlens sees the scene through its own part of the main lens's pupil, of width B = p_px z/f_L. `Refocusing` shifts
images taken through neighbouring parts against each other.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray, as_floats, require
from tradestudy.optics.depth_of_field import DepthOfField
from tradestudy.optics.thin_lens import image_distance


def inverse_focus_virtual_depth(microlens_focal_length: ArrayLike, microlens_gap: ArrayLike) -> FloatArray:
    """1/v₀ = b_L/f_L − 1, from 1/f_L = 1/a_L + 1/b_L.

    Parameters
    ----------
    microlens_focal_length, microlens_gap
        f_L > 0 and b_L > 0 [m]; f_L is infinite for pinholes.

    Returns
    -------
    1/v₀ [1], broadcast: positive for a Keplerian focus (b_L > f_L), negative for a Galilean one, 0 for b_L =
    f_L, which means focus at infinity on both sides.

    Raises
    ------
    OutOfRangeError
        For lengths that are not positive.
    """
    f_L, b_L = as_floats(microlens_focal_length, microlens_gap)
    require(f_L > 0, "microlens focal length", f_L, limit="> 0 m")
    require(b_L > 0, "microlens gap", b_L, limit="> 0 m")
    pinhole = np.isinf(f_L)
    return np.asarray(np.where(pinhole, -1.0, (b_L - np.where(pinhole, b_L, f_L)) / f_L))


def relay_blur_diameter(
    virtual_depth: ArrayLike, inverse_focus_virtual_depth: ArrayLike, microlens_aperture: ArrayLike
) -> FloatArray:
    """Geometric blur on the detector: D |1/v − 1/v₀|.

    Parameters
    ----------
    virtual_depth
        v [1], signed; ±∞ is allowed.
    inverse_focus_virtual_depth
        1/v₀ [1], signed, of the microlens type.
    microlens_aperture
        D > 0 [m]; the pitch for a full fill factor.

    Returns
    -------
    Diameter [m], broadcast; ∞ for an image on the array. Valid while light fills the microlens: for |v| ≥ 1 with
    matched f-numbers.
    """
    v, w0, D = as_floats(virtual_depth, inverse_focus_virtual_depth, microlens_aperture)
    require(D > 0, "microlens aperture", D, limit="> 0 m")
    with np.errstate(divide="ignore"):  # an image on the array is blurred without bound, as documented
        return np.asarray(D * np.abs(1 / v - w0))


def relay_depth_of_field(
    inverse_focus_virtual_depth: ArrayLike,
    *,
    blur_diameter: ArrayLike,
    microlens_aperture: ArrayLike,
    microlens_gap: ArrayLike,
    mla_distance: ArrayLike,
    focal_length: ArrayLike,
    keplerian: bool,
) -> DepthOfField:
    """Object distances that a type of microlens keeps sharp: a = f + f²/s with s = (z − f) − b_L/w, w = 1/v₀ ± c/D.

    Parameters
    ----------
    inverse_focus_virtual_depth
        1/v₀ of each type [1], signed.
    blur_diameter
        Geometric blur c that counts as sharp, on the detector [m]. NaN, where diffraction has used up the blur, gives
        an empty depth of field.
    microlens_aperture, microlens_gap
        D and b_L > 0 [m].
    mla_distance, focal_length
        Main lens to array z, and f of the main lens, > 0 [m].
    keplerian
        Whether the main lens's image is used in front of the array. Blur may allow a type to reach through 1/v = 0 to
        the other side, whose micro-images are reversed; that part is not counted.

    Returns
    -------
    The limits in front of the main lens [m], broadcast. The far limit is ∞ exactly where the sharp image distances
    reach the focal plane of the main lens. A type that is sharp only for images nearer than the focal plane (beyond
    infinity) or on the other side of the array has no depth of field; the reason says so.

    Notes
    -----
    The depth of field is that of the microlenses. The distance of the image is mapped by the focus shift s =
    b − f, which keeps its digits for distant objects.

    Raises
    ------
    OutOfRangeError
        For lengths that are not positive.
    """
    w0, c, D = as_floats(inverse_focus_virtual_depth, blur_diameter, microlens_aperture)
    require((c >= 0) | np.isnan(c), "blur diameter", c, limit="≥ 0 m", remedy="declare the blur that counts as sharp")
    require(D > 0, "microlens aperture", D, limit="> 0 m")
    half = c / D  # of the depth of field in 1/v
    b_L, z, f = as_floats(microlens_gap, mla_distance, focal_length)
    for name, length in (("microlens gap", b_L), ("main lens to array", z), ("focal length", f)):
        require(length > 0, name, length, limit="> 0 m")
    side = 1.0 if keplerian else -1.0
    # Unsigned depth of the relay: the end nearer to the array is the near limit of a Keplerian relay, but the far limit
    # of a Galilean one.
    to_array, from_array = side * w0 + half, np.maximum(side * w0 - half, 0.0)
    near_end, far_end = (to_array, from_array) if keplerian else (from_array, to_array)
    with np.errstate(divide="ignore", invalid="ignore"):  # a relay image at infinity; signs are handled below
        near_shift, far_shift = ((z - f) - side * (b_L / end) for end in (near_end, far_end))
        near = f + f * (f / near_shift)
        far = np.where(far_shift > 0, f + f * (f / far_shift), np.inf)
    wrong_side = to_array <= 0
    beyond = ~wrong_side & ~(near_shift > 0) & ~np.isnan(near_shift)
    empty = wrong_side | beyond | np.isnan(near_shift)
    reason = "; ".join(
        text
        for text, applies in (
            ("a microlens type focuses on the other side of the array", np.any(wrong_side & (w0 != -1.0))),
            ("the shadow of a pinhole is larger than the blur", np.any(wrong_side & (w0 == -1.0))),
            ("a microlens type is sharp only beyond infinity", np.any(beyond)),
            ("diffraction leaves no blur to a microlens type", np.any(np.isnan(half))),
        )
        if applies
    )
    return DepthOfField(near=np.where(empty, np.nan, near), far=np.where(empty, np.nan, far), reason=reason)


def touching_inverse_virtual_depths(
    *, pixels_per_lens: float, nearest_virtual_depth: float = 2.0, types: int = 3, blur_px: float = 1.0
) -> FloatArray:
    """|1/v₀| of types whose depths of field just touch: 1/v_c − (2k + 1) c/D, k = 0 … types − 1.

    Parameters
    ----------
    pixels_per_lens
        Pixels across the aperture of a microlens, D in pixels.
    nearest_virtual_depth
        |v| of the total covering plane, where the range of the first type begins, > 0 [1].
    types
        Number of types, ≥ 1.
    blur_px
        Geometric blur that counts as sharp [px], > 0.

    Returns
    -------
    |1/v₀| [1], unsigned, one per type, shape (types,); multiply by −1 for a Galilean relay.

    Raises
    ------
    OutOfRangeError
        If a type would have to focus beyond an infinitely distant relay image, or a value is not positive.
    """
    values = {"pixels per lens": pixels_per_lens, "virtual depth": nearest_virtual_depth, "blur in pixels": blur_px}
    for name, value in values.items():
        require(value > 0, name, np.asarray(value), limit="> 0", remedy="give a positive number", unit="")
    require(types >= 1, "microlens types", np.asarray(types), limit="≥ 1", remedy="design one or more", unit="")
    inverse = 1 / nearest_virtual_depth - (2 * np.arange(types) + 1) * (blur_px / pixels_per_lens)
    if inverse[-1] <= 0:
        reached = int(np.count_nonzero(inverse > 0))
        raise OutOfRangeError(
            "microlens types that touch from the total covering plane on",
            value=str(types),
            limit=f"≤ {reached}, which already reach an infinitely distant relay image",
            remedy="use fewer types, more pixels per lens, or a nearer total covering plane",
        )
    return np.asarray(inverse)


def microlens_focal_length(inverse_focus_virtual_depth: ArrayLike, microlens_gap: ArrayLike) -> FloatArray:
    """f_L = b_L/(1 + 1/v₀) [m], the inverse of `inverse_focus_virtual_depth`; 1/v₀ signed, above −1.

    Raises
    ------
    OutOfRangeError
        For 1/v₀ ≤ −1, which no converging microlens has, and for a gap that is not positive.
    """
    w0, b_L = as_floats(inverse_focus_virtual_depth, microlens_gap)
    require(w0 > -1, "inverse virtual depth in focus", w0, limit="> −1", remedy="focus at |v| > 1", unit="")
    require(b_L > 0, "microlens gap", b_L, limit="> 0 m")
    return np.asarray(b_L / (1 + w0))


def view_pupil_diameter(
    focus_distance: ArrayLike,
    *,
    focal_length: ArrayLike,
    pixel_pitch: ArrayLike,
    microlens_focal_length: ArrayLike,
) -> FloatArray:
    """Width of the part of the pupil through which one pixel sees: B = p_px z/f_L, with the image distance z in focus.

    Parameters
    ----------
    focus_distance, focal_length
        a₀ > f, the distance in focus on the array, and f of the main lens [m].
    pixel_pitch, microlens_focal_length
        p_px and f_L > 0 [m].

    Returns
    -------
    Width [m], broadcast; it is also the baseline of neighbouring views. Geometric: diffraction at the microlens widens
    it.

    Raises
    ------
    OutOfRangeError
        For a focus inside the focal length and for lengths that are not positive.
    """
    a0, f, p_px, f_L = as_floats(focus_distance, focal_length, pixel_pitch, microlens_focal_length)
    require(a0 > f, "focus distance", a0, limit="beyond the focal length", remedy="focus farther away")
    for name, length in (("focal length", f), ("pixel pitch", p_px), ("microlens focal length", f_L)):
        require(length > 0, name, length, limit="> 0 m")
    return np.asarray(p_px * (image_distance(a0, f) / f_L))

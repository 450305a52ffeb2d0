"""Lateral resolution of a camera on the object over distance, and the range in which it resolves a given size.

One rule for every camera: a detail is resolved when neither the lateral sample nor the geometric blur, both projected
to the object, is larger. The resolution is therefore the larger of the two, and the depth of field *at equal
resolution* is the range in which it does not exceed a given size. `depth_of_field.diffraction_allowance` judges
diffraction.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.depth_of_field.single_lens import DepthOfField, as_floats, require
from tradestudy.optics.thin_lens import focus_shift, image_distance


def lateral_resolution(
    distance: ArrayLike,
    *,
    focus_distance: ArrayLike,
    focal_length: ArrayLike,
    pupil_diameter: ArrayLike,
    sample_pitch: ArrayLike,
) -> FloatArray:
    """Lateral resolution on the object for samples in the image plane of a lens: max(p a/b₀, A |a − a₀|/a₀).

    Parameters
    ----------
    distance
        a > 0 [m].
    focus_distance, focal_length
        a₀ > f and f [m].
    pupil_diameter
        A [m] of the lens; for an unfocused plenoptic camera, of one view (`view_pupil_diameter`).
    sample_pitch
        p [m]: the pixel pitch; for an unfocused plenoptic camera the microlens pitch.

    Returns
    -------
    Size on the object [m], broadcast. For a₀ = ∞ the blur is A at every distance: the width of the beam that comes from
    infinity.

    Raises
    ------
    OutOfRangeError
        For a focus inside the focal length, and for lengths that are not positive.
    """
    a, a0, f, A, p = as_floats(distance, focus_distance, focal_length, pupil_diameter, sample_pitch)
    _require_lengths(distance=a, focal_length=f, pupil_diameter=A, sample_pitch=p)
    require(a0 > f, "focus distance", a0, limit="beyond the focal length", remedy="focus farther away")
    return np.asarray(np.maximum(p * (a / image_distance(a0, f)), A * np.abs(a * (1 / a0) - 1)))


def depth_of_field_at_resolution(
    resolution: ArrayLike,
    *,
    focus_distance: ArrayLike,
    focal_length: ArrayLike,
    pupil_diameter: ArrayLike,
    sample_pitch: ArrayLike,
) -> DepthOfField:
    """Where `lateral_resolution` is at most r: from a₀ (1 − r/A) to the smaller of a₀ (1 + r/A) and r b₀/p.

    Parameters
    ----------
    resolution
        r > 0, size on the object [m].
    focus_distance, focal_length, pupil_diameter, sample_pitch
        As in `lateral_resolution` [m].

    Returns
    -------
    The limits [m], broadcast; the near one is at the lens (0) for r ≥ A. There are none where the samples are too
    coarse even at the near limit, or for a focus at infinity with r < A; the reason says so.

    Raises
    ------
    OutOfRangeError
        As in `lateral_resolution`, and for a resolution that is not positive.
    """
    r, a0, f, A, p = as_floats(resolution, focus_distance, focal_length, pupil_diameter, sample_pitch)
    _require_lengths(resolution=r, focal_length=f, pupil_diameter=A, sample_pitch=p)
    require(a0 > f, "focus distance", a0, limit="beyond the focal length", remedy="focus farther away")
    reachable = np.isfinite(a0) | (r >= A)
    nearest = np.maximum(1 - r / A, 0.0)
    near = np.where(nearest > 0, np.where(np.isfinite(a0), a0, 0.0) * nearest, 0.0)
    far = np.minimum(a0 * (1 + r / A), r * (image_distance(a0, f) / p))
    empty = ~reachable | (far < near)
    reason = "no distance meets the required resolution in both samples and blur" if np.any(empty) else ""
    return DepthOfField(near=np.where(empty, np.nan, near), far=np.where(empty, np.nan, far), reason=reason)


def focused_plenoptic_lateral_resolution(
    distance: ArrayLike,
    *,
    mla_distance: ArrayLike,
    microlens_gap: ArrayLike,
    focal_length: ArrayLike,
    inverse_focus_virtual_depth: ArrayLike,
    microlens_aperture: ArrayLike,
    pixel_pitch: ArrayLike,
) -> FloatArray:
    """Lateral resolution on the object for one type of microlens: max(p |v|, D |1 − v/v₀|) f/s.

    Parameters
    ----------
    distance
        a > f [m].
    mla_distance, microlens_gap, focal_length
        z, b_L and f of the main lens [m].
    inverse_focus_virtual_depth
        1/v₀ of the type [1], signed. For several types, take the minimum of the result along their axis.
    microlens_aperture, pixel_pitch
        D and p [m].

    Returns
    -------
    Size on the object [m], broadcast. A micro-image is |v| times smaller than the main lens's image; the blur D |1/v −
    1/v₀| is projected back with it. For an image on the array itself, a microlens resolves only its own aperture, D.

    Raises
    ------
    OutOfRangeError
        For a distance within the focal length, and for lengths that are not positive.
    """
    a, z, b_L, f, w0, D, p = as_floats(
        distance,
        mla_distance,
        microlens_gap,
        focal_length,
        inverse_focus_virtual_depth,
        microlens_aperture,
        pixel_pitch,
    )
    _require_lengths(mla_distance=z, microlens_gap=b_L, focal_length=f, microlens_aperture=D, pixel_pitch=p)
    require(a > f, "object distance", a, limit="beyond the focal length", remedy="leave out nearer objects")
    v = ((z - f) - focus_shift(a, f)) / b_L
    return np.asarray(np.maximum(p * np.abs(v), D * np.abs(1 - v * w0)) * ((a - f) / f))


def focused_plenoptic_depth_of_field_at_resolution(
    resolution: ArrayLike,
    *,
    mla_distance: ArrayLike,
    microlens_gap: ArrayLike,
    focal_length: ArrayLike,
    inverse_focus_virtual_depth: ArrayLike,
    microlens_aperture: ArrayLike,
    pixel_pitch: ArrayLike,
    keplerian: bool,
) -> DepthOfField:
    """Where `focused_plenoptic_lateral_resolution` is at most r, on one side of the array.

    Both conditions are linear in the focus shift s: p f |z − f − s| ≤ r b_L s and D f |1 − (z − f − s)/(b_L
    v₀)| ≤ r s.

    Parameters
    ----------
    resolution
        r > 0, size on the object [m].
    mla_distance, microlens_gap, focal_length, inverse_focus_virtual_depth, microlens_aperture, pixel_pitch
        As in `focused_plenoptic_lateral_resolution`.
    keplerian
        Whether the main lens's image is used in front of the array.

    Returns
    -------
    The limits [m], broadcast. There are none where the two conditions have no common range on that side; the reason
    says so.

    Raises
    ------
    OutOfRangeError
        For lengths that are not positive.
    """
    r, z, b_L, f, w0, D, p = as_floats(
        resolution,
        mla_distance,
        microlens_gap,
        focal_length,
        inverse_focus_virtual_depth,
        microlens_aperture,
        pixel_pitch,
    )
    _require_lengths(
        resolution=r, mla_distance=z, microlens_gap=b_L, focal_length=f, microlens_aperture=D, pixel_pitch=p
    )
    array_shift, side = z - f, 1.0 if keplerian else -1.0
    slope, offset, allowed = w0, array_shift * w0 - b_L, r * b_L / f
    low, high = _solve(
        (1 + allowed / p, array_shift),  # the sample, where the image lies in front of the array
        (allowed / p - 1, -array_shift),  # and behind it
        (allowed / D + slope, offset),  # the blur
        (allowed / D - slope, -offset),
        (-side, -side * array_shift),
    )
    empty = (low > high) | ~(high > 0)
    with np.errstate(divide="ignore"):  # the ends of the range of s are the ends of the range of distance
        near = f + f * (f / np.where(empty, np.nan, high))
        far = f + f * (f / np.where(empty, np.nan, np.maximum(low, 0.0)))
    reason = (
        "no distance on this side of the array meets the required resolution in both samples and blur"
        if np.any(empty)
        else ""
    )
    return DepthOfField(near=near, far=far, reason=reason)


def _solve(*conditions: tuple[ArrayLike, ArrayLike]) -> tuple[FloatArray, FloatArray]:
    """Smallest and largest s that satisfy every c s ≥ d; the smallest exceeds the largest if none does."""
    low, high = np.asarray(-np.inf), np.asarray(np.inf)
    for coefficient, constant in conditions:
        c, d = np.broadcast_arrays(*as_floats(coefficient, constant))
        bound = np.divide(d, c, out=np.where(d > 0, np.inf, -np.inf), where=c != 0)
        low = np.maximum(low, np.where(c >= 0, bound, -np.inf))
        high = np.minimum(high, np.where(c < 0, bound, np.inf))
    return low, high


def _require_lengths(**lengths: FloatArray) -> None:
    """Refuse lengths that are not positive."""
    for name, length in lengths.items():
        require(length > 0, name.replace("_", " "), length, limit="> 0 m", remedy="check unit and sign")

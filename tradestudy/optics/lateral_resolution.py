"""Lateral resolution of a camera on the object over distance, and the range in which it resolves a given size.

One rule for every camera: a detail is resolved when neither the lateral sample, nor the geometric blur, nor the radius
of the Airy disc, all projected to the object, is larger. The radius of the Airy disc, 1.22 λ N_w/m, is Rayleigh's
criterion: two points are told apart when one lies on the first dark ring of the other. The resolution is therefore the
largest of the three, and the depth of field *at equal resolution* is the range in which it does not exceed a given
size.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.optics.arrays import FloatArray, as_floats, require
from tradestudy.optics.depth_of_field import DepthOfField, diffraction_diameter
from tradestudy.optics.thin_lens import focus_shift, image_distance

FIRST_DARK_RING: Final = 3.8317059702075125 / math.pi
"""1.2197, first zero of J₁ over π: radius of the first dark ring in λ N, N the working f-number."""
_WIDTH_IN_RADII: Final = float(diffraction_diameter(1.0, 1.0, "fwhm")) / FIRST_DARK_RING


@dataclass(frozen=True, kw_only=True)
class LateralResolution:
    """The three lengths on the object that limit the lateral resolution [m], each of the same shape."""

    sampling: FloatArray
    """The lateral sample: a pixel, or a microlens of an unfocused plenoptic camera."""
    blur: FloatArray
    """The diameter of the geometric blur."""
    diffraction: FloatArray
    """The radius of the Airy disc."""

    @property
    def diffraction_width(self) -> FloatArray:
        """Width of the diffraction spot at half maximum [m]: 1.03 λ a/A, if the Airy disc's radius is 1.22 λ a/A."""
        return self.diffraction * _WIDTH_IN_RADII

    @property
    def size(self) -> FloatArray:
        """The smallest detail that is resolved: the largest of the three [m]."""
        return np.asarray(np.maximum(np.maximum(self.sampling, self.blur), self.diffraction))


def airy_radius(distance: ArrayLike, pupil_diameter: ArrayLike, wavelength: ArrayLike) -> FloatArray:
    """Radius of the Airy disc of a pupil [m] at a distance, on the object or in the image: 1.22 λ a/A; broadcast.

    Parameters
    ----------
    distance, pupil_diameter
        a > 0 and A > 0 [m].
    wavelength
        λ > 0 [m].

    Raises
    ------
    OutOfRangeError
        For values that are not positive.
    """
    a, A = as_floats(distance, pupil_diameter)
    _require_lengths(distance=a, pupil_diameter=A)
    return np.asarray(diffraction_diameter(wavelength, a / A, "airy-diameter") / 2.0)


def lateral_resolution(
    distance: ArrayLike,
    *,
    focus_distance: ArrayLike,
    focal_length: ArrayLike,
    pupil_diameter: ArrayLike,
    sample_pitch: ArrayLike,
    wavelength: ArrayLike,
) -> LateralResolution:
    """Lateral resolution on the object for samples in the image plane of a lens: p a/b₀, A |a − a₀|/a₀, 1.22 λ a/A.

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
    wavelength
        λ > 0 [m].

    Returns
    -------
    Sample, blur and Airy radius on the object [m], broadcast. For a₀ = ∞ the blur is A at every distance: the width of
    the beam that comes from infinity.

    Raises
    ------
    OutOfRangeError
        For a focus inside the focal length, and for lengths that are not positive.
    """
    a, a0, f, A, p = as_floats(distance, focus_distance, focal_length, pupil_diameter, sample_pitch)
    _require_lengths(distance=a, focal_length=f, pupil_diameter=A, sample_pitch=p)
    require(a0 > f, "focus distance", a0, limit="beyond the focal length", remedy="focus farther away")
    return _broadcast(
        sampling=p * (a / image_distance(a0, f)),
        blur=A * np.abs(a * (1 / a0) - 1),
        diffraction=airy_radius(a, A, wavelength),
    )


def depth_of_field_at_resolution(
    resolution: ArrayLike,
    *,
    focus_distance: ArrayLike,
    focal_length: ArrayLike,
    pupil_diameter: ArrayLike,
    sample_pitch: ArrayLike,
    wavelength: ArrayLike,
) -> DepthOfField:
    """Where `lateral_resolution` is at most r: a₀ (1 − r/A) to the smallest of a₀ (1 + r/A), r b₀/p and r A/(1.22 λ).

    Parameters
    ----------
    resolution
        r > 0, size on the object [m].
    focus_distance, focal_length, pupil_diameter, sample_pitch, wavelength
        As in `lateral_resolution` [m].

    Returns
    -------
    The limits [m], broadcast; the near one is at the lens (0) for r ≥ A. There are none where the samples or the Airy
    disc are too coarse even at the near limit, or for a focus at infinity with r < A; the reason says so.

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
    coarser = np.maximum(p / image_distance(a0, f), airy_radius(1.0, A, wavelength))  # per distance
    far = np.minimum(a0 * (1 + r / A), r / coarser)
    empty = ~reachable | (far < near)
    reason = "no distance meets the required resolution in samples, blur and diffraction" if np.any(empty) else ""
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
    pupil_diameter: ArrayLike,
    wavelength: ArrayLike,
    entrance_pupil: float = 0.0,
) -> LateralResolution:
    """Lateral resolution on the object for one type of microlens: sample, blur and Airy radius.

    Parameters
    ----------
    distance
        a > f [m].
    mla_distance, microlens_gap, focal_length
        z, b_L and f of the main lens [m].
    inverse_focus_virtual_depth
        1/v₀ of the type [1], signed. For several types, take the smallest `size`.
    microlens_aperture, pixel_pitch
        D and p [m].
    pupil_diameter
        A of the main lens [m].
    wavelength
        λ > 0 [m].
    entrance_pupil
        Distance e of the entrance pupil behind the principal plane from which a counts [m].

    Returns
    -------
    Sample p |v|, blur D |1 − v/v₀| and Airy radius 1.22 λ b_L |v|/D, each times (a − f)/f [m], broadcast. A micro-image
    is |v| times smaller than the main lens's image; the blur D |1/v − 1/v₀| is projected back with it. For an image on
    the array itself, a microlens resolves only its own aperture, D. The Airy disc is that of the part of the main
    lens's pupil through which a microlens sees the object, D b/|a_L| wide. Where that part would be wider than the
    pupil A, the pupil diffracts instead: 1.22 λ (a + e)/A.

    Raises
    ------
    OutOfRangeError
        For a distance within the focal length, and for lengths that are not positive.
    """
    a, z, b_L, f, w0, D, p, A = as_floats(
        distance,
        mla_distance,
        microlens_gap,
        focal_length,
        inverse_focus_virtual_depth,
        microlens_aperture,
        pixel_pitch,
        pupil_diameter,
    )
    _require_lengths(mla_distance=z, microlens_gap=b_L, focal_length=f, microlens_aperture=D, pixel_pitch=p)
    require(a > f, "object distance", a, limit="beyond the focal length", remedy="leave out nearer objects")
    v, enlarged = ((z - f) - focus_shift(a, f)) / b_L, (a - f) / f
    through_microlens = diffraction_diameter(wavelength, b_L / D, "airy-diameter") / 2.0
    return _broadcast(
        sampling=p * np.abs(v) * enlarged,
        blur=D * np.abs(1 - v * w0) * enlarged,
        diffraction=np.maximum(
            through_microlens * np.abs(v) * enlarged, airy_radius(a + entrance_pupil, A, wavelength)
        ),
    )


def focused_plenoptic_depth_of_field_at_resolution(
    resolution: ArrayLike,
    *,
    mla_distance: ArrayLike,
    microlens_gap: ArrayLike,
    focal_length: ArrayLike,
    inverse_focus_virtual_depth: ArrayLike,
    microlens_aperture: ArrayLike,
    pixel_pitch: ArrayLike,
    pupil_diameter: ArrayLike,
    wavelength: ArrayLike,
    keplerian: bool,
    entrance_pupil: float = 0.0,
) -> DepthOfField:
    """Where `focused_plenoptic_lateral_resolution` is at most r, on one side of the array.

    All conditions are linear in the focus shift s: q f |z − f − s| ≤ r b_L s with q the larger of pixel pitch and Airy
    radius 1.22 λ b_L/D, D f |1 − (z − f − s)/(b_L v₀)| ≤ r s, and 1.22 λ (f + e + f²/s)/A ≤ r.

    Parameters
    ----------
    resolution
        r > 0, size on the object [m].
    mla_distance, microlens_gap, focal_length, inverse_focus_virtual_depth, microlens_aperture, pixel_pitch
        As in `focused_plenoptic_lateral_resolution`.
    pupil_diameter, wavelength, entrance_pupil
        As in `focused_plenoptic_lateral_resolution`.
    keplerian
        Whether the main lens's image is used in front of the array.

    Returns
    -------
    The limits [m], broadcast. There are none where the conditions have no common range on that side; the reason
    says so.

    Raises
    ------
    OutOfRangeError
        For lengths that are not positive.
    """
    r, z, b_L, f, w0, D, p, A = as_floats(
        resolution,
        mla_distance,
        microlens_gap,
        focal_length,
        inverse_focus_virtual_depth,
        microlens_aperture,
        pixel_pitch,
        pupil_diameter,
    )
    _require_lengths(
        resolution=r, mla_distance=z, microlens_gap=b_L, focal_length=f, microlens_aperture=D, pixel_pitch=p
    )
    array_shift, side = z - f, 1.0 if keplerian else -1.0
    slope, offset, allowed = w0, array_shift * w0 - b_L, r * b_L / f
    coarser = np.maximum(p, diffraction_diameter(wavelength, b_L / D, "airy-diameter") / 2.0)
    low, high = _solve(
        (1 + allowed / coarser, array_shift),  # sample and microlens, where the image lies in front of the array
        (allowed / coarser - 1, -array_shift),  # and behind it
        (allowed / D + slope, offset),  # the blur
        (allowed / D - slope, -offset),
        (r / airy_radius(1.0, A, wavelength) - f - entrance_pupil, f * f),  # the pupil of the main lens
        (-side, -side * array_shift),
    )
    empty = (low > high) | ~(high > 0)
    with np.errstate(divide="ignore"):  # the ends of the range of s are the ends of the range of distance
        near = f + f * (f / np.where(empty, np.nan, high))
        far = f + f * (f / np.where(empty, np.nan, np.maximum(low, 0.0)))
    reason = (
        "no distance on this side of the array meets the required resolution in samples, blur and diffraction"
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


def _broadcast(*, sampling: FloatArray, blur: FloatArray, diffraction: FloatArray) -> LateralResolution:
    sampling, blur, diffraction = np.broadcast_arrays(sampling, blur, diffraction)
    return LateralResolution(sampling=sampling, blur=blur, diffraction=diffraction)


def _require_lengths(**lengths: FloatArray) -> None:
    """Refuse lengths that are not positive."""
    for name, length in lengths.items():
        require(length > 0, name.replace("_", " "), length, limit="> 0 m")

"""Depth of field of one lens with a sensor at a fixed place: the exact thin lens."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.depth_of_field.diffraction_allowance import (
    DiffractionMeasure,
    blur_allowance,
    diffraction_diameter,
)
from tradestudy.optics.depth_of_field.limits import DepthOfField, as_floats, require
from tradestudy.optics.thin_lens import image_distance


def hyperfocal_distance(focal_length: ArrayLike, pupil_diameter: ArrayLike, blur_diameter: ArrayLike) -> FloatArray:
    """Nearest focus that keeps infinity sharp: H = f A/c + f, that is f²/(N c) + f.

    Parameters
    ----------
    focal_length, pupil_diameter
        f and A = f/N, > 0 [m].
    blur_diameter
        c ≥ 0, geometric blur that counts as sharp, on the sensor [m].

    Returns
    -------
    H [m], broadcast; ∞ for c = 0.

    Raises
    ------
    OutOfRangeError
        For lengths that are not positive.
    """
    f, A, c = as_floats(focal_length, pupil_diameter, blur_diameter)
    _require_lens(f, A, c)
    with np.errstate(divide="ignore"):  # without any blur only infinity itself is the hyperfocal focus
        return np.asarray(f * (A / c) + f)


def depth_of_field(
    focus_distance: ArrayLike, focal_length: ArrayLike, pupil_diameter: ArrayLike, blur_diameter: ArrayLike
) -> DepthOfField:
    """Near and far limit of the exact thin lens: a − f = (1 ∓ κ) f/(f/(a₀ − f) ± κ) with κ = c/A.

    Parameters
    ----------
    focus_distance
        a₀ > f [m]; ∞ is allowed.
    focal_length, pupil_diameter
        f and A = f/N, > 0 [m].
    blur_diameter
        c ≥ 0, geometric blur that counts as sharp, on the sensor [m]. NaN, where no blur is allowed since
        diffraction has used it up, gives an empty depth of field.

    Returns
    -------
    The limits, broadcast. The far limit is ∞ exactly from a₀ = `hyperfocal_distance` on; both are a₀ for c =
    0; the near limit comes inside the focal length when c exceeds the pupil (a virtual image blurred less
    than that).

    Notes
    -----
    From the similar triangles behind the lens: a point imaged to b makes the blur A |b₀ − b|/b on a sensor at
    b₀. The relative error is rounding, magnified as the far limit is by its own condition number near the
    hyperfocal distance.

    Raises
    ------
    OutOfRangeError
        For a focus inside the focal length, for lengths that are not positive.
    """
    a0, f, A, c = as_floats(focus_distance, focal_length, pupil_diameter, blur_diameter)
    unlimited = np.where(np.isnan(c), 0.0, c)
    hyperfocal = hyperfocal_distance(f, A, unlimited)
    require(a0 > f, "focus distance", a0, limit="beyond the focal length", remedy="focus farther away")
    ratio = c / A
    shift = f / (a0 - f)  # focus shift of the sensor over the focal length
    finite = a0 < hyperfocal
    difference = np.where(finite, np.maximum(shift - ratio, 0.0), 0.0)
    with np.errstate(divide="ignore"):  # 0 in a denominator is a limit at infinity
        near = f + f * (1 - ratio) / (shift + ratio)
        far = f + f * (1 + ratio) / difference
    return DepthOfField(near=near, far=np.where(np.isnan(near), np.nan, far))


def diffraction_inclusive_depth_of_field(
    focus_distance: ArrayLike,
    focal_length: ArrayLike,
    pupil_diameter: ArrayLike,
    blur_criterion: ArrayLike,
    *,
    wavelength: ArrayLike,
    measure: DiffractionMeasure,
) -> DepthOfField:
    """Depth of field where defocus and diffraction together meet a criterion in quadrature.

    The diffraction spot is taken on the sensor, at the working f-number b₀/A, so it is the same for every
    distance.

    Parameters
    ----------
    focus_distance, focal_length, pupil_diameter
        As in `depth_of_field` [m].
    blur_criterion
        c > 0, the total blur that counts as sharp, on the sensor [m].
    wavelength
        λ [m].
    measure
        How wide the diffraction spot counts: ``airy-diameter``, ``fwhm`` or ``none``.

    Returns
    -------
    The limits, broadcast. Where diffraction alone exceeds the criterion there is no depth of field: ``empty``
    is true and ``reason`` gives both diameters. Unlike the geometric figure it is not monotone in the
    aperture.

    Raises
    ------
    OutOfRangeError
        As `depth_of_field`, and for a focus at which the law of the spot has no meaning.
    """
    a0, f, A = as_floats(focus_distance, focal_length, pupil_diameter)
    require(a0 > f, "focus distance", a0, limit="beyond the focal length", remedy="focus farther away")
    spot = diffraction_diameter(wavelength, image_distance(a0, f) / A, measure)
    allowance = blur_allowance(blur_criterion, spot)
    limits = depth_of_field(a0, f, A, allowance.geometric_diameter)
    return DepthOfField(near=limits.near, far=limits.far, reason=allowance.reason)


def _require_lens(f: FloatArray, A: FloatArray, c: FloatArray) -> None:
    """Refuse lenses and criteria that are none."""
    require(f > 0, "focal length", f, limit="> 0 m", remedy="check unit and sign")
    require(A > 0, "pupil diameter", A, limit="> 0 m", remedy="check unit and sign")
    require(c >= 0, "blur diameter", c, limit="≥ 0 m", remedy="declare the blur that counts as sharp")

"""Depth of field of the exact thin lens with a fixed sensor, and the geometric blur that diffraction leaves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.optics.thin_lens import image_distance

DiffractionMeasure = Literal["none", "airy-diameter", "fwhm"]
# Diameters of the diffraction pattern of a circular pupil in λ N: (2 J₁(x)/x)² with x = π r/(λ N) has its first zero at
# x = 3.8317059702075125 and half its peak at x = 1.6163399483107032; the diameter is 2x/π.
_DIAMETER_IN_WAVELENGTHS_PER_F_NUMBER: Final[dict[DiffractionMeasure, float]] = {
    "none": 0.0,
    "airy-diameter": 2.439339782533009,
    "fwhm": 1.028993969962188,
}


@dataclass(frozen=True, kw_only=True)
class DepthOfField:
    """Distances from the lens [m] between which the blur meets its criterion.

    Where no distance meets it, both limits are NaN, ``empty`` is true and ``reason`` says why in words.
    """

    near: FloatArray
    """Near limit [m]."""
    far: FloatArray
    """Far limit [m]; +∞ where everything beyond the near limit is sharp."""
    reason: str = ""
    """Reason if there is no depth of field somewhere, with the values of the worst case."""

    @property
    def empty(self) -> BoolArray:
        """Where nothing is sharp."""
        return np.asarray(np.isnan(self.near))

    @property
    def extent(self) -> FloatArray:
        """Far minus near limit [m]; 0 where nothing is sharp, ∞ where the far limit is ∞."""
        deep = self.far > self.near
        return np.subtract(self.far, self.near, out=np.zeros(np.shape(deep)), where=deep)

    def contains(self, distance: ArrayLike) -> BoolArray:
        """Whether distances [m] are sharp (broadcast against the limits)."""
        a = np.asarray(distance, dtype=np.float64)
        return np.asarray((a >= self.near) & (a <= self.far))


def intersection(first: DepthOfField, second: DepthOfField) -> DepthOfField:
    """Range sharp for both, such as the two lenses of a stereo rig: the farther near and the nearer far limit."""
    near, far = np.maximum(first.near, second.near), np.minimum(first.far, second.far)
    apart = near > far
    reasons = [reason for reason in (first.reason, second.reason) if reason]
    if np.any(apart):
        reasons.append("the two depths of field do not meet")
    return DepthOfField(
        near=np.where(apart, np.nan, near), far=np.where(apart, np.nan, far), reason="; ".join(dict.fromkeys(reasons))
    )


def as_floats(*values: ArrayLike) -> tuple[FloatArray, ...]:
    """Return the arguments as arrays."""
    return tuple(np.asarray(value, dtype=np.float64) for value in values)


def require(condition: ArrayLike, what: str, value: FloatArray, *, limit: str, remedy: str, unit: str = "m") -> None:
    """Refuse an argument, showing its first value that breaks the condition."""
    holds = np.asarray(condition)
    if not np.all(holds):
        value, holds = np.broadcast_arrays(value, holds)
        raise OutOfRangeError(what, value=f"{value[~holds].flat[0]:g} {unit}".strip(), limit=limit, remedy=remedy)


def diffraction_diameter(wavelength: ArrayLike, working_f_number: ArrayLike, measure: DiffractionMeasure) -> FloatArray:
    """Diameter of the diffraction spot on the sensor: 2.44 λ N_w (first dark ring) or 1.03 λ N_w (half maximum).

    Parameters
    ----------
    wavelength
        λ > 0 [m].
    working_f_number
        N_w = b/A [1], distance from pupil to sensor over the diameter of the pupil: N (1 + m) for a lens focused at
        magnification m, b_L over the aperture for a microlens.
    measure
        ``airy-diameter``, ``fwhm``, or ``none`` for geometric optics (diameter 0).

    Returns
    -------
    Diameter [m], broadcast.

    Raises
    ------
    OutOfRangeError
        For values that are not positive, or for an unknown measure.
    """
    wavelengths, f_numbers = as_floats(wavelength, working_f_number)
    require(wavelengths > 0, "wavelength", wavelengths, limit="> 0 m", remedy="check the unit")
    require(f_numbers > 0, "working f-number", f_numbers, limit="> 0", remedy="give b/A", unit="")
    if measure not in get_args(DiffractionMeasure):
        raise OutOfRangeError(
            "unknown measure of the diffraction spot",
            value=repr(measure),
            limit=" | ".join(get_args(DiffractionMeasure)),
            remedy="use one of these",
        )
    return np.asarray(_DIAMETER_IN_WAVELENGTHS_PER_F_NUMBER[measure] * wavelengths * f_numbers)


@dataclass(frozen=True, kw_only=True)
class BlurAllowance:
    """Geometric blur that a criterion allows in addition to diffraction."""

    geometric_diameter: FloatArray
    """√(c² − d²) [m]; NaN where diffraction alone exceeds the criterion."""
    exceeded: BoolArray
    """Where diffraction alone exceeds the criterion."""
    reason: str
    """Reason if there is no allowance somewhere, with the numbers of the worst case; empty otherwise."""


def blur_allowance(blur_criterion: ArrayLike, diffraction_spot: ArrayLike) -> BlurAllowance:
    """Split a criterion in quadrature: geometric blur² + diffraction spot² ≤ c².

    Parameters
    ----------
    blur_criterion
        c > 0 [m], on the sensor.
    diffraction_spot
        Diameter of the diffraction spot ≥ 0 [m], from `diffraction_diameter`.

    Returns
    -------
    The allowance, broadcast. Where diffraction alone equals the criterion, the allowance is 0: only the plane of focus
    meets it.

    Raises
    ------
    OutOfRangeError
        For a criterion that is not positive, or a spot that is negative.
    """
    criterion, spot = np.broadcast_arrays(*as_floats(blur_criterion, diffraction_spot))
    require(criterion > 0, "blur criterion", criterion, limit="> 0 m", remedy="declare the blur that counts as sharp")
    require(spot >= 0, "diffraction spot", spot, limit="≥ 0 m", remedy="take it from diffraction_diameter")
    exceeded = np.asarray(spot > criterion)
    remaining = np.sqrt(np.where(exceeded, 0.0, (criterion - spot) * (criterion + spot)))
    reason = ""
    if np.any(exceeded):
        worst = np.unravel_index(np.argmax(np.where(exceeded, spot / criterion, 0.0)), spot.shape)
        reason = (
            f"diffraction alone ({spot[worst] * 1e6:.3g} µm) exceeds the blur criterion"
            f" ({criterion[worst] * 1e6:.3g} µm): nothing is sharp; declare a larger blur, open the aperture,"
            " or measure the spot by its full width at half maximum"
        )
    return BlurAllowance(geometric_diameter=np.where(exceeded, np.nan, remaining), exceeded=exceeded, reason=reason)


def hyperfocal_distance(focal_length: ArrayLike, pupil_diameter: ArrayLike, blur_diameter: ArrayLike) -> FloatArray:
    """Nearest focus that keeps infinity sharp: H = f A/c + f = f²/(N c) + f.

    Parameters
    ----------
    focal_length, pupil_diameter
        f and A = f/N, > 0 [m].
    blur_diameter
        c ≥ 0, the geometric blur that counts as sharp, on the sensor [m].

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
    with np.errstate(divide="ignore"):  # without any blur, only a focus at infinity keeps infinity sharp
        return np.asarray(f * (A / c) + f)


def depth_of_field(
    focus_distance: ArrayLike, focal_length: ArrayLike, pupil_diameter: ArrayLike, blur_diameter: ArrayLike
) -> DepthOfField:
    """Near and far limits of the exact thin lens: a − f = (1 ∓ κ) f/(f/(a₀ − f) ± κ) with κ = c/A.

    Parameters
    ----------
    focus_distance
        a₀ > f [m]; ∞ is allowed.
    focal_length, pupil_diameter
        f and A = f/N, > 0 [m].
    blur_diameter
        c ≥ 0, the geometric blur that counts as sharp, on the sensor [m]. NaN, where diffraction has used up the blur,
        gives an empty depth of field.

    Returns
    -------
    The limits [m], broadcast. The far limit is ∞ exactly for a₀ ≥ `hyperfocal_distance`; both limits are a₀ for c = 0.
    If c exceeds the pupil, the near limit lies inside the focal length: that of a virtual image blurred by less than c.

    Notes
    -----
    From the similar triangles behind the lens: a point imaged at b causes the blur A |b₀ − b|/b on a sensor at b₀. The
    relative error is rounding, amplified near the hyperfocal distance by the condition number of the far limit.

    Raises
    ------
    OutOfRangeError
        For a focus inside the focal length, or for lengths that are not positive.
    """
    a0, f, A, c = as_floats(focus_distance, focal_length, pupil_diameter, blur_diameter)
    unlimited = np.where(np.isnan(c), 0.0, c)
    hyperfocal = hyperfocal_distance(f, A, unlimited)
    require(a0 > f, "focus distance", a0, limit="beyond the focal length", remedy="focus farther away")
    ratio = c / A
    shift = f / (a0 - f)  # focus shift of the sensor relative to the focal length
    finite = a0 < hyperfocal
    difference = np.where(finite, np.maximum(shift - ratio, 0.0), 0.0)
    with np.errstate(divide="ignore"):  # a denominator of 0 puts a limit at infinity
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

    The diffraction spot is that on the sensor, at the working f-number b₀/A; it is the same for every distance.

    Parameters
    ----------
    focus_distance, focal_length, pupil_diameter
        As in `depth_of_field` [m].
    blur_criterion
        c > 0, the total blur that counts as sharp, on the sensor [m].
    wavelength
        λ [m].
    measure
        Measure of the diffraction spot: ``airy-diameter``, ``fwhm`` or ``none``.

    Returns
    -------
    The limits [m], broadcast. Where diffraction alone exceeds the criterion there is no depth of field: ``empty`` is
    true and ``reason`` gives both diameters. Unlike the geometric depth of field, this one is not monotone in the
    aperture.

    Raises
    ------
    OutOfRangeError
        As in `depth_of_field`, and for a focus at which the law of the spot does not apply.
    """
    a0, f, A = as_floats(focus_distance, focal_length, pupil_diameter)
    require(a0 > f, "focus distance", a0, limit="beyond the focal length", remedy="focus farther away")
    spot = diffraction_diameter(wavelength, image_distance(a0, f) / A, measure)
    allowance = blur_allowance(blur_criterion, spot)
    limits = depth_of_field(a0, f, A, allowance.geometric_diameter)
    return DepthOfField(near=limits.near, far=limits.far, reason=allowance.reason)


def _require_lens(f: FloatArray, A: FloatArray, c: FloatArray) -> None:
    """Refuse impossible lenses and criteria."""
    require(f > 0, "focal length", f, limit="> 0 m", remedy="check unit and sign")
    require(A > 0, "pupil diameter", A, limit="> 0 m", remedy="check unit and sign")
    require(c >= 0, "blur diameter", c, limit="≥ 0 m", remedy="declare the blur that counts as sharp")


def object_distance_of_magnification(focal_length: ArrayLike, magnification: ArrayLike) -> FloatArray:
    """Distance from object to principal plane: a = f (1 + 1/m).

    A data sheet counts its working distance from the front of the lens, which is not the principal plane. The
    magnification m, pixel pitch over the size of a pixel on the object, gives the distance a reliably.

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
    require(m > 0, "magnification", m, limit="> 0", remedy="give its absolute value", unit="")
    return np.asarray(f * (1 + 1 / m))


def object_distance_of_working_distance(
    working_distance: ArrayLike, *, reference_working_distance: ArrayLike, reference_object_distance: ArrayLike
) -> FloatArray:
    """Distance from object to principal plane for another working distance: a = w + (a_ref − w_ref).

    This assumes that the principal plane keeps its distance from the front of the lens; with internal focusing, it
    holds only near the reference.

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

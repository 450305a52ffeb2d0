"""Depth of field of a single lens with a fixed sensor, and focus stacks."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import BoolArray, FloatArray, as_floats, require
from tradestudy.optics.thin_lens import focus_shift, image_distance, object_distance

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
    require(f > 0, "focal length", f, limit="> 0 m")
    require(A > 0, "pupil diameter", A, limit="> 0 m")
    require(c >= 0, "blur diameter", c, limit="≥ 0 m", remedy="declare the blur that counts as sharp")
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
    # NaN, where diffraction leaves no blur, makes the limits NaN, but `hyperfocal_distance` would refuse it.
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
    require(f > 0, "focal length", f, limit="> 0 m")
    require(m > 0, "magnification", m, limit="> 0", remedy="give its absolute value", unit="")
    return np.asarray(f * (1 + 1 / m))


# Limits closer than this, relative to their distance, count as touching, so that rounding opens no gaps.
TOUCHING: Final = 1e-9


@dataclass(frozen=True, kw_only=True)
class IntervalUnion:
    """Union of intervals of distance; every array has rows (from, to) in order of distance [m]."""

    covered: FloatArray
    """Where at least one is sharp."""
    gaps: FloatArray
    """Between the nearest and the farthest limit, where none is."""
    overlaps: FloatArray
    """Where at least two are."""

    @property
    def complete(self) -> bool:
        """Whether one interval covers everything from the nearest to the farthest limit."""
        return len(self.covered) == 1


def union(slices: DepthOfField) -> IntervalUnion:
    """Join depths of field given as one-dimensional arrays of limits; empty ones add nothing.

    Neighbours whose limits agree to 1e-9 of their distance touch: they leave no gap and no overlap.
    """
    near, far = (limit[~slices.empty.ravel()] for limit in (slices.near.ravel(), slices.far.ravel()))
    covered = _stretches(near, far, depth=1)
    return IntervalUnion(
        covered=covered,
        overlaps=_stretches(near, far, depth=2),
        gaps=np.stack((covered[:-1, 1], covered[1:, 0]), axis=-1).reshape(-1, 2),
    )


def _stretches(near: FloatArray, far: FloatArray, *, depth: int) -> FloatArray:
    """Distance ranges that at least a given number of intervals cover.

    Going outward, a near limit raises the count and a far limit lowers it. Where two limits touch, the near
    one comes first for the union, which leaves no gap, and the far one for overlaps, which leaves no overlap.
    """
    margin = 1 - TOUCHING if depth == 1 else 1 + TOUCHING
    places = np.concatenate((near, far))
    rank = np.concatenate((near * margin, far))
    step = np.concatenate((np.ones(len(near)), -np.ones(len(far))))
    order = np.lexsort((-step if depth == 1 else step, rank))
    count = np.cumsum(step[order])
    enters = (count == depth) & (step[order] > 0)
    leaves = (count == depth - 1) & (step[order] < 0)
    return np.stack((places[order][enters], places[order][leaves]), axis=-1).reshape(-1, 2)


@dataclass(frozen=True, kw_only=True)
class FocusStack:
    """Images of a stack and the range that they cover."""

    focus_distances: FloatArray
    """Where each image is focused [m], nearest first."""
    slices: DepthOfField
    """Depth of field of each image."""
    union: IntervalUnion
    """Covered stretches, gaps and overlaps."""

    @property
    def images(self) -> int:
        """Number of exposures."""
        return len(self.focus_distances)


def focus_stack(
    focus_distances: ArrayLike, *, focal_length: float, pupil_diameter: float, blur_diameter: ArrayLike
) -> FocusStack:
    """Depth of field of a stack focused at given distances.

    Parameters
    ----------
    focus_distances
        Focus distance of each image, > f [m], shape (images,), in any order.
    focal_length, pupil_diameter
        f and A, the same for all images [m].
    blur_diameter
        Geometric blur that counts as sharp, on the sensor [m]: one for all images, or one for each (in their order).

    Returns
    -------
    The stack, nearest focus first, with gaps and overlaps.

    Raises
    ------
    OutOfRangeError
        As in `depth_of_field`.
    """
    focus = np.atleast_1d(np.asarray(focus_distances, dtype=np.float64))
    blur = np.broadcast_to(np.asarray(blur_diameter, dtype=np.float64), focus.shape)
    order = np.argsort(focus)
    slices = depth_of_field(focus[order], focal_length, pupil_diameter, blur[order])
    return FocusStack(focus_distances=focus[order], slices=slices, union=union(slices))


def images_needed(near: float, far: float, *, focal_length: float, pupil_diameter: float, blur_diameter: float) -> int:
    """Smallest number of images whose depths of field cover a range: ⌈ln(b_near/b_far) / ln((1 + κ)/(1 − κ))⌉, κ = c/A.

    An image focused at b₀ is sharp for image distances from b₀/(1 + κ) to b₀/(1 − κ), a fixed ratio, so a
    touching stack is a geometric progression of image distances.

    Parameters
    ----------
    near, far
        Range to cover, f < near ≤ far [m]; far may be ∞.
    focal_length, pupil_diameter
        f and A [m].
    blur_diameter
        c > 0, geometric blur that counts as sharp, on the sensor [m]. With diffraction, the allowance at ``near``,
        where the spot is largest, is safe for all images.

    Returns
    -------
    Number of images, at least 1; one is enough for any range if c ≥ A.

    Raises
    ------
    OutOfRangeError
        For an empty or reversed range, a range that reaches into the focal length, or no blur allowed.
    """
    _require_range(near, far, focal_length, blur_diameter)
    if blur_diameter >= pupil_diameter:
        return 1
    ratio = blur_diameter / pupil_diameter
    images = _image_distance_range(near, far, focal_length) / (2 * math.atanh(ratio))
    return max(1, math.ceil(images * (1 - 1e-12)))  # rounding must not add an image where they just cover the range


def plan_focus_stack(
    near: float,
    far: float,
    *,
    images: int,
    focal_length: float,
    pupil_diameter: float,
    blur_diameter: float,
) -> FocusStack:
    """Spread the focus of a given number of images evenly over a range.

    The range is cut into one stretch for each image, all with the same ratio of image distances. Each image is focused
    so that the middle of its depth of field, in that ratio, is the middle of its stretch. With `images_needed` images
    or more, the range is covered with equal overlaps; with fewer, equal gaps remain and are reported.

    Parameters
    ----------
    near, far
        Range to cover, f < near ≤ far [m]; far may be ∞.
    images
        Number of images to take, ≥ 1 (8 for MAHLI's stacks).
    focal_length, pupil_diameter, blur_diameter
        f, A and c < A [m].

    Returns
    -------
    The stack.

    Raises
    ------
    OutOfRangeError
        For an empty or reversed range, a range that reaches into the focal length, c ≥ A or c ≤ 0, or no images.
    """
    _require_range(near, far, focal_length, blur_diameter)
    if images < 1:
        raise OutOfRangeError(
            "number of images in a focus stack", value=str(images), limit="≥ 1", remedy="take at least one image"
        )
    if blur_diameter >= pupil_diameter:
        raise OutOfRangeError(
            "blur that counts as sharp",
            value=f"{blur_diameter:g} m",
            limit=f"below the pupil diameter, {pupil_diameter:g} m",
            remedy="take a single image: by this criterion, everything is sharp",
        )
    ratio = blur_diameter / pupil_diameter
    total = _image_distance_range(near, far, focal_length)
    middle = (np.arange(images) + 0.5) * (total / images)
    # Image distance relative to that of the near end, minus one, in a form that keeps its digits for far focus.
    fall = np.expm1(-middle + 0.5 * math.log1p(-(ratio**2)))
    near_shift = float(focus_shift(near, focal_length))
    shift = near_shift + (focal_length + near_shift) * fall
    focus = object_distance(np.maximum(shift, 0.0), focal_length)  # a focus beyond infinity counts as infinity
    return focus_stack(focus, focal_length=focal_length, pupil_diameter=pupil_diameter, blur_diameter=blur_diameter)


def _image_distance_range(near: float, far: float, focal_length: float) -> float:
    """ln(b_near/b_far), from the focus shifts so that no digit is lost for distant ranges."""
    s_near, s_far = (float(focus_shift(a, focal_length)) for a in (near, far))
    return math.log1p((s_near - s_far) / (focal_length + s_far))


def _require_range(near: float, far: float, focal_length: float, blur_diameter: float) -> None:
    """Refuse ranges that no stack can cover."""
    if not focal_length < near <= far:
        raise OutOfRangeError(
            "range of a focus stack",
            value=f"{near:g} to {far:g} m",
            limit=f"focal length ({focal_length:g} m) < near ≤ far",
            remedy="order the range and keep it outside the focal length",
        )
    if not blur_diameter > 0:
        raise OutOfRangeError(
            "blur that counts as sharp", value=f"{blur_diameter:g} m", limit="> 0 m", remedy="declare a larger blur"
        )

"""Focus stacks: the range that images at different focus distances cover sharply, and the number of images needed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.depth_of_field.single_lens import DepthOfField, depth_of_field
from tradestudy.optics.thin_lens import focus_shift, object_distance

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

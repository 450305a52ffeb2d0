"""The answer of one camera to one requirement, with its margin and its worst distance."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Final

import numpy as np

from tradestudy.answers.refocusing import largest_blur
from tradestudy.answers.trade_criteria import criterion_of
from tradestudy.cameras.depth_measurement import FieldPosition
from tradestudy.cameras.focus import SharpRange, sharp_range
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.depth_of_field import DepthOfField
from tradestudy.study.prepared import Case
from tradestudy.study.schema.requirements import (
    CriterionPart,
    RefocusablePart,
    RefocusedDepthOfFieldPart,
    SharpPart,
    criterion_dimension,
)
from tradestudy.units import LENGTH, parse, pretty
from tradestudy.wording import counted, listed, range_words


@dataclass(frozen=True, kw_only=True)
class RequirementAnswer:
    """The answer of one camera to one requirement.

    Parameters
    ----------
    camera
        Name of the camera.
    met
        Whether the requirement is met at all distances, including its guard band; None if there is no value.
    value, bound
        The worst value and its bound, in the SI unit of the quantity.
    place
        Distance of the worst value [m].
    field
        Position of the worst value in the picture.
    error
        Estimated error of the worst value.
    margin
        The fraction by which the worst value could worsen and still meet the bound, negative if it misses the bound. If
        the camera is not usable everywhere, the margin is at most minus the unusable share of the distances.
    unusable
        The unusable share of the distances, on a logarithmic scale.
    reason
        The reason, in words.
    limit
        Name of the limit of the usable range that decides the answer; empty if the value does.
    value_margin
        The margin of the worst value, usable or not; None if `margin` is the same.
    end_shift
        The smallest relative shift of ends of usable ranges that changes whether the camera is usable everywhere;
        infinite if no shift does.
    """

    camera: str
    met: bool | None
    value: float
    bound: float
    place: float
    error: float
    margin: float
    unusable: float
    reason: str
    limit: str = ""
    value_margin: float | None = None
    end_shift: float = math.inf
    field: FieldPosition = 0.0

    def could_be_overturned(self, of_value: float, of_ends: float) -> bool:
        """Whether relative changes of this size in the worst value and in the usable ends could reverse the answer."""
        margin = self.margin if self.value_margin is None else self.value_margin
        by_value, by_ends = abs(margin) <= of_value, self.end_shift <= of_ends
        if self.met or self.value_margin is None or self.unusable == 0.0:
            return by_value or (self.met is True and by_ends)
        # Where the usable range has a gap, the gap must close, and the value must meet its bound, or nearly so.
        return by_ends and (by_value or margin > 0.0)

    @property
    def closeness(self) -> float:
        """How nearly it is met: the margin or, if the camera is not usable everywhere, minus what both fall short by.

        These are the shares by which value and usable range fall short; it is less by one more if nothing is usable.
        """
        if self.value_margin is None or not self.unusable > 0.0:
            return self.margin
        return min(self.value_margin, 0.0) - self.unusable - float(self.unusable >= 1.0)

    @property
    def margin_in_errors(self) -> float:
        """Distance of the worst value from its bound in standard errors, negative if it misses; NaN without errors."""
        if not self.error > 0.0 or self.unusable > 0.0 or not math.isfinite(self.value):
            return math.nan
        return math.copysign(abs(self.bound - self.value) / self.error, self.margin)

    @property
    def conformity(self) -> float:
        """Probability that the true worst value meets the bound, for a normal error; NaN without a value."""
        if self.met is None or math.isnan(self.margin):
            return math.nan
        in_errors = self.margin_in_errors
        if not math.isnan(in_errors):
            return NormalDist().cdf(in_errors)
        return float(bool(self.met) if self.margin == 0.0 else self.margin > 0.0)  # exactly at the bound, `met` decides

    @classmethod
    def unknown(cls, camera: str, bound: float, reason: str) -> RequirementAnswer:
        """An undecided answer, for a camera without a value."""
        nan = math.nan
        return cls(
            camera=camera,
            met=None,
            value=nan,
            bound=bound,
            place=nan,
            error=nan,
            margin=nan,
            unusable=nan,
            reason=reason,
        )


_LESS, _MORE = 1.0 - 1e-9, 1.0 + 1e-9  # relative allowance for rounding of distances
_LEAST_MISS: Final = 1e-9  # share of a range: a miss within rounding is still a miss


def check_criterion(required: CriterionPart, case: Case, camera_name: str) -> RequirementAnswer:
    """Check a bound on a criterion of one camera; undecided if the camera has no number for it."""
    dimension = criterion_dimension(required.name, case.attributes.values())
    assert dimension is not None  # in a valid study
    bound, criterion = parse(required.bound, dimension), criterion_of(case, camera_name, required.name)
    if math.isnan(criterion.number):
        return RequirementAnswer.unknown(camera_name, bound, f"{required.name}: {criterion.text}")
    value = criterion.number
    return _bounded(
        camera_name, value, bound, f"{required.name} {pretty(value, dimension)}", above=required.side == "above"
    )


def _bounded(
    camera_name: str, value: float, bound: float, reason: str, *, above: bool, place: float = math.nan
) -> RequirementAnswer:
    """An exact answer from a value, which must stay below its bound, or reach it if ``above``."""
    kept = value >= bound if above else value < bound
    small, large = (bound, value) if above else (value, bound)
    ratio = large / small if small > 0.0 else math.copysign(math.inf, 1.0 if kept else -1.0)
    return _exact(camera_name, kept=kept, value=value, bound=bound, margin=ratio - 1.0, reason=reason, place=place)


def check_refocusable(required: RefocusablePart, case: Case, camera_name: str) -> RequirementAnswer:
    """Check on which distances one camera can refocus, or its number of distinct planes."""
    camera, blur = case.all_cameras[camera_name].refocusing, largest_blur(case)
    if required.planes is not None:
        count = len(camera.planes(blur))
        return _bounded(camera_name, count, required.planes, counted(count, "distinct plane"), above=True)
    near, far = camera.reach(blur)
    limits = DepthOfField(near=np.asarray(near), far=np.asarray(far))
    return _check_range(sharp_range(("refocused",), [limits]), required.distances, camera_name, "refocusable")


def check_refocused_depth(required: RefocusedDepthOfFieldPart, case: Case, camera_name: str) -> RequirementAnswer:
    """Check the depth of field of a picture that is refocused on a distance; undecided where it cannot be."""
    camera, blur = case.all_cameras[camera_name].refocusing, largest_blur(case)
    near, far = camera.reach(blur)
    if not near * _LESS <= required.at <= far * _MORE:
        reach = f"{pretty(near, LENGTH)} to {pretty(far, LENGTH)}"
        where = range_words(required.at, required.at)
        return RequirementAnswer.unknown(camera_name, required.bound, f"cannot refocus {where}, only from {reach}")
    shift = camera.shift(required.at)
    limits = camera.blur_limits(shift, blur) if required.limits == "blur" else camera.ray_limits(shift)
    depth, by = float(limits.extent), "blur" if required.limits == "blur" else "rays"
    reason = f"depth of field by {by} {pretty(depth, LENGTH)} {range_words(required.at, required.at)}"
    return _bounded(camera_name, depth, required.bound, reason, above=required.above is not None, place=required.at)


def check_sharp(required: SharpPart, case: Case, camera_name: str) -> RequirementAnswer:
    """Check a requirement on the sharp range of one camera, all its slices together, by a blur criterion."""
    criterion = required.criterion or next(iter(case.sharp))
    sharp = case.all_cameras[camera_name].focus.sharp_range(case.sharp[criterion])
    if required.above is not None:
        depth = sharp.extent
        reason = f"depth of field {pretty(depth, LENGTH)}" if depth > 0.0 else f"nothing is sharp: {sharp.reason}"
        kept, margin = depth >= required.above, depth / required.above - 1.0
        return _exact(camera_name, kept=kept, value=depth, bound=required.above, margin=margin, reason=reason)
    return _check_range(sharp, required.distances, camera_name, "sharp")


def _check_range(sharp: SharpRange, over: tuple[float, ...], camera_name: str, word: str) -> RequirementAnswer:
    """How far the sharp range extends beyond the required one, at its tighter end, or by how much it falls short."""
    near, far = over
    around = [row for row in sharp.union.covered if row[0] <= near * _MORE and row[1] >= far * _LESS]
    if around:
        first, last = (float(end) for end in around[0])
        beyond = (near / first - 1.0 if first > 0.0 else math.inf, near), (last / far - 1.0, far)
        margin, place = min(beyond)
        reason = f"{word} {range_words(first, last)}"
        # Ends that coincide within rounding count as met.
        margin = max(margin, 0.0)
        return _exact(camera_name, kept=True, value=1.0, bound=1.0, margin=margin, reason=reason, place=place)
    clipped = np.clip(sharp.union.covered, near, far)
    sharp_share = float(np.sum(np.log(clipped[:, 1] / clipped[:, 0])))
    unsharp = 1.0 - (sharp_share / math.log(far / near) if near < far else 0.0)
    gaps = _gaps(sharp.union.covered, near, far)
    place = gaps[0][0]
    why = f": {sharp.reason}" if sharp.extent == 0.0 and sharp.reason else ""
    reason = f"not {word} {listed([range_words(*gap, math.floor, math.ceil) for gap in gaps])}{why}"
    margin = -max(unsharp, _LEAST_MISS)
    miss = _exact(camera_name, kept=False, value=1.0 - unsharp, bound=1.0, margin=margin, reason=reason, place=place)
    return replace(miss, limit="focus") if word == "sharp" else miss


def _gaps(covered: FloatArray, near: float, far: float) -> list[tuple[float, float]]:
    """The ranges of distance [m] in which the scene is not sharp, from near to far; the first if all vanish."""
    ends = [near, *(end for interval in np.clip(covered, near, far).tolist() for end in interval), far]
    gaps = list(zip(ends[::2], ends[1::2], strict=True))
    return [(start, end) for start, end in gaps if end > start * _MORE] or gaps[:1]


def _exact(
    camera_name: str, *, kept: bool, value: float, bound: float, margin: float, reason: str, place: float = math.nan
) -> RequirementAnswer:
    """An answer from closed forms and declared values, exact up to rounding."""
    return RequirementAnswer(
        camera=camera_name,
        met=kept,
        value=value,
        bound=bound,
        place=place,
        error=0.0,
        margin=margin,
        unusable=0.0,
        reason=reason,
    )

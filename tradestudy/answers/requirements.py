"""Check the requirements of a study against its cameras: the worst value over distance, its margin and its place."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby, pairwise
from typing import Final

import numpy as np

from tradestudy.answers.decision import is_usable
from tradestudy.answers.refocusing import cameras_to_refocus
from tradestudy.answers.requirement_answer import (
    RequirementAnswer,
    check_criterion,
    check_refocusable,
    check_refocused_depth,
    check_sharp,
)
from tradestudy.cameras.depth_camera import DepthCamera, UsableCriteria
from tradestudy.cameras.depth_measurement import FieldPosition, place_words, places_within, towards_corners
from tradestudy.depth.evaluation import Reading, distribution, evaluate_depth, imaged
from tradestudy.depth.table import distribution_between, judged_uncertainty_error, narrow_features
from tradestudy.depth.usable import END_OF_STUDY, Interval, evaluate_limits, usable_intervals
from tradestudy.execution import Steps
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.prepared import Case
from tradestudy.study.schema.requirements import (
    BoundOverPart,
    CriterionPart,
    LengthBelowPart,
    MeasuredPart,
    RefocusablePart,
    RefocusedDepthOfFieldPart,
    RequirementPart,
    ShareAbovePart,
    ShareBelowPart,
    SharpPart,
    UsablePart,
)
from tradestudy.units import FRACTION, LENGTH, NUMBER, PIXELS, Dimension, pretty
from tradestudy.wording import fewest_digits, limit_words, listed, range_words

ANY: Final = "any"
ALL: Final = "all"
_POINTS: Final = 101  # over the distances of a requirement, and again around the worst of them
_COARSE: Final = 9
_LESS, _MORE = 1.0 - 1e-9, 1.0 + 1e-9  # relative allowance for rounding of distances
_ABSENT: Final = "the camera has no overlap"
_RESOLUTION: Final = "lateral_resolution"
_BLUR_COUNTED: Final = ("depth_uncertainty", "failed_fraction")  # quantities that follow from the disparity error
_DECLARED: Final[Mapping[str, tuple[str, Dimension]]] = {
    "overlap": ("overlap", FRACTION),
    "total_covering_plane": ("virtual_depth", NUMBER),
    "availability": ("availability", FRACTION),
    "focus": ("blur", PIXELS),
    "last_disparity_step": ("disparity_step", PIXELS),
    "failed_fraction": ("failed_fraction", FRACTION),
    "relative_uncertainty": ("relative_uncertainty", FRACTION),
}
"""Keys of usable_range behind the limits."""
_Key = tuple[RequirementPart, DepthCamera, UsableCriteria, float, tuple[float, ...]]
"""The last are the wavelength [m] and the field positions at which depth is computed."""


def check_requirement(
    requirement: RequirementPart, case: Case, camera_name: str, known: Sequence[Interval] | None = None
) -> RequirementAnswer:
    """Check a requirement against one camera, which must measure depth if the requirement asks for depth.

    The usable intervals of a camera that measures depth are computed over the distances of the study unless they are
    ``known``. Other cameras have no limits.
    """
    match requirement.required:
        case CriterionPart() as criterion:
            return check_criterion(criterion, case, camera_name)
        case SharpPart() as sharp:
            return check_sharp(sharp, case, camera_name)
        case RefocusablePart() as refocusable:
            return check_refocusable(refocusable, case, camera_name)
        case RefocusedDepthOfFieldPart() as refocused:
            return check_refocused_depth(refocused, case, camera_name)
        case UsablePart() as usable:
            return _check_use(usable, _intervals(case, camera_name, usable.distances, known), case, camera_name)
        case measured:
            intervals = _intervals(case, camera_name, measured.distances, known)
            return _check_measured(requirement, measured, case, camera_name, intervals)


def _check_measured(
    requirement: RequirementPart, required: MeasuredPart, case: Case, camera_name: str, intervals: Sequence[Interval]
) -> RequirementAnswer:
    above = isinstance(required, ShareAbovePart)
    bound, dimension = _bound(required)

    def measured(points: FloatArray, field: FieldPosition = 0.0) -> FloatArray:
        return _values(requirement, case, camera_name, points, field) / _scale(required, points)

    def broken_by(points: FloatArray, field: FieldPosition) -> FloatArray:
        """Severity of the values; unknown ones are the worst."""
        values = measured(points, field)
        return np.where(np.isnan(values), np.inf, -values if above else values)

    if requirement.quantity == "overlap" and np.isnan(measured(np.array(required.distances))).all():
        return RequirementAnswer.unknown(camera_name, bound, _ABSENT)
    features = narrow_features(case.cameras[camera_name]) if camera_name in case.cameras else ()
    place, field = _worst_place(broken_by, required.distances, _fields(requirement, case), features)
    at = np.array([place])
    value = float(measured(at, field)[0])
    error = float((_errors(requirement, case, camera_name, at, field) / _scale(required, at))[0])
    unusable, gaps = _unusable(intervals, required.distances)
    # The ratio of bound and value, whichever should be larger, says by which share the value could still worsen.
    small, large = (bound, value) if above else (value, bound)
    margin = (large / small if small > 0.0 else math.inf) - 1.0
    margin = -1.0 if math.isnan(margin) else margin
    kept = value >= bound if above else value < bound
    guard = 0.0 if requirement.guard_band is None else requirement.guard_band.width * error
    superlative = "" if required.at is not None and len(_fields(requirement, case)) == 1 else "worst "
    worst = "no value" if math.isnan(value) else superlative + _distinguished(bound, value, dimension)
    says_place = requirement.varies_over_picture and (field != 0.0 or requirement.field is not None)
    where = f", {place_words(field)}" if says_place else ""
    reason, limit = f"{worst} {range_words(place, place)}{where}", ""
    if requirement.quantity == _RESOLUTION and math.isfinite(value):
        reason += f", by {_coarsest_part(case, camera_name, place)}"
    kept = bool(kept and abs(bound - value) >= guard)
    if unusable > 0.0:
        broken = [_limit_of(intervals, gap, case, camera_name) for gap in gaps]
        derived = requirement.quantity in _BLUR_COUNTED and _derives_its_error(case, camera_name)
        reason = f"{_not_usable(gaps, broken, derived=derived)}; {reason}"
        # The smaller margin decides: that of the usable range or that of the value.
        limit = broken[0] if -unusable <= margin else ""
        reach = "throughout" if required.at is None else "there"
        if kept and (only := _declared_limits_alone(case, camera_name, gaps)):
            reason += f"; meets {pretty(bound, dimension)} {reach}, and only {only} it out"
    return RequirementAnswer(
        camera=camera_name,
        met=kept and unusable == 0.0,
        value=value,
        bound=bound,
        place=place,
        error=error if math.isfinite(error) else math.nan,
        margin=min(margin, -unusable) if unusable > 0.0 else margin,
        unusable=unusable,
        reason=reason,
        limit=limit,
        value_margin=margin,
        end_shift=_shift_to_decide(intervals, required.distances),
        field=field,
    )


@dataclass(frozen=True, kw_only=True)
class _Alone:
    """A requirement, a case with a single camera, and the known usable intervals of that camera."""

    requirement: RequirementPart
    case: Case
    known: Sequence[Interval] | None


def _check_alone(point: _Alone) -> RequirementAnswer:
    (camera_name,) = point.case.cameras
    return check_requirement(point.requirement, point.case, camera_name, point.known)


class Judge:
    """Answers requirements; a camera that several designs share is checked only once.

    Parameters
    ----------
    usable
        The known usable intervals of cameras over the distances of the study.
    """

    def __init__(self, usable: Mapping[tuple[DepthCamera, UsableCriteria], Sequence[Interval]] | None = None) -> None:
        self._usable = usable or {}
        self._known: dict[_Key, RequirementAnswer] = {}

    def check(self, requirements: Iterable[tuple[RequirementPart, Case]], steps: Steps) -> None:
        """Check the requirements of several designs in one step, before their answers are needed."""
        points: dict[_Key, _Alone] = {}
        for requirement, case in requirements:
            for camera_name in _names(requirement, case):
                key = _key(requirement, case, camera_name)
                if key is not None and key not in self._known and key not in points:
                    alone = Case(
                        cameras={camera_name: key[1]},
                        all_cameras={camera_name: key[1]},
                        criteria=case.criteria,
                        distance=case.distance,
                        wavelength=case.wavelength,
                        fields=case.fields,
                    )
                    points[key] = _Alone(requirement=requirement, case=alone, known=self._usable.get(key[1:3]))
        labels = [f"{point.requirement.says}, {next(iter(point.case.cameras))}" for point in points.values()]
        answer = steps.map("requirements", _check_alone, list(points.values()), labels)
        self._known.update(zip(points, answer, strict=True))

    def answer(
        self, requirement: RequirementPart, case: Case
    ) -> tuple[RequirementAnswer, Mapping[str, RequirementAnswer]]:
        """The camera that decides a requirement, and the answers of all cameras that it concerns.

        For ``any``, the best camera decides; for ``all``, the worst. A camera without a value leaves the requirement
        undecided, unless for ``any`` another meets it or for ``all`` another misses it. If none meets it, the closest
        decides: the one whose value and usable range together fall short by the smallest share; a camera that is usable
        nowhere in the required range comes last.
        """
        names = _names(requirement, case)
        answers = {camera_name: self._answer_of(requirement, case, camera_name) for camera_name in names}
        decided = [answer for answer in answers.values() if answer.met is not None]
        silent = [answer for answer in answers.values() if answer.met is None]
        settled = any(answer.met is not (requirement.camera == ALL) for answer in decided)
        if silent and not settled:
            return silent[0], answers
        deciding = min if requirement.camera == ALL else max
        above = isinstance(requirement.required, ShareAbovePart)
        return deciding(decided, key=lambda answer: _rank(answer, above=above)), answers

    def _answer_of(self, requirement: RequirementPart, case: Case, camera_name: str) -> RequirementAnswer:
        key = _key(requirement, case, camera_name)
        if key is None:  # closed forms that depend on more than the camera
            return check_requirement(requirement, case, camera_name)
        if key not in self._known:
            self._known[key] = check_requirement(requirement, case, camera_name, self._usable.get(key[1:3]))
        return replace(self._known[key], camera=camera_name)


def is_kept(requirement: RequirementPart, case: Case) -> bool | None:
    """Whether a requirement is met on a coarse grid of distances, without its guard band; fast enough for draws.

    None where this cannot be decided, as where a camera lacks the attribute that the requirement bounds.
    """
    # One camera that meets an "any", or that misses an "all", settles it.
    settling, is_undecided = requirement.camera != ALL, False
    for camera_name in _names(requirement, case):
        if requirement.needs_usable_range:
            met = _is_kept_by(requirement, case, camera_name, _spaced(requirement.over, _COARSE))
        else:
            met = check_requirement(requirement, case, camera_name).met
        if met is settling:
            return settling
        is_undecided |= met is None
    return None if is_undecided else not settling


def _names(requirement: RequirementPart, case: Case) -> list[str]:
    """The cameras that a requirement concerns."""
    if requirement.camera not in (ANY, ALL):
        return [requirement.camera]
    if requirement.asks_for_refocusing:
        return list(cameras_to_refocus(case))
    return list(case.cameras if requirement.asks_for_depth else case.all_cameras)


def _key(requirement: RequirementPart, case: Case, camera_name: str) -> _Key | None:
    """What an answer depends on; None if it is cheap and depends on more."""
    if not requirement.needs_usable_range or camera_name not in case.cameras:
        return None
    return requirement, case.cameras[camera_name], case.criteria, case.wavelength, case.fields


def _is_kept_by(requirement: RequirementPart, case: Case, camera_name: str, points: FloatArray) -> bool | None:
    required = requirement.required
    if isinstance(required, MeasuredPart):
        bound, _ = _bound(required)
        for field in _fields(requirement, case):
            values = _values(requirement, case, camera_name, points, field, distribution) / _scale(required, points)
            if requirement.quantity == "overlap" and np.isnan(values).all():
                return None
            kept = values >= bound if isinstance(required, ShareAbovePart) else values < bound
            if not kept.all():
                return False
    return camera_name not in case.cameras or bool(is_usable(case, camera_name, points, distribution).all())


def _distinguished(bound: float, value: float, dimension: Dimension) -> str:
    """A value with the digits that distinguish it from its bound."""
    limit = pretty(bound, dimension, 6)
    return pretty(value, dimension, fewest_digits(lambda digits: pretty(value, dimension, digits) != limit))


def _rank(answer: RequirementAnswer, *, above: bool) -> tuple[bool, float, float]:
    """Sort key, larger for better: whether it is met; how nearly; then the value."""
    value = -math.inf if math.isnan(answer.value) else answer.value if above else -answer.value
    closeness = answer.closeness
    return bool(answer.met), -math.inf if math.isnan(closeness) else closeness, value


def _check_use(required: UsablePart, intervals: Sequence[Interval], case: Case, camera_name: str) -> RequirementAnswer:
    """How far the usable range extends beyond the required range, at the end where it extends least."""
    near, far = required.distances
    unusable, gaps = _unusable(intervals, required.distances)
    if unusable == 0.0:
        interval = next(interval for interval in intervals if interval.far >= far * _LESS)
        margins = {interval.near: near / interval.near - 1.0, interval.far: interval.far / far - 1.0}
        place = min(margins, key=lambda end: margins[end])
        margin, words = margins[place], f"usable from {pretty(interval.near, LENGTH)} to {pretty(interval.far, LENGTH)}"
        limit = (interval.near_limit if place == interval.near else interval.far_limit).partition(", ")[0]
        if limit == END_OF_STUDY:
            words, limit = f"{words}, the end of the study's range", ""
    else:
        broken = [_limit_of(intervals, gap, case, camera_name) for gap in gaps]
        place, limit = gaps[0][0], broken[0]
        margin, words = -unusable, _not_usable(gaps, broken, derived=_derives_its_error(case, camera_name))
    return RequirementAnswer(
        camera=camera_name,
        met=unusable == 0.0,
        value=1.0 - unusable,
        bound=1.0,
        place=place,
        error=0.0,
        margin=margin,
        unusable=unusable,
        reason=words,
        limit=limit,
        value_margin=math.inf,
        end_shift=_shift_to_decide(intervals, required.distances),
    )


def _intervals(
    case: Case, camera_name: str, over: tuple[float, ...], known: Sequence[Interval] | None
) -> Sequence[Interval]:
    """Usable intervals of a camera over the distances of the study, extended to those of the requirement if needed."""
    if camera_name not in case.cameras:
        return [Interval(near=over[0], far=over[1], near_limit=END_OF_STUDY, far_limit=END_OF_STUDY)]
    inside = case.distance[0] * _LESS <= over[0] and over[1] <= case.distance[-1] * _MORE
    if known is not None and inside:
        return known
    grid = case.distance if inside else np.union1d(case.distance, _spaced(over, _POINTS))
    return usable_intervals(case.cameras[camera_name], case.criteria, grid)


def _unusable(intervals: Sequence[Interval], over: tuple[float, ...]) -> tuple[float, list[tuple[float, float]]]:
    """Share of a range, on a logarithmic scale, that no interval covers, and the ends of the gaps [m].

    A single distance is covered or not.
    """
    reached, gaps = 0.0, []
    for near, far in (*((interval.near, interval.far) for interval in intervals), (math.inf, math.inf)):
        if _is_gap(reached, near, over):
            gaps.append((max(reached, over[0]), min(near, over[1])))
        reached = max(reached, far)
    if over[0] == over[1]:
        return float(len(gaps)), gaps
    return sum(math.log(end / start) for start, end in gaps) / math.log(over[1] / over[0]), gaps


def _is_gap(last: float, first: float, over: tuple[float, ...]) -> bool:
    """Whether a part of a range lies between the end of one interval and the beginning of the next."""
    near, far = over
    if near == far:  # a single distance is covered by an interval that comes within rounding of it
        return last * _MORE < near and far * _MORE < first
    return min(first, far) > max(last, near) * _MORE


def _spaced(over: tuple[float, ...], count: int) -> FloatArray:
    """Distances [m] evenly spaced over a range on a logarithmic scale, or its only one."""
    return np.geomspace(over[0], over[1], count if over[0] < over[1] else 1)


def _shift_to_decide(intervals: Sequence[Interval], over: tuple[float, ...]) -> float:
    """The smallest relative shift of ends of usable intervals that opens a gap in a range, or closes all its gaps.

    A gap between two intervals closes if its ends meet, or if one of them leaves the range. The ends of the study are
    fixed, and how close an interval is to splitting cannot be seen from its ends.
    """
    near, far = over
    closing = []
    for before, after in pairwise((None, *sorted(intervals, key=lambda interval: interval.near), None)):
        last, first = -math.inf if before is None else before.far, math.inf if after is None else after.near
        if not _is_gap(last, first, over):
            continue
        alone = [far / last - 1.0] * (before is not None) + [1.0 - near / first] * (after is not None)
        # Two ends meet if each shifts by this share of its distance, in opposite directions.
        meeting = [(first - last) / (first + last)] if len(alone) > 1 and near < far else []
        closing.append(min([*alone, *meeting], default=math.inf))
    if closing:
        return max(closing)
    whole = next(interval for interval in intervals if interval.far >= far * _LESS)
    ends = ((near / whole.near - 1.0, whole.near_limit), (1.0 - far / whole.far, whole.far_limit))
    return min((shift for shift, limit in ends if limit != END_OF_STUDY), default=math.inf)


def _limit_of(intervals: Sequence[Interval], gap: tuple[float, float], case: Case, camera_name: str) -> str:
    """The limit at the nearest end of a usable interval; without any interval, the one violated in most of the gap."""
    place = gap[0]
    before = sorted((interval for interval in intervals if interval.far <= place), key=lambda interval: -interval.far)
    after = sorted((interval for interval in intervals if interval.near > place), key=lambda interval: interval.near)
    limits = [*(interval.far_limit for interval in before), *(interval.near_limit for interval in after)]
    causes = [limit for limit in limits if limit != END_OF_STUDY]
    if causes:
        return causes[0].partition(", ")[0]
    evaluated = evaluate_limits(case.cameras[camera_name], case.criteria, np.geomspace(place * _MORE, gap[1], _POINTS))
    broken = {limit_name: int(np.sum(~limit.met)) for limit_name, limit in evaluated.items() if not limit.met.all()}
    return max(broken, key=lambda limit_name: broken[limit_name], default="")


def _not_usable(gaps: Sequence[tuple[float, float]], limits: Sequence[str], *, derived: bool) -> str:
    """Every gap with the limit that the camera violates there; consecutive gaps with the same limit share its words.

    A ``derived`` disparity error grows with blur, so a limit on blur counts it a second time.
    """
    parts = []
    for limit, group in groupby(zip(limits, gaps, strict=True), key=lambda pair: pair[0]):
        why = f": {limit_words(limit)}" if limit else ""
        if limit == "focus" and derived:
            why += ", although its derived disparity error already contains blur"
        parts.append(listed([range_words(*gap, math.floor, math.ceil) for _, gap in group]) + why)
    return f"not usable {'; '.join(parts)}"


def _derives_its_error(case: Case, camera_name: str) -> bool:
    return not isinstance(case.cameras[camera_name].disparity_error_px, float | int)


def _declared_limits_alone(case: Case, camera_name: str, gaps: Sequence[tuple[float, float]]) -> str:
    """The limits of the study that alone rule out a camera in gaps, with their verb.

    Empty where something else prevents the measurement, such as a search range or saturated pixels.
    """
    inside = np.concatenate([np.geomspace(near, far, _POINTS + 2)[1:-1] for near, far in gaps])
    camera = case.cameras[camera_name]
    if not all(limit.met.all() for limit in evaluate_limits(camera, UsableCriteria(), inside).values()):
        return ""
    evaluated = evaluate_limits(camera, case.criteria, inside, _DECLARED)
    broken = {_DECLARED[limit_name]: limit.bound for limit_name, limit in evaluated.items() if not limit.met.all()}
    words = [f"{key}: {pretty(bound, dimension)}" for (key, dimension), bound in broken.items()]
    if not words:
        return ""
    return f"{listed(words)} {'rules' if len(words) == 1 else 'rule'}"


def _fields(requirement: RequirementPart, case: Case) -> tuple[FieldPosition, ...]:
    """The places of the picture at which a requirement is judged."""
    if not requirement.varies_over_picture or requirement.field == 0.0:
        return (0.0,)
    if requirement.field is not None:
        return places_within(requirement.field)
    return (0.0, *(place for share in case.fields for place in towards_corners(share)))


def _worst_place(
    broken_by: Callable[[FloatArray, FieldPosition], FloatArray],
    over: tuple[float, ...],
    fields: Sequence[FieldPosition],
    features: Sequence[float],
) -> tuple[float, FieldPosition]:
    """Where a value is largest: the distance [m] in a range, and the place in the picture.

    Distances where the depth error changes fast (``features``) are tried too. Places of the picture that are worst at
    some of a few distances are searched on a grid of distances, and the worst one of them between the neighbours of its
    largest value.
    """
    if len(fields) > 1:
        coarse = _spaced(over, _COARSE)
        worst_at = np.argmax([broken_by(coarse, field) for field in fields], axis=0)
        fields = [fields[k] for k in dict.fromkeys(worst_at.tolist())]
    points = np.union1d(_spaced(over, _POINTS), [feature for feature in features if over[0] < feature < over[1]])
    severity = np.array([broken_by(points, field) for field in fields])
    place, worst = (int(k) for k in np.unravel_index(np.argmax(severity), severity.shape))
    if points.size == 1:
        return over[0], fields[place]
    around = np.geomspace(points[max(worst - 1, 0)], points[min(worst + 1, points.size - 1)], _POINTS)
    # Rounding must not move a place out of the range.
    around = np.clip(around, over[0], over[1])
    values = broken_by(np.append(around, points[worst]), fields[place])
    return float(np.append(around, points[worst])[int(np.argmax(values))]), fields[place]


def _bound(required: MeasuredPart) -> tuple[float, Dimension]:
    match required:
        case BoundOverPart():
            return required.limit, FRACTION if required.is_relative else LENGTH
        case ShareAbovePart():
            return required.above, FRACTION
        case ShareBelowPart():
            return required.below, FRACTION
        case LengthBelowPart():
            return required.below, LENGTH


def _scale(required: MeasuredPart, points: FloatArray) -> FloatArray:
    """The divisor of a value before it is compared with its bound: the distance if the bound is relative, else 1."""
    return points if isinstance(required, BoundOverPart) and required.is_relative else np.ones(points.shape)


def _overlap(camera: DepthCamera, distance: FloatArray, field: FieldPosition, depth: Reading) -> FloatArray:  # noqa: ARG001 - of whole pictures
    limits = camera.limits(distance, UsableCriteria())
    return limits["overlap"].value if "overlap" in limits else np.full(distance.shape, np.nan)


def _coarsest_part(case: Case, camera_name: str, place: float) -> str:
    """Which part of the lateral resolution is the largest at a distance [m]."""
    resolution = case.all_cameras[camera_name].focus.lateral_resolution(place, case.wavelength)
    return max(("sampling", "blur", "diffraction"), key=lambda part: float(getattr(resolution, part)))


def _values(
    requirement: RequirementPart,
    case: Case,
    camera_name: str,
    points: FloatArray,
    field: FieldPosition,
    depth: Reading = distribution_between,
) -> FloatArray:
    """The required quantity at each distance [m] and one place of the picture, in SI."""
    if requirement.quantity == _RESOLUTION:
        return case.all_cameras[camera_name].focus.lateral_resolution(points, case.wavelength).size
    return _MEASURED[requirement.quantity](case.cameras[camera_name], points, field, depth)


def _errors(
    requirement: RequirementPart, case: Case, camera_name: str, points: FloatArray, field: FieldPosition
) -> FloatArray:
    """The numerical error of the required quantity; closed forms are exact."""
    if requirement.quantity not in _ERRORS:
        return np.zeros(points.shape)
    return _ERRORS[requirement.quantity](case.cameras[camera_name], points, field)


_MEASURED: Final[Mapping[str, Callable[[DepthCamera, FloatArray, FieldPosition, Reading], FloatArray]]] = {
    "depth_uncertainty": lambda camera, at, field, depth: depth(camera, imaged(camera, at), "both", field).judged,
    "overlap": _overlap,
    "failed_fraction": lambda camera, at, field, depth: (
        depth(camera, imaged(camera, at), "both", field).failed_fraction
    ),
}
_ERRORS: Final[Mapping[str, Callable[[DepthCamera, FloatArray, FieldPosition], FloatArray]]] = {
    "depth_uncertainty": lambda camera, at, field: judged_uncertainty_error(camera, at, "both", field),
    "failed_fraction": lambda camera, at, field: evaluate_depth(camera, at, field).failed_fraction_error[-1],
}

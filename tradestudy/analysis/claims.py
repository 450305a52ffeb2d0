"""Answer the claims of a study."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from tradestudy.analysis.decision import is_usable
from tradestudy.analysis.depth_table import judged_uncertainty
from tradestudy.analysis.focus_claims import (
    depth_of_field_ratio,
    depth_of_field_ratio_words,
    depth_of_field_value,
    depth_of_field_words,
)
from tradestudy.analysis.usable import boundaries, evaluate_limits, margin
from tradestudy.execution.steps import mixed
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.study.definition import Case
from tradestudy.study.schema.claims import (
    ClaimPart,
    DepthOfFieldClaim,
    DepthOfFieldRatioClaim,
    ExpectPart,
    LimitDistanceClaim,
    RelativeUncertaintyDistanceClaim,
    ShareBetterClaim,
    UncertaintyRatioClaim,
)
from tradestudy.units import FRACTION, LENGTH, Dimension, parse, pretty
from tradestudy.wording import in_words, listed, with_article

# Enough for a smooth curve over two decades; the ends of ranges are always included.
_POINTS = 401
_NEAREST, _FARTHEST = 1e-3, 1e5
_MOST_NAMED = 2  # readings that a sentence names in words
_UNDECIDED = "cannot be decided from its source"
_FROM = {"noise": "noise alone", "calibration": "calibration errors alone", "both": "noise and calibration errors"}


def readings_of(claim: ClaimPart, names: Sequence[str]) -> tuple[str, ...]:
    """The readings under which a claim is answered, its own first; ``names`` starts with the study as declared."""
    own = claim.reading or names[0]
    return own, *([name for name in names if name != own] if claim.under == "all" else claim.under)


def claims_in_order(claims: Mapping[str, ClaimPart], names: Sequence[str]) -> list[tuple[str, str]]:
    """Claim and reading of every answer, in the order in which they are computed."""
    asked = [(key, name) for key, claim in claims.items() for name in readings_of(claim, names)]
    return [asked[place] for place in mixed(len(asked))]


def claim_quantity(claim: ClaimPart, titles: Mapping[str, str]) -> str:
    """The quantity that answers a claim, in words; `titles` name the cameras."""
    titles = {key: with_article(title) for key, title in titles.items()}
    match claim:
        case LimitDistanceClaim():
            end = "nearest" if claim.end == "near" else "farthest"
            return f"{end} distance at which {titles[claim.camera]} meets the limit “{in_words(claim.limit)}”"
        case UncertaintyRatioClaim():
            span = " to ".join(pretty(end, LENGTH) for end in claim.over)
            ratio = f"ratio of the uncertainty of {titles[claim.camera]} to that of {titles[claim.against]}"
            return f"largest {ratio} from {span}, due to {_FROM[claim.errors]}"
        case ShareBetterClaim():
            span = " to ".join(pretty(end, LENGTH) for end in claim.over)
            other = f"{titles[claim.against]} is either not usable or less certain"
            better = f"{titles[claim.camera]} is usable and {other}"
            return f"fraction of the range from {span}, on a logarithmic scale, where {better}"
        case RelativeUncertaintyDistanceClaim():
            share = pretty(claim.threshold, FRACTION)
            reached = f"reaches {share} of the distance"
            return f"distance where the uncertainty of {titles[claim.camera]} due to {_FROM[claim.errors]} {reached}"
        case DepthOfFieldClaim():
            return depth_of_field_words(claim, titles)
        case DepthOfFieldRatioClaim():
            return depth_of_field_ratio_words(claim, titles)
        case _:
            # Only studies that ask for wave optics load it.
            from tradestudy.analysis.wave_claims import wave_claim_words

            return wave_claim_words(claim)


def claim_value(claim: ClaimPart, case: Case) -> float:
    """The value of a claim's quantity in SI; NaN where there is none."""
    match claim:
        case LimitDistanceClaim():
            return _limit_distance(claim, case)
        case UncertaintyRatioClaim():
            first, second = (
                judged_uncertainty(case.cameras[name], _span(claim.over), claim.errors)
                for name in (claim.camera, claim.against)
            )
            with np.errstate(divide="ignore", invalid="ignore"):  # unbounded intervals are valid
                ratio = first / second
            # Where both are unbounded, neither is larger; where a camera forms no image, nothing can be compared.
            known = ratio[~np.isnan(ratio)]
            return float(known.max()) if known.size else math.nan
        case ShareBetterClaim():
            return _share_better(claim, case)
        case RelativeUncertaintyDistanceClaim():
            return _relative_uncertainty_distance(claim, case)
        case DepthOfFieldClaim():
            return depth_of_field_value(claim, case)
        case DepthOfFieldRatioClaim():
            return depth_of_field_ratio(claim, case)
        case _:
            from tradestudy.analysis.wave_claims import wave_claim_value

            return wave_claim_value(claim, case.fresnel_validity, case.light_spot)


def _limit_distance(claim: LimitDistanceClaim, case: Case) -> float:
    """Where one limit begins to hold (near end) or ceases to hold (far end), going from near to far.

    A limit that holds at the study's first or last distance is traced beyond it, down to 1 mm and out to 100 km or
    ten times the last distance; the result is 0 or infinity if it still holds there.
    """
    camera, near = case.cameras[claim.camera], claim.end == "near"
    if not evaluate_limits(camera, case.criteria, case.distance[:1], (claim.limit,)):
        return math.nan

    def holds(points: FloatArray) -> BoolArray:
        return evaluate_limits(camera, case.criteria, points, (claim.limit,))[claim.limit].met

    first, last = float(case.distance[0]), float(case.distance[-1])
    if near and holds(case.distance[:1])[0]:
        ends = boundaries(holds, np.geomspace(min(_NEAREST, first / 10.0), first, _POINTS))
        return next((end.distance for end in reversed(ends) if end.begins), 0.0)
    if not near and holds(case.distance[-1:])[0]:
        ends = boundaries(holds, np.geomspace(last, max(_FARTHEST, 10.0 * last), _POINTS))
        return next((end.distance for end in ends if not end.begins), math.inf)
    found = [end.distance for end in boundaries(holds, case.distance) if end.begins == near]
    return math.nan if not found else found[0] if near else found[-1]


def _relative_uncertainty_distance(claim: RelativeUncertaintyDistanceClaim, case: Case) -> float:
    """The last distance from which on the relative uncertainty exceeds the threshold.

    If it exceeds it at all distances of the study, or at none, the distance is traced beyond them as in
    `_limit_distance`; the result is 0 or infinity if it still does so there.
    """
    camera, first, last = case.cameras[claim.camera], float(case.distance[0]), float(case.distance[-1])

    def above(points: FloatArray) -> FloatArray:
        difference = judged_uncertainty(camera, points, claim.errors) - claim.threshold * points
        return margin(difference > 0.0, difference)

    def begins(points: FloatArray) -> list[float]:
        return [end.distance for end in boundaries(above, points) if end.begins]

    if found := begins(case.distance):
        return found[-1]
    uncertainty = judged_uncertainty(camera, case.distance, claim.errors)
    if np.isnan(uncertainty).all():
        return math.nan
    if np.any(uncertainty > claim.threshold * case.distance):
        return next(iter(begins(np.geomspace(min(_NEAREST, first / 10.0), first, _POINTS))[::-1]), 0.0)
    return next(iter(begins(np.geomspace(last, max(_FARTHEST, 10.0 * last), _POINTS))), math.inf)


def _share_better(claim: ShareBetterClaim, case: Case) -> float:
    points = _span(claim.over)
    first, second = (
        judged_uncertainty(case.cameras[name], points, claim.errors) for name in (claim.camera, claim.against)
    )
    usable, other = (is_usable(case, name, points) for name in (claim.camera, claim.against))
    better = usable & (~other | (first < second))
    return float(np.mean(better[1:] & better[:-1]))


def _span(over: tuple[float, ...]) -> FloatArray:
    return np.geomspace(over[0], over[1], _POINTS)


def is_met(expect: ExpectPart, value: float, dimension: Dimension) -> bool | None:
    """Whether a value meets an expectation; None if there is no value."""
    if math.isnan(value):
        return None
    if expect.about is not None:
        expected = parse(expect.about, dimension)
        return abs(value - expected) <= (expect.within or 0.0) * abs(expected)
    if expect.above is not None:
        return value > parse(expect.above, dimension)
    return value < parse(expect.below, dimension)


def could_be_overturned(expect: ExpectPart, value: float, dimension: Dimension, tolerance: float) -> bool:
    """Whether a relative change of a value by the tolerance could reverse the verdict on an expectation."""
    answers = {is_met(expect, value * (1.0 + share), dimension) for share in (-tolerance, 0.0, tolerance)}
    return len(answers) > 1


def expectation(expect: ExpectPart) -> str:
    """An expectation in words."""
    if expect.about is not None:
        return f"{expect.about} ± {pretty(expect.within or 0.0, FRACTION)}"
    return f"above {expect.above}" if expect.above is not None else f"below {expect.below}"


def verdict_over_readings(met: Mapping[str, bool | None], says: Mapping[str, str]) -> tuple[str, str]:
    """The verdict of a claim from its answers under each reading, with the reason; `says` puts readings in words.

    A claim whose answer depends on assumptions that its source does not state cannot be decided from the source.
    """
    decided = {name: answer for name, answer in met.items() if answer is not None}
    silent = [name for name, answer in met.items() if answer is None]
    yes = [name for name, answer in decided.items() if answer]
    no = [name for name, answer in decided.items() if not answer]
    without = f"; no value under {_named(silent, len(met), says)}" if silent else ""
    if not decided:
        return _UNDECIDED, "no reading gives a value"
    if not (yes and no):
        tried = _all_of(len(decided), met=bool(yes)) if len(met) > 1 else "no other reading was tried"
        return "met" if yes else "not met", tried + without
    if len(yes) <= len(no):
        reason = f"met under {_named(yes, len(met), says)}; not under {_the_remaining(no, says)}"
    else:
        reason = f"not met under {_named(no, len(met), says)}; met under {_the_remaining(yes, says)}"
    return _UNDECIDED, reason + without


def _all_of(count: int, *, met: bool) -> str:
    """All readings that give a value, or none of them."""
    if count == 1:
        return "under the only reading with a value"
    if count == 2:
        return "under both readings tried" if met else "met under neither reading tried"
    return f"{'under all' if met else 'met under none of the'} {count} readings tried"


def _named(names: Sequence[str], among: int, says: Mapping[str, str]) -> str:
    """Few readings in words; of many, only how many, and whether the study as declared is one of them."""
    if len(names) <= _MOST_NAMED:
        return listed([f"the reading “{says[name]}”" if name in says else "the study as declared" for name in names])
    declared = ", including the study as declared" if any(name not in says for name in names) else ""
    return f"{len(names)} of {among} readings{declared}"


def _the_remaining(names: Sequence[str], says: Mapping[str, str]) -> str:
    """The readings not named before, and whether the study as declared is one of them."""
    declared = any(name not in says for name in names)
    if len(names) == 1:
        return "the study as declared" if declared else "the remaining reading"
    return f"the remaining {len(names)}{' (the study as declared among them)' * declared}"

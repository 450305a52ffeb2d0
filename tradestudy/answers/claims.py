"""/claims: published statements, compared with the results by which they would be true, under every reading."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import TypeVar

import numpy as np
import xarray as xr

from tradestudy.answers.decision import is_usable, readings_say
from tradestudy.cameras.focus import BlurCriterion, SharpRange
from tradestudy.depth.table import judged_uncertainty
from tradestudy.depth.usable import boundaries, evaluate_limits, kept_by, margin
from tradestudy.execution.steps import Progress, mixed
from tradestudy.light_methods import short_title, within_a_sentence
from tradestudy.optics.arrays import FloatArray
from tradestudy.results import dataset
from tradestudy.study.prepared import Case, PreparedStudy
from tradestudy.study.schema.claims import (
    ClaimPart,
    CriterionFNumberClaim,
    DepthOfFieldClaim,
    DepthOfFieldRatioClaim,
    ExpectPart,
    FresnelFNumberClaim,
    ImageDifferenceClaim,
    LimitDistanceClaim,
    LitPixelsClaim,
    PsfErrorClaim,
    RelativeUncertaintyDistanceClaim,
    ShareBetterClaim,
    UncertaintyRatioClaim,
    claim_dimension,
)
from tradestudy.study.schema.wave_optics import FresnelValidityPart, LightSpotPart, MethodName
from tradestudy.study.schema.wave_optics import listed as listed_f_numbers
from tradestudy.units import FRACTION, LENGTH, PIXELS, Dimension, parse, pretty, significant
from tradestudy.wording import in_words, listed, with_article


def depth_of_field_value(claim: DepthOfFieldClaim, case: Case) -> float:
    """Total extent of the sharp intervals of a camera [m]; NaN if diffraction alone exceeds the criterion."""
    criterion = BlurCriterion(blur_px=claim.blur, measure=claim.diffraction, wavelength=case.wavelength)
    sharp = case.all_cameras[claim.camera].focus.sharp_range(criterion)
    return sharp.extent if sharp.extent > 0.0 else math.nan


def depth_of_field_ratio(claim: DepthOfFieldRatioClaim, case: Case) -> float:
    """Ratio of the depths of field of two cameras; NaN if the second has none, or both are infinite."""
    first, second = (_extent(claim, case, camera_name) for camera_name in (claim.camera, claim.against))
    return math.nan if second == 0.0 or first == second == math.inf else first / second


def _extent(claim: DepthOfFieldRatioClaim, case: Case, camera_name: str) -> float:
    focus = case.all_cameras[camera_name].focus
    if claim.resolution is not None:
        sharp = focus.sharp_range_at_resolution(claim.resolution, case.wavelength)
    else:
        assert claim.blur is not None
        sharp = focus.sharp_range(
            BlurCriterion(blur_px=claim.blur, measure=claim.diffraction or "none", wavelength=case.wavelength)
        )
    return sharp.extent if claim.over is None else _extent_within(sharp, claim.over[0], claim.over[1])


def _extent_within(sharp: SharpRange, near: float, far: float) -> float:
    covered = np.clip(sharp.union.covered, near, far)
    return float(np.sum(covered[:, 1] - covered[:, 0]))


def depth_of_field_words(claim: DepthOfFieldClaim, titles: Mapping[str, str]) -> str:
    """The quantity that answers the claim, in words; `titles` name the cameras."""
    return f"depth of field of {titles[claim.camera]}, {_blur_words(claim.blur, claim.diffraction)}"


def depth_of_field_ratio_words(claim: DepthOfFieldRatioClaim, titles: Mapping[str, str]) -> str:
    """The quantity that answers the claim, in words; `titles` name the cameras."""
    text = f"ratio of the depth of field of {titles[claim.camera]} to that of {titles[claim.against]}"
    if claim.over is not None:
        text += f" between {pretty(claim.over[0], LENGTH)} and {pretty(claim.over[1], LENGTH)}"
    if claim.resolution is not None:
        return f"{text}, both resolving {pretty(claim.resolution, LENGTH)} on the object"
    return f"{text}, {_blur_words(claim.blur or 0.0, claim.diffraction or 'none')}"


def _blur_words(blur: float, diffraction: str) -> str:
    how = {
        "fwhm": "with diffraction (width at half maximum)",
        "airy-diameter": "with diffraction (Airy diameter)",
    }.get(diffraction, "by defocus alone")
    return f"for a blur of {pretty(blur, PIXELS)} {how}"


WaveClaim = PsfErrorClaim | FresnelFNumberClaim | CriterionFNumberClaim | ImageDifferenceClaim | LitPixelsClaim
PartT = TypeVar("PartT")
_METRIC_WORDS = {"peak": "peak error", "l1": "L1 error", "largest": "largest error"}
_CRITERION_WORDS = {
    "path-error": "a neglected path",
    "goodman": "Goodman's condition",
    "paper-eq27-first-zero": "the smaller zero of eq. 27",
    "paper-eq27-second-zero": "the larger zero of eq. 27",
}


def wave_claim_value(claim: WaveClaim, fresnel: FresnelValidityPart | None, spot: LightSpotPart | None) -> float:
    """The value of a claim about light; the schema ensures that the part it refers to exists."""
    # Imported here and below, because they load slowly and few studies make claims about light.
    from tradestudy.models.point_spreads import limit_f_number
    from tradestudy.models.spot_images import image_difference, lit_pixels, spot_image

    match claim:
        case PsfErrorClaim():
            return _psf_error(claim, _present(fresnel), claim.f_number)
        case FresnelFNumberClaim():
            part = _present(fresnel)
            return limit_f_number(lambda f: _psf_error(claim, part, f), listed_f_numbers(part.f_numbers), claim.error)
        case CriterionFNumberClaim():
            return _criterion(claim, _present(fresnel))
        case ImageDifferenceClaim() | LitPixelsClaim():
            image, reference = (spot_image(_present(spot), method).pixels for method in (claim.method, claim.reference))
            if isinstance(claim, ImageDifferenceClaim):
                return image_difference(image, reference)
            return lit_pixels(image, claim.above) / lit_pixels(reference, claim.above)


def compared_spots(study: PreparedStudy) -> Iterator[tuple[LightSpotPart, MethodName]]:
    """The light spots, and the methods for their pictures, that claims compare under the readings that they name."""
    claims = study.file.claims
    for key, reading in claims_in_order(claims, ["", *study.readings]):  # "" is the study as declared
        file = study.readings.get(reading, study).file
        claim = file.claims[key]
        if isinstance(claim, ImageDifferenceClaim | LitPixelsClaim):
            yield from ((_present(file.light_spot), method) for method in (claim.method, claim.reference))


def wave_claim_words(claim: WaveClaim) -> str:
    """The quantity that answers a claim about light, in words."""
    match claim:
        case PsfErrorClaim():
            place = f"{_words(claim.element)} at f/{significant(claim.f_number)}"
            return f"{_measure(claim)} of Fresnel's point-spread function for the {place}"
        case FresnelFNumberClaim():
            limit = f"{pretty(claim.error, FRACTION)} (0 if it does at every f-number compared)"
            element = _words(claim.element)
            return f"smallest f-number above which the {_measure(claim)} for the {element} stays below {limit}"
        case CriterionFNumberClaim():
            bound = f" of {significant(claim.path_error)} waves" if claim.path_error is not None else ""
            return f"smallest f-number for the {_words(claim.element)} by {_CRITERION_WORDS[claim.criterion]}{bound}"
        case ImageDifferenceClaim():
            pictures = f"{_title(claim.method)} and by {_title(claim.reference)}"
            return f"summed difference between the pictures by {pictures}, relative to the latter"
        case LitPixelsClaim():
            pictures = f"by {_title(claim.method)}, relative to that by {_title(claim.reference)}"
            return f"number of pixels above {pretty(claim.above, FRACTION)} of the brightest in the picture {pictures}"


def _words(element: str) -> str:
    return element.replace("-", " ")


def _title(method: str) -> str:
    return within_a_sentence(short_title(method))


def _present(part: PartT | None) -> PartT:
    assert part is not None  # the schema ensures it
    return part


def _psf_error(claim: PsfErrorClaim | FresnelFNumberClaim, part: FresnelValidityPart, f_number: float) -> float:
    from tradestudy.models.point_spreads import psf_differences

    differences = psf_differences(
        part.elements[claim.element],
        f_number=f_number,
        field_angle=0.0,
        wavelength=claim.wavelength,
        lens_phases=(claim.lens_phase,),
        windows=(claim.window,),
        tolerance=part.tolerance,
    )
    return float(getattr(differences[claim.lens_phase], claim.metric)[0])


def _criterion(claim: CriterionFNumberClaim, part: FresnelValidityPart) -> float:
    from tradestudy.models.point_spreads import goodman_f_number, paper_zeros, path_error_f_number

    element = part.elements[claim.element]
    match claim.criterion:
        case "path-error":
            return float(path_error_f_number(element, claim.wavelength, np.float64(claim.path_error or 0.0)))
        case "goodman":
            return float(goodman_f_number(element, claim.wavelength))
        case "paper-eq27-first-zero":
            return float(paper_zeros(element, (claim.wavelength,))[0][0, 0])
        case "paper-eq27-second-zero":
            return float(paper_zeros(element, (claim.wavelength,))[0][0, 1])


def _measure(claim: PsfErrorClaim | FresnelFNumberClaim) -> str:
    window = "" if claim.metric == "peak" else f" over {significant(claim.window)} Airy radii"
    return f"{_METRIC_WORDS[claim.metric]}{window} ({claim.lens_phase} lens phase, {pretty(claim.wavelength, LENGTH)})"


# Enough for a smooth curve over two decades; the ends of ranges are always included.
_POINTS = 401
_NEAREST, _FARTHEST = 1e-3, 1e5
_MOST_NAMED = 2  # readings that a sentence names in words
_UNDECIDED = "cannot be decided from its source"
_FROM = {"noise": "noise alone", "calibration": "calibration errors alone", "both": "noise and calibration errors"}


def readings_of(claim: ClaimPart, names: Sequence[str]) -> tuple[str, ...]:
    """The readings under which a claim is answered, its own first; ``names`` starts with the study as declared."""
    own = claim.reading or names[0]
    return own, *([reading for reading in names if reading != own] if claim.under == "all" else claim.under)


def claims_in_order(claims: Mapping[str, ClaimPart], names: Sequence[str]) -> list[tuple[str, str]]:
    """Claim and reading of every answer, in the order in which they are computed."""
    pairs = [(key, reading) for key, claim in claims.items() for reading in readings_of(claim, names)]
    return [pairs[place] for place in mixed(len(pairs))]


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
            return wave_claim_words(claim)


def claim_value(claim: ClaimPart, case: Case) -> float:
    """The value of a claim's quantity in SI; NaN where there is none."""
    match claim:
        case LimitDistanceClaim():
            return _limit_distance(claim, case)
        case UncertaintyRatioClaim():
            first, second = (
                judged_uncertainty(case.cameras[camera_name], _span(claim.over), claim.errors)
                for camera_name in (claim.camera, claim.against)
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
            return wave_claim_value(claim, case.fresnel_validity, case.light_spot)


def _limit_distance(claim: LimitDistanceClaim, case: Case) -> float:
    """Where one limit begins to hold (near end) or ceases to hold (far end), going from near to far.

    A limit that holds at the study's first or last distance is traced beyond it, down to 1 mm and out to 100 km or
    ten times the last distance; the result is 0 or infinity if it still holds there.
    """
    camera, near = case.cameras[claim.camera], claim.end == "near"
    if not evaluate_limits(camera, case.criteria, case.distance[:1], (claim.limit,)):
        return math.nan

    holds = partial(kept_by, camera, case.criteria, names=(claim.limit,))
    first, last = float(case.distance[0]), float(case.distance[-1])
    if near and holds(case.distance[:1])[0] >= 0.0:
        ends = boundaries(holds, np.geomspace(min(_NEAREST, first / 10.0), first, _POINTS))
        return next((end.distance for end in reversed(ends) if end.begins), 0.0)
    if not near and holds(case.distance[-1:])[0] >= 0.0:
        ends = boundaries(holds, np.geomspace(last, max(_FARTHEST, 10.0 * last), _POINTS))
        return next((end.distance for end in ends if not end.begins), math.inf)
    distances = [end.distance for end in boundaries(holds, case.distance) if end.begins == near]
    return math.nan if not distances else distances[0] if near else distances[-1]


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

    if starts := begins(case.distance):
        return starts[-1]
    uncertainty = judged_uncertainty(camera, case.distance, claim.errors)
    if np.isnan(uncertainty).all():
        return math.nan
    if np.any(uncertainty > claim.threshold * case.distance):
        return next(iter(begins(np.geomspace(min(_NEAREST, first / 10.0), first, _POINTS))[::-1]), 0.0)
    return next(iter(begins(np.geomspace(last, max(_FARTHEST, 10.0 * last), _POINTS))), math.inf)


def _share_better(claim: ShareBetterClaim, case: Case) -> float:
    points = _span(claim.over)
    first, second = (
        judged_uncertainty(case.cameras[camera_name], points, claim.errors)
        for camera_name in (claim.camera, claim.against)
    )
    usable, other = (is_usable(case, camera_name, points) for camera_name in (claim.camera, claim.against))
    better = usable & (~other | (first < second))
    # Steps between points, equal on a logarithmic scale, count if it is better at both of their ends.
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
    decided = {reading: answer for reading, answer in met.items() if answer is not None}
    silent = [reading for reading, answer in met.items() if answer is None]
    yes = [reading for reading, answer in decided.items() if answer]
    no = [reading for reading, answer in decided.items() if not answer]
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


def _named(names: Sequence[str], total: int, says: Mapping[str, str]) -> str:
    """Few readings in words; of many, only how many, and whether the study as declared is one of them."""
    if len(names) <= _MOST_NAMED:
        return listed([f"the reading “{says[name]}”" if name in says else "the study as declared" for name in names])
    declared = ", including the study as declared" if any(name not in says for name in names) else ""
    return f"{len(names)} of {total} readings{declared}"


def _the_remaining(names: Sequence[str], says: Mapping[str, str]) -> str:
    """The readings not named before, and whether the study as declared is one of them."""
    declared = any(name not in says for name in names)
    if len(names) == 1:
        return "the study as declared" if declared else "the remaining reading"
    return f"the remaining {len(names)}{' (the study as declared among them)' * declared}"


def claims_group(
    study: PreparedStudy,
    readings: Mapping[str, PreparedStudy],
    progress: Progress = lambda _step, _share: None,
) -> xr.Dataset:
    """/claims: value and answer under each reading that a claim names, with the verdict."""
    claims = study.file.claims
    titles = {name: part.title for name, part in study.file.cameras.items()}
    names = list(readings)
    value = np.full((len(claims), len(names)), np.nan)
    met = np.full(value.shape, -1, dtype=np.int8)
    text, near = np.full(value.shape, "", dtype=object), np.zeros(value.shape)
    tolerance = study.file.accuracy.tolerance
    rows, pairs = list(claims), claims_in_order(claims, names)
    says = {name: reading.says for name, reading in study.file.readings.items()}
    answers: dict[str, dict[str, bool | None]] = {key: {} for key in claims}
    for done, (key, reading) in enumerate(pairs):
        progress("claims", done / (len(pairs) + len(study.file.requirements)))
        row, column, claim, dimension = rows.index(key), names.index(reading), claims[key], claim_dimension(claims[key])
        # A reading may also change what a claim asks, such as the blur that counts as sharp, but never what it expects.
        value[row, column] = claim_value(readings[reading].file.claims[key], readings[reading].case)
        text[row, column] = pretty(value[row, column], dimension)
        answers[key][reading] = is_met(claim.expect, value[row, column], dimension)
        met[row, column] = -1 if answers[key][reading] is None else int(bool(answers[key][reading]))
        near[row, column] = could_be_overturned(claim.expect, value[row, column], dimension, tolerance)
    verdicts = [
        verdict_over_readings({reading: answers[key][reading] for reading in readings_of(claim, names)}, says)
        for key, claim in claims.items()
    ]
    return dataset(
        "claims",
        {
            "value": value,
            "met": met,
            "value_text": text,
            "reading_says": readings_say(study, names),
            "says": [claim.says for claim in claims.values()],
            "source": [claim.source for claim in claims.values()],
            "expected": [expectation(claim.expect) for claim in claims.values()],
            "quantity": [claim_quantity(claim, titles) for claim in claims.values()],
            "tolerance_reason": [claim.tolerance_reason for claim in claims.values()],
            "verdict": [verdict for verdict, _ in verdicts],
            "reason": [reason for _, reason in verdicts],
            "within_tolerance": near,
        },
        {"claim": list(claims), "reading": names},
    )

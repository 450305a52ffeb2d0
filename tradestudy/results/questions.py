"""/decision, /claims, /requirements: the answers to a study's questions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from tradestudy.results.variable import ESTIMATE, EXACT, Variable

DECISION: Final[Mapping[str, Variable]] = {
    "best_camera": Variable(
        dims=("distance", "error_source"),
        units="",
        long_name="usable candidate with the lowest depth uncertainty; several, separated by commas, where their depth "
        "uncertainties are equal within their error; empty where no usable candidate has a finite depth uncertainty",
    ),
    "winner": Variable(
        dims=("reading", "place", "error_source"),
        units="",
        long_name="usable camera of the main pair with the lower depth uncertainty; both, separated by a comma, "
        "where their depth uncertainties are equal within their error; empty where no usable camera has a finite one",
    ),
    "more_certain": Variable(
        dims=("reading", "place", "error_source"),
        units="",
        long_name="camera of the main pair with the lower depth uncertainty, usable or not; empty where both depth "
        "uncertainties are equal within their error or neither is finite",
    ),
    "uncertainty_ratio": Variable(
        dims=("reading", "place", "error_source"),
        units="1",
        long_name="depth uncertainty of the first camera of the main pair, divided by that of the second; infinite "
        "where only the first is infinite or only the second is 0; NaN where both are infinite or both 0, or a camera "
        "does not see the point",
        error="not stored; for the study as declared, it follows from depth_uncertainty_by_error_source_error of "
        "/depth_at_places; for the other readings, no variable indicates its size",
    ),
    "within_tolerance": Variable(
        dims=("reading", "place", "error_source"),
        units="1",
        long_name="whether uncertainty_ratio differs from 1 by no more than accuracy.depth_uncertainty, so that "
        "omitted effects could reverse the order of the two cameras",
    ),
    "flips": Variable(
        dims=("reading", "place", "error_source"),
        units="1",
        long_name="whether 'winner' differs from the winner in the study as declared",
    ),
    "reading_says": Variable(dims=("reading",), units="", long_name="what the reading assumes, in words"),
    "certainty_flips": Variable(
        dims=("reading", "place", "error_source"),
        units="1",
        long_name="whether more_certain differs from its value in the study as declared",
    ),
    "change_distance": Variable(
        dims=("reading", "error_source", "change"),
        units="m",
        long_name="distance at which the usable camera of the main pair with the lower depth uncertainty changes: from "
        "one camera to the other, from none to one, or from one to none; NaN for indices after the last change",
        error="see change_error",
    ),
    "change_error": Variable(
        dims=("reading", "error_source", "change"),
        units="m",
        long_name="standard error of change_distance over scrambles; infinite where a scramble lacks this change, "
        "NaN for indices after the last change",
        error=ESTIMATE,
    ),
    "change_nearer": Variable(
        dims=("reading", "error_source", "change"),
        units="",
        long_name="usable camera of the main pair with the lower depth uncertainty just below change_distance; empty "
        "if none is usable, and for indices after the last change",
    ),
    "change_farther": Variable(
        dims=("reading", "error_source", "change"),
        units="",
        long_name="usable camera of the main pair with the lower depth uncertainty just above change_distance; empty "
        "if none is usable, and for indices after the last change",
    ),
    "crossover_distance": Variable(
        dims=("reading", "error_source", "crossing"),
        units="m",
        long_name="crossover of the main pair: distance at which both cameras have the same depth uncertainty; NaN "
        "for indices after the last crossover",
        error="see crossover_error",
    ),
    "crossover_error": Variable(
        dims=("reading", "error_source", "crossing"),
        units="m",
        long_name="standard error of crossover_distance over scrambles; infinite where a scramble lacks this "
        "crossover, NaN for indices after the last crossover",
        error=ESTIMATE,
    ),
    "crossover_nearer": Variable(
        dims=("reading", "error_source", "crossing"),
        units="",
        long_name="camera with the lower depth uncertainty just below crossover_distance; empty for indices after the "
        "last crossover",
    ),
    "design_best_camera": Variable(
        dims=("design_place",),
        units="",
        long_name="best_camera of each design in a sweep, for the error source 'both', at the distances of "
        "'decision.at'; the depth uncertainties there are interpolated",
    ),
    "design_best_camera_along": Variable(
        dims=("distance",),
        units="",
        long_name="best_camera of each design in a sweep, for the error source 'both', at the distances of /depth",
    ),
    "design_crossover_distance": Variable(
        dims=("design_crossing",),
        units="m",
        long_name="crossover of the main pair in each design, interpolated between the distances of /depth; NaN "
        "for indices after the last crossover",
        error="see design_crossover_error",
    ),
    "design_crossover_error": Variable(
        dims=("design_crossing",),
        units="m",
        long_name="error of design_crossover_distance, from the errors of both depth uncertainties and from "
        "interpolation; NaN for indices after the last crossover",
        error=ESTIMATE,
    ),
    "design_crossover_nearer": Variable(
        dims=("design_crossing",),
        units="",
        long_name="camera with the lower depth uncertainty just below design_crossover_distance; empty for indices "
        "after the last crossover",
    ),
    "cause": Variable(
        dims=("camera",),
        units="",
        long_name="the uncertain input that contributes most to the variance of inverse depth, and its basis; the "
        "contribution is averaged over the usable distances, or over all distances if none is usable; empty where no "
        "input is uncertain",
    ),
    "cause_share": Variable(
        dims=("camera",),
        units="1",
        long_name="fraction of the variance of inverse depth that the input in 'cause' contributes, including its "
        "correlations with others; NaN where no input is uncertain",
        error="not estimated: inverse depth is taken as linear in the errors",
    ),
    "solution_count": Variable(
        dims=("question",),
        units="1",
        long_name="number of solutions in the range from 'low' to 'high' of the question",
        error=EXACT,
    ),
    "solved_value": Variable(
        dims=("question",),
        units="mixed",
        long_name="smallest solution: value of the varied input, in the unit given by solved_units; NaN if there is no "
        "solution",
        error="see solved_error",
    ),
    "solved_error": Variable(
        dims=("question",),
        units="mixed",
        long_name="standard error of solved_value over scrambles, in the same unit; NaN if there is no solution",
        error=ESTIMATE,
    ),
    "solved_units": Variable(
        dims=("question",), units="", long_name="SI unit of solved_value and solved_error; empty for plain numbers"
    ),
    "solved_says": Variable(dims=("question",), units="", long_name="the question in words"),
    "solved_answer": Variable(dims=("question",), units="", long_name="the answer to the question, in words"),
}

CLAIMS: Final[Mapping[str, Variable]] = {
    "value": Variable(
        dims=("claim", "reading"),
        units="mixed",
        long_name="value of the claim's quantity under a reading, in SI units; NaN where the claim is not tested under "
        "this reading, or where the quantity has no value",
        error="not estimated; for the depth uncertainties on which some claims rest, see depth_uncertainty_error of "
        "/depth",
    ),
    "met": Variable(
        dims=("claim", "reading"),
        units="1",
        long_name="1 where 'value' is as expected, 0 where it is not, −1 where 'value' is NaN",
    ),
    "value_text": Variable(dims=("claim", "reading"), units="", long_name="'value' with its unit, as text"),
    "reading_says": Variable(dims=("reading",), units="", long_name="what the reading assumes, in words"),
    "says": Variable(dims=("claim",), units="", long_name="the claim in the words of its source"),
    "source": Variable(dims=("claim",), units="", long_name="where the claim was published"),
    "expected": Variable(dims=("claim",), units="", long_name="value or bound that the claim implies"),
    "quantity": Variable(
        dims=("claim",), units="", long_name="quantity that the claim is about, with the cameras called by their titles"
    ),
    "tolerance_reason": Variable(
        dims=("claim",),
        units="",
        long_name="why the expected value and its tolerance follow from the wording of the source",
    ),
    "verdict": Variable(
        dims=("claim",),
        units="",
        long_name="verdict on the claim over all tested readings: 'met', 'not met' or 'cannot be decided from its "
        "source'",
    ),
    "reason": Variable(
        dims=("claim",),
        units="",
        long_name="reason for the verdict: the readings under which the claim is met, and those under which it is not",
    ),
    "within_tolerance": Variable(
        dims=("claim", "reading"),
        units="1",
        long_name="whether a change of the value by accuracy.tolerance could reverse 'met'",
        error="not estimated: can be wrong only where it takes almost exactly the tolerance to reverse 'met'",
    ),
}

_OF_REQUIREMENT: Final = ("requirement",)
_OF_CAMERA: Final = ("requirement", "camera")
REQUIREMENTS: Final[Mapping[str, Variable]] = {
    "says": Variable(dims=_OF_REQUIREMENT, units="", long_name="the requirement in words"),
    "priority": Variable(
        dims=_OF_REQUIREMENT,
        units="",
        long_name="'must' or 'should'; with '--strict', a run fails unless every 'must' is met",
    ),
    "quantity": Variable(dims=_OF_REQUIREMENT, units="", long_name="quantity that the requirement bounds"),
    "of": Variable(
        dims=_OF_REQUIREMENT,
        units="",
        long_name="camera that must meet the requirement; 'any' if one camera suffices, 'all' if every camera must",
    ),
    "met": Variable(
        dims=_OF_REQUIREMENT,
        units="1",
        long_name="1 if the requirement is met, 0 if it is not, −1 if this cannot be decided",
    ),
    "camera_deciding": Variable(
        dims=_OF_REQUIREMENT,
        units="",
        long_name="camera that decides 'met': the one in 'of', the best if 'of' is 'any', the worst if it is 'all'",
    ),
    "value": Variable(
        dims=_OF_REQUIREMENT,
        units="mixed",
        long_name="worst value of the quantity over the required distances, for camera_deciding, in SI units or, if "
        "bound_is_relative, as a fraction of the distance; for a required usable or sharp range, the fraction of it, "
        "on a logarithmic scale, that the camera covers; NaN where unknown",
        error="see value_error",
    ),
    "value_error": Variable(
        dims=_OF_REQUIREMENT,
        units="mixed",
        long_name="estimated error of 'value', in the same unit as 'value'; NaN where unknown",
        error=ESTIMATE,
    ),
    "bound": Variable(
        dims=_OF_REQUIREMENT,
        units="mixed",
        long_name="bound on the quantity, in the same unit as 'value'",
        error=EXACT,
    ),
    "bound_is_relative": Variable(
        dims=_OF_REQUIREMENT, units="1", long_name="whether 'bound' is a fraction of the distance", error=EXACT
    ),
    "bound_text": Variable(dims=_OF_REQUIREMENT, units="", long_name="the bound in words"),
    "over_near": Variable(
        dims=_OF_REQUIREMENT,
        units="m",
        long_name="nearest of the required distances, equal to over_far for a single one; NaN where the "
        "requirement has none",
        error=EXACT,
    ),
    "over_far": Variable(
        dims=_OF_REQUIREMENT,
        units="m",
        long_name="farthest of the required distances; NaN where the requirement has none",
        error=EXACT,
    ),
    "place": Variable(
        dims=_OF_REQUIREMENT,
        units="m",
        long_name="distance at which 'value' occurs; for a required usable or sharp range, the near end of the first "
        "gap or, without a gap, the end with the smaller margin; NaN where no distance applies",
        error="1e-4, relative",
    ),
    "margin_percent": Variable(
        dims=_OF_REQUIREMENT,
        units="percent",
        long_name="relative margin in percent, negative if the bound is missed; for an upper bound, 100 "
        "('bound'/'value' − 1); for a lower one, 100 ('value'/'bound' − 1); with either bound, at most −100 p if the "
        "camera is unusable over a fraction p of the required distances (on a logarithmic scale); for a required "
        "usable or sharp range that is covered throughout, 100 (q − 1), where q is the smaller of (required near "
        "end)/(near end) and (far end)/(required far end); for one that is not covered throughout, −100 times the "
        "fraction not covered; NaN where the requirement cannot be decided",
        error="follows from value_error",
    ),
    "margin_sigma": Variable(
        dims=_OF_REQUIREMENT,
        units="1",
        long_name="difference between 'value' and 'bound', divided by value_error; negative if the bound is missed; "
        "NaN where 'value' has no error or the camera is unusable over part of the required range",
        error="not estimated: depends on how good value_error is",
    ),
    "conformity": Variable(
        dims=_OF_REQUIREMENT,
        units="1",
        long_name="probability that the true worst value meets the bound if the error of 'value' is normally "
        "distributed; 0 where the camera is unusable over part of the required range; NaN where the requirement "
        "cannot be decided",
        error="not estimated: depends on how good value_error is",
    ),
    "within_tolerance": Variable(
        dims=_OF_REQUIREMENT,
        units="1",
        long_name="whether 'met' could be reversed by changes in 'value', or in the ends of usable ranges, within "
        "their tolerances under 'accuracy'",
        error="not estimated: can be wrong only where it takes almost exactly the tolerance to reverse 'met'",
    ),
    "reason": Variable(
        dims=_OF_REQUIREMENT,
        units="",
        long_name="'value', 'place' and distances at which the camera is not usable, in words",
    ),
    "limited_by": Variable(
        dims=_OF_REQUIREMENT,
        units="",
        long_name="limit of the usable or sharp range that decides 'met', named as in near_limit of /depth; empty "
        "where 'value' decides",
    ),
    "rests_on": Variable(
        dims=_OF_REQUIREMENT,
        units="",
        long_name="what decides 'met', in words: the limit in limited_by or, where errors decide, the uncertain input "
        "that contributes most to the variance of inverse depth at 'place', and its basis",
    ),
    "rests_on_share": Variable(
        dims=_OF_REQUIREMENT,
        units="1",
        long_name="fraction of the variance of inverse depth that the input in rests_on contributes, including its "
        "correlations with others; NaN where no input decides",
        error="not estimated: inverse depth is taken as linear in the errors",
    ),
    "bound_alone_met": Variable(
        dims=_OF_REQUIREMENT,
        units="1",
        long_name="what 'met' would be if matching reached the Cramér–Rao bound; also −1 if the requirement depends on "
        "no declared matcher",
    ),
    "bound_alone_camera": Variable(
        dims=_OF_REQUIREMENT,
        units="",
        long_name="what camera_deciding would be if matching reached the Cramér–Rao bound; empty if the requirement "
        "depends on no declared matcher",
    ),
    "bound_alone_value": Variable(
        dims=_OF_REQUIREMENT,
        units="mixed",
        long_name="what 'value' would be if matching reached the Cramér–Rao bound, in the same unit as 'value'; NaN if "
        "the requirement depends on no declared matcher",
        error="see bound_alone_value_error",
    ),
    "bound_alone_value_error": Variable(
        dims=_OF_REQUIREMENT,
        units="mixed",
        long_name="what value_error would be if matching reached the Cramér–Rao bound, in the same unit as 'value'; "
        "NaN if the requirement depends on no declared matcher",
        error=ESTIMATE,
    ),
    "bound_alone_place": Variable(
        dims=_OF_REQUIREMENT,
        units="m",
        long_name="what 'place' would be if matching reached the Cramér–Rao bound; NaN if the requirement depends on "
        "no declared matcher",
        error="1e-4, relative",
    ),
    "bound_alone_reason": Variable(
        dims=_OF_REQUIREMENT,
        units="",
        long_name="what 'reason' would be if matching reached the Cramér–Rao bound; empty if the requirement depends "
        "on no declared matcher",
    ),
    "camera_met": Variable(
        dims=_OF_CAMERA,
        units="1",
        long_name="1 if this camera meets the requirement, 0 if it does not, −1 if this cannot be decided or the "
        "requirement does not concern it",
    ),
    "camera_margin_percent": Variable(
        dims=_OF_CAMERA,
        units="percent",
        long_name="margin_percent of this camera; NaN where the requirement does not concern it or cannot be decided "
        "for it",
        error="that of the worst value",
    ),
    "camera_reason": Variable(
        dims=_OF_CAMERA, units="", long_name="'reason' for this camera; empty where the requirement does not concern it"
    ),
    "design_met": Variable(
        dims=_OF_REQUIREMENT,
        units="1",
        long_name="'met' in each design of a sweep",
    ),
    "design_camera": Variable(dims=_OF_REQUIREMENT, units="", long_name="camera_deciding in each design of a sweep"),
    "design_margin_percent": Variable(
        dims=_OF_REQUIREMENT,
        units="percent",
        long_name="margin_percent in each design of a sweep; NaN where the requirement cannot be decided",
        error="that of the worst value",
    ),
    "design_margin_sigma": Variable(
        dims=_OF_REQUIREMENT,
        units="1",
        long_name="margin_sigma in each design of a sweep; NaN where 'value' has no error or the camera is unusable "
        "over part of the required range",
    ),
    "design_within_tolerance": Variable(
        dims=_OF_REQUIREMENT, units="1", long_name="within_tolerance in each design of a sweep"
    ),
    "design_reason": Variable(dims=_OF_REQUIREMENT, units="", long_name="'reason' in each design of a sweep"),
    "design_limited_by": Variable(dims=_OF_REQUIREMENT, units="", long_name="limited_by in each design of a sweep"),
    "reading_says": Variable(dims=("reading",), units="", long_name="other reading of the study, in words"),
    "reading_met": Variable(
        dims=("requirement", "reading"), units="1", long_name="'met' under each of the other readings of the study"
    ),
    "reading_camera": Variable(
        dims=("requirement", "reading"), units="", long_name="camera_deciding under each of the other readings"
    ),
    "reading_reason": Variable(
        dims=("requirement", "reading"), units="", long_name="'reason' under each of the other readings"
    ),
    "met_from": Variable(
        dims=("requirement", "stretch"),
        units="mixed",
        long_name="start of a range of the swept parameter in which the same camera meets the requirement throughout, "
        "in SI units; ranges of several cameras may overlap; NaN for indices after the last range",
        error="see met_to_within",
    ),
    "met_to": Variable(
        dims=("requirement", "stretch"),
        units="mixed",
        long_name="end of the range that begins at met_from, in SI units; NaN for indices after the last range",
        error="see met_to_within",
    ),
    "met_to_within": Variable(
        dims=("requirement", "stretch"),
        units="mixed",
        long_name="larger of the errors of met_from and met_to; the error of each end is half the width of the last "
        "interval of a bisection, or 0 if this end is an end of the sweep or the swept parameter takes only whole "
        "numbers; NaN for indices after the last range",
        error=ESTIMATE,
    ),
    "met_camera": Variable(
        dims=("requirement", "stretch"),
        units="",
        long_name="camera that meets the requirement in this range, or 'all' if every camera must; empty for indices "
        "after the last range",
    ),
}

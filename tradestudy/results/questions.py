"""/decision, /claims, /requirements: the answers to a study's questions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from tradestudy.results.variable import SEE_ERROR, Variable

DECISION: Final[Mapping[str, Variable]] = {
    "best_camera": Variable(
        dims=("distance", "error_source"),
        units="",
        long_name="usable candidate with the lowest depth uncertainty, and all whose depth uncertainty exceeds "
        "it by no more than the two errors together; empty where none is usable",
    ),
    "winner": Variable(
        dims=("reading", "place", "error_source"),
        units="",
        long_name="usable camera of the main pair with the lower depth uncertainty; empty where neither is usable",
    ),
    "more_certain": Variable(
        dims=("reading", "place", "error_source"),
        units="",
        long_name="camera of the main pair with the lower depth uncertainty, usable or not",
    ),
    "uncertainty_ratio": Variable(
        dims=("reading", "place", "error_source"),
        units="1",
        long_name="depth uncertainty of the first camera of the main pair relative to that of the second; "
        "infinite where only the first has no far end, NaN where both have none",
        error=f"{SEE_ERROR} of /depth",
    ),
    "within_tolerance": Variable(
        dims=("reading", "place", "error_source"),
        units="1",
        long_name="whether the uncertainties of the main pair differ by no more than the tolerance, so that "
        "omitted effects could reverse their order",
        error="exact",
    ),
    "flips": Variable(
        dims=("reading", "place", "error_source"),
        units="1",
        long_name="whether the winner differs from the winner in the study as declared",
    ),
    "reading_says": Variable(dims=("reading",), units="", long_name="what the reading assumes"),
    "certainty_flips": Variable(
        dims=("reading", "place", "error_source"),
        units="1",
        long_name="whether the more certain camera, usable or not, differs from that in the study as declared",
    ),
    "change_distance": Variable(
        dims=("reading", "error_source", "change"),
        units="m",
        long_name="distance where the winner of the main pair switches; NaN where there is none",
        error="change_error; its range over readings is stored too",
    ),
    "change_error": Variable(
        dims=("reading", "error_source", "change"),
        units="m",
        long_name="standard error over independent scrambles; infinite where not every scramble has the switch, "
        "NaN where there is none",
        error="itself an estimate",
    ),
    "change_nearer": Variable(
        dims=("reading", "error_source", "change"), units="", long_name="winner on the near side of the switch"
    ),
    "change_farther": Variable(
        dims=("reading", "error_source", "change"), units="", long_name="winner on the far side of the switch"
    ),
    "crossover_distance": Variable(
        dims=("reading", "error_source", "crossing"),
        units="m",
        long_name="distance where the cameras of the main pair are equally uncertain; NaN where there is none",
        error="crossover_error; its range over readings is stored too",
    ),
    "crossover_error": Variable(
        dims=("reading", "error_source", "crossing"),
        units="m",
        long_name="standard error over independent scrambles; infinite where not every scramble has the crossover, "
        "NaN where there is none",
        error="itself an estimate",
    ),
    "crossover_nearer": Variable(
        dims=("reading", "error_source", "crossing"),
        units="",
        long_name="more certain camera on the near side of the crossover",
    ),
    "design_best_camera": Variable(
        dims=("design_place",),
        units="",
        long_name="best_camera of each design of a sweep at a few distances, interpolated from the curves of the "
        "design",
    ),
    "design_best_camera_along": Variable(
        dims=("distance",), units="", long_name="best_camera of each design of a sweep over distance"
    ),
    "design_crossover_distance": Variable(
        dims=("design_crossing",),
        units="m",
        long_name="distance where the main pair is equally uncertain in each design, interpolated from the "
        "curves of the design",
        error="design_crossover_error",
    ),
    "design_crossover_error": Variable(
        dims=("design_crossing",),
        units="m",
        long_name="error of the two curves, including their curvature between two distances, divided by the "
        "difference of their slopes",
        error="itself an estimate",
    ),
    "design_crossover_nearer": Variable(
        dims=("design_crossing",),
        units="",
        long_name="more certain camera on the near side of design_crossover_distance",
    ),
    "cause": Variable(
        dims=("camera",),
        units="",
        long_name="uncertain input that contributes most to the variance of depth, averaged over the usable "
        "distances, and its basis",
    ),
    "cause_share": Variable(
        dims=("camera",),
        units="1",
        long_name="share of the variance of depth that the input named in 'cause' contributes, correlations "
        "included; by linear propagation",
        error="that of the linearisation",
    ),
    "solution_count": Variable(
        dims=("question",), units="1", long_name="number of solutions between the declared ends", error="exact"
    ),
    "solved_value": Variable(
        dims=("question",),
        units="mixed",
        long_name="smallest value of the varied input that answers the inverse question, in solved_units",
        error="solved_error",
    ),
    "solved_error": Variable(
        dims=("question",),
        units="mixed",
        long_name="standard error over independent scrambles, in solved_units",
        error="itself an estimate",
    ),
    "solved_units": Variable(dims=("question",), units="", long_name="SI unit of solved_value"),
    "solved_says": Variable(dims=("question",), units="", long_name="the inverse question"),
    "solved_answer": Variable(dims=("question",), units="", long_name="the answer in words"),
}

CLAIMS: Final[Mapping[str, Variable]] = {
    "value": Variable(
        dims=("claim", "reading"),
        units="mixed",
        long_name="value of the claimed quantity under a reading; NaN where the claim is not tested",
        error=f"{SEE_ERROR} of /depth",
    ),
    "met": Variable(
        dims=("claim", "reading"),
        units="1",
        long_name="whether the claim is met under a reading: 1 met, 0 not met, −1 not tested",
    ),
    "value_text": Variable(dims=("claim", "reading"), units="", long_name="value, written with its unit"),
    "reading_says": Variable(dims=("reading",), units="", long_name="what the reading assumes"),
    "says": Variable(dims=("claim",), units="", long_name="the claim in the words of its source"),
    "source": Variable(dims=("claim",), units="", long_name="where the claim is made"),
    "expected": Variable(dims=("claim",), units="", long_name="expected value or bound"),
    "quantity": Variable(
        dims=("claim",), units="", long_name="quantity that decides the claim; cameras are named by their titles"
    ),
    "tolerance_reason": Variable(
        dims=("claim",),
        units="",
        long_name="how the expected result and its tolerance follow from the wording of the source",
    ),
    "verdict": Variable(dims=("claim",), units="", long_name="met, not met, or cannot be decided from the paper"),
    "reason": Variable(dims=("claim",), units="", long_name="reason for the verdict"),
    "within_tolerance": Variable(
        dims=("claim", "reading"),
        units="1",
        long_name="whether a change of the value by the tolerance could overturn the answer",
        error="exact",
    ),
}

_OF_REQUIREMENT: Final = ("requirement",)
_OF_CAMERA: Final = ("requirement", "camera")
REQUIREMENTS: Final[Mapping[str, Variable]] = {
    "says": Variable(dims=_OF_REQUIREMENT, units="", long_name="the requirement"),
    "priority": Variable(
        dims=_OF_REQUIREMENT, units="", long_name="priority of the requirement: must (enforced by --strict) or should"
    ),
    "quantity": Variable(dims=_OF_REQUIREMENT, units="", long_name="quantity that is compared with the bound"),
    "of": Variable(dims=_OF_REQUIREMENT, units="", long_name="camera that the requirement concerns, or any, or all"),
    "met": Variable(
        dims=_OF_REQUIREMENT,
        units="1",
        long_name="whether the requirement is met: 1 met, 0 not met, −1 cannot be decided",
    ),
    "camera_deciding": Variable(
        dims=_OF_REQUIREMENT,
        units="",
        long_name="camera with the largest margin or, for a requirement on all cameras, with the smallest",
    ),
    "value": Variable(
        dims=_OF_REQUIREMENT, units="mixed", long_name="worst value over the distances, in SI", error="value_error"
    ),
    "value_error": Variable(
        dims=_OF_REQUIREMENT, units="mixed", long_name="estimated error of value", error="itself an estimate"
    ),
    "bound": Variable(dims=_OF_REQUIREMENT, units="mixed", long_name="bound on the quantity, in SI", error="exact"),
    "place": Variable(
        dims=_OF_REQUIREMENT, units="m", long_name="distance at which the worst value lies", error="1e-4, relative"
    ),
    "margin_percent": Variable(
        dims=_OF_REQUIREMENT,
        units="percent",
        long_name="fraction by which the worst value could worsen within its bound; negative when missed, and then "
        "at least as large as the fraction of the distances, on a logarithmic scale, where the camera is not usable",
        error="as that of the value",
    ),
    "margin_sigma": Variable(
        dims=_OF_REQUIREMENT,
        units="1",
        long_name="bound minus worst value, divided by the estimated error of that value; NaN where there is none",
        error="as good as that estimate",
    ),
    "conformity": Variable(
        dims=_OF_REQUIREMENT,
        units="1",
        long_name="probability that the true worst value meets the bound, for a normally distributed error",
        error="as good as the estimate of that error",
    ),
    "within_tolerance": Variable(
        dims=_OF_REQUIREMENT,
        units="1",
        long_name="whether a change of the worst value or of usable ranges' ends by the tolerance could overturn the "
        "answer",
        error="exact",
    ),
    "reason": Variable(dims=_OF_REQUIREMENT, units="", long_name="the worst value and where it lies"),
    "limited_by": Variable(
        dims=_OF_REQUIREMENT,
        units="",
        long_name="limit of the usable or sharp range that decides the answer; empty where the value decides",
    ),
    "rests_on": Variable(
        dims=_OF_REQUIREMENT,
        units="",
        long_name="what the answer rests on: the limit that decides, or the uncertain input that contributes "
        "most to the variance at the worst distance, with its basis",
    ),
    "rests_on_share": Variable(
        dims=_OF_REQUIREMENT,
        units="1",
        long_name="share of the variance that the input named in rests_on contributes, correlations included; by "
        "linear propagation; NaN where no input decides",
        error="that of the linearisation",
    ),
    "bound_alone_met": Variable(
        dims=_OF_REQUIREMENT,
        units="1",
        long_name="met if matching were as precise as its bound instead of having the errors of the declared "
        "matcher; −1 where undecided, or where no matcher makes a difference",
    ),
    "bound_alone_camera": Variable(
        dims=_OF_REQUIREMENT,
        units="",
        long_name="camera_deciding at the matching bound; empty where no matcher makes a difference",
    ),
    "bound_alone_value": Variable(
        dims=_OF_REQUIREMENT,
        units="mixed",
        long_name="value at the matching bound, in SI; NaN where no matcher makes a difference",
        error="bound_alone_value_error",
    ),
    "bound_alone_value_error": Variable(
        dims=_OF_REQUIREMENT,
        units="mixed",
        long_name="value_error at the matching bound",
        error="itself an estimate",
    ),
    "bound_alone_place": Variable(
        dims=_OF_REQUIREMENT, units="m", long_name="place at the matching bound", error="1e-4, relative"
    ),
    "bound_alone_reason": Variable(dims=_OF_REQUIREMENT, units="", long_name="reason at the matching bound"),
    "camera_met": Variable(
        dims=_OF_CAMERA,
        units="1",
        long_name="whether this camera meets the requirement: 1 met, 0 not met, −1 cannot be decided or not required",
    ),
    "camera_margin_percent": Variable(
        dims=_OF_CAMERA, units="percent", long_name="margin_percent of this camera", error="as that of its value"
    ),
    "camera_reason": Variable(dims=_OF_CAMERA, units="", long_name="worst value of this camera, and where it lies"),
    "design_met": Variable(
        dims=_OF_REQUIREMENT,
        units="1",
        long_name="whether the requirement is met in this design: 1 met, 0 not met, −1 cannot be decided",
    ),
    "design_camera": Variable(dims=_OF_REQUIREMENT, units="", long_name="camera that decides in this design"),
    "design_margin_percent": Variable(
        dims=_OF_REQUIREMENT, units="percent", long_name="margin_percent in this design", error="as that of the value"
    ),
    "design_margin_sigma": Variable(dims=_OF_REQUIREMENT, units="1", long_name="margin_sigma in this design"),
    "design_within_tolerance": Variable(
        dims=_OF_REQUIREMENT, units="1", long_name="within_tolerance in this design: 1 yes, 0 no"
    ),
    "design_reason": Variable(dims=_OF_REQUIREMENT, units="", long_name="reason in this design"),
    "design_limited_by": Variable(dims=_OF_REQUIREMENT, units="", long_name="limited_by in this design"),
    "met_from": Variable(
        dims=("requirement", "stretch"),
        units="mixed",
        long_name="start of a range of the only swept parameter in which the requirement is met, in the SI unit "
        "of that parameter",
        error="met_to_within",
    ),
    "met_to": Variable(
        dims=("requirement", "stretch"),
        units="mixed",
        long_name="end of the range that begins at met_from",
        error="met_to_within",
    ),
    "met_to_within": Variable(
        dims=("requirement", "stretch"),
        units="mixed",
        long_name="error of met_from and met_to: half the width of the bracket around the root; 0 at an end of "
        "the sweep",
        error="itself an estimate",
    ),
    "met_camera": Variable(
        dims=("requirement", "stretch"),
        units="",
        long_name="cameras that decide in this range, in the order of the increasing parameter",
    ),
}

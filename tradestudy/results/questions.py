"""/decision, /claims, /requirements: what a study asks, answered."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from tradestudy.results.variable import SEE_ERROR, Variable

DECISION: Final[Mapping[str, Variable]] = {
    "best_camera": Variable(
        dims=("distance", "way"),
        units="",
        long_name="candidate of lowest depth uncertainty among the usable, with those that differ by no more than both "
        "may be off by; empty where none is usable",
    ),
    "winner": Variable(
        dims=("reading", "place", "way"),
        units="",
        long_name="of the headline pair, the usable camera of lower depth uncertainty; empty where neither is usable",
    ),
    "more_certain": Variable(
        dims=("reading", "place", "way"),
        units="",
        long_name="of the headline pair, the one of lower depth uncertainty, usable or not",
    ),
    "uncertainty_ratio": Variable(
        dims=("reading", "place", "way"),
        units="1",
        long_name="depth uncertainty of the first camera of the headline pair over that of the second; "
        "infinite where only the first has no far end, NaN where both have none",
        error=SEE_ERROR,
    ),
    "within_tolerance": Variable(
        dims=("reading", "place", "way"),
        units="1",
        long_name="whether the uncertainties of the headline pair differ by no more than the tolerance, so that what "
        "was left out could overturn which is lower",
        error="exact",
    ),
    "flips": Variable(
        dims=("reading", "place", "way"),
        units="1",
        long_name="whether the winner differs from the study's reading",
    ),
    "reading_says": Variable(dims=("reading",), units="", long_name="what the reading assumes"),
    "certainty_flips": Variable(
        dims=("reading", "place", "way"),
        units="1",
        long_name="whether the more certain camera, usable or not, differs from the study's reading",
    ),
    "change_distance": Variable(
        dims=("reading", "way", "change"),
        units="m",
        long_name="distance where the winner of the headline pair changes; NaN where there is none",
        error="change_error; its range over readings stands beside it",
    ),
    "change_error": Variable(
        dims=("reading", "way", "change"),
        units="m",
        long_name="standard error over independent scrambles; infinite where not all have the change, "
        "NaN where there is none",
        error="an estimate of an error",
    ),
    "change_nearer": Variable(dims=("reading", "way", "change"), units="", long_name="winner nearer than the change"),
    "change_farther": Variable(dims=("reading", "way", "change"), units="", long_name="winner farther than the change"),
    "crossover_distance": Variable(
        dims=("reading", "way", "crossing"),
        units="m",
        long_name="distance where the two uncertainties of the headline pair are equal; NaN where there is none",
        error="crossover_error; its range over readings stands beside it",
    ),
    "crossover_error": Variable(
        dims=("reading", "way", "crossing"),
        units="m",
        long_name="standard error over independent scrambles; infinite where not all have the crossing, "
        "NaN where there is none",
        error="an estimate of an error",
    ),
    "crossover_nearer": Variable(
        dims=("reading", "way", "crossing"), units="", long_name="camera that is more certain nearer than the crossing"
    ),
    "solved_value": Variable(
        dims=("question",),
        units="mixed",
        long_name="value of the varied input that makes two cameras equally certain, or one as certain as asked, in "
        "solved_units",
        error="solved_error",
    ),
    "solved_error": Variable(
        dims=("question",),
        units="mixed",
        long_name="standard error over independent scrambles, in solved_units",
        error="an estimate of an error",
    ),
    "solved_units": Variable(dims=("question",), units="", long_name="SI unit of the solved value"),
    "solved_says": Variable(dims=("question",), units="", long_name="the inverse question"),
    "solved_answer": Variable(dims=("question",), units="", long_name="the answer in words"),
}

CLAIMS: Final[Mapping[str, Variable]] = {
    "value": Variable(
        dims=("claim", "reading"),
        units="mixed",
        long_name="value found under a reading; NaN where not tried",
        error=SEE_ERROR,
    ),
    "met": Variable(dims=("claim", "reading"), units="1", long_name="1 met, 0 not met, −1 not tried"),
    "value_text": Variable(dims=("claim", "reading"), units="", long_name="value found, with its unit"),
    "says": Variable(dims=("claim",), units="", long_name="the claim in the words of its source"),
    "source": Variable(dims=("claim",), units="", long_name="where it is made"),
    "expected": Variable(dims=("claim",), units="", long_name="expected value or bound"),
    "quantity": Variable(dims=("claim",), units="", long_name="what is computed to answer it"),
    "tolerance_reason": Variable(
        dims=("claim",), units="", long_name="why the expectation and its tolerance follow from the wording"
    ),
    "verdict": Variable(dims=("claim",), units="", long_name="met, not met, or cannot be decided from the paper"),
    "reason": Variable(dims=("claim",), units="", long_name="the verdict's reason"),
    "within_tolerance": Variable(
        dims=("claim", "reading"),
        units="1",
        long_name="whether a change of the value by as much as the tolerance could overturn the answer",
        error="exact",
    ),
}

REQUIREMENTS: Final[Mapping[str, Variable]] = {
    "says": Variable(dims=("requirement",), units="", long_name="the requirement"),
    "met": Variable(dims=("requirement",), units="1", long_name="whether it is met"),
    "camera": Variable(dims=("requirement",), units="", long_name="camera that comes nearest to it"),
    "margin_percent": Variable(
        dims=("requirement",),
        units="percent",
        long_name="bound over worst value, less one; negative when missed",
        error=SEE_ERROR,
    ),
    "margin_sigma": Variable(
        dims=("requirement",),
        units="1",
        long_name="bound less worst value, over the estimated error of that value; NaN where it has none",
        error="as good as that estimate",
    ),
    "within_tolerance": Variable(
        dims=("requirement",),
        units="1",
        long_name="whether a change of the worst value by as much as the tolerance could overturn the answer",
        error="exact",
    ),
    "reason": Variable(dims=("requirement",), units="", long_name="the worst value and where it lies"),
}

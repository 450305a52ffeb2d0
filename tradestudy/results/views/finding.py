"""What the first figure of a report shows: its cameras, and its finding in one short sentence for the caption."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import xarray as xr

from tradestudy.results.views.conclusions import best_ranges, never_best
from tradestudy.results.views.decision import tied
from tradestudy.results.views.groups import FloatArray, group, has, records, titles_in
from tradestudy.results.views.headline import headline, uncertainty_at_ends
from tradestudy.results.views.requirement_conclusions import requirement_conclusions
from tradestudy.units import LENGTH, pretty, significant
from tradestudy.wording import DECLARED_VALUE, distance, in_words, plain_span, with_article

MOST_CURVES: Final = 3  # in a first figure
MOST_WORDS: Final = 20  # in the first sentence of its caption


def cameras_by_weight(tree: xr.DataTree, group_name: str = "depth") -> list[str]:
    """The cameras of a group in the order in which figures need them.

    First those that decide requirements where they meet them, then the best ones by decreasing range, those that the
    decision compares, those that are nearly as certain as the best, and the others in the order of the study.
    """
    every = titles_in(tree, group_name)
    keys = {title: key for key, title in every.items()}
    best = sorted(best_ranges(tree), key=lambda best_range: best_range.near / best_range.far)
    close = sorted(never_best(tree), key=lambda entry: entry[1])
    titles = [*_meeting(tree), *(title for best_range in best for title in best_range.cameras)]
    attrs = group(tree, "decision").attrs if has(tree, "decision") else {}
    compared = [key for which in ("first", "second", "candidates") for key in tied(attrs.get(which, ""))]
    named = [keys[title] for title in titles if title in keys]
    near = [keys[title] for title, _ in close if title in keys]
    return list(dict.fromkeys([*named, *(key for key in compared if key in every), *near, *every]))


def _meeting(tree: xr.DataTree) -> list[str]:
    """The cameras that meet the requirements that must hold; none if one of these is not met."""
    must = [conclusion for conclusion in requirement_conclusions(tree) if conclusion.priority == "must"]
    return [conclusion.camera for conclusion in must] if all(conclusion.met for conclusion in must) else []


MOST_DETAILED: Final = 8


def detailed_cameras(tree: xr.DataTree, group_name: str) -> dict[str, str]:
    """Titles, by key, of the cameras of which an appendix shows every number: all, or those that figures need most."""
    every = titles_in(tree, group_name)
    if len(every) <= MOST_DETAILED:
        return every
    keys = cameras_by_weight(tree, group_name)[:MOST_DETAILED]
    return {key: title for key, title in every.items() if key in keys}


def short(sentence: str) -> str:
    """The first clauses of a sentence, as many as have at most 20 words together."""
    words = sentence.removesuffix(".")
    # Later clauses are dropped first, and what a colon introduces only if the first clause is still too long.
    for mark in ("; ", ": "):
        while len(words.split()) > MOST_WORDS and mark in words:
            words = words.rpartition(mark)[0]
    return f"{words}." if words else ""


def camera_finding(tree: xr.DataTree) -> str:
    """Which cameras are the most certain, and from which distance to which; of one camera, its depth uncertainty."""
    ranges = best_ranges(tree)
    taken = [best_range for best_range in ranges if best_range.cameras]
    if not ranges:
        return ""
    if not taken:
        return f"No camera is usable from {plain_span(ranges[0].near, ranges[-1].far)}."
    if len(group(tree, "depth")["camera"]) == 1:
        return f"Depth uncertainty: {' to '.join(uncertainty_at_ends(tree, taken))}."
    every = f"Most certain: {'; '.join(best_range.words for best_range in taken)}."
    if len(every.split()) <= MOST_WORDS:
        return every
    if _meeting(tree):  # the headline says which camera meets the requirements, not which is best where
        return headline_finding(tree)
    longest = max(taken, key=lambda best_range: best_range.far / best_range.near)
    return f"Over the longest stretch, {longest.where}, {with_article(longest.cameras[0])} is the most certain."


def headline_finding(tree: xr.DataTree) -> str:
    """The finding of a sweep or a rendered scene: the first clauses of the headline."""
    return short(headline(tree))


def map_finding(tree: xr.DataTree, camera: str) -> str:
    """How much larger the depth uncertainty of a rig is elsewhere in the picture than in its middle."""
    depth_map = group(tree, "depth_map").sel(camera=camera)
    places = [float(place) for place in depth_map["distance"].values]
    most, place = max((float(np.nanmax(ratio_to_middle(depth_map, place), initial=1.0)), place) for place in places)
    return (
        f"Off the middle of the picture, depth uncertainty is up to {significant(most, 2)} times as large, at "
        f"{distance(place)}."
    )


def ratio_to_middle(depth_map: xr.Dataset, place: float) -> FloatArray:
    """The depth uncertainty over the picture at one distance, relative to that in the middle; NaN where unknown."""
    values = np.asarray(depth_map["depth_uncertainty"].sel(distance=place).values, dtype=np.float64)
    with np.errstate(invalid="ignore"):  # unbounded everywhere
        ratio = values / values[values.shape[0] // 2, values.shape[1] // 2]
    return np.where(np.isfinite(ratio), ratio, np.nan)


def goal_questions(tree: xr.DataTree) -> list[dict[str, Any]]:
    """The inverse questions that ask for a depth uncertainty, with the values tried and the uncertainty at each."""
    if not has(tree, "decision", "solved_tried_value"):
        return []
    data = group(tree, "decision")
    return [
        {**row, "values": values[np.isfinite(values)], "uncertainties": uncertainties[np.isfinite(values)]}
        for row, values, uncertainties in zip(
            records(tree, "decision", "question"),
            data["solved_tried_value"].values,
            data["solved_tried_uncertainty"].values,
            strict=True,
        )
        if math.isfinite(row["solved_goal"])
    ]


_OF_ERRORS: Final = {"both": "", "noise": " due to noise", "calibration": " due to calibration"}


def uncertainty_words(question: Mapping[str, Any]) -> str:
    """The quantity that an inverse question gives a value: "depth uncertainty due to calibration at 1 m"."""
    return f"depth uncertainty{_OF_ERRORS[question['solved_errors']]} at {distance(question['solved_place'])}"


def question_finding(question: Mapping[str, Any]) -> str:
    """The value at which a camera reaches the required depth uncertainty, or that none of those tried does."""
    goal, parameter = pretty(question["solved_goal"], LENGTH), in_words(question["solved_path"].rpartition(".")[2])
    if not math.isfinite(question["solved_value"]):
        return f"No {parameter} that was tried gives a {uncertainty_words(question)} of {goal}."
    value = question["solved_answer"].partition(DECLARED_VALUE)[0].partition(";")[0]
    at = f"a {parameter} of {value}" if question["solved_units"] else f"{value} {parameter}"
    return f"At {at}, {uncertainty_words(question)} is {goal}, as required."

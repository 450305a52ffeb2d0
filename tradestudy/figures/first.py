"""The first figure of a report, which follows the question of its study; its caption begins with the finding."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import xarray as xr

from tradestudy.figures.drawing import Drawing
from tradestudy.figures.sweeps import moved_cameras, reference_distance, swept_words
from tradestudy.results.views.depth import swept
from tradestudy.results.views.finding import (
    camera_finding,
    goal_questions,
    headline_finding,
    map_finding,
    question_finding,
)
from tradestudy.results.views.groups import group, has
from tradestudy.results.views.measured import measured_tables
from tradestudy.wording import distance, with_article


def first_of_all(tree: xr.DataTree, drawings: Mapping[str, Drawing]) -> dict[str, Drawing]:
    """The same figures, but first the one that answers the question of the study, its finding before its caption."""
    name, finding = _choice(tree, drawings)
    if not name:
        return dict(drawings)
    first = drawings[name]
    told = replace(first, caption=f"{finding} {first.caption}".strip())
    return {name: told, **{other: drawing for other, drawing in drawings.items() if other != name}}


def _choice(tree: xr.DataTree, drawings: Mapping[str, Drawing]) -> tuple[str, str]:
    """The name of the first figure and its finding; empty where the results have no figure."""
    cameras = [str(key) for key in group(tree, "depth")["camera"].values] if has(tree, "depth") else []
    alone = f"depth-map-{cameras[0]}" if len(cameras) == 1 else ""
    if "depth-of-field" in drawings:
        return "depth-of-field", ""
    if "measured_scene" in drawings:
        return "measured_scene", headline_finding(tree)
    if "goals" in drawings and len(cameras) == 1 and not has(tree, "requirements"):
        return "goals", question_finding(goal_questions(tree)[0])
    if "requirement_margins" in drawings:
        return "requirement_margins", headline_finding(tree)
    if cameras and swept(group(tree, "depth")):
        return ("sweep_map", _sweep_finding(tree)) if "sweep_map" in drawings else ("whole_range", camera_finding(tree))
    measured = next((name for table in measured_tables(tree) if (name := f"measured_{table.name}") in drawings), "")
    if len(cameras) == 1 and measured and not has(tree, "requirements"):
        return measured, headline_finding(tree)
    if alone in drawings:
        return alone, map_finding(tree, cameras[0])
    over_distance = next((name for name in ("deciding_cameras", "whole_range") if name in drawings), "")
    if over_distance:
        return over_distance, camera_finding(tree)
    return next(iter(drawings), ""), ""


def _sweep_finding(tree: xr.DataTree) -> str:
    """The depth uncertainties between which a sweep moves its first camera, at the distance of its map."""
    camera, place = moved_cameras(tree)[0], reference_distance(tree)
    if not (words := swept_words(tree, camera.key)):
        return ""
    title = with_article(camera.title)
    return f"At {distance(place)}, the depth uncertainty of {title} is {words}, depending on the design."

"""The figures of depth of field, with what they show in words."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
import xarray as xr

from tradestudy.figures import depth_of_field
from tradestudy.figures.drawing import Drawing
from tradestudy.results.views.cameras import camera_titles
from tradestudy.results.views.depth_of_field import by_first_criterion, sharp_stretches
from tradestudy.units import LENGTH, PIXELS, pretty


def focus_drawings(tree: xr.DataTree) -> Iterator[Drawing]:
    """The bars and the curves of resolution."""
    yield Drawing(
        name="depth-of-field",
        caption="What each camera keeps sharp, measured from its principal plane: "
        + _criterion_words(tree)
        + ". Neighbouring shades are images of a stack or types of microlenses; dotted lines are gaps between them."
        + _thin_words(tree)
        + " At the right, the coarsest detail that is resolved within the scene; grey where not all of it is sharp.",
        alt="Bars of depth of field over working distance, one row per camera. " + _sharp_words(tree),
        draw=partial(depth_of_field.draw_depth_of_field, tree),
    )
    yield Drawing(
        name="lateral-resolution",
        caption="Detail that each camera resolves on the object: the larger of its lateral sample and its geometric "
        "blur. Bold where the camera is sharp by the first criterion.",
        alt="Log-log chart of resolved detail against distance. " + _resolution_words(tree),
        draw=partial(depth_of_field.draw_lateral_resolution, tree),
    )


def _criterion_words(tree: xr.DataTree) -> str:
    first = by_first_criterion(tree)
    measure = str(first["diffraction"].item())
    beside = "defocus alone" if measure == "none" else f"defocus and the {measure} of diffraction"
    return f"{beside} blurs to at most {pretty(float(first['blur_px']), PIXELS)}"


def _thin_words(tree: xr.DataTree) -> str:
    data = tree["depth_of_field"].to_dataset()
    if "equal_resolution" not in data.attrs:
        return ""
    size = pretty(float(data.attrs["equal_resolution"]), LENGTH)
    return f" Thin lines below: where {size} on the object is resolved, the comparison at equal resolution."


def _sharp_words(tree: xr.DataTree) -> str:
    data = by_first_criterion(tree)
    sentences = []
    for key, title in camera_titles(tree).items():
        found = sharp_stretches(data.sel(camera=key), "sharp")
        where = " and ".join(f"{pretty(a, LENGTH)} to {pretty(b, LENGTH)}" for a, b in found) or "nowhere"
        sentences.append(f"{title}: sharp {where}. ")
    return "".join(sentences)


def _resolution_words(tree: xr.DataTree) -> str:
    data = tree["depth_of_field"].to_dataset()
    middle = (float(data.attrs["scene_near"]) + float(data.attrs["scene_far"])) / 2.0
    there = data["lateral_resolution"].sel(distance=middle, method="nearest")
    place = pretty(float(there["distance"]), LENGTH)
    values = [
        f"{title} {pretty(size, LENGTH)}"
        for key, title in camera_titles(tree).items()
        if np.isfinite(size := float(there.sel(camera=key)))
    ]
    return f"At {place}: " + "; ".join(values) + "."

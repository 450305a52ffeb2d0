"""Which figures a results tree allows, in the order of a report, with what they show in words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from tradestudy.figures import (
    depth_curves,
    focus_gallery,
    fresnel_validity,
    light_spot,
    readings,
    sweeps,
    uncertainty_parts,
)
from tradestudy.figures.calibration_gallery import calibration_drawings
from tradestudy.figures.cost import cost_drawing, measured_quantities
from tradestudy.figures.depth_data import (
    Camera,
    cameras,
    has_winners,
    nominal,
    of_camera,
    swept,
    usable_intervals,
    winners,
)
from tradestudy.figures.drawing import Drawing
from tradestudy.figures.hard_cases import hard_cases_drawing
from tradestudy.units import LENGTH, pretty, significant

if TYPE_CHECKING:
    import xarray as xr

CLOSE_RANGE_ENDS = 1.0  # m: the paper's figure 8 ends and its figure 9 begins here


def drawings(tree: xr.DataTree) -> Mapping[str, Drawing]:
    """Every figure that the groups of `tree` allow, by name, in the order of a report."""
    return {drawing.name: drawing for drawing in _all(tree)}


def _all(tree: xr.DataTree) -> Iterator[Drawing]:
    if "depth_of_field" in tree.children:
        yield from focus_gallery.drawings(tree)
    if "depth" in tree.children:
        yield _whole_range(tree)
        yield from _paper_figures(tree)
        yield _parts(tree)
        if swept(tree["depth"].to_dataset()):
            yield from _sweeps(tree)
    if "decision" in tree.children and "uncertainty_ratio" in tree["decision"]:
        yield _readings(tree)
    yield from calibration_drawings(tree)
    if "fresnel_validity" in tree.children:
        yield from fresnel_validity.drawings(tree)
    yield from light_spot.drawings(tree)
    if "hard_cases" in tree.children:
        yield hard_cases_drawing(tree)
    if "cost" in tree.children and measured_quantities(tree["cost"].to_dataset()):
        yield cost_drawing(tree)


def _whole_range(tree: xr.DataTree) -> Drawing:
    depth, shown = nominal(tree), cameras(tree)
    caption = (
        "Depth uncertainty (half the central 68.27 % interval of one measurement) over the whole range, noise and "
        "calibration together; bold where the camera is usable, thin elsewhere. Grey lines: equal shares of the "
        "distance. Bars: usable distances."
    )
    caption += _design_words(tree)
    if has_winners(tree):
        caption += (
            " The last bar names the usable camera with the smallest uncertainty; dashed lines mark where it changes."
        )
    return Drawing(
        name="whole_range",
        caption=caption,
        alt="Log-log chart of depth uncertainty against distance. "
        + _usable_words(depth, shown)
        + _winner_words(tree, shown),
        draw=partial(depth_curves.whole_range, tree),
    )


def _design_words(tree: xr.DataTree) -> str:
    """Which of the swept designs the curves show; nothing to say without a sweep."""
    depth = nominal(tree)
    names = swept(tree["depth"].to_dataset())
    if not names:
        return ""
    design = ", ".join(f"{name} = {sweeps.shown_value(depth[name], depth[name].item())}" for name in names)
    return f" Of the swept designs the one with {design} is shown."


def _usable_words(depth: xr.Dataset, shown: tuple[Camera, ...]) -> str:
    """Where each camera is usable, in one sentence each."""
    sentences = []
    for camera in shown:
        stretches = [f"{pretty(a, LENGTH)} to {pretty(b, LENGTH)}" for a, b in usable_intervals(depth, camera)]
        sentences.append(f"{camera.title}: usable {' and '.join(stretches) or 'nowhere'}. ")
    return "".join(sentences)


def _winner_words(tree: xr.DataTree, shown: tuple[Camera, ...]) -> str:
    if not has_winners(tree):
        return ""
    titles = {camera.key: camera.title for camera in shown} | {"": "no camera"}
    stretches = [f"{pretty(a, LENGTH)} to {pretty(b, LENGTH)} {titles[key]}" for a, b, key in winners(tree)]
    return "Smallest uncertainty: " + ", ".join(stretches) + "."


def _paper_figures(tree: xr.DataTree) -> Iterator[Drawing]:
    distance = np.asarray(nominal(tree)["distance"].values, dtype=float)
    first, last = float(distance[0]), float(distance[-1])
    if first < CLOSE_RANGE_ENDS:
        end = min(CLOSE_RANGE_ENDS, last)
        yield _discrimination(tree, "close_range", 0.0, end)
    if last > CLOSE_RANGE_ENDS:
        yield _discrimination(tree, "mid_range", max(CLOSE_RANGE_ENDS, first), last)


def _discrimination(tree: xr.DataTree, name: str, near: float, far: float) -> Drawing:
    depth, shown = nominal(tree), cameras(tree)
    span = f"{pretty(near, LENGTH) if near else '0'} to {pretty(far, LENGTH)}"
    return Drawing(
        name=name,
        caption=f"Depth discriminating power and depth uncertainty from {span}. Discrimination is the "
        "change of depth that moves the disparity by its declared step, without noise or calibration errors; "
        "uncertainty has both." + _design_words(tree),
        alt=f"Two charts against distance from {span}, depth on a logarithmic axis: discriminating "
        f"power and uncertainty. Uncertainty at {pretty(far, LENGTH)}: {_values_at(depth, shown, far)}.",
        draw=partial(depth_curves.discrimination_and_uncertainty, tree, near, far),
    )


def _values_at(depth: xr.Dataset, shown: tuple[Camera, ...], distance: float) -> str:
    there = depth.sel(distance=[distance], method="nearest")
    values = [float(of_camera(there, "depth_uncertainty", camera)[0]) for camera in shown]
    return "; ".join(f"{camera.title} {pretty(v, LENGTH)}" for camera, v in zip(shown, values, strict=True))


def _parts(tree: xr.DataTree) -> Drawing:
    silent = ", ".join(name.replace("_", " ") for name in uncertainty_parts.silent_part_names(nominal(tree)))
    return Drawing(
        name="uncertainty_parts",
        caption="What depth uncertainty is made of: each source of error alone, and all together (black). Shaded: "
        "usable distances. Sources that are drawn jointly do not add in quadrature."
        + (f" Not drawn, because it moves no depth here: {silent}." if silent else "")
        + _design_words(tree),
        alt="One log-log chart per camera with a line per source of error. " + _largest_parts(tree),
        draw=partial(uncertainty_parts.uncertainty_parts, tree),
    )


def _largest_parts(tree: xr.DataTree) -> str:
    """The largest part of every camera at the middle of its usable range."""
    depth = nominal(tree)
    sentences = []
    for camera in cameras(tree):
        intervals = usable_intervals(depth, camera)
        if not intervals:
            continue
        near, far = intervals[0]
        middle = float(np.sqrt(near * min(far, float(depth["distance"].values[-1]))))
        part = depth["depth_uncertainty_part"].sel(camera=camera.key).sel(distance=middle, method="nearest")
        values = np.asarray(part.values, dtype=float)
        if np.isfinite(values).any():
            name = str(part["part"].values[int(np.nanargmax(values))]).replace("_", " ")
            sentences.append(f"{camera.title} at {pretty(middle, LENGTH)}: {name} is the largest. ")
    return "".join(sentences)


def _readings(tree: xr.DataTree) -> Drawing:
    decision = tree["decision"].to_dataset()
    ratio = decision["uncertainty_ratio"]
    titles = {camera.key: camera.title for camera in cameras(tree)}
    numerator, denominator = titles[decision.attrs["first"]], titles[decision.attrs["second"]]
    sentences = []
    for place in ratio["place"].values:
        values = np.asarray(ratio.sel(place=place, way="both").values, dtype=float)
        finite = values[np.isfinite(values)]
        if finite.size:
            sentences.append(
                f"At {pretty(float(place), LENGTH)} the ratio runs from {significant(float(finite.min()))} to "
                f"{significant(float(finite.max()))} and is above 1 in {int((finite > 1).sum())} of {finite.size} "
                "readings. "
            )
    return Drawing(
        name="readings",
        caption=f"Which assumption flips the verdict: uncertainty of {numerator} over that of {denominator}, under "
        f"every reading of what the sources leave open. Left of 1 (shaded) {numerator} is better, right of it "
        f"{denominator}.",
        alt="Dot chart of the ratio of uncertainties, one row per reading, one mark per distance, three panels: "
        "noise and calibration, noise only, calibration only. " + "".join(sentences),
        draw=partial(readings.readings, tree),
    )


def _sweeps(tree: xr.DataTree) -> Iterator[Drawing]:
    names = ", ".join(swept(tree["depth"].to_dataset()))
    place = pretty(sweeps.reference_distance(tree), LENGTH)
    moved = sweeps.moved_cameras(tree)
    titles = ", ".join(camera.title for camera in moved)
    if moved:
        yield Drawing(
            name="sweep_map",
            caption=f"Depth uncertainty at {place} over the swept values of {names}.",
            alt=f"Depth uncertainty at {place} against {names}, for {titles}.",
            draw=partial(sweeps.sweep_map, tree),
        )
    yield Drawing(
        name="pareto",
        caption=f"All designs that are usable at {place}: nearest usable distance against depth uncertainty at "
        f"{place}. The line joins the designs that no other beats in both.",
        alt=f"Scatter chart of nearest usable distance against depth uncertainty at {place}, with the frontier of "
        "best designs.",
        draw=partial(sweeps.pareto, tree),
    )

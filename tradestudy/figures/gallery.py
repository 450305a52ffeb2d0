"""The figures that a results tree allows, in the order of a report, with captions and alt texts."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from functools import partial
from typing import Final

import numpy as np
import xarray as xr

from tradestudy.figures import depth_of_field, fresnel_validity, light_spot, sweeps
from tradestudy.figures.calibration import calibration_drawings
from tradestudy.figures.decision import (
    ERROR_SOURCE_TITLES,
    draw_readings,
    margin_drawings,
    rank_drawings,
    worth_drawings,
)
from tradestudy.figures.depth import (
    MOST_BOUNDS,
    crossovers,
    draw_discrimination_and_uncertainty,
    draw_off_axis,
    draw_variance_shares,
    draw_whole_range,
    largest_shares,
    required_uncertainties,
    shown_parts,
)
from tradestudy.figures.drawing import Drawing
from tradestudy.figures.first import first_of_all
from tradestudy.figures.goals import goal_drawings
from tradestudy.figures.measured import measured_drawings
from tradestudy.figures.pictures import (
    depth_loop_drawings,
    depth_map_drawings,
    measured_scene_drawings,
    picture_drawings,
    uncertainty_map_drawings,
)
from tradestudy.figures.program import cost_drawing, hard_cases_drawing
from tradestudy.figures.refocusing import refocusing_drawing
from tradestudy.figures.style import MOST_CAMERAS, CameraTrace, selection_words, traces
from tradestudy.figures.value_tables import reading_tables
from tradestudy.results import JUDGED
from tradestudy.results.views.conclusions import best_ranges
from tradestudy.results.views.decision import candidates, has_winners
from tradestudy.results.views.depth import (
    field_words,
    largest_parts,
    nominal,
    of_camera,
    swept,
    uniform_shares,
    where_measured,
    where_usable,
    worst_corner,
)
from tradestudy.results.views.designs import parameter_words
from tradestudy.results.views.finding import MOST_CURVES
from tradestudy.results.views.groups import camera_titles, has, titles_in
from tradestudy.units import LENGTH, pretty, significant
from tradestudy.wording import counted, distance, in_words, listed, span, with_article, within

CLOSE_RANGE_ENDS = 1.0  # m: where the paper's figure 8 ends and its figure 9 begins
_NEAR_ZERO = 0.1  # of the farthest distance: an axis that would begin nearer begins at the camera


def all_drawings(tree: xr.DataTree) -> Mapping[str, Drawing]:
    """List every figure that the groups of `tree` allow, by name: first the one that answers the study's question."""
    return first_of_all(tree, {drawing.name: drawing for drawing in _all(tree)})


def _all(tree: xr.DataTree) -> Iterator[Drawing]:
    if "depth_of_field" in tree.children:
        yield from depth_of_field.focus_drawings(tree)
    if "depth" in tree.children:
        if len(titles_in(tree, "depth")) > MOST_CURVES:
            yield _over_distance(tree, "deciding_cameras", MOST_CURVES)
        yield _over_distance(tree, "whole_range", MOST_CAMERAS)
        if "claims" in tree.children:  # of a paper, whose figures show both
            yield from _paper_figures(tree)
        if uncertain := tuple(camera for camera in traces(tree) if camera.key not in uniform_shares(tree)):
            yield _shares(tree, uncertain)
        if "depth_field" in tree.children:
            yield _off_axis(tree)
        yield from uncertainty_map_drawings(tree)
        if swept(tree["depth"].to_dataset()):
            yield from margin_drawings(tree)
            yield from _sweeps(tree)
    yield from measured_drawings(tree)
    yield from picture_drawings(tree)
    yield from measured_scene_drawings(tree)
    yield from depth_map_drawings(tree)
    yield from depth_loop_drawings(tree)
    yield from goal_drawings(tree)
    yield from worth_drawings(tree)
    yield from rank_drawings(tree)
    if has(tree, "decision", "uncertainty_ratio") and tree["decision"].sizes["reading"] > 1:
        yield _readings(tree)
    yield from calibration_drawings(tree)
    if "refocusing" in tree.children:
        yield refocusing_drawing(tree)
    if "fresnel_validity" in tree.children:
        yield from fresnel_validity.fresnel_drawings(tree)
    yield from light_spot.light_drawings(tree)
    if "hard_cases" in tree.children:
        yield hard_cases_drawing(tree)
    if "cost" in tree.children and tree["cost"].sizes["entry"]:
        yield cost_drawing(tree)


def _over_distance(tree: xr.DataTree, name: str, most: int) -> Drawing:
    depth, shown, every = nominal(tree), traces(tree, most=most), titles_in(tree, "depth")
    measured = where_measured(depth)
    caption = (
        "Depth uncertainty on the optical axis (half the width of the central 68.27 % interval), bold where the camera "
        "is usable. Bars: usable distances."
    )
    if larger := [camera.title for camera in shown if _is_judged_by_radius(measured, camera.key)]:
        caption += (
            f" Of {listed(larger)}, the error radius is drawn where it is larger than that: requirements and ranks are "
            "judged by the larger of both."
        )
    required = required_uncertainties(tree)
    kinds = {
        "dashed" if requirement.over[0] < requirement.over[1] else "diamonds" for requirement in required[:MOST_BOUNDS]
    }
    if kinds:
        caption += f" Black, {' or '.join(sorted(kinds))}: largest uncertainty that a requirement allows"
        caption += "." if len(required) <= MOST_BOUNDS else f", for the two tightest of {len(required)}."
    caption += _selection_words(tree) if most > MOST_CURVES else sweeps.design_sentence(tree, depth)
    if most < len(every) and most == MOST_CURVES:
        left = counted(len(every) - most, "other camera")
        caption += f" {left}: figure in section “Where each camera is usable”."
    alt = "Log-log chart of depth uncertainty against distance. " + _usable_words(depth, shown)
    if has_winners(tree) and len(shown) > 1:
        among = [title for key, title in camera_titles(tree).items() if key in candidates(tree)]
        caption += (
            f" Last bar: the usable {f'one of the candidates {listed(among)}' if among else 'camera'} with the "
            "smallest uncertainty, or several whose uncertainties differ by less than the numerical error."
        )
        if crossovers(tree):
            caption += " Dotted: where this changes."
        best = "; ".join(stretch.words for stretch in best_ranges(tree))
        alt += f"Smallest uncertainty{' of the candidates' * bool(among)}: {best}."
    return Drawing(
        name=name,
        caption=caption,
        alt=alt,
        draw=partial(draw_whole_range, tree, most),
    )


def _is_judged_by_radius(measured: xr.Dataset, camera: str) -> bool:
    """Whether the error radius of a camera visibly exceeds its depth uncertainty anywhere."""
    half_width, radius = (of_camera(measured, variable, camera) for variable in JUDGED)
    return bool(np.any(radius > 1.01 * half_width))


def _selection_words(tree: xr.DataTree) -> str:
    """Say which of the swept designs the curves show, and which cameras; empty if all."""
    return sweeps.design_sentence(tree, nominal(tree)) + selection_words(tree)


def _usable_words(depth: xr.Dataset, shown: tuple[CameraTrace, ...]) -> str:
    """Say where each camera is usable, in one sentence per camera."""
    where = [
        " and ".join(f"from {span(*within(a, b))}" for a, b in where_usable(depth, camera.key)) for camera in shown
    ]
    return "".join(
        f"{camera.title}: usable {places or 'nowhere'}. " for camera, places in zip(shown, where, strict=True)
    )


def _paper_figures(tree: xr.DataTree) -> Iterator[Drawing]:
    every = np.asarray(nominal(tree)["distance"].values, dtype=float)
    first, last = float(every[0]), float(every[-1])
    if first < CLOSE_RANGE_ENDS:
        end = min(CLOSE_RANGE_ENDS, last)
        yield _discrimination(tree, "close_range", first if first > _NEAR_ZERO * end else 0.0, end)
    if last > CLOSE_RANGE_ENDS:
        yield _discrimination(tree, "mid_range", max(CLOSE_RANGE_ENDS, first), last)


def _discrimination(tree: xr.DataTree, name: str, near: float, far: float) -> Drawing:
    shown = traces(tree)
    where = span(near, far)
    return Drawing(
        name=name,
        caption=f"Depth discrimination and depth uncertainty from {where}. Discrimination: the change of depth that "
        "moves the disparity by its declared step, without noise or calibration errors; the band extends from the "
        "change for a nearer point to that for a farther one. Uncertainty: from noise and calibration errors."
        + _selection_words(tree),
        alt=f"Two charts against distance from {where}, depth on a logarithmic axis: discrimination and uncertainty. "
        f"Uncertainty {_values_at(tree, shown, far)}.",
        draw=partial(draw_discrimination_and_uncertainty, tree, near, far),
    )


def _values_at(tree: xr.DataTree, shown: tuple[CameraTrace, ...], place: float) -> str:
    """The uncertainty of each camera at a declared distance, or at the nearest computed one, which is named."""
    depth = nominal(tree)
    if "depth_at_places" in tree.children:
        declared = tree["depth_at_places"].to_dataset()
        depth = declared if place in declared["distance"].values else depth
    here = depth.sel(distance=[place], method="nearest")
    values = [float(of_camera(here, "depth_uncertainty", camera.key)[0]) for camera in shown]
    each = "; ".join(f"{camera.title} {pretty(v, LENGTH)}" for camera, v in zip(shown, values, strict=True))
    return f"at {distance(float(here['distance'].item()))}: {each}"


_ERRORS: Final = {"array": "microlens positions"}


def _shares(tree: xr.DataTree, cameras: tuple[CameraTrace, ...]) -> Drawing:
    depth = nominal(tree).sel(camera=[camera.key for camera in cameras])
    every, shown = largest_shares(depth), shown_parts(depth)
    silent = listed(
        [_ERRORS.get(part, in_words(part)) for part, most in every.items() if most >= 0.0 and part not in shown]
    )
    is_known = depth["variance_share"].notnull().all("part")
    pale = "; pale: the camera is not usable" * bool((is_known & ~depth["usable"].astype(bool)).any())
    blank = "; blank: the camera measures no depth" * bool((~is_known).any())
    return Drawing(
        name="variance_shares",
        caption="Share of each error source in the variance of inverse depth, against distance (Shapley shares: "
        "variance due to correlated errors is divided fairly among them, so that the shares sum to 100 %). Grey: "
        f"matching noise, which averaging reduces; coloured: error sources that averaging does not reduce{pale}{blank}."
        + (f" Not drawn, since never above 0.5 %: {silent}." if silent else "")
        + _selection_words(tree),
        alt="One chart per camera of stacked shares against distance. "
        f"Largest shares: {_largest_shares(tree, cameras)}",
        draw=partial(draw_variance_shares, tree, cameras),
    )


def _largest_shares(tree: xr.DataTree, cameras: tuple[CameraTrace, ...]) -> str:
    """Name, for every camera, the part with the largest share of the variance, and where that changes."""
    depth = nominal(tree)
    distances = np.asarray(depth["distance"].values, dtype=np.float64).tolist()
    sentences = []
    largest = dict(zip(map(str, depth["camera"].values), largest_parts(depth)[0][0], strict=True))
    for camera in cameras:
        places = zip(distances, largest[camera.key], strict=True)
        groups = itertools.groupby(places, key=lambda place: place[1])
        stretches = [(next(group)[0], part) for part, group in groups if part is not None]
        if stretches:
            words = [f"{in_words(part)} from {distance(start)} on" for start, part in stretches]
            sentences.append(f"{camera.title}: {', '.join(words)}. ")
    return "".join(sentences)


def _off_axis(tree: xr.DataTree) -> Drawing:
    off = tree["depth_field"].to_dataset()
    fields = listed([field_words(float(field)) for field in off["field"].values])
    last = off.isel(field=-1)
    largest = worst_corner(last)
    sentences = []
    for camera in traces(tree):
        off_axis = np.asarray(largest.sel(camera=camera.key).values, dtype=np.float64)
        axis = of_camera(nominal(tree), "depth_uncertainty", camera.key)
        ratio = off_axis[np.isfinite(off_axis)] / axis[np.isfinite(off_axis)]
        finite = ratio[np.isfinite(ratio)]
        sentences.append(
            f"{camera.title}: {significant(float(finite.min()))} to {significant(float(finite.max()))} times as large. "
            if finite.size
            else f"{camera.title}: sees none of these distances there. "
        )
    return Drawing(
        name="off_axis",
        caption=f"Depth uncertainty (half the width of the central 68.27 % interval) {fields} of the sensor where "
        "it is largest, and on the axis. A line ends where the camera sees the point towards no corner, or the "
        "interval has no far end." + selection_words(tree),
        alt=f"One log-log chart per camera. Uncertainty {field_words(float(last['field']))}: " + "".join(sentences),
        draw=partial(draw_off_axis, tree),
    )


def _readings(tree: xr.DataTree) -> Drawing:
    decision = tree["decision"].to_dataset()
    ratio = decision["uncertainty_ratio"]
    every = np.asarray(ratio.values, dtype=float)
    titles = camera_titles(tree)
    numerator, denominator = (with_article(titles[decision.attrs[end]]) for end in ("first", "second"))
    unbounded = [
        f"{sign} at the edge: only the uncertainty of {title} has no bound."
        for sign, marked, title in (("∞", np.isinf(every), numerator), ("0", every == 0.0, denominator))
        if marked.any()
    ]
    if np.isnan(every).any():
        unbounded.append("No mark: a camera does not see the point there, or neither uncertainty has a bound.")
    sentences = []
    for place in ratio["place"].values:
        values = np.asarray(ratio.sel(place=place, error_source="both").values, dtype=float)
        decided = values[~np.isnan(values)]
        if decided.size == values.size == 1:
            sentences.append(f"At {distance(float(place))} the ratio is {significant(float(decided[0]))}. ")
        elif decided.size:
            sentences.append(
                f"At {distance(float(place))} the ratio runs from {significant(float(decided.min()))} to "
                f"{significant(float(decided.max()))} and is above 1 in {int((decided > 1).sum())} of "
                f"{counted(values.size, 'reading')}"
                + (f", undecided in {values.size - decided.size}. " if decided.size < values.size else ". ")
            )
    return Drawing(
        name="readings",
        caption=f"Which assumption reverses the verdict on certainty: ratio of the uncertainty of {numerator} to that "
        f"of {denominator}, under every reading (named in the list above). Left of 1 (shaded), {numerator} is more "
        f"certain; right of 1, {denominator}. The panels show the effect of noise and calibration errors, of noise "
        "alone, and of calibration errors alone. Open marks: the reverse of the "
        + " ".join(["verdict that the study as declared gives.", *unbounded]),
        alt=f"Dot chart of the ratio of the uncertainty of {numerator} to that of {denominator}, one row per reading, "
        "one mark per distance, three panels: noise and calibration, noise only, calibration only. "
        + "".join(sentences),
        draw=partial(draw_readings, tree),
        values=partial(reading_tables, tree, ERROR_SOURCE_TITLES),
    )


def _sweeps(tree: xr.DataTree) -> Iterator[Drawing]:
    names = parameter_words(tree, swept(tree["depth"].to_dataset()))
    place = distance(sweeps.reference_distance(tree))
    why = sweeps.why_this_distance(tree) + selection_words(tree)
    empty = "Dash" if sweeps.has_numbers(tree) else "Blank"
    unseen = f" {empty}: the camera does not see the point, or the uncertainty has no bound." * sweeps.has_gaps(tree)
    if moved := sweeps.moved_cameras(tree):
        numbers = "; the numbers are in mm" if sweeps.has_numbers(tree) else ""
        yield Drawing(
            name="sweep_map",
            caption=f"Depth uncertainty at {place} over the swept {names}{numbers}.{unseen}{why}",
            alt=f"Depth uncertainty at {place} over the swept {names}. "
            + "".join(f"{camera.title}: {sweeps.swept_words(tree, camera.key) or 'none'}. " for camera in moved),
            draw=partial(sweeps.draw_sweep_map, tree),
            values=partial(sweeps.map_tables, tree),
        )
    if not any(len(points) for points in sweeps.usable_designs(tree).values()):
        return  # a logarithmic axis needs at least one point
    yield Drawing(
        name="pareto",
        caption=f"Depth uncertainty at {place} against the nearest usable distance, for all designs usable at "
        f"{place}. The line joins the Pareto-optimal designs.{why}",
        alt=f"Scatter chart of depth uncertainty at {place} against nearest usable distance. {_frontier_words(tree)}",
        draw=partial(sweeps.draw_pareto, tree),
    )


def _frontier_words(tree: xr.DataTree) -> str:
    """Say how many designs each camera has on the chart, and where the frontier ends."""
    clouds = sweeps.usable_designs(tree)
    titles = camera_titles(tree)
    counts = ", ".join(f"{titles[key]} {counted(len(points), 'design')}" for key, points in clouds.items())
    front = sweeps.frontier(np.concatenate(list(clouds.values())))
    (first, least), (last, best) = ((float(near), float(sigma)) for near, sigma in (front[0], front[-1]))
    return (
        f"{counts}. The frontier runs from {pretty(least, LENGTH)} with a near end of {distance(first)} to "
        f"{pretty(best, LENGTH)} with one of {distance(last)}."
    )

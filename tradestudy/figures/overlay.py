"""Depth uncertainty of the same cameras in several runs, in one chart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Final

import numpy as np
import xarray as xr

from tradestudy.figures.curves import NamedCurve, name_ends
from tradestudy.figures.depth import MM, depth_limits, draw_curve, draw_relative_guides
from tradestudy.figures.drawing import Drawing
from tradestudy.figures.style import (
    INK,
    CameraTrace,
    StudyFigure,
    all_traces,
    distance_axis,
    distance_label,
    legend,
    length_tick,
    line_style,
    log_axis,
    new_figure,
    styled,
)
from tradestudy.figures.sweeps import design_sentence
from tradestudy.results.views.depth import nominal, of_camera, swept, where_measured
from tradestudy.results.views.groups import group
from tradestudy.wording import listed

FEW: Final = 3
"""Up to this many cameras are all drawn, changed or not."""
_MOST: Final = 6
_LONGEST_NAME: Final = 26
_LONGEST_LABEL: Final = 90


def overlay_drawing(
    trees: Sequence[xr.DataTree], labels: Sequence[str], cameras: Sequence[str], design: Mapping[str, Any], said: str
) -> Drawing:
    """Describe the figure that overlays the curves of several runs.

    Parameters
    ----------
    trees, labels
        Results and name of each run.
    cameras
        Keys of the cameras to draw, which every run must have; only the first six are drawn.
    design
        Values of the swept parameters to draw, by dimension; other parameters are as declared.
    said
        What differs, in words.
    """
    shown = tuple(camera for camera in all_traces(trees[0]) if camera.key in cameras)
    drawn, silent = shown[:_MOST], shown[_MOST:]
    rest = f" Not drawn: {listed([camera.title for camera in silent])}." if silent else ""
    return Drawing(
        name="overlay",
        caption="Depth uncertainty (half the width of the central 68.27 % interval of one measurement, noise and "
        f"calibration together) in each run: {_line_words(labels)}. Bold where the camera is usable, thin elsewhere. "
        "Grey lines: constant fractions of the distance."
        f"{design_sentence(trees[0], _of_design(trees[0], design))}{rest}",
        alt=f"Log-log chart of depth uncertainty against distance, one colour for each camera and one line style for "
        f"each run. {said}.",
        draw=partial(draw_overlay, trees, labels, drawn, design),
    )


def _line_words(labels: Sequence[str]) -> str:
    return listed([f"{'solid' if order == 0 else 'dashed'}, {label}" for order, label in enumerate(labels)])


def _of_design(tree: xr.DataTree, design: Mapping[str, Any]) -> xr.Dataset:
    """The depth of one design; parameters that it does not name are as declared."""
    depth, declared = group(tree, "depth"), nominal(tree)
    return depth.sel({path: design.get(path, declared[path].item()) for path in swept(depth)})


@styled()
def draw_overlay(
    trees: Sequence[xr.DataTree],
    labels: Sequence[str],
    shown: Sequence[CameraTrace],
    design: Mapping[str, Any],
) -> StudyFigure:
    """Draw one colour for each camera, named at the ends of its curves; the first run is solid, others are dashed."""
    depths = [where_measured(_of_design(tree, design)) for tree in trees]
    figure = new_figure(3.6)
    axes = figure.subplots()
    distances = [np.asarray(depth["distance"].values, dtype=np.float64) for depth in depths]
    drawn = [[of_camera(depth, "depth_uncertainty", camera.key) for camera in shown] for depth in depths]
    ends = min(float(grid[0]) for grid in distances), max(float(grid[-1]) for grid in distances)
    limits = [depth_limits(curves, distance, *ends) for curves, distance in zip(drawn, distances, strict=True)]
    log_axis(axes, "y", tick=length_tick)
    distance_axis(axes, ends, dense=True)
    axes.set(
        ylim=(min(low for low, _ in limits), max(high for _, high in limits)),
        ylabel="depth uncertainty (68 %)",
        xlabel=distance_label(ends[1]),
        title="Where does the depth uncertainty differ?",
    )
    for order, (depth, curves) in enumerate(zip(depths, drawn, strict=True)):
        for camera, uncertainty in zip(shown, curves, strict=True):
            style = replace(camera.style, dash=line_style(order).dash)
            # The first run is wider and lies below the others, so that both of two equal curves show.
            draw_curve(axes, depth, replace(camera, style=style), uncertainty, under=int(order == 0))
    grid = np.geomspace(*ends)
    every = [
        np.interp(grid, distance, uncertainty, left=np.nan, right=np.nan)
        for distance, curves in zip(distances, drawn, strict=True)
        for uncertainty in curves
    ]
    draw_relative_guides(axes, grid, every)
    name_ends(
        axes,
        [
            NamedCurve(name=camera.title, color=camera.style.color, x=distances[0], y=uncertainty * MM)
            for camera, uncertainty in zip(shown, drawn[0], strict=True)
        ],
    )
    handles = [line_style(order).handle(color=INK) for order in range(len(labels))]
    columns = 1 if max(map(len, labels)) > _LONGEST_NAME else len(labels)
    legend(figure, handles, labels, columns=columns, longest=_LONGEST_LABEL)
    return figure

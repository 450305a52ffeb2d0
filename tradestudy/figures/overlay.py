"""Depth uncertainty of the same cameras in several runs, over one another."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Final

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from tradestudy.figures.depth_curves import MM, depth_limits, draw_curve, draw_relative_guides
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
    shortened,
    styled,
)
from tradestudy.figures.sweeps import shown_value
from tradestudy.results.views.depth import nominal, of_camera, swept
from tradestudy.results.views.designs import path_words
from tradestudy.results.views.groups import FloatArray, group
from tradestudy.wording import listed

FEW: Final = 3
"""So many cameras are all drawn, changed or not."""
_MOST: Final = 6
_LONGEST_NAME: Final = 26
_LONGEST_LABEL: Final = 90
_APART: Final = 0.06  # of the height of the panel, between names of curves


def overlay_drawing(
    trees: Sequence[xr.DataTree], labels: Sequence[str], cameras: Sequence[str], design: Mapping[str, Any], said: str
) -> Drawing:
    """The figure that lays the curves of several runs over one another.

    Parameters
    ----------
    trees, labels
        Results of each run, and what to call it.
    cameras
        Keys of the cameras to draw, of which every run has all; the first six are drawn.
    design
        Swept values to draw, by path; others are drawn as declared.
    said
        What differs, in words.
    """
    shown = tuple(camera for camera in all_traces(trees[0]) if camera.key in cameras)
    drawn, silent = shown[:_MOST], shown[_MOST:]
    rest = f" Not drawn: {listed([camera.title for camera in silent])}." if silent else ""
    return Drawing(
        name="overlay",
        caption="Depth uncertainty (half the central 68.27 % interval of one measurement, noise and calibration "
        f"together) in each run: {_line_words(labels)}. Bold where the camera is usable, thin elsewhere. Grey lines: "
        f"equal shares of the distance.{_design_words(trees[0], design)}{rest}",
        alt=f"Log-log chart of depth uncertainty against distance, one colour for each camera and one line style for "
        f"each run. {said}.",
        draw=partial(draw_overlay, trees, labels, drawn, design),
    )


def _line_words(labels: Sequence[str]) -> str:
    return listed([f"{'solid' if order == 0 else 'dashed'}, {label}" for order, label in enumerate(labels)])


def _design_words(tree: xr.DataTree, design: Mapping[str, Any]) -> str:
    depth = _of_design(tree, design)
    values = [f"{path_words(tree, path)} = {shown_value(depth[path], depth[path].item())}" for path in _swept(tree)]
    return f" Of the swept designs the one with {listed(values)} is shown." if values else ""


def _swept(tree: xr.DataTree) -> tuple[str, ...]:
    return swept(group(tree, "depth"))


def _of_design(tree: xr.DataTree, design: Mapping[str, Any]) -> xr.Dataset:
    """Depth of one design; what it does not say is as declared."""
    declared = nominal(tree)
    return group(tree, "depth").sel({path: design.get(path, declared[path].item()) for path in _swept(tree)})


@styled()
def draw_overlay(
    trees: Sequence[xr.DataTree],
    labels: Sequence[str],
    shown: Sequence[CameraTrace],
    design: Mapping[str, Any],
) -> StudyFigure:
    """One colour for each camera, named at the ends of its curves; the first run solid, each other dashed."""
    depths = [_of_design(tree, design) for tree in trees]
    figure = new_figure(3.6)
    axes = figure.subplots()
    curves: dict[str, list[tuple[FloatArray, FloatArray]]] = {camera.key: [] for camera in shown}
    for order, depth in enumerate(depths):
        distance = np.asarray(depth["distance"].values, dtype=np.float64)
        for camera in shown:
            uncertainty = of_camera(depth, "depth_uncertainty", camera.key)
            style = replace(camera.style, dash=line_style(order).dash)
            draw_curve(axes, depth, replace(camera, style=style), uncertainty)
            curves[camera.key].append((distance, uncertainty))
    every = [one for found in curves.values() for one in found]
    ends = (min(float(one[0][0]) for one in every), max(float(one[0][-1]) for one in every))
    log_axis(axes, "y", tick=length_tick)
    distance_axis(axes, ends, dense=True)
    limits = [depth_limits([uncertainty], distance, *ends) for distance, uncertainty in every]
    axes.set(
        ylim=(min(low for low, _ in limits), max(high for _, high in limits)),
        ylabel="depth uncertainty (68 %)",
        xlabel=distance_label(ends[1]),
        title="Where does the depth uncertainty differ?",
    )
    draw_relative_guides(axes, np.geomspace(*ends))
    _name_curves(axes, shown, curves)
    handles = [line_style(order).handle(color=INK) for order in range(len(labels))]
    columns = 1 if max(map(len, labels)) > _LONGEST_NAME else len(labels)
    legend(figure, handles, labels, columns=columns, longest=_LONGEST_LABEL)
    return figure


def _name_curves(
    axes: Axes, shown: Sequence[CameraTrace], curves: Mapping[str, Sequence[tuple[FloatArray, FloatArray]]]
) -> None:
    """The name of each camera at the end of its longest curve, in its colour; beside the panel none on another."""
    bottom, top = axes.get_ylim()
    last = axes.get_xlim()[1]
    beside = {}
    for camera in shown:
        ends = [_end(distance, metres * MM, top) for distance, metres in curves[camera.key]]
        place, millimetres = max(one for one in ends if one is not None) if any(ends) else (0.0, 0.0)
        if place >= last * (1.0 - 1e-9):
            height = np.log(max(millimetres, bottom) / bottom) / np.log(top / bottom)
            beside[camera.key] = float(height)
        elif place > 0.0:
            _name(axes, camera, (place, millimetres), "data", (4, -6))
    placed = dict(zip(sorted(beside, key=beside.__getitem__), _spread(sorted(beside.values())), strict=True))
    for camera in shown:
        if camera.key in placed:
            _name(axes, camera, (1.0, placed[camera.key]), "axes fraction", (4, 0))


def _name(axes: Axes, camera: CameraTrace, place: tuple[float, float], of: str, away: tuple[float, float]) -> None:
    axes.annotate(
        shortened(camera.title, _LONGEST_NAME),
        place,
        xycoords=of,
        xytext=away,
        textcoords="offset points",
        color=camera.style.color,
        fontsize=7,
        va="center",
        annotation_clip=False,
    )


def _end(distance: FloatArray, millimetres: FloatArray, top: float) -> tuple[float, float] | None:
    """Where a curve ends inside a panel; None of one that is nowhere in it."""
    inside = np.flatnonzero(np.isfinite(millimetres) & (millimetres > 0.0) & (millimetres <= top))
    return (float(distance[inside[-1]]), float(millimetres[inside[-1]])) if inside.size else None


def _spread(heights: Sequence[float]) -> list[float]:
    """Heights in rising order, moved so that neighbours are far enough apart and all stay in the panel."""
    placed: list[float] = []
    for height in heights:
        placed.append(max(height, placed[-1] + _APART) if placed else height)
    excess = max(placed[-1] - 1.0, 0.0) if placed else 0.0
    ceiling = [1.0 - _APART * rank for rank in range(len(placed))][::-1]
    return [min(one, most) for one, most in zip(placed, ceiling, strict=True)] if excess else placed

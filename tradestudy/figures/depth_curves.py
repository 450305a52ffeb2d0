"""Depth discrimination and depth uncertainty against distance: the paper's figures 8 and 9, and the whole range."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter

from tradestudy.figures.style import (
    FAINT,
    INK,
    SOFT,
    CameraTrace,
    StudyFigure,
    distance_axis,
    distance_label,
    distance_tick,
    legend,
    length_tick,
    log_axis,
    named_rows,
    new_figure,
    shortened,
    styled,
    traces,
)
from tradestudy.results.views.decision import answer_title, has_winners, tied, told_winners, winners
from tradestudy.results.views.depth import nominal, of_camera, where_usable
from tradestudy.results.views.groups import FloatArray
from tradestudy.wording import distance as distance_words

MM = 1e3
_UNUSABLE_WIDTH, _USABLE_WIDTH = 0.7, 1.9
_LETTERS_ACROSS, _SHORTEST_NAME = 78, 9  # of a name written into the bar of the best camera
_ROOM_OF_GUIDE = 0.13  # of the width, for the name of a line of equal relative uncertainty


@styled()
def draw_discrimination_and_uncertainty(tree: xr.DataTree, near: float, far: float) -> StudyFigure:
    """Two panels over distances from `near` to `far` [m]: discriminating power and uncertainty, in millimetres."""
    depth, shown = nominal(tree), traces(tree)
    figure = new_figure(3.3)
    left, right = figure.subplots(1, 2, sharex=True, sharey=True)
    distance = np.asarray(depth["distance"].values, dtype=float)
    # One point more on each side, so that a curve reaches the edge of the panel.
    inside = np.flatnonzero((distance >= near) & (distance <= far))
    view = depth.isel(distance=slice(max(inside[0] - 1, 0), inside[-1] + 2))
    drawn: list[FloatArray] = []
    for camera in shown:
        nearer = of_camera(view, "depth_discrimination", camera.key, side="nearer")
        farther = of_camera(view, "depth_discrimination", camera.key, side="farther")
        uncertainty = of_camera(view, "depth_uncertainty", camera.key)
        draw_curve(left, view, camera, nearer, "depth_discrimination")
        _band(left, view, camera, nearer, farther)
        draw_curve(right, view, camera, uncertainty)
        drawn += [nearer, uncertainty]
    for axes, title in ((left, "Discriminating power"), (right, "Uncertainty (68 %)")):
        log_axis(axes, "y", tick=length_tick)
        axes.set(xlim=(near, far), xlabel=distance_label(far), title=title)
        axes.xaxis.set_major_formatter(FuncFormatter(distance_tick(far)))
    left.set(ylabel="depth", ylim=depth_limits(drawn, view["distance"].values, near, far))
    _camera_legend(figure, shown)
    return figure


def depth_limits(curves: list[FloatArray], distance: FloatArray, near: float, far: float) -> tuple[float, float]:
    """Depth limits [mm] that hold the curves between two distances, but little above the distance itself."""
    inside = (distance >= near) & (distance <= far)
    values = np.concatenate([curve[inside] for curve in curves])
    values = values[np.isfinite(values) & (values > 0)] * MM
    if not values.size:
        return 0.01 * far, far * MM
    # A percentile, because discrimination falls to nothing where a plenoptic image lies on its array.
    return float(np.percentile(values, 2.0)) / 1.5, min(float(values.max()) * 1.5, 2.0 * far * MM)


def draw_curve(
    axes: Axes, view: xr.Dataset, camera: CameraTrace, metres: FloatArray, variable: str = "depth_uncertainty"
) -> None:
    """A curve over all distances, bold where the camera is usable."""
    distance = np.asarray(view["distance"].values, dtype=float)
    y = np.where(np.isfinite(metres) & (metres > 0), metres * MM, np.nan)
    line = {"color": camera.style.color, "linestyle": camera.style.dash}
    axes.plot(distance, y, linewidth=_UNUSABLE_WIDTH, alpha=0.55, **line, **camera.shows(variable))
    bold = np.where(view["usable"].sel(camera=camera.key).values.astype(bool), y, np.nan)
    axes.plot(distance, bold, linewidth=_USABLE_WIDTH, **line, **camera.shows(variable, "usable"))


def _band(axes: Axes, view: xr.Dataset, camera: CameraTrace, nearer: FloatArray, farther: FloatArray) -> None:
    """From the step nearer to the step farther; an infinite step has no upper edge."""
    top = np.where(np.isinf(farther), 1e9, farther * MM)
    axes.fill_between(
        np.asarray(view["distance"].values, dtype=float),
        nearer * MM,
        top,
        where=np.isfinite(nearer).tolist(),
        color=camera.style.color,
        alpha=0.13,
        linewidth=0,
        **camera.shows("depth_discrimination"),
    )


@styled()
def draw_whole_range(tree: xr.DataTree) -> StudyFigure:
    """Uncertainty over the whole range, log–log, with usable intervals and the best camera as bars below."""
    depth, shown = nominal(tree), traces(tree)
    figure = new_figure(2.4 + 0.16 * len(shown))
    curves, bars = figure.subplots(2, 1, sharex=True, height_ratios=(2.5, 0.17 * (len(shown) + 1) + 0.25))
    distance = np.asarray(depth["distance"].values, dtype=float)
    drawn = [of_camera(depth, "depth_uncertainty", camera.key) for camera in shown]
    for camera, uncertainty in zip(shown, drawn, strict=True):
        draw_curve(curves, depth, camera, uncertainty)
    log_axis(curves, "y", tick=length_tick)
    distance_axis(curves, (float(distance[0]), float(distance[-1])), dense=True)
    limits = depth_limits(drawn, distance, float(distance[0]), float(distance[-1]))
    curves.set(ylim=limits, ylabel="depth uncertainty (68 %)")
    draw_relative_guides(curves, distance)
    _bars(bars, depth, shown)
    if has_winners(tree):
        _best_camera_bar(bars, tree, shown)
        _crossovers((curves, bars), tree)
    bars.set_xlabel(distance_label(float(distance[-1])))
    return figure


def draw_relative_guides(axes: Axes, distance: FloatArray) -> None:
    """Lines of equal relative uncertainty, named inside the panel at its right edge."""
    bottom, top = axes.get_ylim()
    room = float(distance[0] * (distance[-1] / distance[0]) ** _ROOM_OF_GUIDE)
    for share, name in ((1e-4, "0.01 %"), (1e-3, "0.1 %"), (1e-2, "1 %"), (1e-1, "10 %"), (1.0, "100 %")):
        y = share * distance * MM
        axes.plot(distance, y, color=FAINT, linewidth=0.9, zorder=0.5)
        # The name stands where the line leaves the panel: at its right end, or at its top.
        x_end = min(float(distance[-1]), top / (share * MM)) * 0.93
        if bottom < share * x_end * MM < top and x_end > room:
            axes.annotate(
                f"{name} of distance" if name == "1 %" else name,
                (x_end, share * x_end * MM),
                color=SOFT,
                fontsize=6,
                ha="right",
                va="bottom",
            )


def _bars(axes: Axes, depth: xr.Dataset, shown: tuple[CameraTrace, ...]) -> None:
    """One line of bars per camera: the distances at which it is usable."""
    last = float(depth["distance"].values[-1])
    for row, camera in enumerate(shown):
        told = camera.shows("usable")
        nowhere = ((last, last),)  # a page that shows another design moves the ends of bars, also of one without length
        for near, far in where_usable(depth, camera.key) or nowhere:
            end = min(far, last)
            (bar,) = axes.barh(row, end - near, left=near, height=0.62, color=camera.style.color, linewidth=0)
            bar.set(**told)
            # The camera's line style runs through its bar, for readers without colours.
            axes.plot([near, end], [row, row], color="white", linestyle=camera.style.dash, linewidth=0.9, **told)
    named_rows(axes, [shortened(camera.title) for camera in shown])
    axes.set_title("Usable", fontsize=7.5)


def _best_camera_bar(axes: Axes, tree: xr.DataTree, shown: tuple[CameraTrace, ...]) -> None:
    by_key = {camera.key: camera for camera in shown}
    titles = {camera.key: camera.title for camera in shown}
    row = len(shown) + 0.25
    distance = nominal(tree)["distance"].values
    for start, end, answer in winners(tree):
        best = tied(answer)
        for order, key in enumerate(best):  # cameras that are alike share the bar
            height = 0.9 / len(best)
            middle = row - 0.45 + (order + 0.5) * height
            color = by_key[key].style.color
            (bar,) = axes.barh(middle, end - start, left=start, height=height, color=color, linewidth=0)
            bar.set_gid("best")
        if best:
            letters = int(_LETTERS_ACROSS * np.log(end / start) / np.log(distance[-1] / distance[0]))
            if letters >= _SHORTEST_NAME:
                name = shortened(answer_title(titles, answer), letters)
                middle = float(np.sqrt(start * end))
                text = axes.text(middle, row, name, color="white", ha="center", va="center", fontsize=6.5)
                text.set_gid("declared")
    names = [*(shortened(camera.title) for camera in shown), "best camera"]
    axes.set(yticks=[*range(len(shown)), row], yticklabels=names, ylim=(row + 0.6, -0.6))
    axes.get_yticklabels()[-1].set_fontweight("bold")


def _crossovers(panels: tuple[Axes, ...], tree: xr.DataTree) -> None:
    """A vertical line wherever the best camera changes, with its distance."""
    stretches = list(told_winners(tree))
    for _, edge, _ in stretches[:-1]:
        for axes in panels:
            axes.axvline(edge, color=INK, linewidth=0.6, linestyle=(0, (2, 2)), zorder=0.8, gid="declared")
        panels[0].annotate(
            distance_words(edge),
            (edge, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(-1, -2),
            textcoords="offset points",
            fontsize=6.5,
            rotation=90,
            ha="right",
            va="top",
            gid="declared",
        )


def _camera_legend(figure: StudyFigure, shown: tuple[CameraTrace, ...]) -> None:
    handles: list[Line2D | Patch] = [
        *(camera.style.handle(linewidth=_USABLE_WIDTH) for camera in shown),
        Line2D([], [], color=SOFT, linewidth=_UNUSABLE_WIDTH),
        Patch(color=SOFT, alpha=0.2, linewidth=0),
    ]
    labels = [
        *(camera.title for camera in shown),
        "thin: outside the usable range",
        "from the step nearer to the step farther",
    ]
    legend(figure, handles, labels, columns=2)

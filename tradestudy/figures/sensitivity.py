"""Which error drives depth: a tornado per camera, and Sobol indices against distance."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.patches import Patch
from matplotlib.ticker import LogLocator

from tradestudy.figures.curves import NamedCurve, name_ends
from tradestudy.figures.style import (
    PANEL_TITLE,
    SMALL,
    SOFT,
    CameraTrace,
    StudyFigure,
    camera_panels,
    legend,
    length_tick,
    line_style,
    log_axis,
    new_figure,
    shortened,
    styled,
    traces,
)
from tradestudy.results.views.depth import field_words
from tradestudy.wording import in_words

MM = 1e3
_COLUMNS = 2
_MOST_BARS = 8
_MOST_LINES = 7
_LEAST_INDEX = 0.02


def tornado_distance(tree: xr.DataTree) -> float:
    """The computed distance nearest to the logarithmic middle of the declared places, or to 1 m without any."""
    distance = np.asarray(tree["sensitivity"]["distance"].values, dtype=np.float64)
    places = np.asarray(tree["decision"]["place"].values) if "place" in tree["decision"].coords else np.ones(1)
    middle = float(np.exp(np.log(places).mean()))
    return float(distance[np.argmin(np.abs(np.log(distance / middle)))])


@styled()
def draw_tornado(tree: xr.DataTree) -> StudyFigure:
    """Draw, per camera, half the central 68.27 % interval of depth from each independent source, largest first."""
    shown = traces(tree, "sensitivity")
    place = tornado_distance(tree)
    data = tree["sensitivity"].to_dataset().sel(distance=place)
    columns = min(_COLUMNS, len(shown))
    rows = -(-len(shown) // columns)
    finite = data["source_uncertainty"].where(np.isfinite(data["source_uncertainty"])).fillna(0.0)
    counts = [min(_MOST_BARS, int((finite.sel(camera=c.key).max("field") > 0.0).sum())) for c in shown]
    heights = [max(1, *counts[first : first + columns]) for first in range(0, len(shown), columns)]
    figure = new_figure(0.8 + sum(0.3 + 0.2 * height for height in heights))
    grid = figure.subplots(rows, columns, sharex=True, squeeze=False, height_ratios=heights)
    largest = max(float(finite.max()) * MM, np.finfo(float).tiny)  # positive if no camera sees this distance
    for axes, camera in zip(grid.flat, shown, strict=False):
        _bars(axes, data.sel(camera=camera.key), camera)
        axes.set(xlim=(largest * 1e-5, largest * 2.0))
    for row, height in zip(grid, heights, strict=True):
        for axes in row:
            axes.set_ylim(height - 0.4, -0.6)
    for axes in list(grid.flat)[len(shown) :]:
        axes.set_visible(False)
    for axes in grid[-1]:
        axes.set_xlabel("uncertainty from one source")
    fields = [float(field) for field in data["field"].values]
    handles = [Patch(color=SOFT, alpha=_alpha(order), linewidth=0) for order in range(len(fields))]
    legend(figure, handles, [field_words(field) for field in fields], columns=2)
    return figure


def _alpha(order: int) -> float:
    """The opacity of the bars at a field position; the axis comes first."""
    return float(0.4**order)


def _bars(axes: Axes, data: xr.Dataset, camera: CameraTrace) -> None:
    """Draw the bars of one camera, largest first."""
    values = data["source_uncertainty"].transpose("field", "source").values * MM
    size = np.max(np.where(np.isfinite(values), values, 0.0), axis=0)
    order = [k for k in np.argsort(-size) if size[k] > 0.0][:_MOST_BARS]
    names = [shortened(in_words(str(data["source"].values[k])), 32) for k in order]
    rows = np.arange(len(order))
    height = 0.78 / len(values)
    for field, there in enumerate(values):
        widths = np.where(np.isfinite(there[order]), there[order], 0.0)
        middle = rows + (field + 0.5) * height - 0.39
        axes.barh(middle, widths, height=height, color=camera.style.color, alpha=_alpha(field), linewidth=0)
    axes.set_yticks(rows, names, fontsize=SMALL)
    log_axis(axes, "x", tick=length_tick)
    axes.xaxis.set_major_locator(LogLocator(base=100.0, numticks=20))
    axes.tick_params(axis="x", labelsize=SMALL)
    axes.grid(visible=False, axis="y")
    axes.set_title(shortened(camera.title, 34), fontsize=PANEL_TITLE)


@styled()
def draw_indices(tree: xr.DataTree) -> StudyFigure:
    """Draw, per camera, total Sobol indices of inverse depth against distance, and first-order ones as rings."""
    shown = traces(tree, "sensitivity")
    data = tree["sensitivity"].to_dataset().sel(field=0.0)
    names = _main_sources(data)
    columns = min(_COLUMNS, len(shown))
    figure = new_figure(0.6 + 1.5 * -(-len(shown) // columns))
    distance = np.asarray(data["distance"].values, dtype=np.float64)
    panels = camera_panels(figure, len(shown), distance, columns)
    for axes, camera in zip(panels, shown, strict=True):
        axes.set_ylim(0.0, 1.05)
        axes.set_title(shortened(camera.title, 34), fontsize=PANEL_TITLE)
        name_ends(axes, list(_indices(axes, data.sel(camera=camera.key), names)))
    for axes in panels[::columns]:
        axes.set_ylabel("Sobol index")
    return figure


def _indices(axes: Axes, data: xr.Dataset, names: list[str]) -> Iterator[NamedCurve]:
    """Draw the indices of one camera, and yield the curves of its total indices, to be named."""
    distance = np.asarray(data["distance"].values, dtype=np.float64)
    for number, name in enumerate(names):
        one, style, words = data.sel(source=name), line_style(number), in_words(name)
        total = np.asarray(one["total_index"].values, dtype=np.float64)
        if not np.any(total > _LEAST_INDEX):
            continue
        axes.errorbar(
            distance, total, yerr=one["total_index_error"].values, color=style.color, linestyle=style.dash,
            linewidth=1.3, elinewidth=0.8, marker=style.marker, markersize=3, clip_on=False, label=words,
        )  # fmt: skip
        axes.plot(
            distance, one["first_index"].values, color=style.color, linestyle="", marker="o", markersize=6.5,
            markerfacecolor="none", markeredgewidth=0.7, clip_on=False, label=f"{words}, first order",
        )  # fmt: skip
        yield NamedCurve(name=words, color=style.color, x=distance, y=total)


def _main_sources(data: xr.Dataset) -> list[str]:
    """The sources whose index is large enough to draw at some distance, the largest first."""
    values = data["total_index"].transpose("source", ...).values.reshape(data.sizes["source"], -1)
    most = np.max(np.where(np.isfinite(values), values, 0.0), axis=1)
    order = [k for k in np.argsort(-most) if most[k] > _LEAST_INDEX][:_MOST_LINES]
    return [str(data["source"].values[k]) for k in order]

"""Which error drives depth: a tornado per camera, and Sobol indices against distance."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import LogLocator

from tradestudy.figures.style import (
    PANEL_TITLE,
    PANELS_IN_A_ROW,
    SMALL,
    SOFT,
    CameraTrace,
    StudyFigure,
    camera_panels,
    distance_axis,
    legend,
    length_tick,
    line_style,
    log_axis,
    new_figure,
    shortened,
    styled,
    traces_in,
)
from tradestudy.results.views.depth import field_words

MM = 1e3
_MOST_BARS = 8
_MOST_LINES = 7
_LEAST_INDEX = 0.02


def tornado_distance(tree: xr.DataTree) -> float:
    """The computed distance nearest to the middle (in logarithm) of the declared places, 1 m without any."""
    distance = np.asarray(tree["sensitivity"]["distance"].values, dtype=np.float64)
    places = np.asarray(tree["decision"]["place"].values) if "place" in tree["decision"].coords else np.ones(1)
    middle = float(np.exp(np.log(places).mean()))
    return float(distance[np.argmin(np.abs(np.log(distance / middle)))])


@styled()
def draw_tornado(tree: xr.DataTree) -> StudyFigure:
    """Half the central 68.27 % interval of depth from each independent source alone, largest first, per camera."""
    shown = traces_in(tree, "sensitivity")
    place = tornado_distance(tree)
    data = tree["sensitivity"].to_dataset().sel(distance=place)
    columns = min(2, len(shown))
    rows = -(-len(shown) // columns)
    figure = new_figure(0.6 + 1.75 * rows)
    grid = figure.subplots(rows, columns, sharex=True, squeeze=False)
    finite = data["source_uncertainty"].where(np.isfinite(data["source_uncertainty"])).fillna(0.0)
    largest = max(float(finite.max()) * MM, np.finfo(float).tiny)  # nothing is measured at a distance that none sees
    bars = [_bars(axes, data.sel(camera=c.key), c) for axes, c in zip(grid.flat, shown, strict=False)]
    for axes in list(grid.flat)[: len(shown)]:
        axes.set(ylim=(max(bars) - 0.4, -0.6), xlim=(largest * 1e-5, largest * 2.0))
    for axes in list(grid.flat)[len(shown) :]:
        axes.set_visible(False)
    for axes in grid[-1]:
        axes.set_xlabel("uncertainty from one source")
    fields = [float(field) for field in data["field"].values]
    handles = [Patch(color=SOFT, alpha=_alpha(order), linewidth=0) for order in range(len(fields))]
    legend(figure, handles, [field_words(field) for field in fields], columns=2)
    return figure


def _alpha(order: int) -> float:
    """Opacity of the bars at a field position, the axis first."""
    return float(0.4**order)


def _bars(axes: Axes, data: xr.Dataset, camera: CameraTrace) -> int:
    """Draw the bars of one camera, largest first, and say how many there are."""
    values = data["source_uncertainty"].transpose("field", "source").values * MM
    size = np.max(np.where(np.isfinite(values), values, 0.0), axis=0)
    order = [k for k in np.argsort(-size) if size[k] > 0.0][:_MOST_BARS]
    names = [shortened(str(data["source"].values[k]).replace("_", " "), 30) for k in order]
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
    return len(order)


@styled()
def draw_indices(tree: xr.DataTree) -> StudyFigure:
    """Total Sobol indices of inverse depth against distance, with the first-order ones dotted, per camera."""
    shown = traces_in(tree, "sensitivity")
    data = tree["sensitivity"].to_dataset().sel(field=0.0)
    names = _main_sources(data)
    figure = new_figure(0.8 + 1.7 * -(-len(shown) // PANELS_IN_A_ROW))
    distance = np.asarray(data["distance"].values, dtype=np.float64)
    panels = camera_panels(figure, len(shown), float(distance[-1]))
    for axes, camera in zip(panels, shown, strict=True):
        there = data.sel(camera=camera.key)
        for number, name in enumerate(names):
            style = line_style(number)
            total = there["total_index"].sel(source=name).values
            first = there["first_index"].sel(source=name).values
            axes.plot(
                distance,
                total,
                color=style.color,
                linestyle=style.dash,
                linewidth=1.3,
                marker=style.marker,
                markersize=3,
                label=name.replace("_", " "),
            )
            axes.plot(
                distance,
                first,
                color=style.color,
                linestyle=(0, (1, 1.5)),
                linewidth=0.8,
                label=f"{name.replace('_', ' ')}, first order",
            )
        distance_axis(axes, (float(distance[0]), float(distance[-1])))
        axes.set_ylim(0.0, 1.05)
        axes.set_title(shortened(camera.title, 34), fontsize=PANEL_TITLE)
    for axes in panels[::PANELS_IN_A_ROW]:
        axes.set_ylabel("Sobol index")
    handles = [line_style(order).handle() for order in range(len(names))]
    handles.append(Line2D([], [], color=SOFT, linestyle=(0, (1, 1.5)), linewidth=0.8))
    labels = [*(name.replace("_", " ") for name in names), "first order"]
    legend(figure, handles, labels, columns=4)
    return figure


def _main_sources(data: xr.Dataset) -> list[str]:
    """Sources with an index large enough to draw somewhere, the largest first."""
    values = data["total_index"].transpose("source", ...).values.reshape(data.sizes["source"], -1)
    most = np.max(np.where(np.isfinite(values), values, 0.0), axis=1)
    order = [k for k in np.argsort(-most) if most[k] > _LEAST_INDEX][:_MOST_LINES]
    return [str(data["source"].values[k]) for k in order]

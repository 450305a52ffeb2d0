"""What accuracy costs: error against seconds, a line per model, the frontier, the chosen settings, the next digit."""

from __future__ import annotations

import math
import textwrap
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator

from tradestudy.figures.depth_data import FloatArray
from tradestudy.figures.drawing import Drawing
from tradestudy.figures.style import (
    FAINT,
    INK,
    SOFT,
    StudyFigure,
    legend,
    line_style,
    log_axis,
    new_figure,
    printable,
    styled,
)
from tradestudy.units import DURATION, pretty, significant

if TYPE_CHECKING:
    import xarray as xr

_COLUMNS: Final = 2
_PANEL_HEIGHT: Final = 2.7
_LARGEST: Final = 10.0  # an error of ten times the value is no answer
_MARKER: Final = 3.6
_MOST_TICKS: Final = 7
_FOOT: Final = 0.1
_ROOM: Final = 2.0  # beyond the outermost marks
_TITLE_WIDTH: Final = 46  # characters above a panel
_LEGEND_WIDTH, _LEGEND_HANDLE = 118, 11  # characters below the panels, and what the mark before a label takes of them
# Settings of these are what is left out, one thing or another: none follows on the one before.
_UNORDERED: Final = "picture_"


def cost_drawing(tree: xr.DataTree) -> Drawing:
    """Describe the figure of `cost_figure`."""
    data = tree["cost"].to_dataset()
    return Drawing(
        name="cost",
        caption="What accuracy costs on this machine: relative error against the reference (up) and seconds (across), "
        "one line per model through its settings; for models of a picture a mark for each thing left out. "
        "Grey band: the frontier, on which nothing is as accurate in less "
        "time. Ring: what a run of the study computes. Star: a tenth of its error, along the frontier, or of the error "
        "that the study asks for where that is not measured. Dotted: the error of the reference; marks on it err by at "
        "most that. An entry that is the reference stands on "
        "it. Errors above ten times the value are not drawn.",
        alt="Log-log charts of error against seconds. " + _in_words(data),
        draw=partial(cost_figure, tree),
    )


def measured_quantities(data: xr.Dataset) -> list[str]:
    """Quantities that have entries whose errors can be drawn."""
    kept = {str(name) for name in data["quantity"].values[_drawable(data["relative_error"].values)]}
    return [str(name) for name in data["cost_quantity"].values if str(name) in kept]


def _drawable(error: FloatArray) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    return np.asarray(np.isfinite(error) & (error <= _LARGEST))


def _in_words(data: xr.Dataset) -> str:
    sentences = []
    for name in measured_quantities(data):
        one = data.sel(cost_quantity=name)
        text, chosen, floor = str(one["title"].item()), float(one["chosen_error"]), float(one["reference_error"])
        if chosen == 0.0:
            text += f": the study's own choice is the most complete model, in {_time(one, 'chosen_seconds')}"
        elif math.isfinite(chosen):
            least = "at most " if chosen < floor else ""
            text += f": the study's own choice errs by {least}{_percent(max(chosen, floor))} in "
            text += _time(one, "chosen_seconds")
            if (star := _next_digit(one)) is not None:
                text += f"; {_percent(star[1])} costs {pretty(star[0], DURATION, digits=2)}"
            text += f"; the best measured errs by {_percent(float(one['best_error']))} in {_time(one, 'best_seconds')}"
        sentences.append(text + ". ")
    return "".join(sentences)


def _percent(error: float) -> str:
    """As the report writes errors."""
    return f"{significant(100.0 * error, 2)} %"


def _time(one: xr.Dataset, name: str) -> str:
    return pretty(float(one[name]), DURATION, digits=2)


def cost_figure(tree: xr.DataTree) -> StudyFigure:
    """One panel per quantity."""
    with styled():
        data = tree["cost"].to_dataset()
        names = measured_quantities(data)
        drawn = np.isin(data["quantity"].values, names)
        models = list(dict.fromkeys(str(model) for model in data["model"].values[drawn]))
        columns = min(_COLUMNS, len(names))
        rows = -(-len(names) // columns)
        labels = [*models, "frontier", "the study's choice", "the next digit"]
        beside = _legend_columns(labels)
        figure = new_figure(_PANEL_HEIGHT * rows + 0.25 + 0.14 * -(-len(labels) // beside))
        panels = figure.subplots(rows, columns, squeeze=False).ravel()
        for place, (axes, name) in enumerate(zip(panels, names, strict=False)):
            _panel(axes, data, name, models)
            if place + columns >= len(names):
                axes.set_xlabel("seconds")
            if place % columns == 0:
                axes.set_ylabel("relative error")
        for axes in panels[len(names) :]:
            axes.remove()
        marks = [_line(models.index(model)) for model in models]
        band = Line2D([], [], color=FAINT, linewidth=5.0)
        ring = Line2D([], [], linestyle="", marker="o", markersize=8, markerfacecolor="none", markeredgecolor=INK)
        star = Line2D([], [], linestyle="", marker="*", markersize=8, color=INK)
        legend(figure, [*marks, band, ring, star], labels, beside)
    return figure


def _legend_columns(labels: list[str]) -> int:
    """As many columns, up to four, as the width of the figure has room for, each as wide as its longest label."""
    for columns in (4, 3, 2):
        longest = [max(len(label) for label in column) for column in np.array_split(labels, columns) if len(column)]
        if sum(longest) + _LEGEND_HANDLE * len(longest) <= _LEGEND_WIDTH:
            return columns
    return 1


def _line(order: int) -> Line2D:
    style = line_style(order)
    return Line2D([], [], color=style.color, linestyle=style.dash, marker=style.marker, markersize=_MARKER)


def _panel(axes: Axes, data: xr.Dataset, name: str, models: list[str]) -> None:
    one = data.isel(entry=np.flatnonzero(data["quantity"].values == name))
    summary = data.sel(cost_quantity=name)
    floor = float(summary["reference_error"])
    if floor == 0.0:  # the reference is one of the entries, without an error of its own: it stands at the foot
        positive = one["relative_error"].values[one["relative_error"].values > 0.0]
        floor = float(positive.min()) * _FOOT if positive.size else _FOOT
    error = np.maximum(np.asarray(one["relative_error"].values, dtype=float), floor)
    seconds = np.asarray(one["seconds"].values, dtype=float)
    shown = _drawable(error)
    on = shown & one["frontier"].values.astype(bool)
    order = np.argsort(seconds[on])
    axes.plot(seconds[on][order], error[on][order], color=FAINT, linewidth=7.0, solid_capstyle="round", zorder=1)
    for model in models:
        own = shown & (one["model"].values == model)
        style = line_style(models.index(model))
        axes.plot(
            seconds[own], error[own], color=style.color, linestyle="" if name.startswith(_UNORDERED) else style.dash,
            linewidth=1.1, marker=style.marker, markersize=_MARKER, zorder=3,
        )  # fmt: skip
    chosen = shown & one["chosen"].values.astype(bool)
    axes.plot(
        seconds[chosen], error[chosen], linestyle="", marker="o", markersize=9, markerfacecolor="none",
        markeredgecolor=INK, zorder=4,
    )  # fmt: skip
    axes.axhline(floor, color=SOFT, linewidth=0.8, linestyle=(0, (1, 2)), zorder=2)
    star = _next_digit(summary)
    if star is not None:
        axes.plot(*star, linestyle="", marker="*", markersize=8, color=INK, zorder=5)
    axes.set_title(textwrap.fill(printable(str(summary["title"].item())), _TITLE_WIDTH), fontsize=7.5)
    _frame(axes, seconds[shown], np.append(error[shown], floor), [] if star is None else [star])


def _next_digit(summary: xr.Dataset) -> tuple[float, float] | None:
    """Seconds and error of a tenth of the chosen error, or else of what the study asks for; None if neither is told."""
    chosen, asked = float(summary["chosen_error"]), float(summary["asked_error"])
    own = float(summary["next_seconds"]), float(summary["next_error"])
    tenth = float(summary["asked_tenth_seconds"]), asked / 10.0
    if math.isfinite(own[0]) and own[1] > 0.0:
        return own
    return tenth if math.isfinite(tenth[0]) and tenth[1] < chosen else None


def _frame(axes: Axes, seconds: FloatArray, errors: FloatArray, extra: list[tuple[float, float]]) -> None:
    """Logarithmic axes over what is drawn, with few enough ticks that their labels keep apart."""
    for which, values in (
        ("x", np.append(seconds, [x for x, _ in extra])),
        ("y", np.append(errors, [y for _, y in extra])),
    ):
        low, high = float(values.min()) / _ROOM, float(values.max()) * _ROOM
        decades = math.log10(high / low)
        log_axis(axes, which, dense=decades < 1.5)
        if decades >= 1.5:
            axis = axes.xaxis if which == "x" else axes.yaxis
            axis.set_major_locator(LogLocator(base=10.0 ** math.ceil(decades / _MOST_TICKS), numticks=20))
        (axes.set_xlim if which == "x" else axes.set_ylim)(low, high)

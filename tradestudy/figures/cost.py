"""What accuracy costs: error against seconds, a line per model, the frontier, the chosen settings, the next digit."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.path import Path
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator

from tradestudy.figures.drawing import Drawing
from tradestudy.figures.fonts import printable
from tradestudy.figures.style import (
    FAINT,
    INK,
    SOFT,
    StudyFigure,
    legend,
    line_style,
    log_axis,
    new_figure,
    plain_number,
    styled,
)
from tradestudy.results.cost import NO_ANSWER
from tradestudy.results.views.groups import FloatArray
from tradestudy.units import DURATION, pretty, significant

_COLUMNS: Final = 2
_PANEL_HEIGHT: Final = 2.7
_MARKER: Final = 3.6
_FEWEST_TICKS, _MOST_TICKS = 2, 7
_FEW_DECADES: Final = 1.5
_FOOT: Final = 0.1  # of the smallest error, where entries without one stand
_BREAK: Final = 1.12  # half the height of the break above them, as a factor
_ROOM, _EDGE = 2.0, 0.09  # beyond the outermost marks: at least a factor, and a share of the decades between them
_TITLE_WIDTH, _SUBTITLE_WIDTH = 46, 58  # characters above a panel
_SUBTITLE_HEIGHT: Final = 8.6  # points a line
_LEGEND_WIDTH, _LEGEND_HANDLE = 118, 11  # characters below the panels, and what the mark before a label takes of them
# Settings of these are what is left out, one thing or another: none follows on the one before.
_UNORDERED: Final = "picture_"
_DOWNWARDS: Final = np.array([(0.0, 0.0), (0.0, -1.0), (-0.22, -0.68), (0.0, -1.0), (0.22, -0.68)])
_STROKES: Final = [Path.MOVETO, Path.LINETO, Path.LINETO, Path.MOVETO, Path.LINETO]
_DOWN: Final = Path(_DOWNWARDS, _STROKES)
_HOLLOW_AND_DOWN: Final = Path.make_compound_path(
    Path.circle((0.0, 0.75), 0.25), Path(1.5 * _DOWNWARDS + np.array([0.0, 0.5]), _STROKES)
)
_RING: Final[Mapping[str, Any]] = {
    "linestyle": "", "marker": "o", "markersize": 9, "markerfacecolor": "none", "markeredgecolor": INK,
}  # fmt: skip
_STAR: Final[Mapping[str, Any]] = {"linestyle": "", "marker": "*", "markersize": 8, "color": INK}
_ARROW: Final[Mapping[str, Any]] = {
    "linestyle": "", "marker": _DOWN, "markersize": 15, "markerfacecolor": "none", "markeredgewidth": 0.9,
}  # fmt: skip
_SLASH: Final[Mapping[str, Any]] = {
    "linestyle": "", "marker": Path([(-1.0, -0.4), (1.0, 0.4)]), "markersize": 8, "markeredgecolor": SOFT,
    "markeredgewidth": 0.8,
}  # fmt: skip


def cost_drawing(tree: xr.DataTree) -> Drawing:
    """Describe the figure of `draw_cost`."""
    data = tree["cost"].to_dataset()
    titles, drawn = data["title"], measured_quantities(data)
    missing = [str(titles.sel(cost_quantity=name).item()) for name in data["cost_quantity"].values if name not in drawn]
    return Drawing(
        name="cost",
        caption="What accuracy costs on this machine: relative error against the reference (up) and seconds (across), "
        "one line per model through its settings; for models of a picture a mark for each thing left out. Grey band: "
        "the frontier, the least error that was measured in no more time. Ring: what a run of the study computes. "
        "Star: the cheapest that was measured within a tenth of its error, or, where nothing was, of the error that "
        "the study asks for; named above each panel. Dotted: the error of the reference; hollow marks on it, with an "
        "arrow, err by at most that. Below a break in the axis: no error, for an entry that is the reference. Errors "
        "above ten times the value are not drawn."
        + (
            f" Without a panel, as nothing of it was measured that could be drawn: {'; '.join(missing)}."
            if missing
            else ""
        ),
        alt="Log-log charts of error against seconds. " + _in_words(data),
        draw=partial(draw_cost, tree),
    )


def measured_quantities(data: xr.Dataset) -> list[str]:
    """Quantities that have entries whose errors can be drawn."""
    kept = {str(name) for name in data["quantity"].values[_drawable(data["relative_error"].values)]}
    return [str(name) for name in data["cost_quantity"].values if str(name) in kept]


def _drawable(error: FloatArray) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    return np.asarray(np.isfinite(error) & (error <= NO_ANSWER))


def _in_words(data: xr.Dataset) -> str:
    sentences = []
    for name in measured_quantities(data):
        one = data.sel(cost_quantity=name)
        text, chosen, floor = str(one["title"].item()), float(one["chosen_error"]), float(one["reference_error"])
        if chosen == 0.0 == floor:
            text += f": the study's own choice is the most complete model, in {_time(one, 'chosen_seconds')}"
        elif math.isfinite(chosen):
            least = "at most " if chosen < floor else ""
            text += f": the study's own choice errs by {least}{_percent(max(chosen, floor))} in "
            text += _time(one, "chosen_seconds")
            if (star := _next_digit(one)) is not None:
                text += f"; {star.what}: {star.words}, {pretty(star.seconds, DURATION, digits=2)}"
            text += f"; the best measured errs by {_percent(max(float(one['best_error']), floor))} in "
            text += _time(one, "best_seconds")
        sentences.append(text + ". ")
    return "".join(sentences)


def _percent(error: float) -> str:
    """As the report writes errors."""
    return f"{significant(100.0 * error, 3)} %"


def _time(one: xr.Dataset, name: str) -> str:
    return pretty(float(one[name]), DURATION, digits=2)


@styled()
def draw_cost(tree: xr.DataTree) -> StudyFigure:
    """One panel per quantity."""
    data = tree["cost"].to_dataset()
    names = measured_quantities(data)
    drawn = np.isin(data["quantity"].values, names) & _drawable(data["relative_error"].values)
    models = list(dict.fromkeys(str(model) for model in data["model"].values[drawn]))
    columns = min(_COLUMNS, len(names))
    rows = -(-len(names) // columns)
    marks = {
        "frontier": Line2D([], [], color=FAINT, linewidth=5.0),
        "the study's choice": Line2D([], [], **_RING),
        "the next digit": Line2D([], [], **_STAR),
        "errs by at most this": Line2D(
            [], [], **{**_ARROW, "marker": _HOLLOW_AND_DOWN, "markersize": 11}, markeredgecolor=INK
        ),
    }
    labels = [*models, *marks]
    beside = _legend_columns(labels)
    figure = new_figure(_PANEL_HEIGHT * rows + 0.25 + 0.14 * -(-len(labels) // beside))
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, name in zip(panels, names, strict=False):
        _panel(axes, data, name, models)
    for axes in panels[len(names) :]:
        axes.remove()
    styles = [line_style(order) for order in range(len(models))]
    legend(
        figure,
        [*(style.handle(marker=style.marker, markersize=_MARKER) for style in styles), *marks.values()],
        labels,
        beside,
        longest=_LEGEND_WIDTH,
    )
    return figure


def _legend_columns(labels: list[str]) -> int:
    """As many columns, up to four, as the width of the figure has room for, each as wide as its longest label."""
    for columns in (4, 3, 2):
        longest = [max(len(label) for label in column) for column in np.array_split(labels, columns) if len(column)]
        if sum(longest) + _LEGEND_HANDLE * len(longest) <= _LEGEND_WIDTH:
            return columns
    return 1


@dataclass(frozen=True, kw_only=True)
class _Scale:
    """Where errors are drawn: none below the reference's, and those that are nothing at a place of their own.

    Parameters
    ----------
    floor
        Height of the dotted line: the error of the reference, or the place of "no error".
    exact
        Whether the reference is one of the entries, without an error of its own.
    """

    floor: float
    exact: bool

    @classmethod
    def of(cls, errors: FloatArray, reference_error: float) -> _Scale:
        """For the errors of a panel, one decade and a break below the smallest if the reference has none."""
        if reference_error > 0.0:
            return cls(floor=reference_error, exact=False)
        positive = errors[_drawable(errors) & (errors > 0.0)]
        return cls(floor=float(positive.min() if positive.size else 1.0) * _FOOT, exact=True)

    @property
    def gap(self) -> float:
        """Where the axis is broken."""
        return self.floor * math.sqrt(1.0 / _FOOT)


def _panel(axes: Axes, data: xr.Dataset, name: str, models: list[str]) -> None:
    one = data.isel(entry=np.flatnonzero(data["quantity"].values == name))
    summary = data.sel(cost_quantity=name)
    measured = np.asarray(one["relative_error"].values, dtype=float)
    scale = _Scale.of(measured, float(summary["reference_error"]))
    error, seconds = np.maximum(measured, scale.floor), np.asarray(one["seconds"].values, dtype=float)
    shown, bound = _drawable(measured), (measured < scale.floor) & (not scale.exact)
    on = shown & one["frontier"].values.astype(bool)
    order = np.argsort(seconds[on])
    axes.plot(
        seconds[on][order], error[on][order], drawstyle="steps-post", color=FAINT, linewidth=7.0,
        solid_capstyle="round", solid_joinstyle="round", zorder=1,
    )  # fmt: skip
    for model in models:
        own = shown & (one["model"].values == model)
        _model(axes, seconds[own], error[own], bound[own], models.index(model), joined=not name.startswith(_UNORDERED))
    chosen = shown & one["chosen"].values.astype(bool)
    _whole(axes, seconds[chosen], error[chosen], zorder=4, **_RING)
    axes.axhline(scale.floor, color=SOFT, linewidth=0.8, linestyle=(0, (1, 2)), zorder=2)
    star = _next_digit(summary)
    if star is not None:
        _whole(axes, np.array([star.seconds]), np.array([max(star.error, scale.floor)]), zorder=5, **_STAR)
    _headed(axes, summary, star)
    axes.set(xlabel="seconds", ylabel="relative error")
    _frame(axes, seconds[shown], np.append(error[shown], scale.floor), scale)


def _model(
    axes: Axes, seconds: FloatArray, error: FloatArray, bound: np.ndarray[Any, Any], order: int, *, joined: bool
) -> None:
    """The entries of a model; those that are known to within the reference alone are hollow and point down."""
    style = line_style(order)
    axes.plot(seconds, error, color=style.color, linestyle=style.dash if joined else "", linewidth=1.1, zorder=3)
    for filled, at in ((True, ~bound), (False, bound)):
        axes.plot(
            seconds[at], error[at], color=style.color, linestyle="", marker=style.marker, markersize=_MARKER,
            markerfacecolor=style.color if filled else "white", zorder=3.2,
        )  # fmt: skip
    _whole(axes, seconds[bound], error[bound], zorder=3.1, markeredgecolor=style.color, **_ARROW)


def _whole(axes: Axes, seconds: FloatArray, error: FloatArray, **style: Any) -> None:
    """Marks that no frame cuts; without any nothing is drawn, for the layout would make room for it."""
    if seconds.size:
        axes.plot(seconds, error, clip_on=False, **style)


@dataclass(frozen=True, kw_only=True)
class _Star:
    """The entry that the next digit costs, and what it is the cheapest within."""

    what: str
    words: str
    error: float
    seconds: float


def _next_digit(summary: xr.Dataset) -> _Star | None:
    """The entry within a tenth of the chosen error, or else of what the study asks for; None if neither was measured.

    None, too, where the chosen one has no error, or is within a tenth of what is asked itself.
    """
    asked = float(summary["asked_error"])
    for which, wanted in (("next", float(summary["next_wanted"])), ("asked_tenth", asked / 10.0)):
        words, error = str(summary[f"{which}_entry"].item()), float(summary[f"{which}_error"])
        if words and 0.0 < wanted < float(summary["chosen_error"]):
            what = "a tenth of that" if which == "next" else _percent(wanted)
            return _Star(what=what, words=words, error=error, seconds=float(summary[f"{which}_seconds"]))
    return None


def _headed(axes: Axes, summary: xr.Dataset, star: _Star | None) -> None:
    """The title of a panel, and under it what ring and star stand for."""
    said = []
    if words := str(summary["chosen_entry"].item()):
        said.append(f"○ {words}: {_time(summary, 'chosen_seconds')}")
    if star is not None:
        said.append(f"★ {star.words}: {pretty(star.seconds, DURATION, digits=2)}")
    lines = [textwrap.fill(printable(line), _SUBTITLE_WIDTH) for line in said]
    below = "\n".join(lines)
    axes.set_title(
        textwrap.fill(printable(str(summary["title"].item())), _TITLE_WIDTH),
        fontsize=7.5,
        pad=5.0 + _SUBTITLE_HEIGHT * (below.count("\n") + 1 if below else 0),
    )
    subtitle = axes.annotate(
        below, (0.0, 1.0), (0.0, 4.0), xycoords="axes fraction", textcoords="offset points", fontsize=6.5, color=SOFT,
        verticalalignment="bottom", linespacing=1.15,
    )  # fmt: skip
    subtitle.set_in_layout(False)  # the title's distance makes room for it


def _frame(axes: Axes, seconds: FloatArray, errors: FloatArray, scale: _Scale) -> None:
    """Logarithmic axes over what is drawn, with few enough ticks that their labels keep apart."""
    for which, values in (("x", seconds), ("y", errors)):
        decades = math.log10(float(values.max()) / float(values.min()))
        room = max(_ROOM, 10.0 ** (_EDGE * decades))  # a ring fits beside the outermost marks
        low, high = float(values.min()) / room, float(values.max()) * room
        decades = math.log10(high / low)
        labelled = scale.gap if which == "y" and scale.exact else low
        powers_of_ten = math.floor(math.log10(high)) - math.ceil(math.log10(labelled)) + 1
        dense = decades < _FEW_DECADES or powers_of_ten < _FEWEST_TICKS
        log_axis(axes, which, dense=dense)
        if not dense:
            axis = axes.xaxis if which == "x" else axes.yaxis
            axis.set_major_locator(LogLocator(base=10.0 ** math.ceil(decades / _MOST_TICKS), numticks=20))
        (axes.set_xlim if which == "x" else axes.set_ylim)(low, high)
    if scale.exact:
        _broken(axes, scale)


def _broken(axes: Axes, scale: _Scale) -> None:
    """No error has no place on a logarithmic axis: its own tick, below a break."""
    axis, (low, high) = axes.yaxis, axes.get_ylim()
    ticks = [float(tick) for tick in axis.get_major_locator().tick_values(low, high) if scale.gap < tick <= high]
    minor = [float(tick) for tick in axis.get_minor_locator().tick_values(low, high) if scale.gap < tick <= high]
    axis.set_major_locator(FixedLocator([scale.floor, *ticks]))
    axis.set_minor_locator(FixedLocator(minor))
    axis.set_major_formatter(FuncFormatter(lambda value, _at: "no error" if value < scale.gap else plain_number(value)))
    across = axes.get_yaxis_transform()
    for factor in (1.0 / _BREAK, _BREAK):
        axes.plot(0.0, scale.gap * factor, **_SLASH, transform=across, clip_on=False, zorder=6)
    axes.plot([0.0, 0.0], [scale.gap / _BREAK, scale.gap * _BREAK], color="white", linewidth=2.0, transform=across,
              clip_on=False, zorder=5.5)  # fmt: skip

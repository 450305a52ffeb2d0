"""What accuracy costs in time, and how well the program answers cases with known answers."""

from __future__ import annotations

import math
from functools import partial
from typing import Any, Final

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator

from tradestudy.figures.drawing import Drawing
from tradestudy.figures.style import (
    FAINT,
    INK,
    PANEL_TITLE,
    PANELS_IN_A_ROW,
    SMALL,
    SOFT,
    StudyFigure,
    legend,
    line_style,
    log_axis,
    new_figure,
    shortened,
    styled,
)
from tradestudy.results.views.groups import FloatArray
from tradestudy.units import DURATION, pretty

_COLUMNS: Final = 2
_HEIGHT, _LEGEND_HEIGHT = 1.95, 0.3  # inches: a row of panels, and the legend below all rows
_ROOM: Final = 2.5  # an axis ends at this factor beyond the outermost marks
_FEW_DECADES, _MOST_TICKS = 2.2, 6
_TITLE: Final = 48  # characters
_MODELS: Final[dict[str, Any]] = {"linestyle": "", "marker": "o", "markersize": 3.6, "color": SOFT}
_FRONTIER: Final[dict[str, Any]] = {"color": FAINT, "linewidth": 5.0, "solid_capstyle": "round"}
_RING: Final[dict[str, Any]] = {
    "linestyle": "", "marker": "o", "markersize": 10, "markerfacecolor": "none", "markeredgecolor": INK,
}  # fmt: skip
_STAR: Final[dict[str, Any]] = {"linestyle": "", "marker": "*", "markersize": 11, "color": INK}
_REFERENCE: Final[dict[str, Any]] = {"color": SOFT, "linewidth": 0.8, "linestyle": (0, (1, 2))}


def cost_drawing(tree: xr.DataTree) -> Drawing:
    """Describe the figure of `draw_cost`."""
    data = tree["cost"].to_dataset()
    star = "Star: the fastest set with a tenth of its error or less. " if data["next_digit"].any() else ""
    return Drawing(
        name="cost",
        caption="Cost of accuracy on this machine: error relative to the reference (the most complete models) against "
        f"computing time, one dot for each set of models. Ring: the set that the run uses. {star}Grey: the Pareto "
        "front. Dotted: the error of the reference itself, below which "
        "errors cannot be distinguished.",
        alt="Log-log charts of error against seconds. " + "".join(_in_words(data, problem) for problem in _drawn(data)),
        draw=partial(draw_cost, data),
    )


def _drawn(data: xr.Dataset) -> list[str]:
    """Names of the problems that have entries."""
    return list(dict.fromkeys(str(problem) for problem in data["problem_of"].values))


def _in_words(data: xr.Dataset, problem: str) -> str:
    entries = data.isel(entry=data["problem_of"].values == problem)
    every = ", ".join(
        f"{models} {pretty(float(took), DURATION, digits=2)} and {100.0 * float(error):.2g} %"
        for models, took, error in zip(
            entries["models"].values, entries["seconds"].values, entries["relative_error"].values, strict=True
        )
    )
    return f"{entries['title'].sel(problem=problem).item()}: {every}. "


@styled()
def draw_cost(data: xr.Dataset) -> StudyFigure:
    """Draw error against seconds, with one panel for each problem."""
    names = _drawn(data)
    columns = min(_COLUMNS, len(names))
    rows = -(-len(names) // columns)
    figure = new_figure(_HEIGHT * rows + _LEGEND_HEIGHT)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, problem in zip(panels, names, strict=False):
        _panel(axes, data.isel(entry=data["problem_of"].values == problem).sel(problem=problem))
    for axes in panels[len(names) :]:
        axes.remove()
    styles = {
        "a set of models": _MODELS,
        "Pareto front": _FRONTIER,
        "used by the run": _RING,
    }
    if data["next_digit"].any():
        styles["a tenth of the error"] = _STAR
    handles = [Line2D([], [], **style) for style in (*styles.values(), _REFERENCE)]
    legend(figure, handles, [*styles, "error of the reference"], len(handles))
    return figure


def _panel(axes: Axes, problem: xr.Dataset) -> None:
    shown = np.isfinite(problem["relative_error"].values)
    entries = problem.isel(entry=shown).sortby("seconds")
    seconds, error = np.asarray(entries["seconds"].values), 100.0 * np.asarray(entries["relative_error"].values)
    on, chosen, star = (entries[variable].values.astype(bool) for variable in ("frontier", "chosen", "next_digit"))
    floor = 100.0 * float(problem["reference_error"])
    axes.plot(seconds[on], error[on], drawstyle="steps-post", zorder=1, **_FRONTIER)
    axes.axhline(floor, zorder=2, **_REFERENCE)
    axes.plot(seconds, error, zorder=3, label="a set of models", **_MODELS)
    axes.plot(seconds[chosen], error[chosen], zorder=4, **_RING)
    axes.plot(seconds[star], error[star], zorder=5, **_STAR)
    _frame(axes, "x", seconds)
    _frame(axes, "y", np.append(error, floor))
    for took in seconds[star]:  # the corner for slow and inaccurate models has the fewest marks
        price = f"★ a tenth of the error: {pretty(float(took), DURATION, digits=2)}"
        axes.text(0.985, 0.97, price, transform=axes.transAxes, ha="right", va="top", fontsize=SMALL)
    axes.set_title(shortened(str(problem["title"].item()), _TITLE))
    axes.set(xlabel="computing time [s]", ylabel="error [%]")


def _frame(axes: Axes, which: str, values: FloatArray) -> None:
    """Make an axis logarithmic, with room around the values and so few ticks that their labels do not touch."""
    low, high = float(values.min()) / _ROOM, float(values.max()) * _ROOM
    decades = math.log10(high / low)
    log_axis(axes, which, dense=decades < _FEW_DECADES)
    if decades > _MOST_TICKS:
        axis = axes.xaxis if which == "x" else axes.yaxis
        axis.set_major_locator(LogLocator(base=10.0 ** math.ceil(decades / _MOST_TICKS), numticks=20))
    (axes.set_xlim if which == "x" else axes.set_ylim)(low, high)


# Errors lie between these powers of ten; exact values and wrong infinities have places of their own beside them.
_LOWEST, _HIGHEST = -18.0, 4.0
_EXACT, _WRONG = -20.0, 6.0
_TICKS = (-12, 0)


def hard_cases_drawing(tree: xr.DataTree) -> Drawing:
    """Describe the figure of `draw_hard_cases`."""
    data = tree["hard_cases"].to_dataset()
    numbers = data.isel(case=np.flatnonzero(~data["outcome"].values.astype(bool)))
    naive, ours = (np.asarray(numbers[variable].values, dtype=float) for variable in ("naive_error", "our_error"))
    bound = np.asarray(numbers["bound"].values, dtype=float)
    return Drawing(
        name="hard_cases",
        caption="Relative error of the usual formula (across) against that of this program (up): one chart for "
        "each group of cases, one mark for each case whose answer is a number. On the dashed line both are equally "
        "accurate; the dotted lines are at 10⁻¹², the bound for well-conditioned cases. “Wrong”: no finite relative "
        "error.",
        alt=f"Scatter chart of {naive.size} hard cases. The usual formula is beyond the bound in "
        f"{int((~(naive <= bound)).sum())} of them and gives no number at all in {int(np.isinf(naive).sum())}; this "
        f"program is beyond it in {int((~(ours <= bound)).sum())}. Its largest error is "
        f"{float(np.max(ours[np.isfinite(ours)], initial=0.0)):.1e}, where rounding or sampling allows it.",
        draw=partial(draw_hard_cases, tree),
    )


@styled()
def draw_hard_cases(tree: xr.DataTree) -> StudyFigure:
    """Draw the program's error against that of the usual formula, with a panel for each family of cases."""
    data = tree["hard_cases"].to_dataset()
    data = data.isel(case=np.flatnonzero(~data["outcome"].values.astype(bool)))
    families = list(dict.fromkeys(str(family) for family in data["family_title"].values))
    rows = -(-len(families) // PANELS_IN_A_ROW)
    figure = new_figure(0.5 + 1.6 * rows)
    grid = figure.subplots(rows, PANELS_IN_A_ROW, sharex=True, sharey=True, squeeze=False)
    for order, (axes, family) in enumerate(zip(grid.flat, families, strict=False)):
        _case_axis(axes)
        cases = data.isel(case=np.flatnonzero(data["family_title"].values == family))
        x, y = (_placed(np.asarray(cases[variable].values, dtype=float)) for variable in ("naive_error", "our_error"))
        style = line_style(order)
        axes.plot(x, y, linestyle="", marker=style.marker, markersize=4, color=style.color, alpha=0.6, label=family)
        axes.set_title(family, fontsize=PANEL_TITLE)
    for axes in grid.flat[len(families) :]:
        axes.set_visible(False)
    for axes in grid.flat[: len(families)][-PANELS_IN_A_ROW:]:  # only the lowest panel of each column
        axes.tick_params(labelbottom=True)
    figure.supxlabel("relative error of the usual formula", fontsize="medium")
    figure.supylabel("relative error of this program", fontsize="medium")
    return figure


def _case_axis(axes: Axes) -> None:
    """Label the axes: powers of ten, with "exact" before them and "wrong" after them."""
    ticks = [_EXACT, *_TICKS, _WRONG]
    labels = ["exact", *(f"10{str(t).translate(str.maketrans('-0123456789', '⁻⁰¹²³⁴⁵⁶⁷⁸⁹'))}" for t in _TICKS), "wrong"]
    labels[labels.index("10⁰")] = "1"
    ends = (_EXACT - 1.0, _WRONG + 1.0)
    axes.set(xticks=ticks, xticklabels=labels, xlim=ends, yticks=ticks, yticklabels=labels, ylim=ends)
    axes.plot([_LOWEST, _HIGHEST], [_LOWEST, _HIGHEST], color=SOFT, linewidth=0.8, linestyle=(0, (5, 3)))
    axes.axhline(-12.0, color=SOFT, linewidth=0.8, linestyle=(0, (1, 2)))
    axes.axvline(-12.0, color=SOFT, linewidth=0.8, linestyle=(0, (1, 2)))
    for edge in (_LOWEST - 0.5, _HIGHEST + 0.5):
        axes.axhline(edge, color=FAINT, linewidth=0.8)
        axes.axvline(edge, color=FAINT, linewidth=0.8)


def _placed(error: FloatArray) -> FloatArray:
    """The exponents of errors; zero and infinity have places of their own."""
    power = np.clip(np.log10(np.where((error > 0.0) & np.isfinite(error), error, 1.0)), _LOWEST, _HIGHEST)
    return np.where(error == 0.0, _EXACT, np.where(np.isfinite(error), power, _WRONG))

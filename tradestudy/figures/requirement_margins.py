"""Margins by which designs of a sweep meet their requirements: curves over one parameter, a map over two."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import fill
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter

from tradestudy.figures.drawing import Drawing
from tradestudy.figures.fonts import printable
from tradestudy.figures.style import (
    INK,
    SMALL,
    SOFT,
    StudyFigure,
    legend,
    line_style,
    log_axis,
    new_figure,
    plain_number,
    styled,
)
from tradestudy.figures.sweeps import axis_label, axis_unit, axis_values, shown_value
from tradestudy.figures.value_tables import Tables, grid
from tradestudy.results.views.designs import common_ranges, must_hold, parameter_words, path_words
from tradestudy.results.views.groups import FloatArray
from tradestudy.results.views.requirement_conclusions import requirement_conclusions, requirement_sentence
from tradestudy.units import FRACTION

_FEW = 2
_LETTERS_UP = 30  # in a line of the label of the vertical axis
_LEVELS = (-50.0, -20.0, -10.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0)  # contours of margin [%], besides 0
_LINEAR_WITHIN = 10.0  # per cent: margins beyond are on a logarithmic scale


def margins_drawing(tree: xr.DataTree) -> Drawing | None:
    """The figure of a study that sweeps one or two parameters and has requirements; None for any other."""
    if "requirements" not in tree.children or "design_met" not in tree["requirements"].data_vars:
        return None
    data = tree["requirements"].to_dataset()
    dims = _swept(data)
    if not np.isfinite(data["design_margin_percent"].values).any():  # no requirement can fail, or none can be decided
        return None
    if len(dims) > 2 or (len(dims) == 2 and any(data[dim].dtype.kind not in "fiu" for dim in dims)):
        return None
    if len(dims) == 2 and np.ptp(_least(data, dims)) == 0.0:  # equal margins have no contours
        return None
    names = parameter_words(tree, dims)
    conclusions = "; ".join(requirement_sentence(one) for one in requirement_conclusions(tree))
    shown = "Smallest margin of the requirements that must be met" if len(dims) == 2 else "Margin of each requirement"
    marks = (
        "Thick line: a margin of 0. Filled dots: designs that meet all of them."
        if len(dims) == 2
        else "A requirement is met where its margin is positive. Marks: computed designs; the curves cross 0 at the "
        "limits found between them. Shaded: all requirements that must be met are met."
    )
    return Drawing(
        name="requirement_margins",
        caption=f"{shown}, against the {names}. {marks} "
        "Dashed: the study as declared. If no camera is usable over 30 % of the range, on a logarithmic scale, the "
        "margin is −30 % or less.",
        alt=f"Margins over the {names}. {conclusions}.",
        draw=lambda: draw_requirement_margins(tree),
        values=lambda: _tables(tree, data, dims) if len(dims) == 2 else (),
    )


@styled()
def draw_requirement_margins(tree: xr.DataTree) -> StudyFigure:
    """Draw margins [%]: over one swept parameter, a curve for each requirement; over two, a map of the smallest."""
    data = tree["requirements"].to_dataset()
    dims = _swept(data)
    return _map(tree, data, (dims[0], dims[1])) if len(dims) == 2 else _curves(tree, data, dims[0])


def _swept(data: xr.Dataset) -> list[str]:
    return [str(name) for name in data["design_met"].dims if name != "requirement"]


def _curves(tree: xr.DataTree, data: xr.Dataset, dim: str) -> StudyFigure:
    x, names = axis_values(data[dim])
    figure = new_figure(2.8)
    axes = figure.subplots()
    if "met_from" in data:
        factor = axis_unit(data[dim])[0]
        for low, high in common_ranges(data, must_hold(data)):
            axes.axvspan(low * factor, high * factor, color=SOFT, alpha=0.3, linewidth=0)
    axes.axhline(0.0, color=INK, linewidth=0.8)
    handles = []
    for number, says in enumerate(data["says"].values):
        style = line_style(number)
        margins = np.asarray(data["design_margin_percent"].values[:, number], dtype=np.float64)
        look: dict[str, Any] = {"marker": style.marker, "markersize": 4}
        words = printable(str(says))
        # A straight line between two designs would not cross 0 at the limit that was found between them.
        limits = _limits(data, number, dim)
        places = np.append(x, limits)
        order = np.argsort(places, kind="stable")
        axes.plot(
            places[order],
            np.append(margins, np.zeros(limits.size))[order],
            color=style.color,
            linestyle=style.dash,
            clip_on=False,
            label=words,
            markevery=np.flatnonzero(order < x.size).tolist(),
            **look,
        )
        handles.append((style.handle(**look), words))
    if data[dim].dtype.kind in "fiu":
        _mark_declared(axes, data[dim])
        if _is_geometric(x):
            log_axis(axes, "x", dense=True, tick=lambda value, _: plain_number(value))
    else:
        axes.set_xticks(x, names)
    axes.set_yscale("symlog", linthresh=_LINEAR_WITHIN)
    axes.yaxis.set_major_formatter(FuncFormatter(_per_cent))
    axes.set(xlabel=axis_label(tree, data[dim]), ylabel="margin of the worst value")
    legend(figure, [one for one, _ in handles], [words for _, words in handles], columns=1)
    return figure


def _limits(data: xr.Dataset, requirement: int, dim: str) -> FloatArray:
    """The limits between which a requirement is met, in the units of the figure's axis."""
    if "met_from" not in data:
        return np.empty(0)
    ends = np.ravel(common_ranges(data, np.arange(data.sizes["requirement"]) == requirement))
    swept = np.asarray(data[dim].values, dtype=np.float64)
    return np.asarray(ends[(ends > swept.min()) & (ends < swept.max())] * axis_unit(data[dim])[0], dtype=np.float64)


def _map(tree: xr.DataTree, data: xr.Dataset, dims: tuple[str, str]) -> StudyFigure:
    """Draw contours of the least margin of the requirements that must hold; fill the dots of designs that meet all."""
    least = _least(data, dims)
    met = np.all(data["design_met"].transpose("requirement", dims[1], dims[0]).values[must_hold(data)] == 1, axis=0)
    (x, _), (y, _) = (axis_values(data[dim]) for dim in dims)
    figure = new_figure(2.3)
    axes = figure.subplots()
    levels = [level for level in _LEVELS if np.min(least) < level < np.max(least)]
    drawn = axes.contour(x, y, least, levels=levels, colors=SOFT, linewidths=0.7, linestyles="solid")
    axes.contour(x, y, least, levels=[0.0], colors=INK, linewidths=1.6)
    for label in axes.clabel(drawn, fmt=lambda value: _per_cent(value, 0), fontsize=SMALL, colors=INK):
        label.set(zorder=4, bbox={"facecolor": "white", "linewidth": 0.0, "pad": 0.6})  # above all dots and lines
    across, up = np.meshgrid(x, y)
    color = line_style(0).color
    dots: dict[str, Any] = {
        "linestyle": "",
        "marker": "o",
        "markersize": 3.5,
        "markeredgecolor": color,
        "clip_on": False,
    }
    axes.plot(across[~met], up[~met], markerfacecolor="white", markeredgewidth=0.5, **dots)
    axes.plot(across[met], up[met], markerfacecolor=color, **dots)
    _mark_declared(axes, data[dims[0]])
    _mark_declared(axes, data[dims[1]], upright=False)
    axes.margins(0.03)
    for name, values in (("x", x), ("y", y)):
        if _is_geometric(values):
            log_axis(axes, name, dense=True, tick=lambda value, _: plain_number(value))
    axes.set(xlabel=axis_label(tree, data[dims[0]]), ylabel=fill(axis_label(tree, data[dims[1]]), _LETTERS_UP))
    return figure


def _least(data: xr.Dataset, dims: Sequence[str]) -> FloatArray:
    """The least margin [%] of all requirements that must hold; columns over the first of two swept parameters."""
    every = data["design_margin_percent"].transpose("requirement", dims[1], dims[0])
    return np.asarray(np.min(every.values[must_hold(data)], axis=0), dtype=np.float64)


def _tables(tree: xr.DataTree, data: xr.Dataset, dims: Sequence[str]) -> Tables:
    """Make the table of margins of a map."""
    columns, rows = ([shown_value(data[dim], value) for value in data[dim].values] for dim in dims)
    across, up = (path_words(tree, dim) for dim in dims)
    least = _least(data, dims) / 100.0
    return (grid(f"Margin, {up} down and {across} across", [up, *columns], rows, least, FRACTION),)


def _is_geometric(values: FloatArray) -> bool:
    """Whether values are closer to a geometric than to an arithmetic sequence."""
    if not np.all(values > 0.0) or values.size <= _FEW:
        return False
    steps, factors = np.diff(values), np.diff(np.log(values))
    return bool(np.std(factors) / np.mean(factors) < np.std(steps) / np.mean(steps))


def _mark_declared(axes: Axes, coordinate: xr.DataArray, *, upright: bool = True) -> None:
    declared = coordinate.attrs.get("declared", "")
    if isinstance(declared, str):
        return
    mark = axes.axvline if upright else axes.axhline
    mark(declared * axis_unit(coordinate)[0], color=INK, linewidth=0.8, linestyle=(0, (3, 2)))


def _per_cent(value: float, _position: float | FloatArray) -> str:
    return f"{value:+g} %".replace("-", "−") if value else "0"

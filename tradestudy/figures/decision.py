"""Figures of decisions: readings that flip the verdict, ranks, worths of assumptions, and margins of requirements."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from textwrap import fill, wrap
from typing import Any

import matplotlib
import numpy as np
import numpy.typing as npt
import xarray as xr
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter

from tradestudy.figures.curves import NamedCurve, name_ends
from tradestudy.figures.drawing import Drawing
from tradestudy.figures.fonts import printable
from tradestudy.figures.style import (
    DECLARED,
    FAINT,
    INK,
    PANEL_TITLE,
    PANELS_IN_A_ROW,
    SMALL,
    SOFT,
    StudyFigure,
    camera_panels,
    legend,
    letters_on,
    line_style,
    log_axis,
    new_figure,
    plain_number,
    readable,
    shortened,
    styled,
)
from tradestudy.figures.sweeps import axis_label, axis_unit, axis_values, shown_value
from tradestudy.figures.value_tables import Tables, grid, rank_tables
from tradestudy.results.views.conclusions import worths
from tradestudy.results.views.designs import common_ranges, must_hold, parameter_words, path_words
from tradestudy.results.views.finding import MOST_CURVES
from tradestudy.results.views.groups import FloatArray, camera_titles, group
from tradestudy.results.views.requirement_conclusions import requirement_conclusions, requirement_sentence
from tradestudy.results.views.trade_off import candidates_by_rank
from tradestudy.units import FRACTION, pretty
from tradestudy.wording import counted, distance

ERROR_SOURCE_TITLES = {"both": "noise and calibration", "noise": "noise only", "calibration": "calibration only"}
_ROW = 0.27  # inches
_STEP = 0.12  # of a row: the offset between successive places, which separates marks of similar ratios


@styled()
def draw_readings(tree: xr.DataTree) -> StudyFigure:
    """Draw the ratio of the uncertainties by error source: one row per reading, one mark per declared distance."""
    decision = tree["decision"].to_dataset()
    ratio = decision["uncertainty_ratio"]
    titles = {key: shortened(title, 28) for key, title in camera_titles(tree).items()}
    names = [str(reading) for reading in ratio["reading"].values]
    places = np.asarray(ratio["place"].values, dtype=np.float64)
    figure = new_figure(1.35 + _ROW * len(names))
    panels = figure.subplots(1, len(ERROR_SOURCE_TITLES), sharey=True, width_ratios=(2.2, 1.0, 1.0))
    for axes, (error_source, title) in zip(panels, ERROR_SOURCE_TITLES.items(), strict=True):
        _panel(
            axes,
            np.asarray(ratio.sel(error_source=error_source).values, dtype=np.float64),
            decision["certainty_flips"].sel(error_source=error_source).values,
        )
        axes.set_title(title, fontsize=PANEL_TITLE)
    first, second = titles[decision.attrs["first"]], titles[decision.attrs["second"]]
    panels[0].set(
        yticks=range(len(names)),
        yticklabels=[shortened(reading, 30) for reading in names],
        ylim=(len(names) - 0.4, -0.6),
        xlabel=f"uncertainty of {first}\nover that of {second}",
    )
    panels[0].get_yticklabels()[0].set_fontweight("bold")
    for axes in panels[1:]:
        axes.set_xlabel("the same ratio")
    handles = [_mark(order, len(places), filled=True) for order in range(len(places))]
    handles.append(_mark(0, 1, filled=False))
    labels = [
        *(f"at {distance(place)}" for place in places),
        "open: reversed",
    ]
    legend(figure, handles, labels, columns=min(len(labels), 4))
    return figure


def _place_color(order: int, count: int) -> Any:
    """From dark (near) to light (far), an order that colour-blind readers and grey prints keep."""
    return colormaps["cividis"](0.85 * order / max(count - 1, 1))


def _mark(order: int, count: int, *, filled: bool) -> Line2D:
    color = _place_color(order, count) if filled else SOFT
    return Line2D(
        [],
        [],
        linestyle="",
        marker=line_style(order).marker,
        markersize=4.2,
        color=color,
        markerfacecolor=color if filled else "white",
        markeredgecolor=INK,  # visible on light and dark pages, unlike some colours of the places
        markeredgewidth=0.6,
    )


def _panel(axes: Axes, ratio: FloatArray, flips: npt.NDArray[np.bool_]) -> None:
    """Draw all marks of one panel; `ratio` and `flips` have shape (reading, place)."""
    finite = ratio[np.isfinite(ratio) & (ratio > 0)]
    low, high = (min(float(finite.min()), 0.5), max(float(finite.max()), 2.0)) if finite.size else (0.5, 2.0)
    low, high = low / 1.4, high * 1.4
    log_axis(axes, "x", ends=(low, high))
    axes.set_xlim(low, high)
    axes.axvspan(low, 1, color=FAINT, alpha=0.5, linewidth=0, zorder=0)
    axes.axvline(1, color=INK, linewidth=0.9, zorder=0.9)
    axes.grid(visible=True, axis="y", linewidth=0.4)
    rows, places = ratio.shape
    shift = _STEP * (np.arange(places) - (places - 1) / 2.0)
    marked = np.isfinite(ratio) & (ratio > 0.0)
    drawn = np.column_stack([marked, np.ones(rows, dtype=bool)])  # a gap ends the line of each row
    across, up = np.full(drawn.shape, np.nan), np.full(drawn.shape, np.nan)
    across[:, :-1], up[:, :-1] = ratio, np.arange(rows)[:, None] + shift
    axes.plot(across[drawn], up[drawn], color=SOFT, linewidth=0.6, zorder=1)
    for place in range(places):
        y = np.arange(rows) + shift[place]
        for filled in (True, False):
            keep = np.isfinite(ratio[:, place]) & (flips[:, place].astype(bool) != filled)
            if keep.any():
                mark = _mark(place, places, filled=True)
                face = mark.get_markerfacecolor() if filled else "white"
                mark.set_data(ratio[keep, place], y[keep])
                mark.set_markerfacecolor(face)
                axes.add_line(mark)
    _unbounded(axes, ratio)


def _unbounded(axes: Axes, ratio: FloatArray) -> None:
    """Write ratios of 0 and ∞, which no logarithmic axis contains, at the edge of the panel, coloured like marks."""
    places = ratio.shape[1]
    for value, text, edge, side in ((np.inf, "∞", 1.0, -1), (0.0, "0", 0.0, 1)):
        for row, here in enumerate(ratio == value):
            for count, place in enumerate(np.flatnonzero(here)):
                axes.annotate(
                    text,
                    (edge, row),
                    xycoords=("axes fraction", "data"),
                    xytext=(side * (3 + 8 * count), 0),
                    textcoords="offset points",
                    color=readable(to_hex(_place_color(int(place), places))),
                    ha="left" if side > 0 else "right",
                    va="center",
                    fontsize=8,
                )


ERROR_SOURCE_WORDS = {"calibration": "calibration alone", "both": "single measurements"}
_LETTERS = 22  # in a line of the title of a panel a third of a page wide


@styled()
def draw_rank_probability(tree: xr.DataTree) -> StudyFigure:
    """Draw the probability that the first camera of a pair errs less against distance, with a panel for each pair."""
    data, titles = group(tree, "decision"), camera_titles(tree)
    distance = np.asarray(data["rank_distance"].values, dtype=np.float64)
    pairs = list(zip(data["pair_first"].values, data["pair_second"].values, strict=True))
    figure = new_figure(0.4 + 1.7 * -(-len(pairs) // PANELS_IN_A_ROW))
    panels = camera_panels(figure, len(pairs), distance, dense=len(pairs) == 1)
    letters = _LETTERS * PANELS_IN_A_ROW // min(PANELS_IN_A_ROW, len(pairs))
    for axes, pair, (first, second) in zip(panels, data["pair"].values, pairs, strict=True):
        error_sources = enumerate(data["rank_error_source"].values)
        lines = [
            _line(axes, distance, data.sel(pair=pair, rank_error_source=error_source), order)
            for order, error_source in error_sources
        ]
        axes.axhline(0.5, color=SOFT, linewidth=0.8, zorder=0)
        axes.set_ylim(0.0, 1.0)
        if axes in (*panels[PANELS_IN_A_ROW - 1 :: PANELS_IN_A_ROW], panels[-1]):  # only the last panel of a row
            name_ends(axes, lines)
        words = printable(f"{titles[str(first)]} more accurate than {titles[str(second)]}")
        axes.set_title("\n".join(wrap(words, letters)), fontsize=PANEL_TITLE)
    panels[0].set(yticks=[0.0, 0.5, 1.0], yticklabels=["0", "50 %", "100 %"])
    for axes in panels[::PANELS_IN_A_ROW]:
        axes.set_ylabel("probability")
    return figure


def _line(axes: Axes, distance: FloatArray, ranks: xr.Dataset, order: int) -> NamedCurve:
    style = line_style(order)
    seen = np.asarray((ranks["rank_first"] + ranks["rank_second"]).values, dtype=np.float64) > 0.0
    first = np.where(seen, np.asarray(ranks["rank_first"].values, dtype=np.float64), np.nan)
    error = 2.0 * np.asarray(ranks["rank_first_error"].values, dtype=np.float64)
    label = ERROR_SOURCE_WORDS[str(ranks["rank_error_source"].item())]
    axes.fill_between(distance, first - error, first + error, color=style.color, alpha=0.2, linewidth=0, label=label)
    axes.plot(distance, first, color=style.color, linestyle=style.dash, label=label)
    return NamedCurve(name=label, color=style.color, x=distance, y=first)


_MOST = 10
_LONGEST = 40
_LEAST_NAMED = 9.0  # per cent: parts of a bar at least this wide have room for a name


def rank_drawings(tree: xr.DataTree) -> Iterator[Drawing]:
    """The figure of a study that weighs criteria; none for any other, or for a single candidate."""
    candidates = candidates_by_rank(tree)[:_MOST]
    if len(candidates) <= 1:
        return
    listed_values = "; ".join(
        f"{candidate.title} {pretty(candidate.ranks[0], FRACTION, 2)}" for candidate in candidates
    )
    yield Drawing(
        name="rank_acceptability",
        caption="Fraction of the possible weights under which each candidate takes each rank, the first rank darkest.",
        alt=f"Fraction of the possible weights that rank each candidate first: {listed_values}.",
        draw=lambda: draw_ranks(tree),
        values=lambda: rank_tables(tree),
    )


@styled()
def draw_ranks(tree: xr.DataTree) -> StudyFigure:
    """Draw one bar for each candidate, divided into its ranks; on top, the candidate that ranks first most often."""
    candidates = candidates_by_rank(tree)[:_MOST]
    count = len(candidates[0].ranks)
    figure = new_figure(0.6 + 0.26 * len(candidates))
    axes = figure.subplots()
    colors = matplotlib.colormaps["cividis"](np.linspace(0.0, 0.95, count))
    places = np.arange(len(candidates))[::-1]
    begin = np.zeros(len(candidates))
    for rank in range(count):
        widths = 100.0 * np.array([candidate.ranks[rank] for candidate in candidates])
        axes.barh(places, widths, left=begin, height=0.7, color=colors[rank], edgecolor="white", linewidth=0.5)
        for place, start, width in zip(places, begin, widths, strict=True):
            if width > _LEAST_NAMED:
                axes.text(
                    start + width / 2.0, place, f"rank {rank + 1}", color=letters_on(to_hex(colors[rank])),
                    fontsize=SMALL, ha="center", va="center", gid=DECLARED,
                )  # fmt: skip
        begin += widths
    axes.set_yticks(places, [shortened(candidate.title, _LONGEST) for candidate in candidates])
    axes.set_xlim(0.0, 100.0)
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g} %"))
    axes.set_xlabel("fraction of the possible weights")
    return figure


def worth_drawings(tree: xr.DataTree) -> Iterator[Drawing]:
    """The figure of a study that asks for the worth of its assumptions; none for any other."""
    assumptions = worths(tree)[:_MOST]
    if not assumptions:
        return
    listed_values = "; ".join(
        f"{assumption.says} {pretty(assumption.worth, FRACTION, digits=2)}" for assumption in assumptions
    )
    yield Drawing(
        name="assumption_worths",
        caption="Worth of knowing each assumption before choosing a camera: the average reduction of relative depth "
        "uncertainty; bars span one standard error to either side.",
        alt=f"Worth of knowing each assumption: {listed_values}.",
        draw=lambda: draw_worths(tree),
    )


@styled()
def draw_worths(tree: xr.DataTree) -> StudyFigure:
    """Draw a dot with its standard error for each assumption, the most valuable on top."""
    assumptions = worths(tree)[:_MOST]
    figure = new_figure(0.8 + 0.3 * len(assumptions))
    axes = figure.subplots()
    places = np.arange(len(assumptions))[::-1]
    style = line_style(0)
    axes.errorbar(
        [100.0 * assumption.worth for assumption in assumptions],
        places,
        xerr=[100.0 * assumption.error for assumption in assumptions],
        fmt=style.marker,
        color=style.color,
        markersize=5,
        capsize=3,
        label="worth",
    )
    axes.axvline(0.0, color=INK, linewidth=0.8)
    axes.set_yticks(places, [printable(shortened(assumption.says, _LONGEST)) for assumption in assumptions])
    axes.set_ylim(-0.6, len(assumptions) - 0.4)
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g} %"))
    axes.set_xlabel("worth, as a fraction of the distance")
    return figure


_FEW = 2
_LETTERS_UP = 30  # in a line of the label of the vertical axis
_LEVELS = (-50.0, -20.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0)  # contours of margin [%], besides 0
_LINEAR_WITHIN = 10.0  # per cent: margins beyond are on a logarithmic scale


def margin_drawings(tree: xr.DataTree) -> Iterator[Drawing]:
    """The figure of a study that sweeps one or two parameters and has requirements; none for any other."""
    if "requirements" not in tree.children or "design_met" not in tree["requirements"].data_vars:
        return
    data = tree["requirements"].to_dataset()
    dims = _swept(data)
    if not np.isfinite(data["design_margin_percent"].values).any():  # no requirement can fail, or none can be decided
        return
    if len(dims) > 2 or (len(dims) == 2 and any(data[dim].dtype.kind not in "fiu" for dim in dims)):
        return
    if len(dims) == 2 and np.ptp(_least(data, dims)) == 0.0:  # equal margins have no contours
        return
    names = parameter_words(tree, dims)
    conclusions = "; ".join(
        requirement_sentence(conclusion) for conclusion in requirement_conclusions(tree)[:MOST_CURVES]
    )
    left = data.sizes["requirement"] - MOST_CURVES if len(dims) == 1 else 0
    more = f" {counted(left, 'other requirement')}: section “Requirements”." if left > 0 else ""
    shown = "Smallest margin of the requirements that must be met" if len(dims) == 2 else "Margin of each requirement"
    marks = (
        "Thick line: a margin of 0. Filled dots: designs that meet all of them."
        if len(dims) == 2
        else "A requirement is met where its margin is positive. Marks: computed designs; the curves cross 0 at the "
        "limits found between them. Shaded: all requirements that must be met are met."
    )
    yield Drawing(
        name="requirement_margins",
        caption=f"{shown}, against the {names}. {marks} "
        "Dashed: the study as declared. A margin of −30 %: not usable over 30 % of the required distances, on a "
        f"logarithmic scale.{more}",
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
    return [str(dim) for dim in data["design_met"].dims if dim != "requirement"]


def _curves(tree: xr.DataTree, data: xr.Dataset, dim: str) -> StudyFigure:
    x, names = axis_values(data[dim])
    figure = new_figure(2.8)
    axes = figure.subplots()
    if "met_from" in data:
        factor = axis_unit(data[dim])[0]
        for low, high in common_ranges(data, must_hold(data)):
            axes.axvspan(low * factor, high * factor, color=SOFT, alpha=0.3, linewidth=0)
    axes.axhline(0.0, color=INK, linewidth=0.8)
    drawn = []
    for number in _deciding(data):
        style, words = line_style(number), printable(str(data["says"].values[number]))
        margins = np.asarray(data["design_margin_percent"].values[:, number], dtype=np.float64)
        # A straight line between two designs would not cross 0 at the limit that was found between them.
        limits = _limits(data, number, dim)
        places = np.append(x, limits)
        order = np.argsort(places, kind="stable")
        curve = NamedCurve(
            name=words, color=style.color, x=places[order], y=np.append(margins, np.zeros(limits.size))[order]
        )
        axes.plot(
            curve.x,
            curve.y,
            color=style.color,
            linestyle=style.dash,
            clip_on=False,
            label=words,
            marker=style.marker,
            markersize=4,
            markevery=np.flatnonzero(order < x.size).tolist(),
        )
        drawn.append(curve)
    if data[dim].dtype.kind in "fiu":
        _mark_declared(axes, data[dim])
        if _is_geometric(x):
            ends = float(x.min()), float(x.max())
            log_axis(axes, "x", dense=True, tick=lambda value, _: plain_number(value), ends=ends)
    else:
        axes.set_xticks(x, names)
    axes.set_yscale("symlog", linthresh=_LINEAR_WITHIN)
    axes.yaxis.set_major_formatter(FuncFormatter(_per_cent))
    axes.set(xlabel=axis_label(tree, data[dim]), ylabel="margin of the worst value")
    name_ends(axes, drawn)
    axes.text(
        0.01,
        0.0,
        "met above",
        transform=axes.get_yaxis_transform(),
        fontsize=SMALL,
        va="bottom",
        color=INK,
        gid=DECLARED,
    )
    return figure


def _deciding(data: xr.Dataset) -> list[int]:
    """The requirements with the smallest margins in the declared study, those that must hold first; at most three."""
    margins = np.nan_to_num(np.asarray(data["margin_percent"].values, dtype=np.float64), nan=-np.inf)
    order = np.lexsort((margins, ~must_hold(data)))
    return sorted(order[:MOST_CURVES].tolist())


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
    for axis, values in (("x", x), ("y", y)):
        if _is_geometric(values):
            ends = float(values.min()), float(values.max())
            log_axis(axes, axis, dense=True, tick=lambda value, _: plain_number(value), ends=ends)
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

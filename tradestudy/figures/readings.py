"""Readings that flip the verdict: the ratio of the pair's uncertainties under each reading."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.lines import Line2D

from tradestudy.figures.style import (
    FAINT,
    INK,
    PANEL_TITLE,
    SOFT,
    StudyFigure,
    legend,
    line_style,
    log_axis,
    new_figure,
    readable,
    shortened,
    styled,
)
from tradestudy.results.views.groups import FloatArray, camera_titles
from tradestudy.wording import distance

ERROR_SOURCE_TITLES = {"both": "noise and calibration", "noise": "noise only", "calibration": "calibration only"}
_ROW = 0.27  # inches
_STEP = 0.12  # of a row: the offset between successive places, which separates marks of similar ratios


@styled()
def draw_readings(tree: xr.DataTree) -> StudyFigure:
    """Draw the ratio of the uncertainties by error source: one row per reading, one mark per declared distance."""
    decision = tree["decision"].to_dataset()
    ratio = decision["uncertainty_ratio"]
    titles = {key: shortened(title, 28) for key, title in camera_titles(tree).items()}
    names = [str(name) for name in ratio["reading"].values]
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
        yticklabels=[shortened(name, 30) for name in names],
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
    known = np.column_stack([marked, np.ones(rows, dtype=bool)])  # a gap ends the line of each row
    across, up = np.full(known.shape, np.nan), np.full(known.shape, np.nan)
    across[:, :-1], up[:, :-1] = ratio, np.arange(rows)[:, None] + shift
    axes.plot(across[known], up[known], color=SOFT, linewidth=0.6, zorder=1)
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

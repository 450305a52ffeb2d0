"""Under which reading of the open questions the verdict flips: the ratio of the two best uncertainties per reading."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

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
    printable,
    shortened,
    styled,
)

if TYPE_CHECKING:
    import xarray as xr

WAY_TITLES = {"both": "noise and calibration", "noise": "noise only", "calibration": "calibration only"}
_WAY_MARKERS = {"both": "D", "noise": "o", "calibration": "s"}
_ROW = 0.3  # inches


def readings(tree: xr.DataTree) -> StudyFigure:
    """One panel per declared distance, one row per reading: the ratio of the uncertainties, 1 marked."""
    with styled():
        ratio = tree["decision"].to_dataset()["decision_ratio"]
        names = [str(name) for name in ratio["reading"].values]
        places = np.asarray(ratio["place"].values, dtype=float)
        figure = new_figure(1.75 + _ROW * len(names))
        panels = figure.subplots(1, len(places), sharex=True, sharey=True, squeeze=False)[0]
        finite = ratio.values[np.isfinite(ratio.values) & (ratio.values > 0)]
        reach = 1.3 * max(float(np.exp(np.abs(np.log(finite)).max())), 3.0) if finite.size else 3.0
        for axes, place in zip(panels, places, strict=True):
            _panel(axes, ratio.sel(place=place), reach)
            axes.set_title(f"at {plain_number(place)} m")
        panels[0].set_yticks(range(len(names)), [shortened(name) for name in names])
        panels[0].get_yticklabels()[0].set_fontweight("bold")
        panels[0].set_ylim(len(names) - 0.4, -0.6)
        numerator, denominator = (
            printable(str(ratio.attrs["numerator"])),
            printable(str(ratio.attrs["denominator"])),
        )
        panels[len(panels) // 2].set_xlabel(f"uncertainty of {numerator} / uncertainty of {denominator}")
        ways = [str(way) for way in ratio["way"].values]
        handles = [_marker(way) for way in ways]
        handles.append(Line2D([], [], color=SOFT, marker=_WAY_MARKERS["both"], markerfacecolor="white", linestyle=""))
        labels = [*(WAY_TITLES[way] for way in ways), "open: other winner than in the first reading"]
        legend(figure, handles, labels, columns=2)
    return figure


def _marker(way: str) -> Line2D:
    order = list(WAY_TITLES).index(way)
    return Line2D([], [], color=line_style(order).color, marker=_WAY_MARKERS[way], linestyle="", markersize=4)


def _panel(axes: Axes, ratio: xr.DataArray, reach: float) -> None:
    log_axis(axes, "x", dense=reach < 12)
    axes.set_xlim(1 / reach, reach)
    axes.axvspan(1 / reach, 1, color=FAINT, alpha=0.5, linewidth=0, zorder=0)
    axes.axvline(1, color=INK, linewidth=0.9, zorder=0.9)
    axes.grid(visible=True, axis="y", linewidth=0.4)
    ways = [str(way) for way in ratio["way"].values]
    for index, way in enumerate(ways):
        values = np.asarray(ratio.sel(way=way).values, dtype=float)
        rows = np.arange(len(values)) + 0.2 * (index - (len(ways) - 1) / 2)
        flipped = (values > 1) != (values[0] > 1)
        color = _marker(way).get_color()
        for subset, face in ((~flipped, color), (flipped, "white")):
            keep = subset & np.isfinite(values)
            if not keep.any():
                continue  # an empty line that is not clipped would count as a point at the origin in the layout
            axes.plot(
                values[keep],
                rows[keep],
                linestyle="",
                marker=_WAY_MARKERS[way],
                markersize=4.5 if way == "both" else 3.2,
                color=color,
                markerfacecolor=face,
                markeredgewidth=0.9,
                clip_on=False,
            )

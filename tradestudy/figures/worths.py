"""The worth of knowing each assumption."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.ticker import FuncFormatter

from tradestudy.figures.drawing import Drawing
from tradestudy.figures.fonts import printable
from tradestudy.figures.style import INK, StudyFigure, line_style, new_figure, shortened, styled
from tradestudy.results.views.conclusions import worths
from tradestudy.units import FRACTION, pretty

_MOST = 10
_LONGEST = 40


def worths_drawing(tree: xr.DataTree) -> Drawing | None:
    """The figure of a study that asks for the worth of its assumptions; None for any other."""
    found = worths(tree)[:_MOST]
    if not found:
        return None
    listed_values = "; ".join(f"{one.says} {pretty(one.worth, FRACTION, digits=2)}" for one in found)
    return Drawing(
        name="assumption_worths",
        caption="Worth of knowing each assumption before choosing a camera: the average reduction of relative depth "
        "uncertainty; bars span one standard error to either side.",
        alt=f"Worth of knowing each assumption: {listed_values}.",
        draw=lambda: draw_worths(tree),
    )


@styled()
def draw_worths(tree: xr.DataTree) -> StudyFigure:
    """Draw a dot with its standard error for each assumption, the most valuable on top."""
    found = worths(tree)[:_MOST]
    figure = new_figure(0.8 + 0.3 * len(found))
    axes = figure.subplots()
    places = np.arange(len(found))[::-1]
    style = line_style(0)
    axes.errorbar(
        [100.0 * one.worth for one in found],
        places,
        xerr=[100.0 * one.error for one in found],
        fmt=style.marker,
        color=style.color,
        markersize=5,
        capsize=3,
        label="worth",
    )
    axes.axvline(0.0, color=INK, linewidth=0.8)
    axes.set_yticks(places, [printable(shortened(one.says, _LONGEST)) for one in found])
    axes.set_ylim(-0.6, len(found) - 0.4)
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g} %"))
    axes.set_xlabel("worth, as a fraction of the distance")
    return figure

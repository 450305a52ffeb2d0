"""The fraction of the possible weights under which each candidate takes each rank."""

from __future__ import annotations

import matplotlib
import numpy as np
import xarray as xr
from matplotlib.colors import to_hex
from matplotlib.ticker import FuncFormatter

from tradestudy.figures.drawing import Drawing
from tradestudy.figures.style import DECLARED, SMALL, StudyFigure, letters_on, new_figure, shortened, styled
from tradestudy.figures.value_tables import rank_tables
from tradestudy.results.views.trade_off import candidates_by_rank
from tradestudy.units import FRACTION, pretty

_MOST = 10
_LONGEST = 40
_LEAST_NAMED = 9.0  # per cent: parts of a bar at least this wide have room for a name


def rank_drawing(tree: xr.DataTree) -> Drawing | None:
    """The figure of a study that weighs criteria; None for any other, or for a single candidate."""
    found = candidates_by_rank(tree)[:_MOST]
    if len(found) <= 1:
        return None
    listed_values = "; ".join(f"{one.title} {pretty(one.ranks[0], FRACTION, 2)}" for one in found)
    return Drawing(
        name="rank_acceptability",
        caption="Fraction of the possible weights under which each candidate takes each rank, the first rank darkest.",
        alt=f"Fraction of the possible weights that rank each candidate first: {listed_values}.",
        draw=lambda: draw_ranks(tree),
        values=lambda: rank_tables(tree),
    )


@styled()
def draw_ranks(tree: xr.DataTree) -> StudyFigure:
    """Draw one bar for each candidate, divided into its ranks; on top, the candidate that ranks first most often."""
    found = candidates_by_rank(tree)[:_MOST]
    count = len(found[0].ranks)
    figure = new_figure(0.6 + 0.26 * len(found))
    axes = figure.subplots()
    colors = matplotlib.colormaps["cividis"](np.linspace(0.0, 0.95, count))
    places = np.arange(len(found))[::-1]
    begin = np.zeros(len(found))
    for rank in range(count):
        widths = 100.0 * np.array([one.ranks[rank] for one in found])
        axes.barh(places, widths, left=begin, height=0.7, color=colors[rank], edgecolor="white", linewidth=0.5)
        for place, start, width in zip(places, begin, widths, strict=True):
            if width > _LEAST_NAMED:
                axes.text(
                    start + width / 2.0, place, f"rank {rank + 1}", color=letters_on(to_hex(colors[rank])),
                    fontsize=SMALL, ha="center", va="center", gid=DECLARED,
                )  # fmt: skip
        begin += widths
    axes.set_yticks(places, [shortened(one.title, _LONGEST) for one in found])
    axes.set_xlim(0.0, 100.0)
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g} %"))
    axes.set_xlabel("fraction of the possible weights")
    return figure

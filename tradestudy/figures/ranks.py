"""Which camera has the smaller error: probabilities of the ranks of pairs of cameras against distance."""

from __future__ import annotations

from textwrap import wrap

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from tradestudy.figures.curves import NamedCurve, name_ends
from tradestudy.figures.fonts import printable
from tradestudy.figures.style import (
    PANEL_TITLE,
    PANELS_IN_A_ROW,
    SOFT,
    StudyFigure,
    camera_panels,
    line_style,
    new_figure,
    styled,
)
from tradestudy.results.views.groups import FloatArray, camera_titles, group

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


def _line(axes: Axes, distance: FloatArray, there: xr.Dataset, order: int) -> NamedCurve:
    style = line_style(order)
    seen = np.asarray((there["rank_first"] + there["rank_second"]).values, dtype=np.float64) > 0.0
    first = np.where(seen, np.asarray(there["rank_first"].values, dtype=np.float64), np.nan)
    error = 2.0 * np.asarray(there["rank_first_error"].values, dtype=np.float64)
    label = ERROR_SOURCE_WORDS[str(there["rank_error_source"].item())]
    axes.fill_between(distance, first - error, first + error, color=style.color, alpha=0.2, linewidth=0, label=label)
    axes.plot(distance, first, color=style.color, linestyle=style.dash, label=label)
    return NamedCurve(name=label, color=style.color, x=distance, y=first)

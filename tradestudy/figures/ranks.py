"""Who errs less: probabilities of the ranks of pairs of cameras against distance."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from tradestudy.figures.style import (
    FAINT,
    StudyFigure,
    distance_axis,
    distance_label,
    legend,
    line_style,
    new_figure,
    styled,
)
from tradestudy.results.views.groups import FloatArray, camera_titles, group

WAY_WORDS = {"calibration": "calibration alone", "both": "single readings"}


@styled()
def draw_rank_probability(tree: xr.DataTree) -> StudyFigure:
    """Probability that the first camera of each pair errs less, against distance; calibration alone, and with noise."""
    data, titles = group(tree, "decision"), camera_titles(tree)
    figure = new_figure(2.3 + 0.12 * data.sizes["pair"])
    panels = figure.subplots(1, data.sizes["rank_way"], sharex=True, sharey=True, squeeze=False)[0]
    distance = np.asarray(data["rank_distance"].values, dtype=np.float64)
    pairs = zip(data["pair_first"].values, data["pair_second"].values, strict=True)
    labels = [f"{titles[str(first)]} before {titles[str(second)]}" for first, second in pairs]
    for axes, way in zip(panels, data["rank_way"].values, strict=True):
        for order, (pair, label) in enumerate(zip(data["pair"].values, labels, strict=True)):
            _line(axes, distance, data.sel(pair=pair, rank_way=way), order, label)
        axes.axhline(0.5, color=FAINT, linewidth=0.8, zorder=0)
        distance_axis(axes, (float(distance[0]), float(distance[-1])))
        axes.set(title=WAY_WORDS[str(way)], ylim=(0.0, 1.0), xlabel=distance_label(float(distance[-1])))
    panels[0].set_ylabel("P(first errs less)")
    legend(figure, [line_style(order).handle() for order in range(len(labels))], labels, columns=2, longest=70)
    return figure


def _line(axes: Axes, distance: FloatArray, there: xr.Dataset, order: int, label: str) -> None:
    style = line_style(order)
    seen = np.asarray((there["rank_first"] + there["rank_second"]).values, dtype=np.float64) > 0.0
    first = np.where(seen, np.asarray(there["rank_first"].values, dtype=np.float64), np.nan)
    error = 2.0 * np.asarray(there["rank_first_error"].values, dtype=np.float64)
    axes.fill_between(distance, first - error, first + error, color=style.color, alpha=0.2, linewidth=0, label=label)
    axes.plot(distance, first, color=style.color, linestyle=style.dash, linewidth=1.3, label=label)

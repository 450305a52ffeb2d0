"""Depth of planes measured in their pictures, compared with the prediction, against distance."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from tradestudy.figures.curves import NamedCurve, name_ends
from tradestudy.figures.drawing import Drawing
from tradestudy.figures.style import (
    FAINT,
    INK,
    PANEL_TITLE,
    StudyFigure,
    distance_axis,
    distance_label,
    line_style,
    log_axis,
    new_figure,
    styled,
)
from tradestudy.results.views.groups import FloatArray, camera_titles, group, has
from tradestudy.units import significant
from tradestudy.wording import listed, span

_TOLERANCE = 0.1  # of the spread: how closely a fitted matcher should predict it at other distances
_LARGEST_BIAS = 0.05  # px
_MARGIN = 1.1  # the axis reaches this factor beyond the planes
_LARGEST_MARK = 6.5  # points
_PANELS = {
    "Spread of the depth errors": "spread [% of distance]",
    "Spread relative to that from noise": "ratio",
    "Standard deviation relative to the fitted matcher's prediction": "ratio",
    "Bias of the disparity": "bias [px]",
}


def depth_loop_drawings(tree: xr.DataTree) -> Iterator[Drawing]:
    """The figure of a study with a depth loop."""
    if not has(tree, "depth_loop", "depth_spread"):
        return
    data, titles = group(tree, "depth_loop"), camera_titles(tree)
    names = listed([titles[str(key)] for key in data["camera"].values])
    distance = data["distance"].values
    yield Drawing(
        name="depth_loop",
        caption="Depth of rendered planes, with standard errors. First: spread of the depth errors (marks: half their "
        "central 68.27 % interval) and the predicted depth uncertainty (curves). Second: spread of the errors, each "
        "divided by the standard deviation that noise causes in its matching window. Third: standard deviation of the "
        "errors without false matches, relative to the prediction of the matcher fitted at the distances with filled "
        "marks; grey: within 10 %. Fourth: bias of the disparity; grey: within 0.05 px.",
        alt=f"For {names}, from {span(float(distance[0]), float(distance[-1]))}: achieved and predicted spread, the "
        f"spread relative to noise and to the fitted matcher, and bias. Spread relative to that from noise: "
        f"{_noise_words(tree)}.",
        draw=lambda: draw_loop(tree),
    )


def _noise_words(tree: xr.DataTree) -> str:
    """The smallest and largest spread of each camera, relative to that from noise alone."""
    data, titles = group(tree, "depth_loop"), camera_titles(tree)
    words = []
    for key in data["camera"].values:
        values = np.asarray(data["depth_over_bound"].sel(camera=key).values, dtype=np.float64)
        known = values[np.isfinite(values)]
        spread = f"{significant(known.min())} to {significant(known.max())}" if known.size else "not measured"
        words.append(f"{titles[str(key)]} {spread}")
    return "; ".join(words)


@styled()
def draw_loop(tree: xr.DataTree) -> StudyFigure:
    """Draw four panels over distance, with a colour for each camera, and several contrasts and lights side by side."""
    data, titles = group(tree, "depth_loop"), camera_titles(tree)
    distance = data["distance"].values
    ends = float(distance[0]), float(distance[-1])
    names = [titles[str(name)] for name in data["camera"].values]
    figure = new_figure(6.6)
    panels = list(figure.subplots(4, 1, sharex=True))
    for axes, (title, label) in zip(panels, _PANELS.items(), strict=True):
        axes.set_ylabel(label)
        axes.set_title(title, fontsize=PANEL_TITLE)
    distance_axis(panels[0], (ends[0] / _MARGIN, ends[1] * _MARGIN), dense=True)
    panels[-1].set_xlabel(distance_label(ends[1]))
    log_axis(panels[0], "y")
    panels[1].axhline(1.0, color=INK, linewidth=0.6)
    panels[2].axhspan(1.0 - _TOLERANCE, 1.0 + _TOLERANCE, color=FAINT)
    panels[3].axhspan(-_LARGEST_BIAS, _LARGEST_BIAS, color=FAINT)
    drawn: list[list[NamedCurve]] = [[] for _ in panels]
    for k in range(len(names)):
        for c in range(data.sizes["contrast"]):
            for e in range(data.sizes["electrons"]):
                found = tuple(_draw(panels, data.isel(camera=k, contrast=c, electrons=e), k, names[k]))
        for curves, last in zip(drawn, found, strict=True):
            curves.append(last)
    for axes, curves in zip(panels, drawn, strict=True):
        axes.set_ylim(axes.get_ylim())
        name_ends(axes, curves)
    return figure


def _draw(panels: Sequence[Axes], one: xr.Dataset, order: int, label: str) -> Iterator[NamedCurve]:
    """Draw one camera in one texture and light, and yield its values in each panel."""
    style = line_style(order)
    distance = one["distance"].values
    predicted = one["depth_predicted"].values / distance * 100.0
    panels[0].plot(
        distance, predicted, color=style.color, linestyle=style.dash, linewidth=1.0, label=f"{label}, predicted"
    )
    scale = 100.0 / distance
    fitted = one["fitted"].values > 0.0
    # Later marks are smaller, and those not fitted are open, so that all marks at one place can be seen.
    size = max(_LARGEST_MARK - 1.0 * order, 3.0)
    for axes, (name, factor) in zip(panels, _values(scale), strict=True):
        values, errors = one[name].values * factor, one[f"{name}_error"].values * factor
        for among, filled in ((fitted, True), (~fitted, False)):
            axes.errorbar(
                distance[among],
                values[among],
                yerr=errors[among],
                fmt=style.marker,
                color=style.color,
                markerfacecolor=style.color if filled else "none",
                markersize=size,
                elinewidth=1.0,
                capsize=2.0,
                label=label,
            )
        yield NamedCurve(name=label, color=style.color, x=distance, y=values)


def _values(scale: FloatArray) -> tuple[tuple[str, FloatArray], ...]:
    """The variable that each panel shows, and the factor for its values."""
    same = np.ones_like(scale)
    return ("depth_spread", scale), ("depth_over_bound", same), ("over_matcher", same), ("depth_bias_px", same)

"""What depth uncertainty is made of: one panel per camera, one line per source of error."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from tradestudy.figures.style import (
    FAINT,
    INK,
    PANELS_IN_A_ROW,
    CameraTrace,
    StudyFigure,
    camera_panels,
    distance_axis,
    legend,
    length_tick,
    line_style,
    log_axis,
    new_figure,
    shortened,
    styled,
    traces,
)
from tradestudy.results.views.depth import nominal, of_camera, where_usable

MM = 1e3


def largest_by_part(depth: xr.Dataset) -> dict[str, float]:
    """The largest uncertainty [m] from each source of error over all cameras and distances; NaN where none has it.

    It is nothing for a source that cameras have but that moves no depth, as roll on the axis.
    """
    part = depth["depth_uncertainty_part"].transpose("part", ...)
    rows = part.values.reshape(part.sizes["part"], -1)
    known = np.where(np.isnan(rows), -np.inf, rows).max(axis=1)
    return {str(name): float(m) if m >= 0.0 else np.nan for name, m in zip(part["part"].values, known, strict=True)}


@styled()
def draw_uncertainty_parts(tree: xr.DataTree) -> StudyFigure:
    """Depth uncertainty of every camera and its parts against distance, both axes logarithmic."""
    depth, shown = nominal(tree), traces(tree)
    names = [name for name, largest in largest_by_part(depth).items() if largest > 0.0]
    figure = new_figure(0.6 + 1.85 * -(-len(shown) // PANELS_IN_A_ROW))
    panels = camera_panels(figure, len(shown), float(depth["distance"].values[-1]))
    for axes, camera in zip(panels, shown, strict=True):
        _panel(axes, depth, camera, names)
    for axes in panels[::PANELS_IN_A_ROW]:
        axes.set_ylabel("depth uncertainty")
    panels[0].set_ylim(*_limits(depth))
    styles = [line_style(order + 1) for order in range(len(names))]
    handles = [Line2D([], [], color=INK, linewidth=2.2)]
    handles += [style.handle(marker=style.marker, markersize=3, linewidth=1.1) for style in styles]
    legend(figure, handles, ["all together", *(name.replace("_", " ") for name in names)], columns=4)
    return figure


def _limits(depth: xr.Dataset) -> tuple[float, float]:
    """Four decades down from the largest total that is not beyond the distance itself."""
    total = depth["depth_uncertainty"].values
    finite = total[np.isfinite(total) & (total > 0)] * MM
    if not finite.size:
        return 1e-3, 1e3
    top = min(float(finite.max()), float(depth["distance"].values[-1]) * MM) * 2.0
    return max(float(finite.min()) / 30.0, top * 1e-7), top


def _panel(axes: Axes, depth: xr.Dataset, camera: CameraTrace, names: list[str]) -> None:
    distance = np.asarray(depth["distance"].values, dtype=float)
    for near, far in where_usable(depth, camera.key):
        axes.axvspan(near, min(far, float(distance[-1])), color=FAINT, alpha=0.45, linewidth=0, zorder=0)
    total = of_camera(depth, "depth_uncertainty", camera.key) * MM
    axes.plot(distance, np.where(np.isfinite(total), total, np.nan), color=INK, linewidth=2.2)
    for order, name in enumerate(names):
        values = of_camera(depth, "depth_uncertainty_part", camera.key, part=name) * MM
        if not np.isfinite(values).any():
            continue
        style = line_style(order + 1)
        spots = np.linspace(0, len(distance) - 1, 5).astype(int)[1:-1] + 4 * order
        axes.plot(
            distance,
            np.where(np.isfinite(values) & (values > 0), values, np.nan),
            color=style.color,
            linestyle=style.dash,
            linewidth=1.1,
            marker=style.marker,
            markersize=3,
            markevery=[int(spot) % len(distance) for spot in spots],
        )
    distance_axis(axes, (float(distance[0]), float(distance[-1])))
    log_axis(axes, "y", tick=length_tick)
    axes.set_title(shortened(camera.title, 34), fontsize=7.5)

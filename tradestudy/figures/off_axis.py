"""Depth uncertainty off the axis compared with that on it, one panel per camera."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from tradestudy.figures.style import (
    INK,
    PANEL_TITLE,
    PANELS_IN_A_ROW,
    CameraTrace,
    StudyFigure,
    camera_panels,
    legend,
    length_tick,
    line_style,
    log_axis,
    new_figure,
    shortened,
    styled,
    traces,
)
from tradestudy.results.views.depth import field_words, nominal, of_camera, worst_corner
from tradestudy.results.views.groups import FloatArray, group

MM = 1e3


@styled()
def draw_off_axis(tree: xr.DataTree) -> StudyFigure:
    """Draw depth uncertainty against distance on the axis (thick) and at every declared field position.

    Off the axis, the corner with the largest uncertainty counts.
    """
    depth, off, shown = nominal(tree), group(tree, "depth_field"), traces(tree)
    fields = [float(field) for field in off["field"].values]
    figure = new_figure(0.7 + 1.6 * -(-len(shown) // PANELS_IN_A_ROW))
    panels = camera_panels(figure, len(shown), depth["distance"].values)
    for axes, camera in zip(panels, shown, strict=True):
        _panel(axes, depth, off, camera)
    log_axis(panels[0], "y", tick=length_tick)
    panels[0].set_ylim(*_limits(depth))
    for axes in panels[::PANELS_IN_A_ROW]:
        axes.set_ylabel("uncertainty (68 %)")
    handles = [line_style(0).handle(color=INK, linestyle="-", linewidth=2.0)]
    handles += [line_style(order + 1).handle() for order in range(len(fields))]
    legend(figure, handles, [field_words(field) for field in (0.0, *fields)], columns=3)
    return figure


def _limits(depth: xr.Dataset) -> tuple[float, float]:
    """Limits [mm] that contain the known values on the axis, up to the farthest distance."""
    values = np.asarray(depth["depth_uncertainty"].values, dtype=np.float64)
    values = values[np.isfinite(values) & (values > 0.0)] * MM
    if not values.size:
        return 1e-3, 1e3
    return float(values.min()) / 2.0, 2.0 * min(float(values.max()), float(depth["distance"].values[-1]) * MM)


def _panel(axes: Axes, depth: xr.Dataset, off: xr.Dataset, camera: CameraTrace) -> None:
    distance = np.asarray(depth["distance"].values, dtype=np.float64)
    axes.plot(
        distance,
        _drawn(of_camera(depth, "depth_uncertainty", camera.key)),
        color=INK,
        linewidth=2.0,
        label=field_words(0.0),
    )
    for order, field in enumerate(off["field"].values):
        style = line_style(order + 1)
        there = np.asarray(worst_corner(off).sel(field=field, camera=camera.key).values, dtype=np.float64)
        axes.plot(
            off["distance"].values,
            _drawn(there),
            color=style.color,
            linestyle=style.dash,
            linewidth=1.3,
            label=field_words(float(field)),
        )
    axes.set_title(shortened(camera.title, 34), fontsize=PANEL_TITLE)


def _drawn(metres: FloatArray) -> FloatArray:
    return np.where(np.isfinite(metres) & (metres > 0.0), metres * MM, np.nan)

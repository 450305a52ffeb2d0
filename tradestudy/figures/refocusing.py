"""The planes on which unfocused plenoptic cameras can refocus, with both depths of field."""

from __future__ import annotations

from functools import partial
from typing import Any, Final

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from tradestudy.figures.drawing import Drawing
from tradestudy.figures.style import SOFT, StudyFigure, distance_tick, legend, line_style, log_axis, new_figure, styled
from tradestudy.results.views.refocusing import refocused_cameras, refocusing_words

_MOST: Final = 4  # cameras, each with a panel of its own
_PALE: Final = 0.35
_WIDE, _THIN = 5.0, 1.0  # points: lines of the limits by blur and by rays


def refocusing_drawing(tree: xr.DataTree) -> Drawing:
    """Distance against shift, and the limits of the depth of field of every plane."""
    cameras = list(refocused_cameras(tree))
    left = f" The figure shows {_MOST} of {len(cameras)} cameras." if len(cameras) > _MOST else ""
    finding = ". ".join(list(refocusing_words(tree))[:_MOST])
    return Drawing(
        name="refocusing",
        caption=f"{finding}. Dots: refocused planes over the shift between neighbouring views. Wide lines: depth of "
        "field by blur; thin lines: by rays. Lines that reach the upper edge go on to infinity, or beyond the figure."
        + left,
        alt=f"Chart of the refocused distance over the shift, which falls as the shift grows. {finding}.",
        draw=partial(draw_refocusing, tree),
    )


@styled()
def draw_refocusing(tree: xr.DataTree) -> StudyFigure:
    """Draw a panel for each camera: planes as dots, the limits of their depths of field as vertical lines."""
    shown = list(refocused_cameras(tree))[:_MOST]
    figure = new_figure(3.2)
    panels = figure.subplots(1, len(shown), squeeze=False)[0]
    for number, (axes, (title, camera)) in enumerate(zip(panels, shown, strict=True)):
        _draw_planes(axes, title, camera, line_style(number).color)
        axes.set_xlabel("shift [microlenses]")
        if len(shown) > 1:
            axes.set_title(title)
    handles: list[Any] = [
        Line2D([], [], color=SOFT, marker="o", linestyle="none", markersize=3.5),
        Line2D([], [], color=SOFT, linewidth=_WIDE, alpha=_PALE),
        Line2D([], [], color=SOFT, linewidth=_THIN),
    ]
    legend(figure, handles, ["refocused plane", "depth of field by blur", "depth of field by rays"], columns=3)
    return figure


def _draw_planes(axes: Axes, title: str, camera: xr.Dataset, color: str) -> None:
    shift, refocused = (
        np.asarray(camera[variable].values, dtype=np.float64) for variable in ("shift", "refocused_distance")
    )
    ends = np.concatenate(
        [camera[variable].values for variable in ("refocused_distance", "ray_near", "blur_near", "near")], axis=None
    )
    finite = ends[np.isfinite(ends)]
    low, high = float(finite.min()) / 1.15, float(finite.max()) * 1.6
    for by, width, alpha in (("blur", _WIDE, _PALE), ("ray", _THIN, 1.0)):
        near, far = (np.asarray(camera[f"{by}_{end}"].values, dtype=np.float64) for end in ("near", "far"))
        axes.vlines(shift, near, np.minimum(far, high), color=color, linewidth=width, alpha=alpha)
    axes.plot(shift, np.where(np.isfinite(refocused), refocused, np.nan), "o", color=color, markersize=3.5, label=title)
    log_axis(axes, "y", dense=True, tick=distance_tick(high), ends=(low, high))
    axes.set(ylim=(low, high), ylabel="distance [mm]" if high < 0.1 else "distance [m]")

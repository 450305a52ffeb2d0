"""How far to trust a pair calibrated from corners: residuals over both pictures, and halves of its views."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.patches import Rectangle

from tradestudy.figures.curves import NamedCurve, name_ends
from tradestudy.figures.style import (
    INK,
    SMALL,
    SOFT,
    StudyFigure,
    length_tick,
    line_style,
    log_axis,
    new_figure,
    styled,
)

MM = 1e3
_ARROW_PX = 0.15  # length of the arrow in the key
_MARGIN = 0.14  # around a picture, of its width


@styled()
def draw_trust(tree: xr.DataTree, posterior: str) -> StudyFigure:
    """Mean residuals of the corners over the left and right picture, and depth by halves of the views."""
    data = tree["calibration"].to_dataset().sel(posterior=posterior)
    columns, rows = (float(size) for size in data["posterior_pixels"].values)
    figure = new_figure(4.6)
    grid = figure.add_gridspec(2, 2)
    residuals = np.asarray(data["rig_residual"].values, dtype=np.float64)
    for side, title in enumerate(("left", "right")):
        axes = figure.add_subplot(grid[0, side])
        down, across = residuals.shape[1:3]
        x, y = np.meshgrid((np.arange(across) + 0.5) / across * columns, (np.arange(down) + 0.5) / down * rows)
        u, v = residuals[side, ..., 0], residuals[side, ..., 1]
        arrows = axes.quiver(x, y, u, v, angles="xy", scale_units="xy", color=INK, scale=_ARROW_PX / (columns / across))
        axes.quiverkey(arrows, 0.85, 1.06, _ARROW_PX, f"{_ARROW_PX:g} px", labelpos="E", fontproperties={"size": SMALL})
        # Arrows may reach beyond the frame, which marks the edge of the picture.
        beyond = _MARGIN * columns
        axes.set(
            xlim=(-beyond, columns + beyond),
            ylim=(rows + beyond, -beyond),
            title=f"{title.capitalize()} picture",
            aspect="equal",
        )
        axes.add_patch(Rectangle((0.0, 0.0), columns, rows, fill=False, edgecolor=SOFT, linewidth=0.5))
        axes.set(xlabel="x [px]", ylabel="y [px]" if side == 0 else "")
    axes = figure.add_subplot(grid[1, :])
    distance = np.asarray(data["rig_distance"].values, dtype=np.float64)
    curves = {
        "halves: found": "rig_halves_difference",
        "halves: claimed": "rig_halves_claim",
        "all views: claimed": "rig_claimed",
    }
    drawn = []
    for order, (name, variable) in enumerate(curves.items()):
        style, y = line_style(order), MM * np.asarray(data[variable].values, dtype=np.float64)
        axes.plot(
            distance,
            y,
            color=style.color,
            linestyle=style.dash,
            linewidth=2.6 - 0.5 * order,
            marker=style.marker,
            label=name,
        )
        drawn.append(NamedCurve(name=name, color=style.color, x=distance, y=y))
    axes.set_xscale("log")
    axes.set_xticks(distance, [f"{one:g}" for one in distance])
    axes.minorticks_off()
    log_axis(axes, "y", tick=length_tick)
    axes.set(xlabel="distance [m]", ylabel="RMS difference or uncertainty")
    name_ends(axes, drawn)
    return figure

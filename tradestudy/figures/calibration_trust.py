"""How far to trust a pair calibrated from corners: residuals over both pictures, and halves of its views."""

from __future__ import annotations

import numpy as np
import xarray as xr

from tradestudy.figures.style import StudyFigure, legend, length_tick, line_style, log_axis, new_figure, styled

MM = 1e3
_ARROW_PX = 0.15  # length of the arrow in the key


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
        arrows = axes.quiver(x, y, u, v, angles="xy", scale_units="xy", scale=_ARROW_PX / (columns / across))
        axes.quiverkey(arrows, 0.85, 1.06, _ARROW_PX, f"{_ARROW_PX:g} px", labelpos="E", fontproperties={"size": 6})
        axes.set(xlim=(0.0, columns), ylim=(rows, 0.0), title=f"{title} picture", aspect="equal")
        axes.set(xlabel="x [px]", ylabel="y [px]" if side == 0 else "")
    axes = figure.add_subplot(grid[1, :])
    distance = np.asarray(data["rig_distance"].values, dtype=np.float64)
    curves = {
        "difference of random halves, root mean square": "rig_halves_difference",
        "what the halves claim for it": "rig_halves_claim",
        "what the whole claims": "rig_claimed",
    }
    for order, (label, variable) in enumerate(curves.items()):
        style = line_style(order)
        look = {"color": style.color, "linestyle": style.dash, "marker": style.marker, "label": label}
        axes.plot(distance, MM * data[variable].values, **look)
    axes.set_xscale("log")
    axes.set_xticks(distance, [f"{one:g}" for one in distance])
    axes.minorticks_off()
    log_axis(axes, "y", tick=length_tick)
    axes.set(xlabel="distance [m]", ylabel="standard deviation of depth")
    legend(figure, [line_style(order).handle() for order in range(len(curves))], list(curves), columns=1)
    return figure

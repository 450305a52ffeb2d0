"""Error sources of depth uncertainty: shares of the variance of inverse depth over distance, a panel per camera."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.patches import Patch

from tradestudy.figures.style import (
    PANEL_TITLE,
    PANELS_IN_A_ROW,
    SOFT,
    CameraTrace,
    StudyFigure,
    camera_panels,
    distance_axis,
    legend,
    line_style,
    new_figure,
    shortened,
    styled,
    traces,
)
from tradestudy.results.views.depth import nominal, where_usable
from tradestudy.results.views.groups import FloatArray

_LEAST = 0.005  # a share that a panel hardly shows
_NOISE = "#c3c8cf"
_HATCHES = ("", "///", "..", "\\\\\\", "xx")


def largest_shares(depth: xr.Dataset) -> dict[str, float]:
    """The largest share of each part over all cameras and distances; NaN where none is known."""
    rows = depth["variance_share"].transpose("part", ...)
    flat = rows.values.reshape(rows.sizes["part"], -1)
    known = np.where(np.isnan(flat), -np.inf, flat).max(axis=1)
    return {str(name): float(m) if m >= 0.0 else np.nan for name, m in zip(rows["part"].values, known, strict=True)}


def shown_parts(depth: xr.Dataset) -> list[str]:
    """The parts that somewhere have a share worth drawing, in their own order."""
    return [name for name, largest in largest_shares(depth).items() if largest > _LEAST]


@styled()
def draw_variance_shares(tree: xr.DataTree) -> StudyFigure:
    """Shares of the variance of inverse depth, stacked to 1, against distance; paler where the camera is not usable."""
    depth, shown = nominal(tree), traces(tree)
    names = shown_parts(depth)
    figure = new_figure(0.7 + 1.25 * -(-len(shown) // PANELS_IN_A_ROW))
    panels = camera_panels(figure, len(shown), float(depth["distance"].values[-1]))
    for axes, camera in zip(panels, shown, strict=True):
        _panel(axes, depth, camera, names)
    for axes in panels[::PANELS_IN_A_ROW]:
        axes.set_ylabel("share of variance")
    panels[0].set(ylim=(0.0, 1.0), yticks=[0.0, 0.5, 1.0], yticklabels=["0", "50 %", "100 %"])
    handles = [_patch(name, order) for order, name in enumerate(names)]
    handles.append(Patch(facecolor="white", edgecolor=SOFT, linewidth=0.5))
    legend(figure, handles, [*(name.replace("_", " ") for name in names), "pale: not usable"], columns=5)
    return figure


def _look(name: str, order: int) -> tuple[str, str]:
    """Colour and hatch of a part: measurement noise is grey, sources that averaging does not reduce are coloured."""
    return (_NOISE, "") if name == "noise" else (line_style(order - 1).color, _HATCHES[(order - 1) % len(_HATCHES)])


def _patch(name: str, order: int) -> Patch:
    color, hatch = _look(name, order)
    return Patch(facecolor=color, hatch=hatch, edgecolor="white", linewidth=0.0)


def _panel(axes: Axes, depth: xr.Dataset, camera: CameraTrace, names: list[str]) -> None:
    distance = np.asarray(depth["distance"].values, dtype=np.float64)
    shares = depth["variance_share"].sel(camera=camera.key, part=names).transpose("part", "distance").values
    known = np.isfinite(shares).any(axis=0)
    bottom = np.zeros_like(distance)
    for order, (name, share) in enumerate(zip(names, np.nan_to_num(shares), strict=True)):
        color, hatch = _look(name, order)
        if share.any():
            axes.fill_between(
                distance, bottom, bottom + share, where=known.tolist(),
                facecolor=color, hatch=hatch, edgecolor="white", linewidth=0.0,
                label=name.replace("_", " "), gid=f"variance_share:{name}/{camera.key}",
            )  # fmt: skip
        bottom = bottom + share
    nothing = ((distance[0], distance[0]),)  # moved by a page that shows another design
    for near, far in _not_usable(depth, camera.key, distance) or nothing:
        axes.axvspan(near, far, color="white", alpha=0.6, linewidth=0, zorder=2, gid=f"unusable/{camera.key}")
    distance_axis(axes, (float(distance[0]), float(distance[-1])))
    axes.set_title(shortened(camera.title, 34), fontsize=PANEL_TITLE)


def _not_usable(depth: xr.Dataset, camera: str, distance: FloatArray) -> list[tuple[float, float]]:
    """The stretches of distance [m] between those where a camera is usable."""
    ends = [float(distance[0])]
    for near, far in where_usable(depth, camera):
        ends += [near, min(far, float(distance[-1]))]
    ends.append(float(distance[-1]))
    return [(a, b) for a, b in zip(ends[::2], ends[1::2], strict=True) if b > a]

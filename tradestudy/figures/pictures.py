"""Pictures of the scene: each camera's first picture in full, a detail of it, and its true depth."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from tradestudy.figures.drawing import Drawing
from tradestudy.figures.style import PANEL_TITLE, StudyFigure, new_figure, shortened, styled
from tradestudy.figures.value_tables import picture_tables
from tradestudy.results.views.groups import FloatArray, camera_titles, group, has
from tradestudy.wording import distance, listed

_MOST = 6  # cameras
_LONGEST = 34
_BRIGHT = 99.5  # the percentile of brightness that is drawn white


def pictures_drawing(tree: xr.DataTree) -> Drawing | None:
    """The figure of a study that renders a scene; None for any other."""
    if not has(tree, "pictures", "brightness"):
        return None
    data, titles = group(tree, "pictures"), camera_titles(tree)
    shown = _first_of_each(data)
    near, far = map(distance, ends_of_depth(data["true_depth"].values))
    names = listed([titles[str(data["camera_of"].values[k])] for k in shown])
    return Drawing(
        name="scene_pictures",
        caption="The first picture by each camera: in full, its middle enlarged, and the true depth in each pixel "
        "(white: no light, or no surface). Brightness is scaled for each picture separately.",
        alt=f"Pictures of the scene by {names}, each with a detail of {data.sizes['detail_row']} pixels and its true "
        f"depth, from {near} to {far}.",
        draw=lambda: draw_pictures(tree),
        values=lambda: picture_tables(tree, shown),
    )


@styled()
def draw_pictures(tree: xr.DataTree) -> StudyFigure:
    """Draw a row for each camera: its first picture, the middle of it, and true depth on one scale for all."""
    data, titles = group(tree, "pictures"), camera_titles(tree)
    shown = _first_of_each(data)
    depth = data["true_depth"].values
    ends = ends_of_depth(depth[shown])
    figure = new_figure(0.3 + 2.05 * len(shown))
    panels = figure.subplots(len(shown), 3, squeeze=False)
    last = None
    for (whole, detail, deep), k in zip(panels, shown, strict=True):
        one = data.isel(picture=k)
        title = titles[str(one["camera_of"].item())]
        _grey(whole, one["brightness"].values, f"{shortened(title, _LONGEST)}")
        _grey(detail, one["detail"].values, f"middle {data.sizes['detail_row']} × {data.sizes['detail_column']} pixels")
        bare(deep, "true depth")
        last = deep.imshow(cropped(depth[k]) * 1e3, cmap="cividis", vmin=ends[0] * 1e3, vmax=ends[1] * 1e3)
    if last is not None:
        figure.colorbar(last, ax=panels[:, 2].tolist(), label="true depth [mm]", fraction=0.05, panchor=False)
    return figure


def _first_of_each(data: xr.Dataset) -> list[int]:
    """Where the first picture of each camera is."""
    _, first = np.unique(data["camera_of"].values.astype(str), return_index=True)
    return sorted(first.tolist())[:_MOST]


def _grey(axes: Axes, values: FloatArray, title: str) -> None:
    shown = cropped(values)
    bare(axes, title)
    axes.imshow(shown, cmap="gray", vmin=0.0, vmax=float(np.nanpercentile(shown, _BRIGHT)), interpolation="nearest")


def ends_of_depth(depth: FloatArray) -> tuple[float, float]:
    """The nearest and the farthest of the finite depths [m]."""
    finite = depth[np.isfinite(depth)]
    return float(finite.min()), float(finite.max())


def bare(axes: Axes, title: str) -> None:
    """Prepare a panel for a picture: a title, no ticks."""
    axes.set_title(title, fontsize=PANEL_TITLE)
    axes.set_xticks([])
    axes.set_yticks([])
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)
    axes.set_anchor("NW")


def cropped(values: FloatArray) -> FloatArray:
    """Crop the empty rows and columns that pad a picture to the size of the largest."""
    known = ~np.isnan(values)
    rows, columns = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    return values[: rows[-1] + 1, : columns[-1] + 1] if rows.size else values[:1, :1]

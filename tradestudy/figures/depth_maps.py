"""Depth measured in the pictures of the scene: maps, and the comparison with the prediction."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable

from tradestudy.figures.drawing import Drawing
from tradestudy.figures.pictures import bare, cropped, ends_of_depth
from tradestudy.figures.style import FAINT, INK, SOFT, StudyFigure, line_style, new_figure, shortened, styled
from tradestudy.figures.value_tables import depth_map_tables
from tradestudy.results.views.groups import FloatArray, camera_titles, group, has
from tradestudy.units import LENGTH, pretty
from tradestudy.wording import listed

_MOST = 6  # cameras
_LONGEST = 30
_ERROR_SPREADS = 3.0  # the scale of an error map spans the bias and this many spreads to either side


def depth_map_drawings(tree: xr.DataTree) -> Iterator[Drawing]:
    """The figures of a study that measures depth in its pictures."""
    if not has(tree, "pictures", "map_depth"):
        return
    data, titles = group(tree, "pictures"), camera_titles(tree)
    names = listed([titles[str(key)] for key in data["mapped_camera"].values[:_MOST]])
    yield Drawing(
        name="depth_maps",
        caption="Depth measured in the pictures, its error, and the fraction of the surface that the estimator sees "
        "in no second picture, for example behind edges and beyond the overlap. Each block shows the median of "
        "its points; hatched blocks have no depth. The scale of the error runs from blue at minus the value in the "
        "title to red at plus this value. Left: the all-in-focus picture, if the camera computes one from its map.",
        alt="Measured depth, its error, and the hidden fraction of the surface, as pictures. Median error and half the "
        "central 68.27 % interval of the errors: " + _error_words(tree),
        draw=lambda: draw_depth_maps(tree),
        values=lambda: depth_map_tables(tree),
    )
    yield Drawing(
        name="depth_achieved",
        caption="Errors of measured depth against true depth. Markers: median, with its standard error as a thick bar. "
        "Thin bars: half the width of the central 68.27 % interval to either side. Band: predicted depth uncertainty.",
        alt=f"For {names}: the median and the spread of the errors of measured depth in classes of true depth, with "
        "the predicted uncertainty as a band around zero. Over all depths: " + _error_words(tree),
        draw=lambda: draw_achieved(tree),
    )


def _error_words(tree: xr.DataTree) -> str:
    """Bias and spread of the measured depth of each camera."""
    data, titles = group(tree, "pictures"), camera_titles(tree)
    words = []
    for k in range(min(_MOST, data.sizes["mapped_camera"])):
        one = data.isel(mapped_camera=k)
        bias, spread = float(one["depth_bias"]), float(one["depth_spread"])
        error = f"{pretty(bias, LENGTH)} ± {pretty(spread, LENGTH)}" if np.isfinite(spread) else "measured nothing"
        words.append(f"{titles[str(one['mapped_camera'].item())]} {error}")
    return "; ".join(words) + "."


@styled()
def draw_depth_maps(tree: xr.DataTree) -> StudyFigure:
    """Draw a row for each camera: sharp picture, depth on the scale of the true one, its error, hidden fraction."""
    data, titles = group(tree, "pictures"), camera_titles(tree)
    count = min(_MOST, data.sizes["mapped_camera"])
    near, far = ends_of_depth(data["true_depth"].values)
    figure = new_figure(0.9 + 1.75 * count)
    panels = figure.subplots(count, 4, squeeze=False)
    last: ScalarMappable | None = None
    hidden: ScalarMappable | None = None
    for k, (sharp, deep, wrong, missing) in enumerate(panels[:count]):
        one = data.isel(mapped_camera=k)
        title = shortened(titles[str(one["mapped_camera"].item())], _LONGEST)
        picture = one["map_sharp"].values
        bare(sharp, title)
        if np.any(np.isfinite(picture)):
            grey = cropped(picture)
            sharp.imshow(grey, cmap="gray", vmin=0.0, vmax=float(np.nanpercentile(grey, 99.5)))
        else:
            sharp.text(
                0.5, 0.5, "no all-in-focus\npicture", ha="center", va="center", transform=sharp.transAxes, color=SOFT
            )
        bare(deep, "measured depth")
        shape = cropped(one["map_hidden"].values).shape
        last = _map(deep, one["map_depth"].values[: shape[0], : shape[1]] * 1e3, (near * 1e3, far * 1e3), "cividis")
        limit = (abs(float(one["depth_bias"].item())) + _ERROR_SPREADS * float(one["depth_spread"].item())) * 1e3
        bare(wrong, f"error, ±{limit:.2g} mm" if np.isfinite(limit) else "error")
        limit = limit if np.isfinite(limit) and limit > 0.0 else 1.0
        _map(wrong, one["map_depth_error"].values[: shape[0], : shape[1]] * 1e3, (-limit, limit), "RdBu_r")
        bare(missing, "hidden fraction")
        hidden = _map(missing, one["map_hidden"].values[: shape[0], : shape[1]], (0.0, 1.0), "magma")
    if last is not None and hidden is not None:
        everything = panels.ravel().tolist()
        for shown, label in ((last, "measured depth [mm]"), (hidden, "hidden fraction")):
            figure.colorbar(
                shown, ax=everything, label=label, location="bottom", fraction=0.02, aspect=60, panchor=False
            )
    return figure


def _map(axes: Axes, values: FloatArray, ends: tuple[float, float], colors: str) -> ScalarMappable:
    """Draw a map, hatched where there is no value."""
    axes.set_facecolor(FAINT)
    axes.patch.set(hatch="////", edgecolor=SOFT)
    return axes.imshow(values, cmap=colors, vmin=ends[0], vmax=ends[1], interpolation="nearest")


@styled()
def draw_achieved(tree: xr.DataTree) -> StudyFigure:
    """Draw the errors of measured depth against true depth, with a panel for each camera."""
    data, titles = group(tree, "pictures"), camera_titles(tree)
    count = min(_MOST, data.sizes["mapped_camera"])
    columns = min(count, 2)
    rows = -(-count // columns)
    figure = new_figure(0.2 + 2.1 * rows)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in panels[count:]:
        axes.set_visible(False)
    for k, axes in enumerate(panels[:count]):
        one = data.isel(mapped_camera=k)
        style = line_style(k)
        title = shortened(titles[str(one["mapped_camera"].item())], _LONGEST)
        axes.set_title(title)
        distance = one["class_distance"].values * 1e3
        if not np.any(np.isfinite(one["class_bias"].values)):
            bare(axes, title)
            axes.text(0.5, 0.5, "measured nothing", ha="center", va="center", transform=axes.transAxes, color=SOFT)
            continue
        bias, spread, predicted = (one[f"class_{name}"].values * 1e3 for name in ("bias", "spread", "predicted"))
        axes.axhline(0.0, color=INK, linewidth=0.6)
        axes.fill_between(distance, -predicted, predicted, color=style.color, alpha=0.18, linewidth=0.0)
        axes.errorbar(distance, bias, yerr=spread, fmt="none", ecolor=style.color, elinewidth=0.8, capsize=2.5)
        error = one["class_bias_error"].values * 1e3
        look = {"fmt": style.marker, "color": style.color, "label": "median error"}
        axes.errorbar(distance, bias, yerr=error, elinewidth=2.4, markersize=4, **look)
        axes.set_xlabel("true depth [mm]")
        axes.set_ylabel("error of depth [mm]")
    return figure

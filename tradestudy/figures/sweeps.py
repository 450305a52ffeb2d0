"""Swept designs: how depth uncertainty moves with one or two swept parameters, and which designs nothing beats."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter

from tradestudy.figures.fonts import printable
from tradestudy.figures.style import (
    INK,
    SOFT,
    CameraTrace,
    StudyFigure,
    distance_label,
    distance_tick,
    legend,
    length_tick,
    log_axis,
    new_figure,
    plain_number,
    shortened,
    styled,
    traces,
)
from tradestudy.results.views.depth import swept
from tradestudy.results.views.groups import FloatArray
from tradestudy.wording import distance

MM = 1e3
_COLUMNS = 3


def reference_distance(tree: xr.DataTree) -> float:
    """The computed distance [m] at which designs are compared: next to the middle of those declared, or of all."""
    every = tree["depth"].to_dataset()["distance"].values
    middle = float(np.sqrt(every[0] * every[-1]))
    if "decision" in tree.children and "place" in tree["decision"].coords:
        places = np.sort(tree["decision"].to_dataset()["place"].values)
        middle = float(places[(len(places) - 1) // 2])
    return float(every[np.argmin(np.abs(np.log(every / middle)))])


def moved_cameras(tree: xr.DataTree) -> tuple[CameraTrace, ...]:
    """The cameras whose uncertainty depends on what is swept."""
    depth = tree["depth"].to_dataset()
    values = depth["depth_uncertainty"].transpose("camera", "distance", ...).values
    flat = values.reshape(*values.shape[:2], -1)
    moved = [not np.array_equal(one, np.broadcast_to(one[:, :1], one.shape), equal_nan=True) for one in flat]
    return tuple(camera for camera, moves in zip(traces(tree), moved, strict=True) if moves)


# SI unit: factor and unit on axes.
AXIS_UNITS = {"m": (MM, "mm"), "rad": (180.0 / np.pi, "°"), "px": (1.0, "px")}


def axis_values(coordinate: xr.DataArray) -> tuple[FloatArray, list[str], str]:
    """Places of the values of a swept coordinate on an axis, their names, and the label; choices stand side by side."""
    name = printable(str(coordinate.attrs.get("long_name", coordinate.name)))
    if coordinate.dtype.kind not in "fiu":
        return np.arange(coordinate.size, dtype=np.float64), [shortened(str(v), 20) for v in coordinate.values], name
    factor, unit = AXIS_UNITS.get(str(coordinate.attrs.get("units", "")), (1.0, ""))
    values = np.asarray(coordinate.values, dtype=np.float64) * factor
    return values, [plain_number(value) for value in values], f"{name} [{unit}]" if unit else name


def shown_value(coordinate: xr.DataArray, value: float | str) -> str:
    """One value of a swept coordinate with its unit."""
    if isinstance(value, str):
        return value
    factor, unit = AXIS_UNITS.get(str(coordinate.attrs.get("units", "")), (1.0, ""))
    return f"{plain_number(value * factor)} {unit}".rstrip()


@styled()
def draw_sweep_map(tree: xr.DataTree) -> StudyFigure:
    """Depth uncertainty [mm] at the reference distance: a curve over one swept parameter, a map over two.

    Of more than two, all but the two with the most values stand at their first value.
    """
    place, moved = reference_distance(tree), moved_cameras(tree)
    depth = tree["depth"].to_dataset().sel(distance=place, method="nearest")
    dims = sorted(swept(tree["depth"].to_dataset()), key=lambda d: (-depth.sizes[d], d))
    uncertainty = depth["depth_uncertainty"].isel(dict.fromkeys(dims[2:], 0))
    if len(dims) == 1:
        return _curves(uncertainty, moved, dims[0], place)
    return _maps(uncertainty, moved, (dims[0], dims[1]), place)


def _curves(uncertainty: xr.DataArray, moved: tuple[CameraTrace, ...], dim: str, place: float) -> StudyFigure:
    figure = new_figure(3.0)
    axes = figure.subplots()
    x, names, label = axis_values(uncertainty[dim])
    for camera in moved:
        y = np.asarray(uncertainty.sel(camera=camera.key).values, dtype=float) * MM
        style = camera.style
        y = np.where(np.isfinite(y), y, np.nan)
        look = {"color": style.color, "linestyle": style.dash, "label": camera.title}
        axes.plot(x, y, marker=style.marker, markersize=4, **look)
    log_axis(axes, "y", dense=True, tick=length_tick)
    if uncertainty[dim].dtype.kind not in "fiu":
        axes.set_xticks(x, names)
    axes.set(xlabel=label, ylabel=f"depth uncertainty at {distance(place)}")
    handles = [camera.style.handle(marker=camera.style.marker, markersize=4) for camera in moved]
    legend(figure, handles, [camera.title for camera in moved], columns=2)
    return figure


def _maps(
    uncertainty: xr.DataArray, moved: tuple[CameraTrace, ...], dims: tuple[str, str], place: float
) -> StudyFigure:
    columns = min(_COLUMNS, max(len(moved), 1))
    rows = -(-len(moved) // columns)
    figure = new_figure(0.7 + 2.1 * rows)
    panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    arrays = {c.key: uncertainty.sel(camera=c.key).transpose(dims[1], dims[0]).values * MM for c in moved}
    everything = np.concatenate([array.ravel() for array in arrays.values()])
    finite = everything[np.isfinite(everything) & (everything > 0)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (1.0, 10.0)
    norm = LogNorm(vmin=low, vmax=max(high, 1.01 * low))
    (x, x_names, x_label), (y, y_names, y_label) = (axis_values(uncertainty[dim]) for dim in dims)
    for axes, camera in zip(panels.flat, moved, strict=False):
        _map(axes, arrays[camera.key], norm)
        axes.set_xticks(np.arange(len(x)) + 0.5, x_names)
        axes.set_yticks(np.arange(len(y)) + 0.5, y_names)
        axes.set_title(shortened(camera.title, 34), fontsize=7.5)
    for axes in panels.flat[len(moved) :]:
        axes.set_visible(False)
    figure.supxlabel(x_label, fontsize=7.5)
    figure.supylabel(y_label, fontsize=7.5)
    bar = figure.colorbar(
        ScalarMappable(norm=norm, cmap="cividis"), ax=panels.ravel().tolist(), format=FuncFormatter(length_tick)
    )
    bar.ax.minorticks_off()
    bar.set_label(f"depth uncertainty at {distance(place)} (numbers in mm)")
    return figure


def _map(axes: Axes, values: FloatArray, norm: LogNorm) -> None:
    axes.pcolormesh(np.ma.masked_invalid(values), norm=norm, cmap="cividis", edgecolors="white", linewidth=0.6)
    axes.grid(visible=False)
    for row, column in np.ndindex(values.shape):
        value = values[row, column]
        dark = np.isfinite(value) and norm(value) < 0.55
        text = plain_number(float(f"{value:.2g}")) if np.isfinite(value) else "–"
        axes.text(
            column + 0.5,
            row + 0.5,
            text,
            ha="center",
            va="center",
            color="white" if dark else INK,
            fontsize=6,
        )


@styled()
def draw_pareto(tree: xr.DataTree) -> StudyFigure:
    """Nearest usable distance against uncertainty at the reference distance, for designs usable there; the frontier."""
    depth, place = tree["depth"].to_dataset(), reference_distance(tree)
    figure = new_figure(3.4)
    axes = figure.subplots()
    shown = traces(tree)
    clouds: list[FloatArray] = []
    handles = []
    for camera in shown:
        near = depth["usable_near"].sel(camera=camera.key).min("interval")
        there = depth.sel(camera=camera.key).sel(distance=place, method="nearest")
        sigma = there["depth_uncertainty"].where(there["usable"])
        points = np.stack([array.values.ravel() for array in xr.broadcast(near, sigma)], axis=1)
        points = np.unique(points[np.isfinite(points).all(axis=1)], axis=0)
        clouds.append(points)
        mark: dict[str, Any] = {"linestyle": "", "marker": camera.style.marker, "markersize": 5}
        axes.plot(points[:, 0], points[:, 1] * MM, color=camera.style.color, label=camera.title, **mark)
        handles.append(camera.style.handle(**mark))
    designs = np.concatenate(clouds)
    front = frontier(designs)
    axes.step(front[:, 0], front[:, 1] * MM, where="post", color=SOFT, linewidth=1.0, zorder=0.9)
    farthest = float(np.max(designs[:, 0], initial=0.0))
    log_axis(axes, "x", dense=True, tick=distance_tick(farthest))
    log_axis(axes, "y", dense=True, tick=length_tick)
    axes.set(xlabel=f"nearest usable {distance_label(farthest)}", ylabel=f"depth uncertainty at {distance(place)}")
    handles.append(Line2D([], [], color=SOFT, linewidth=1.0))
    legend(figure, handles, [*(camera.title for camera in shown), "no design is better in both"], columns=2)
    return figure


def frontier(points: FloatArray) -> FloatArray:
    """The rows of `points` (two costs each) that no other row beats in both, by rising first cost."""
    ordered = points[np.lexsort((points[:, 1], points[:, 0]))]
    best = np.minimum.accumulate(ordered[:, 1])
    keep = np.ones(len(ordered), dtype=bool)
    keep[1:] = ordered[1:, 1] < best[:-1]
    return ordered[keep]

"""Swept designs: depth uncertainty against one or two parameters, and the Pareto-optimal designs."""

from __future__ import annotations

from collections.abc import Mapping
from textwrap import fill
from typing import Final

import numpy as np
import xarray as xr
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, to_hex
from matplotlib.ticker import FuncFormatter, LogLocator

from tradestudy.figures.curves import NamedCurve, name_ends
from tradestudy.figures.fonts import printable
from tradestudy.figures.style import (
    INK,
    PANEL_TITLE,
    SMALL,
    SOFT,
    CameraTrace,
    StudyFigure,
    distance_label,
    distance_tick,
    length_tick,
    letters_on,
    log_axis,
    new_figure,
    plain_number,
    shortened,
    styled,
    traces,
)
from tradestudy.figures.value_tables import Tables, grid
from tradestudy.results.views.depth import swept
from tradestudy.results.views.designs import design_words, path_words
from tradestudy.results.views.groups import FloatArray, group, titles_in
from tradestudy.units import LENGTH, pretty
from tradestudy.wording import distance

MM = 1e3
_MOST_CELLS: Final = 15  # along a side of a map, with numbers; of more, only some ticks have room
_COLUMNS = 3
_LETTERS_UP = 34  # in a line of a label that runs along a map


def reference_distance(tree: xr.DataTree) -> float:
    """The computed distance [m] at which designs are compared: nearest to the middle of those declared, or of all."""
    every = tree["depth"].to_dataset()["distance"].values
    declared = _declared_distance(tree)
    middle = float(np.sqrt(every[0] * every[-1])) if declared is None else declared
    return float(every[np.argmin(np.abs(np.log(every / middle)))])


def _declared_distance(tree: xr.DataTree) -> float | None:
    """The middle one of the declared distances [m]; None without any."""
    if "decision" not in tree.children or "place" not in tree["decision"].coords:
        return None
    places = np.sort(tree["decision"].to_dataset()["place"].values)
    return float(places[(len(places) - 1) // 2])


def why_this_distance(tree: xr.DataTree) -> str:
    """Say why the reference distance is not the declared one; empty if the two agree to three digits."""
    declared, used = _declared_distance(tree), distance(reference_distance(tree))
    if declared is None or distance(declared) == used:
        return ""
    return f" Of the distances at which designs are computed, {used} is nearest to {distance(declared)}."


def moved_cameras(tree: xr.DataTree) -> tuple[CameraTrace, ...]:
    """The cameras whose uncertainty depends on the swept parameters, or on the two that a map shows."""
    depth = tree["depth"].to_dataset()
    depth = depth.isel(dict.fromkeys(_by_size(depth)[2:], 0))
    values = depth["depth_uncertainty"].transpose("camera", "distance", ...).values
    flat = values.reshape(*values.shape[:2], -1)
    moved = [
        not np.array_equal(designs, np.broadcast_to(designs[:, :1], designs.shape), equal_nan=True) for designs in flat
    ]
    keys = {str(key) for key, moves in zip(depth["camera"].values, moved, strict=True) if moves}
    return tuple(camera for camera in traces(tree) if camera.key in keys)


# SI unit: factor and unit of an axis.
AXIS_UNITS = {"m": (MM, "mm"), "rad": (180.0 / np.pi, "°"), "px": (1.0, "px")}


def axis_values(coordinate: xr.DataArray) -> tuple[FloatArray, list[str]]:
    """Where the values of a swept coordinate lie on an axis, and their names; choices stand side by side."""
    if coordinate.dtype.kind not in "fiu":
        return np.arange(coordinate.size, dtype=np.float64), [shortened(str(v), 20) for v in coordinate.values]
    values = np.asarray(coordinate.values, dtype=np.float64) * axis_unit(coordinate)[0]
    return values, [plain_number(value) for value in values]


def axis_unit(coordinate: xr.DataArray) -> tuple[float, str]:
    """The unit of a swept coordinate on axes, and the factor to it from SI."""
    return AXIS_UNITS.get(str(coordinate.attrs.get("units", "")), (1.0, ""))


def axis_label(tree: xr.DataTree, coordinate: xr.DataArray) -> str:
    """The name of a swept coordinate in words, with its unit."""
    words, unit = printable(path_words(tree, str(coordinate.name))), axis_unit(coordinate)[1]
    return f"{words} [{unit}]" if unit else words


def shown_value(coordinate: xr.DataArray, value: float | str) -> str:
    """One value of a swept coordinate with its unit."""
    if isinstance(value, str):
        return value
    factor, unit = axis_unit(coordinate)
    return f"{plain_number(value * factor)} {unit}".rstrip()


def design_sentence(tree: xr.DataTree, depth: xr.Dataset) -> str:
    """Say of which swept design a figure shows the depth; empty without a sweep."""
    values = {dim: shown_value(depth[dim], depth[dim].item()) for dim in swept(group(tree, "depth"))}
    return f" Of the swept designs, the figure shows {design_words(tree, values)}." if values else ""


@styled()
def draw_sweep_map(tree: xr.DataTree) -> StudyFigure:
    """Draw the depth uncertainty [mm] at the reference distance: a curve over one swept parameter, a map over two.

    With more than two, all but the two that have the most values keep their first value.
    """
    (uncertainty, dims), moved = _mapped(tree), moved_cameras(tree)
    if len(dims) == 1:
        return _curves(tree, uncertainty, moved, dims[0])
    return _maps(tree, uncertainty, moved, (dims[0], dims[1]))


def _mapped(tree: xr.DataTree) -> tuple[xr.DataArray, list[str]]:
    """The uncertainty at the reference distance over the two swept parameters with the most values, and their names."""
    depth = tree["depth"].to_dataset().sel(distance=reference_distance(tree), method="nearest")
    dims = _by_size(depth)
    return depth["depth_uncertainty"].isel(dict.fromkeys(dims[2:], 0)), dims


def _by_size(depth: xr.Dataset) -> list[str]:
    """The swept parameters, those with the most values first."""
    return sorted(swept(depth), key=lambda dim: (-depth.sizes[dim], dim))


def has_numbers(tree: xr.DataTree) -> bool:
    """Whether the figure is a map whose cells have room for their numbers."""
    uncertainty, dims = _mapped(tree)
    return len(dims) > 1 and all(uncertainty.sizes[dim] <= _MOST_CELLS for dim in dims[:2])


def has_gaps(tree: xr.DataTree) -> bool:
    """Whether a map of `draw_sweep_map` has cells without a finite value."""
    uncertainty, dims = _mapped(tree)
    shown = uncertainty.sel(camera=[camera.key for camera in moved_cameras(tree)])
    return len(dims) > 1 and not np.isfinite(shown.values).all()


def map_tables(tree: xr.DataTree) -> Tables:
    """Make the tables of numbers of the maps of `draw_sweep_map`; none where it draws curves."""
    uncertainty, dims = _mapped(tree)
    if len(dims) == 1:
        return ()
    columns, rows = ([shown_value(uncertainty[dim], value) for value in uncertainty[dim].values] for dim in dims[:2])
    across, up = (path_words(tree, dim) for dim in dims[:2])
    return tuple(
        grid(
            f"{camera.title}, {_uncertainty_label(tree)}: {up} down, {across} across",
            [up, *columns],
            rows,
            uncertainty.sel(camera=camera.key).transpose(dims[1], dims[0]).values,
            LENGTH,
        )
        for camera in moved_cameras(tree)
    )


def _curves(tree: xr.DataTree, uncertainty: xr.DataArray, moved: tuple[CameraTrace, ...], dim: str) -> StudyFigure:
    figure = new_figure(3.0)
    axes = figure.subplots()
    x, names = axis_values(uncertainty[dim])
    drawn = []
    for camera in moved:
        y = np.asarray(uncertainty.sel(camera=camera.key).values, dtype=float) * MM
        style = camera.style
        y = np.where(np.isfinite(y), y, np.nan)
        name = printable(camera.title)
        axes.plot(x, y, color=style.color, linestyle=style.dash, marker=style.marker, markersize=4, label=name)
        drawn.append(NamedCurve(name=name, color=style.color, x=x, y=y))
    shown = np.concatenate([curve.y[curve.y > 0.0] for curve in drawn])
    ends = (float(shown.min()), float(shown.max())) if shown.size else None
    log_axis(axes, "y", dense=True, tick=length_tick, ends=ends)
    if uncertainty[dim].dtype.kind not in "fiu":
        axes.set_xticks(x, names)
    axes.set(xlabel=axis_label(tree, uncertainty[dim]), ylabel=_uncertainty_label(tree))
    name_ends(axes, drawn)
    return figure


def _maps(
    tree: xr.DataTree, uncertainty: xr.DataArray, moved: tuple[CameraTrace, ...], dims: tuple[str, str]
) -> StudyFigure:
    columns = min(_COLUMNS, max(len(moved), 1))
    rows = -(-len(moved) // columns)
    figure = new_figure(0.7 + 2.1 * rows)
    panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    arrays = {c.key: uncertainty.sel(camera=c.key).transpose(dims[1], dims[0]).values * MM for c in moved}
    everything = np.concatenate([array.ravel() for array in arrays.values()])
    finite = everything[np.isfinite(everything) & (everything > 0)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (1.0, 10.0)
    # A scale needs two different ends, also where all values are the same.
    norm = LogNorm(vmin=low, vmax=max(high, 1.01 * low))
    x_names, y_names = (axis_values(uncertainty[dim])[1] for dim in dims)
    for axes, camera in zip(panels.flat, moved, strict=False):
        _map(axes, arrays[camera.key], norm, f"{_uncertainty_label(tree)} [mm]", numbers=has_numbers(tree))
        axes.set_xticks(*_some(x_names, columns))
        axes.set_yticks(*_some(y_names))
        axes.set_title(shortened(camera.title, 34), fontsize=PANEL_TITLE)
    for axes in panels.flat[len(moved) :]:
        axes.set_visible(False)
    figure.supxlabel(axis_label(tree, uncertainty[dims[0]]), fontsize="medium")
    figure.supylabel(fill(axis_label(tree, uncertainty[dims[1]]), _LETTERS_UP * rows), fontsize="medium")
    bar = figure.colorbar(
        ScalarMappable(norm=norm, cmap="cividis"), ax=panels.ravel().tolist(), format=FuncFormatter(length_tick)
    )
    bar.ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    bar.ax.minorticks_off()
    bar.set_label(_uncertainty_label(tree))
    return figure


def _some(names: list[str], panels: int = 1) -> tuple[FloatArray, list[str]]:
    """Where the ticks of the cells of a map are, and their names: all, or as many as have room beside other panels."""
    step = 1 if len(names) <= _MOST_CELLS else -(-len(names) * panels // _MOST_CELLS)
    return np.arange(0.5, len(names), step, dtype=np.float64), names[::step]


def swept_words(tree: xr.DataTree, camera: str) -> str:
    """The smallest and the largest uncertainty of a camera over the designs, at the distance of the map."""
    depth = tree["depth"].to_dataset().sel(distance=reference_distance(tree), method="nearest")
    values = depth["depth_uncertainty"].sel(camera=camera).values
    finite = values[np.isfinite(values)]
    return f"{pretty(float(finite.min()), LENGTH)} to {pretty(float(finite.max()), LENGTH)}" if finite.size else ""


def _uncertainty_label(tree: xr.DataTree) -> str:
    return f"uncertainty at {distance(reference_distance(tree))}"


def _map(axes: Axes, values: FloatArray, norm: LogNorm, label: str, *, numbers: bool) -> None:
    masked = np.ma.masked_invalid(values)
    edges, width = ("white", 0.6) if numbers else ("none", 0.0)
    axes.pcolormesh(masked, norm=norm, cmap="cividis", edgecolors=edges, linewidth=width, label=label)
    axes.grid(visible=False)
    if not numbers:
        return
    colors = colormaps["cividis"]
    for row, column in np.ndindex(values.shape):
        value = values[row, column]
        text = plain_number(float(f"{value:.2g}")) if np.isfinite(value) else "–"
        axes.text(
            column + 0.5,
            row + 0.5,
            text,
            ha="center",
            va="center",
            color=letters_on(to_hex(colors(norm(value)))) if np.isfinite(value) else INK,
            fontsize=SMALL,
        )


@styled()
def draw_pareto(tree: xr.DataTree) -> StudyFigure:
    """Draw nearest usable distance against uncertainty, for the designs usable at the reference distance."""
    place = reference_distance(tree)
    figure = new_figure(3.4)
    axes = figure.subplots()
    shown = traces(tree)
    clouds = usable_designs(tree)
    drawn = []
    for camera in shown:
        color, name, (near, sigma) = camera.style.color, printable(camera.title), clouds[camera.key].T
        axes.plot(near, sigma * MM, linestyle="", marker=camera.style.marker, markersize=5, color=color, label=name)
        drawn.append(NamedCurve(name=name, color=color, x=near, y=sigma * MM))
    designs = np.concatenate(list(clouds.values()))
    front = frontier(designs)
    axes.step(front[:, 0], front[:, 1] * MM, where="post", color=SOFT, linewidth=1.0, zorder=0.9)
    farthest = float(np.max(designs[:, 0], initial=0.0))
    log_axis(axes, "x", dense=True, tick=distance_tick(farthest))
    log_axis(axes, "y", dense=True, tick=length_tick)
    axes.set(xlabel=f"nearest usable {distance_label(farthest)}", ylabel=f"depth uncertainty at {distance(place)}")
    name_ends(axes, drawn)
    return figure


def usable_designs(tree: xr.DataTree) -> Mapping[str, FloatArray]:
    """The designs of each camera usable at the reference distance, one per row: near end and uncertainty there [m]."""
    depth, place = tree["depth"].to_dataset(), reference_distance(tree)
    designs = {}
    for camera in titles_in(tree, "depth"):
        near = depth["usable_near"].sel(camera=camera).min("interval")
        here = depth.sel(camera=camera).sel(distance=place, method="nearest")
        sigma = here["depth_uncertainty"].where(here["usable"])
        points = np.stack([array.values.ravel() for array in xr.broadcast(near, sigma)], axis=1)
        designs[camera] = np.unique(points[np.isfinite(points).all(axis=1)], axis=0)
    return designs


def frontier(points: FloatArray) -> FloatArray:
    """The rows of `points` (two costs each) that no other row beats in both, sorted by the first cost."""
    ordered = points[np.lexsort((points[:, 1], points[:, 0]))]
    best = np.minimum.accumulate(ordered[:, 1])
    keep = np.ones(len(ordered), dtype=bool)
    keep[1:] = ordered[1:, 1] < best[:-1]
    return ordered[keep]

"""Pictures of a scene, the depth measured in them and over them, and whether it agrees with the prediction."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.image import AxesImage

from tradestudy.figures.curves import NamedCurve, name_ends, names_fit
from tradestudy.figures.drawing import Drawing
from tradestudy.figures.style import (
    FAINT,
    INK,
    PANEL_TITLE,
    SMALL,
    SOFT,
    StudyFigure,
    distance_axis,
    distance_label,
    line_style,
    log_axis,
    new_figure,
    shortened,
    styled,
)
from tradestudy.figures.value_tables import Tables, depth_map_tables, picture_tables, uncertainty_map_tables
from tradestudy.results.views.finding import ratio_to_middle
from tradestudy.results.views.groups import FloatArray, camera_titles, group, has
from tradestudy.units import ELECTRONS, FRACTION, LENGTH, pretty, significant
from tradestudy.wording import counted, distance, listed, span

_MOST = 6  # cameras
_ROWS = 4  # of pictures, which leave room for the answer on the first page
_LONGEST = 30
_BRIGHT = 99.5  # the percentile of brightness that is drawn white


def picture_drawings(tree: xr.DataTree) -> Iterator[Drawing]:
    """The figure of a study that renders a scene; none for any other."""
    if not has(tree, "pictures", "brightness"):
        return
    data, titles = group(tree, "pictures"), camera_titles(tree)
    shown = _first_of_each(data)
    near, far = map(distance, ends_of_depth(data["true_depth"].values))
    names = listed([titles[str(data["camera_of"].values[k])] for k in shown])
    yield Drawing(
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
        picture = data.isel(picture=k)
        title = titles[str(picture["camera_of"].item())]
        _grey(whole, picture["brightness"].values, shortened(title, _LONGEST))
        _grey(
            detail,
            picture["detail"].values,
            f"middle {data.sizes['detail_row']} × {data.sizes['detail_column']} pixels",
        )
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
    is_known = ~np.isnan(values)
    rows, columns = np.flatnonzero(is_known.any(axis=1)), np.flatnonzero(is_known.any(axis=0))
    return values[: rows[-1] + 1, : columns[-1] + 1] if rows.size else values[:1, :1]


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


def measured_scene_drawings(tree: xr.DataTree) -> Iterator[Drawing]:
    """The figure of the cameras that measure a rendered scene best; none for any other study."""
    if not has(tree, "pictures", "map_depth") or not best_of_scene(tree):
        return
    others = group(tree, "pictures").sizes["mapped_camera"] - len(best_of_scene(tree))
    yield Drawing(
        name="measured_scene",
        caption="From left to right: the picture, the depth measured in it, and its error on one scale for all "
        "(red: too far; larger errors have the colour of the end). Each block shows the median of its points; hatched "
        "blocks have no depth."
        + (f" {counted(others, 'other camera')}: section “Depth measured in the pictures”." if others > 0 else ""),
        alt="Pictures, measured depths and their errors. Median error and half the central 68.27 % interval: "
        + _error_words(tree),
        draw=partial(draw_measured_scene, tree),
    )


def best_of_scene(tree: xr.DataTree) -> list[str]:
    """The cameras that measure a rendered scene best, at most four, by the root mean square of bias and spread."""
    data = group(tree, "pictures")
    errors = np.hypot(data["depth_bias"].values, data["depth_spread"].values)
    order = [k for k in np.argsort(errors, kind="stable") if np.isfinite(errors[k])]
    return [str(data["mapped_camera"].values[k]) for k in order[:_ROWS]]


def _error_words(tree: xr.DataTree) -> str:
    """Bias and spread of the measured depth of each camera."""
    data, titles = group(tree, "pictures"), camera_titles(tree)
    words = []
    for k in range(min(_MOST, data.sizes["mapped_camera"])):
        camera = data.isel(mapped_camera=k)
        bias, spread = float(camera["depth_bias"]), float(camera["depth_spread"])
        error = f"{pretty(bias, LENGTH)} ± {pretty(spread, LENGTH)}" if np.isfinite(spread) else "measured nothing"
        words.append(f"{titles[str(camera['mapped_camera'].item())]} {error}")
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
        camera = data.isel(mapped_camera=k)
        title = shortened(titles[str(camera["mapped_camera"].item())], _LONGEST)
        picture = camera["map_sharp"].values
        bare(sharp, title)
        if np.any(np.isfinite(picture)):
            grey = cropped(picture)
            sharp.imshow(grey, cmap="gray", vmin=0.0, vmax=float(np.nanpercentile(grey, 99.5)))
        else:
            sharp.text(
                0.5, 0.5, "no all-in-focus\npicture", ha="center", va="center", transform=sharp.transAxes, color=SOFT
            )
        bare(deep, "measured depth")
        shape = cropped(camera["map_hidden"].values).shape
        last = _map(deep, camera["map_depth"].values[: shape[0], : shape[1]] * 1e3, (near * 1e3, far * 1e3), "cividis")
        last.set_label("measured depth [mm]")
        limit = (abs(float(camera["depth_bias"].item())) + _ERROR_SPREADS * float(camera["depth_spread"].item())) * 1e3
        bare(wrong, f"error, ±{limit:.2g} mm" if np.isfinite(limit) else "error")
        limit = limit if np.isfinite(limit) and limit > 0.0 else 1.0
        error = camera["map_depth_error"].values[: shape[0], : shape[1]] * 1e3
        _map(wrong, error, (-limit, limit), "RdBu_r").set_label("depth error [mm]")
        bare(missing, "hidden fraction")
        hidden = _map(missing, camera["map_hidden"].values[: shape[0], : shape[1]], (0.0, 1.0), "magma")
    if last is not None and hidden is not None:
        everything = panels.ravel().tolist()
        for shown, label in ((last, "measured depth [mm]"), (hidden, "hidden fraction")):
            figure.colorbar(
                shown, ax=everything, label=label, location="bottom", fraction=0.02, aspect=60, panchor=False
            )
    return figure


@styled()
def draw_measured_scene(tree: xr.DataTree) -> StudyFigure:
    """Draw a row for each of the best cameras: its picture, the depth measured in it, and its error on one scale."""
    data, titles, keys = group(tree, "pictures"), camera_titles(tree), best_of_scene(tree)
    # In reverse, so that the first picture of each camera is the one that stays.
    first = dict(zip(reversed(data["camera_of"].values), reversed(range(data.sizes["picture"])), strict=True))
    near, far = ends_of_depth(data["true_depth"].values)
    rows = data.set_index(mapped_camera="mapped_camera").sel(mapped_camera=keys)
    limit = float(np.max(np.abs(rows["depth_bias"]) + _ERROR_SPREADS * rows["depth_spread"])) * 1e3
    figure = new_figure(0.8 + 1.4 * len(keys))
    panels = figure.subplots(len(keys), 3, squeeze=False)
    for (picture, deep, wrong), key in zip(panels, keys, strict=True):
        camera = rows.sel(mapped_camera=key)
        _grey(picture, data["brightness"].values[first[key]], shortened(titles[key], _LONGEST))
        bare(deep, "measured depth" if key == keys[0] else "")
        bare(wrong, "depth error" if key == keys[0] else "")
        height, width = cropped(camera["map_hidden"].values).shape
        depths, errors = (
            camera[variable].values[:height, :width] * 1e3 for variable in ("map_depth", "map_depth_error")
        )
        depth_scale = _map(deep, depths, (near * 1e3, far * 1e3), "cividis")
        error_scale = _map(wrong, errors, (-limit, limit), "RdBu_r")
    for column, scale, label in ((1, depth_scale, "measured depth [mm]"), (2, error_scale, "depth error [mm]")):
        figure.colorbar(scale, ax=panels[:, column].tolist(), label=label, location="bottom", fraction=0.05, pad=0.02)
    return figure


def _map(axes: Axes, values: FloatArray, ends: tuple[float, float], colors: str) -> AxesImage:
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
        camera = data.isel(mapped_camera=k)
        style = line_style(k)
        title = shortened(titles[str(camera["mapped_camera"].item())], _LONGEST)
        axes.set_title(title)
        distance = camera["class_distance"].values * 1e3
        if not np.any(np.isfinite(camera["class_bias"].values)):
            bare(axes, title)
            axes.text(0.5, 0.5, "measured nothing", ha="center", va="center", transform=axes.transAxes, color=SOFT)
            continue
        bias, spread, predicted = (
            camera[f"class_{statistic}"].values * 1e3 for statistic in ("bias", "spread", "predicted")
        )
        axes.axhline(0.0, color=INK, linewidth=0.6)
        axes.fill_between(distance, -predicted, predicted, color=style.color, alpha=0.18, linewidth=0.0)
        axes.errorbar(distance, bias, yerr=spread, fmt="none", ecolor=style.color, elinewidth=0.8, capsize=2.5)
        error = camera["class_bias_error"].values * 1e3
        look = {"fmt": style.marker, "color": style.color, "label": "median error"}
        axes.errorbar(distance, bias, yerr=error, elinewidth=2.4, markersize=4, **look)
        axes.set_xlabel("true depth [mm]")
        axes.set_ylabel("error of depth [mm]")
    return figure


_LARGEST_RATIO = 3.0  # times the uncertainty in the middle: the scale ends here at most


def uncertainty_map_drawings(tree: xr.DataTree) -> Iterator[Drawing]:
    """List one figure for each rig that has maps."""
    if not has(tree, "depth_map"):
        return
    titles = camera_titles(tree)
    for key in map(str, group(tree, "depth_map")["camera"].values):
        yield Drawing(
            name=f"depth-map-{key}",
            caption=f"Depth uncertainty of {titles[key]} over the picture, relative to that in the middle, on one "
            f"scale for all distances{_end_of_scale(tree, key)}. Blank: the point is not seen by both cameras or lies "
            "outside the valid field of a lens model, or its uncertainty has no bound. The map takes inverse depth as "
            "linear in all errors, and so may differ slightly from the tables.",
            alt=map_words(tree, key),
            draw=partial(draw_uncertainty_map, tree, key),
            values=partial(_tables, tree, key),
        )


def _end_of_scale(tree: xr.DataTree, key: str) -> str:
    """Say that larger values share the last colour; empty if there are none."""
    depth_map = group(tree, "depth_map").sel(camera=key)
    ratios = np.concatenate([ratio_to_middle(depth_map, float(place)) for place in depth_map["distance"].values])
    return (
        f"; values above {_LARGEST_RATIO:g} are drawn as {_LARGEST_RATIO:g}"
        if np.nanmax(ratios, initial=0.0, where=np.isfinite(ratios)) > _LARGEST_RATIO
        else ""
    )


def map_words(tree: xr.DataTree, key: str) -> str:
    """Describe the maps of one rig: how the uncertainty grows towards the edges."""
    depth_map, title = group(tree, "depth_map").sel(camera=key), camera_titles(tree)[key]
    places = []
    for place in depth_map["distance"].values:
        ratio = ratio_to_middle(depth_map, float(place))
        finite = ratio[np.isfinite(ratio)]
        if finite.size:
            middle = float(depth_map["depth_uncertainty"].sel(distance=place, down=0.0, across=0.0, method="nearest"))
            places.append(
                f"{pretty(middle, LENGTH)} at {distance(float(place))} (elsewhere up to {finite.max():.1f} times that)"
            )
    return f"Depth uncertainty of {title} in the middle of the picture: {listed(places)}." if places else ""


@styled()
def draw_uncertainty_map(tree: xr.DataTree, key: str) -> StudyFigure:
    """Draw a map for each distance."""
    depth_map = group(tree, "depth_map").sel(camera=key)
    ratios = [ratio_to_middle(depth_map, float(place)) for place in depth_map["distance"].values]
    finite = np.concatenate([ratio[np.isfinite(ratio)] for ratio in ratios])
    low, high = (
        (float(finite.min()), min(float(finite.max()), _LARGEST_RATIO)) if finite.size else (1.0, _LARGEST_RATIO)
    )
    figure = new_figure(1.7)
    panels = figure.subplots(1, len(ratios), squeeze=False)[0]
    for axes, ratio, place in zip(panels, ratios, depth_map["distance"].values, strict=True):
        bare(axes, distance(float(place)))
        values = np.asarray(depth_map["depth_uncertainty"].sel(distance=place).values, dtype=np.float64) * 1e3
        middle = float(values[values.shape[0] // 2, values.shape[1] // 2])
        axes.imshow(
            np.where(np.isfinite(ratio), values, np.nan),
            cmap="viridis",
            norm=Normalize(low * middle, high * middle) if np.isfinite(middle) else Normalize(low, high),
            label="depth uncertainty [mm]",
        )
    bar = figure.colorbar(ScalarMappable(norm=Normalize(low, high), cmap="viridis"), ax=panels.tolist(), shrink=0.8)
    bar.set_label("relative to\nthe middle", fontsize=SMALL)
    return figure


def _tables(tree: xr.DataTree, key: str) -> Tables:
    depth_map = group(tree, "depth_map").sel(camera=key)
    places = depth_map["distance"].values.tolist()
    return uncertainty_map_tables(places, [ratio_to_middle(depth_map, float(place)) for place in places])


_TOLERANCE = 0.1  # of the spread: how closely a fitted matcher should predict it at other distances
_LARGEST_BIAS = 0.05  # px
_MARGIN = 1.1  # the axis reaches this factor beyond the planes
_MOST_TICKS = 5  # steps of an axis
_LARGEST_MARK = 6.5  # points
_PANELS = {
    "Spread of the depth errors": "spread [% of distance]",
    "Spread relative to that from noise": "ratio",
    "Standard deviation relative to the fitted matcher's prediction": "ratio",
    "Bias of the disparity": "bias [px]",
}


def depth_loop_drawings(tree: xr.DataTree) -> Iterator[Drawing]:
    """The figure of a study with a depth loop."""
    if not has(tree, "depth_loop", "depth_spread"):
        return
    data, titles = group(tree, "depth_loop"), camera_titles(tree)
    names = listed([titles[str(key)] for key in data["camera"].values])
    distance = data["distance"].values
    yield Drawing(
        name="depth_loop",
        caption="Depth of rendered planes, with standard errors. First: spread of the depth errors (marks: half their "
        "central 68.27 % interval) and the predicted depth uncertainty (curves). Second: spread of the errors, each "
        "divided by the standard deviation that noise causes in its matching window. Third: standard deviation of the "
        "errors without false matches, relative to the prediction of the matcher fitted at the distances with filled "
        "marks; grey: within 10 %. Fourth: bias of the disparity; grey: within 0.05 px." + _varied_words(data),
        alt=f"For {names}, from {span(float(distance[0]), float(distance[-1]))}: achieved and predicted spread, the "
        f"spread relative to noise and to the fitted matcher, and bias. Spread relative to that from noise: "
        f"{_noise_words(tree)}.",
        draw=lambda: draw_loop(tree),
    )


def _varied_words(data: xr.Dataset) -> str:
    """Say where the values of several contrasts and lights are; empty if there is one of each."""
    varied = [word for dim, word in (("contrast", "contrast"), ("electrons", "light")) if data.sizes[dim] > 1]
    return f" Every {' and '.join(varied)} has marks of its own; the table below lists their values." if varied else ""


def _noise_words(tree: xr.DataTree) -> str:
    """The smallest and largest spread of each camera, relative to that from noise alone."""
    data, titles = group(tree, "depth_loop"), camera_titles(tree)
    words = []
    for key in data["camera"].values:
        values = np.asarray(data["depth_over_bound"].sel(camera=key).values, dtype=np.float64)
        finite = values[np.isfinite(values)]
        spread = f"{significant(finite.min())} to {significant(finite.max())}" if finite.size else "not measured"
        words.append(f"{titles[str(key)]} {spread}")
    return "; ".join(words)


@styled()
def draw_loop(tree: xr.DataTree) -> StudyFigure:
    """Draw four panels over distance, with a colour for each camera, and a curve for each of its contrasts and lights.

    If the names of all curves do not fit beside a panel, one curve of each camera gets the name of the camera.
    """
    data, titles = group(tree, "depth_loop"), camera_titles(tree)
    distance = data["distance"].values
    ends = float(distance[0]), float(distance[-1])
    names = [titles[str(camera)] for camera in data["camera"].values]
    figure = new_figure(6.6)
    panels = list(figure.subplots(4, 1, sharex=True))
    for axes, (title, label) in zip(panels, _PANELS.items(), strict=True):
        axes.set_ylabel(label)
        axes.set_title(title, fontsize=PANEL_TITLE)
    distance_axis(panels[0], (ends[0] / _MARGIN, ends[1] * _MARGIN), dense=True)
    panels[-1].set_xlabel(distance_label(ends[1]))
    log_axis(panels[0], "y")
    # Matplotlib's choice depends on the height of a panel, which is known too late for the margins.
    for axes in panels[1:]:
        axes.locator_params("y", nbins=_MOST_TICKS)
    panels[1].axhline(1.0, color=INK, linewidth=0.6)
    panels[2].axhspan(1.0 - _TOLERANCE, 1.0 + _TOLERANCE, color=FAINT)
    panels[3].axhspan(-_LARGEST_BIAS, _LARGEST_BIAS, color=FAINT)
    drawn: list[list[NamedCurve]] = [[] for _ in panels]
    camera_of_curve: list[int] = []
    for k, c, e in itertools.product(*(range(data.sizes[dim]) for dim in ("camera", "contrast", "electrons"))):
        taken = data.isel(camera=k, contrast=c, electrons=e)
        camera_of_curve.append(k)
        label = ", ".join([names[k], *_texture_and_light(data, taken)])
        for curves, curve in zip(drawn, _draw(panels, taken, k, label), strict=True):
            curves.append(curve)
    for axes, curves in zip(panels, drawn, strict=True):
        axes.set_ylim(axes.get_ylim())  # from here on fixed, as names need it
        if not names_fit(axes, [curve.name for curve in curves]):
            last_of_each = dict(zip(camera_of_curve, curves, strict=True))
            curves = [replace(curve, name=names[k]) for k, curve in last_of_each.items()]
        name_ends(axes, curves)
    return figure


def _texture_and_light(data: xr.Dataset, taken: xr.Dataset) -> Iterator[str]:
    """The contrast and the light of some pictures, where the loop has several."""
    for dim, dimension in (("contrast", FRACTION), ("electrons", ELECTRONS)):
        if data.sizes[dim] > 1:
            yield pretty(float(taken[dim].item()), dimension)


def _draw(panels: Sequence[Axes], data: xr.Dataset, order: int, label: str) -> Iterator[NamedCurve]:
    """Draw one camera in one texture and light, and yield its values in each panel."""
    style = line_style(order)
    distance = data["distance"].values
    predicted = data["depth_predicted"].values / distance * 100.0
    panels[0].plot(
        distance, predicted, color=style.color, linestyle=style.dash, linewidth=1.0, label=f"{label}, predicted"
    )
    scale = 100.0 / distance
    fitted = data["fitted"].values > 0.0
    # Later marks are smaller, and those not fitted are open, so that all marks at one place can be seen.
    size = max(_LARGEST_MARK - 1.0 * order, 3.0)
    for axes, (variable, factor) in zip(panels, _values(scale), strict=True):
        values, errors = data[variable].values * factor, data[f"{variable}_error"].values * factor
        for among, filled in ((fitted, True), (~fitted, False)):
            axes.errorbar(
                distance[among],
                values[among],
                yerr=errors[among],
                fmt=style.marker,
                color=style.color,
                markerfacecolor=style.color if filled else "none",
                markersize=size,
                elinewidth=1.0,
                capsize=2.0,
                label=label,
            )
        yield NamedCurve(name=label, color=style.color, x=distance, y=values)


def _values(scale: FloatArray) -> tuple[tuple[str, FloatArray], ...]:
    """The variable that each panel shows, and the factor for its values."""
    same = np.ones_like(scale)
    return ("depth_spread", scale), ("depth_over_bound", same), ("over_matcher", same), ("depth_bias_px", same)

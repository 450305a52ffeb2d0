"""Depth uncertainty over the picture: maps for a few distances on one scale."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
import xarray as xr

from tradestudy.figures.drawing import Drawing
from tradestudy.figures.pictures import bare
from tradestudy.figures.style import SMALL, StudyFigure, new_figure, styled
from tradestudy.figures.value_tables import Tables, uncertainty_map_tables
from tradestudy.results.views.groups import FloatArray, camera_titles, group, has
from tradestudy.units import LENGTH, pretty
from tradestudy.wording import distance, listed

_MOST = 3.0  # times the uncertainty in the middle: the scale ends here at most


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
    one = group(tree, "depth_map").sel(camera=key)
    ratios = np.concatenate([_ratio(one.sel(distance=place)) for place in one["distance"].values])
    return (
        f"; values above {_MOST:g} are drawn as {_MOST:g}"
        if np.nanmax(ratios, initial=0.0, where=np.isfinite(ratios)) > _MOST
        else ""
    )


def map_words(tree: xr.DataTree, key: str) -> str:
    """Describe the maps of one rig: how the uncertainty grows towards the edges."""
    one, title = group(tree, "depth_map").sel(camera=key), camera_titles(tree)[key]
    found = []
    for place in one["distance"].values:
        ratio = _ratio(one.sel(distance=place))
        known = ratio[np.isfinite(ratio)]
        if known.size:
            middle = float(one["depth_uncertainty"].sel(distance=place, down=0.0, across=0.0, method="nearest"))
            found.append(
                f"{pretty(middle, LENGTH)} at {distance(float(place))} (elsewhere up to {known.max():.1f} times that)"
            )
    return f"Depth uncertainty of {title} in the middle of the picture: {listed(found)}." if found else ""


@styled()
def draw_uncertainty_map(tree: xr.DataTree, key: str) -> StudyFigure:
    """Draw a map for each distance."""
    one = group(tree, "depth_map").sel(camera=key)
    ratios = [_ratio(one.sel(distance=place)) for place in one["distance"].values]
    known = np.concatenate([ratio[np.isfinite(ratio)] for ratio in ratios])
    low, high = (float(known.min()), min(float(known.max()), _MOST)) if known.size else (1.0, _MOST)
    figure = new_figure(1.7)
    panels = figure.subplots(1, len(ratios), squeeze=False)[0]
    for axes, ratio, place in zip(panels, ratios, one["distance"].values, strict=True):
        bare(axes, distance(float(place)))
        shown = axes.imshow(np.where(np.isfinite(ratio), ratio, np.nan), cmap="viridis", vmin=low, vmax=high)
    bar = figure.colorbar(shown, ax=panels.tolist(), shrink=0.8)
    bar.set_label("relative to\nthe middle", fontsize=SMALL)
    return figure


def _tables(tree: xr.DataTree, key: str) -> Tables:
    one = group(tree, "depth_map").sel(camera=key)
    places = one["distance"].values.tolist()
    return uncertainty_map_tables(places, [_ratio(one.sel(distance=place)) for place in places])


def _ratio(one: xr.Dataset) -> FloatArray:
    values = np.asarray(one["depth_uncertainty"].values, dtype=np.float64)
    return np.asarray(values / values[values.shape[0] // 2, values.shape[1] // 2])

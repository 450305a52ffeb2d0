"""Error sources of depth: their shares of the variance of inverse depth over distance, with a panel per camera."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.patches import Patch
from numpy.lib.stride_tricks import sliding_window_view

from tradestudy.figures.curves import Flags, fill
from tradestudy.figures.style import (
    DECLARED,
    INK,
    PANEL_TITLE,
    PANELS_IN_A_ROW,
    SMALL,
    CameraTrace,
    StudyFigure,
    camera_panels,
    legend,
    letters_on,
    line_style,
    new_figure,
    panel_size,
    shortened,
    styled,
    traces,
)
from tradestudy.results.views.depth import nominal, where_measured, where_usable
from tradestudy.results.views.groups import FloatArray

_LEAST = 0.005  # a smaller share can hardly be seen
_NOISE = "#c3c8cf"
_NEARLY = 0.95  # of the largest room
_LETTER, _SPARE = 0.62, 0.5  # in units of the font size: mean width of a letter, and room above and below lines


def largest_shares(depth: xr.Dataset) -> dict[str, float]:
    """The largest share of each part over all cameras and distances; NaN if none is known."""
    rows = depth["variance_share"].transpose("part", ...)
    flat = rows.values.reshape(rows.sizes["part"], -1)
    known = np.where(np.isnan(flat), -np.inf, flat).max(axis=1)
    return {str(name): float(m) if m >= 0.0 else np.nan for name, m in zip(rows["part"].values, known, strict=True)}


def shown_parts(depth: xr.Dataset) -> list[str]:
    """The parts whose share is worth drawing somewhere, in their own order."""
    return [name for name, largest in largest_shares(depth).items() if largest > _LEAST]


@styled()
def draw_variance_shares(tree: xr.DataTree) -> StudyFigure:
    """Draw shares of the variance of inverse depth against distance, stacked to 1, and paler where not usable."""
    depth, shown = where_measured(nominal(tree)), traces(tree)
    names = shown_parts(depth)
    figure = new_figure(0.7 + 1.25 * -(-len(shown) // PANELS_IN_A_ROW))
    panels = camera_panels(figure, len(shown), depth["distance"].values)
    panels[0].set(ylim=(0.0, 1.0), yticks=[0.0, 0.5, 1.0], yticklabels=["0", "50 %", "100 %"])
    named = {name for axes, camera in zip(panels, shown, strict=True) for name in _panel(axes, depth, camera, names)}
    for axes in panels[::PANELS_IN_A_ROW]:
        axes.set_ylabel("share of variance")
    if thin := [name for name in names if name not in named]:
        handles = [Patch(facecolor=_color(names, name)) for name in thin]
        legend(figure, handles, thin, columns=4)
    return figure


def _color(names: list[str], name: str) -> str:
    """The colour of a part: grey for matching noise, other colours for sources that averaging does not reduce."""
    return _NOISE if name == "noise" else line_style(names.index(name) - ("noise" in names)).color


def _panel(axes: Axes, depth: xr.Dataset, camera: CameraTrace, names: list[str]) -> Iterator[str]:
    """Draw the areas of a camera, and yield the parts whose area has room for a name."""
    distance = np.asarray(depth["distance"].values, dtype=np.float64)
    shares = depth["variance_share"].sel(camera=camera.key, part=names).transpose("part", "distance").values
    known = np.isfinite(shares).any(axis=0)
    bottom = np.zeros_like(distance)
    usable = depth["usable"].sel(camera=camera.key).values.astype(bool)
    for name, share in zip(names, np.nan_to_num(shares), strict=True):
        if share.any():
            look = {"color": _color(names, name), "label": name, "gid": f"variance_share:{name}/{camera.key}"}
            fill(axes, distance, bottom, bottom + share, known, **look)
            for words in (name, name.replace(" ", "\n")):
                if (place := _free_place(axes, words, bottom, bottom + share, known, usable)) is not None:
                    middle, level = place
                    color = letters_on(_color(names, name)) if usable[middle] and name != "noise" else INK
                    axes.text(
                        distance[middle], level, words, color=color, fontsize=SMALL, linespacing=1.0, ha="center",
                        va="center", zorder=3, gid=DECLARED,
                    )  # fmt: skip
                    yield name
                    break
        bottom = bottom + share
    nothing = ((distance[0], distance[0]),)  # pages that show another design move it
    for near, far in _not_usable(depth, camera.key, distance) or nothing:
        axes.axvspan(near, far, color="white", alpha=0.6, linewidth=0, zorder=2, gid=f"unusable/{camera.key}")
    axes.set_title(shortened(camera.title, 34), fontsize=PANEL_TITLE)


def _free_place(
    axes: Axes, words: str, bottom: FloatArray, top: FloatArray, known: Flags, usable: Flags
) -> tuple[int, float] | None:
    """Where words fit best: index and height of the middle of the highest stretch of an area in one shade."""
    width, height = panel_size(axes)
    lines = words.split("\n")
    half = int(np.ceil(0.5 * len(bottom) * _LETTER * SMALL * max(map(len, lines)) / width))
    if 2 * half >= len(bottom):
        return None
    over = partial(sliding_window_view, window_shape=2 * half + 1)
    shades = over(usable)
    fits = over(known).all(axis=1) & (shades.all(axis=1) | ~shades.any(axis=1))
    rooms = np.where(fits, over(top).min(axis=1) - over(bottom).max(axis=1), 0.0)
    if rooms.max() < (len(lines) + _SPARE) * SMALL / height:
        return None
    places = np.flatnonzero(rooms > _NEARLY * rooms.max())
    middle = half + int(places[len(places) // 2])
    here = slice(middle - half, middle + half + 1)
    return middle, float(top[here].min() + bottom[here].max()) / 2.0


def _not_usable(depth: xr.Dataset, camera: str, distance: FloatArray) -> list[tuple[float, float]]:
    """The stretches of distance [m] where a camera is not usable."""
    ends = [float(distance[0])]
    for near, far in where_usable(depth, camera):
        ends += [near, min(far, float(distance[-1]))]
    ends.append(float(distance[-1]))
    return [(a, b) for a, b in zip(ends[::2], ends[1::2], strict=True) if b > a]

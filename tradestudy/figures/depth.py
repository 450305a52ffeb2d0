"""Depth uncertainty against distance: its curves, the paper's figures 8 and 9, its sources, and points off the axis."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import Final

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.text import Annotation
from matplotlib.ticker import FuncFormatter
from matplotlib.transforms import offset_copy
from numpy.lib.stride_tricks import sliding_window_view

from tradestudy.figures.curves import Flags, NamedCurve, beneath, fill, name_ends, name_places
from tradestudy.figures.style import (
    DECLARED,
    FAINT,
    INK,
    MOST_CAMERAS,
    PANEL_TITLE,
    PANELS_IN_A_ROW,
    SMALL,
    SOFT,
    CameraTrace,
    StudyFigure,
    all_traces,
    camera_panels,
    distance_axis,
    distance_label,
    distance_tick,
    legend,
    length_tick,
    letters_on,
    line_style,
    log_axis,
    named_rows,
    new_figure,
    panel_size,
    shortened,
    styled,
    traces,
)
from tradestudy.results import judged_uncertainty
from tradestudy.results.views.decision import has_winners, reported_winners, shown_ends, tied, winners
from tradestudy.results.views.depth import field_words, nominal, of_camera, where_measured, where_usable, worst_corner
from tradestudy.results.views.groups import FloatArray, group, records
from tradestudy.wording import distance as distance_words

MM = 1e3
_WIDEST = 1e3  # factor by which bounds may extend the axis of the depth uncertainty beyond its curves
_UNUSABLE_WIDTH, _USABLE_WIDTH, _WIDER = 0.8, 1.7, 1.2  # points: wider by this much for each curve on top
MOST_BOUNDS: Final = 2  # named requirements
_MOST_CROSSOVERS: Final = 10
_LETTERS_OF_BOUND: Final = 36  # of the name of a requirement
_LETTERS_ACROSS: Final = 62  # of a name written into the bar of the best camera
_SPOTS: Final = (
    (0.0, 3.5, "left", "bottom"), (0.0, -3.5, "left", "top"), (5.0, 0.0, "left", "center"),
    (5.0, 6.0, "left", "bottom"), (5.0, 12.0, "left", "bottom"), (5.0, -12.0, "left", "top"),
    (-5.0, -12.0, "right", "top"), (-5.0, 12.0, "right", "bottom"), (-5.0, 6.0, "right", "bottom"),
    (-5.0, 0.0, "right", "center"), (0.0, -3.5, "right", "top"), (0.0, 3.5, "right", "bottom"),
    (5.0, -18.0, "left", "top"), (5.0, 18.0, "left", "bottom"),
    (-5.0, 18.0, "right", "bottom"), (-5.0, -18.0, "right", "top"),
)  # fmt: skip
"""Shifts [points] of a name from an end of its line, and its alignment."""
_FARTHER: Final = (4.0, 12.0)  # points up or down; nearer spots are tried first
_FINE: Final = 500  # points of a curve
_LETTER: Final = 0.62  # mean width of a letter, of its size
_GUIDES: Final = ((1e-4, "0.01 %"), (1e-3, "0.1 %"), (1e-2, "1 % of distance"), (1e-1, "10 %"), (1.0, "100 %"))


@styled()
def draw_discrimination_and_uncertainty(tree: xr.DataTree, near: float, far: float) -> StudyFigure:
    """Two panels over distances from `near` to `far` [m]: discrimination and uncertainty, in millimetres."""
    depth, shown = where_measured(nominal(tree)), traces(tree)
    figure = new_figure(max(4.1, 1.1 + 0.28 * len(shown)))  # names beside the panels need this room
    upper, lower = figure.subplots(2, 1, sharex=True, sharey=True)
    distance = np.asarray(depth["distance"].values, dtype=float)
    # One more point on each side, so that curves reach the edge of the panel.
    inside = np.flatnonzero((distance >= near) & (distance <= far))
    view = depth.isel(distance=slice(max(inside[0] - 1, 0), inside[-1] + 2))
    nearer, farther = (
        [of_camera(view, "depth_discrimination", camera.key, side=side) for camera in shown]
        for side in ("nearer", "farther")
    )
    uncertainty = [of_camera(view, "depth_uncertainty", camera.key) for camera in shown]
    limits = depth_limits([*nearer, *uncertainty], view["distance"].values, near, far)
    for axes, title, label in (
        (upper, "Discrimination", "change of depth"),
        (lower, "Uncertainty (68 %)", "uncertainty"),
    ):
        log_axis(axes, "y", tick=length_tick, ends=limits)
        axes.set(xlim=(near, far), ylim=limits, title=title, ylabel=label)
        axes.xaxis.set_major_formatter(FuncFormatter(distance_tick(far)))
    for camera, first, last in zip(shown, nearer, farther, strict=True):
        _band(upper, view, camera, first, last)
    draw_curves(upper, view, shown, nearer, variable="depth_discrimination")
    draw_curves(lower, view, shown, uncertainty)
    lower.set_xlabel(distance_label(far))
    handles: list[Line2D | Patch] = [
        Line2D([], [], color=SOFT, linewidth=_USABLE_WIDTH),
        Line2D([], [], color=SOFT, linewidth=_UNUSABLE_WIDTH),
        Patch(color=SOFT, alpha=0.2, linewidth=0),
    ]
    labels = ["usable", "not usable", "between a step nearer and a step farther"]
    legend(figure, handles, labels, columns=len(labels))
    return figure


def depth_limits(curves: list[FloatArray], distance: FloatArray, near: float, far: float) -> tuple[float, float]:
    """Limits [mm] of depth: they contain the curves between two distances, but end little above the distance itself."""
    inside = (distance > near) & (distance < far)
    ends = [near, far]  # between points of a coarse grid
    values = np.concatenate([np.append(curve[inside], np.interp(ends, distance, curve)) for curve in curves])
    values = values[np.isfinite(values) & (values > 0)] * MM
    if not values.size:
        return 0.01 * far, far * MM
    # A percentile, because discrimination falls to zero where a plenoptic camera's image lies on its array.
    return float(np.percentile(values, 2.0)) / 1.5, min(float(values.max()) * 1.5, 2.0 * far * MM)


def draw_curves(
    axes: Axes,
    view: xr.Dataset,
    shown: Sequence[CameraTrace],
    metres: Sequence[FloatArray],
    *,
    variable: str = "depth_uncertainty",
) -> None:
    """Draw the curve of every camera, named at its end; the scales and limits of the axes must be set."""
    distance = np.asarray(view["distance"].values, dtype=float)
    for camera, curve, under in zip(shown, metres, covered_by(metres, axes.get_ylim()), strict=True):
        draw_curve(axes, view, camera, curve, under, variable)
    name_ends(
        axes,
        [
            NamedCurve(name=camera.title, color=camera.style.color, x=distance, y=curve * MM)
            for camera, curve in zip(shown, metres, strict=True)
        ],
    )


def covered_by(metres: Sequence[FloatArray], limits: tuple[float, float]) -> list[int]:
    """Count, for each curve of depths [m], the later ones that lie on it, between limits in millimetres."""
    return beneath([curve * MM for curve in metres], limits)


def draw_curve(
    axes: Axes,
    view: xr.Dataset,
    camera: CameraTrace,
    metres: FloatArray,
    under: int = 0,
    variable: str = "depth_uncertainty",
) -> None:
    """Draw a curve over all distances, bold where the camera is usable, and wider if it lies `under` other curves."""
    distance = np.asarray(view["distance"].values, dtype=float)
    y = np.where(np.isfinite(metres) & (metres > 0), metres * MM, np.nan)
    line = {"color": camera.style.color, "linestyle": camera.style.dash, "zorder": 2.0 - 0.01 * under}
    wider = _WIDER * under
    axes.plot(distance, y, linewidth=_UNUSABLE_WIDTH + 0.7 * wider, alpha=0.6, **line, **camera.shows(variable))
    bold = np.where(view["usable"].sel(camera=camera.key).values.astype(bool), y, np.nan)
    axes.plot(
        distance, bold, linewidth=_USABLE_WIDTH + wider, gapcolor="white", **line, **camera.shows(variable, "usable")
    )


def _band(axes: Axes, view: xr.Dataset, camera: CameraTrace, nearer: FloatArray, farther: FloatArray) -> None:
    """Fill the band between the step nearer and the step farther; an infinite step has no upper edge."""
    top = np.where(np.isinf(farther), 1e9, farther * MM)
    distance = np.asarray(view["distance"].values, dtype=float)
    look = {"color": camera.style.color, "alpha": 0.13, **camera.shows("depth_discrimination")}
    fill(axes, distance, nearer * MM, top, np.isfinite(nearer), **look)


@styled()
def draw_whole_range(tree: xr.DataTree, most: int = MOST_CAMERAS) -> StudyFigure:
    """Judged uncertainty over the whole range, log–log, with usable intervals and the best camera as bars below.

    The figure has at most `most` cameras, and the tightest requirements.
    """
    depth, shown = where_measured(nominal(tree)), traces(tree, most=most)
    figure = new_figure(2.75 + 0.17 * len(shown))
    rows = len(shown) + (len(shown) > 1)
    curves, bars = figure.subplots(2, 1, sharex=True, height_ratios=(2.0, 0.16 * rows + 0.2))
    distance = np.asarray(depth["distance"].values, dtype=float)
    depth = depth.assign(judged_uncertainty=judged_uncertainty(depth))
    drawn = [of_camera(depth, "judged_uncertainty", camera.key) for camera in shown]
    distance_axis(curves, (float(distance[0]), float(distance[-1])), dense=True)
    bounds = required_uncertainties(tree)[:MOST_BOUNDS]
    low, high = depth_limits(drawn, distance, float(distance[0]), float(distance[-1]))
    required_mm = [MM * end for requirement in bounds for end in requirement.bound.tolist()] or [np.nan]
    # An absurd bound, far below or above all curves, is not worth flattening them.
    low = max(np.fmin(low, 0.5 * min(required_mm)), low / _WIDEST)
    high = min(np.fmax(high, 2.0 * max(required_mm)), high * _WIDEST)
    log_axis(curves, "y", tick=length_tick, ends=(float(low), float(high)))
    curves.set(ylim=(low, high), ylabel="depth uncertainty (68 %)")
    draw_curves(curves, depth, shown, drawn, variable="judged_uncertainty")
    edges = crossovers(tree)
    required = [np.interp(distance, r.over, r.bound, left=np.nan, right=np.nan) for r in bounds]
    draw_relative_guides(curves, distance, [*drawn, *required], edges)
    # Points so close together that no name fits between two of them.
    fine = np.geomspace(distance[0], distance[-1], _FINE)
    lines = [np.column_stack([fine, np.interp(fine, distance, curve)]) for curve in (*drawn, *required)]
    hidden = np.concatenate([*lines, *(np.column_stack([r.over, r.bound]) for r in bounds)])
    for k, requirement in enumerate(bounds):
        name, others = shortened(requirement.says, _LETTERS_OF_BOUND), [*drawn, *required[:k], *required[k + 1 :]]
        look = {"linestyle": (0, (4, 1.5)), "linewidth": 1.1, "marker": "|", "markersize": 4.0}
        if requirement.is_point:
            look |= {"linestyle": "", "marker": "D", "markersize": 3.5}
        ends = slice(1 if requirement.is_point else 2)
        curves.plot(requirement.over[ends], requirement.bound[ends] * MM, color=INK, zorder=2.1, **look)
        if requirement.is_point or not _name_along(curves, distance, required[k], name, others, edges):
            _name_beside(curves, requirement, name, hidden)
    _bars(bars, depth, shown)
    if has_winners(tree):
        if len(shown) > 1:
            _best_camera_bar(bars, tree, shown)
        _crossovers((curves, bars), edges)
    bars.set_xlabel(distance_label(float(distance[-1])))
    return figure


def _name_beside(axes: Axes, required: RequiredUncertainty, name: str, hidden: FloatArray) -> None:
    """Name a required uncertainty beside an end, where the name hides none of these points [m] and no other name.

    Without such a place, it gets no name.
    """
    drawn = np.array(axes.transData.transform(hidden * (1.0, MM)))
    names = [text.get_window_extent() for text in axes.texts if not isinstance(text, Annotation)]
    is_left = np.log(required.over).mean() < np.mean(np.log(axes.get_xlim()))
    # The nearest spots first, and of these the ones from which the text runs into the wider part of the panel.
    spots = sorted(_SPOTS, key=lambda spot: (np.searchsorted(_FARTHER, abs(spot[1])), (spot[2] == "left") != is_left))
    for (across, up, ha, va), end in product(spots, (0, -1) if is_left else (-1, 0)):
        text = axes.text(
            float(required.over[end]), float(required.bound[end]) * MM, name, ha=ha, va=va, color=INK, fontsize=SMALL,
            transform=offset_copy(axes.transData, axes.get_figure(root=True), across, up, "points"), zorder=4,
            bbox={"facecolor": "white", "alpha": 0.8, "linewidth": 0.0, "pad": 0.5},
        )  # fmt: skip
        box = text.get_window_extent()
        inside = axes.bbox.x0 <= box.x0 and box.x1 <= axes.bbox.x1 and axes.bbox.y0 <= box.y0 and box.y1 <= axes.bbox.y1
        if inside and not box.count_overlaps(names) and not box.padded(3.0).count_contains(drawn):
            return
        text.remove()


@dataclass(frozen=True, kw_only=True)
class RequiredUncertainty:
    """The largest depth uncertainty [m] that a requirement allows, at both ends of its computed distances [m]."""

    says: str
    over: FloatArray
    bound: FloatArray

    @property
    def is_point(self) -> bool:
        """Whether it concerns a single distance."""
        return bool(self.over[0] == self.over[1])


def required_uncertainties(tree: xr.DataTree) -> list[RequiredUncertainty]:
    """Requirements on the depth uncertainty at computed distances: first those that must hold, the tightest first."""
    rows = [row for row in records(tree, "requirements", "requirement") if row["quantity"] == "depth_uncertainty"]
    rows.sort(key=lambda row: (row["priority"] != "must", float(np.nan_to_num(row["margin_percent"], nan=-np.inf))))
    required = []
    for row in rows:
        distance = group(tree, "depth")["distance"].values
        over = np.array([row["over_near"], row["over_far"]], dtype=float)
        if over[0] <= distance[-1] and over[1] >= distance[0]:
            over = np.clip(over, distance[0], distance[-1])
            bound = float(row["bound"]) * (over if row["bound_is_relative"] else np.ones(2))
            required.append(RequiredUncertainty(says=str(row["says"]), over=over, bound=bound))
    return required


def draw_relative_guides(
    axes: Axes, distance: FloatArray, drawn: Sequence[FloatArray], edges: Sequence[float] = ()
) -> None:
    """Draw lines of equal relative uncertainty, each named where its name is farthest from all curves and edges.

    Parameters
    ----------
    axes
        Logarithmic, with limits, in metres across and millimetres up.
    distance
        Of the curves [m].
    drawn
        Uncertainties [m] over `distance`.
    edges
        Distances [m] of vertical lines.
    """
    for share, name in _GUIDES:
        axes.plot(distance, share * distance * MM, color=FAINT, linewidth=0.9, zorder=0.5)
        _name_along(axes, distance, share * distance, name, drawn, edges)


def _name_along(
    axes: Axes, distance: FloatArray, line: FloatArray, name: str, others: Sequence[FloatArray], edges: Sequence[float]
) -> bool:
    """Write the name of a line [m] on it, where there is room between curves [m] and vertical lines at `edges` [m].

    Returns whether there is room.
    """
    (left, right), (bottom, top) = np.log(axes.get_xlim()), np.log(axes.get_ylim())
    wide, tall = panel_size(axes)
    x = (np.log(distance) - left) / (right - left)
    uprights = [float((np.log(edge) - left) / (right - left)) for edge in edges]
    with np.errstate(divide="ignore", invalid="ignore"):
        levels = [(np.log(depth * MM) - bottom) / (top - bottom) for depth in (line, *others)]
    shown = [np.where(np.isfinite(level), level, np.nan) for level in levels]
    width, height = _LETTER * SMALL * len(name) / wide, 1.6 * SMALL / tall
    middle = _free_place(x, shown[0], shown[1:], uprights, (width, height))
    if middle is None:
        return False
    drawn = np.isfinite(shown[0])
    before, foot, after = np.interp([middle - 0.5 * width, middle, middle + 0.5 * width], x[drawn], shown[0][drawn])
    slope = float(np.degrees(np.arctan2(tall * (after - before), wide * width)))
    axes.text(
        middle, float(foot), name, transform=axes.transAxes, color=SOFT, fontsize=SMALL, ha="center", va="bottom",
        rotation_mode="anchor", rotation=slope,
    )  # fmt: skip
    return True


def _free_place(
    x: FloatArray,
    guide: FloatArray,
    levels: Sequence[FloatArray],
    uprights: Sequence[float],
    size: tuple[float, float],
) -> float | None:
    """Where a text of this size fits on a guide, as fractions of the panel; None if it fits nowhere."""
    width, height = size
    best, room = None, 0.0
    # A tenth of the width stays free on either side of the text.
    for middle in np.arange(1.0 - 0.6 * width, 0.6 * width, -0.02):
        here = np.abs(x - middle) <= 0.6 * width
        foot = float(np.interp(middle, x, guide))
        if not (here.any() and 0.01 <= foot <= 0.99 - height) or np.isnan(guide[here]).any():
            continue
        if any(abs(upright - middle) <= 0.6 * width for upright in uprights):
            continue
        apart = [np.abs(level[here] - (foot + height / 2.0)) for level in levels]
        nearest = min((float(np.nanmin(gaps)) for gaps in apart if np.isfinite(gaps).any()), default=1.0)
        if nearest > height:
            return float(middle)
        if nearest > max(room, 0.6 * height):
            best, room = float(middle), nearest
    return best


def _bars(axes: Axes, depth: xr.Dataset, shown: tuple[CameraTrace, ...]) -> None:
    """Draw one line of bars per camera: the distances at which it is usable."""
    last = float(depth["distance"].values[-1])
    for row, camera in enumerate(shown):
        shows, where = camera.shows("usable"), list(where_usable(depth, camera.key))
        # HTML pages that show another design move the ends of bars, and so need a bar even for a camera usable nowhere.
        for near, far in where or [(last, last)]:
            end = min(far, last)
            (bar,) = axes.barh(row, end - near, left=near, height=0.62, color=camera.style.color, linewidth=0)
            bar.set(**shows)
            # The camera's line style runs through its bar, for readers without colours.
            axes.plot([near, end], [row, row], color="white", linestyle=camera.style.dash, linewidth=0.9, **shows)
        if not where:
            axes.text(
                0.01, row, "usable nowhere", transform=axes.get_yaxis_transform(), va="center", fontsize=SMALL,
                color=SOFT, gid=DECLARED,
            )  # fmt: skip
    named_rows(axes, [shortened(camera.title) for camera in shown])
    axes.yaxis.tick_right()
    axes.tick_params(axis="y", length=0)
    axes.set_title("Usable", fontsize=PANEL_TITLE)


def _best_camera_bar(axes: Axes, tree: xr.DataTree, shown: tuple[CameraTrace, ...]) -> None:
    by_key = {camera.key: camera for camera in all_traces(tree)}
    row = len(shown) + 0.25
    distance = nominal(tree)["distance"].values
    for start, end, answer in winners(tree):
        best = tied(answer)
        for order, key in enumerate(best):  # equally good cameras share the bar
            height = 0.9 / len(best)
            middle = row - 0.45 + (order + 0.5) * height
            color = by_key[key].style.color
            (bar,) = axes.barh(middle, end - start, left=start, height=height, color=color, linewidth=0)
            bar.set_gid("best")
        if len(best) == 1:
            title = shortened(by_key[best[0]].title)
            if len(title) <= _LETTERS_ACROSS * np.log(end / start) / np.log(distance[-1] / distance[0]):
                color = letters_on(by_key[best[0]].style.color)
                middle = float(np.sqrt(start * end))
                axes.text(middle, row, title, color=color, ha="center", va="center", fontsize=SMALL, gid=DECLARED)
    names = [*(shortened(camera.title) for camera in shown), "best camera"]
    axes.set(yticks=[*range(len(shown)), row], yticklabels=names, ylim=(row + 0.6, -0.6))
    axes.get_yticklabels()[-1].set_fontweight("bold")


def crossovers(tree: xr.DataTree) -> list[float]:
    """The distances [m] at which the best camera changes; none where there are too many to mark and to name."""
    edges = [edge for _, edge, _ in list(shown_ends(tuple(reported_winners(tree))))[:-1]] if has_winners(tree) else []
    return edges if len(edges) <= _MOST_CROSSOVERS else []


def _crossovers(panels: tuple[Axes, Axes], edges: Sequence[float]) -> None:
    """Draw a vertical line wherever the best camera changes, with the distance above the panels."""
    for edge in edges:
        for axes in panels:
            axes.axvline(edge, color=INK, linewidth=0.6, linestyle=(0, (2, 2)), zorder=0.8, gid=DECLARED)
    name_places(panels[0], edges, [distance_words(edge) for edge in edges])


_LEAST = 0.005  # a smaller share can hardly be seen
_NOISE = "#c3c8cf"
_NEARLY = 0.95  # of the largest room
_SPARE = 0.5  # of the font size: room above and below lines


def largest_shares(depth: xr.Dataset) -> dict[str, float]:
    """The largest share of each part over all cameras and distances; NaN if none is known."""
    rows = depth["variance_share"].transpose("part", ...)
    flat = rows.values.reshape(rows.sizes["part"], -1)
    largest = np.where(np.isnan(flat), -np.inf, flat).max(axis=1)
    return {
        str(part): float(share) if share >= 0.0 else np.nan
        for part, share in zip(rows["part"].values, largest, strict=True)
    }


def shown_parts(depth: xr.Dataset) -> list[str]:
    """The parts whose share is worth drawing somewhere, in their own order."""
    return [part for part, largest in largest_shares(depth).items() if largest > _LEAST]


@styled()
def draw_variance_shares(tree: xr.DataTree, shown: tuple[CameraTrace, ...]) -> StudyFigure:
    """Draw shares of the variance of inverse depth against distance, stacked to 1, and paler where not usable."""
    depth = where_measured(nominal(tree))
    names = shown_parts(depth.sel(camera=[camera.key for camera in shown]))
    figure = new_figure(0.7 + 1.25 * -(-len(shown) // PANELS_IN_A_ROW))
    panels = camera_panels(figure, len(shown), depth["distance"].values)
    panels[0].set(ylim=(0.0, 1.0), yticks=[0.0, 0.5, 1.0], yticklabels=["0", "50 %", "100 %"])
    named = {part for axes, camera in zip(panels, shown, strict=True) for part in _panel(axes, depth, camera, names)}
    for axes in panels[::PANELS_IN_A_ROW]:
        axes.set_ylabel("share of variance")
    if thin := [part for part in names if part not in named]:
        handles = [Patch(facecolor=_color(names, part)) for part in thin]
        legend(figure, handles, thin, columns=4)
    return figure


def _color(names: list[str], part: str) -> str:
    """The colour of a part: grey for matching noise, other colours for sources that averaging does not reduce."""
    return _NOISE if part == "noise" else line_style(names.index(part) - ("noise" in names)).color


def _panel(axes: Axes, depth: xr.Dataset, camera: CameraTrace, names: list[str]) -> Iterator[str]:
    """Draw the areas of a camera, and yield the parts whose area has room for a name."""
    distance = np.asarray(depth["distance"].values, dtype=np.float64)
    shares = depth["variance_share"].sel(camera=camera.key, part=names).transpose("part", "distance").values
    is_known = np.isfinite(shares).any(axis=0)
    bottom = np.zeros_like(distance)
    usable = depth["usable"].sel(camera=camera.key).values.astype(bool)
    for part, share in zip(names, np.nan_to_num(shares), strict=True):
        if share.any():
            look = {"color": _color(names, part), "label": part, "gid": f"variance_share:{part}/{camera.key}"}
            fill(axes, distance, bottom, bottom + share, is_known, **look)
            for words in (part, part.replace(" ", "\n")):
                if (place := _free_area(axes, words, bottom, bottom + share, is_known, usable)) is not None:
                    middle, level = place
                    color = letters_on(_color(names, part)) if usable[middle] and part != "noise" else INK
                    axes.text(
                        distance[middle], level, words, color=color, fontsize=SMALL, linespacing=1.0, ha="center",
                        va="center", zorder=3, gid=DECLARED,
                    )  # fmt: skip
                    yield part
                    break
        bottom = bottom + share
    nothing = ((distance[0], distance[0]),)  # pages that show another design move it
    for near, far in _not_usable(depth, camera.key, distance) or nothing:
        axes.axvspan(near, far, color="white", alpha=0.6, linewidth=0, zorder=2, gid=f"unusable/{camera.key}")
    axes.set_title(shortened(camera.title, 34), fontsize=PANEL_TITLE)


def _free_area(
    axes: Axes, words: str, bottom: FloatArray, top: FloatArray, is_known: Flags, usable: Flags
) -> tuple[int, float] | None:
    """Where words fit best: index and height of the middle of the highest stretch of an area in one shade."""
    width, height = panel_size(axes)
    lines = words.split("\n")
    half = int(np.ceil(0.5 * len(bottom) * _LETTER * SMALL * max(map(len, lines)) / width))
    if 2 * half >= len(bottom):
        return None
    over = partial(sliding_window_view, window_shape=2 * half + 1)
    shades = over(usable)
    fits = over(is_known).all(axis=1) & (shades.all(axis=1) | ~shades.any(axis=1))
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


@styled()
def draw_off_axis(tree: xr.DataTree) -> StudyFigure:
    """Draw depth uncertainty against distance on the axis (thick) and at every declared field position.

    Off the axis, the corner with the largest uncertainty counts.
    """
    depth, off, shown = nominal(tree), group(tree, "depth_field"), traces(tree)
    fields = [float(field) for field in off["field"].values]
    figure = new_figure(0.7 + 1.6 * -(-len(shown) // PANELS_IN_A_ROW))
    panels = camera_panels(figure, len(shown), depth["distance"].values)
    for axes, camera in zip(panels, shown, strict=True):
        _field_panel(axes, depth, off, camera)
    log_axis(panels[0], "y", tick=length_tick)
    panels[0].set_ylim(*_limits(depth))
    for axes in panels[::PANELS_IN_A_ROW]:
        axes.set_ylabel("uncertainty (68 %)")
    handles = [line_style(0).handle(color=INK, linestyle="-", linewidth=2.0)]
    handles += [line_style(order + 1).handle() for order in range(len(fields))]
    legend(figure, handles, [field_words(field) for field in (0.0, *fields)], columns=3)
    return figure


def _limits(depth: xr.Dataset) -> tuple[float, float]:
    """Limits [mm] that contain the known values on the axis, up to the farthest distance."""
    values = np.asarray(depth["depth_uncertainty"].values, dtype=np.float64)
    values = values[np.isfinite(values) & (values > 0.0)] * MM
    if not values.size:
        return 1e-3, 1e3
    return float(values.min()) / 2.0, 2.0 * min(float(values.max()), float(depth["distance"].values[-1]) * MM)


def _field_panel(axes: Axes, depth: xr.Dataset, off: xr.Dataset, camera: CameraTrace) -> None:
    distance = np.asarray(depth["distance"].values, dtype=np.float64)
    axes.plot(
        distance,
        _drawn(of_camera(depth, "depth_uncertainty", camera.key)),
        color=INK,
        linewidth=2.0,
        label=field_words(0.0),
    )
    for order, field in enumerate(off["field"].values):
        style = line_style(order + 1)
        off_axis = np.asarray(worst_corner(off).sel(field=field, camera=camera.key).values, dtype=np.float64)
        axes.plot(
            off["distance"].values,
            _drawn(off_axis),
            color=style.color,
            linestyle=style.dash,
            linewidth=1.3,
            label=field_words(float(field)),
        )
    axes.set_title(shortened(camera.title, 34), fontsize=PANEL_TITLE)


def _drawn(metres: FloatArray) -> FloatArray:
    return np.where(np.isfinite(metres) & (metres > 0.0), metres * MM, np.nan)

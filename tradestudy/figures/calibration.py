"""Calibration errors against distance: quantile bands with linear theory, failures, and who errs less."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from tradestudy.figures.style import (
    FAINT,
    INK,
    PANELS_IN_A_ROW,
    SOFT,
    CameraTrace,
    StudyFigure,
    camera_panels,
    distance_axis,
    distance_label,
    legend,
    line_style,
    new_figure,
    shortened,
    styled,
    traces_in,
)
from tradestudy.results.views.groups import FloatArray, camera_titles

_TOP = 2.5  # depth over distance at the upper end of the bands
_LEAST_SHARE = 1e-5


@styled()
def draw_bands(tree: xr.DataTree) -> StudyFigure:
    """Quantiles of one reading over the true distance, per camera: 95 and 68 % on the axis, 95 % at the edge."""
    shown = traces_in(tree, "calibration")
    data = tree["calibration"].to_dataset()
    figure = new_figure(0.7 + 1.75 * -(-len(shown) // PANELS_IN_A_ROW))
    reach = _reach(data.sel(way="both"))
    panels = camera_panels(figure, len(shown), float(data["distance"].values[-1]))
    for axes, camera in zip(panels, shown, strict=True):
        _band(axes, data.sel(camera=camera.key, way="both"), camera)
        axes.set_ylim(max(0.0, 1.0 - reach), 1.0 + reach)
    for axes in panels[::PANELS_IN_A_ROW]:
        axes.set_ylabel("depth / distance")
    handles: list[Line2D | Patch] = [
        Patch(color=SOFT, alpha=0.25, linewidth=0),
        Patch(color=SOFT, alpha=0.6, linewidth=0),
        Line2D([], [], color=SOFT, linewidth=1.2),
        Line2D([], [], color=INK, linewidth=0.9, linestyle=(0, (4, 2))),
        Line2D([], [], color=SOFT, linewidth=0.8, linestyle=(0, (1, 1))),
        Line2D([], [], color=INK, linewidth=0.6),
    ]
    labels = [
        "central 95 %", "central 68 %", "median", "linear theory, 95 %", "95 % at the edge of the field",
        "upright line: mean and deviation end here",
    ]  # fmt: skip
    legend(figure, handles, labels, columns=3)
    return figure


def _reach(data: xr.Dataset) -> float:
    """How far the panels go above and below the truth: as far as the widest 95 % interval, within limits."""
    ratio = np.asarray((data["depth_quantile"] / data["distance"]).values, dtype=np.float64)
    ratio = ratio[~np.isnan(ratio)]
    return float(np.clip(1.2 * np.abs(ratio - 1.0).max(), 0.01, _TOP - 1.0)) if ratio.size else _TOP - 1.0


def _band(axes: Axes, data: xr.Dataset, camera: CameraTrace) -> None:
    distance = np.asarray(data["distance"].values, dtype=np.float64)
    quantile = data["depth_quantile"].transpose("field", "quantile", "distance")
    axis = np.asarray(quantile.sel(field="axis").values) / distance
    edge = np.asarray(quantile.sel(field="edge").values) / distance
    line = np.asarray(data["linear_quantile"].sel(field="axis").transpose("quantile", "distance").values) / distance
    beyond = 2.0 * _TOP
    for low, high, alpha in ((0, 4, 0.25), (1, 3, 0.6)):
        bottom, top = (np.clip(axis[k], 0.0, beyond) for k in (low, high))
        axes.fill_between(distance, bottom, top, color=camera.style.color, alpha=alpha, linewidth=0)
    axes.plot(distance, np.clip(axis[2], 0.0, beyond), color=camera.style.color, linewidth=1.2)
    for k in (0, 4):
        axes.plot(distance, line[k], color=INK, linewidth=0.9, linestyle=(0, (4, 2)))
        axes.plot(
            distance, np.clip(edge[k], 0.0, beyond), color=camera.style.color, linewidth=0.8, linestyle=(0, (1, 1))
        )
    end = float(data["moments_end"].sel(field="axis"))
    if np.isfinite(end):
        axes.axvline(end, color=INK, linewidth=0.6)
    distance_axis(axes, (float(distance[0]), float(distance[-1])))
    axes.set_title(shortened(camera.title, 34), fontsize=7.5)


@styled()
def draw_failures(tree: xr.DataTree) -> StudyFigure:
    """Probability of a reading at or beyond infinity, and of none at all, against distance; axis and edge."""
    shown = traces_in(tree, "calibration")
    data = tree["calibration"].to_dataset().sel(way="both")
    figure = new_figure(2.9 + 0.13 * len(shown))
    panels = figure.subplots(2, 2, sharex=True, sharey=True)
    distance = np.asarray(data["distance"].values, dtype=np.float64)
    for column, field in enumerate(("axis", "edge")):
        for camera in shown:
            there = data.sel(camera=camera.key, field=field)
            shares = (there["infinite_fraction"], there["failed_fraction"].sum("cause"))
            for axes, share in zip(panels[:, column], shares, strict=True):
                axes.plot(distance, share.values, color=camera.style.color, linestyle=camera.style.dash, linewidth=1.3)
        panels[0, column].set_title(f"beyond infinity, {_FIELD_WORDS[field]}")
        panels[1, column].set(title=f"no reading, {_FIELD_WORDS[field]}", xlabel=distance_label(float(distance[-1])))
    for axes in panels.flat:
        distance_axis(axes, (float(distance[0]), float(distance[-1])))
        axes.set_yscale("symlog", linthresh=_LEAST_SHARE, linscale=0.5)
        axes.set(
            yticks=[0.0, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0],
            yticklabels=["0", "10 ppm", "0.01 %", "0.1 %", "1 %", "10 %", "100 %"],
            ylim=(0.0, 1.6),
        )
    for axes in panels[:, 0]:
        axes.set_ylabel("probability")
    legend(figure, [camera.style.handle() for camera in shown], [camera.title for camera in shown], columns=3)
    return figure


_FIELD_WORDS = {"axis": "on the axis", "edge": "at the edge"}


@styled()
def draw_rank_probability(tree: xr.DataTree) -> StudyFigure:
    """Probability that the first camera of each pair errs less, against distance; calibration alone, and with noise."""
    data = tree["decision"].to_dataset()
    titles = camera_titles(tree)
    figure = new_figure(3.9 + 0.08 * data.sizes["pair"])
    panels = figure.subplots(2, 2, sharex=True, sharey=True)
    distance = np.asarray(data["rank_distance"].values, dtype=np.float64)
    for row, way in enumerate(data["rank_way"].values):
        for column, field in enumerate(data["field"].values):
            axes = panels[row, column]
            for order, pair in enumerate(data["pair"].values):
                _rank_line(axes, distance, data.sel(pair=pair, field=field, rank_way=way), order)
            axes.axhline(0.5, color=FAINT, linewidth=0.8, zorder=0)
            words = "calibration alone" if way == "calibration" else "single readings"
            distance_axis(axes, (float(distance[0]), float(distance[-1])))
            axes.set(title=f"{words}, {_FIELD_WORDS[str(field)]}", ylim=(0.0, 1.0))
    for axes in panels[:, 0]:
        axes.set_ylabel("P(first errs less)")
    for axes in panels[1]:
        axes.set_xlabel(distance_label(float(distance[-1])))
    pairs = zip(data["pair_first"].values, data["pair_second"].values, strict=True)
    labels = [f"{titles[str(first)]} before {titles[str(second)]}" for first, second in pairs]
    legend(figure, [line_style(order).handle() for order in range(len(labels))], labels, columns=2)
    return figure


def _rank_line(axes: Axes, distance: FloatArray, there: xr.Dataset, order: int) -> None:
    style = line_style(order)
    seen = np.asarray((there["rank_first"] + there["rank_second"]).values, dtype=np.float64) > 0.0
    first = np.where(seen, np.asarray(there["rank_first"].values, dtype=np.float64), np.nan)
    error = 2.0 * np.asarray(there["rank_first_error"].values, dtype=np.float64)
    axes.fill_between(distance, first - error, first + error, color=style.color, alpha=0.2, linewidth=0)
    axes.plot(distance, first, color=style.color, linestyle=style.dash, linewidth=1.3)

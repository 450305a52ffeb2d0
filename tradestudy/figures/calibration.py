"""Figures of calibration: error sources, ranks, posteriors, and how far to trust a calibration."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from textwrap import wrap

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import LogLocator

from tradestudy.figures.curves import NamedCurve, name_ends
from tradestudy.figures.decision import draw_rank_probability
from tradestudy.figures.drawing import Drawing
from tradestudy.figures.style import (
    INK,
    PANEL_TITLE,
    SMALL,
    SOFT,
    CameraTrace,
    StudyFigure,
    camera_panels,
    legend,
    length_tick,
    line_style,
    log_axis,
    new_figure,
    selection_words,
    shortened,
    styled,
    traces,
)
from tradestudy.figures.value_tables import Tables, corner_tables, residual_tables, source_tables, trace_tables
from tradestudy.results.views.depth import field_words, largest_source
from tradestudy.results.views.groups import FloatArray, camera_titles, group
from tradestudy.units import LENGTH, pretty, significant
from tradestudy.wording import in_words


def calibration_drawings(tree: xr.DataTree) -> Iterator[Drawing]:
    """The figures on error sources, ranks and posteriors that the study allows."""
    if "sensitivity" in tree.children:
        yield from _sensitivity(tree)
    if "decision" in tree.children and "rank_first" in tree["decision"].data_vars:
        yield _ranks(tree)
    if "calibration" in tree.children and "posterior_draw" in tree["calibration"].data_vars:
        for posterior in tree["calibration"].to_dataset()["posterior"].values:
            yield from _posterior(tree, str(posterior))
            if "rig_claimed" in tree["calibration"].data_vars:
                yield from _trust(tree, str(posterior))


def _sensitivity(tree: xr.DataTree) -> Iterator[Drawing]:
    place = tornado_distance(tree)
    selection = selection_words(tree, "sensitivity")
    shown = {camera.key: camera.title for camera in traces(tree, "sensitivity")}
    sentences = [
        f"{title}: {in_words(largest)}, {_source_words(tree, key, largest, place)}. "
        for key, title in shown.items()
        if (largest := largest_source(tree, key, place)) is not None
    ]
    yield Drawing(
        name="tornado",
        caption=f"Depth uncertainty at {pretty(place, LENGTH)} (half the width of the central 68.27 % interval) from "
        "each source alone. Correlated parameters, such as those of a joint calibration, count as one source: moving "
        "one of them alone would describe cameras that the calibration rules out." + selection,
        alt="Bar charts of depth uncertainty by source, one per camera. The largest on the axis: " + "".join(sentences),
        draw=partial(draw_tornado, tree),
        values=partial(source_tables, tree, place),
    )
    yield Drawing(
        name="sobol-indices",
        caption="Total (lines) and first-order (rings) Sobol indices of inverse depth on the axis, of the "
        "independent sources whose total index reaches 0.02. A line above its ring shows interaction with other "
        "sources; total indices then sum to more than 1, so they are not shares." + selection,
        alt="One chart per camera of total and first-order Sobol indices against distance. Largest total index at "
        f"{pretty(place, LENGTH)}: " + _index_words(tree, place),
        draw=partial(draw_indices, tree),
    )


def _source_words(tree: xr.DataTree, camera: str, source: str, place: float) -> str:
    """The uncertainty of depth from one source alone, on the axis at a distance [m]."""
    alone = group(tree, "sensitivity")["source_uncertainty"].sel(
        camera=camera, field=0.0, distance=place, source=source
    )
    return pretty(float(alone), LENGTH)


def _index_words(tree: xr.DataTree, place: float) -> str:
    """The largest total index of each camera on the axis at a distance [m]."""
    indices = group(tree, "sensitivity")["total_index"].sel(field=0.0, distance=place)
    sentences = []
    for camera in traces(tree, "sensitivity"):
        values = np.asarray(indices.sel(camera=camera.key).values, dtype=np.float64)
        if np.isfinite(values).any():
            first = int(np.nanargmax(values))
            source = in_words(str(indices["source"].values[first]))
            sentences.append(f"{camera.title}: {source} {significant(float(values[first]), 2)}. ")
        else:
            sentences.append(f"{camera.title}: none is known. ")
    return "".join(sentences)


def _tie_words(tree: xr.DataTree, posterior: str) -> str:
    """The two parameters of a posterior with the strongest correlation."""
    if (tie := closest_tie(tree, posterior)) is None:
        return ""
    first, second, correlation = tie
    return f"Strongest correlation: {in_words(first)} and {in_words(second)}, {significant(correlation, 2)}."


def _ranks(tree: xr.DataTree) -> Drawing:
    decision = tree["decision"].to_dataset().sel(rank_error_source="calibration")
    titles = camera_titles(tree)
    sentences = []
    for pair in decision["pair"].values:
        ranks = decision.sel(pair=pair).sel(rank_distance=1.0, method="nearest")
        first, second = (titles[str(ranks[member].item())] for member in ("pair_first", "pair_second"))
        sentences.append(
            f"{first} more accurate than {second} at {pretty(float(ranks['rank_distance']), LENGTH)}: "
            f"{significant(100.0 * float(ranks['rank_first']))} %. "
        )
    return Drawing(
        name="rank-probability",
        caption="Probability that the depth error of the first camera is smaller than that of the second. Calibration "
        "alone: calibration errors and drift vary, and all noise is averaged out. Single measurements: noise as well. "
        "Shaded: 2 Monte Carlo standard errors. Drift with temperature or pressure that both cameras declare alike is "
        "drawn once for both.",
        alt="Probability against distance, one chart for each pair of cameras. Calibration alone: "
        + "".join(sentences),
        draw=partial(draw_rank_probability, tree),
    )


def _posterior(tree: xr.DataTree, posterior: str) -> Iterator[Drawing]:
    titles = camera_titles(tree)
    data = tree["calibration"].to_dataset().sel(posterior=posterior)
    count = int(np.isfinite(data["posterior_mean"].values).sum())
    shown = shown_parameters(tree, posterior)
    which = (
        f"the {len(shown)} most strongly correlated of {count} parameters" if len(shown) < count else "all parameters"
    )
    yield Drawing(
        name=f"corner-{posterior}",
        caption=f"Posterior of {titles[posterior]}: {which}, in standard deviations from the mean. Contours contain 39 "
        f"and 86 % of the draws, as one and two standard deviations of a bivariate normal do. Dashed: Laplace's normal "
        "approximation.",
        alt=f"Corner plot of the posterior draws of {titles[posterior]}: {', '.join(map(in_words, shown))}. "
        + _tie_words(tree, posterior),
        draw=partial(draw_corner, tree, posterior),
        values=partial(corner_values, tree, posterior),
    )
    yield Drawing(
        name=f"trace-{posterior}",
        caption=f"Chains behind the posterior of {titles[posterior]}: the first walker of each independent ensemble, "
        "one colour each, after the warm-up, in standard deviations from the mean.",
        alt=f"Trace plot of the chains of {titles[posterior]}, one row per parameter. "
        + (
            "All ensembles cover the same range: "
            if bool(data["posterior_converged"])
            else "The chains did not converge: "
        )
        + f"the largest R-hat is {float(np.nanmax(data['posterior_r_hat'].values)):.4f}.",
        draw=partial(draw_trace, tree, posterior),
        values=partial(trace_values, tree, posterior),
    )


def _trust(tree: xr.DataTree, posterior: str) -> Iterator[Drawing]:
    data = tree["calibration"].to_dataset().sel(posterior=posterior)
    if not np.isfinite(data["rig_claimed"].values).any():
        return
    ratio = data["rig_halves_difference"].values / data["rig_halves_claim"].values
    distances = [pretty(float(where), LENGTH) for where in data["rig_distance"].values]
    yield Drawing(
        name=f"trust-{posterior}",
        caption=f"How far to trust the calibration of {camera_titles(tree)[posterior]}. Above: mean residuals of each "
        "camera fitted alone, in cells of its picture; arrows that agree in neighbouring cells show errors of the lens "
        "model or of the board. Below, for a point midway between the cameras: the RMS difference between the depths "
        "that random halves of the views give (found); this difference as the uncertainties of the halves predict it "
        "(claimed); and the depth uncertainty that the fit to all views claims.",
        alt=f"Two maps of arrows for {camera_titles(tree)[posterior]}, and a chart of halves of the views, whose "
        "differences, divided by the claimed ones, are: "
        + ", ".join(f"{significant(float(times), 2)} at {where}" for times, where in zip(ratio, distances, strict=True))
        + ".",
        draw=partial(draw_trust, tree, posterior),
        values=partial(residual_tables, data["rig_residual"].values),
    )


MM = 1e3
_COLUMNS = 2
_MOST_BARS = 8
_MOST_LINES = 7
_LEAST_INDEX = 0.02


def tornado_distance(tree: xr.DataTree) -> float:
    """The computed distance nearest to the logarithmic middle of the declared places, or to 1 m without any."""
    distance = np.asarray(tree["sensitivity"]["distance"].values, dtype=np.float64)
    places = np.asarray(tree["decision"]["place"].values) if "place" in tree["decision"].coords else np.ones(1)
    middle = float(np.exp(np.log(places).mean()))
    return float(distance[np.argmin(np.abs(np.log(distance / middle)))])


@styled()
def draw_tornado(tree: xr.DataTree) -> StudyFigure:
    """Draw, per camera, half the central 68.27 % interval of depth from each independent source, largest first."""
    shown = traces(tree, "sensitivity")
    place = tornado_distance(tree)
    data = tree["sensitivity"].to_dataset().sel(distance=place)
    columns = min(_COLUMNS, len(shown))
    rows = -(-len(shown) // columns)
    finite = data["source_uncertainty"].where(np.isfinite(data["source_uncertainty"])).fillna(0.0)
    counts = [min(_MOST_BARS, int((finite.sel(camera=c.key).max("field") > 0.0).sum())) for c in shown]
    heights = [max(1, *counts[first : first + columns]) for first in range(0, len(shown), columns)]
    figure = new_figure(0.8 + sum(0.3 + 0.2 * height for height in heights))
    grid = figure.subplots(rows, columns, sharex=True, squeeze=False, height_ratios=heights)
    largest = max(float(finite.max()) * MM, np.finfo(float).tiny)  # positive if no camera sees this distance
    for axes, camera in zip(grid.flat, shown, strict=False):
        _bars(axes, data.sel(camera=camera.key), camera)
        axes.set(xlim=(largest * 1e-5, largest * 2.0))
    for row, height in zip(grid, heights, strict=True):
        for axes in row:
            axes.set_ylim(height - 0.4, -0.6)
    for axes in list(grid.flat)[len(shown) :]:
        axes.set_visible(False)
    for axes in grid[-1]:
        axes.set_xlabel("uncertainty from one source")
    fields = [float(field) for field in data["field"].values]
    handles = [Patch(color=SOFT, alpha=_alpha(order), linewidth=0) for order in range(len(fields))]
    legend(figure, handles, [field_words(field) for field in fields], columns=2)
    return figure


def _alpha(order: int) -> float:
    """The opacity of the bars at a field position; the axis comes first."""
    return float(0.4**order)


def _bars(axes: Axes, data: xr.Dataset, camera: CameraTrace) -> None:
    """Draw the bars of one camera, largest first."""
    values = data["source_uncertainty"].transpose("field", "source").values * MM
    size = np.max(np.where(np.isfinite(values), values, 0.0), axis=0)
    order = [k for k in np.argsort(-size) if size[k] > 0.0][:_MOST_BARS]
    names = [shortened(in_words(str(data["source"].values[k])), 32) for k in order]
    rows = np.arange(len(order))
    height = 0.78 / len(values)
    for field, of_field in enumerate(values):
        widths = np.where(np.isfinite(of_field[order]), of_field[order], 0.0)
        middle = rows + (field + 0.5) * height - 0.39
        axes.barh(middle, widths, height=height, color=camera.style.color, alpha=_alpha(field), linewidth=0)
    axes.set_yticks(rows, names, fontsize=SMALL)
    log_axis(axes, "x", tick=length_tick)
    axes.xaxis.set_major_locator(LogLocator(base=100.0, numticks=20))
    axes.tick_params(axis="x", labelsize=SMALL)
    axes.grid(visible=False, axis="y")
    axes.set_title(shortened(camera.title, 34), fontsize=PANEL_TITLE)


@styled()
def draw_indices(tree: xr.DataTree) -> StudyFigure:
    """Draw, per camera, total Sobol indices of inverse depth against distance, and first-order ones as rings."""
    shown = traces(tree, "sensitivity")
    data = tree["sensitivity"].to_dataset().sel(field=0.0)
    names = _main_sources(data)
    columns = min(_COLUMNS, len(shown))
    figure = new_figure(0.6 + 1.5 * -(-len(shown) // columns))
    distance = np.asarray(data["distance"].values, dtype=np.float64)
    panels = camera_panels(figure, len(shown), distance, columns)
    for axes, camera in zip(panels, shown, strict=True):
        axes.set_ylim(0.0, 1.05)
        axes.set_title(shortened(camera.title, 34), fontsize=PANEL_TITLE)
        name_ends(axes, list(_indices(axes, data.sel(camera=camera.key), names)))
    for axes in panels[::columns]:
        axes.set_ylabel("Sobol index")
    return figure


def _indices(axes: Axes, data: xr.Dataset, names: list[str]) -> Iterator[NamedCurve]:
    """Draw the indices of one camera, and yield the curves of its total indices, to be named."""
    distance = np.asarray(data["distance"].values, dtype=np.float64)
    for number, source in enumerate(names):
        indices, style, words = data.sel(source=source), line_style(number), in_words(source)
        total = np.asarray(indices["total_index"].values, dtype=np.float64)
        if not np.any(total > _LEAST_INDEX):
            continue
        axes.errorbar(
            distance, total, yerr=indices["total_index_error"].values, color=style.color, linestyle=style.dash,
            linewidth=1.3, elinewidth=0.8, marker=style.marker, markersize=3, clip_on=False, label=words,
        )  # fmt: skip
        axes.plot(
            distance, indices["first_index"].values, color=style.color, linestyle="", marker="o", markersize=6.5,
            markerfacecolor="none", markeredgewidth=0.7, clip_on=False, label=f"{words}, first order",
        )  # fmt: skip
        yield NamedCurve(name=words, color=style.color, x=distance, y=total)


def _main_sources(data: xr.Dataset) -> list[str]:
    """The sources whose index is large enough to draw at some distance, the largest first."""
    values = data["total_index"].transpose("source", ...).values.reshape(data.sizes["source"], -1)
    most = np.max(np.where(np.isfinite(values), values, 0.0), axis=1)
    order = [k for k in np.argsort(-most) if most[k] > _LEAST_INDEX][:_MOST_LINES]
    return [str(data["source"].values[k]) for k in order]


MOST_PARAMETERS = 6
_BINS = 30
_LETTERS = 13  # in a line of a name
_CONTENTS = (0.865, 0.393)  # the content of a bivariate normal distribution within two and one standard deviations


def shown_parameters(tree: xr.DataTree, posterior: str) -> tuple[str, ...]:
    """The parameters of a posterior to draw: the most correlated of those propagated, in their own order."""
    names, correlation = _correlations(tree, posterior)
    chosen = np.sort(np.argsort(-np.abs(correlation).max(axis=0), kind="stable")[:MOST_PARAMETERS])
    return tuple(names[k] for k in chosen)


def closest_tie(tree: xr.DataTree, posterior: str) -> tuple[str, str, float] | None:
    """The two most correlated parameters of a posterior, and their correlation; None for a single parameter."""
    names, correlation = _correlations(tree, posterior)
    if len(names) < 2:
        return None
    first, second = np.unravel_index(int(np.argmax(np.abs(correlation))), correlation.shape)
    return names[first], names[second], float(correlation[first, second])


def _correlations(tree: xr.DataTree, posterior: str) -> tuple[tuple[str, ...], FloatArray]:
    """The names of the parameters that have draws, and their correlations, with 0 on the diagonal."""
    data = tree["calibration"].to_dataset().sel(posterior=posterior)
    drawn = np.flatnonzero(np.isfinite(data["posterior_draw"].values).any(axis=0))
    draws = _present(data["posterior_draw"].values[:, drawn])
    correlation = np.atleast_2d(np.corrcoef(draws.T)) - np.eye(len(drawn))
    return tuple(str(parameter) for parameter in data["parameter"].values[drawn]), correlation


@styled()
def draw_corner(tree: xr.DataTree, posterior: str) -> StudyFigure:
    """Draw marginals of one and two parameters, in standard deviations from the mean, with the Laplace fit dashed."""
    names = shown_parameters(tree, posterior)
    data = tree["calibration"].to_dataset().sel(posterior=posterior, parameter=list(names))
    draws = _present(np.asarray(data["posterior_draw"].values, dtype=np.float64))
    deviation = np.asarray(data["posterior_deviation"].values, dtype=np.float64)
    scores = (draws - np.asarray(data["posterior_mean"].values)) / deviation
    laplace = np.asarray(data["laplace_deviation"].values, dtype=np.float64) / deviation
    size = len(names)
    figure = new_figure(0.8 * size + 0.7)
    # No shared axes, because each would ask all others for its limits again and again.
    grid = figure.add_gridspec(size, size)
    for row in range(size):
        for column in range(row + 1):
            axes = figure.add_subplot(grid[row, column])
            axes.grid(visible=False)
            axes.set(xlim=(-3.5, 3.5), xticks=[-2, 0, 2])
            axes.tick_params(labelsize=SMALL, length=2, labelbottom=row == size - 1)
            if column == row:
                _marginal(axes, scores[:, row], float(laplace[row]))
            else:
                _plane(axes, scores[:, column], scores[:, row])
            if column == 0:
                axes.set_ylabel(_lines(names[row]), fontsize=SMALL, rotation=0, ha="right", va="center")
            if column > 0 or row == 0:
                axes.tick_params(labelleft=False)
            if row == size - 1:
                axes.set_xlabel(_lines(names[column]), fontsize=SMALL)
    return figure


def corner_values(tree: xr.DataTree, posterior: str) -> Tables:
    """Make the tables of numbers of `draw_corner`."""
    names = shown_parameters(tree, posterior)
    data = tree["calibration"].to_dataset().sel(posterior=posterior, parameter=list(names))
    return corner_tables(names, data, _present(np.asarray(data["posterior_draw"].values, dtype=np.float64)))


def _present(draws: FloatArray) -> FloatArray:
    """The draws that exist; short chains are padded with NaN."""
    return np.asarray(draws[np.isfinite(draws).all(axis=1)])


def _lines(name: str) -> str:
    """Break a name into short lines."""
    return "\n".join(wrap(in_words(name), _LETTERS))


def _marginal(axes: Axes, scores: FloatArray, laplace: float) -> None:
    axes.hist(scores, bins=_BINS, range=(-3.5, 3.5), density=True, color=SOFT, alpha=0.5, histtype="stepfilled")
    if np.isfinite(laplace) and laplace > 0.0:
        x = np.linspace(-3.5, 3.5, 101)
        axes.plot(
            x,
            np.exp(-0.5 * (x / laplace) ** 2) / (laplace * np.sqrt(2.0 * np.pi)),
            color=INK,
            linewidth=0.8,
            linestyle=(0, (3, 1.5)),
        )
    axes.set_yticks([])


def _plane(axes: Axes, x: FloatArray, y: FloatArray) -> None:
    """Draw contours that contain as many draws as one and two standard deviations do."""
    counts, edges, _ = np.histogram2d(x, y, bins=_BINS, range=((-3.5, 3.5), (-3.5, 3.5)))
    from scipy.ndimage import gaussian_filter  # slow to load, and few studies have a posterior

    smooth = gaussian_filter(counts, 1.0)
    falling = np.sort(smooth.ravel())[::-1]
    share = np.cumsum(falling) / falling.sum()
    # Bins at least this full contain that share of the draws.
    levels = [float(falling[np.searchsorted(share, content)]) for content in _CONTENTS]
    middle = 0.5 * (edges[1:] + edges[:-1])
    if levels[0] < levels[1]:  # equal where few bins contain all draws; contours need rising levels
        axes.contour(middle, middle, smooth.T, levels=levels, colors=[SOFT, INK], linewidths=0.8)
    axes.set(ylim=(-3.5, 3.5), yticks=[-2, 0, 2])


def trace_values(tree: xr.DataTree, posterior: str) -> Tables:
    """Make the tables of numbers of `draw_trace`."""
    return trace_tables(shown_parameters(tree, posterior), _walks(tree, posterior))


def _walks(tree: xr.DataTree, posterior: str) -> FloatArray:
    """The first walker of every ensemble, in standard deviations from the mean: shape (ensemble, step, parameter)."""
    names = list(shown_parameters(tree, posterior))
    data = tree["calibration"].to_dataset().sel(posterior=posterior, parameter=names)
    walks = np.asarray(data["posterior_trace"].values, dtype=np.float64)
    return np.asarray((walks - data["posterior_mean"].values) / data["posterior_deviation"].values)


@styled()
def draw_trace(tree: xr.DataTree, posterior: str) -> StudyFigure:
    """Draw the first walker of every ensemble, in standard deviations from the mean, after the warm-up."""
    names, scores = shown_parameters(tree, posterior), _walks(tree, posterior)
    figure = new_figure(0.5 + 0.55 * len(names))
    panels = figure.subplots(len(names), 1, sharex=True, sharey=True, squeeze=False).ravel()
    share = np.linspace(0.0, 1.0, scores.shape[1])
    for number, axes in enumerate(panels):
        for ensemble in range(scores.shape[0]):
            axes.plot(share, scores[ensemble, :, number], color=line_style(ensemble).color, linewidth=0.4)
        axes.set(ylim=(-4.0, 4.0), yticks=[-2, 0, 2])
        axes.tick_params(labelsize=SMALL)
        axes.set_ylabel(_lines(names[number]), fontsize=SMALL, rotation=0, ha="right", va="center")
    panels[-1].set(xlim=(0.0, 1.0), xlabel="fraction of the chain after its warm-up")
    return figure


_ARROW_PX = 0.15  # length of the arrow in the key
_MARGIN = 0.14  # around a picture, of its width


@styled()
def draw_trust(tree: xr.DataTree, posterior: str) -> StudyFigure:
    """Mean residuals of the corners over the left and right picture, and depth by halves of the views."""
    data = tree["calibration"].to_dataset().sel(posterior=posterior)
    columns, rows = (float(size) for size in data["posterior_pixels"].values)
    figure = new_figure(4.6)
    grid = figure.add_gridspec(2, 2)
    residuals = np.asarray(data["rig_residual"].values, dtype=np.float64)
    for side, title in enumerate(("left", "right")):
        axes = figure.add_subplot(grid[0, side])
        down, across = residuals.shape[1:3]
        x, y = np.meshgrid((np.arange(across) + 0.5) / across * columns, (np.arange(down) + 0.5) / down * rows)
        u, v = residuals[side, ..., 0], residuals[side, ..., 1]
        arrows = axes.quiver(x, y, u, v, angles="xy", scale_units="xy", color=INK, scale=_ARROW_PX / (columns / across))
        axes.quiverkey(arrows, 0.85, 1.06, _ARROW_PX, f"{_ARROW_PX:g} px", labelpos="E", fontproperties={"size": SMALL})
        # Arrows may reach beyond the frame, which marks the edge of the picture.
        beyond = _MARGIN * columns
        axes.set(
            xlim=(-beyond, columns + beyond),
            ylim=(rows + beyond, -beyond),
            title=f"{title.capitalize()} picture",
            aspect="equal",
        )
        axes.add_patch(Rectangle((0.0, 0.0), columns, rows, fill=False, edgecolor=SOFT, linewidth=0.5))
        axes.set(xlabel="x [px]", ylabel="y [px]" if side == 0 else "")
    axes = figure.add_subplot(grid[1, :])
    distance = np.asarray(data["rig_distance"].values, dtype=np.float64)
    curves = {
        "halves: found": "rig_halves_difference",
        "halves: claimed": "rig_halves_claim",
        "all views: claimed": "rig_claimed",
    }
    drawn = []
    for order, (name, variable) in enumerate(curves.items()):
        style, y = line_style(order), MM * np.asarray(data[variable].values, dtype=np.float64)
        axes.plot(
            distance,
            y,
            color=style.color,
            linestyle=style.dash,
            linewidth=2.6 - 0.5 * order,
            marker=style.marker,
            label=name,
        )
        drawn.append(NamedCurve(name=name, color=style.color, x=distance, y=y))
    axes.set_xscale("log")
    axes.set_xticks(distance, [f"{tick:g}" for tick in distance])
    axes.minorticks_off()
    log_axis(axes, "y", tick=length_tick)
    axes.set(xlabel="distance [m]", ylabel="RMS difference or uncertainty")
    name_ends(axes, drawn)
    return figure

"""Figures of a posterior: the correlations of its parameters, and whether its chains mix."""

from __future__ import annotations

from textwrap import wrap

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from tradestudy.figures.style import INK, SMALL, SOFT, StudyFigure, line_style, new_figure, styled
from tradestudy.figures.value_tables import Tables, corner_tables, trace_tables
from tradestudy.results.views.groups import FloatArray
from tradestudy.wording import in_words

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
    known = np.flatnonzero(np.isfinite(data["posterior_draw"].values).any(axis=0))
    draws = _present(data["posterior_draw"].values[:, known])
    correlation = np.atleast_2d(np.corrcoef(draws.T)) - np.eye(len(known))
    return tuple(str(name) for name in data["parameter"].values[known]), correlation


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
    levels = [float(falling[np.searchsorted(share, content)]) for content in _CONTENTS]
    middle = 0.5 * (edges[1:] + edges[:-1])
    if levels[0] < levels[1]:
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

"""Hard cases: the error of the usual formula against that of this program, with one mark per case."""

from __future__ import annotations

from functools import partial

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from tradestudy.figures.drawing import Drawing
from tradestudy.figures.style import (
    FAINT,
    PANEL_TITLE,
    PANELS_IN_A_ROW,
    SOFT,
    StudyFigure,
    line_style,
    new_figure,
    styled,
)
from tradestudy.results.views.groups import FloatArray

# Errors lie between these powers of ten; exact values and wrong infinities have places of their own beside them.
_LOWEST, _HIGHEST = -18.0, 4.0
_EXACT, _WRONG = -20.0, 6.0
_TICKS = (-12, 0)


def hard_cases_drawing(tree: xr.DataTree) -> Drawing:
    """Describe the figure of `draw_hard_cases`."""
    data = tree["hard_cases"].to_dataset()
    numbers = data.isel(case=np.flatnonzero(~data["outcome"].values.astype(bool)))
    naive, ours = (np.asarray(numbers[name].values, dtype=float) for name in ("naive_error", "our_error"))
    bound = np.asarray(numbers["bound"].values, dtype=float)
    return Drawing(
        name="hard_cases",
        caption="Relative error of the usual formula (across) against that of this program (up): one chart for "
        "each group of cases, one mark for each case whose answer is a number. On the dashed line both are equally "
        "accurate; the dotted lines are at 10⁻¹², the bound for well-conditioned cases. “Wrong”: no finite relative "
        "error.",
        alt=f"Scatter chart of {naive.size} hard cases. The usual formula is beyond the bound in "
        f"{int((~(naive <= bound)).sum())} of them and gives no number at all in {int(np.isinf(naive).sum())}; this "
        f"program is beyond it in {int((~(ours <= bound)).sum())}. Its largest error is "
        f"{float(np.max(ours[np.isfinite(ours)], initial=0.0)):.1e}, where rounding or sampling allows it.",
        draw=partial(draw_hard_cases, tree),
    )


@styled()
def draw_hard_cases(tree: xr.DataTree) -> StudyFigure:
    """Draw the program's error against that of the usual formula, with a panel for each family of cases."""
    data = tree["hard_cases"].to_dataset()
    data = data.isel(case=np.flatnonzero(~data["outcome"].values.astype(bool)))
    families = list(dict.fromkeys(str(name) for name in data["family_title"].values))
    rows = -(-len(families) // PANELS_IN_A_ROW)
    figure = new_figure(0.5 + 1.6 * rows)
    grid = figure.subplots(rows, PANELS_IN_A_ROW, sharex=True, sharey=True, squeeze=False)
    for order, (axes, family) in enumerate(zip(grid.flat, families, strict=False)):
        _frame(axes)
        cases = data.isel(case=np.flatnonzero(data["family_title"].values == family))
        x, y = (_placed(np.asarray(cases[name].values, dtype=float)) for name in ("naive_error", "our_error"))
        style = line_style(order)
        axes.plot(x, y, linestyle="", marker=style.marker, markersize=4, color=style.color, alpha=0.6, label=family)
        axes.set_title(family, fontsize=PANEL_TITLE)
    for axes in grid.flat[len(families) :]:
        axes.set_visible(False)
    for axes in grid.flat[: len(families)][-PANELS_IN_A_ROW:]:  # only the lowest panel of each column
        axes.tick_params(labelbottom=True)
    figure.supxlabel("relative error of the usual formula", fontsize="medium")
    figure.supylabel("relative error of this program", fontsize="medium")
    return figure


def _frame(axes: Axes) -> None:
    """Label the axes: powers of ten, with "exact" before them and "wrong" after them."""
    ticks = [_EXACT, *_TICKS, _WRONG]
    labels = ["exact", *(f"10{str(t).translate(str.maketrans('-0123456789', '⁻⁰¹²³⁴⁵⁶⁷⁸⁹'))}" for t in _TICKS), "wrong"]
    labels[labels.index("10⁰")] = "1"
    ends = (_EXACT - 1.0, _WRONG + 1.0)
    axes.set(xticks=ticks, xticklabels=labels, xlim=ends, yticks=ticks, yticklabels=labels, ylim=ends)
    axes.plot([_LOWEST, _HIGHEST], [_LOWEST, _HIGHEST], color=SOFT, linewidth=0.8, linestyle=(0, (5, 3)))
    axes.axhline(-12.0, color=SOFT, linewidth=0.8, linestyle=(0, (1, 2)))
    axes.axvline(-12.0, color=SOFT, linewidth=0.8, linestyle=(0, (1, 2)))
    for edge in (_LOWEST - 0.5, _HIGHEST + 0.5):
        axes.axhline(edge, color=FAINT, linewidth=0.8)
        axes.axvline(edge, color=FAINT, linewidth=0.8)


def _placed(error: FloatArray) -> FloatArray:
    """The exponents of errors; zero and infinity have places of their own."""
    power = np.clip(np.log10(np.where((error > 0.0) & np.isfinite(error), error, 1.0)), _LOWEST, _HIGHEST)
    return np.where(error == 0.0, _EXACT, np.where(np.isfinite(error), power, _WRONG))

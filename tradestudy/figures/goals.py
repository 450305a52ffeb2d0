"""The depth uncertainty against the inputs that inverse questions vary, with the required value as a line."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from tradestudy.figures.drawing import Drawing
from tradestudy.figures.style import (
    INK,
    SMALL,
    StudyFigure,
    length_tick,
    line_style,
    log_axis,
    new_figure,
    styled,
)
from tradestudy.figures.sweeps import AXIS_UNITS
from tradestudy.results.views.finding import MOST_CURVES, goal_questions, question_finding, uncertainty_words
from tradestudy.units import LENGTH, pretty
from tradestudy.wording import counted, in_words

MM: Final = 1e3


def goal_drawings(tree: xr.DataTree) -> Iterator[Drawing]:
    """The figure of a study that asks which value of an input gives a required depth uncertainty."""
    questions = goal_questions(tree)[:MOST_CURVES]
    if not questions:
        return
    findings = " ".join(map(question_finding, questions))
    left = len(goal_questions(tree)) - len(questions)
    more = f" {counted(left, 'more question')} of the study: see the answers above." if left else ""
    yield Drawing(
        name="goals",
        caption=f"The {uncertainty_words(questions[0])} against each varied input; horizontal line: the goal; dashed: "
        f"the answer.{more}",
        alt=f"Log-log curves of {uncertainty_words(questions[0])} against varied inputs. {findings}",
        draw=lambda: draw_goals(tree),
    )


@styled()
def draw_goals(tree: xr.DataTree) -> StudyFigure:
    """Draw the depth uncertainty against the varied input of each question, with the goal and the answers as lines."""
    questions = goal_questions(tree)[:MOST_CURVES]
    figure = new_figure(2.5)
    panels = figure.subplots(1, len(questions), sharey=True, squeeze=False)[0]
    every = np.concatenate([[question["solved_goal"], *question["uncertainties"]] for question in questions]) * MM
    every = every[np.isfinite(every)]
    ends = float(every.min()) / 1.5, float(every.max()) * 1.5
    log_axis(panels[0], "y", tick=length_tick, ends=ends)
    panels[0].set_ylim(ends)
    panels[0].set_ylabel(uncertainty_words(questions[0]).replace(" at ", "\nat ").replace(" due ", "\ndue "))
    for axes, question in zip(panels, questions, strict=True):
        _goal_panel(axes, question)
    return figure


def _goal_panel(axes: Axes, question: Mapping[str, Any]) -> None:
    factor, unit = AXIS_UNITS.get(str(question["solved_units"]), (1.0, ""))
    style, x = line_style(0), factor * np.asarray(question["values"], dtype=np.float64)
    y = MM * np.asarray(question["uncertainties"], dtype=np.float64)
    parameter = in_words(str(question["solved_path"]).rpartition(".")[2])
    log_axis(axes, "x", ends=(float(x[0]), float(x[-1])))
    axes.plot(x, np.where(np.isfinite(y), y, np.nan), color=style.color, marker="o", markersize=3, label=parameter)
    goal = MM * float(question["solved_goal"])
    axes.axhline(goal, color=INK, linewidth=0.9)
    axes.text(
        0.98, goal, f"goal: {pretty(goal / MM, LENGTH)}", transform=axes.get_yaxis_transform(), fontsize=SMALL,
        ha="right", va="bottom",
    )  # fmt: skip
    if np.isfinite(question["solved_value"]):
        axes.axvline(factor * float(question["solved_value"]), color=INK, linewidth=0.7, linestyle=(0, (3, 2)))
    axes.set_xlabel(f"{parameter} [{unit}]" if unit else parameter)

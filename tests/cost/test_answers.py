"""What the report and the figure answer to "what would one more digit cost?", on tables made up."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import xarray as xr

from tradestudy.cost.entries import Entry, Measured, nothing_measured
from tradestudy.cost.study_cost import _dataset
from tradestudy.figures.cost import _next_digit, cost_drawing, cost_figure
from tradestudy.report.document import Callout, Table
from tradestudy.report.sections.cost import cost as cost_section


def entry(setting: str, error: float, seconds: float, *, chosen: bool = False) -> Entry:
    return Entry(
        model="law",
        setting=setting,
        evaluations=math.nan,
        error=error,
        typical_error=error,
        seconds=seconds,
        least_seconds=seconds,
        peak_memory=1e6,
        repeats=3,
        chosen=chosen,
    )


def tree(*entries: Entry, floor: float, asked: float = math.nan, left_out: tuple[str, ...] = ()) -> xr.DataTree:
    measured = Measured(
        name="q",
        title="Quantity",
        says="Seconds for all.",
        reference="something finer",
        reference_error=floor,
        reference_seconds=50.0,
        entries=entries,
        left_out=left_out,
        asked=asked,
    )
    return as_tree(measured)


def as_tree(*measured: Measured) -> xr.DataTree:
    return xr.DataTree.from_dict({"/depth": xr.Dataset(), "/cost": _dataset(list(measured), budget=30.0)})


def answers(data: xr.DataTree) -> list[str]:
    (box,) = [block for block in cost_section(data, {}) if isinstance(block, Callout)]
    (bullets,) = box.blocks
    return ["".join(span.text for span in spans).replace("\N{NO-BREAK SPACE}", " ") for spans in bullets.items]


def star(data: xr.DataTree) -> tuple[float, float] | None:
    return _next_digit(data["cost"].to_dataset().sel(cost_quantity="q"))


def test_a_measured_tenth_is_priced_and_starred() -> None:
    data = tree(entry("1 %", 1e-2, 1.0, chosen=True), entry("0.01 %", 1e-4, 100.0), floor=1e-6)
    assert answers(data) == ["Quantity: a run errs by 1 % in 1 s; a tenth of that costs 10 s, 10 times as long."]
    assert star(data) == (pytest.approx(10.0), pytest.approx(1e-3))
    assert "0.1 % costs 10 s" in cost_drawing(data).alt


def test_where_the_reference_ends_a_tenth_of_what_is_asked_is_priced() -> None:
    data = tree(entry("1 %", 4e-3, 10.0, chosen=True), entry("0.1 %", 6e-4, 40.0), floor=8e-4, asked=1e-2)
    (said,) = answers(data)
    assert said.startswith("Quantity: a run errs by 0.4 % in 10 s; a tenth of the 1 % that the study asks for costs ")
    assert "a tenth of that is less than the 0.08 % by which the reference may err" in said
    found = star(data)
    assert found is not None
    assert 10.0 < found[0] < 40.0
    assert found[1] == pytest.approx(1e-3)
    table = next(b for b in cost_section(data, {}) if isinstance(b, Table) and b.name == "cost-q-table")
    assert [str(row[1]).replace("\N{NO-BREAK SPACE}", " ") for row in table.rows] == ["0.4 %", "≤ 0.08 %"]


def test_where_neither_is_told_the_best_that_was_measured_is_priced() -> None:
    data = tree(entry("1 %", 4e-3, 10.0, chosen=True), entry("0.1 %", 6e-4, 40.0), floor=1.1e-3, asked=1e-2)
    (said,) = answers(data)
    assert "the best measured errs by 0.11 % at most, and that costs 40 s, 4 times as long; a tenth of that is" in said


def test_what_errs_less_than_the_reference_is_said_to_err_by_at_most_that() -> None:
    (said,) = answers(tree(entry("1 %", 1e-5, 1.0, chosen=True), entry("10 %", 1e-1, 0.1), floor=1e-4))
    assert said.startswith("Quantity: a run errs by at most 0.01 % in 1 s; a tenth of that is less than the 0.01 %")


def test_a_tenth_that_nothing_reaches_names_the_best_and_the_way_to_more() -> None:
    data = tree(entry("1 %", 1e-2, 1.0, chosen=True), floor=1e-6, left_out=("law, 0.1 %: about 99 s, 1 s are left",))
    (said,) = answers(data)
    assert "a tenth of that was not reached: the best measured errs by 1 % in 1 s; a larger --budget" in said
    assert star(data) is None


def test_without_the_choice_the_best_is_named() -> None:
    (said,) = answers(tree(entry("1 %", 1e-2, 1.0), entry("0.1 %", 1e-3, 9.0), floor=1e-6))
    assert "the best that was, law, 0.1 %, errs by 0.1 % in 9 s" in said


def test_where_nothing_was_measured_the_box_says_why_and_how_to_get_it() -> None:
    (said,) = answers(as_tree(nothing_measured("q", "Quantity", "", "everything: it takes about 90 s")))
    assert said.startswith("Quantity: nothing was measured within the 30 s of this measurement. Left out: everything")
    assert "it takes about 90 s" in said
    assert "cost STUDY --budget SECONDS" in said


@pytest.mark.parametrize("longest", ["closed form", "diffraction to the first dark ring", "a model " * 5])
def test_the_legend_stays_within_the_figure(longest: str) -> None:
    models = [f"{longest} {number}" for number in range(9)]
    entries = [replace(entry("", 10.0**-k, 10.0**k), model=model) for k, model in enumerate(models)]
    figure = cost_figure(tree(*entries, floor=1e-12))
    figure.draw_without_rendering()
    (legend,) = figure.legends
    drawn = legend.get_window_extent()
    assert drawn.x0 >= 0.0
    assert drawn.x1 <= figure.bbox.width

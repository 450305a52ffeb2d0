"""What the report and the figure answer to "what would one more digit cost?", on tables made up."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping
from dataclasses import replace

import pytest
import xarray as xr
from matplotlib.axes import Axes

from tradestudy.cost.entries import CostTable, Entry, nothing_measured
from tradestudy.cost.study_cost import _dataset
from tradestudy.figures.cost import _ARROW, _RING, _next_digit, cost_drawing, draw_cost
from tradestudy.report.document import Bullets, Callout, Paragraph, Table, plain_text
from tradestudy.report.sections.cost import Measuring
from tradestudy.report.sections.cost import describe_cost as cost_section


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


def tree(
    *entries: Entry,
    floor: float,
    asked: float = math.nan,
    left_out: tuple[str, ...] = (),
    ways: Mapping[str, str] | None = None,
    of_a_run: bool = True,
) -> xr.DataTree:
    measured = CostTable(
        name="q",
        title="Quantity",
        says="Seconds for all.",
        reference="something finer",
        reference_error=floor,
        reference_seconds=50.0,
        entries=entries,
        left_out=left_out,
        asked=asked,
        ways=ways or {},
        of_a_run=of_a_run,
    )
    return as_tree(measured)


def as_tree(*measured: CostTable) -> xr.DataTree:
    return xr.DataTree.from_dict({"/depth": xr.Dataset(), "/cost": _dataset(list(measured), budget=30.0)})


def measuring(*options: str) -> Measuring:
    return Measuring(file="studies/one.yaml", folder="out", options=options)


def answers(data: xr.DataTree, *options: str) -> list[str]:
    (box,) = [block for block in cost_section(data, {}, measuring(*options)) if isinstance(block, Callout)]
    (bullets,) = box.blocks
    assert isinstance(bullets, Bullets)
    return [plain_text(item) for item in bullets.items]


def rows_of(data: xr.DataTree, name: str) -> list[list[str]]:
    table = next(
        block for block in cost_section(data, {}, measuring()) if isinstance(block, Table) and block.name == name
    )
    return [[plain_text(cell) for cell in row] for row in table.rows]


def star(data: xr.DataTree) -> tuple[str, float, float] | None:
    found = _next_digit(data["cost"].to_dataset().sel(cost_quantity="q"))
    return None if found is None else (found.words, found.seconds, found.error)


def test_the_next_digit_is_a_measured_entry_and_named() -> None:
    data = tree(entry("1 %", 1e-2, 1.0, chosen=True), entry("0.01 %", 1e-4, 100.0), floor=1e-6)
    assert answers(data) == [
        "Quantity: a run (law, 1 %) errs by 1 % in 1 s; a tenth of that: law, 0.01 %, 100 s, 100 times as long, 99 s "
        "more (it errs by 0.01 %)."
    ]
    assert star(data) == ("law, 0.01 %", 100.0, 1e-4)
    assert "a tenth of that: law, 0.01 %, 100 s" in cost_drawing(data).alt
    assert [row[-1] for row in rows_of(data, "cost-q-table")] == ["frontier, chosen", "frontier, next digit"]
    assert rows_of(data, "cost-digits") == [
        ["Quantity"],
        ["10 % to 1 %", "law, 1 %", "1 s", "1 %"],
        ["0.1 % to 0.01 %", "law, 0.01 %", "100 s", "0.01 %"],
        ["0.001 % to 0.0001 %", "—", "", ""],
    ]


def test_what_costs_nothing_more_is_said_to() -> None:
    data = tree(entry("1 %", 1e-2, 5.0, chosen=True), entry("0.01 %", 1e-4, 2.0), floor=1e-6)
    (said,) = answers(data)
    assert said.endswith("in 5 s; a tenth of that costs nothing more: law, 0.01 % takes 2 s and errs by 0.01 %.")


def test_what_errs_less_in_less_time_is_told_beside_the_next_digit() -> None:
    entries = entry("1 %", 1e-2, 5.0, chosen=True), entry("0.5 %", 5e-3, 2.0), entry("0.01 %", 1e-4, 20.0)
    (said,) = answers(tree(*entries, floor=1e-6))
    assert "a tenth of that: law, 0.01 %, 20 s, 4 times as long" in said
    assert said.endswith("; law, 0.5 % errs less than that run, by 0.5 %, and takes no more time, 2 s.")
    (said,) = answers(tree(*entries[:2], floor=1e-6))
    assert said.endswith("was not reached; law, 0.5 % errs less than that run, by 0.5 %, and takes no more time, 2 s.")


def test_where_the_reference_ends_a_tenth_of_what_is_asked_is_priced() -> None:
    data = tree(entry("1 %", 4e-3, 10.0, chosen=True), entry("0.1 %", 6e-4, 40.0), floor=8e-4, asked=1e-2)
    (said,) = answers(data)
    assert said.startswith(
        "Quantity: a run (law, 1 %) errs by 0.4 % in 10 s; a tenth of the 1 % that the study asks for: law, 0.1 %, "
        "40 s, 4 times as long, 30 s more (it errs by at most 0.08 %); "
    )
    assert said.endswith("a tenth of that run's error is less than the 0.08 % by which the reference may err.")
    assert star(data) == ("law, 0.1 %", 40.0, 6e-4)
    assert [row[1] for row in rows_of(data, "cost-q-table")] == ["0.4 %", "≤ 0.08 %"]
    assert rows_of(data, "cost-digits")[-1] == ["0.01 % to 0.0001 %", "?", "", ""]


def test_where_neither_is_told_the_best_that_was_measured_is_priced() -> None:
    data = tree(entry("1 %", 4e-3, 10.0, chosen=True), entry("0.1 %", 6e-4, 40.0), floor=1.1e-3, asked=1e-2)
    (said,) = answers(data)
    assert "the best measured errs by at most 0.11 %: law, 0.1 %, 40 s, 4 times as long, 30 s more; a tenth" in said
    assert star(data) is None


def test_what_errs_less_than_the_reference_is_said_to_err_by_at_most_that() -> None:
    (said,) = answers(tree(entry("1 %", 1e-5, 1.0, chosen=True), entry("10 %", 1e-1, 0.1), floor=1e-4))
    assert said.startswith("Quantity: a run (law, 1 %) errs by at most 0.01 % in 1 s; a tenth of that run's error is ")
    assert "which itself took 50 s; where errors fall as the inverse of time, or of its root, it costs about" in said
    assert "about 500 s to" in said or "about 8.3 min to" in said


def test_a_tenth_that_nothing_reaches_is_said_not_to_be_reached_and_the_way_to_more() -> None:
    data = tree(entry("1 %", 1e-2, 1.0, chosen=True), floor=1e-6, left_out=("law, 0.1 %: about 99 s, 1 s are left",))
    (said,) = answers(data)
    assert "a tenth of that run's error was not reached, and nothing measured errs less; a larger --budget" in said
    assert star(data) is None


def test_without_the_choice_the_best_is_named() -> None:
    (said,) = answers(tree(entry("1 %", 1e-2, 1.0), entry("0.1 %", 1e-3, 9.0), floor=1e-6))
    assert "the best that was measured, law, 0.1 %, errs by 0.1 % in 9 s" in said


def test_what_no_run_computes_is_said_to_be_so_whatever_was_left_out() -> None:
    data = tree(entry("1 %", 1e-2, 1.0), floor=1e-6, left_out=("law, 0.1 %: about 99 s, 1 s are left",), of_a_run=False)
    (said,) = answers(data)
    assert said == (
        "Quantity: no run computes it by itself, so that none of its models is chosen; the best that was measured, "
        "law, 1 %, errs by 1 % in 1 s."
    )


def test_what_no_option_asks_for_is_said_to_be_there_for_comparison_only() -> None:
    entries = entry("", 1e-2, 1.0, chosen=True), replace(entry("fine", 1e-5, 10.0), model="other")
    data = tree(*entries, floor=1e-6, ways={"law": "effects.calibration"})
    (said,) = answers(data)
    assert "other, fine, 10 s, 10 times as long, 9 s more (it errs by 0.001 %; for comparison only: no option " in said
    (paragraph,) = [
        plain_text(block.text)
        for block in cost_section(data, {}, measuring())
        if isinstance(block, Paragraph) and plain_text(block.text).startswith("What a study asks")
    ]
    assert paragraph == (
        "What a study asks for them by: law → effects.calibration. other → nothing, measured for comparison only."
    )
    (said,) = answers(tree(*entries, floor=1e-6, ways={"other": "some.option"}))
    assert "(it errs by 0.001 %; asked for by some.option)" in said
    (said,) = answers(tree(*entries, floor=1e-6))  # of an earlier program, which did not know
    assert said.endswith("(it errs by 0.001 %).")


def test_beside_the_factor_stands_what_the_whole_run_took() -> None:
    data = tree(entry("1 %", 1e-2, 1.0, chosen=True), entry("0.01 %", 1e-4, 89.0), floor=1e-6)
    box = next(
        block for block in cost_section(data, {}, replace(measuring(), seconds=7.2)) if isinstance(block, Callout)
    )
    (bullets,) = box.blocks
    assert isinstance(bullets, Bullets)
    assert (
        "89 times as long, 88 s more (it errs by 0.01 %); all that the run computed took 7.2 s, its report apart."
        in plain_text(bullets.items[0])
    )


def test_the_digits_of_an_error_tell_a_tenth_of_it_from_more() -> None:
    data = tree(
        entry("", 1.0456e-5, 1e-3, chosen=True), entry("1", 1.18e-6, 0.03), entry("3", 1e-10, 0.09), floor=1e-11
    )
    (said,) = answers(data)
    assert said.startswith("Quantity: a run (law) errs by 0.00105 % in ")
    assert "law, 3" in said
    assert [row[1] for row in rows_of(data, "cost-q-table")] == ["0.00105 %", "0.000118 %", "1×10⁻⁸ %"]


def test_the_caption_names_what_has_no_panel() -> None:
    drawn = tree(entry("1 %", 1e-2, 1.0), floor=1e-6)
    assert "panel, as" not in cost_drawing(drawn).caption
    measured = CostTable(
        name="q", title="Quantity", says="", reference="", reference_error=1e-6, reference_seconds=1.0,
        entries=(entry("1 %", 1e-2, 1.0),),
    )  # fmt: skip
    both = as_tree(measured, nothing_measured("spot", "Whole spot", "", "no time"))
    assert cost_drawing(both).caption.endswith(
        " Without a panel, as nothing of it was measured that could be drawn: Whole spot."
    )


def test_the_most_complete_model_has_no_digit_to_buy() -> None:
    (said,) = answers(tree(entry("simple", 1e-1, 1.0), entry("all", 0.0, 2.0, chosen=True), floor=0.0))
    assert said.endswith(
        "a run takes the most complete model that there is (law, all), in 2 s; there is no digit to buy."
    )


def test_where_nothing_was_measured_the_box_says_why_and_how_to_get_it() -> None:
    data = as_tree(nothing_measured("q", "Quantity", "", "everything: it takes about 90 s"))
    (said,) = answers(data, "--tolerance", "10 %")
    assert said.startswith("Quantity: nothing was measured within the 30 s of this measurement. Left out: everything")
    assert "it takes about 90 s" in said
    assert "cost studies/one.yaml --tolerance '10 %' --out out --budget SECONDS" in said


@pytest.mark.parametrize("value", ["10 %", "a 'b' c", 'say "x"', "it's $HOME", "plain"])
def test_options_are_quoted_for_a_shell(value: str) -> None:
    data = xr.DataTree.from_dict({"/depth": xr.Dataset()})
    _, paragraph = cost_section(data, {}, measuring("--set", f"title={value}"))
    assert isinstance(paragraph, Paragraph)
    (command,) = [span.text for span in paragraph.text if span.style == "code"]
    assert shlex.split(command) == [
        *("python", "-m", "tradestudy", "cost", "studies/one.yaml", "--set", f"title={value}", "--out", "out")
    ]


def drawn(data: xr.DataTree) -> Axes:
    """The panel of the only quantity, laid out."""
    figure = draw_cost(data)
    figure.draw_without_rendering()
    (axes,) = figure.axes
    return axes


def test_no_error_stands_at_a_tick_of_its_own_below_a_break() -> None:
    axes = drawn(tree(entry("simple", 0.5, 1e-3), entry("all", 0.0, 2e-3, chosen=True), floor=0.0))
    low, high = axes.get_ylim()
    ticks = {float(at): label.get_text() for at, label in zip(axes.get_yticks(), axes.get_yticklabels(), strict=True)}
    (nothing,) = [at for at, label in ticks.items() if label == "no error"]
    assert low < nothing < 0.5
    assert all(at > 0.1 for at, label in ticks.items() if label != "no error" and low <= at <= high)
    assert all(at > 0.1 for at in axes.yaxis.get_minorticklocs() if low <= at <= high)
    assert any(nothing in line.get_ydata() for line in axes.lines)


def test_bounds_are_hollow_with_an_arrow_and_rings_are_whole() -> None:
    entries = [entry("1 %", 1e-2, 1e-3, chosen=True), entry("fine", 1e-9, 1.0)]
    for floor, bounds in ((1e-6, 1), (1e-12, 0)):
        axes = drawn(tree(*entries, floor=floor))
        hollow = [
            line for line in axes.lines
            if line.get_markerfacecolor() == "white" and line.get_marker() != "None" and len(line.get_xdata())
        ]  # fmt: skip
        arrows = [line for line in axes.lines if line.get_marker() is _ARROW["marker"]]
        assert len(hollow) == len(arrows) == bounds
        assert all(list(line.get_ydata()) == [floor] for line in (*hollow, *arrows))
        (ring,) = [line for line in axes.lines if line.get_markersize() == _RING["markersize"]]
        assert not ring.get_clip_on()
        edge, (at, _) = axes.bbox.x0, axes.transData.transform((1e-3, 1e-2))
        radius = _RING["markersize"] / 2.0 * axes.figure.dpi / 72.0
        assert at - radius > edge
        assert axes.get_xlabel() == "seconds"


def test_panels_have_room_where_there_is_no_choice_and_no_bound() -> None:
    axes = drawn(tree(entry("a", 1e-2, 1e-3), entry("b", 1e-9, 1.0), floor=1e-12))
    assert axes.figure is not None
    assert axes.bbox.width > 0.7 * axes.figure.bbox.width


def test_the_frontier_has_no_slope_between_entries() -> None:
    axes = drawn(tree(entry("a", 1e-2, 1e-3, chosen=True), entry("b", 1e-9, 1.0), floor=1e-12))
    assert axes.lines[0].get_drawstyle() == "steps-post"


@pytest.mark.parametrize("start", [1.05e-3, 2e-3, 4e-3, 9e-3])
@pytest.mark.parametrize("floor", [0.0, 2e-4])
def test_axes_have_labels_to_read_a_value_by(start: float, floor: float) -> None:
    axes = drawn(tree(entry("a", start, start), entry("b", 9.0 * start, 9.0 * start), floor=floor))
    for axis, (low, high) in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
        ticks = zip(axis.get_majorticklocs(), axis.get_ticklabels(), strict=True)
        labels = [label.get_text() for at, label in ticks if low <= at <= high and label.get_text() != "no error"]
        assert len(labels) >= 2


def test_the_legend_names_models_in_full() -> None:
    model = "Fresnel at the main lens, Kirchhoff at microlenses"
    (legend,) = draw_cost(tree(replace(entry("", 1e-2, 1.0), model=model), floor=1e-6)).legends
    assert model in [text.get_text() for text in legend.get_texts()]


@pytest.mark.parametrize("longest", ["closed form", "diffraction to the first dark ring", "a model " * 5])
def test_the_legend_stays_within_the_figure(longest: str) -> None:
    models = [f"{longest} {number}" for number in range(9)]
    entries = [replace(entry("", 10.0**-k, 10.0**k), model=model) for k, model in enumerate(models)]
    figure = draw_cost(tree(*entries, floor=1e-12))
    figure.draw_without_rendering()
    (legend,) = figure.legends
    drawn = legend.get_window_extent()
    assert drawn.x0 >= 0.0
    assert drawn.x1 <= figure.bbox.width

"""The report of hard cases: every case with both errors, its bound and its verdict; what is not met is said first."""

from __future__ import annotations

from pathlib import Path

import pytest
import xarray as xr

from tradestudy import api, figures
from tradestudy.report.contents import compose_report
from tradestudy.report.document import Callout, Paragraph, Table, all_blocks, plain_text, spans
from tradestudy.results.views.terminal import conclusions_as_json, terminal_lines

STUDY = Path(__file__).parents[2] / "studies" / "hard_cases.yaml"


@pytest.fixture(scope="module")
def tree() -> xr.DataTree:
    return api.load(STUDY, ("hard_cases.families=[thin-lens, triangulation]",)).run().data


def tables(tree: xr.DataTree) -> dict[str, Table]:
    blocks = all_blocks(compose_report(tree, {}, figures.build(tree)).blocks)
    return {block.name: block for block in blocks if isinstance(block, Table) and block.name.startswith("hard-cases")}


def verdict(tree: xr.DataTree) -> tuple[str, str]:
    blocks = all_blocks(compose_report(tree, {}, figures.build(tree)).blocks)
    box = next(block for block in blocks if isinstance(block, Callout) and block.title == "Where formulas break down")
    assert isinstance(box.blocks[0], Paragraph)
    return box.tone, "".join(span.text for span in spans(box.blocks[0].text))


def value(shown: str) -> float:
    """The number behind a power of ten with raised digits."""
    mantissa, _, exponent = shown.partition("×10")
    raised = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
    return float(mantissa) * 10.0 ** int(exponent.translate(raised) or 0)


def test_every_case_has_both_errors_a_bound_and_a_verdict(tree: xr.DataTree) -> None:
    made = tables(tree)
    assert [column.title for column in made["hard-cases-thin-lens-numbers"].columns] == [
        *("Case", "Quantity", "κ", "Usual formula", "This program", "Bound", "Verdict")
    ]
    assert sum(len(table.rows) for table in made.values()) == tree["hard_cases"].sizes["case"]
    rows = {row[0]: row for row in made["hard-cases-thin-lens-numbers"].rows}
    # b f/(b − f) of an object at 10⁸ m: eight of sixteen digits are gone.
    _, law, condition, naive, ours, bound, met = rows["there and back from 10⁸ m"]
    assert plain_text(law) == "object → image → object"
    assert (condition, value(bound), met) == ("1", 1e-12, "met")
    assert 1e-9 < value(naive) < 1e-5
    assert value(ours) < 1e-15
    assert rows["shift for an object at infinity"][3] == "wrong: NaN"


def test_the_figure_s_alternative_text_gives_its_numbers(tree: xr.DataTree) -> None:
    drawing = figures.build(tree)["hard_cases"]
    data = tree["hard_cases"].to_dataset()
    numbers = int((~data["outcome"].values.astype(bool)).sum())
    assert f"Scatter chart of {numbers} hard cases" in drawing.alt
    panels = [axes for axes in drawing.draw().axes if axes.get_visible()]
    assert [axes.get_title(loc="left") for axes in panels] == list(dict.fromkeys(data["family_title"].values))
    lines = [line for axes in panels for line in axes.lines]
    marks = sum(line.get_xdata().size for line in lines if line.get_linestyle() == "None")
    assert marks == numbers


def test_cases_that_are_not_met_come_first(tree: xr.DataTree) -> None:
    tone, words = verdict(tree)
    count = tree["hard_cases"].sizes["case"]
    assert tone == "answer"
    assert f" all {count} hard cases" in words
    data = tree["hard_cases"].to_dataset().copy(deep=True)
    data["met"][3] = False
    wrong = xr.DataTree.from_dict({"/": tree.to_dataset(), "/hard_cases": data})
    tone, words = verdict(wrong)
    assert tone == "warning"
    assert f"{count - 1} of {count} hard cases" in words
    assert f"Not met: {data['case'].values[3]}." in words


def test_the_terminal_and_the_json_count_the_cases(tree: xr.DataTree) -> None:
    cases = tree["hard_cases"]["met"].values
    assert conclusions_as_json(tree)["hard_cases"] == {"cases": cases.size, "met": int(cases.sum())}
    assert f"{int(cases.sum())} of {cases.size} hard cases" in " ".join(terminal_lines(tree))

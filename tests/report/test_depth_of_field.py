"""The report of a study about focus: its first page answers, and every camera stands in figures and tables."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pypdfium2 as pdfium
import pytest
import xarray as xr

from tradestudy import figures
from tradestudy.api import Result, load
from tradestudy.figures.plotted import plotted
from tradestudy.report import contents
from tradestudy.report.document import Table, all_blocks, spans
from tradestudy.results.views.depth import sharp_ranges
from tradestudy.results.views.groups import camera_titles

STUDIES = Path(__file__).parents[2] / "studies"


@pytest.fixture(scope="module")
def result(run_of: Callable[..., Result]) -> Result:
    return run_of("hand_lens", "scene.distances.points=93")


@pytest.fixture(scope="module")
def written(result: Result, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return result.write(tmp_path_factory.mktemp("hand-lens"))


@pytest.fixture(scope="module")
def first_page(written: Path) -> str:
    with pdfium.PdfDocument((written / "report.pdf").read_bytes()) as document:
        text = str(document[0].get_textpage().get_text_range())
    return text.replace("\N{NO-BREAK SPACE}", " ").replace("\r\n", "\n")


def test_the_first_page_says_which_camera_at_what_resolution_exposures_and_moving_parts(first_page: str) -> None:
    # camera, scene sharp, from – to, resolution, diffraction spot, exposures, moving parts
    # Resolution at 160 mm: Airy radius 1.22 · 0.55 µm · 160 mm · 9.8/18.3 mm = 57.5 µm.
    assert re.search(r"MAHLI focus stack\s+all\s+0\.14 to 0\.161 m\s+57\.5 µm\s+[\d.]+ µm\s+3\s+1\b", first_page)
    row = r"Multi-focus\s+R5\s+sharp\s+from\s+135\s+mm\s+all\s+0\.135 to [\d.]+ m\s+154 µm\s+[\d.]+ µm\s+1\s+0\b"
    assert re.search(row, first_page)
    assert re.search(r"R5 without microlenses\s+27\.6 %", first_page)
    either = r"\s+or\s+".join(rf"the\s+{kind}\S\s*focus\s+R5\s+sharp\s+from\s+135\s+mm" for kind in ("multi", "single"))
    assert re.search(rf"take\s+{either}\s+\(154\s+µm,\s+1\s+exposure", first_page)
    assert "Figure 1" in first_page


def test_the_figures_have_alternative_texts(result: Result) -> None:
    drawings = figures.build(result.data)
    assert list(drawings)[:2] == ["depth-of-field", "lateral-resolution"]
    for title in camera_titles(result.data).values():
        assert title in drawings["depth-of-field"].alt
    assert "MAHLI at 22.5 mm: sharp 53.7 mm to 54.6 mm" in drawings["depth-of-field"].alt
    assert "MAHLI single image 53.9 µm" in drawings["lateral-resolution"].alt


def test_bars_end_where_the_results_say(result: Result) -> None:
    data = result.data["depth_of_field"].to_dataset()
    figure = figures.figure(result.data, "depth-of-field")
    bars = [(bar.get_x(), bar.get_x() + bar.get_width()) for bar in figure.axes[0].patches if bar.get_height() < 0.5]
    low, high = figure.axes[0].get_xlim()
    expected = [
        (max(near * 1e3, low), min(far * 1e3, high))
        for key in camera_titles(result.data)
        for near, far in sharp_ranges(data.sel(camera=key, sharp="one-pixel"), "slice")
        if near * 1e3 < high and far * 1e3 > low
    ]
    np.testing.assert_allclose(sorted(bars), sorted(expected), rtol=1e-9)


def test_drawing_again_gives_equal_figures(result: Result, written: Path) -> None:
    for name in ("depth-of-field", "lateral-resolution"):
        drawn = plotted(figures.figure(result.data, name)).svg
        assert (written / "figures" / f"{name}.svg").read_bytes() == drawn


def test_every_number_of_the_comparison_is_in_a_table(written: Path) -> None:
    with (written / "tables" / "criteria_by_camera_criterion.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len({row["camera"] for row in rows}) == 10
    assert {row["basis"] for row in rows if row["criterion"] == "moving parts"} == {"datasheet", "derived"}
    html = (written / "report.html").read_text(encoding="utf-8")
    assert "hidden beside a step" in html
    assert re.search(r"</sup>\s*declared\W+[\w ]*data ?sheet", html)


def said(tree: xr.DataTree) -> str:
    """All that the report says in tables and paragraphs."""
    blocks = all_blocks(contents.compose_report(tree, {}, figures.build(tree)).blocks)
    cells = [cell for block in blocks if isinstance(block, Table) for row in block.rows for cell in row]
    return " | ".join("".join(span.text for span in spans(cell)) for cell in cells).replace("\N{NO-BREAK SPACE}", " ")


def test_gaps_of_a_short_stack_are_written_out() -> None:
    short = [
        "scene.distances.points=12",
        "mahli-stack.focus.stack.images=2",
        "depth_of_field.criteria.one-pixel.blur=0.5 px",
        "readings=null",
        "claims=null",
    ]
    tree = load(STUDIES / "hand_lens.yaml", short).run().data
    gaps = tree["depth_of_field"].to_dataset()["gap_near"].sel(camera="mahli-stack", sharp="one-pixel")
    assert np.isfinite(gaps.values).sum() == 1
    assert re.search(rf"\bgaps?\W+{math.floor(float(gaps[0]) * 1e3) / 1e3:g}", said(tree))


def test_cameras_that_measure_no_depth_have_a_report_of_their_own(result: Result) -> None:
    only = ["mahli", "mahli-stack", "mahli-contact"]
    tree = xr.DataTree.from_dict(
        {name: result.data[name].to_dataset().sel(camera=only) for name in ("cameras", "depth_of_field", "criteria")}
    )
    tree.attrs = result.data.attrs
    assert list(figures.build(tree)) == ["depth-of-field", "lateral-resolution"]
    assert "MAHLI focus stack | all" in said(tree)
    assert "σ" not in said(tree)

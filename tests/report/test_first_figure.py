"""The first figure of a report follows the question of the study, and its caption begins with the finding."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pypdfium2 as pdfium
import pytest
import xarray as xr

from tests.report.layout import unreadable
from tradestudy import figures
from tradestudy.figures.style import traces
from tradestudy.report.contents import compose_report
from tradestudy.report.document import Block, Bullets, Callout, PageBreak, Picture, plain_text
from tradestudy.report.pdf import render_pdf
from tradestudy.results.views.finding import MOST_CURVES, MOST_WORDS, cameras_by_weight, ratio_to_middle, short
from tradestudy.results.views.terminal import terminal_lines
from tradestudy.wording import few

SVG = b'<svg xmlns="http://www.w3.org/2000/svg" width="400" height="200"></svg>'


def _first_picture(tree: xr.DataTree, record: dict[str, object]) -> Picture:
    return _first_of(compose_report(tree, record, figures.build(tree)).blocks)


def _first_of(blocks: Sequence[Block]) -> Picture:
    page_one = blocks[: next(k for k, block in enumerate(blocks) if isinstance(block, PageBreak))]
    (picture,) = (block for block in page_one if isinstance(block, Picture))
    return picture


def _crowd(tree: xr.DataTree, copies: int) -> xr.DataTree:
    """The synthetic study with copies of its first camera, which are as uncertain as that, but first in no answer."""
    keys = [*tree["cameras"]["camera"].values, *(f"copy-{number}" for number in range(copies))]
    places = [0, 1, 2, *[0] * copies]
    groups = {name: tree[name].to_dataset() for name in ("cameras", "depth", "decision")}
    many = {name: data.isel(camera=places).assign_coords(camera=keys) for name, data in groups.items()}
    titles = [*tree["cameras"]["title"].values, *(f"Copy {number}" for number in range(copies))]
    many["cameras"]["title"] = ("camera", titles)
    crowd = xr.DataTree.from_dict({**{name: tree[name].to_dataset() for name in tree.children}, **many})
    crowd.attrs = tree.attrs
    return crowd


def test_three_cameras_need_one_figure_and_many_a_first_one_of_three(
    tree: xr.DataTree, record: dict[str, object]
) -> None:
    assert _first_picture(tree, record).name == "whole_range"
    crowd = _crowd(tree, 37)
    drawings = figures.build(crowd)
    blocks = compose_report(crowd, record, drawings).blocks
    first = _first_of(blocks)
    assert first.name == "deciding_cameras"
    assert "37 other cameras" in first.caption
    figure = drawings["deciding_cameras"].draw()
    labels = {label.get_text() for label in figure.axes[1].get_yticklabels()}
    assert len(labels) == MOST_CURVES + 1  # and the best camera
    assert not unreadable(figure)
    assert "whole_range" in {block.name for block in blocks if isinstance(block, Picture)}


def test_the_cameras_of_the_answer_come_first(tree: xr.DataTree) -> None:
    crowd = _crowd(tree, 5)
    best = {key for names in crowd["decision"]["best_camera"].values.ravel() for key in str(names).split(", ") if key}
    shown = {camera.key for camera in traces(crowd, most=MOST_CURVES)}
    assert best <= shown
    assert set(cameras_by_weight(crowd)) == set(crowd["depth"]["camera"].values)


@pytest.mark.parametrize("copies", [0, 20])
def test_the_caption_begins_with_the_finding(tree: xr.DataTree, copies: int) -> None:
    drawings = figures.build(_crowd(tree, copies))
    first = next(iter(drawings.values()))
    finding = first.caption.partition(". ")[0]
    assert "ost certain" in finding
    assert len(finding.split()) <= MOST_WORDS


def test_a_sweep_without_requirements_shows_its_designs_first(
    make_tree: Callable[..., xr.DataTree], record: dict[str, object]
) -> None:
    first = _first_picture(make_tree(sweep={"baseline": [0.05, 0.1, 0.2]}), record)
    assert first.name == "sweep_map"
    assert first.caption.startswith("At ")
    assert "depending on the design" in first.caption.partition(". ")[0]


def test_a_long_sentence_is_cut_at_a_clause() -> None:
    few, many = "It measures best", " ".join(["word"] * 25)
    assert short(f"{few}; {many}.") == f"{few}."
    assert short(f"{few}: {many}.") == f"{few}."
    assert short(f"{few}; so it is.") == f"{few}; so it is."
    assert short("") == ""


def _planned(tree: xr.DataTree) -> xr.DataTree:
    """One camera, whose uncertainty falls as 10 mm / views, and the question of how many views give 1 mm."""
    views = np.array([5.0, 20.0, np.nan])
    one = {
        "solution_count": [1],
        "solved_value": [10.0],
        "solved_error": [0.5],
        "solved_units": [""],
        "solved_says": ["How many views?"],
        "solved_answer": ["10; declared: 20"],
        "solved_path": ["r5.calibration.target.views"],
        "solved_goal": [1e-3],
        "solved_place": [1.0],
        "solved_errors": ["calibration"],
    }
    decision = xr.Dataset({name: ("question", np.array(value, dtype=object)) for name, value in one.items()})
    for name in ("solved_value", "solved_goal", "solved_place"):
        decision[name] = decision[name].astype(float)
    decision["solved_tried_value"] = (("question", "solved_tried"), [views])
    decision["solved_tried_uncertainty"] = (("question", "solved_tried"), [0.01 / views])
    decision = decision.assign_coords(question=["views"])
    depth = tree["depth"].to_dataset().sel(camera=["r5"])
    groups = {"/cameras": tree["cameras"].to_dataset(), "/depth": depth, "/decision": decision}
    return xr.DataTree.from_dict(groups)


def test_a_planned_calibration_shows_its_error_against_the_views_with_the_goal(tree: xr.DataTree) -> None:
    planned = _planned(tree)
    first = next(iter(figures.build(planned).values()))
    assert first.name == "goals"
    assert first.caption.startswith(
        "At 10 views, depth uncertainty due to calibration at 1\u00a0m is 1 mm, as required."
    )
    axes = figures.build(planned)["goals"].draw().axes[0]
    curve, goal, answer = axes.get_lines()
    np.testing.assert_allclose(curve.get_xydata(), [[5.0, 2.0], [20.0, 0.5]])
    np.testing.assert_allclose(goal.get_ydata(), 1.0)
    np.testing.assert_allclose(answer.get_xdata(), 10.0)
    assert [text.get_text() for text in axes.texts] == ["goal: 1 mm"]


def _demanding(tree: xr.DataTree, count: int) -> xr.DataTree:
    """The synthetic study with copies of its requirements, each named by its number."""
    declared = tree["requirements"].to_dataset()
    many = declared.isel(requirement=np.arange(count) % declared.sizes["requirement"])
    many = many.assign_coords(requirement=[f"need-{number}" for number in range(count)])
    many["says"] = ("requirement", [f"need {number}" for number in range(count)])
    demanding = tree.copy()
    demanding["requirements"] = xr.DataTree(many)
    return demanding


def test_page_one_names_the_requirements_that_decide_and_counts_the_others(
    tree: xr.DataTree, record: dict[str, object]
) -> None:
    demanding = _demanding(_crowd(tree, 37), 50)
    drawings = figures.build(demanding)
    report = compose_report(demanding, record, drawings)
    (callout,) = (
        block for block in report.blocks if isinstance(block, Callout) and block.name == "answer-requirements"
    )
    (bullets,) = (block for block in callout.blocks if isinstance(block, Bullets))
    assert len(bullets.items) == 5
    assert "46 more requirements (section “Requirements”)" in plain_text(bullets.items[-1])
    shown = [block.name for block in report.blocks if isinstance(block, Picture)]
    pictures = dict.fromkeys(shown, SVG) | {shown[0]: drawings[shown[0]].draw().svg()}  # the others follow page one
    with pdfium.PdfDocument(render_pdf(report, pictures)) as document:
        first_page = document[0].get_textpage().get_text_range()
    assert "Figure 1" in first_page
    assert "Contents" not in first_page


def test_lines_on_the_terminal_stay_readable_with_many_cameras_and_requirements(tree: xr.DataTree) -> None:
    lines = list(terminal_lines(_demanding(_crowd(tree, 97), 50)))
    assert max(map(len, lines)) <= 400


def test_a_short_list_counts_what_it_leaves_out() -> None:
    names = [f"N{number}" for number in range(40)]
    assert few(names, 2) == "N0, N1 and 38 more"
    assert few(names[:3], 2) == "N0, N1 and N2"  # as long as with "1 more"
    assert few(names[:1]) == "N0"


def test_a_map_of_depth_whose_middle_is_unbounded_is_drawn_without_a_warning() -> None:
    values = [[[0.02, np.inf, 0.02], [0.01, np.inf, 0.03]]]
    one = xr.Dataset({"depth_uncertainty": (("distance", "field_y", "field_x"), values)}, {"distance": [1.0]})
    np.testing.assert_array_equal(ratio_to_middle(one, 1.0), [[0.0, np.nan, 0.0], [0.0, np.nan, 0.0]])

"""Sources of calibrations, the worth of averaging, ties, ranks, and depth off the axis in reports."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable

import numpy as np
import pytest
import xarray as xr

from tradestudy import figures
from tradestudy.figures.style import traces
from tradestudy.report.contents import compose_report
from tradestudy.report.document import Bullets, Heading, Paragraph, Report, Table, Text, all_blocks, plain_text
from tradestudy.report.sections.answer import describe_answer
from tradestudy.report.words import interval, with_error
from tradestudy.results import dataset
from tradestudy.results.views.decision import answer_title, reported_winners, winners
from tradestudy.results.views.depth import field_words, largest_parts

MakeTree = Callable[..., xr.DataTree]
RIG, WIDE = "stereo-30mm", "stereo-65deg"


def report_of(tree: xr.DataTree, inputs: dict[str, str] | None = None) -> Report:
    return compose_report(tree, {"inputs": inputs or {}}, figures.build(tree))


def table(report: Report, name: str) -> list[list[str]]:
    found = next(b for b in all_blocks(report.blocks) if isinstance(b, Table) and b.name == name)
    return [[plain_text(cell) for cell in row] for row in found.rows]


def texts(report: Report) -> list[str]:
    found: list[Text] = []
    for block in all_blocks(report.blocks):
        found += block.items if isinstance(block, Bullets) else [block.text] if isinstance(block, Paragraph) else []
    return [plain_text(text) for text in found]


def with_best(tree: xr.DataTree, best: list[str]) -> xr.DataTree:
    """Of so many distances from end to end of the range, with these best cameras, all usable everywhere."""
    decision, depth = tree["decision"].to_dataset(), tree["depth"].to_dataset()
    places = np.linspace(0, depth.sizes["distance"] - 1, len(best)).round().astype(int)
    decision, depth = decision.isel(distance=places).copy(deep=True), depth.isel(distance=places).copy(deep=True)
    decision["best_camera"][:] = np.repeat(np.array(best, dtype=object)[:, None], 3, axis=1)
    depth["usable_near"][:], depth["usable_far"][:], depth["usable"][:] = 0.05, 10.0, True
    decision["crossover_distance"][:] = np.nan
    return xr.DataTree.from_dict(
        {"/": tree.to_dataset(), "/cameras": tree["cameras"].to_dataset(), "/depth": depth, "/decision": decision}
    )


def test_tied_cameras_are_named_together(make_tree: MakeTree) -> None:
    tree = with_best(make_tree(), ["r5"] * 5 + [f"{RIG}, {WIDE}"] * 5)
    sentence = next(text for text in texts(report_of(tree)) if "(tied)" in text)
    assert re.search(r": Stereo 100 mm, f = 30\.5 mm; and Stereo 100 mm, 65\.24° across \(tied\), .*±", sentence)
    bars = figures.figure(tree, "whole_range").axes[1].patches
    colors = {camera.key: camera.style.color for camera in traces(tree)}
    far = [bar for bar in bars if bar.get_y() > 2.5 and bar.get_x() > 0.3]
    assert [bar.get_facecolor() for bar in far] == [pytest.approx(_rgb(colors[key])) for key in (RIG, WIDE)]
    assert sum(bar.get_height() for bar in far) == pytest.approx(0.9)


def _rgb(color: str) -> tuple[float, ...]:
    return (*(int(color[k : k + 2], 16) / 255 for k in (1, 3, 5)), 1.0)


@pytest.mark.parametrize(
    ("best", "reported"),
    [
        (["r5"] * 50 + [f"r5, {WIDE}"] + [WIDE] * 50, ["r5", WIDE]),  # the error of a crossover
        (["r5"] * 50 + [f"r5, {WIDE}"] + ["r5"] * 50, ["r5"]),
        (["r5"] * 40 + [f"r5, {WIDE}"] * 20 + [WIDE] * 40, ["r5", f"r5, {WIDE}", WIDE]),  # a wide range of ties
        (["r5"] * 50 + [f"{RIG}, {WIDE}"] + [WIDE] * 50, ["r5", f"{RIG}, {WIDE}", WIDE]),
        ([""] * 50 + [f"r5, {WIDE}"] + [WIDE] * 50, ["", f"r5, {WIDE}", WIDE]),
    ],
)
def test_a_brief_tie_at_a_crossover_is_a_handover(make_tree: MakeTree, best: list[str], reported: list[str]) -> None:
    tree = with_best(make_tree(), best)
    found = list(reported_winners(tree))
    assert [names for _, _, names in found] == reported
    assert (found[0][0], found[-1][1]) == (pytest.approx(0.05), pytest.approx(10.0))
    assert all(a[1] == b[0] for a, b in itertools.pairwise(found))
    assert len(list(winners(tree))) == 3


def test_the_table_of_verdicts_names_ties(make_tree: MakeTree) -> None:
    tree = make_tree()
    decision = tree["decision"].to_dataset().copy(deep=True)
    decision["winner"][0, 1], decision["more_certain"][0, 1] = f"r5, {WIDE}", ""
    tree["decision"] = xr.DataTree(decision)
    row = table(report_of(tree), "verdict-table")[1]
    assert row[1] == "Raytrix R5, Keplerian; and Stereo 100 mm, 65.24° across (tied)"
    assert row[3] == "tied"
    assert answer_title({"a": "A"}, "", "neither") == "neither"


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (0.0123, 0.0001, "12.3 mm"),
        (0.0123, 0.0004, "12.3 ± 0.4 mm"),
        (0.0123, 0.00096, "12 ± 1 mm"),
        (-6.78e-7, 1.2e-6, "−1 ± 1 µm"),
        (9.94e-7, 6e-7, "1.0 ± 0.6 µm"),
        (0.0123, 0.0, "12.3 mm"),
        (math.inf, math.nan, "∞"),
        (math.nan, math.nan, "—"),
        (0.5, math.nan, "500 mm"),
    ],
)
def test_an_error_is_shown_where_it_is_not_negligible(value: float, error: float, text: str) -> None:
    assert with_error(value, error).replace("\u00a0", " ") == text


def test_an_empty_interval_is_a_dash() -> None:
    assert interval(math.nan, math.nan) == "—"


def test_what_did_not_converge_is_marked_and_the_widest_interval_is_shown(make_tree: MakeTree) -> None:
    tree = make_tree()
    depth = tree["depth"].to_dataset().copy(deep=True).assign_coords(quantile=[0.005, 0.16, 0.5, 0.84, 0.995])
    depth["converged"][0] = False
    tree["depth"] = xr.DataTree(depth)
    report = report_of(tree)
    found = next(b for b in all_blocks(report.blocks) if isinstance(b, Table) and b.name == "depth-table")
    assert plain_text(found.columns[-1].title) == "99 % interval"
    stars = [row[-1].endswith(" *") for row in table(report, "depth-table") if len(row) > 1]
    assert stars == [True, False, False] * 3


def test_a_camera_without_errors_needs_endless_averaging(make_tree: MakeTree) -> None:
    tree = make_tree()
    depth = tree["depth"].to_dataset().copy(deep=True)
    depth["depth_uncertainty_by_error_source"].loc[{"camera": "r5", "error_source": "calibration"}] = 0.0
    tree["depth"] = xr.DataTree(depth)
    report = report_of(tree)
    assert set(table(report, "averaging-table")[0][1:]) == {"∞"}


def test_the_first_page_names_rigs_whose_views_support_less_than_they_claim(make_tree: MakeTree) -> None:
    tree = make_tree()
    data = xr.Dataset(
        {
            "rig_claimed": (("posterior", "rig_distance"), [[0.4e-3, 2e-3], [0.5e-3, 3e-3]]),
            "rig_halves_difference": (("posterior", "rig_distance"), [[0.5e-3, 3e-3], [0.6e-3, 4e-3]]),
            "rig_halves_claim": (("posterior", "rig_distance"), [[0.4e-3, 2.9e-3], [0.7e-3, 4.1e-3]]),
        },
        coords={"posterior": [RIG, WIDE], "rig_distance": [0.3, 1.0]},
    )
    tree["calibration"] = xr.DataTree(data)
    said = [plain_text(block.text) for block in describe_answer(tree) if isinstance(block, Paragraph)]
    assert (
        "The calibration of Stereo 100 mm, f = 30.5 mm is good to 500 µm at 0.3 m, although it claims 400 µm: depths "
        "from random halves of its views differ by 1.25 times as much as claimed; the numbers here use the claim."
        in said[-1].replace("\N{NO-BREAK SPACE}", " ")
    )
    assert "65.24" not in said[-1].partition("The calibration of")[2].partition("as claimed")[0]


def test_measurements_worth_averaging_make_noise_as_large_as_calibration(make_tree: MakeTree) -> None:
    rows = table(report_of(make_tree()), "averaging-table")
    # 0.12 z² of noise over 0.006 z² of calibration; of the stereo rigs calibration is the larger part.
    assert rows[0][1:] == ["400"] * 3
    assert rows[1][1:] == ["< 1"] * 3


def test_the_largest_share_decides(make_tree: MakeTree) -> None:
    tree = make_tree()
    depth = tree["depth"].to_dataset()
    near = int(np.argmin(np.abs(depth["distance"].values - 1.0)))
    cameras = depth["camera"].values.tolist()
    assert [largest_parts(depth)[0][0, cameras.index(key), near] for key in ("r5", RIG)] == [
        "noise",
        "relative rotation",
    ]
    unknown = depth.copy(deep=True)
    unknown["variance_share"][0] = np.nan
    assert set(largest_parts(unknown)[0][0, 0]) == {None}


def with_ranks(tree: xr.DataTree) -> xr.DataTree:
    first = np.array([[[0.9, 0.8, 0.7], [0.6, 0.5, 0.0]]])
    ranks = dataset(
        "decision",
        {
            "rank_first": first,
            "rank_first_error": np.full_like(first, 0.001),
            "rank_second": np.where(first == 0.0, 0.0, 1.0 - first),
            "pair_first": ["r5"],
            "pair_second": [WIDE],
        },
        {
            "pair": [f"r5 against {WIDE}"],
            "rank_error_source": ["calibration", "both"],
            "rank_distance": [0.3, 0.5, 1.0],
        },
    )
    tree["decision"] = xr.DataTree(tree["decision"].to_dataset().merge(ranks))
    return tree


def test_ranks_appear_in_figure_and_table(make_tree: MakeTree) -> None:
    tree = with_ranks(make_tree())
    report = report_of(tree)
    rows = [row for row in table(report, "rank-table") if len(row) > 1]
    names = ["Raytrix R5, Keplerian", "Stereo 100 mm, 65.24° across"]
    assert rows == [
        [*names, "90.0 ± 0.2 %", "80.0 ± 0.2 %", "70.0 ± 0.2 %"],
        [*names, "60.0 ± 0.2 %", "50.0 ± 0.2 %", "—"],
    ]
    (panel,) = figures.figure(tree, "rank-probability").axes  # one for each pair
    assert all(name in panel.get_title(loc="left").replace("\n", " ") for name in names)
    drawn = [np.asarray(line.get_ydata(), dtype=float) for line in panel.get_lines()[:2]]
    np.testing.assert_array_equal(drawn, [[0.9, 0.8, 0.7], [0.6, 0.5, np.nan]])


def with_field(tree: xr.DataTree) -> xr.DataTree:
    """Up to twice as uncertain 70 % of the way to the corners, where the R5 sees nothing."""
    depth = tree["depth"].to_dataset()
    off = (
        (2.0 * depth[["depth_uncertainty", "depth_error_radius", "depth_uncertainty_by_error_source"]])
        .expand_dims(field=[0.7], axis=1)
        .copy(deep=True)
    )
    off["depth_uncertainty"].loc[{"camera": "r5"}] = np.nan
    both = xr.concat([off, off / 1.5], "corner").assign_coords(corner=["lower left", "lower right"])
    tree["depth_field"] = xr.DataTree(both)
    return tree


def test_depth_off_the_axis_is_shown_next_to_depth_on_it(make_tree: MakeTree) -> None:
    tree = with_field(make_tree())
    drawing = figures.build(tree)["off_axis"]
    assert "Stereo 100 mm, 65.24° across: 2 to 2 times as large." in drawing.alt
    assert "Raytrix R5, Keplerian: sees none of these distances there." in drawing.alt
    figure = drawing.draw()
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        "on the axis",
        "70 % of the way to the corner",
    ]
    axis, off = (np.asarray(line.get_ydata(), dtype=float) for line in figure.axes[2].get_lines())
    np.testing.assert_allclose(off, 2.0 * axis)
    headings = [plain_text(b.text) for b in all_blocks(report_of(tree).blocks) if isinstance(b, Heading)]
    assert "Off the axis" in headings
    assert field_words(0.0) == "on the axis"


def test_sensitivity_is_drawn_at_every_place_in_the_field(make_tree: MakeTree) -> None:
    tree, sources = make_tree(), ["yaw", "pixel_noise"]
    cameras = [str(key) for key in tree["depth"]["camera"].values]
    shape = (3, 2, 2, 2)
    u = np.broadcast_to(np.array([0.02, 0.001]), shape) * np.array([1.0, 2.0])[None, :, None, None]
    values = {
        "source_uncertainty": u,
        "first_index": np.broadcast_to(np.array([0.9, 0.1]), shape),
        "total_index": np.broadcast_to(np.array([0.9, 0.1]), shape),
        "total_index_error": np.full(shape, 0.01),
        "parameter_refused": ["", "", "correlated"],
        "index_refused": np.full(shape[:3], ""),
    }
    places = {"camera": cameras, "field": [0.0, 0.7], "distance": [0.5, 1.0], "source": sources}
    tree["sensitivity"] = xr.DataTree(dataset("sensitivity", values, places))
    drawn = figures.build(tree)
    assert "The largest on the axis: Raytrix R5, Keplerian: yaw, 20 mm." in drawn["tornado"].alt
    widths = [bar.get_width() for bar in drawn["tornado"].draw().axes[0].patches]
    np.testing.assert_allclose(widths, [20.0, 1.0, 40.0, 2.0])
    assert [row[0] for row in drawn["tornado"].values()[0].rows] == ["yaw", "matching noise"]
    names = [[text.get_text() for text in axes.texts] for axes in drawn["sobol-indices"].draw().axes[:3]]
    assert names == [["yaw", "matching noise"]] * 3
    (refused,) = table(report_of(tree), "refused-table")
    assert (refused[0], refused[-1]) == ("Stereo 100 mm, 65.24° across", "correlated")

from __future__ import annotations

import itertools
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import Callable

import matplotlib as mpl
import numpy as np
import pytest
import xarray as xr

from tests.report.layout import unreadable
from tradestudy import figures
from tradestudy.errors import OutOfRangeError
from tradestudy.figures.curves import fill
from tradestudy.figures.fonts import printable
from tradestudy.figures.style import length_tick, line_style, new_figure, plain_number, styled, traces
from tradestudy.figures.sweeps import axis_values, frontier, moved_cameras, reference_distance
from tradestudy.report.page_data import curve_values
from tradestudy.results.views.decision import has_winners, winners
from tradestudy.results.views.depth import nominal, uniform_shares
from tradestudy.results.views.groups import camera_titles
from tradestudy.units import LENGTH, NUMBER, pretty

HOSTILE = r"_R5 $x_1$ \frac{1}{0} <b>&amp; %s {0} #id '\"" + "日本"


def test_the_available_figures_follow_from_the_groups(tree: xr.DataTree, make_tree: Callable[..., xr.DataTree]) -> None:
    base = ["whole_range", "variance_shares"]
    of_a_paper = ["whole_range", "close_range", "mid_range", "variance_shares", "readings"]
    assert list(figures.build(tree)) == of_a_paper
    only_depth = xr.DataTree.from_dict({"/cameras": tree["cameras"].to_dataset(), "/depth": tree["depth"].to_dataset()})
    assert list(figures.build(only_depth)) == base
    assert not figures.build(xr.DataTree())
    with_sweep = make_tree(sweep={"baseline": [0.05, 0.1, 0.2]})
    assert list(figures.build(with_sweep)) == ["sweep_map", *of_a_paper[:-1], "pareto", "readings"]


def test_a_figure_that_does_not_exist_is_refused_with_those_that_do(tree: xr.DataTree) -> None:
    with pytest.raises(OutOfRangeError, match=r"figure-9.*whole_range, close_range"):
        figures.figure(tree, "figure-9")


@pytest.mark.parametrize("sweep", [{}, {"b": [1.0, 2.0]}, {"b": [1.0, 2.0, 3.0], "f": [1.0, 4.0], "g": [1.0, 2.0]}])
def test_hostile_names_are_drawn_as_they_are(
    make_tree: Callable[..., xr.DataTree], sweep: dict[str, list[float]]
) -> None:
    tree = make_tree(titles={"r5": HOSTILE}, sweep=sweep)
    names = ("sweep_map", "pareto") if sweep else ("whole_range", "close_range", "variance_shares", "readings")
    for drawing in (figures.build(tree)[name] for name in names):
        ET.fromstring(drawing.draw().svg())  # well formed, and no warning about letters or layout on the way


def test_a_title_that_starts_with_an_underscore_labels_its_curve(make_tree: Callable[..., xr.DataTree]) -> None:
    figure = figures.figure(make_tree(titles={"r5": "_hidden $a$"}), "close_range")
    for axes in figure.axes:
        name = next(text for text in axes.texts if text.get_text() == "_hidden $a$")
        assert not name.get_parse_math()


def test_letters_that_the_font_lacks_are_named() -> None:
    assert printable("α 日 µ") == "α ⟨U+65E5⟩ µ"


def test_the_caller_s_settings_neither_leak_in_nor_change(tree: xr.DataTree) -> None:
    usual = figures.figure(tree, "readings").svg()
    with mpl.rc_context({"font.size": 31.0, "lines.linewidth": 9.0, "svg.hashsalt": "other"}):
        before = dict(mpl.rcParams)
        assert figures.figure(tree, "readings").svg() == usual
        assert dict(mpl.rcParams) == before


def test_importing_the_package_does_not_import_matplotlib() -> None:
    program = (
        "import sys, tradestudy.figures, tradestudy.report; print('matplotlib' in sys.modules, 'typst' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "False"]


def test_pairs_of_colour_and_line_style_do_not_repeat() -> None:
    pairs = [(line_style(order).color, str(line_style(order).dash)) for order in range(35)]
    assert len(set(pairs)) == len(pairs)


def _seen_by(rgb: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    return np.clip(linear @ matrix.T, 0, 1)


# Machado, Oliveira and Fernandes (2009), full severity, linear RGB.
_DEFICIENCIES = {
    "protan": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deutan": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritan": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}


@pytest.mark.parametrize("deficiency", _DEFICIENCIES)
def test_the_first_six_colours_differ_for_colour_blind_readers(deficiency: str) -> None:
    rgb = np.array([[int(line_style(n).color[i : i + 2], 16) / 255 for i in (1, 3, 5)] for n in range(6)])
    seen = _cielab(_seen_by(rgb, np.array(_DEFICIENCIES[deficiency])))
    closest = min(float(np.linalg.norm(a - b)) for a, b in itertools.combinations(seen, 2))
    assert closest > 9.0  # a difference of 2.3 is just noticeable


def _cielab(linear: np.ndarray) -> np.ndarray:
    to_xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    ratio = (linear @ to_xyz.T) / np.array([0.9505, 1.0, 1.089])
    f = np.where(ratio > (6 / 29) ** 3, np.cbrt(ratio), ratio / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.stack([116 * f[:, 1] - 16, 500 * (f[:, 0] - f[:, 1]), 200 * (f[:, 1] - f[:, 2])], axis=1)


def test_a_camera_keeps_its_style_on_every_figure(tree: xr.DataTree) -> None:
    for name in ("whole_range", "close_range", "mid_range"):
        lines = figures.figure(tree, name).axes[0].get_lines()
        for camera in traces(tree):
            of_camera = [line for line in lines if line.get_color() == camera.style.color]
            assert len(of_camera) == 2  # bold where usable, thin elsewhere
            assert len({line.get_linestyle() for line in of_camera}) == 1


def test_bold_curves_hold_the_uncertainty_where_usable_in_millimetres(tree: xr.DataTree) -> None:
    figure = figures.figure(tree, "close_range")
    camera = traces(tree)[2]
    bold = max(
        (line for line in figure.axes[1].get_lines() if line.get_color() == camera.style.color),
        key=lambda line: line.get_linewidth(),
    )
    x, y = (np.asarray(values, dtype=float) for values in bold.get_data())
    drawn = np.isfinite(y)
    assert x[drawn].min() == pytest.approx(0.391, abs=0.01)
    np.testing.assert_allclose(y[drawn], 1e3 * np.hypot(6.9e-4, 0.0349) * x[drawn] ** 2, rtol=1e-12)


def test_required_uncertainties_are_drawn_over_their_distances(tree: xr.DataTree) -> None:
    """2 % of the distance from 0.1 to 0.4 m, and 40 mm at 1 m, in millimetres."""
    drawing = figures.build(tree)["whole_range"]
    assert "that a requirement allows" in drawing.caption
    axes = drawing.draw().axes[0]
    range_, point = ([one.get_xydata() for one in axes.lines if one.get_marker() == marker] for marker in "|D")
    np.testing.assert_allclose(range_, [[[0.1, 2.0], [0.4, 8.0]]])
    np.testing.assert_allclose(point, [[[1.0, 40.0]]])
    named = {text.get_text(): text for text in axes.texts}
    assert "below 2 % from 0.1 m to 0.4 m" in named
    assert named["any camera at 1 m"].get_position() == (1.0, 40.0)
    without = tree.copy()
    del without["requirements"]
    assert "requirement" not in figures.build(without)["whole_range"].caption


@pytest.mark.parametrize(
    "place",
    [
        pytest.param(place, marks=[pytest.mark.slow] if number % 6 else [])
        for number, place in enumerate(np.geomspace(0.1, 0.9, 25))
    ],
)
def test_names_of_fifty_requirements_hide_no_curve(tree: xr.DataTree, place: float) -> None:
    """Requirements at 50 distances, each as large as the least uncertainty there; the tightest two are named."""
    depth, own = tree["depth"].to_dataset(), tree["requirements"].to_dataset()
    near = place * np.geomspace(1.0, 1.1, 50)
    least = depth["depth_uncertainty"].min("camera").interp(distance=near).values
    every = own.isel(requirement=[0, 1] * 25).assign(
        requirement=[f"r{k}" for k in range(50)], says=("requirement", [f"at most {one:.2g} m" for one in least])
    )
    for name, values in {"over_near": near, "over_far": near * ([1.0, 1.3] * 25), "bound": least}.items():
        every[name] = ("requirement", values)
    every["bound_is_relative"] = ("requirement", np.zeros(50, dtype=bool))
    many = tree.copy()
    many["requirements"] = xr.DataTree(every)
    figure = figures.figure(many, "whole_range")
    figure.draw_without_rendering()
    axes = figure.axes[0]
    boxes = [text.get_window_extent() for text in axes.texts if text.get_text().startswith("at most")]
    for line in axes.lines[: len(depth["camera"]) * 2]:
        x = np.geomspace(*axes.get_xlim(), 2000)
        y = np.interp(x, line.get_xdata(), line.get_ydata())
        points = axes.transData.transform(np.column_stack([x, y])[np.isfinite(y)])
        assert not any(box.padded(-1.0).count_contains(points) for box in boxes)


def test_a_required_uncertainty_far_below_all_curves_lies_on_the_panel(tree: xr.DataTree) -> None:
    strict = tree.copy()
    strict["requirements"] = xr.DataTree(tree["requirements"].to_dataset().assign(bound=("requirement", [1e-5, 1e-5])))
    axes = figures.figure(strict, "whole_range").axes[0]
    lines = [line.get_ydata() for line in axes.lines if line.get_marker() == "|"]
    assert lines
    assert axes.get_ylim()[0] < np.min([np.min(line) for line in lines])


def test_a_requirement_beyond_the_computed_distances_is_not_drawn(tree: xr.DataTree) -> None:
    far = tree.copy()
    ends = {name: ("requirement", [20.0, 20.0]) for name in ("over_near", "over_far")}
    far["requirements"] = xr.DataTree(tree["requirements"].to_dataset().assign(ends))
    drawing = figures.build(far)["whole_range"]
    assert "requirement" not in drawing.caption
    assert not [line for line in drawing.draw().axes[0].lines if line.get_marker() == "|"]
    plain = tree.copy()
    del plain["requirements"]
    assert drawing.draw().axes[0].get_ylim() == figures.figure(plain, "whole_range").axes[0].get_ylim()


def test_a_requirement_that_ends_between_computed_distances_is_named_on_its_line(tree: xr.DataTree) -> None:
    few = tree.copy()
    few["depth"] = xr.DataTree(tree["depth"].to_dataset().isel(distance=slice(None, None, 9)))
    texts = figures.figure(few, "whole_range").axes[0].texts
    assert all(np.isfinite([*text.get_position(), text.get_rotation()]).all() for text in texts if text.get_text())


@pytest.mark.parametrize("name", ["whole_range", "mid_range"])
def test_no_curve_is_drawn_where_no_point_is_seen_twice(make_tree: Callable[..., xr.DataTree], name: str) -> None:
    tree = make_tree()
    depth = tree["depth"].to_dataset().copy(deep=True)
    depth["limit_value"][0, :100, 0] = 0.0
    tree["depth"] = xr.DataTree(depth)
    last = float(depth["distance"][99])
    axes = figures.figure(tree, name).axes[0]
    first, *others = (
        np.asarray(line.get_xdata(), dtype=float)[np.isfinite(np.asarray(line.get_ydata(), dtype=float))]
        for line in axes.get_lines()
        if line.get_color() in {trace.style.color for trace in traces(tree)} and len(line.get_xdata()) > 2
    )
    assert first.min() > last
    assert min(x.min() for x in others if x.size) < last
    values = curve_values(tree)
    assert np.isnan(values["depth_uncertainty/r5"].value[:100]).all()
    assert np.isfinite(values["depth_uncertainty/r5"].value[100:]).all()


def test_an_unbounded_step_shades_to_the_top_and_an_infinite_uncertainty_ends_the_curve(
    make_tree: Callable[..., xr.DataTree],
) -> None:
    tree = make_tree()
    depth = tree["depth"].to_dataset().copy(deep=True)
    depth["depth_uncertainty"][0, -60:] = np.inf
    tree["depth"] = xr.DataTree(depth)
    figure = figures.figure(tree, "mid_range")
    line = next(line for line in figure.axes[1].get_lines() if line.get_color() == traces(tree)[0].style.color)
    assert not np.isfinite(np.asarray(line.get_ydata(), dtype=float)[-60:]).any()
    assert np.isfinite(figure.axes[0].get_ylim()).all()


def test_ranges_of_one_winner_touch_and_cover_the_whole_range(tree: xr.DataTree) -> None:
    stretches = list(winners(tree))
    assert [key for _, _, key in stretches] == ["", "r5", "stereo-65deg"]
    assert stretches[0][0] == pytest.approx(0.05)
    assert stretches[-1][1] == pytest.approx(10.0)
    assert all(a[1] == b[0] for a, b in itertools.pairwise(stretches))


def test_a_camera_whose_variance_is_nearly_all_noise_has_no_panel_of_shares(tree: xr.DataTree) -> None:
    figure = figures.figure(tree, "variance_shares")
    assert [axes.get_title(loc="left") for axes in figure.axes] == [camera.title for camera in traces(tree)[1:]]
    assert uniform_shares(tree) == {"r5": "noise"}
    alone = tree.copy()
    alone["depth"] = xr.DataTree(tree["depth"].to_dataset().sel(camera=["r5"]))
    assert "variance_shares" not in figures.build(alone)


def test_shares_are_stacked_to_one_and_small_ones_named(tree: xr.DataTree) -> None:
    depth = tree["depth"].to_dataset().copy(deep=True)
    depth["variance_share"].loc[{"camera": "r5", "part": "noise"}] = 0.9
    depth["variance_share"].loc[{"camera": "r5", "part": "relative rotation"}] = 0.1
    tree = tree.copy()
    tree["depth"] = xr.DataTree(depth)
    figure = figures.figure(tree, "variance_shares")
    inside = {text.get_text().replace("\n", " ") for axes in figure.axes for text in axes.texts}
    below = {text.get_text() for legend in figure.legends for text in legend.get_texts()}
    assert inside | below == {"noise", "relative rotation", "relative position"}
    assert {"noise", "relative rotation"} <= inside
    assert not inside & below
    assert re.search(r"0\.5 %: interior orientation and [a-z ]+\.", figures.build(tree)["variance_shares"].caption)
    # The stereo rig: noise below, the rotation on it, the position up to 1.
    areas = [np.asarray(area.get_paths()[0].vertices) for area in figure.axes[1].collections]
    noise, yaw = 1.8e-4, 0.0349
    share = noise**2 / (noise**2 + yaw**2)
    tops = [area[:, 1].max() for area in areas]
    np.testing.assert_allclose(tops, [share, share + 0.9 * (1 - share), 1.0], rtol=1e-9)


_SHIFTS = (-0.12, 0.0, 0.12)  # of the marks of a row, nearest place on top


@pytest.mark.parametrize(("panel", "error_source"), [(0, "both"), (1, "noise"), (2, "calibration")])
def test_every_reading_has_its_marks_at_its_ratios(tree: xr.DataTree, panel: int, error_source: str) -> None:
    axes = figures.figure(tree, "readings").axes[panel]
    decision = tree["decision"].to_dataset().sel(error_source=error_source)
    marks: dict[bool, set[tuple[float, float]]] = {True: set(), False: set()}
    for line in axes.get_lines():
        if line.get_linestyle() == "None":
            points = zip(*(np.asarray(values, dtype=float).tolist() for values in line.get_data()), strict=True)
            marks[line.get_markerfacecolor() == "white"].update(points)
    for flipped in marks:
        expected = {
            (float(decision["uncertainty_ratio"][reading, place]), reading + _SHIFTS[place])
            for reading, place in np.ndindex(4, 3)
            if bool(decision["certainty_flips"][reading, place]) == flipped
        }
        assert sorted(marks[flipped]) == [pytest.approx(point) for point in sorted(expected)]


def test_readings_without_bound_are_counted_and_shown(make_tree: Callable[..., xr.DataTree]) -> None:
    tree = make_tree()
    decision = tree["decision"].to_dataset().copy(deep=True)
    # At 1 m: 3.4 · 1.2 as declared, then unbounded, undecided, and the first camera's bound against none.
    decision["uncertainty_ratio"].loc[{"place": 1.0, "error_source": "both"}] = [4.08, np.inf, np.nan, 0.0]
    tree["decision"] = xr.DataTree(decision)
    drawing = figures.build(tree)["readings"]
    sentence = "At 1\u00a0m the ratio runs from 0 to ∞ and is above 1 in 2 of 4 readings, undecided in 1."
    assert sentence in drawing.alt
    first, second = (camera_titles(tree)[decision.attrs[end]] for end in ("first", "second"))
    unbounded, undecided = drawing.caption.split("∞ at the edge: ")[1].split(" No mark: ")
    of_first, of_second = unbounded.split(" 0 at the edge: ")
    assert first in of_first
    assert second in of_second
    assert undecided
    assert [(text.get_text(), text.xy[1]) for text in drawing.draw().axes[0].texts] == [("∞", 1), ("0", 3)]
    as_usual = figures.build(make_tree())["readings"].caption
    assert "edge" not in as_usual
    assert "No mark" not in as_usual


def test_words_and_table_have_one_value_at_a_declared_distance(make_tree: Callable[..., xr.DataTree]) -> None:
    tree = make_tree()
    grid = tree["depth"].to_dataset()
    nearest = float(grid["distance"].sel(distance=1.0, method="nearest"))
    assert nearest != 1.0
    assert f"Uncertainty at {nearest:.3g}\u00a0m: " in figures.build(tree)["close_range"].alt
    places = grid.isel(distance=[0]).assign_coords(distance=[1.0])
    places["depth_uncertainty"] = places["depth_uncertainty"] * 0 + np.array([0.111, 0.222, 0.333])[:, None]
    tree["depth_at_places"] = xr.DataTree(places)
    alt = figures.build(tree)["close_range"].alt
    assert "Uncertainty at 1\u00a0m: Raytrix R5, Keplerian 111 mm; " in alt


def test_near_axes_are_in_millimetres_and_begin_with_the_study(make_tree: Callable[..., xr.DataTree]) -> None:
    tree = make_tree()
    near = tree["depth"].to_dataset().copy(deep=True)
    near = near.assign_coords(distance=np.linspace(0.042, 0.08, near.sizes["distance"]))
    named = {f"/{name}": tree[name].to_dataset() for name in ("cameras", "claims")}
    drawn = figures.build(xr.DataTree.from_dict({**named, "/depth": near}))
    assert "from 42\u00a0mm to 80\u00a0mm" in drawn["close_range"].caption
    for name in ("close_range", "whole_range", "variance_shares"):
        figure = drawn[name].draw()
        axes = next(axes for axes in figure.axes if axes.get_xlabel())
        assert axes.get_xlabel() == "distance [mm]"
        assert axes.get_xlim() == pytest.approx((0.042, 0.08))
        figure.draw_without_rendering()
        inside = [label for label in axes.get_xticklabels() if 0.042 <= label.get_position()[0] <= 0.08]
        assert len(inside) >= 3
        for label in inside:
            assert float(label.get_text()) == pytest.approx(1e3 * label.get_position()[0], rel=1e-3)
    axes = figures.figure(tree, "close_range").axes[1]  # from 50 mm to 1 m
    assert (axes.get_xlabel(), axes.get_xlim()) == ("distance [m]", (0.0, 1.0))


def test_no_word_of_a_legend_is_cut_off(tree: xr.DataTree) -> None:
    for drawing in figures.build(tree).values():
        texts = [text.get_text() for legend in drawing.draw().legends for text in legend.get_texts()]
        assert not any(text.endswith("…") for text in texts)


def test_curves_are_drawn_at_the_declared_design_or_name_theirs(make_tree: Callable[..., xr.DataTree]) -> None:
    sweep = {"b": [0.05, 0.1, 0.2]}  # the uncertainty is divided by 1, 2, 3
    declared, unknown = make_tree(sweep=sweep, declared={"b": 0.1}), make_tree(sweep=sweep)
    at_first = make_tree()["depth"].to_dataset()["depth_uncertainty"].values
    np.testing.assert_array_equal(nominal(declared)["depth_uncertainty"].values, at_first / 2)
    np.testing.assert_array_equal(nominal(unknown)["depth_uncertainty"].values, at_first)
    assert "the figure shows b 100 mm." in figures.build(declared)["mid_range"].caption
    assert "the figure shows b 50 mm." in figures.build(unknown)["mid_range"].caption
    # A decision is about the declared design: it is not drawn over the curves of another one.
    assert [has_winners(tree) for tree in (declared, unknown)] == [True, False]
    assert "best camera" in _tick_labels(declared)
    assert "best camera" not in _tick_labels(unknown)


def _tick_labels(tree: xr.DataTree) -> list[str]:
    return [label.get_text() for label in figures.figure(tree, "whole_range").axes[1].get_yticklabels()]


def test_a_sweep_over_one_value_is_drawn_at_the_middle_place(make_tree: Callable[..., xr.DataTree]) -> None:
    tree = make_tree(sweep={"b": [0.05, 0.1, 0.2]}, declared={"b": 0.1})
    axes = figures.figure(tree, "sweep_map").axes[0]
    line = next(line for line in axes.get_lines() if line.get_color() == traces(tree)[2].style.color)
    x, y = (np.asarray(values, dtype=float) for values in line.get_data())
    distance = float(tree["depth"].to_dataset()["distance"].sel(distance=0.5, method="nearest"))
    np.testing.assert_allclose(x, [50.0, 100.0, 200.0])
    np.testing.assert_allclose(y, 1e3 * np.hypot(6.9e-4, 0.0349) * distance**2 / np.array([1, 2, 3]), rtol=1e-12)


def test_choices_can_be_swept(make_tree: Callable[..., xr.DataTree]) -> None:
    axes = figures.figure(make_tree(sweep={"relay": ["keplerian", "galilean"]}), "sweep_map").axes[0]
    assert [label.get_text() for label in axes.get_xticklabels()] == ["keplerian", "galilean"]


def test_only_designs_usable_at_the_place_compete(make_tree: Callable[..., xr.DataTree]) -> None:
    tree = make_tree(sweep={"b": [0.05, 0.1, 0.2]}, declared={"b": 0.1})
    lines = figures.figure(tree, "pareto").axes[0].get_lines()
    points = {camera.key: next(n for n in lines if n.get_color() == camera.style.color) for camera in traces(tree)}
    # At 0.5 m the rig with 30.5 mm is not usable yet: it begins at 1.489 m.
    counts = {key: len(np.atleast_1d(line.get_xdata())) for key, line in points.items()}
    assert counts == {"r5": 3, "stereo-30mm": 0, "stereo-65deg": 3}


def test_without_a_usable_design_there_is_no_chart_of_them(make_tree: Callable[..., xr.DataTree]) -> None:
    tree = make_tree(sweep={"b": [0.05, 0.1, 0.2]}, declared={"b": 0.1})
    depth = tree["depth"].to_dataset()
    unusable = depth.assign(usable=xr.zeros_like(depth["usable"]), usable_near=depth["usable_near"] * np.nan)
    tree["depth"] = xr.DataTree(unusable)
    drawn = figures.build(tree)
    assert "sweep_map" in drawn
    assert "pareto" not in drawn
    for drawing in drawn.values():
        drawing.draw().svg()


def test_captions_say_why_designs_are_compared_near_the_declared_distance(
    make_tree: Callable[..., xr.DataTree],
) -> None:
    """Grid points are 3.4 % apart, so that none is 1 m."""
    tree = make_tree(sweep={"baseline": [0.05, 0.1, 0.2]})
    places = tree["decision"].to_dataset()["place"].values
    declared = sorted(places)[(len(places) - 1) // 2]
    grid = tree["depth"]["distance"].values
    used = grid[np.argmin(np.abs(np.log(grid / declared)))]
    assert f"{used:.3g}" != f"{declared:.3g}"
    for name in ("sweep_map", "pareto"):
        caption = figures.build(tree)[name].caption.replace("\N{NO-BREAK SPACE}", " ")
        assert f"at {used:.3g} m" in caption
        assert caption.endswith(f"{used:.3g} m is nearest to {declared:.3g} m.")


def test_the_frontier_keeps_what_nothing_beats() -> None:
    rng = np.random.default_rng(7)
    points = rng.random((200, 2))
    beaten = (
        ((points[:, None] >= points) & (points[:, None] > points).any(axis=2, keepdims=True)).all(axis=2).any(axis=1)
    )
    np.testing.assert_array_equal(frontier(points), np.array(sorted(map(tuple, points[~beaten]))))


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (0.05, "0.05"),
        (0.391, "0.391"),
        (1.0, "1"),
        (20.0, "20"),
        (1e4, "10,000"),
        (1e-7, "10⁻⁷"),
        (2e8, "2·10⁸"),
    ],
)
def test_tick_labels_are_readable(value: float, text: str) -> None:
    assert plain_number(value) == text


@pytest.mark.parametrize(
    ("millimetres", "text"),
    [(1e-3, "1 µm"), (0.02, "20 µm"), (1.0, "1 mm"), (500.0, "500 mm"), (1e4, "10 m"), (1e6, "1 km")],
)
def test_lengths_on_axes_have_the_expected_unit(millimetres: float, text: str) -> None:
    assert length_tick(millimetres) == text


def test_figures_show_themselves_in_notebooks_in_the_same_style(tree: xr.DataTree) -> None:
    shown = figures.figure(tree, "readings")._repr_svg_()
    assert shown == figures.figure(tree, "readings").svg().decode()


def test_bars_and_maps_have_tables_of_their_values(make_tree: Callable[..., xr.DataTree]) -> None:
    tree = make_tree(sweep={"b": [1.0, 2.0, 3.0], "f": [1.0, 4.0]})
    drawings = figures.build(tree)
    decision = tree["decision"].to_dataset()
    for table, error_source in zip(drawings["readings"].values(), ("both", "noise", "calibration"), strict=True):
        for row, reading in zip(table.rows, decision["reading"].values, strict=True):
            ratio = decision["uncertainty_ratio"].sel(reading=reading, error_source=error_source).values
            assert row == (reading, *(pretty(float(one), NUMBER) for one in ratio))
    depth = tree["depth"].to_dataset().sel(distance=reference_distance(tree))["depth_uncertainty"]
    for table, camera in zip(drawings["sweep_map"].values(), moved_cameras(tree), strict=True):
        reported = [list(row[1:]) for row in table.rows]
        values = depth.sel(camera=camera.key).transpose("f", "b").values
        assert reported == [[pretty(float(one), LENGTH) for one in row] for row in values]
    assert drawings["whole_range"].values() == ()


def test_a_map_of_many_designs_has_no_numbers_and_ticks_that_can_be_read(make_tree: Callable[..., xr.DataTree]) -> None:
    few, many = (make_tree(sweep={"b": np.linspace(0.01, 0.2, n), "f": np.linspace(1.0, 4.0, n)}) for n in (4, 25))
    assert "the numbers are in mm" in figures.build(few)["sweep_map"].caption
    drawing = figures.build(many)["sweep_map"]
    assert "numbers" not in drawing.caption
    drawn = drawing.draw()
    titles = [camera.title for camera in moved_cameras(many)]  # too long for three panels side by side
    assert not [one for one in unreadable(drawn) if not any(title in one for title in titles)]
    axes = drawn.axes[0]
    assert not axes.texts
    for ticks, parameter in ((axes.get_xticklabels(), "b"), (axes.get_yticklabels(), "f")):
        assert 4 <= len(ticks) <= 15
        names = axis_values(many["depth"].to_dataset()[parameter])[1]
        places = [tick.get_position()[parameter == "f"] for tick in ticks]
        assert [names[int(place)] for place in places] == [tick.get_text() for tick in ticks]


def test_a_figure_of_many_cameras_shows_those_that_answers_name_and_says_so(tree: xr.DataTree) -> None:
    keys = [*(f"copy-{number}" for number in range(22)), *tree["cameras"]["camera"].values]
    groups = {name: tree[name].to_dataset() for name in ("cameras", "depth")}
    many = {name: data.isel(camera=np.arange(25) % 3).assign_coords(camera=keys) for name, data in groups.items()}
    many["cameras"]["title"] = ("camera", [f"Camera {number}" for number in range(25)])
    decision = tree["decision"].to_dataset().drop_vars("judged_uncertainty")  # of the three cameras alone
    crowd = xr.DataTree.from_dict({**many, "claims": tree["claims"].to_dataset(), "decision": decision})
    assert [camera.key for camera in traces(crowd)] == [*keys[:16], "r5", "stereo-65deg"]
    for name in ("whole_range", "close_range", "variance_shares"):
        drawing = figures.build(crowd)[name]
        assert "18 of 25 cameras" in drawing.caption
        assert not unreadable(drawing.draw()), name


@pytest.mark.parametrize("scale", ["linear", "log"])
def test_an_area_of_few_points_looks_like_that_of_all(scale: str) -> None:
    x = np.geomspace(0.05, 10.0, 401)
    low, high = 0.02 * x, np.where(x < 1.0, 0.5 + 0.3 * np.sin(3.0 * x), 0.9)
    known = (x > 0.1) & (x < 5.0)
    with styled():
        axes = new_figure(2.0).subplots()
        axes.set(xscale="log", yscale=scale, xlim=(0.05, 10.0), ylim=(1e-3, 1.0))
        fill(axes, x, low, high, known)
    (area,) = axes.collections
    (path,) = area.get_paths()
    drawn = axes.transData.transform(path.vertices)
    middle = axes.transData.transform(np.column_stack([x, np.sqrt(low * high)]))
    lower, upper = (drawn[side(drawn[:, 1], np.interp(drawn[:, 0], *middle.T))] for side in (np.less, np.greater))
    for edge, wanted in ((lower, low), (upper, high)):
        here, there = axes.transData.transform(np.column_stack([x, wanted])[known]).T
        order = np.argsort(edge[:, 0], kind="stable")
        assert len(order) < 150
        np.testing.assert_allclose(np.interp(here, *edge[order].T), there, atol=0.139)

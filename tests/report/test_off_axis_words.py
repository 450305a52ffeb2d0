"""How much less certain depth off the axis is, and which cameras are usable nowhere, in the words of the first page."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import xarray as xr

from tradestudy import load
from tradestudy.results.views.conclusions import never_usable
from tradestudy.results.views.depth import off_axis_words
from tradestudy.results.views.headline import headline
from tradestudy.results.views.terminal import terminal_lines

MakeTree = Callable[..., xr.DataTree]
RIG = "stereo-65deg"


def with_field(tree: xr.DataTree, factor: float) -> xr.DataTree:
    """The study with depth halfway to the corner, `factor` times as uncertain there at one distance of one rig."""
    depth = tree["depth"].to_dataset()
    off = depth["depth_uncertainty"].expand_dims(field=[0.5], corner=["lower right", "upper left"]).copy()
    place = int(np.argmin(np.abs(off["distance"].values - 1.0)))
    off.loc[{"camera": RIG, "corner": "upper left", "distance": off["distance"].values[place]}] *= factor
    return xr.DataTree.from_dict(
        {
            **{node.path: node.to_dataset() for node in tree.subtree},
            "/depth_field": xr.Dataset({"depth_uncertainty": off, "depth_error_radius": 0.999 * off}),
        }
    )


def test_only_a_camera_that_is_clearly_less_certain_off_the_axis_is_named(make_tree: MakeTree) -> None:
    (words,) = off_axis_words(with_field(make_tree(), 2.5))
    assert "65.24°" in words
    assert "2.5 times" in words
    assert "50 % of the way to the upper left corner" in words
    assert off_axis_words(with_field(make_tree(), 1.05)) == []
    assert off_axis_words(make_tree()) == []


def test_an_uncertainty_without_bound_off_the_axis_is_said_to_have_none(make_tree: MakeTree) -> None:
    (words,) = off_axis_words(with_field(make_tree(), np.inf))
    assert "unbounded" in words


def test_a_place_where_a_usable_camera_measures_nothing_is_named(make_tree: MakeTree) -> None:
    (words,) = off_axis_words(with_field(make_tree(), np.nan))
    assert "measures no depth (50 % of the way to the upper left corner" in words


def test_the_terminal_says_for_which_points_of_the_picture_the_answers_hold(make_tree: MakeTree) -> None:
    assert any("axis" in line and "2.5 times" in line for line in terminal_lines(with_field(make_tree(), 2.5)))
    assert not any("axis" in line for line in terminal_lines(make_tree()))


def test_a_camera_that_is_usable_nowhere_is_named_with_the_limit_that_it_misses(make_tree: MakeTree) -> None:
    tree = make_tree()
    assert list(never_usable(tree)) == []
    depth = tree["depth"].to_dataset(inherit=False).copy(deep=True)
    for end in ("usable_near", "usable_far"):
        depth[end].loc[{"camera": "r5"}] = np.nan
    depth["limit_met"].loc[{"camera": "r5"}] = 1
    depth["limit_met"].loc[{"camera": "r5", "limit": "focus"}] = 0
    changed = xr.DataTree.from_dict({**{node.path: node.to_dataset() for node in tree.subtree}, "/depth": depth})
    assert list(never_usable(changed)) == [("Raytrix R5, Keplerian", "out of focus")]


def test_the_only_camera_is_named_with_the_limit_that_it_misses_everywhere(tmp_path: Path) -> None:
    """Parallel axes, f = 900 px, B = 1 m: the overlap, 1 − fB/(640 px Z), reaches 60 % at 3.52 m."""
    (tmp_path / "wide.yaml").write_text(
        "format: 2\nstudy: wide\ntitle: Wide\nquestion: Where?\ncameras:\n"
        "  rig: {kind: stereo, lenses: {focal_length: 900 px}, sensor: {pixels: [640, 480], pixel_pitch: 3 um},\n"
        "    baseline: 1 m, depth: {disparity_error: 0.1 px}}\n"
        "scene: {distances: {from: 1.6 m, to: 3.4 m, points: 5}, wavelength: 550 nm}\nusable_range: {overlap: 60 %}\n"
    )
    tree = load(tmp_path / "wide.yaml").run().data
    assert list(never_usable(tree)) == []
    assert headline(tree) == "No camera is usable from 1.6 to 3.4 m (too little overlap)."

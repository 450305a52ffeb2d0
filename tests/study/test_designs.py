"""What a sweep concludes, in every case that its results can be in."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import tradestudy
from tradestudy.results.views.designs import (
    common_ranges,
    design_details,
    favoured_words,
    feasible_designs,
    feasible_words,
)
from tradestudy.results.views.terminal import terminal_lines
from tradestudy.study.varying import sweep_axes

STUDIES = Path(__file__).parents[2] / "studies"
AT_HALF_A_METRE = {"depth_uncertainty": {"below": "40 mm", "at": "0.5 m"}}
CAMERAS = {"rig": "Rig", "r5": "R5"}
BASELINES, FOCI = np.array([0.05, 0.1, 0.2]), np.array([0.004, 0.008])


def tree(
    met: Any = None,
    margins: Any = None,
    *,
    priority: tuple[str, ...] = ("must", "must"),
    of: str = "rig",
    **more: Any,
) -> xr.DataTree:
    """Results of a sweep over the baseline (3) and the focal length (2) of a rig, with two requirements."""
    axes = {
        "baseline": ("baseline", BASELINES, {"units": "m", "declared": 0.1, "path": "rig.baseline"}),
        "focal_length": ("focal_length", FOCI, {"units": "m", "declared": 0.008, "path": "rig.lenses.focal_length"}),
    }
    groups: dict[str, xr.Dataset] = {
        "/cameras": xr.Dataset({"title": ("camera", list(CAMERAS.values()))}, coords={"camera": list(CAMERAS)})
    }
    if met is not None:
        dims = ("baseline", "focal_length", "requirement")
        groups["/requirements"] = xr.Dataset(
            {
                "design_met": (dims, np.broadcast_to(met, (3, 2, 2))),
                "design_margin_percent": (dims, np.broadcast_to(margins, (3, 2, 2)).astype(float)),
                "design_reason": (dims, np.broadcast_to([["worst 1 %", "worst 2 %"]], (3, 2, 2))),
                "priority": ("requirement", list(priority)),
                "of": ("requirement", [of, of]),
                "says": ("requirement", ["close enough", "far enough"]),
            },
            coords={**axes, "requirement": ["near", "far"]},
        )
    if more:
        groups["/decision"] = xr.Dataset(
            {name: value for name, value in more.items() if isinstance(value, tuple)},
            coords={**axes, "design_place": [0.5, 1.0]},
            attrs={"first": "rig", "second": "r5"},
        )
    return xr.DataTree.from_dict(groups)


def grid(*rows: tuple[float, float]) -> np.ndarray:
    """Values by baseline and focal length, of both requirements alike."""
    return np.repeat(np.array(rows)[..., None], 2, axis=-1)


def test_the_feasible_region_is_described_by_the_values_of_its_designs() -> None:
    results = tree(grid((0, 0), (1, 0), (1, 1)), grid((-50, -60), (5, -3), (20, 12)))
    assert feasible_words(results) == (
        "3 of 6 designs meet both requirements: the rig with baseline 100 mm to 200 mm and focal length 4 mm to 8 mm "
        "(not every combination)"
    )
    assert design_details(results) == (
        "Largest margin, 20 %: the rig with baseline 200 mm and focal length 4 mm. Of the others, 3 miss “close "
        "enough” and 3 miss “far enough” (some miss both)"
    )
    found = feasible_designs(results)
    assert found is not None
    assert (found.count, found.designs) == (3, 6)
    assert found.best.values == {"rig.baseline": 0.2, "rig.lenses.focal_length": 0.004}
    assert found.best.margin == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("feasible", "best"),
    [
        (0, "50 mm (where the sweep begins)"),
        (2, "200 mm"),
        (3, "400 mm (where the sweep ends)"),
        (4, "900 mm"),  # declared; the sweep does not reach it
    ],
)
def test_a_best_design_at_the_edge_of_a_sweep_is_called_so(feasible: int, best: str) -> None:
    met = np.zeros((5, 2, 2))
    met[feasible, 0] = 1
    results = tree(0, 0)
    data = results["requirements"].to_dataset().isel(baseline=[0, 1, 2, 2, 2])
    data["baseline"] = ("baseline", [0.05, 0.1, 0.2, 0.4, 0.9], {**data["baseline"].attrs, "declared": 0.9})
    dims = ("baseline", "focal_length", "requirement")
    results["requirements"] = xr.DataTree(data.assign(design_met=(dims, met), design_margin_percent=(dims, met)))
    assert f"the rig with baseline {best} and focal length 4 mm" in design_details(results)
    alike = np.broadcast_to(met[feasible], met.shape)  # the baseline has no influence
    results["requirements"] = xr.DataTree(data.assign(design_met=(dims, alike), design_margin_percent=(dims, alike)))
    assert "the rig with baseline 50 mm and focal length 4 mm" in design_details(results)


def test_one_feasible_design_and_all_feasible_designs_are_described() -> None:
    one = feasible_words(tree(grid((0, 0), (1, 0), (0, 0)), grid((-5, -5), (5, -5), (-5, -5))))
    assert one == "take the rig with baseline 100 mm and focal length 4 mm: 1 of 6 designs meets both requirements"
    assert feasible_words(tree(1, 7)).startswith("every design meets both requirements: ")
    by_any = feasible_words(tree(1, 7, of="any"))
    assert by_any.startswith("every design meets both requirements with one of the cameras: ")


def test_without_a_feasible_design_the_nearest_one_is_named_with_the_requirement_it_misses() -> None:
    margins = grid((-50, -60), (-40, -30), (-20, -25))
    margins[2, 0] = (10.0, -4.0)
    results = tree((margins > 0.0) * 1, margins)
    assert feasible_words(results) == (
        "none of 6 designs meets both requirements: the rig with baseline 200 mm and focal length 4 mm comes closest"
    )
    assert design_details(results) == "The closest design misses “far enough” (worst 2 %)"


def test_every_requirement_that_the_nearest_design_misses_is_named_worst_missed_first() -> None:
    margins = grid((-50, -60), (-40, -30), (-20, -25))
    margins[2, 0] = (-4.0, -10.0)
    assert design_details(tree(0, margins)).endswith("misses “far enough” (worst 2 %) and “close enough” (worst 1 %)")


def test_a_wish_does_not_make_a_design_infeasible() -> None:
    met = np.zeros((3, 2, 2))
    met[..., 0] = 1
    found = feasible_designs(tree(met, np.where(met == 1, 5.0, -5.0), priority=("must", "should")))
    assert found is not None
    assert (found.count, found.required) == (6, 1)


def test_a_design_without_a_margin_is_never_nearest() -> None:
    margins = grid((-50, np.nan), (-40, -30), (-20, -25))
    found = feasible_designs(tree(0, margins))
    assert found is not None
    assert found.best.margin == pytest.approx(-0.2)


def test_no_design_is_called_closest_where_the_sweep_does_not_matter() -> None:
    results = tree(0, grid(*[(-20.0, -20.0)] * 3))
    assert feasible_words(results) == "none of 6 designs meets both requirements: all miss them alike"
    assert design_details(results) == "Every design misses “close enough” (worst 1 %) and “far enough” (worst 2 %)"


def test_a_requirement_that_cannot_be_decided_is_not_called_missed() -> None:
    unknown, nowhere = [1, -1], np.broadcast_to([20.0, np.nan], (3, 2, 2))
    results = tree(unknown, nowhere)
    assert feasible_words(results) == "none of 6 designs meets both requirements: one of them cannot be decided for any"
    assert design_details(results) == "Every design leaves undecided “far enough” (worst 2 %)"
    margins = grid((-10, -20), (-30, -40), (-50, -60)).astype(float)
    margins[..., 1] = np.nan
    results = tree([0, -1], margins)
    assert feasible_words(results).endswith("the rig with baseline 50 mm and focal length 4 mm comes closest")
    assert design_details(results).startswith(
        "The closest design misses “close enough” (worst 1 %) and leaves undecided"
    )


def test_no_design_has_the_largest_margin_where_the_sweep_does_not_matter() -> None:
    results = tree(1, grid(*[(20.0, 20.0)] * 3))
    assert feasible_words(results).startswith("every design meets both requirements")
    assert design_details(results) == "The margin of every design is 20 %"
    assert design_details(tree(1, np.full((3, 2, 2), np.inf))) == ""


def test_the_next_requirement_decides_between_designs_that_miss_the_worst_one_alike() -> None:
    margins = grid((-50, -50), (-50, -50), (-50, -50)).astype(float)
    margins[..., 1] = [[-30, -20], [-10, -25], [-40, -45]]
    found = feasible_designs(tree(0, margins))
    assert found is not None
    assert found.best.values == {"rig.baseline": 0.1, "rig.lenses.focal_length": 0.004}


def test_a_margin_without_an_end_is_not_stated_as_a_number() -> None:
    met = grid((1, 1), (1, 1), (1, 0))
    assert design_details(tree(met, np.full((3, 2, 2), np.inf))).startswith("Best: the rig with baseline 50 mm")


def test_the_closest_design_has_the_largest_margin_and_what_it_lacks_is_said() -> None:
    """Lenses at f/2, focused at 0.3 m, blur a point at 0.35 m over f/2 · f/(0.3 m − f)/7: 1.3 and 5.2 px."""
    rig = {
        "kind": "stereo",
        "lenses": {"focal_length": "8 mm", "f_number": 2},
        "focus_distance": "0.3 m",
        "principal_distance": "focused",
        "sensor": {"pixels": [1280, 960], "pixel_pitch": "3 um"},
        "baseline": "60 mm",
        "depth": {"disparity_error": "0.1 px"},
    }
    study = {
        "format": 2,
        "study": "closest",
        "title": "Closest",
        "question": "Which lens?",
        "cameras": {"rig": rig},
        "scene": {"distances": {"from": "0.2 m", "to": "4 m", "points": 9}, "wavelength": "550 nm"},
        "usable_range": {"blur": "1.5 px"},
        "sweep": {"rig.lenses.focal_length": ["4 mm", "8 mm"]},
        "requirements": {
            "fine": {
                "says": "fine",
                "camera": "rig",
                "depth_uncertainty": {"below": "10 um", "over": ["0.3 m", "0.35 m"]},
            }
        },
    }
    result = tradestudy.Study.from_dict(study).run()
    data = result.data["requirements"].to_dataset()
    assert (data["design_margin_percent"].values[0] < data["design_margin_percent"].values[1]).all()
    lines = list(terminal_lines(result.data))
    assert any("focal length 8 mm comes closest" in line for line in lines)
    assert any(line.startswith("The closest design misses “fine” (not usable ") for line in lines)


def test_of_designs_that_are_usable_nowhere_the_one_that_falls_short_by_less_is_closest() -> None:
    results = tree(0, grid(*[(-100.0, -100.0)] * 3))
    data = results["requirements"].to_dataset()
    short = -2.0 * np.ones(data["design_margin_percent"].shape)
    short[1, 1] = -1.5
    dims = data["design_margin_percent"].dims
    results["requirements"] = xr.DataTree(data.assign(design_closeness=(dims, short)))
    assert "baseline 100 mm and focal length 8 mm comes closest" in feasible_words(results)


def test_a_sweep_to_infinity_has_choices_and_no_range_up_to_infinity() -> None:
    """Nothing is drawn or searched between a number and infinity; the declared infinity is one design, not two."""
    study = tradestudy.load(STUDIES / "robot.yaml").with_values(
        {
            "sweep": {"stereo-75mm.focus_distance": ["inf", "0.5 m", "2 m"]},
            "stereo-75mm.focus_distance": "infinity",
            "requirements": {
                "near-and-mid": None,
                "fine": {"says": "fine", "camera": "stereo-75mm", **AT_HALF_A_METRE},
            },
            "scene.distances": ["0.3 m", "4 m"],
            "usable_range.blur": "1 px",
        }
    )
    (axis,) = sweep_axes(study.prepared)
    assert (axis.labels, axis.declared) == (("0.5 m", "2 m", "inf"), "inf")
    # At 0.5 m, f = 2.65 mm at f/2 blurs over 1.325 mm · f · |1/0.5 m − 1/a₀|: 5.3 um focused at 2 m, 7 um at infinity.
    first, *_ = terminal_lines(study.run().data)
    assert first == "Take the 75 mm stereo head with focus distance 0.5 m: 1 of 3 designs meets the requirement."


def test_the_favoured_camera_is_counted_over_designs_and_equal_places_are_merged() -> None:
    dims = ("baseline", "focal_length", "design_place")
    mixed = np.array([["rig", "r5"], ["rig", "rig"], ["rig", ""]], dtype=object)
    best = np.stack([mixed, mixed], axis=-1)
    (reported,) = favoured_words(tree(design_best_camera=(dims, best)))
    assert (
        reported.replace("\N{NO-BREAK SPACE}", " ")
        == "at 0.5 m and 1 m: Rig in 4 of 6 designs, no camera in 1, R5 in 1"
    )
    nobody = np.full((3, 2, 2), "", dtype=object)
    nobody[..., 1] = "r5"
    first, second = favoured_words(tree(design_best_camera=(dims, nobody)))
    assert first.endswith("no camera in any design")
    assert second.endswith("R5 in every design")


def test_ranges_of_several_requirements_are_intersected_and_takeovers_joined() -> None:
    """One requirement holds on 1–3 by one camera, on 3–5 by another, and on 7–9; the other on 2–8."""
    data = xr.Dataset(
        {
            "met_from": (("requirement", "stretch"), [[1.0, 3.0, 7.0], [2.0, np.nan, np.nan]]),
            "met_to": (("requirement", "stretch"), [[2.99, 5.0, 9.0], [8.0, np.nan, np.nan]]),
            "met_to_within": (("requirement", "stretch"), [[0.005, 0.005, 0.005], [0.0, np.nan, np.nan]]),
        }
    )
    assert common_ranges(data, np.array([True, True])) == [(2.0, 5.0), (7.0, 8.0)]
    assert common_ranges(data, np.array([True, False])) == [(1.0, 5.0), (7.0, 9.0)]


def test_a_design_that_misses_only_a_guard_band_names_the_right_requirement() -> None:
    met = np.ones((3, 2, 2))
    met[..., 0] = 0.0
    margins = np.zeros((3, 2, 2))
    margins[..., 0], margins[..., 1] = 50.0, 5.0
    margins[2, 1] = 6.0
    assert design_details(tree(met, margins)) == "The closest design misses “close enough” (worst 1 %)"

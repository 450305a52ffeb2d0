"""Two runs side by side: every sentence, results beyond their error, the figure and the page."""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Mapping
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

import tradestudy
from tradestudy import api
from tradestudy.cli import app
from tradestudy.comparison import Comparison, compare_runs
from tradestudy.comparison.comparison import Run
from tradestudy.comparison.results import Results, compare_results, values_in_words
from tradestudy.errors import OutOfRangeError
from tradestudy.results import dataset, storage
from tradestudy.units import PIXELS

DISTANCE = np.geomspace(0.1, 10.0, 41)
CAMERAS = {"a": "Near head", "b": "Far head"}
WHOLE = (0.1, 10.0)
ROBOT = Path(__file__).parent.parent / "studies" / "robot.yaml"


def requirement(verdict: int, worst: float = 1.0, camera: str = "a", **other: Any) -> dict[str, Any]:
    """A row of /requirements; its value has an error of 1 %."""
    return {
        "says": "2 % at 1 m",
        "priority": "must",
        "quantity": "depth_uncertainty",
        "of": "any",
        "met": verdict,
        "camera_deciding": camera,
        "value": worst / 100.0,
        "value_error": worst / 1e4,
        "bound": 0.02,
        "place": 1.0,
        "margin_percent": 10.0,
        "conformity": 1.0,
        "reason": f"worst {worst:g} % at 1 m",
        "limited_by": "",
        "rests_on": "",
        "rests_on_share": 0.0,
    } | other


def tree(
    *,
    handover: float = 1.0,
    usable: Mapping[str, tuple[float, float] | None] | None = None,
    end_error: float = 0.0,
    factor: float = 1.0,
    error: float = 1e-6,
    asked: Mapping[str, dict[str, Any]] | None = None,
    verdict: str = "met",
    cameras: Mapping[str, str] | None = None,
    left_out: float = 0.0,
    propagation: str = "linear",
    distance: np.ndarray = DISTANCE,
) -> xr.DataTree:
    """A study of two cameras: a is best up to the handover, b beyond; depth uncertainty Z²/100, of b `factor` times."""
    titles = CAMERAS if cameras is None else cameras
    ranges = dict.fromkeys(titles, WHOLE) | dict(usable or {})
    uncertainty = np.stack([distance**2 / 100.0 * (factor if key == "b" else 1.0) for key in titles])
    ends = np.array([ranges[key] or (np.nan, np.nan) for key in titles])
    depth = dataset(
        "depth",
        {
            "depth_uncertainty": uncertainty,
            "depth_uncertainty_error": error * uncertainty,
            "depth_error_radius": 0.999 * uncertainty,
            "depth_error_radius_error": error * uncertainty,
            "usable": (distance >= ends[:, :1]) & (distance <= ends[:, 1:]),
            "usable_near": ends[:, :1],
            "usable_far": ends[:, 1:],
            "usable_near_error": np.full((len(titles), 1), end_error),
            "usable_far_error": np.full((len(titles), 1), end_error),
            "limit_value": np.ones((*uncertainty.shape, 1)),
            "near_limit": [["overlap"]] * len(titles),
            "far_limit": [["relative_uncertainty"]] * len(titles),
        },
        {"camera": list(titles), "distance": distance, "limit": ["overlap"]},
    )
    best = np.where(distance < handover, *list(titles)[:2])
    decision = dataset(
        "decision",
        {
            "best_camera": best[:, None].astype(object),
            "crossover_distance": [[[handover]]],
            "crossover_error": [[[1e-4]]],
        },
        {"distance": distance, "error_source": ["both"], "reading": ["as declared"]},
    )
    groups = {
        "cameras": dataset("cameras", {"title": list(titles.values())}, {"camera": list(titles)}),
        "depth": depth,
        "decision": decision,
        "claims": dataset("claims", {"says": ["as its maker says"], "verdict": [verdict]}, {"claim": ["C1"]}),
        "effects": dataset(
            "effects",
            {
                "joint_change": np.full((len(titles), 2), left_out),
                "problem_of": list(titles),
                "slot": ["calibration"] * len(titles),
                "model": [propagation] * len(titles),
                "chosen": [1.0] * len(titles),
                "problem_title": list(titles.values()),
            },
            {"problem": list(titles), "quantity": ["depth_uncertainty", "usable_range"], "decision": list(titles)},
        ),
    }
    rows = asked or {}
    if rows:
        names = next(iter(rows.values()))
        columns = {name: [row[name] for row in rows.values()] for name in names}
        groups["requirements"] = dataset("requirements", columns, {"requirement": list(rows)})
    return xr.DataTree.from_dict({f"/{name}": data for name, data in groups.items()})


def compared(*trees: xr.DataTree, **inputs: tuple[str, ...]) -> Comparison:
    records = [
        {"study": "s", "inputs": {name.replace("__", "."): values[k] for name, values in inputs.items()}}
        for k in range(len(trees))
    ]
    return compare_runs([f"run{k}" for k in range(len(trees))], records, trees)


def sentences(*trees: xr.DataTree) -> list[str]:
    return [one.replace("\N{NO-BREAK SPACE}", " ") for one in compared(*trees).sentences()]


SWITCH = "From 0.1 to {} m take the near head, to 10 m the far head"
REST = "Unchanged: 1 claim; the best camera from 0.1 to 10 m; the usable range of 2 cameras."


@pytest.mark.parametrize(
    ("before", "after", "sentence"),
    [
        (requirement(1, 0.87), requirement(0, 2.31), "met → not met (Near head: worst 0.87 % → 2.31 % at 1 m)."),
        (requirement(0, 2.31), requirement(1, 0.87), "not met → met (Near head: worst 2.31 % → 0.87 % at 1 m)."),
        (
            requirement(1),
            requirement(-1, np.nan, "b", reason="the camera has none"),
            "met → cannot be decided (Near head: worst 1 % at 1 m → Far head: the camera has none).",
        ),
        (
            requirement(0, 3.0, reason="not usable at 2 m; worst 3 % at 1 m"),
            requirement(1, 1.0),
            "not met → met (Near head: not usable at 2 m; worst 3 % at 1 m → worst 1 % at 1 m).",
        ),
        (requirement(1), requirement(1, 1.0, "b"), "met, by Near head → met, by Far head."),
        (
            requirement(0, 3.0),
            requirement(0, 3.0, "b"),
            "not met, closest: Near head → not met, closest: Far head.",
        ),
        (
            requirement(1),
            requirement(0, bound=0.005),
            "met → not met (Near head: worst 1 % at 1 m; its bound differs).",
        ),
    ],
)
def test_a_requirement_that_is_answered_differently(
    before: dict[str, Any], after: dict[str, Any], sentence: str
) -> None:
    found = sentences(tree(asked={"r": before}), tree(asked={"r": after}))
    assert found == [f'Requirement "2 % at 1 m": {sentence}', REST]


def test_a_requirement_that_one_run_does_not_ask() -> None:
    found = sentences(tree(asked={"r": requirement(1)}), tree())
    assert found == ['Requirement "2 % at 1 m": met → not asked (Near head: worst 1 % at 1 m).', REST]


def test_a_worst_value_counts_as_changed_only_beyond_its_error() -> None:
    def reported(after: float) -> list[str]:
        found = compared(tree(asked={"r": requirement(1, 1.0)}), tree(asked={"r": requirement(1, after)}))
        assert found.conclusions == ()
        return [str(one) for one in found.results]

    assert reported(1.25) == ['requirement "2 % at 1 m": worst 1 % at 1 m → worst 1.25 % at 1 m (+25 %)']
    assert reported(1.01) == []  # √2 of the 1 % that each may be off by


def test_a_claim_that_is_answered_differently() -> None:
    assert sentences(tree(), tree(verdict="not met"))[0] == 'Claim "as its maker says": met → not met.'


def test_the_best_camera_changes_between_distances() -> None:
    found = sentences(tree(handover=1.0), tree(handover=2.0))
    assert found == [
        "Best camera: Far head → Near head from 1 to 2 m; otherwise unchanged.",
        "Unchanged: 1 claim; the usable range of 2 cameras.",
    ]


def test_the_best_camera_changes_everywhere() -> None:
    found = sentences(tree(handover=20.0), tree(handover=0.01))
    assert found[0] == "Best camera: Near head → Far head from 0.1 to 10 m."


def test_an_unreported_sliver_belongs_to_the_adjacent_range() -> None:
    sliver = tree(handover=0.100_01)
    assert not sentences(sliver, sliver)[0].startswith("Best camera")
    found = sentences(sliver, tree(handover=1.0))
    assert found[0] == "Best camera: Far head → Near head from 0.1 to 1 m; otherwise unchanged."


def test_a_handover_that_moves_by_less_than_its_error_is_unchanged() -> None:
    (close,) = sentences(tree(handover=1.0), tree(handover=1.0007))
    assert re.sub(r"10 m, [^;]*error[^;]*;", "10 m;", close) == REST != close
    assert sentences(tree(handover=1.0), tree(handover=1.02))[0].startswith("Best camera")


def test_studies_of_other_distances_are_compared_where_they_overlap() -> None:
    near = DISTANCE[:31]  # to 3.16 m
    found = sentences(tree(), tree(handover=2.0, distance=near, usable={"a": (0.1, 3.2), "b": (0.1, 3.2)}))
    assert found == [
        "Best camera: Far head → Near head from 1 to 2 m; otherwise unchanged.",
        "Unchanged: 1 claim; the usable range of 2 cameras.",
    ]
    apart = compared(tree(distance=near), tree(distance=np.geomspace(4.0, 10.0, 5)))
    assert not any(one.what == "Best camera" for one in apart.conclusions)
    (note,) = apart.notes
    assert note.endswith(": depth uncertainty.")


@pytest.mark.parametrize(
    ("before", "after", "sentence"),
    [
        (WHOLE, (0.1, 4.0), "0.1 to 10 m → 0.1 to 4 m (far end set by the relative uncertainty)."),
        ((0.3, 4.0), (0.4, 4.0), "0.3 to 4 m → 0.4 to 4 m (near end set by the overlap)."),
        (None, (1.0, 4.0), "nowhere → 1 to 4 m."),
        ((1.0, 4.0), None, "1 to 4 m → nowhere."),
        ((1.0, np.inf), (1.0, 4.0), "1 to 10 m → 1 to 4 m (far end set by the relative uncertainty)."),
    ],
)
def test_a_usable_range_moves_appears_and_vanishes(
    before: tuple[float, float] | None, after: tuple[float, float] | None, sentence: str
) -> None:
    found = sentences(tree(usable={"a": before}), tree(usable={"a": after}))
    assert found[0] == f"Usable range of Near head: {sentence}"
    assert found[-1].endswith("the usable range of 1 camera.")


def test_an_end_that_moves_by_less_than_its_error_is_unchanged() -> None:
    def moved(after: float, **known: float) -> bool:
        return sentences(tree(usable={"a": (1.0, 4.0)}, **known), tree(usable={"a": (1.0, after)}, **known)) != [REST]

    assert moved(4.02)
    assert not moved(4.02, end_error=0.01)  # 0.02 m is two standard errors
    assert moved(4.2, end_error=0.01)
    assert not moved(4.02, left_out=0.01)  # what the models leave out may move it by 0.04 m


def test_a_result_differs_where_both_errors_together_are_exceeded() -> None:
    def reported(**known: float) -> list[str]:
        return [
            str(one).replace("\N{NO-BREAK SPACE}", " ") for one in compared(tree(), tree(factor=1.05, **known)).results
        ]

    line = ["depth uncertainty of Far head: 100 µm → 105 µm at 0.1 m (+5 %)"]
    assert reported() == line
    assert reported(error=0.04) == line
    assert reported(error=0.06) == []
    assert reported(left_out=0.06) == []


def test_standard_errors_of_draws_count_as_often_as_in_decisions() -> None:
    def drawn(factor: float) -> xr.DataTree:
        return tree(factor=factor, error=0.01, propagation="exact")

    limit = 5.4 * 0.01 * np.sqrt(2.0)
    assert compared(drawn(1.0), drawn(1.0 + 0.9 * limit)).results == ()
    assert len(compared(drawn(1.0), drawn(1.0 + 1.2 * limit)).results) == 1


def many(factors: np.ndarray) -> xr.DataTree:
    """A study of as many cameras as factors of their depth uncertainty."""
    keys = [f"c{k}" for k in range(factors.size)]
    found = tree(cameras={key: f"Camera {key[1:]}" for key in keys})
    depth = found["depth"].to_dataset()
    found["depth"] = xr.DataTree(depth.assign(depth_uncertainty=depth["depth_uncertainty"] * factors[:, None]))
    return found


def test_the_largest_come_first_and_the_rest_is_counted() -> None:
    found = compared(many(np.ones(13)), many(1.0 + np.arange(13) / 100.0))
    lines = str(found).splitlines()
    start = lines.index("Results that differ by more than their error, 12 of 13:")
    assert [re.findall(r"Camera (\d+)", line)[0] for line in lines[start + 1 : start + 11]] == [
        str(k) for k in range(12, 2, -1)
    ]
    assert lines[start + 11 :] == ["  and 2 more"]
    assert (len(found.results), found.same_results) == (12, 1)
    assert found.overlay is not None
    assert found.overlay.caption.endswith(
        "Not drawn: " + ", ".join(f"Camera {k}" for k in range(7, 12)) + " and Camera 12."
    )


@pytest.mark.parametrize(
    ("after", "change"),
    [(2.0, "(+100 %)"), (0.5, "(−50 %)"), (11.0, "(+1000 %)"), (178.0, "(178 times)"), (np.inf, "")],
)
def test_large_changes_are_factors_and_infinite_ones_speak_for_themselves(after: float, change: str) -> None:
    (found,) = compared(tree(), tree(factor=after)).results
    assert found.values[0] == "100 µm"
    assert found.where.replace("\N{NO-BREAK SPACE}", " ") == f"at 0.1 m {change}".strip()


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ((180.1, 180.2), ("180.1 px", "180.2 px")),
        ((180.0, 180.0), ("180 px", "180 px")),
        ((180.0, math.nan), ("180 px", "none")),
        ((1.0, 1.0 + 1e-9), ("1 px", "1 px")),  # six digits at most
    ],
)
def test_values_have_the_digits_that_distinguish_them(values: tuple[float, ...], words: tuple[str, ...]) -> None:
    assert values_in_words(values, PIXELS) == words


def test_changes_where_the_camera_is_usable_come_first() -> None:
    bent = tree(usable={"b": (1.0, 2.0)})
    depth = bent["depth"].to_dataset().copy(deep=True)
    depth["depth_uncertainty"][1] *= np.where(DISTANCE < 0.5, 50.0, 1.1)
    bent["depth"] = xr.DataTree(depth)
    (found,) = compared(tree(usable={"b": (1.0, 2.0)}), bent).results
    assert found.where.endswith("(+10 %)")


def test_the_clauses_of_an_answer_that_did_not_change_are_not_repeated() -> None:
    def asked(end: str, declared: str, value: float) -> xr.DataTree:
        found = tree()
        answer = f"Left pair: met from {end} on; Right pair: met nowhere between 50 mm and 90 mm; declared: {declared}"
        solved = {"solved_says": ["Which baseline?"], "solved_answer": [answer], "solved_value": [value]}
        more = dataset("decision", solved | {"solved_error": [0.0]}, {"question": ["baseline"]})
        found["decision"] = xr.DataTree(found["decision"].to_dataset().merge(more))
        return found

    (said,) = [
        one
        for one in compared(asked("53 mm", "60 mm", 0.053), asked("61 mm", "6 cm", 0.061)).conclusions
        if one.what.startswith("Question")
    ]
    assert said.change == "Left pair: met from 53 mm on → Left pair: met from 61 mm on"


@pytest.mark.parametrize(
    ("one", "other", "alike"),
    [
        ("['0.0 rad', '0.0 rad', '0.1 rad']", "['1e-19 rad', '-2e-17 rad', '0.1 rad']", True),
        ("['-0.1 m', '0.0 m', '0.0 m']", "['-100 mm', '3e-18 m', '0 m']", True),
        ("['-0.1 m', '0.0 m', '0.0 m']", "['-0.1 m', '1e-9 m', '0.0 m']", False),
        ("['0.0 rad', '0.0 rad', '0.1 rad']", "['1e-9 rad', '0.0 rad', '0.1 rad']", False),
        ("1e-19 m", "2e-19 m", False),
        ("infinity", "infinity", True),
        ("infinity", "1 m", False),
        ("[1, 2]", "[1, 2, 3]", False),
        ("0.01 deg", "0.01°", True),
        ("[{'yaw': '0.01 deg', 'at': '1 m'}]", "[{'yaw': '0.01°', 'at': '1000 mm'}]", True),
        ("[{'yaw': '0.01 deg', 'at': '1 m'}]", "[{'yaw': '0.02°', 'at': '1000 mm'}]", False),
        ("{'pixels': '2000 px', 'wavelength': '550 nm'}", "{'pixels': '2000 px', 'wavelength': '550.1 nm'}", False),
        ("5 %", "0.05", True),
        ("7 ppm/K", "7e-6 1/K", True),
        ("20 degC", "293.15 K", True),
    ],
)
def test_rounding_does_not_make_inputs_differ(one: str, other: str, alike: bool) -> None:
    found = compared(tree(), tree(), value=(one, other))
    assert (len(found.inputs), found.same_inputs) == ((0, 1) if alike else (1, 0))


def test_cameras_of_other_keys_and_the_same_title_are_told_apart() -> None:
    renamed = compared(tree(), tree(cameras={"near": "Near head", "b": "Far head"}))
    assert "Best camera: Near head (a) → Near head (near)" in " ".join(map(str, renamed.conclusions))
    notes = " ".join(renamed.notes)
    assert "not compared: Near head (a) (" in notes
    assert "not compared: Near head (near) (" in notes


def test_a_title_that_moves_to_another_camera_is_told_apart() -> None:
    moved = compared(tree(), tree(cameras={"a": "Middle head", "near": "Near head"}, propagation="exact"))
    assert "Best camera: Far head → Near head (near)" in " ".join(map(str, moved.conclusions))
    assert "not compared: Near head (near) (" in " ".join(moved.notes)
    assert "Near head / Middle head (a): linear calibration → exact calibration" in map(str, moved.models)


def test_keys_of_a_scene_are_no_cameras_and_parts_are_shown_whole() -> None:
    surface = "[{'shape': 'plane', 'distance': '0.6 m'}]"
    titled = tree(cameras={"rig": "Stereo 80 mm", "b": "Far head"})
    found = compared(titled, titled, scene__image__rig=("drawn", "as-designed"), scene__image__surfaces=("x", surface))
    assert [str(one) for one in found.inputs] == [
        "scene › image › rig: drawn → as-designed",
        f"scene › image › surfaces: x → {surface}",
    ]


def test_equivalent_inputs_do_not_differ_and_units_are_readable() -> None:
    found = compared(
        tree(),
        tree(),
        cameras__a__baseline=("0.075 m", "75mm"),
        cameras__a__lenses__focal_length=("2.65mm", "0.003 m"),
        accuracy__tolerance=("1 %", "0.05"),
        scene__distances__points=("40", "80"),
        cameras__a__depth__disparity_error=("derived", "0.1 px"),
        decision__between=("['a', 'b']", "['b', 'a']"),
        sweep__a__baseline=("['50mm', '0.1 m']", "not set"),
    )
    assert [str(one) for one in found.inputs] == [
        "focal length of the near head: 2.65 mm → 0.003 m",
        "accuracy › tolerance: 1 % → 0.05",
        "scene › distances › points: 40 → 80",
        "disparity error of the near head: derived → 0.1 px",
        "decision › between: Near head, Far head → Far head, Near head",
        "sweep › Near head › baseline: 50 mm, 0.1 m → not set",
    ]
    assert found.same_inputs == 1


def test_models_that_were_chosen_differently_are_named() -> None:
    lines = str(compared(tree(), tree(propagation="exact"))).splitlines()
    start = lines.index("Models chosen differently:")
    assert lines[start + 1] == "  Near head: linear calibration → exact calibration"


def test_equal_runs_have_no_changes() -> None:
    assert str(compared(tree(), tree(), a=("1 m", "1 m"))).splitlines() == [
        f"The answer stays “{SWITCH.format(1)}”.",
        "run0 → run1",
        REST,
        "Inputs that differ: none of 1",
        "Results that differ by more than their error: none of 2",
    ]


def test_a_run_compared_with_itself_is_unchanged() -> None:
    found = compare_runs(["x", "x"], [{"results_sha256": "1"}] * 2, [tree()] * 2)
    (note,) = found.notes
    assert "identical" in note
    assert found.labels == ("x (1)", "x (2)")


def test_other_studies_versions_and_cameras_are_reported() -> None:
    found = compare_runs(
        ["x", "y"],
        [{"study": "one", "code_hash": "1"}, {"study": "two", "code_hash": "2"}],
        [tree(), tree(cameras={"a": "Near head", "c": "Third head"})],
    )
    studies, versions, *alone = found.notes
    assert "different studies, one and two" in studies
    assert "versions of the program" in versions
    assert [one.rpartition(": ")[2] for one in alone] == ["Far head (x).", "Third head (y)."]
    assert str(found.conclusions[0]).startswith("Best camera: Far head → Third head from 1 to 10")


def test_runs_without_conclusions_say_so() -> None:
    empty = xr.DataTree.from_dict({"/hard_cases": xr.Dataset()})
    (sentence,) = compared(empty, empty).sentences()
    assert "no conclusions" in sentence
    assert compared(empty, empty).without_overlay.startswith("No figure: ")


def test_three_runs_are_reported_in_their_order() -> None:
    found = compared(tree(), tree(handover=2.0), tree(factor=2.0), a=("1 m", "2 m", "1 m"))
    answers = " to ".join(f"“{SWITCH.format(place)}”" for place in (1, 2, 1))
    assert str(found).splitlines()[:3] == [
        f"The answer changes from {answers}.",
        "run0 → run1 → run2",
        "Best camera: Far head → Near head → Far head from 1 to 2 m; otherwise unchanged.",
    ]
    assert found.inputs[0].values == ("1 m", "2 m", "1 m")
    assert (
        found.results[0].change.replace("\N{NO-BREAK SPACE}", " ") == "100 µm → 100 µm → 200 µm at 0.1 m (+0 %, +100 %)"
    )


def test_other_results_are_reported_with_distinct_places_and_the_largest_relevant_error() -> None:
    def optics(factor: float) -> xr.DataTree:
        error = {"units": "1", "ancillary_variables": "width_numerical"}
        data = {
            "width": (("element", "f_number"), factor * np.array([[1.0, 2.0], [3.0, 4.0]]), error),
            "width_numerical": (("element", "f_number", "window"), np.full((2, 2, 2), [0.0, 0.15]), {"units": "1"}),
        }
        coords = {"element": ["main lens", "microlens"], "f_number": [2.0, 4.0]}
        return xr.DataTree.from_dict({"/fresnel_validity": xr.Dataset(data, coords)})

    (line,) = compared(optics(1.0), optics(1.1)).results
    assert str(line) == "width (fresnel validity): 3 → 3.3 for element microlens, f-number 2 (+10 %)"
    assert compared(optics(1.0), optics(1.05)).results == ()  # 0.2 of at most 4, both known to 0.15


@pytest.mark.parametrize(
    ("group", "variable", "value", "others", "noise", "change"),
    [
        # A score of 0.5 whose criterion is 3 ± 0.03, and scores from 1 to 5: the error is 0.0075.
        ("criteria", "worth", [[0.5]], {"weighed_value": [[3.0]], "worth_error": [[0.0075]]}, 0.02, 0.06),
        # 3 ± 0.03, while the first design has another value
        ("criteria", "design_value", [[3.0]], {"weighed_value_error": [[9]], "design_value_error": [[0.03]]}, 0.1, 0.3),
        # 400 independent draws with a deviation of 2: 0.1
        ("calibration", "posterior_mean", [[9.0]], {"posterior_mean_error": [[0.1]]}, 0.5, 0.9),
        ("images", "power", [0.5], {"numerical_error": [0.5], "power_error": [0.01]}, 0.01, 0.02),
        ("images", "difference", [[0.2]], {"numerical_error": [0.5], "difference_error": [[0.01]]}, 0.01, 0.02),
        # 10 000 pixels of 0.0001: their norm is 0.01, which is known to 1 %.
        ("images", "chosen_image", np.full((100, 100), 1e-4), {"chosen_error": 0.01}, 1e-4, 2e-4),
        ("images", "image", np.full((1, 100, 100), 1e-4), {"numerical_error": [0.01]}, 1e-4, 2e-4),
        ("pictures", "map_depth", [[[1.0]]], {"depth_spread": [0.1], "map_depth_error": [[[0.5]]]}, 0.1, 0.2),
    ],
)  # fmt: skip
def test_a_change_counts_against_the_error_that_belongs_to_the_result(
    group: str, variable: str, value: Any, others: Mapping[str, Any], noise: float, change: float
) -> None:
    def reports(by: float) -> bool:
        changed = np.array(value, dtype=np.float64)
        changed.flat[0] += by
        groups = [dataset(group, {variable: values, **others}, {}) for values in (np.asarray(value), changed)]
        trees = [xr.DataTree.from_dict({f"/{group}": one}) for one in groups]
        found = compare_results([Run(name="", record={}, tree=tree) for tree in trees])
        assert found.within_error + len(found.moved) > 0
        return variable in {one.variable for one in found.moved}

    assert reports(change)
    assert not reports(noise)


def test_a_result_without_a_stored_error_is_not_compared() -> None:
    values = {"limit_f_number": np.full((1, 1, 1, 1, 1), 8.0), "psf_error": np.ones((1, 1, 1, 1, 1, 1))}
    data = dataset("fresnel_validity", values, {})
    trees = [xr.DataTree.from_dict({"/fresnel_validity": one}) for one in (data, data + 1.0)]
    found = compare_results([Run(name="", record={}, tree=tree) for tree in trees])
    assert found == Results(moved=(), within_error=0, apart=())


def test_one_run_cannot_be_compared() -> None:
    with pytest.raises(OutOfRangeError, match="at least 2"):
        compare_runs(["one"], [{}], [tree()])


def test_the_overlay_draws_each_run_in_its_line_style_and_names_the_cameras() -> None:
    overlay = compared(tree(), tree(factor=2.0), scene__wavelength=("1 m", "2 m")).overlay
    assert overlay is not None
    assert "solid, scene › wavelength: 1 m; and dashed, scene › wavelength: 2 m" in overlay.caption
    axes = overlay.draw().axes[0]
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    assert axes.get_title(loc="left").endswith("?")
    assert {"Near head", "Far head"} <= {text.get_text() for text in axes.texts}
    colored = [line for line in axes.lines if line.get_color() == "#D55E00"]  # of the second camera
    assert {line.get_linestyle() for line in colored} == {"-", "--"}
    drawn = {line.get_linestyle(): np.asarray(line.get_ydata(), dtype=float) for line in colored}
    np.testing.assert_allclose(drawn["--"], 2.0 * drawn["-"])
    np.testing.assert_allclose(drawn["-"], DISTANCE**2 / 100.0 * 1e3)  # in millimetres


def test_without_a_changed_curve_there_is_no_figure() -> None:
    found = compared(tree(), tree(handover=2.0))
    assert found.overlay is None
    assert found.without_overlay == "No figure: no curve of depth uncertainty differs by more than its error."
    assert found.without_overlay in found.html().decode()


def test_the_page_contacts_no_host_and_its_file_is_replaced_atomically(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = tradestudy.load(ROBOT).with_values({"scene.distances.points": 12, "trade_off": None})
    results = [one.run() for one in (study, study.with_values({"stereo-75mm.baseline": "40 mm"}))]
    for name, result in zip(("wide", "narrow"), results, strict=True):
        storage.write_finished(storage.encoded(result.data), result.run_record, tmp_path / name)
    page = tmp_path / "pages" / "compared.html"
    runs = [str(tmp_path / name) for name in ("wide", "narrow")]
    monkeypatch.setattr(api, "open_result", functools.cache(api.open_result))  # which takes longest, and twice the same
    done = CliRunner().invoke(app, ["compare", *runs, "--html", str(page)])
    assert done.exit_code == 0, done.output
    lines = done.stdout.splitlines()
    heads = ("75 mm stereo head", "50 mm stereo head")
    assert all(f"ake the {head}" in lines[0] for head in heads)
    assert lines[0].startswith("The answer changes from “")
    assert lines[1] == " → ".join(runs)
    assert lines[2:4] == [
        'Requirement "20 mm or better from 0.4 to 1 m": met if matching is as exact as the pictures allow, by 75 mm '
        "stereo head → met if matching is as exact as the pictures allow, by 50 mm stereo head.",
        "Best camera: 75 mm stereo head → 50 mm stereo head from 0.3 to 4 m.",
    ]
    assert "  baseline of the 75 mm stereo head: 75 mm → 40 mm" in lines
    assert lines[-1] == f"Page: {page}"
    text = page.read_text(encoding="utf-8")
    assert not re.findall(r"https?://|<script[^>]* src|<link|@import", text)
    assert text.count('<figure class="plot"') == 1
    same = compare_runs(runs, [one.run_record for one in results], [one.data for one in results])
    assert lines[0] == same.headline.replace("\N{NO-BREAK SPACE}", " ")
    plain = unescape(text).replace("\N{NO-BREAK SPACE}", " ")
    for sentence in (same.headline, *same.sentences()):
        assert sentence.replace("\N{NO-BREAK SPACE}", " ") in plain
    # A page that cannot be made leaves the old one.
    monkeypatch.setattr(Comparison, "html", lambda _: 1 / 0)
    assert CliRunner().invoke(app, ["compare", *runs, "--html", str(page)]).exit_code == 1
    assert page.read_text(encoding="utf-8") == text
    assert [one.name for one in page.parent.iterdir()] == [page.name]

"""Two runs side by side."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from tradestudy.comparison import compare_runs
from tradestudy.errors import OutOfRangeError


def tree(uncertainty: list[float], verdict: str) -> xr.DataTree:
    depth = xr.Dataset({"u": ("distance", np.array(uncertainty))}, coords={"distance": [0.5, 1.0, 2.0]})
    claims = xr.Dataset({"verdict": ("claim", np.array([verdict], dtype=object))}, coords={"claim": ["C1"]})
    return xr.DataTree.from_dict({"/depth": depth, "/claims": claims})


def record(baseline: str) -> dict[str, object]:
    return {"inputs": {"cameras.a.baseline": baseline, "scene.wavelength": "550 nm"}}


def test_inputs_and_results_that_differ_are_named_with_the_largest_move() -> None:
    found = compare_runs(
        ["one", "two"],
        [record("100 mm"), record("50 mm")],
        [tree([1.0, 4.0, np.inf], "met"), tree([1.0, 5.0, np.inf], "not met")],
    )
    assert [(d.what, d.values) for d in found.inputs] == [("cameras.a.baseline", ("100 mm", "50 mm"))]
    assert [(d.what, d.values) for d in found.results] == [
        ("claims/verdict at claim=C1", ("met", "not met")),
        ("depth/u", ("reference", "up to +25 % at distance=1")),
    ]


def test_equal_runs_have_nothing_to_tell() -> None:
    same = tree([1.0, np.nan, np.inf], "met")
    found = compare_runs(["one", "two"], [record("1 m")] * 2, [same, same])
    assert found.inputs == ()
    assert found.results == ()


def test_a_value_that_became_infinite_is_shown_and_a_missing_group_is_named() -> None:
    without = xr.DataTree.from_dict({"/depth": tree([1.0, np.inf, 3.0], "met")["depth"].to_dataset()})
    found = compare_runs(["one", "two"], [record("1 m")] * 2, [tree([1.0, 2.0, 3.0], "met"), without])
    assert [(d.what, d.values) for d in found.results] == [
        ("claims/verdict", ("present", "—")),
        ("depth/u", ("reference", "2 → inf at distance=1")),
    ]


def test_the_error_of_a_distance_is_a_stated_error() -> None:
    def crossing(error: float) -> xr.DataTree:
        at = {"crossover_distance": 0.4, "crossover_error": error, "rounding_error": error}
        return xr.DataTree.from_dict({"/decision": xr.Dataset({name: ("k", [value]) for name, value in at.items()})})

    found = compare_runs(["one", "two"], [record("1 m")] * 2, [crossing(0.1), crossing(0.2)])
    assert [(d.what, d.values[1]) for d in found.results] == [
        ("decision/rounding_error", "up to +100 % at k=0"),
        ("decision/stated numerical errors", "moved for 1 variable"),
    ]


def test_one_run_cannot_be_compared() -> None:
    with pytest.raises(OutOfRangeError, match="at least 2"):
        compare_runs(["one"], [{}], [tree([1.0, 2.0, 3.0], "met")])


def decided(best: list[str], usable: list[bool], why: str, error: float) -> xr.DataTree:
    """A study of four distances: best camera by two ways, flags by camera, a reason, a number and its stated error."""
    distance = [0.042, 0.0425, 0.043, 0.08]
    decision = xr.Dataset(
        {"best": (("distance", "way"), np.array([best, best], dtype=object).T)},
        coords={"distance": distance, "way": ["noise", "both"]},
    )
    depth = xr.Dataset(
        {
            "usable": (("camera", "distance"), np.array([usable, [True] * 4])),
            "u": ("distance", np.ones(4)),
            "u_error": ("distance", np.full(4, error)),
            "same": ("distance", np.arange(4.0)),
        },
        coords={"camera": ["a", "b"], "distance": distance},
    )
    effects = xr.Dataset({"why": ("model", np.array([why], dtype=object))}, coords={"model": ["blur"]})
    return xr.DataTree.from_dict({"/effects": effects, "/depth": depth, "/decision": decision})


def test_what_a_reader_asks_comes_first_grouped_and_the_rest_is_counted() -> None:
    one = decided(["a", "a", "b", "b"], [True] * 4, "changes at most 4.7 %", 1e-6)
    two = decided(["", "", "b", "a"], [False, False, True, True], "changes at most 7.9e-1 %", 3e-6)
    assert str(compare_runs(["x", "y"], [record("1 m"), record("2 m")], [one, two])).splitlines() == [
        "x → y",
        "Conclusions that changed: none",
        "Inputs that differ: 1, 1 other the same",
        "  cameras.a.baseline: 1 m → 2 m",
        "Results that moved: 3, 2 others the same",
        "  decision",
        "    best at distance=0.042 to 0.0425, way=both and way=noise: a → none",
        "    best at distance=0.08, way=both and way=noise: b → a",
        "  depth",
        "    usable: differs in 2 of 8 places, all at camera=a",
        "    stated numerical errors: moved for 1 variable",
        "  effects",
        "    why: other numbers in 1 place",
    ]


def test_a_neighbouring_change_of_another_kind_is_a_stretch_of_its_own() -> None:
    one = decided(["a", "a", "b", "b"], [True] * 4, "", 1.0)
    two = decided(["c", "b", "a", "b"], [True] * 4, "", 1.0)
    found = compare_runs(["x", "y"], [{}, {}], [one, two]).results
    assert [(d.what.removeprefix("decision/best at distance=").split(",")[0], d.values) for d in found] == [
        ("0.042", ("a", "c")),
        ("0.0425", ("a", "b")),
        ("0.043", ("b", "a")),
    ]


def test_many_changes_are_counted_after_the_first() -> None:
    def texts(end: str) -> xr.DataTree:
        table = xr.Dataset({"t": ("k", np.array([f"{letter} {end}" for letter in "abcdefghi"], dtype=object))})
        return xr.DataTree.from_dict({"/claims": table})

    found = compare_runs(["x", "y", "z"], [{}] * 3, [texts("old"), texts("new"), texts("old")])
    assert len(found.results) == 7
    assert found.results[-1].values == ("reference", "more changes in 3 places", "more changes in 3 places")
    assert (found.moved_results, found.same_results) == (1, 0)
    assert str(found).splitlines()[5:9] == ["    t at k=0", "      x: a old", "      y: a new", "      z: a old"]


@pytest.mark.parametrize(
    ("after", "text"),
    [(2.0, "up to +100 %"), (0.5, "up to -50 %"), (11.0, "up to +1000 %"), (178.0, "up to 178 times")],
)
def test_large_changes_are_factors(after: float, text: str) -> None:
    found = compare_runs(["x", "y"], [{}, {}], [tree([1.0, 1.0, 1.0], ""), tree([1.0, after, 1.0], "")])
    assert found.results[0].values == ("reference", f"{text} at distance=1")

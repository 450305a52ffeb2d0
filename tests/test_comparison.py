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


def test_one_run_cannot_be_compared() -> None:
    with pytest.raises(OutOfRangeError, match="at least 2"):
        compare_runs(["one"], [{}], [tree([1.0, 2.0, 3.0], "met")])

"""The comparison of two runs that are to be equal, on results small enough to see what it must find."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from tests.equivalence import RESULTS, Line, compare_results, main

Results = dict[str, xr.Dataset]


def results() -> Results:
    depth = xr.Dataset(
        {
            "depth_uncertainty": (("camera", "distance"), [[1e-3, 2e-3, np.inf], [np.nan, 4e-3, 5e-3]], {"units": "m"}),
            "depth_uncertainty_error": (("camera", "distance"), [[1e-9, 2e-9, np.nan], [np.nan, 4e-9, 5e-9]]),
            "near_limit": ("camera", np.array(["focus", "overlap"], dtype=object)),
            "draws": ("camera", [512, 1024]),
        },
        coords={"camera": ["one", "two"], "distance": [0.5, 1.0, 2.0]},
        attrs={"seed": 1},
    )
    calibration = xr.Dataset({"posterior_seconds": ((), 3.0), "mean": ((), 0.25)})
    return {"/": xr.Dataset(attrs={"study": "s", "code_hash": "a"}), "/depth": depth, "/calibration": calibration}


def failures(after: Results) -> list[str]:
    return [f"{line.group}: {what}" for line in compare_results("s", results(), after) for what in line.failures]


def with_values(name: str, change: Callable[[np.ndarray], None]) -> Results:
    changed = results()
    change(changed["/depth"][name].values)
    return changed


def moved(name: str, relative: float) -> Results:
    return with_values(name, lambda values: values.__setitem__((0, 1), values[0, 1] * (1.0 + relative)))


def found(lines: list[Line], group: str) -> Line:
    return next(line for line in lines if line.group == group)


def test_equal_runs_are_identical() -> None:
    line = found(compare_results("s", results(), results()), "/depth")
    assert (line.variables, line.identical, line.largest) == (6, 6, 0.0)
    assert not failures(results())


def test_wall_times_and_the_program_may_differ() -> None:
    after = results()
    after["/calibration"]["posterior_seconds"] = ((), 4.0)
    after["/"].attrs["code_hash"] = "b"
    assert not failures(after)
    assert found(compare_results("s", results(), after), "/calibration").variables == 1


def test_a_number_may_change_by_rounding_only() -> None:
    line = found(compare_results("s", results(), moved("depth_uncertainty", 5e-10)), "/depth")
    assert line.largest == pytest.approx(5e-10, rel=1e-5)
    assert (line.where, line.identical, line.failures) == ("depth_uncertainty at camera=one, distance=1.0", 5, [])
    (failure,) = failures(moved("depth_uncertainty", 2e-9))
    assert failure.startswith("/depth: depth_uncertainty at camera=one, distance=1.0: 0.002 → 0.002000000004, 2.0e-09;")


def test_a_difference_of_nearly_equal_numbers_moves_with_these() -> None:
    assert not failures(moved("depth_uncertainty_error", 1e-4))
    assert len(failures(moved("depth_uncertainty_error", 1e-2))) == 1


@pytest.mark.parametrize("value", [0.0, np.inf, -np.inf])
def test_a_nan_that_became_a_number_is_named(value: float) -> None:
    (failure,) = failures(with_values("depth_uncertainty", lambda values: values.__setitem__((1, 0), value)))
    assert failure.startswith(f"/depth: depth_uncertainty at camera=two, distance=0.5: nan → {value!r}, inf;")


def test_an_infinity_that_moved_is_named() -> None:
    (failure,) = failures(
        with_values("depth_uncertainty", lambda values: values[0].__setitem__([0, 2], [np.inf, 1e-3]))
    )
    assert failure.startswith("/depth: depth_uncertainty at camera=one, distance=0.5: 0.001 → inf, inf; 2 of 6")


def test_another_text_or_count_is_named() -> None:
    after = with_values("near_limit", lambda values: values.__setitem__(1, "focus"))
    (failure,) = failures(after)
    assert failure.startswith("/depth: near_limit at camera=two: 'overlap' → 'focus'")
    (failure,) = failures(with_values("draws", lambda values: values.__setitem__(0, 513)))
    assert failure.startswith("/depth: draws at camera=one: 512 → 513")


def test_missing_values_fail_and_additional_ones_are_new() -> None:
    fewer = results()
    fewer["/depth"] = fewer["/depth"].drop_vars("draws").sel(camera=["one"])
    del fewer["/calibration"]
    assert failures(fewer) == ["/depth: camera=two: vanished", "/depth: draws: vanished", "/calibration: vanished"]
    lines = compare_results("s", fewer, results())
    assert [(line.group, line.new) for line in lines if line.new] == [
        ("/depth", ["camera=two", "draws"]),
        ("/calibration", ["the group"]),
    ]
    assert not any(line.failures for line in lines)


def test_other_attributes_coordinates_and_shapes_are_named() -> None:
    after = results()
    after["/depth"].attrs["seed"] = 2
    after["/depth"]["depth_uncertainty"].attrs["units"] = "mm"
    after["/depth"]["draws"] = after["/depth"]["draws"].astype(float)
    after["/depth"] = after["/depth"].isel(distance=slice(2))
    found_there = failures(after)
    assert "/depth: group: attribute seed: 1 → 2" in found_there
    assert "/depth: depth_uncertainty: attribute units: 'm' → 'mm'" in found_there
    assert "/depth: draws: integer {'camera': 2} → float {'camera': 2}" in found_there
    assert "/depth: distance: float {'distance': 3} → float {'distance': 2}" in found_there
    shifted = results()
    shifted["/depth"] = shifted["/depth"].assign_coords(distance=[0.5, 1.0, 2.1])
    assert failures(shifted) == ["/depth: distance at distance=2.0: 2.0 → 2.1, 4.8e-02; 1 of 3 beyond the limit"]


def test_a_renamed_label_is_the_same_label() -> None:
    after = results()
    after["/depth"] = after["/depth"].assign_coords(camera=["one", "second"])
    table = {"/depth/camera": ("^two$", "second", "it is called so now")}
    assert not any(line.failures for line in compare_results("s", results(), after, table))
    assert failures(after) == ["/depth: camera=two: vanished"]


@pytest.mark.parametrize(("relative", "status"), [(0.0, 0), (2e-9, 1)])
def test_the_command_prints_a_table_and_fails_where_numbers_moved(
    relative: float,
    status: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    for side, groups in (("before", results()), ("after", moved("depth_uncertainty", relative))):
        (tmp_path / side / "s").mkdir(parents=True)
        xr.DataTree.from_dict(groups).to_netcdf(tmp_path / side / "s" / RESULTS, engine="h5netcdf")
    monkeypatch.setattr(sys, "argv", ["equivalence", str(tmp_path / "before"), str(tmp_path / "after")])
    with pytest.raises(SystemExit) as ended:
        main()
    shown = capsys.readouterr().out
    assert int(ended.value.code or 0) == status
    assert "| study | group | variables |" in shown
    assert f"Failures: {status or 'none'}" in shown

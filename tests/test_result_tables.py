"""Results as data frames, held against the CSV files of the same names."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import tradestudy
from tradestudy import api
from tradestudy.errors import OutOfRangeError
from tradestudy.report import csv_tables
from tradestudy.result import Result

EXAMPLE = Path(__file__).parents[1] / "reports" / "examples" / "plenoptic-vs-stereo"


@pytest.fixture(scope="module")
def example() -> Result:
    return tradestudy.open_result(EXAMPLE)


def test_names_the_tables_of_the_report(example: Result) -> None:
    names = example.table_names
    assert sorted(names) == sorted(path.stem for path in (EXAMPLE / "tables").glob("*.csv"))


@pytest.mark.parametrize(
    "name", ["depth_by_camera_distance_error_source", "claims_by_claim_reading", "cameras_by_property"]
)
def test_holds_what_the_csv_file_holds(example: Result, name: str) -> None:
    frame = example.table(name)
    written = pd.read_csv(EXAMPLE / "tables" / f"{name}.csv")
    flat = frame.reset_index() if frame.index.names != [None] else frame.rename_axis("property").reset_index()
    units = [frame.attrs["units"].get(column, "") for column in flat.columns]
    for column, unit in zip(flat.columns, units, strict=True):
        title = next(one for one in written.columns if one.partition(" [")[0] == column)
        assert not unit or title == f"{column} [{unit}]"
        if flat[column].dtype.kind in "fiub":
            np.testing.assert_array_equal(flat[column], written[title])
        else:
            assert list(flat[column].astype(str)) == [str(one).removeprefix("'") for one in written[title].fillna("")]


def test_a_single_value_is_a_table_of_one_row() -> None:
    group = xr.Dataset({"alone": ((), 2.0, {"units": "m"})})
    frame = Result(data=xr.DataTree.from_dict({"/g": group}), run_record={}).table("g")
    pd.testing.assert_frame_equal(frame, pd.read_csv(io.StringIO("alone\n2.0")))
    assert frame.attrs["units"] == {"alone": "m"}


def test_refuses_a_name_that_it_does_not_have(example: Result) -> None:
    with pytest.raises(OutOfRangeError, match="depth_by_camera_distance") as reported:
        example.table("depth")
    assert reported.value.value == "depth"


def test_a_sweep_keeps_the_names_of_tables() -> None:
    uncertainty = np.array([[1e-3, 2e-3, 3e-3]])
    coordinates = {"camera": ["rig"], "distance": [0.5, 1.0, 2.0]}
    one = xr.Dataset({"depth_uncertainty": (("camera", "distance"), uncertainty, {"units": "m"})}, coordinates)
    baseline = ("baseline", [0.05, 0.1], {"path": "rig.baseline"})
    swept = one.expand_dims(baseline=2).assign_coords(baseline=baseline)
    requirements = xr.Dataset(
        {"met": ("requirement", [1]), "design_met": (("baseline", "requirement"), [[1], [0]])},
        {"requirement": ["near"], "baseline": baseline},
    )
    plain = Result(data=xr.DataTree.from_dict({"/depth": one}), run_record={})
    result = Result(data=xr.DataTree.from_dict({"/depth": swept, "/requirements": requirements}), run_record={})
    assert plain.table_names == ["depth_by_camera_distance"]
    assert sorted(result.table_names) == [
        "depth_by_camera_distance",
        "requirements_by_baseline_requirement",
        "requirements_by_requirement",
    ]
    for found in (plain, result):
        frame = found.table("depth_by_camera_distance")
        assert frame.attrs["units"] == {"depth_uncertainty": "m"}
    written = pd.read_csv(io.BytesIO(b"".join(csv_tables.tables(result.data)["depth_by_camera_distance.csv"])))
    assert len(written) == 3  # the same in both designs


def _swept(rig: np.ndarray, other: np.ndarray) -> xr.DataTree:
    """A table over a sweep of two parameters of the rig, with another camera that no design changes."""
    values = np.stack([rig, np.broadcast_to(other, rig.shape)], axis=2)
    dims = ("baseline", "focal_length", "camera", "distance")
    coordinates = {
        "baseline": ("baseline", np.arange(rig.shape[0]) / 10, {"path": "rig.baseline"}),
        "focal_length": ("focal_length", np.arange(rig.shape[1]) / 100, {"path": "rig.lenses.focal_length"}),
        "camera": ["rig", "other"],
        "distance": np.arange(rig.shape[2]) + 0.5,
    }
    return xr.DataTree.from_dict({"/depth": xr.Dataset({"disparity_px": (dims, values)}, coordinates)})


def test_a_camera_that_no_design_changes_is_written_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(csv_tables, "_ROWS", 7)  # pieces that end within a design
    rig = np.random.default_rng(1).random((4, 3, 5))
    tree = _swept(rig, np.array([np.nan, -0.0, 1.0, np.inf, 2.0]))
    (pieces,) = csv_tables.tables(tree).values()
    written = pd.read_csv(io.BytesIO(b"".join(pieces)))
    other = written[written["camera"] == "other"]
    assert other[["baseline", "focal_length"]].isna().all(axis=None)
    np.testing.assert_array_equal(other["disparity_px"], [np.nan, -0.0, 1.0, np.inf, 2.0])
    own = written[written["camera"] == "rig"].set_index(["baseline", "focal_length", "distance"])
    frame = tradestudy.Result(data=tree, run_record={}).table("depth_by_camera_distance")
    pd.testing.assert_series_equal(own["disparity_px"], frame.xs("rig", level="camera")["disparity_px"])
    np.testing.assert_array_equal(own["disparity_px"], rig.ravel())


def test_large_tables_are_written_only_on_request(monkeypatch: pytest.MonkeyPatch) -> None:
    tree = _swept(np.random.default_rng(1).random((40, 30, 20)), np.zeros(20))
    (pieces,) = csv_tables.tables(tree).values()
    size = len(b"".join(pieces))
    assert csv_tables.large_tables(tree) == {}
    monkeypatch.setattr(csv_tables, "LARGE", 0.9 * size)
    assert csv_tables.large_tables(tree) == {"depth_by_camera_distance.csv": pytest.approx(size, rel=0.03)}
    assert not csv_tables.tables(tree, large=False)
    (line,) = api.tables_left_out(Result(data=tree, run_record={}))
    assert line.endswith("written only with --large-tables: depth_by_camera_distance.csv (880 kB)")
    assert csv_tables.tables(tree).keys() == {"depth_by_camera_distance.csv"}


def test_small_tables_are_not_estimated(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(csv_tables, "_size", lambda _table: pytest.fail("a table of few cells was estimated"))
    assert csv_tables.large_tables(_swept(np.zeros((2, 3, 4)), np.zeros(4))) == {}

"""Results as data frames, held against the CSV files of the same names."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import tradestudy
from tradestudy.errors import OutOfRangeError
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

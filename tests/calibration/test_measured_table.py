"""Tables of measured depth errors: units, derived values, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tradestudy.calibration.measured_table import MeasuredTable, read_measurements
from tradestudy.errors import OutOfRangeError


def _read(folder: Path, text: str) -> MeasuredTable:
    path = folder / "wall.csv"
    path.write_text(text, encoding="utf-8")
    return read_measurements(path)


def test_units_percent_empty_cells_and_comments(tmp_path: Path) -> None:
    table = _read(
        tmp_path,
        "# a wall\ndistance [cm], sigma [%], bias (mm), valid [%], note\n100,1,-2,99,near\n200,,3,,\n\n300,2,4,50,\n",
    )
    assert table.distance == pytest.approx([1.0, 2.0, 3.0])
    np.testing.assert_allclose(table.sigma, [0.01, np.nan, 0.06])
    assert table.bias == pytest.approx([-0.002, 0.003, 0.004])
    np.testing.assert_allclose(table.valid, [0.99, np.nan, 0.5])
    assert table.lines == (3, 4, 6)
    assert table.spread == "sigma"


def test_rms_and_bias_give_the_standard_deviation(tmp_path: Path) -> None:
    table = _read(tmp_path, "distance [m],rms [mm],bias [mm]\n1,5,3\n2,13,-5\n3,10,6\n")
    assert table.sigma == pytest.approx([0.004, 0.012, 0.008])


ROWS = "1,1\n2,4\n3,9\n"
WRONG = {
    "": "is empty",
    f"distance,sigma [mm]\n{ROWS}": "column without a unit.*'distance'.*write, for example, 'distance \\[mm\\]'",
    f"distance [m],sigma\n{ROWS}": "column without a unit",
    f"distance [m],deviation [mm]\n{ROWS}": "column of an unknown name",
    f"distance [m],sigma [kg]\n{ROWS}": "column sigma: .*a length",
    f"distance [%],sigma [mm]\n{ROWS}": "column distance",
    f"distance [m],distance [m]\n{ROWS}": "column twice",
    f"sigma [m],rms [m]\n{ROWS}": "no column of the distance",
    f"distance [m],note\n{ROWS}": "no column of the measured quantity",
    "distance [m],sigma [mm]\n1,1\n2,4\n": "too few rows.*2.*two points fit every law",
    "distance [m],sigma [mm]\n1,5,1\n2,4\n3,9\n": "line 2: the row has another number of cells.*decimal commas",
    'distance [m],sigma [mm]\n"1,5",1\n2,4\n3,9\n': "line 2, column distance: this is not a number.*decimal commas",
    "distance [m],sigma [mm]\n1,nan\n2,4\n3,9\n": "this is not a number",
    "distance [m],sigma [mm]\n1,1\n2,-4\n3,9\n": "line 3: sigma must be above 0",
    "distance [m],sigma [m]\n1,0.1\n2,2\n3,0.9\n": "line 3: sigma must be below the distance",
    "distance [m],sigma [mm]\n1,1\n1,2\n2,4\n2,5\n": "too few distances: 2.*two points fit every law",
    "distance [m],sigma [mm]\n0,1\n2,4\n3,9\n": "the distance must be above 0",
    "distance [m],sigma [mm]\n,1\n2,4\n3,9\n": "the distance must be above 0",
    "distance [m],valid [%]\n1,101\n2,4\n3,9\n": "valid share must lie between",
    "distance [m],sigma [mm],rms [mm],bias [mm]\n1,3,5,4\n2,3,5,4\n3,3,6,4\n": "line 4: RMS² must be",
    "distance [m],rms [mm],bias [mm]\n1,3,-4\n2,3,1\n3,3,2\n": "line 2: rms must not be smaller",
    "distance [m];sigma [mm]\n1;1\n2;4\n3;9\n": "separates columns by semicolons",
    "distance [m]\tsigma [mm]\n1\t1\n2\t4\n3\t9\n": "separates columns by tabs",
    "distance [m],sigma [m]\n1,1e-320\n2,4\n3,9\n": "line 2, column sigma: no measurement gives this value: 1e-320",
    "distance [km],sigma [m]\n1,1\n2,4\n1e29,9\n": "line 4, column distance: no measurement gives this value",
    "distance [m],bias [m]\n1,0\n2,-2\n3,0\n": "line 3: the bias must be above −distance",
    'distance [m],sigma [m]\n1,"1\n2,4\n3,9\n': "not CSV",
    "distance [m],absolute_error [mm],bias [mm]\n1,3,-4\n2,3,1\n3,3,2\n": "must not be smaller than the magnitude",
}


@pytest.mark.parametrize("text", WRONG)
def test_wrong_tables_are_refused_with_their_place(tmp_path: Path, text: str) -> None:
    with pytest.raises(OutOfRangeError, match=f"(?s){WRONG[text]}"):
        _read(tmp_path, text)


def test_a_file_that_is_no_table_is_refused(tmp_path: Path) -> None:
    with pytest.raises(OutOfRangeError, match="cannot be read"):
        read_measurements(tmp_path / "none.csv")


def test_a_file_of_gigabytes_is_refused_without_reading_it(tmp_path: Path) -> None:
    with (tmp_path / "big.csv").open("wb") as file:
        file.truncate(3_000_000_000)
    with pytest.raises(OutOfRangeError, match="3e\\+03 MB"):
        read_measurements(tmp_path / "big.csv")

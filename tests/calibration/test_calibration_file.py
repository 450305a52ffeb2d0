"""Calibrations from files: bit for bit there and back, read by other programs' conventions, mistakes named."""

import numpy as np
import pytest
import xarray

from tests.calibration.calibration_files import write_calibration
from tradestudy.calibration.calibration_file import (
    CalibrationCovariance,
    CalibrationDraws,
    CalibrationFileError,
    read_calibration,
)

NAMES = ("baseline", "relative_rotation_y", "left_principal_point_x_px")
RNG = np.random.default_rng(0)
DRAWS = CalibrationDraws(names=NAMES, draws=RNG.standard_normal((150, 3)) * [1e-3, 3e-3, 10.0] + [0.1, 0.0, 512.0])
COVARIANCE = CalibrationCovariance(names=NAMES, mean=DRAWS.draws.mean(axis=0), covariance=np.cov(DRAWS.draws.T))


@pytest.mark.parametrize("suffix", ["csv", "nc"])
def test_draws_and_covariances_read_back_bit_for_bit(tmp_path, suffix):
    path = tmp_path / f"calibration.{suffix}"
    write_calibration(path, DRAWS)
    found = read_calibration(path)
    assert isinstance(found, CalibrationDraws)
    assert found.names == NAMES
    np.testing.assert_array_equal(found.draws, DRAWS.draws)
    write_calibration(path, COVARIANCE)
    found = read_calibration(path)
    assert isinstance(found, CalibrationCovariance)
    np.testing.assert_array_equal(found.mean, COVARIANCE.mean)
    np.testing.assert_array_equal(found.covariance, COVARIANCE.covariance)


HEAD = "parameter,mean,a,b\n"


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("", "is empty"),
        ("a,b\n", "is empty"),
        ("a,b\n1,2\n3\n", r"csv:3 .*: 1 cells .allowed: 2\)"),
        ("a,b\n1,two\n", "'two'"),
        ("a,a\n" + "1,2\n" * 120, r"a .allowed: each exactly once"),
        ("a,b\n" + "1,2\n" * 99, "too few draws.*99"),
        ("a,b\n1,0\n0,2\n", "the first line parameter,mean,NAME"),
        ("a;b\n" + "1,5;2,25\n" * 120, "semicolons separate the columns: a;b .*save it as CSV with commas"),
        ("a\tb\n" + "1.5\t2.25\n" * 120, "tabs separate the columns"),
        ("a,b\n" + "1,nan\n" * 120, "120 cells.*finite"),
        (HEAD + "b,0,1,0\na,0,0,1\n", r"b, a .allowed: a, b"),
        (HEAD + "a,0,1,0.5\nb,0,0.4,1\n", "not symmetric"),
        (HEAD + "a,0,1,1.5\nb,0,1.5,1\n", "not positive semidefinite: eigenvalue -5.00e-01"),
        (HEAD + "a,0,-1,0\nb,0,0,1\n", r"variance of a .*: -1 .allowed: >= 0"),
        (HEAD + "a,inf,1,0\nb,0,0,1\n", "1 cells.*finite"),
        (HEAD + "a,0,0,0\nb,0,0,0\n", "is zero.*leave the posterior out"),
    ],
)
def test_mistakes_are_named(tmp_path, text, word):
    path = tmp_path / "calibration.csv"
    path.write_text(text)
    with pytest.raises(CalibrationFileError, match=word) as caught:
        read_calibration(path)
    assert caught.value.remedy


def test_the_mark_with_which_spreadsheets_begin_a_file_is_no_part_of_a_name(tmp_path):
    path = tmp_path / "calibration.csv"
    path.write_text("\ufeffa,b\n" + "1,2\n3,5\n" * 60, encoding="utf-8")
    assert read_calibration(path).names == ("a", "b")


def test_a_perfectly_known_parameter_is_allowed(tmp_path):
    path = tmp_path / "calibration.csv"
    path.write_text(HEAD + "a,1,0,0\nb,2,0,4\n")
    found = read_calibration(path)
    np.testing.assert_array_equal(found.covariance, [[0, 0], [0, 4]])


def test_foreign_files_are_named(tmp_path):
    path = tmp_path / "other.nc"
    xarray.Dataset({"temperature": ("x", [1.0])}).to_netcdf(path, engine="h5netcdf")
    with pytest.raises(CalibrationFileError, match=r"other\.nc .*: temperature"):
        read_calibration(path)
    data = xarray.Dataset({"covariance": (("parameter", "other"), np.eye(1))}, coords={"parameter": ["a"]})
    data.to_netcdf(path, engine="h5netcdf")
    with pytest.raises(CalibrationFileError, match="without its mean"):
        read_calibration(path)
    with pytest.raises(CalibrationFileError, match=r": \.txt .allowed: \.csv, \.nc"):
        read_calibration(tmp_path / "calibration.txt")


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("none.csv", None, "none.csv cannot be read: No such file"),
        ("none.nc", None, "none.nc cannot be read: No such file"),
        ("noise.csv", b"\xff\xfe\x00", "noise.csv .*: not a .csv file"),
        ("noise.nc", b"not netCDF", "noise.nc .*: not a .nc file"),
        ("noise.txt", b"a", r": .txt \(allowed: .csv, .nc\)"),
    ],
)
def test_files_that_cannot_be_read_are_named(tmp_path, name, content, words):
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(CalibrationFileError, match=words):
        read_calibration(path)


def test_packed_values_are_refused_by_name(tmp_path):
    """Reading them as they are stored would scale every error by the factor."""
    draws = xarray.DataArray(np.random.default_rng(0).normal(0.0, 2e-4, (200, 1)), dims=("draw", "parameter"))
    data = xarray.Dataset({"draws": draws}, {"parameter": ["yaw"]})
    packing = {"draws": {"dtype": "int32", "scale_factor": 1e-7, "_FillValue": -(2**31)}}
    data.to_netcdf(tmp_path / "packed.nc", engine="h5netcdf", encoding=packing)
    with pytest.raises(CalibrationFileError, match=r"packed\.nc has packed values: draws\.scale_factor"):
        read_calibration(tmp_path / "packed.nc")
    data.to_netcdf(tmp_path / "plain.nc", engine="h5netcdf")
    assert read_calibration(tmp_path / "plain.nc").draws == pytest.approx(draws.values)


def test_hdf5_without_dimensions_is_named(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "plain.nc", "w") as file:
        file["parameter"] = np.array([b"yaw"])
        file["draws"] = np.zeros((200, 1))
    with pytest.raises(CalibrationFileError, match=r"plain\.nc cannot be read: not a \.nc file"):
        read_calibration(tmp_path / "plain.nc")

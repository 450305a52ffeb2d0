"""Files of calibrations, as another program would write them."""

from __future__ import annotations

import csv
from pathlib import Path

import xarray as xr

from tradestudy.calibration.calibration_file import CalibrationCovariance, CalibrationDraws


def write_calibration(path: Path, calibration: CalibrationCovariance | CalibrationDraws) -> None:
    """Write a calibration with all its digits, as CSV or NetCDF by the suffix of the path."""
    names = list(calibration.names)
    if path.suffix == ".nc":
        data = (
            {"draws": (("draw", "parameter"), calibration.draws)}
            if isinstance(calibration, CalibrationDraws)
            else {
                "mean": ("parameter", calibration.mean),
                "covariance": (("parameter", "parameter_"), calibration.covariance),
            }
        )
        xr.Dataset(data, coords={"parameter": names}).to_netcdf(path, engine="h5netcdf")
        return
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        if isinstance(calibration, CalibrationDraws):
            writer.writerows([names, *calibration.draws.tolist()])
            return
        writer.writerow(["parameter", "mean", *names])
        columns = names, calibration.mean.tolist(), calibration.covariance.tolist()
        writer.writerows([name, mean, *row] for name, mean, row in zip(*columns, strict=True))

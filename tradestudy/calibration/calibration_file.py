"""Calibrations in CSV or NetCDF files: a covariance or joint draws.

CSV with draws: the first line names the parameters, and every other line is one joint draw. CSV with a covariance: the
first line is ``parameter,mean,NAME,NAME…``, then one line per parameter with its name, its mean and its row of the
covariance. NetCDF: ``draws(draw, parameter)``, or ``mean(parameter)`` and ``covariance(parameter, parameter_)``, with
the names in a text variable ``parameter``. With draws, ``reference(parameter)`` may give the values at which the errors
are zero. Numbers are in SI units, and in pixels where the name ends in ``_px``; ``units`` or ``unit``, a
variable or an attribute of a variable or of the file, may say so. Numbers that ``_FillValue`` or ``missing_value``
marks as missing, and another variable over draws, such as weights, are refused. The posterior of a rig calibrated from
corners also has ``best(parameter)`` and ``pixels(side)``, and the attribute ``lens_model`` unless its lenses are
pinholes with k1 and k2.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from tradestudy.calibration.projection import RADIAL_LENS, FreeLens, lens_of_text
from tradestudy.errors import OutOfRangeError, TradestudyError
from tradestudy.optics.arrays import FloatArray
from tradestudy.provenance import require_regular_file

MINIMUM_DRAWS = 100  # fewer cannot determine a 95 % interval
_UNITS: Final = ("unit", "units")
_NUMBERS: Final = ("draws", "reference", "best", "mean", "covariance")
_HAS_UNITS: Final = ("parameter", *_NUMBERS)
_READ_WITH_DRAWS: Final = ("parameter", "draws", "reference", "best", "pixels", *_UNITS)
_READ_WITH_COVARIANCE: Final = ("parameter", "mean", "covariance", *_UNITS)
_MISSING: Final = ("_FillValue", "missing_value")  # attributes of a variable
_NOT_NUMBERS: Final = ("Conventions", "history", "coordinates")
"""Attributes that describe the file, not its numbers."""
_SYMMETRY_LIMIT = 1e-9  # relative
_NEGATIVE_LIMIT = 1e-10  # of the largest eigenvalue of the correlation matrix: the rounding of numbers in a file


class CalibrationFileError(TradestudyError):
    """A calibration file is unreadable or inconsistent."""

    exit_status = 2


@dataclass(frozen=True, kw_only=True, eq=False)
class CalibrationCovariance:
    """A calibration as mean and covariance.

    Parameters
    ----------
    names : tuple of str, length P
        Names of the parameters.
    mean : array (P,)
        Best values.
    covariance : array (P, P)
        Their covariance, symmetric and positive semidefinite.
    stated_units : tuple of (variable, parameter, unit)
        Units that the file states.
    unread : tuple of str
        What the file contains besides.
    """

    names: tuple[str, ...]
    mean: FloatArray
    covariance: FloatArray
    stated_units: tuple[tuple[str, str, str], ...] = ()
    unread: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class CalibrationDraws:
    """A calibration as joint draws.

    Parameters
    ----------
    names : tuple of str, length P
        Names of the parameters.
    draws : array (K, P)
        Joint draws.
    reference : array (P,), optional
        Values at which the errors are zero; None if the file does not say.
    best : array (P,), optional
        Best parameters of a rig that is calibrated from corners, with which it measures depth.
    pixels : tuple of int, optional
        Columns and rows of the rig's pictures.
    lens
        Lens model of both cameras of the rig.
    stated_units, unread
        As in `CalibrationCovariance`.
    """

    names: tuple[str, ...]
    draws: FloatArray
    reference: FloatArray | None = None
    best: FloatArray | None = None
    pixels: tuple[int, int] | None = None
    lens: FreeLens = RADIAL_LENS
    stated_units: tuple[tuple[str, str, str], ...] = ()
    unread: tuple[str, ...] = ()


def read_calibration(path: str | Path) -> CalibrationCovariance | CalibrationDraws:
    """Read draws or a covariance from a file whose suffix (.csv, .nc) gives the format.

    Parameters
    ----------
    path : path
        The file.

    Returns
    -------
    CalibrationCovariance or CalibrationDraws
        Names are unique, numbers finite, a covariance is symmetric and positive semidefinite, and draws suffice.

    Raises
    ------
    CalibrationFileError
        The file cannot be read, or fails one of these checks.
    """
    path = Path(path)
    if path.suffix not in _READERS:
        raise CalibrationFileError(
            f"{path.name} has an unknown format",
            value=path.suffix or "no suffix",
            limit=", ".join(_READERS),
            remedy="rename or convert it",
        )
    try:
        require_regular_file(path)
        path.open("rb").close()  # raises with the message of the operating system
        calibration = _READERS[path.suffix](path)
    except (OSError, ValueError, KeyError) as error:
        raise CalibrationFileError(
            f"{path.name} cannot be read",
            value=getattr(error, "strerror", None) or f"not a {path.suffix} file",
            remedy="check its path and the program that wrote it",
        ) from None
    repeated = sorted({name for name in calibration.names if calibration.names.count(name) > 1 or not name})
    if repeated:
        raise CalibrationFileError(
            f"{path.name} has unnamed parameters, or gives one name to several",
            value=", ".join(repeated) or "''",
            limit="each exactly once",
            remedy="rename the columns",
        )
    if isinstance(calibration, CalibrationDraws):
        _check_finite(
            path,
            calibration.draws,
            *(table for table in (calibration.best, calibration.reference) if table is not None),
        )
        if (
            calibration.draws.ndim != 2
            or calibration.draws.shape[1] != len(calibration.names)
            or len(calibration.draws) < MINIMUM_DRAWS
        ):
            raise CalibrationFileError(
                f"{path.name} contains too few draws, or draws of the wrong shape",
                value=" × ".join(map(str, calibration.draws.shape)),
                limit=f">= {MINIMUM_DRAWS} draws of {len(calibration.names)} parameters",
                remedy="write one joint draw per row; for fewer draws, give their covariance instead, in a CSV file "
                "with the first line parameter,mean,NAME,…",
            )
        return calibration
    _check_finite(path, calibration.covariance, calibration.mean)
    return replace(calibration, covariance=_checked_covariance(path, calibration.names, calibration.covariance))


def _read_csv(path: Path) -> CalibrationCovariance | CalibrationDraws:
    """Draws or a covariance, depending on the first line."""
    with path.open(newline="", encoding="utf-8-sig") as stream:
        lines = [[cell.strip() for cell in line] for line in csv.reader(stream) if line]
    if len(lines) < 2:
        raise CalibrationFileError(
            f"{path.name} is empty", value=f"{len(lines)} lines", limit=">= 2", remedy="write a header and numbers"
        )
    header, rows = lines[0], lines[1:]
    for separator, plural in ((";", "semicolons"), ("\t", "tabs")):
        if separator in header[0]:
            raise CalibrationFileError(
                f"{path.name}: {plural} separate the columns",
                value=header[0][:40],
                limit="commas, and decimal points in the numbers",
                remedy="save it as CSV with commas",
            )
    for number, row in enumerate(rows, start=2):
        if len(row) != len(header):
            raise CalibrationFileError(
                f"{path.name}:{number} does not have as many cells as the header",
                value=f"{len(row)} cells",
                limit=str(len(header)),
                remedy="complete the line",
            )
    if header[:2] != ["parameter", "mean"]:
        return CalibrationDraws(names=tuple(header), draws=_numbers(path, rows))
    names = tuple(header[2:])
    if tuple(row[0] for row in rows) != names:
        raise CalibrationFileError(
            f"{path.name} has different names in the rows and columns of the covariance",
            value=", ".join(row[0] for row in rows),
            limit=", ".join(names),
            remedy="list the parameters in the same order in rows and columns",
        )
    table = _numbers(path, [row[1:] for row in rows])
    return CalibrationCovariance(names=names, mean=table[:, 0], covariance=table[:, 1:])


def _numbers(path: Path, rows: list[list[str]]) -> FloatArray:
    """Convert cells to numbers."""
    try:
        return np.array(rows, dtype=np.float64)
    except ValueError as error:
        raise CalibrationFileError(
            f"{path.name} contains a cell that is not a number",
            value=str(error),
            limit="numbers in SI units",
            remedy="remove units and text",
        ) from error


def _read_netcdf(path: Path) -> CalibrationCovariance | CalibrationDraws:
    """Draws or a covariance, depending on the variables."""
    import h5netcdf

    with h5netcdf.File(path, "r") as file:
        if "parameter" not in file.variables or not ({"draws", "covariance"} & set(file.variables)):
            raise CalibrationFileError(
                f"{path.name} contains no calibration",
                value=", ".join(file.variables) or "no variables",
                limit="variables named parameter and draws, or parameter, mean and covariance",
                remedy="rename the variables",
            )
        names = _texts(file.variables["parameter"][...])
        packed = [
            f"{variable}.{key}"
            for variable, values in file.variables.items()
            for key in ("scale_factor", "add_offset")
            if key in values.attrs
        ]
        if packed:
            raise CalibrationFileError(
                f"{path.name} has packed values",
                value=", ".join(packed),
                limit="values as they are, in SI units",
                remedy="write it without packing (encoding) in xarray or netCDF4",
            )
        used = _READ_WITH_DRAWS if "draws" in file.variables else _READ_WITH_COVARIANCE
        unused = [name for name in file.variables if name not in (*used, *file.dimensions)]
        variables = {name: values for name, values in file.variables.items() if name in used}
        units = _stated_units(names, variables, file.attrs)
        attributes = _unread_attributes(variables, file.attrs, has_lens="best" in variables)
        _refuse_missing(path, {name: variables[name] for name in _NUMBERS if name in variables})
        if "draws" in file.variables:
            _require_equal_draws(path, {name: file.variables[name] for name in unused}, file.variables["draws"].shape)
            draws = _netcdf_draws(names, file.variables, str(file.attrs.get("lens_model", "")))
            return replace(draws, stated_units=units, unread=(*unused, *attributes, *file.groups))
        if "mean" not in file.variables:
            raise CalibrationFileError(
                f"{path.name} has a covariance without its mean",
                value=", ".join(file.variables),
                limit="mean(parameter)",
                remedy="add the best values",
            )
        mean = np.asarray(file.variables["mean"][...], dtype=np.float64)
        covariance = np.asarray(file.variables["covariance"][...], dtype=np.float64)
        unread = (*unused, *attributes, *file.groups)
        return CalibrationCovariance(names=names, mean=mean, covariance=covariance, stated_units=units, unread=unread)


def _texts(values: Any) -> tuple[str, ...]:
    """Text of a variable or of an attribute, also as a table of characters, as xarray writes bytes."""
    table = np.asarray(values)
    rows = [b"".join(row) for row in table] if table.dtype == "S1" and table.ndim == 2 else table.ravel()
    return tuple(text.decode() if isinstance(text, bytes) else str(text) for text in rows)


def _stated_units(
    names: tuple[str, ...], variables: Mapping[str, Any], attributes: Mapping[str, Any]
) -> tuple[tuple[str, str, str], ...]:
    """Variable, parameter and unit, of every unit that variables, their attributes or those of the file state."""
    statements = [(key, _texts(variables[key][...])) for key in _UNITS if key in variables]
    owners = {"": attributes} | {name: values.attrs for name, values in variables.items() if name in _HAS_UNITS}
    for owner, attrs in owners.items():
        for key in _UNITS:
            if key in attrs:
                stated = tuple(unit.strip() for unit in ",".join(_texts(attrs[key])).split(","))
                statements.append((owner or key, stated))
    rows: list[tuple[str, str, str]] = []
    for variable, stated in statements:
        # One for all, or a list that does not match the parameters and hence is the unit of none.
        units = stated if len(stated) == len(names) else (", ".join(stated),) * len(names)
        rows += [(variable, name, unit) for name, unit in zip(names, units, strict=True)]
    return tuple(rows)


def _unread_attributes(variables: Mapping[str, Any], attributes: Mapping[str, Any], *, has_lens: bool) -> list[str]:
    """Attributes of the file and, after a point, of the variables read, that may describe numbers and are not used."""
    used = (*_UNITS, *_NOT_NUMBERS, *(["lens_model"] if has_lens else []))
    unread = [key for key in attributes if key not in used]
    for variable, values in variables.items():
        used = (*_NOT_NUMBERS, *((*_UNITS, *_MISSING) if variable in _HAS_UNITS else ()))
        unread += [f"{variable}.{key}" for key in values.attrs if key not in used]
    return unread


def _refuse_missing(path: Path, variables: Mapping[str, Any]) -> None:
    """Refuse numbers that an attribute of their variable marks as missing."""
    for variable, values in variables.items():
        for key in _MISSING:
            if key not in values.attrs:
                continue
            marks = np.asarray(values.attrs[key]).astype(np.float64).ravel()
            # One of the two may have been written in single precision.
            numbers = np.asarray(values[...], dtype=np.float64)
            missing = np.isclose(numbers[..., None], marks, rtol=1e-6, atol=0.0).any(axis=-1)
            if np.any(missing):
                raise CalibrationFileError(
                    f"{path.name} has missing values",
                    value=f"{np.sum(missing)} cells of {variable} equal its {key}",
                    limit="none",
                    remedy="remove the draws that failed, or remove the attribute if these numbers are values",
                )


def _require_equal_draws(path: Path, unused: Mapping[str, Any], shape: tuple[int, ...]) -> None:
    """Refuse numbers that say that draws are not equally probable, or of different chains, unless all are equal."""
    for name, values in unused.items():
        if shape[0] in values.shape and np.asarray(values[...]).dtype.kind in "biuf" and np.ptp(1.0 * values[...]) != 0:
            raise CalibrationFileError(
                f"{path.name} has a number for each draw that is not read",
                value=name,
                limit="draws that are equally probable",
                remedy="resample the draws by their weights; remove the variable",
            )


def _netcdf_draws(names: tuple[str, ...], variables: Mapping[str, Any], lens: str) -> CalibrationDraws:
    """Draws, with best parameters, picture size and lens for a rig calibrated from corners."""
    draws = np.asarray(variables["draws"][...], dtype=np.float64)
    if "best" not in variables:
        reference = np.asarray(variables["reference"][...], dtype=np.float64) if "reference" in variables else None
        if reference is not None and reference.shape != (len(names),):
            raise CalibrationFileError(
                "the reference of draws does not match their parameters",
                value=f"{reference.size} values",
                limit=str(len(names)),
                remedy="give one value per parameter",
            )
        return CalibrationDraws(names=names, draws=draws, reference=reference)
    size = np.asarray(variables["pixels"][...]).ravel() if "pixels" in variables else np.zeros(0)
    best = np.asarray(variables["best"][...], dtype=np.float64)
    if size.size != 2 or best.shape != (len(names),):
        raise CalibrationFileError(
            "the posterior of a rig needs pixels (columns and rows) and one best value for each parameter",
            value=f"{size.size} pixels, {best.size} best values for {len(names)} parameters",
            remedy="use an unchanged file written by a run",
        )
    columns, rows = (int(count) for count in size)
    try:
        return CalibrationDraws(names=names, draws=draws, best=best, pixels=(columns, rows), lens=lens_of_text(lens))
    except (ValueError, LookupError, TypeError, OutOfRangeError) as error:
        raise CalibrationFileError(
            "the posterior of a rig has an invalid lens model",
            value=str(error),
            remedy="use an unchanged file written by a run",
        ) from None


_READERS: Final[Mapping[str, Callable[[Path], CalibrationCovariance | CalibrationDraws]]] = {
    ".csv": _read_csv,
    ".nc": _read_netcdf,
}


def _check_finite(path: Path, *tables: FloatArray) -> None:
    """Refuse NaN and infinity."""
    if bad := sum(int(np.sum(~np.isfinite(table))) for table in tables):
        raise CalibrationFileError(
            f"{path.name} contains non-finite values",
            value=f"{bad} cells",
            limit="finite numbers",
            remedy="remove the draws that failed",
        )


def _checked_covariance(path: Path, names: tuple[str, ...], covariance: FloatArray) -> FloatArray:
    """The covariance, after checking that it is symmetric and positive semidefinite."""
    if covariance.shape != (len(names), len(names)):
        raise CalibrationFileError(
            f"the covariance in {path.name} does not match its names",
            value=" × ".join(map(str, covariance.shape)),
            limit=f"{len(names)} × {len(names)}",
            remedy="give one row and one column per parameter",
        )
    variance = np.diag(covariance)
    if np.any(variance < 0.0):
        index = int(np.argmin(variance))
        raise CalibrationFileError(
            f"the variance of {names[index]} in {path.name} is negative",
            value=f"{variance[index]:g}",
            limit=">= 0",
            remedy="check the order of rows and columns",
        )
    if not np.any(variance):
        raise CalibrationFileError(
            f"the covariance in {path.name} is zero",
            value="every variance is 0",
            limit="at least one above 0",
            remedy="leave the posterior out if the calibration is exact",
        )
    scale = np.sqrt(np.where(variance > 0.0, variance, 1.0))
    correlation = covariance / np.outer(scale, scale)
    asymmetry = float(np.max(np.abs(correlation - correlation.T)))
    if asymmetry > _SYMMETRY_LIMIT:
        raise CalibrationFileError(
            f"the covariance in {path.name} is not symmetric",
            value=f"asymmetry of {asymmetry:.1e} in the correlation matrix",
            limit=f"<= {_SYMMETRY_LIMIT:g}",
            remedy="write both triangles with all digits",
        )
    values = np.linalg.eigvalsh((correlation + correlation.T) / 2.0)
    if values[0] < -_NEGATIVE_LIMIT * values[-1]:
        raise CalibrationFileError(
            f"the covariance in {path.name} is not positive semidefinite",
            value=f"eigenvalue {values[0]:.2e} of the correlation matrix",
            limit=">= 0",
            remedy="write it with all digits; correlations beyond ±1 suggest a wrong unit in one row",
        )
    return (covariance + covariance.T) / 2.0

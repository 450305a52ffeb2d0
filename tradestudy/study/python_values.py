"""Values from Python as a study file has them: arrays as lists, quantities with units as text."""

from __future__ import annotations

import atexit
import hashlib
import io
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, cast

import numpy as np

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.document import Value
from tradestudy.units import LENGTH, parse


def plain_value(value: Any) -> Value:
    """A value of Python as plain text, number, list or mapping.

    Quantities of pint, and arrays of xarray whose attribute ``units`` names a unit, become text with that unit. A
    DataFrame with the covariance of errors becomes a calibration that declares these errors and their correlations; one
    with joint draws, or an array with named fields, becomes a calibration by these draws.

    Raises
    ------
    OutOfRangeError
        If a DataFrame is neither a covariance nor joint draws.
    """
    if isinstance(value, str | bool | int | float) and not isinstance(value, np.generic):
        return value
    if isinstance(value, Mapping):
        return {key: plain_value(item) for key, item in value.items()}
    if hasattr(value, "columns") and hasattr(value, "to_numpy"):
        return _calibration(value)
    if names := getattr(getattr(value, "dtype", None), "names", None):
        return _posterior(names, np.stack([value[name] for name in names], axis=-1))
    if isinstance(value, list | tuple | range):
        return [plain_value(item) for item in value]
    unit, numbers = _unit_and_numbers(value)
    return _with_unit(numbers, unit)


def new_value(path: str, value: Any, old: Any) -> Value:
    """A value that replaces another (None: nothing); an array with one element is a single value, as solvers pass it.

    It stays a list where a list or a mapping was. Joint draws replace the declared errors that they determine.

    Raises
    ------
    OutOfRangeError
        If an array with more elements replaces a single value.
    """
    plain = plain_value(value)
    if hasattr(value, "ndim") and not hasattr(value, "columns") and not isinstance(old, list | dict):
        while isinstance(plain, list) and len(plain) == 1:
            plain = plain[0]
        if isinstance(plain, list) and old is not None:
            remedy = "Study.sweep computes depth for several values"
            raise OutOfRangeError(path, value=f"{plain!r:.60}", limit="one value", remedy=remedy)
    if isinstance(plain, dict) and "posterior" in plain and isinstance(old, dict) and not isinstance(value, Mapping):
        drawn = tuple(value.columns if hasattr(value, "columns") else value.dtype.names)
        return {**plain, "errors": {name: None for name in old.get("errors", {}) if name in drawn}}
    return plain


def _calibration(table: Any) -> Value:
    """The calibration that a table of joint draws has, or jointly normal errors with mean 0 [SI] from their covariance.

    Rows of a covariance have the names of its columns, in any order; rows of draws have none.
    """
    from tradestudy.uncertainty.joint import JointNormal  # reading a study does not need it
    from tradestudy.uncertainty.sources import ErrorClass

    names, rows = tuple(map(str, table.columns)), tuple(map(str, table.index))
    if not any(isinstance(row, str) for row in table.index) and len(rows) > len(names):
        return _posterior(names, table.to_numpy())
    if sorted(names) != sorted(rows):
        raise OutOfRangeError(
            "this DataFrame is neither a covariance nor joint draws of errors",
            value=f"{len(rows)} rows, columns {', '.join(names)}",
            limit="a covariance with the same names for rows and columns, or more draws than columns, without names",
        )
    covariance = table.set_axis(rows, axis=0).set_axis(names, axis=1).loc[list(names)]
    joint = JointNormal(
        name="errors",
        parameters=names,
        mean=np.zeros(len(names)),
        covariance=covariance.to_numpy(),
        error_class=ErrorClass.RIG,
    )
    tied = np.clip(joint.correlation, -1.0, 1.0)
    deviations = np.sqrt(np.diag(joint.covariance)).tolist()
    return {
        "errors": {name: {"standard_deviation": deviation} for name, deviation in zip(names, deviations, strict=True)},
        "correlations": {
            name: {names[j]: float(tied[i, j]) for j in range(i + 1, len(names)) if tied[i, j] != 0.0}
            for i, name in enumerate(names)
            if np.any(tied[i, i + 1 :])
        },
    }


def _posterior(names: Sequence[str], draws: FloatArray) -> Value:
    """A posterior in a file that lasts as long as this process, named after its content."""
    text = io.StringIO()
    np.savetxt(text, draws, fmt="%.17g", delimiter=",", header=",".join(names), comments="")
    content = text.getvalue().encode()
    path = _folder() / f"draws-{hashlib.sha256(content).hexdigest()[:12]}.csv"
    path.write_bytes(content)
    return {"posterior": {"file": str(path)}}


@cache
def _folder() -> Path:
    """A folder that lasts as long as this process; a `TemporaryDirectory` would warn when it is collected."""
    folder = tempfile.mkdtemp(prefix="tradestudy-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


def in_metres(distance: Any) -> FloatArray:
    """Distances of any shape [m] from numbers [m], text with a unit, quantities of pint or arrays of xarray.

    Raises
    ------
    OutOfRangeError
        If they are not positive, finite lengths.
    """
    unit, numbers = _unit_and_numbers(distance)
    try:
        plain = plain_value(distance) if isinstance(distance, list | tuple) else numbers
        texts = np.asarray(plain)
        if texts.dtype.kind == "U":
            metres = np.reshape([parse(str(text), LENGTH) for text in texts.flat], texts.shape)
        else:
            scale = parse(f"1 {unit}", LENGTH) if unit not in ("", "m") else 1.0
            metres = np.asarray(plain, dtype=np.float64) * scale
    except (TypeError, ValueError) as error:
        raise OutOfRangeError("this is not a distance", value=f"{distance!r:.60}", remedy=str(error)) from None
    wrong = metres[~((metres > 0.0) & np.isfinite(metres))]
    if wrong.size:
        shown = "None" if texts.dtype.kind == "O" and None in texts.ravel().tolist() else f"{wrong[0]:g} m"
        raise OutOfRangeError("distance", value=shown, limit="positive and finite")
    return metres


def _unit_and_numbers(value: Any) -> tuple[str, Any]:
    """The unit of a quantity or of an array with units, "" without one; and its numbers in plain lists."""
    held = value.data if hasattr(value, "attrs") and hasattr(value, "data") else value  # xarray may hold a quantity
    if hasattr(held, "magnitude") and hasattr(held, "units"):
        return f"{held.units:~C}", _unit_and_numbers(held.magnitude)[1]
    unit = str(getattr(value, "attrs", {}).get("units", ""))
    return ("" if unit == "1" else unit), value.tolist() if hasattr(value, "tolist") else _listed(value)


def _listed(value: Any) -> Any:
    return value.to_numpy().tolist() if hasattr(value, "to_numpy") else value


def _with_unit(numbers: Any, unit: str) -> Value:
    if isinstance(numbers, list):
        return [_with_unit(number, unit) for number in numbers]
    return f"{numbers!r} {unit}" if unit else cast(Value, numbers)

"""Tables of depth errors that were measured at known distances."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.provenance import require_regular_file
from tradestudy.units import FRACTION, LENGTH, Dimension, UnitError, parse

QUANTITIES: Final = ("sigma", "rms", "absolute_error", "bias", "valid")
MOST_ROWS: Final = 10_000
_MOST_BYTES: Final = 10_000_000
_SMALLEST, _LARGEST = 1e-30, 1e30  # in SI, as for quantities of studies
_FEWEST_ROWS: Final = 3
_COLUMNS: Final = ("distance", *QUANTITIES)
_HEADER: Final = re.compile(r"(?P<name>\w+)\s*[\[(]\s*(?P<unit>[^\])]*?)\s*[\])]")
_NUMBER: Final = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_ROUNDING: Final = 0.02  # by which rounded columns may contradict each other, relative
_NOTE: Final = "note"


@dataclass(frozen=True, kw_only=True, eq=False)
class MeasuredTable:
    """Measured depth errors of one camera, in SI; NaN where a cell is empty.

    Parameters
    ----------
    distance : array (N,)
        True distances [m].
    lines
        The lines of the file on which the rows stand.
    sigma, rms, absolute_error, bias : arrays (N,)
        Standard deviation, root-mean-square error, mean absolute error, and mean error of measured depth [m]; a bias is
        positive where depth is too large.
    valid : array (N,)
        Share of points with a depth [1].
    """

    distance: FloatArray
    lines: tuple[int, ...]
    sigma: FloatArray
    rms: FloatArray
    absolute_error: FloatArray
    bias: FloatArray
    valid: FloatArray

    @property
    def spread(self) -> str:
        """The column that says most about noise: sigma, rms or absolute_error; empty if there is none of them."""
        return next((name for name in QUANTITIES[:3] if np.isfinite(getattr(self, name)).any()), "")


def read_measurements(path: Path) -> MeasuredTable:
    """Read a table of measured depth errors.

    The first line names the columns and their units, as in ``distance [m],sigma [mm],bias [%],valid [%]``: ``distance``
    and any of ``sigma``, ``rms``, ``absolute_error``, ``bias``, ``valid`` and, for remarks, ``note``. A length in % is
    one of the distance. Empty cells are unknown; lines that begin with ``#`` are comments. Where rms and bias are
    given without sigma, ``RMS² = σ² + bias²`` gives it.

    Raises
    ------
    OutOfRangeError
        The file cannot be read; a column is missing, unknown, repeated or without a valid unit; a cell is not a number
        with a decimal point; a distance is not positive, a deviation is negative or zero, or a share is not between 0
        and 1; a deviation reaches the distance; columns contradict each other; there are fewer than three rows or
        different distances, or more than `MOST_ROWS`.
    """
    rows = _rows(path)
    if not rows:
        raise OutOfRangeError(f"{path.name} is empty", remedy="name the columns and their units in the first line")
    names, units = _header(path, rows[0][1])
    if not _FEWEST_ROWS <= len(rows) - 1 <= MOST_ROWS:
        raise OutOfRangeError(
            f"{path.name} has too {'few' if len(rows) <= _FEWEST_ROWS else 'many'} rows of measurements",
            value=str(len(rows) - 1),
            limit=f"{_FEWEST_ROWS} to {MOST_ROWS}",
            remedy="two points fit every law; measure at more distances" if len(rows) <= _FEWEST_ROWS else "split it",
        )
    values = {name: np.full(len(rows) - 1, np.nan) for name in _COLUMNS}
    for k, (line, cells) in enumerate(rows[1:]):
        if len(cells) != len(names):
            raise OutOfRangeError(
                f"{path.name}, line {line}: the row has another number of cells than the first line",
                value=str(len(cells)),
                limit=str(len(names)),
                remedy="write decimal points, not decimal commas, and separate cells by commas",
            )
        for name, text in zip(names, cells, strict=True):
            if name != _NOTE and text:
                values[name][k] = _number(path, line, name, text, units[name][0])
    for name, (_, of_distance) in units.items():
        if of_distance:
            values[name] *= values["distance"]
    lines = tuple(line for line, _ in rows[1:])
    _require_possible(path, lines, values)
    if (different := np.unique(values["distance"]).size) < _FEWEST_ROWS:
        raise OutOfRangeError(
            f"{path.name} has measurements at too few distances",
            value=str(different),
            limit=f"{_FEWEST_ROWS} or more",
            remedy="two points fit every law; measure at more distances",
        )
    if np.isnan(values["sigma"]).all():
        with np.errstate(invalid="ignore"):
            values["sigma"] = np.sqrt(np.maximum(values["rms"] ** 2 - values["bias"] ** 2, 0.0))
        values["sigma"][~(values["sigma"] > 0.0)] = np.nan
    return MeasuredTable(lines=lines, **values)


def _rows(path: Path) -> list[tuple[int, list[str]]]:
    """The lines of a file that are not empty and no comments, with their numbers, as cells."""
    try:
        require_regular_file(path)
        size = path.stat().st_size
        if size > _MOST_BYTES:
            raise OutOfRangeError(
                f"'{path.name}' is no table of measurements",
                value=f"{size / 1e6:.3g} MB",
                limit=f"{_MOST_BYTES / 1e6:g} MB",
            )
        with path.open(newline="", encoding="utf-8-sig") as stream:
            reader = csv.reader(stream, skipinitialspace=True, strict=True)
            every = [(reader.line_num, [cell.strip() for cell in cells]) for cells in reader]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        why = getattr(error, "strerror", None) or "not CSV in UTF-8"
        raise OutOfRangeError(f"'{path}' cannot be read", value=why) from None
    return [(line, cells) for line, cells in every if any(cells) and not cells[0].startswith("#")]


def _header(path: Path, cells: Sequence[str]) -> tuple[list[str], dict[str, tuple[float, bool]]]:
    """The names of the columns, and for each its unit in SI and whether it is relative to the distance."""
    if len(cells) == 1 and (separator := re.search(r"[;\t]", cells[0])):
        used = "semicolons" if separator[0] == ";" else "tabs"
        remedy = "separate columns by commas, and write decimal points"
        raise OutOfRangeError(
            f"{path.name} separates columns by {used}", value=repr(cells[0]), limit="commas", remedy=remedy
        )
    names: list[str] = []
    units: dict[str, tuple[float, bool]] = {}
    for cell in cells:
        match = _HEADER.fullmatch(cell)
        name = match["name"].lower() if match else cell.lower()
        if name not in (*_COLUMNS, _NOTE) or (match is None and name != _NOTE):
            unknown = re.split(r"[\s\[(]", name)[0] not in (*_COLUMNS, _NOTE)
            raise OutOfRangeError(
                f"{path.name} has a column {'of an unknown name' if unknown else 'without a unit'}",
                value=repr(cell),
                limit=f"{', '.join(f'{column} [unit]' for column in _COLUMNS)}, {_NOTE}",
                remedy="remove it, or rename it" if unknown else f"write, for example, '{name} [mm]'",
            )
        if name in names:
            raise OutOfRangeError(f"{path.name} has a column twice", value=name, limit="once", remedy="remove one")
        names.append(name)
        if match and name != _NOTE:
            units[name] = _unit(path, name, match["unit"])
    if "distance" not in names or not {*names} & {*QUANTITIES}:
        missing = "distance" if "distance" not in names else "measured quantity"
        raise OutOfRangeError(
            f"{path.name} has no column of the {missing}", value=", ".join(names), limit=f"one of {', '.join(_COLUMNS)}"
        )
    return names, units


def _unit(path: Path, name: str, unit: str) -> tuple[float, bool]:
    dimension: Dimension = FRACTION if name == "valid" or (unit == "%" and name != "distance") else LENGTH
    try:
        return parse(f"1 {unit}", dimension), dimension is FRACTION and name != "valid"
    except UnitError as error:
        raise OutOfRangeError(f"{path.name}, column {name}: {error}") from None


def _number(path: Path, line: int, name: str, text: str, unit: float) -> float:
    """The number in a cell in SI, with the unit of its column in SI."""
    if not _NUMBER.fullmatch(text) or not math.isfinite(float(text)):
        comma = "," in text or ";" in text
        raise OutOfRangeError(
            f"{path.name}, line {line}, column {name}: this is not a number",
            value=repr(text),
            limit="a finite number with a decimal point",
            remedy="write decimal points, not decimal commas" if comma else "correct it, or leave the cell empty",
        )
    value = float(text) * unit
    if not (value == 0.0 or _SMALLEST <= abs(value) <= _LARGEST):
        raise OutOfRangeError(
            f"{path.name}, line {line}, column {name}: no measurement gives this value",
            value=f"{text} ({value:g} in SI)",
            limit=f"0, or {_SMALLEST:g} to {_LARGEST:g} in SI",
            remedy="correct it, or leave the cell empty",
        )
    return value


def _require_possible(path: Path, lines: Sequence[int], values: Mapping[str, FloatArray]) -> None:
    """Refuse values that no measurement gives, and columns that contradict each other."""
    distance, sigma, rms, mean, bias = (values[name] for name in _COLUMNS[:5])
    size, more = np.abs(bias), 1.0 + _ROUNDING
    with np.errstate(invalid="ignore"):
        combined = np.hypot(sigma, bias)
        wrong = {
            "the distance must be above 0": ~(distance > 0.0),
            "sigma must be above 0": sigma <= 0.0,
            **{f"{name} must be below the distance": values[name] >= distance for name in QUANTITIES[:3]},
            "rms must be above 0": rms <= 0.0,
            "absolute_error must not be negative": mean < 0.0,
            "the bias must be above −distance, or measured depths are not positive": bias <= -distance,
            "the valid share must lie between 0 and 1": (values["valid"] < 0.0) | (values["valid"] > 1.0),
            "RMS² must be σ² + bias²": np.abs(rms - combined) > _ROUNDING * combined,
            "rms must not be smaller than sigma, bias or absolute_error": more * rms
            < np.fmax(np.fmax(sigma, size), mean),
            "absolute_error must not be smaller than the magnitude of the bias": more * mean < size,
        }
    for rule, rows in wrong.items():
        if rows.any():
            k = int(np.argmax(rows))
            cells = ", ".join(f"{name} {values[name][k]:.4g}" for name in _COLUMNS if np.isfinite(values[name][k]))
            raise OutOfRangeError(
                f"{path.name}, line {lines[k]}: {rule}", value=f"{cells} (in m)", remedy="correct the row"
            )

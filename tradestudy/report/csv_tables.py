"""All results as CSV: one file per group and set of dimensions, with SI units in the header."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from tradestudy.errors import escaped
from tradestudy.results.views.tables import Table, tables_of

_FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r")


def tables(tree: xr.DataTree) -> Mapping[str, bytes]:
    """Write all groups of a results tree as tables.

    Returns
    -------
    mapping of str to bytes
        File name to content, such as ``depth_by_camera_distance.csv``: one row per combination of the dimensions,
        one column per variable, numbers with all their digits.
    """
    return {f"{name}.csv": _table(table) for name, table in tables_of(tree).items()}


def _table(table: Table) -> bytes:
    data, dims, names = table.data, table.dims, table.variables
    columns = [_cells(data[name].values) for name in names]
    if dims:
        keys = [""]
        for number, dim in enumerate(dims):
            labels = [f",{cell}" if number else cell for cell in _cells(data[dim].values)]
            keys = [key + label for key in keys for label in labels]
        columns.insert(0, keys)
    units = {name: data[name].attrs.get("units", "") for name in (*dims, *names)}
    title = ",".join(_quoted(_cell(f"{name} [{unit}]" if unit else name)) for name, unit in units.items())
    return "\n".join((title, *map(",".join, zip(*columns, strict=True)), "")).encode()


def _cells(values: NDArray[Any]) -> list[str]:
    """Write cells, but format each distinct value only once, because most values of a sweep repeat."""
    flat = np.ravel(values)
    if flat.dtype.kind not in "fiub":
        cells = [_cell(value) for value in flat.tolist()]
        quoted = {cell: _quoted(cell) for cell in set(cells)}
        return [quoted[cell] for cell in cells]
    bits = (
        flat.view(f"i{flat.itemsize}") if flat.dtype.kind == "f" else flat
    )  # by bits, because −0 is written differently from 0
    _, first, places = np.unique(bits, return_index=True, return_inverse=True)
    texts: list[str] = np.array([str(number) for number in flat[first].tolist()], dtype=object)[places].tolist()
    return texts


def _cell(value: object) -> str:
    """Write one value; text that a spreadsheet would run as a formula gets an apostrophe before it."""
    if isinstance(value, str):
        text = escaped(value, lines=True)
        return f"'{text}" if value.startswith(_FORMULA_STARTS) else text
    return str(value)


def _quoted(cell: str) -> str:
    """Put a cell in quotes if CSV requires it."""
    row = io.StringIO(newline="")
    csv.writer(row, lineterminator="\n").writerow(["", cell])
    return row.getvalue()[1:-1]

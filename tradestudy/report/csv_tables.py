"""All results as CSV: one file per group and set of dimensions, with SI units in the header."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Mapping
from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from tradestudy.errors import escaped
from tradestudy.results.views.tables import Table, tables_of

LARGE: Final = 50e6  # bytes from which a table is written only on request
_ROWS: Final = 10_000  # formatted at a time, so that memory does not grow with the number of designs
_FEW: Final = 100_000  # cells: a table of fewer comes nowhere near that size
_SAMPLE: Final = 500  # rows from which the size of a larger table is estimated
_FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r")


def tables(tree: xr.DataTree, *, large: bool = True) -> Mapping[str, Iterator[bytes]]:
    """Write all groups of a results tree as tables, piece by piece; those above 50 MB only if `large`.

    Returns
    -------
    mapping of str to iterator of bytes
        File name, such as ``depth_by_camera_distance.csv``, to the pieces of its content: one row per combination of
        the dimensions, one column per variable, numbers with all their digits. In a sweep, the rows of a camera that
        are the same in every design are written once, with empty cells for the swept parameters.
    """
    left_out = () if large else large_tables(tree)
    return {f"{name}.csv": _pieces(table) for name, table in tables_of(tree).items() if f"{name}.csv" not in left_out}


def large_tables(tree: xr.DataTree) -> dict[str, float]:
    """The files of tables above 50 MB, with their sizes in bytes, estimated from some of their rows."""
    sizes = {f"{name}.csv": _size(table) for name, table in tables_of(tree).items() if _count_cells(table) > _FEW}
    return {name: size for name, size in sizes.items() if size > LARGE}


def _pieces(table: Table) -> Iterator[bytes]:
    units = {column: table.data[column].attrs.get("units", "") for column in (*table.dims, *table.variables)}
    titles = [_cell(f"{column} [{unit}]" if unit else column) for column, unit in units.items()]
    yield f"{','.join(titles)}\n".encode()
    once, count = _same_in_every_design(table), math.prod(_shape(table))
    for begin in range(0, count, _ROWS):
        yield "".join(_lines(table, np.arange(begin, min(begin + _ROWS, count)), once)).encode()


def _shape(table: Table) -> tuple[int, ...]:
    return tuple(table.data.sizes[dim] for dim in table.dims)


def _count_cells(table: Table) -> int:
    return math.prod(_shape(table)) * (len(table.dims) + len(table.variables))


def _same_in_every_design(table: Table) -> NDArray[np.bool_]:
    """For every camera, whether all its values in the table are the same in all designs of a sweep; False without."""
    designs = math.prod(table.data.sizes[dim] for dim in table.swept)
    once = np.full(table.data.sizes.get("camera", 0) if "camera" in table.dims else 0, designs > 1)
    for variable in table.variables if once.any() else ():
        values = table.data[variable].transpose(*table.swept, "camera", ...).values.reshape(designs, once.size, -1)
        first = values[:1]
        once &= np.all((values == first) | ((values != values) & (first != first)), axis=(0, 2))  # NaN equals NaN
    return once


def _lines(table: Table, rows: NDArray[np.int64], once: NDArray[np.bool_]) -> list[str]:
    """The lines of these rows, counted over all combinations; without those of a camera that an earlier design has."""
    data, shape = table.data, _shape(table)
    places = dict(zip(table.dims, np.unravel_index(rows, shape) if shape else (), strict=True))
    repeats = once[places["camera"]] if once.any() else np.zeros(rows.size, dtype=np.bool_)
    later = np.any([places[dim] > 0 for dim in table.swept], axis=0) if table.swept else repeats
    kept = ~(repeats & later)
    columns = []
    for dim, place in places.items():
        # An empty cell at index −1 stands for the swept parameters of rows that hold in every design.
        labels = np.array([*_cells(data[dim].values), ""], dtype=object)
        columns.append(labels[np.where(repeats & (dim in table.swept), -1, place)[kept]].tolist())
    columns += [_cells(np.ravel(data[variable].values)[rows[kept]]) for variable in table.variables]
    return [f"{','.join(cells)}\n" for cells in zip(*columns, strict=True)]


def _size(table: Table) -> float:
    """Bytes of a table, estimated from rows spread over it."""
    count, designs = math.prod(_shape(table)), math.prod(table.data.sizes[dim] for dim in table.swept)
    if not count:
        return 0.0
    once = _same_in_every_design(table)
    lines = _lines(table, np.unique(np.linspace(0, count - 1, _SAMPLE).astype(np.int64)), once)
    # Of a camera that is the same in every design, only the rows of one design are written.
    written = count * (1.0 - (once.mean() if once.size else 0.0) * (1.0 - 1.0 / designs))
    return float(written * np.mean([len(line.encode()) for line in lines]))


def _cells(values: NDArray[Any]) -> list[str]:
    """Write numbers with all their digits, and text as `_cell` does, once for each of the few that are different."""
    cells = np.ravel(values).tolist()
    if values.dtype.kind in "fiub":
        return list(map(str, cells))
    texts = {text: _cell(text) for text in set(cells)}
    return [texts[text] for text in cells]


def _cell(text: str) -> str:
    """Write text, in quotes if CSV requires it; one that a spreadsheet would run as a formula after an apostrophe."""
    row = io.StringIO(newline="")
    safe = "'" * text.startswith(_FORMULA_STARTS) + escaped(text, lines=True)
    # After an empty cell, because the writer puts the only cell of a row in quotes if it is empty.
    csv.writer(row, lineterminator="\n").writerow(["", safe])
    return row.getvalue()[1:-1]

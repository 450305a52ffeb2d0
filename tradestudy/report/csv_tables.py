"""Every number of the results as CSV, one file per group and set of dimensions, SI units in the header."""

from __future__ import annotations

import csv
import io
import itertools
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import xarray as xr

_FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r")


def tables(tree: xr.DataTree) -> Mapping[str, bytes]:
    """Write all groups of a results tree as tables.

    Returns
    -------
    mapping of str to bytes
        File name to content, such as ``depth_by_camera_distance.csv``: one row per combination of the dimensions,
        one column per variable, numbers with all their digits.
    """
    return dict(_tables(tree))


def _tables(tree: xr.DataTree) -> Iterator[tuple[str, bytes]]:
    for group in tree.children.values():
        data = group.to_dataset()
        by_dims: dict[tuple[str, ...], list[str]] = {}
        for name, array in data.data_vars.items():
            by_dims.setdefault(tuple(map(str, array.dims)), []).append(str(name))
        for dims, names in by_dims.items():
            over = "_by_" + "_".join(dims) if dims else ""
            yield f"{group.name}{over}.csv".replace("/", "_"), _table(data, dims, names)


def _table(data: xr.Dataset, dims: tuple[str, ...], names: list[str]) -> bytes:
    buffer = io.StringIO(newline="")
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow([_titled(data, name) for name in (*dims, *names)])
    keys = itertools.product(*([_cell(value) for value in data[dim].values.tolist()] for dim in dims))
    columns = [[_cell(value) for value in np.ravel(data[name].values).tolist()] for name in names]
    writer.writerows([*key, *cells] for key, *cells in zip(keys, *columns, strict=True))
    return buffer.getvalue().encode()


def _titled(data: xr.Dataset, name: str) -> str:
    unit = data[name].attrs.get("units", "")
    return _cell(f"{name} [{unit}]" if unit else name)


def _cell(value: object) -> str:
    """Write one value; text that a spreadsheet would run as a formula gets an apostrophe before it."""
    if isinstance(value, str):
        return f"'{value}" if value.startswith(_FORMULA_STARTS) else value
    return repr(value) if isinstance(value, float) else str(value)

"""Two or more runs side by side: inputs that differ, results that moved."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import xarray as xr

from tradestudy.errors import OutOfRangeError

ABSENT: Final = "—"
# Rounding of another machine or library moves the last digits; a study's reader does not care.
_NEGLIGIBLE: Final = 1e-9
_MOST_TEXTS: Final = 6
# What was declared is compared as inputs; what a reader asks first comes first.
_NOT_COMPARED: Final = ("assumptions", "cameras", "contradictions")
_FIRST: Final = ("decision", "claims", "requirements")


@dataclass(frozen=True, kw_only=True)
class Difference:
    """One line of a comparison: what, and its value in each run."""

    what: str
    values: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """What differs between runs, in their order."""

    names: tuple[str, ...]
    inputs: tuple[Difference, ...]
    results: tuple[Difference, ...]


def compare_runs(
    names: Sequence[str], records: Sequence[Mapping[str, Any]], trees: Sequence[xr.DataTree]
) -> Comparison:
    """Compare runs by their records and results.

    Parameters
    ----------
    names
        What to call each run.
    records
        Content of each ``run.json``.
    trees
        Results of each run.

    Raises
    ------
    OutOfRangeError
        For fewer than two runs.
    """
    if len(names) < 2:
        raise OutOfRangeError("runs to compare", value=str(len(names)), limit="at least 2")
    return Comparison(
        names=tuple(names),
        inputs=tuple(_inputs([record.get("inputs", {}) for record in records])),
        results=tuple(_results(trees)),
    )


def _inputs(inputs: Sequence[Mapping[str, str]]) -> Iterator[Difference]:
    inputs = [one if isinstance(one, Mapping) else {} for one in inputs]
    for path in dict.fromkeys(path for one in inputs for path in one):
        values = tuple(str(one.get(path, ABSENT)) for one in inputs)
        if len(set(values)) > 1:
            yield Difference(what=path, values=values)


def _results(trees: Sequence[xr.DataTree]) -> Iterator[Difference]:
    names = dict.fromkeys(name for tree in trees for name in tree.children if name not in _NOT_COMPARED)
    groups = sorted(names, key=lambda name: _FIRST.index(name) if name in _FIRST else len(_FIRST))
    for group in groups:
        tables = [tree[group].to_dataset() if group in tree.children else xr.Dataset() for tree in trees]
        for name in dict.fromkeys(str(name) for table in tables for name in table.data_vars):
            columns = [table.get(name) for table in tables]
            yield from _variable(f"{group}/{name}", columns)


def _variable(what: str, columns: Sequence[xr.DataArray | None]) -> Iterator[Difference]:
    """Differences of one variable: text by label, numbers by their largest relative move against the first run."""
    first = columns[0]
    present = [column is not None for column in columns]
    if first is None or not all(present):
        yield Difference(what=what, values=tuple("present" if there else ABSENT for there in present))
        return
    others = [column for column in columns[1:] if column is not None]
    if first.dtype.kind in "OUTS":
        yield from _text(what, [first, *others])
        return
    moves = [_largest_move(first, other) for other in others]
    if any(moves):
        yield Difference(what=what, values=("reference", *(move or "unchanged" for move in moves)))


def _text(what: str, columns: Sequence[xr.DataArray]) -> Iterator[Difference]:
    if any(column.shape != columns[0].shape for column in columns):
        yield Difference(what=what, values=tuple(f"{column.size} entries" for column in columns))
        return
    differing = [
        (index, values)
        for index in np.ndindex(columns[0].shape)
        if len(set(values := tuple(str(column.values[index]) for column in columns))) > 1
    ]
    for index, values in differing[:_MOST_TEXTS]:
        yield Difference(what=f"{what}{_label(columns[0], index)}", values=values)
    if len(differing) > _MOST_TEXTS:
        more = f"{len(differing) - _MOST_TEXTS} more"
        yield Difference(what=what, values=("reference", *[f"differs in {more} places"] * (len(columns) - 1)))


def _largest_move(first: xr.DataArray, other: xr.DataArray) -> str:
    """The largest relative change in words, with where it is; empty where nothing moved."""
    if any(first.sizes[dim] != other.sizes[dim] for dim in first.dims if dim in other.dims and dim not in first.coords):
        return "another number of entries"
    a, b = xr.align(first.astype(float), other.astype(float), join="inner")
    if first.size == 0 and other.size == 0:
        return ""
    if a.size == 0 or a.dims != b.dims:
        return "no common points"
    x, y = a.values, b.values
    # Far below the largest value of a variable numbers differ by what they are made of, not by what they mean.
    finite = np.abs(x[np.isfinite(x)])
    floor = _NEGLIGIBLE * float(finite.max()) if finite.size else 0.0
    same = (x == y) | (np.isnan(x) & np.isnan(y)) | ((np.abs(x) <= floor) & (np.abs(y) <= floor))
    with np.errstate(divide="ignore", invalid="ignore"):  # infinite and zero references are outcomes, sorted out below
        move = np.where(same, 0.0, np.abs(y / x - 1.0))
    move = np.where(np.isnan(move) | (np.isinf(x) & ~same), math.inf, move)
    at = np.unravel_index(int(np.argmax(move)), move.shape) if move.ndim else ()
    if move[at] <= _NEGLIGIBLE:
        return ""
    size = (
        f"{x[at]:.4g} → {y[at]:.4g}" if not math.isfinite(move[at]) else f"up to {100.0 * (y[at] / x[at] - 1.0):+.3g} %"
    )
    return f"{size}{_label(a, tuple(int(i) for i in at))}"


def _label(array: xr.DataArray, index: tuple[int, ...]) -> str:
    parts = []
    for dim, position in zip(array.dims, index, strict=True):
        value = array[dim].values[position] if dim in array.coords else position
        parts.append(f"{dim}={value:.4g}" if isinstance(value, float) else f"{dim}={value}")
    return f" at {', '.join(parts)}" if parts else ""

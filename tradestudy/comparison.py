"""Two or more runs side by side: conclusions that changed, inputs that differ, results that moved."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import xarray as xr

from tradestudy.errors import OutOfRangeError
from tradestudy.results.views.conclusions import best_stretches, requirement_conclusions, usable_words
from tradestudy.wording import counted, listed

ABSENT: Final = "—"
# Rounding of another machine or library moves the last digits; a study's reader does not care.
_NEGLIGIBLE: Final = 1e-9
_MOST_TEXTS: Final = 6
# What was declared is compared as inputs; what a reader asks first comes first.
_NOT_COMPARED: Final = ("assumptions", "cameras", "contradictions")
_FIRST: Final = ("decision", "claims", "requirements", "depth_at_places", "depth")
_NUMBERS: Final = re.compile(r"[+-]?\d[\d.]*(?:e[+-]?\d+)?")
_REFERENCE: Final = "reference"
_STATED_ERRORS: Final = "stated numerical errors"


@dataclass(frozen=True, kw_only=True)
class Difference:
    """One line of a comparison: what, and its value in each run."""

    what: str
    values: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """What differs between runs, in their order, and how many declared values and computed variables do not.

    Conclusions are verdicts of requirements, best cameras and usable ranges, in words.
    """

    names: tuple[str, ...]
    conclusions: tuple[Difference, ...]
    inputs: tuple[Difference, ...]
    results: tuple[Difference, ...]
    same_inputs: int
    moved_results: int
    same_results: int

    def __str__(self) -> str:
        return "\n".join(self._lines())

    def _lines(self) -> Iterator[str]:
        """What differs, grouped, and how much does not."""
        yield " → ".join(self.names)
        yield f"Conclusions that changed: {len(self.conclusions) or 'none'}"
        for difference in self.conclusions:
            yield from self._told(difference.what, difference.values, indent="  ")
        yield f"Inputs that differ: {len(self.inputs)}, {counted(self.same_inputs, 'other')} the same"
        for difference in self.inputs:
            yield from self._told(difference.what, difference.values, indent="  ")
        yield f"Results that moved: {self.moved_results}, {counted(self.same_results, 'other')} the same"
        for group, members in itertools.groupby(self.results, key=lambda difference: difference.what.split("/")[0]):
            yield f"  {group}"
            for difference in members:
                yield from self._told(difference.what.removeprefix(f"{group}/"), difference.values, indent="    ")

    def _told(self, what: str, values: tuple[str, ...], indent: str) -> Iterator[str]:
        if len(values) == 2:
            yield f"{indent}{what}: {values[1] if values[0] == _REFERENCE else ' → '.join(values)}"
            return
        yield f"{indent}{what}"
        for name, value in zip(self.names, values, strict=True):
            yield f"{indent}  {name}: {value}"


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
    declared = [one if isinstance(one := record.get("inputs", {}), Mapping) else {} for record in records]
    inputs, results = tuple(_inputs(declared)), tuple(_results(trees))
    compared = {name for tree in trees for name in _variables(tree)}
    moved = len(compared & {difference.what.split(" at ")[0] for difference in results})
    return Comparison(
        names=tuple(names),
        conclusions=tuple(_conclusions(trees)),
        inputs=inputs,
        results=results,
        same_inputs=len({path for one in declared for path in one}) - len(inputs),
        moved_results=moved,
        same_results=len(compared) - moved,
    )


def _conclusions(trees: Sequence[xr.DataTree]) -> Iterator[Difference]:
    """Verdicts of requirements, best cameras and usable ranges that are not the same in every run."""
    if not all("cameras" in tree.children for tree in trees):
        return
    requirements = [{one.name: one for one in requirement_conclusions(tree)} for tree in trees]
    says = {name: one.says for found in reversed(requirements) for name, one in found.items()}
    verdicts = [{says[name]: f"{one.verdict}, {one.camera}" for name, one in found.items()} for found in requirements]
    best = [{"best camera": "; ".join(one.words for one in best_stretches(tree)) or ABSENT} for tree in trees]
    ranges = [{f"{title} usable": words for title, words in usable_words(tree).items()} for tree in trees]
    for found in (verdicts, best, ranges):
        for what in dict.fromkeys(name for one in found for name in one):
            values = tuple(one.get(what, ABSENT) for one in found)
            if len(set(values)) > 1:
                yield Difference(what=what, values=values)


def _variables(tree: xr.DataTree) -> Iterator[str]:
    """What results are compared: numbers and texts, not the stated errors of numbers."""
    for group in tree.children:
        if group not in _NOT_COMPARED:
            names = [str(name) for name in tree[group].data_vars]
            yield from (f"{group}/{name}" for name in names if not _is_stated_error(name, names))


def _inputs(inputs: Sequence[Mapping[str, str]]) -> Iterator[Difference]:
    for path in dict.fromkeys(path for one in inputs for path in one):
        values = tuple(str(one.get(path, ABSENT)) for one in inputs)
        if len(set(values)) > 1:
            yield Difference(what=path, values=values)


def _results(trees: Sequence[xr.DataTree]) -> Iterator[Difference]:
    names = dict.fromkeys(name for tree in trees for name in tree.children if name not in _NOT_COMPARED)
    groups = sorted(names, key=lambda name: _FIRST.index(name) if name in _FIRST else len(_FIRST))
    for group in groups:
        tables = [tree[group].to_dataset() if group in tree.children else xr.Dataset() for tree in trees]
        names_here = dict.fromkeys(str(name) for table in tables for name in table.data_vars)
        for name in names_here:
            if not _is_stated_error(name, names_here):
                yield from _variable(f"{group}/{name}", [table.get(name) for table in tables])
        # How well a number is known moves with the number and tells little by itself.
        errors = [
            name
            for name in names_here
            if _is_stated_error(name, names_here)
            and any(_variable(f"{group}/{name}", [table.get(name) for table in tables]))
        ]
        if errors:
            values = (_REFERENCE, *[f"moved for {counted(len(errors), 'variable')}"] * (len(trees) - 1))
            yield Difference(what=f"{group}/{_STATED_ERRORS}", values=values)


def _is_stated_error(name: str, names: Iterable[str]) -> bool:
    """Whether a variable is the estimated numerical error of another one of its group."""
    stem = name.removesuffix("_error")
    return stem != name and not {stem, f"{stem}_distance", f"{stem}_value"}.isdisjoint(names)


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
    # Answers, yes or no or not asked, are no numbers whose relative change would say anything.
    move_of = _flips if first.dtype.kind == "b" or first.dtype == np.int8 else _largest_move
    moves = [move_of(first, other) for other in others]
    if any(moves):
        yield Difference(what=what, values=(_REFERENCE, *(move or "unchanged" for move in moves)))


def _text(what: str, columns: Sequence[xr.DataArray]) -> Iterator[Difference]:
    """Texts that differ, neighbours of one change together; those that say the same of other numbers only counted."""
    first = columns[0]
    if any(column.shape != first.shape for column in columns):
        yield Difference(what=what, values=tuple(f"{counted(column.size, 'entry', 'entries')}" for column in columns))
        return
    found: dict[tuple[int, ...], tuple[str, ...]] = {}
    reworded = 0
    for index in np.ndindex(first.shape):
        values = tuple(str(column.values[index]) for column in columns)
        if len(set(values)) > 1:
            if len({_NUMBERS.sub("#", value) for value in values}) > 1:
                found[index] = values
            else:
                reworded += 1
    stretches = list(_stretches(first, found))
    for label, values in stretches[:_MOST_TEXTS]:
        yield Difference(what=f"{what}{label}", values=tuple(value or "none" for value in values))
    rest = [
        f"{words} in {counted(count, 'place')}"
        for words, count in (("other numbers", reworded), ("more changes", len(stretches) - _MOST_TEXTS))
        if count > 0
    ]
    if rest:
        yield Difference(what=what, values=(_REFERENCE, *[", ".join(rest)] * (len(columns) - 1)))


def _stretches(
    array: xr.DataArray, found: Mapping[tuple[int, ...], tuple[str, ...]]
) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Changes with where they are: along distance, neighbours that change alike as one stretch."""
    if "distance" not in array.coords or "distance" not in array.dims:
        yield from ((_label(array, index), values) for index, values in found.items())
        return
    axis = array.dims.index("distance")
    places = array["distance"].values

    def beside(index: tuple[int, ...]) -> tuple[int, ...]:
        return (*index[:axis], *index[axis + 1 :])

    # Noise and calibration together is what a reader asks first: the last way of three.
    order = sorted(found, key=lambda index: (tuple(-one for one in beside(index)), index[axis]))
    alike: dict[tuple[str, tuple[str, ...]], list[str]] = {}
    for _, members in itertools.groupby(
        enumerate(order), key=lambda item: (beside(item[1]), found[item[1]], item[1][axis] - item[0])
    ):
        indices = [index for _, index in members]
        ends = [places[index[axis]] for index in (indices[0], indices[-1])]
        where = " to ".join(dict.fromkeys(f"{end:.4g}" for end in ends))
        others = _label(array.isel(distance=0), beside(indices[0])).removeprefix(" at ")
        alike.setdefault((where, found[indices[0]]), []).append(others)
    for (where, values), every in alike.items():
        yield f" at {', '.join(part for part in (f'distance={where}', listed(every)) if part)}", values


def _flips(first: xr.DataArray, other: xr.DataArray) -> str:
    """How many answers are others, and what they have in common."""
    if first.shape != other.shape:
        return "another number of entries"
    differing = np.argwhere(np.atleast_1d(first.values != other.values))
    if not differing.size:
        return ""
    if not first.ndim:
        return f"{first.item()} → {other.item()}"
    common = [
        f"{dim}={first[dim].values[differing[0, axis]]}"
        for axis, dim in enumerate(first.dims)
        if dim in first.coords and first.sizes[dim] > 1 and len(set(differing[:, axis])) == 1
    ]
    text = f"differs in {len(differing)} of {counted(first.size, 'place')}"
    return f"{text}, all at {', '.join(common)}" if common else text


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
    return f"{_change(float(x[at]), float(y[at]))}{_label(a, tuple(int(i) for i in at))}"


def _change(before: float, after: float) -> str:
    """A change in per cent; as a factor where that is beyond 1000 %, and both values where there is no ratio."""
    with np.errstate(divide="ignore", invalid="ignore"):  # told by both values
        ratio = float(np.float64(after) / np.float64(before))
    if not math.isfinite(ratio) or math.isinf(before):
        return f"{before:.4g} → {after:.4g}"
    percent = 100.0 * (ratio - 1.0)
    if abs(percent) > 1000.0:
        return f"up to {ratio:.3g} times"
    return f"up to {percent:+.0f} %" if abs(percent) >= 100.0 else f"up to {percent:+.3g} %"


def _label(array: xr.DataArray, index: tuple[int, ...]) -> str:
    places = {
        dim: array[dim].values[position] if dim in array.coords else position
        for dim, position in zip(array.dims, index, strict=True)
    }
    parts = [f"{dim}={at:.4g}" if isinstance(at, float) else f"{dim}={at}" for dim, at in places.items()]
    return f" at {', '.join(parts)}" if parts else ""

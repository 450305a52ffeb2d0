"""Results that differ by more than their error, the largest difference first."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import xarray as xr

from tradestudy.comparison.difference import Difference, Run, titles_of
from tradestudy.comparison.stated_errors import (
    ROUNDING,
    beyond,
    error_name,
    left_out_share,
    standard_errors,
    stated_error,
)
from tradestudy.comparison.words import (
    changes_in_words,
    group_words,
    known_dimension,
    place_in_words,
    result_words,
    values_in_words,
    varies,
)
from tradestudy.results.views.groups import FloatArray, group, records
from tradestudy.units import FRACTION

# Declared values, conclusions, or computing times, which other parts of the comparison cover.
_COVERED_ELSEWHERE: Final = (
    "assumptions", "cameras", "claims", "contradictions", "cost", "datasheet", "decision", "effects", "requirements",
)  # fmt: skip
_OF_PLACES, _OF_DEPTH, _REQUIREMENTS = "depth_at_places", "depth", "requirements"
_UNCERTAINTY, _RADIUS = "depth_uncertainty", "depth_error_radius"
_PARTS_OF_DEPTH: Final = (
    "depth_uncertainty_by_error_source", "depth_error_radius_by_error_source", "depth_quantile", "equivalent_baseline",
    "limit_value", "usable_near", "usable_far",
)  # fmt: skip
# They repeat another variable, or the conclusions.
_REPETITIONS: Final[Mapping[str, tuple[str, ...]]] = {
    _OF_DEPTH: _PARTS_OF_DEPTH,
    _OF_PLACES: _PARTS_OF_DEPTH,
    "depth_field": _PARTS_OF_DEPTH,
    "depth_of_field": ("sharp_near", "sharp_far", "scene_share", "resolved_scene_share"),
    "disparity_causes": ("disparity_error_px", "disparity_error_px_changed"),
}


@dataclass(frozen=True, kw_only=True)
class ChangedResult:
    """One result of one camera where it differs most.

    Parameters
    ----------
    group, variable, camera
        Names in the results; camera is empty where the result belongs to none.
    size
        The largest change relative to the first run; for a share, its difference; infinite where there is no ratio.
    design
        The swept values there, by path; empty without a sweep.
    difference
        The difference in words.
    """

    group: str
    variable: str
    camera: str
    size: float
    design: Mapping[str, Any]
    difference: Difference


@dataclass(frozen=True, kw_only=True)
class Results:
    """Results that differ by more than their error, the largest first; the number of others; those not comparable."""

    moved: tuple[ChangedResult, ...]
    within_error: int
    apart: tuple[str, ...]


def compare_results(runs: Sequence[Run]) -> Results:
    """Compare every number that carries an error, camera by camera, wherever all runs have it."""
    titles = titles_of(runs)
    moved: list[ChangedResult] = []
    within, apart = 0, []
    for name, variable in _variables(runs):
        aligned = _aligned(runs, name, variable)
        if aligned is None:
            apart += [f"{result_words(variable)}{group_words(name)}"] * (variable != _RADIUS)
            continue
        for camera in _cameras(aligned.values[0]):
            found = _largest(runs, titles, name, variable, camera, aligned.of(camera))
            if found is not None:
                moved.append(found)
            elif variable != _RADIUS:
                within += 1
    # The radius repeats the depth uncertainty unless a bias or failures alone change.
    spread = {(one.group, one.camera) for one in moved if one.variable == _UNCERTAINTY}
    moved = [one for one in moved if one.variable != _RADIUS or (one.group, one.camera) not in spread]
    worst = list(_worst_values(runs))
    moved += [one for one in worst if one is not None]
    within += worst.count(None)
    return Results(
        moved=tuple(sorted(moved, key=lambda one: -one.size)), within_error=within, apart=tuple(dict.fromkeys(apart))
    )


def _worst_values(runs: Sequence[Run]) -> Iterator[ChangedResult | None]:
    """Worst values of requirements whose verdict and camera stay the same; None where they agree within their error."""
    rows = [{str(row["requirement"]): row for row in records(run.tree, _REQUIREMENTS, "requirement")} for run in runs]
    for name in rows[0]:
        ones = [one[name] for one in rows if name in one]
        if len(ones) == len(runs) and len({(one["met"], one["camera_deciding"]) for one in ones}) == 1:
            yield _worst_value(runs, ones)


def _worst_value(runs: Sequence[Run], ones: Sequence[Mapping[str, Any]]) -> ChangedResult | None:
    camera = str(ones[0]["camera_deciding"])
    values = [float(one["value"]) for one in ones]
    shares = [left_out_share(run.tree, camera, str(ones[0]["quantity"])) + ROUNDING for run in runs]
    errors = [
        standard_errors(run.tree, camera) * float(np.nan_to_num(one["value_error"])) + share * abs(value)
        for run, one, share, value in zip(runs, ones, shares, values, strict=True)
    ]
    sizes = [
        abs(value / values[0] - 1.0)
        for value, error in zip(values[1:], errors[1:], strict=True)
        if values[0] and math.isfinite(value / values[0]) and abs(value - values[0]) > math.hypot(error, errors[0])
    ]
    if not sizes:
        return None
    return ChangedResult(
        group=_REQUIREMENTS,
        variable="value",
        camera=camera,
        size=max(sizes),
        design={},
        difference=Difference(
            what=f'requirement "{ones[0]["says"]}"',
            values=tuple(str(one["reason"]) for one in ones),
            where=changes_in_words(values),
        ),
    )


def _variables(runs: Sequence[Run]) -> Iterator[tuple[str, str]]:
    """Groups and variables with known errors that every run contains and nothing else covers."""
    for name in runs[0].tree.children:
        if name in _COVERED_ELSEWHERE or not all(name in run.tree.children for run in runs):
            continue
        if name == _OF_PLACES and _has_common_distances(runs):
            continue
        tables = [group(run.tree, name) for run in runs]
        for variable in map(str, tables[0].data_vars):
            if (
                variable not in _REPETITIONS.get(name, ())
                and all(variable in table and table[variable].dtype.kind in "fiu" for table in tables)
                and all(error_name(table, variable) is not None for table in tables)
            ):
                yield name, variable


def _has_common_distances(runs: Sequence[Run]) -> bool:
    grids = [group(run.tree, _OF_DEPTH)["distance"].values for run in runs if _OF_DEPTH in run.tree.children]
    return len(grids) == len(runs) and all(np.isin(grids[0], other).any() for other in grids[1:])


@dataclass(frozen=True, kw_only=True)
class _Aligned:
    """A variable and its error in every run, at the places that all runs share."""

    values: tuple[xr.DataArray, ...]
    errors: tuple[xr.DataArray, ...]

    def of(self, camera: str) -> _Aligned:
        """The part that belongs to one camera; everything if the results belong to none."""
        if not camera:
            return self
        return _Aligned(
            values=tuple(one.sel(camera=camera) for one in self.values),
            errors=tuple(one.sel(camera=camera) for one in self.errors),
        )


def _aligned(runs: Sequence[Run], name: str, variable: str) -> _Aligned | None:
    """A variable of all runs at their common places; None if there are none."""
    tables = []
    for run in runs:
        values, error = group(run.tree, name)[variable], stated_error(run.tree, name, variable)
        assert error is not None  # callers pass only variables with known errors
        tables.append(xr.Dataset({"value": values.astype(float), "error": error.broadcast_like(values)}))
    first = tables[0]
    bare = [dim for dim in first["value"].dims if dim not in first.coords]
    if any(set(one["value"].dims) != set(first["value"].dims) for one in tables):
        return None
    if any(one.sizes[dim] != first.sizes[dim] for one in tables for dim in bare):
        return None
    aligned = [one.transpose(*first["value"].dims) for one in xr.align(*tables, join="inner")]
    if not aligned[0]["value"].size:
        return None
    return _Aligned(values=tuple(one["value"] for one in aligned), errors=tuple(one["error"] for one in aligned))


def _cameras(values: xr.DataArray) -> tuple[str, ...]:
    return tuple(map(str, values["camera"].values)) if "camera" in values.dims else ("",)


def _largest(
    runs: Sequence[Run], titles: Mapping[str, str], name: str, variable: str, camera: str, aligned: _Aligned
) -> ChangedResult | None:
    """Where a result differs most from the first run, among the places where it differs by more than its error."""
    first = aligned.values[0]
    arrays = [np.asarray(one.values, dtype=np.float64) for one in aligned.values]
    errors = [np.asarray(one.values, dtype=np.float64) for one in aligned.errors]
    is_share = _is_share(first, arrays)
    sizes = [
        np.where(beyond((arrays[0], other), (errors[0], error)), _size(arrays[0], other, is_share=is_share), 0.0)
        for other, error in zip(arrays[1:], errors[1:], strict=True)
    ]
    largest = _most_relevant(np.max(sizes, axis=0), _usable_somewhere(runs, name, aligned, camera))
    first_of_largest = int(np.argmax(largest >= np.max(largest) * (1.0 - ROUNDING)))
    at = tuple(map(int, np.unravel_index(first_of_largest, largest.shape)))
    size = float(largest[at])
    if size == 0.0:
        return None
    values = [float(array[at]) for array in arrays]
    dimension = FRACTION if is_share else known_dimension(first)
    what = result_words(variable) + (f" of {titles[camera]}" if camera in titles else "") + group_words(name)
    change = "" if is_share or not math.isfinite(size) else changes_in_words(values)
    return ChangedResult(
        group=name,
        variable=variable,
        camera=camera,
        size=size,
        design={
            dim: first[dim].values[at[axis]]
            for axis, dim in enumerate(map(str, first.dims))
            if "declared" in first[dim].attrs and varies(first, axis, at)  # swept
        },
        difference=Difference(
            what=what,
            values=values_in_words(values, dimension),
            where=" ".join(filter(None, (place_in_words(runs[0].tree, first, at, titles), change))),
        ),
    )


def _usable_somewhere(runs: Sequence[Run], name: str, aligned: _Aligned, camera: str) -> np.ndarray:
    """Where a camera is usable in any run; everywhere for results that are not about depth."""
    like = aligned.values[0]
    if name != _OF_DEPTH or not camera or "distance" not in like.dims:
        return np.ones(like.shape, dtype=bool)
    flags = [
        group(run.tree, name)["usable"].sel(camera=camera).reindex_like(like.coords.to_dataset(), fill_value=False)
        for run in runs
    ]
    usable = np.logical_or.reduce([one.broadcast_like(like).transpose(*like.dims).values for one in flags])
    return np.asarray(usable, dtype=bool)


def _most_relevant(sizes: FloatArray, usable: np.ndarray) -> FloatArray:
    """The most relevant changes: where the camera is usable, if any; changes with a ratio before those without."""
    there = np.where(usable, sizes, 0.0)
    for some in (there, sizes):
        finite = np.where(np.isfinite(some), some, 0.0)
        for found in (finite, some):
            if found.any():
                return np.asarray(found)
    return sizes


def _is_share(values: xr.DataArray, arrays: Sequence[FloatArray]) -> bool:
    """Whether all values are shares of a whole, whose ratios near zero are meaningless."""
    if values.attrs.get("units") != "1" or values.dtype.kind != "f":
        return False
    known = np.concatenate([one[np.isfinite(one)].ravel() for one in arrays])
    return bool(known.size and known.min() >= 0.0 and known.max() <= 1.0)


def _size(first: FloatArray, other: FloatArray, *, is_share: bool) -> FloatArray:
    with np.errstate(divide="ignore", invalid="ignore"):  # a change without a ratio counts as infinite
        size = np.abs(other - first) if is_share else np.abs(other / first - 1.0)
    return np.where(np.isfinite(size) & np.isfinite(first) & np.isfinite(other), size, math.inf)

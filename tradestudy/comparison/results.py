"""Results that differ by more than their error, the largest difference first, and these errors."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import xarray as xr

from tradestudy.comparison.comparison import Difference, Run, titles_of
from tradestudy.results import JUDGED
from tradestudy.results.views.depth import field_words
from tradestudy.results.views.designs import path_words
from tradestudy.results.views.groups import FloatArray, group, has, records, swept_paths
from tradestudy.units import ANGLE, ELECTRONS, FRACTION, LENGTH, NUMBER, PIXELS, Dimension, pretty, significant
from tradestudy.wording import distance, fewest_digits, in_words

# As in decisions: by chance, over eight scrambles, one difference in a thousand exceeds this many standard errors.
SURE: Final = 5.4
ROUNDING: Final = 1e-9
"""Relative change of a value that another machine or library may cause."""
_CLOSED_FORM: Final = ("rounding", "exact")
_FROM_DRAWS: Final = "standard error"
_OF_THE_NORM: Final = "in the L2 norm over its pixels"
_DRAWN_OR_LINEAR: Final = "depth_uncertainty_error"


def error_name(data: xr.Dataset, variable: str) -> str | None:
    """The variable that contains the error of another; empty for rounding alone, None if no number states the error."""
    attributes = data[variable].attrs
    if "ancillary_variables" in attributes:
        return str(attributes["ancillary_variables"])
    return "" if any(word in str(attributes.get("error", "")) for word in _CLOSED_FORM) else None


def stated_error(tree: xr.DataTree, group_name: str, variable: str) -> xr.DataArray | None:
    """The error of each value of a variable, in its unit; None if no number states it.

    Standard errors count `SURE` times, measured and estimated errors once; the change due to everything that the
    applied models leave out is added where the run knows it. As in decisions, an error that could not be estimated
    counts as zero.
    """
    data = group(tree, group_name)
    error_variable = error_name(data, variable)
    if error_variable is None:
        return None
    values = abs(data[variable].astype(float))
    finite = values.where(np.isfinite(values), 0.0)
    # Far below the largest value, numbers differ by rounding alone.
    error = ROUNDING * xr.ones_like(finite) * (finite.max() if finite.size else 0.0)
    if error_variable:
        stored = data[error_variable].astype(float).fillna(0.0)
        stored = stored.max([dim for dim in stored.dims if dim not in values.dims])  # if it has more dimensions
        if _OF_THE_NORM in str(data[error_variable].attrs.get("comment", "")):  # at most, on a single pixel
            stored = stored * np.sqrt((finite**2).sum([dim for dim in finite.dims if dim not in stored.dims]))
        error = error + stored * _standard_errors(tree, data, error_variable)
    return error + _left_out(tree, data, variable) * finite


def _standard_errors(tree: xr.DataTree, data: xr.Dataset, error_variable: str) -> xr.DataArray | float:
    """Factor by which a stored error counts; by camera where it depends on how the depth errors were propagated."""
    says = str(data[error_variable].attrs.get("comment", ""))
    if error_variable != _DRAWN_OR_LINEAR and _DRAWN_OR_LINEAR not in says:
        return SURE if _FROM_DRAWS in says else 1.0
    return _by_camera(data, lambda key: standard_errors(tree, key))


def _by_camera(data: xr.Dataset, factor: Callable[[str], float]) -> xr.DataArray:
    keys = data["camera"].values
    return xr.DataArray([factor(str(key)) for key in keys], coords={"camera": keys}, dims="camera")


def standard_errors(tree: xr.DataTree, camera: str) -> float:
    """Factor by which the error of a depth uncertainty counts: `SURE` if draws give it, 1 if a linear model does."""
    if not has(tree, "effects", "problem_of", "slot", "model", "chosen"):
        return SURE
    effects = group(tree, "effects")
    drawn = (effects["slot"] == "calibration") & (effects["model"] == "exact") & (effects["chosen"] == 1)
    return SURE if camera in effects["problem_of"].values[drawn.values] else 1.0


def _left_out(tree: xr.DataTree, data: xr.Dataset, variable: str) -> xr.DataArray | float:
    if "camera" not in data[variable].dims:
        return 0.0
    return _by_camera(data, lambda key: left_out_share(tree, key, variable))


def left_out_share(tree: xr.DataTree, camera: str, quantity: str) -> float:
    """Relative change of a camera's quantity due to everything that its models leave out; 0 where it is unknown."""
    if not has(tree, "effects", "joint_change"):
        return 0.0
    changes = group(tree, "effects")["joint_change"]
    quantity = JUDGED[0] if quantity in JUDGED else quantity  # the plan knows the change of the larger of them
    if camera not in changes["problem"].values or quantity not in changes["quantity"].values:
        return 0.0
    return float(np.nan_to_num(changes.sel(problem=camera, quantity=quantity).item()))


def beyond(values: tuple[FloatArray, FloatArray], errors: tuple[FloatArray, FloatArray]) -> np.ndarray:
    """Where two arrays differ by more than both errors; a value known in only one of them differs."""
    first, other = values
    alike = (first == other) | (np.isnan(first) & np.isnan(other))
    with np.errstate(invalid="ignore"):  # ∞ − ∞, which counts as equal
        apart = np.abs(other - first) > np.hypot(*errors)
    finite = np.isfinite(first) & np.isfinite(other)
    return np.asarray(~alike & np.where(finite, apart, True))


_BY_UNIT: Final[Mapping[str, Dimension]] = {
    "m": LENGTH, "rad": ANGLE, "px": PIXELS, "1": NUMBER, "electrons": ELECTRONS,
}  # fmt: skip
_LABELS: Final[Mapping[tuple[str, str], str]] = {
    ("side", "nearer"): "to the nearer side",
    ("side", "farther"): "to the farther side",
    ("error_source", "noise"): "noise only",
    ("error_source", "calibration"): "calibration only",
    ("error_source", "both"): "noise and calibration",
}
_UNNAMED_GROUPS: Final = ("depth", "depth_at_places", "disparity_causes")
_MOST_PERCENT: Final = 1000.0


def group_words(group_name: str) -> str:
    """The group of a variable in brackets, where the variable's name alone is ambiguous."""
    return "" if group_name in _UNNAMED_GROUPS else f" ({group_name.replace('_', ' ')})"


def known_dimension(array: xr.DataArray) -> Dimension | None:
    """The dimension of an array; None if its unit is not a known one."""
    return _BY_UNIT.get(str(array.attrs.get("units", "")))


def values_in_words(values: Sequence[float], dimension: Dimension | None) -> tuple[str, ...]:
    """Values with their unit and the digits that distinguish different ones; "none" for NaN."""
    different = len({value for value in values if not math.isnan(value)}) + any(map(math.isnan, values))

    def written(digits: int) -> tuple[str, ...]:
        return tuple(_written(value, dimension, digits) for value in values)

    return written(fewest_digits(lambda digits: len(set(written(digits))) >= different))


def _written(value: float, dimension: Dimension | None, digits: int) -> str:
    if math.isnan(value):
        return "none"
    return significant(value, digits) if dimension is None else pretty(value, dimension, digits)


def changes_in_words(values: Sequence[float]) -> str:
    """How much each value differs from the first, in brackets."""
    return f"({', '.join(_percent(values[0], value) for value in values[1:])})"


def _percent(before: float, after: float) -> str:
    """A change in per cent; beyond 1000 %, as a factor."""
    percent = 100.0 * (after / before - 1.0)
    if abs(percent) > _MOST_PERCENT:
        return f"{significant(after / before)} times"
    text = f"{percent:+.0f}" if abs(percent) >= 100.0 else f"{percent:+.2g}"
    return f"{text.replace('-', '−')} %"


def place_in_words(tree: xr.DataTree, values: xr.DataArray, at: tuple[int, ...], titles: Mapping[str, str]) -> str:
    """A place in an array, in words, without coordinates that do not matter: "at 2 m, noise only", "for f number 2"."""
    parts = [
        _coordinate(tree, dim, values[dim], at[axis], titles)
        for axis, dim in enumerate(map(str, values.dims))
        if dim.endswith("distance") or varies(values, axis, at)
    ]
    parts.sort(key=lambda part: not part.startswith("at "))
    return ("" if not parts or parts[0].startswith("at ") else "for ") + ", ".join(parts)


def varies(values: xr.DataArray, axis: int, at: tuple[int, ...]) -> bool:
    """Whether the values at a place vary along an axis."""
    here = np.moveaxis(np.asarray(values.values, dtype=np.float64), axis, -1)[(*at[:axis], *at[axis + 1 :])]
    return len(set(here[~np.isnan(here)].tolist())) > 1


def _coordinate(tree: xr.DataTree, dim: str, coordinate: xr.DataArray, position: int, titles: Mapping[str, str]) -> str:
    if dim not in coordinate.coords:
        return f"{dim.replace('_', ' ')} {position + 1}"
    label: Any = coordinate.values[position]
    if dim == "field":
        return field_words(float(label))
    if dim == "corner":
        return f"towards the {label} corner"
    words = path_words(tree, dim) if "path" in coordinate.attrs else in_words(dim)  # swept
    if isinstance(label, str):
        return _LABELS.get((dim, label), f"{words} {titles.get(label, label)}")
    if dim.endswith("distance"):
        return f"at {distance(float(label))}"
    return f"{words} {values_in_words((float(label),), known_dimension(coordinate))[0]}"


# Declared values, conclusions, or computing times, which other parts of the comparison cover.
_COVERED_ELSEWHERE: Final = (
    "assumptions", "cameras", "claims", "contradictions", "cost", "datasheet", "decision", "effects", "requirements",
)  # fmt: skip
_OF_PLACES, _OF_DEPTH, _REQUIREMENTS = "depth_at_places", "depth", "requirements"
_UNCERTAINTY, _RADIUS = "depth_uncertainty", "depth_error_radius"
_PARTS_OF_DEPTH: Final = (
    "depth_uncertainty_by_error_source", "depth_error_radius_by_error_source", "depth_quantile", "equivalent_baseline",
    "limit_value", "usable_near", "usable_far", "relative_uncertainty",
)  # fmt: skip
# They repeat another variable, or the conclusions.
_REPETITIONS: Final[Mapping[str, tuple[str, ...]]] = {
    _OF_DEPTH: _PARTS_OF_DEPTH,
    _OF_PLACES: _PARTS_OF_DEPTH,
    "depth_field": _PARTS_OF_DEPTH,
    "depth_map": ("relative_uncertainty",),
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
        The swept values there, by dimension; empty without a sweep.
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
    for group_name, variable in _variables(runs):
        aligned = _aligned(runs, group_name, variable)
        if not aligned:
            apart += [f"{in_words(variable)}{group_words(group_name)}"] * (variable != _RADIUS)
            continue
        cameras = map(str, aligned[0]["camera"].values) if "camera" in aligned[0]["value"].dims else ("",)
        for camera in cameras:
            of_camera = [table.sel(camera=camera) for table in aligned] if camera else aligned
            changed = _largest(runs, titles, group_name, variable, camera, of_camera)
            if changed is not None:
                moved.append(changed)
            elif variable != _RADIUS:
                within += 1
    # The radius repeats the depth uncertainty unless a bias or failures alone change.
    spread = {(result.group, result.camera) for result in moved if result.variable == _UNCERTAINTY}
    moved = [result for result in moved if result.variable != _RADIUS or (result.group, result.camera) not in spread]
    worst = list(_worst_values(runs))
    moved += [result for result in worst if result is not None]
    within += worst.count(None)
    return Results(
        moved=tuple(sorted(moved, key=lambda result: -result.size)),
        within_error=within,
        apart=tuple(dict.fromkeys(apart)),
    )


def _worst_values(runs: Sequence[Run]) -> Iterator[ChangedResult | None]:
    """Worst values of requirements whose verdict and camera stay the same; None where they agree within their error."""
    tables = [{str(row["requirement"]): row for row in records(run.tree, _REQUIREMENTS, "requirement")} for run in runs]
    for requirement in tables[0]:
        rows = [table[requirement] for table in tables if requirement in table]
        if len(rows) == len(runs) and len({(row["met"], row["camera_deciding"]) for row in rows}) == 1:
            yield _worst_value(runs, rows)


def _worst_value(runs: Sequence[Run], rows: Sequence[Mapping[str, Any]]) -> ChangedResult | None:
    camera = str(rows[0]["camera_deciding"])
    values = [float(row["value"]) for row in rows]
    shares = [left_out_share(run.tree, camera, str(rows[0]["quantity"])) + ROUNDING for run in runs]
    errors = [
        standard_errors(run.tree, camera) * float(np.nan_to_num(row["value_error"])) + share * abs(value)
        for run, row, share, value in zip(runs, rows, shares, values, strict=True)
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
            what=f'requirement "{rows[0]["says"]}"',
            values=tuple(str(row["reason"]) for row in rows),
            where=changes_in_words(values),
        ),
    )


def _variables(runs: Sequence[Run]) -> Iterator[tuple[str, str]]:
    """Groups and variables with known errors that every run contains and nothing else covers."""
    for group_name in runs[0].tree.children:
        if group_name in _COVERED_ELSEWHERE or not all(group_name in run.tree.children for run in runs):
            continue
        # The curves show these changes, unless the runs computed them at different distances.
        if group_name == _OF_PLACES and _has_common_distances(runs):
            continue
        tables = [group(run.tree, group_name) for run in runs]
        for variable in map(str, tables[0].data_vars):
            if (
                variable not in _REPETITIONS.get(group_name, ())
                and all(variable in table and table[variable].dtype.kind in "fiu" for table in tables)
                and all(error_name(table, variable) is not None for table in tables)
            ):
                yield group_name, variable


def _has_common_distances(runs: Sequence[Run]) -> bool:
    grids = [group(run.tree, _OF_DEPTH)["distance"].values for run in runs if _OF_DEPTH in run.tree.children]
    return len(grids) == len(runs) and all(np.isin(grids[0], other).any() for other in grids[1:])


def _aligned(runs: Sequence[Run], group_name: str, variable: str) -> list[xr.Dataset]:
    """A variable of every run, ``value``, and its ``error``, at the places that all runs share; empty if none are."""
    tables = []
    for run in runs:
        values, error = group(run.tree, group_name)[variable], stated_error(run.tree, group_name, variable)
        assert error is not None  # callers pass only variables with known errors
        tables.append(xr.Dataset({"value": values.astype(float), "error": error.broadcast_like(values)}))
    first = tables[0]
    # Dimensions without labels cannot be aligned, only compared in size.
    bare = [dim for dim in first["value"].dims if dim not in first.coords]
    if any(
        set(table["value"].dims) != set(first["value"].dims) or swept_paths(table) != swept_paths(first)
        for table in tables
    ):
        return []
    if any(table.sizes[dim] != first.sizes[dim] for table in tables for dim in bare):
        return []
    aligned = [table.transpose(*first["value"].dims) for table in xr.align(*tables, join="inner")]
    return aligned if aligned[0]["value"].size else []


def _largest(
    runs: Sequence[Run],
    titles: Mapping[str, str],
    group_name: str,
    variable: str,
    camera: str,
    aligned: Sequence[xr.Dataset],
) -> ChangedResult | None:
    """Where a result differs most from the first run, among the places where it differs by more than its error."""
    first = aligned[0]["value"]
    arrays = [np.asarray(table["value"].values, dtype=np.float64) for table in aligned]
    errors = [np.asarray(table["error"].values, dtype=np.float64) for table in aligned]
    is_share = _is_share(first, arrays)
    sizes = [
        np.where(beyond((arrays[0], other), (errors[0], error)), _size(arrays[0], other, is_share=is_share), 0.0)
        for other, error in zip(arrays[1:], errors[1:], strict=True)
    ]
    largest = _most_relevant(np.max(sizes, axis=0), _usable_somewhere(runs, group_name, first, camera))
    # The first of changes that are equal but for rounding, which would otherwise choose the place.
    first_of_largest = int(np.argmax(largest >= np.max(largest) * (1.0 - ROUNDING)))
    position = tuple(map(int, np.unravel_index(first_of_largest, largest.shape)))
    size = float(largest[position])
    if size == 0.0:
        return None
    values = [float(array[position]) for array in arrays]
    dimension = FRACTION if is_share else known_dimension(first)
    what = in_words(variable) + (f" of {titles[camera]}" if camera in titles else "") + group_words(group_name)
    change = "" if is_share or not math.isfinite(size) else changes_in_words(values)
    return ChangedResult(
        group=group_name,
        variable=variable,
        camera=camera,
        size=size,
        design={
            dim: first[dim].values[position[axis]]
            for axis, dim in enumerate(map(str, first.dims))
            if "path" in first[dim].attrs and varies(first, axis, position)  # swept
        },
        difference=Difference(
            what=what,
            values=values_in_words(values, dimension),
            where=" ".join(filter(None, (place_in_words(runs[0].tree, first, position, titles), change))),
        ),
    )


def _usable_somewhere(runs: Sequence[Run], group_name: str, like: xr.DataArray, camera: str) -> np.ndarray:
    """Where a camera is usable in any run; everywhere for results that are not about depth."""
    if group_name != _OF_DEPTH or not camera or "distance" not in like.dims:
        return np.ones(like.shape, dtype=bool)
    flags = [
        group(run.tree, group_name)["usable"]
        .sel(camera=camera)
        .reindex_like(like.coords.to_dataset(), fill_value=False)
        for run in runs
    ]
    usable = np.logical_or.reduce([flag.broadcast_like(like).transpose(*like.dims).values for flag in flags])
    return np.asarray(usable, dtype=bool)


def _most_relevant(sizes: FloatArray, usable: np.ndarray) -> FloatArray:
    """The most relevant changes: where the camera is usable, if any; changes with a ratio before those without."""
    inside = np.where(usable, sizes, 0.0)
    for considered in (inside, sizes):
        finite = np.where(np.isfinite(considered), considered, 0.0)
        for relevant in (finite, considered):
            if relevant.any():
                return np.asarray(relevant)
    return sizes


def _is_share(values: xr.DataArray, arrays: Sequence[FloatArray]) -> bool:
    """Whether all values are shares of a whole, whose ratios near zero are meaningless."""
    if values.attrs.get("units") != "1" or values.dtype.kind != "f":
        return False
    finite = np.concatenate([array[np.isfinite(array)].ravel() for array in arrays])
    return bool(finite.size and finite.min() >= 0.0 and finite.max() <= 1.0)


def _size(first: FloatArray, other: FloatArray, *, is_share: bool) -> FloatArray:
    with np.errstate(divide="ignore", invalid="ignore"):  # a change without a ratio counts as infinite
        size = np.abs(other - first) if is_share else np.abs(other / first - 1.0)
    return np.where(np.isfinite(size) & np.isfinite(first) & np.isfinite(other), size, math.inf)

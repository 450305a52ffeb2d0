"""Access to the groups of a results tree, as datasets and row by row, and to the cameras of a study in order."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from tradestudy.results import UNCONVERGED
from tradestudy.wording import distance, few

FloatArray = npt.NDArray[np.float64]


def has(tree: xr.DataTree, group_name: str, *variables: str) -> bool:
    """Whether a group exists and contains all these variables."""
    return group_name in tree.children and all(variable in tree[group_name].data_vars for variable in variables)


def group(tree: xr.DataTree, group_name: str) -> xr.Dataset:
    """Get a group as a dataset."""
    return tree[group_name].to_dataset()


def swept_paths(data: xr.Dataset | xr.DataTree) -> dict[str, str]:
    """The paths in the study of the swept parameters of a group, by dimension."""
    variables = data.coords.variables  # a DataArray for each of them would take a hundred times as long
    return {
        str(dim): str(coordinate.attrs["path"]) for dim, coordinate in variables.items() if "path" in coordinate.attrs
    }


def dotted_path(tree: xr.DataTree, name: str) -> str:
    """The path in the study of a swept parameter that is a dimension of the results; any other name as it is."""
    return next((paths[name] for node in tree.children.values() if name in (paths := swept_paths(node))), name)


def records(tree: xr.DataTree, group_name: str, dim: str) -> list[dict[str, Any]]:
    """Read the one-dimensional variables of a group row by row; key `dim` contains the label of the row."""
    if group_name not in tree.children or dim not in tree[group_name].sizes:
        return []
    data = group(tree, group_name)
    columns = {dim: data[dim].values}
    columns |= {str(column): array.values for column, array in data.data_vars.items() if array.dims == (dim,)}
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def ranges_of(near: npt.ArrayLike, far: npt.ArrayLike) -> tuple[tuple[float, float], ...]:
    """Ranges of distance [m], as (near, far), from padded arrays of their ends; `far` may be infinite."""
    ends = zip(np.ravel(np.asarray(near)), np.ravel(np.asarray(far)), strict=True)
    return tuple((float(a), float(b)) for a, b in ends if np.isfinite(a) and not np.isnan(b))


def camera_titles(tree: xr.DataTree) -> dict[str, str]:
    """Get the titles of all cameras by their keys."""
    return _by_key(tree, "title")


def camera_families(tree: xr.DataTree) -> dict[str, str]:
    """Get the families of all cameras by their keys."""
    return _by_key(tree, "family")


def origin_words(tree: xr.DataTree) -> list[str]:
    """From where the distances of cameras with distant pupils or a declared front count, and how long working ones are.

    Each a clause without a full stop; thin lenses without a front are left out.
    """
    titles_of: dict[str, list[str]] = {}
    for row in records(tree, "cameras", "camera"):
        front, origin = float(row.get("front", math.nan)), str(row.get("distance_origin", ""))
        if math.isnan(front) and origin in ("", "principal plane"):
            continue
        shorter = "" if math.isnan(front) else f"; working distances, from the front, are {distance(abs(front))} "
        clause = f"count from the {origin}{shorter}{'' if not shorter else 'shorter' if front >= 0.0 else 'longer'}"
        titles_of.setdefault(clause, []).append(str(row["title"]))
    return [f"Distances of {few(titles)} {clause}" for clause, titles in titles_of.items()]


def titles_in(tree: xr.DataTree, group_name: str) -> dict[str, str]:
    """Get the titles of the cameras in a group: in ``depth``, for instance, of those that measure depth."""
    keys = {str(key) for key in group(tree, group_name)["camera"].values}
    return {key: title for key, title in camera_titles(tree).items() if key in keys}


def depth_methods(tree: xr.DataTree) -> dict[str, dict[str, Any]]:
    """Get the method by which each camera measures depth, by camera key; cameras that measure no depth are left out."""
    return {key: json.loads(method) for key, method in _by_key(tree, "method").items() if method}


def _by_key(tree: xr.DataTree, variable: str) -> dict[str, str]:
    data = group(tree, "cameras")
    return {str(key): str(value) for key, value in zip(data["camera"].values, data[variable].values, strict=True)}


def perfectly_calibrated(tree: xr.DataTree) -> tuple[str, ...]:
    """Titles of the cameras that measure depth without calibration errors: none are declared, or they are off."""
    if not has(tree, "cameras", "perfect_calibration"):
        return ()
    cameras = group(tree, "cameras")
    return tuple(str(title) for title in cameras["title"].values[cameras["perfect_calibration"].values > 0.0])


def left_out(tree: xr.DataTree) -> tuple[str, ...]:
    """What of the declarations of cameras acts only in part, each with the title of its camera."""
    if not has(tree, "cameras", "left_out"):
        return ()
    rows = records(tree, "cameras", "camera")
    return tuple(f"{row['title']}: {row['left_out']}" for row in rows if row["left_out"])


def unconverged(tree: xr.DataTree) -> tuple[str, ...]:
    """Titles of the cameras whose fitted calibration did not converge, each with the failed checks in brackets.

    First as declared, then under the values of readings and designs.
    """
    others = tuple(str(tree.attrs.get(UNCONVERGED, "")).splitlines())
    if not has(tree, "calibration", "posterior_converged"):
        return others
    titles, rows = camera_titles(tree), records(tree, "calibration", "posterior")
    declared = (
        f"{titles[str(row['posterior'])]} ({row['posterior_verdict']})"
        for row in rows
        if not row["posterior_converged"]
    )
    return (*declared, *others)


def consequences(tree: xr.DataTree) -> tuple[tuple[str, str], ...]:
    """The cameras with contradictory inputs, and what these do to the answers, without a full stop."""
    if not has(tree, "contradictions", "consequence"):
        return ()
    titles = camera_titles(tree)
    rows = [row for row in records(tree, "contradictions", "contradiction") if row["consequence"]]
    return tuple((titles.get(str(row["camera"]), str(row["camera"])), str(row["consequence"])) for row in rows)

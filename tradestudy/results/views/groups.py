"""Groups of a results tree: whether they are there, as datasets, and row by row."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

FloatArray = npt.NDArray[np.float64]


def has(tree: xr.DataTree, name: str, *variables: str) -> bool:
    """Whether a group exists and holds all these variables."""
    return name in tree.children and all(variable in tree[name].data_vars for variable in variables)


def group(tree: xr.DataTree, name: str) -> xr.Dataset:
    """Get a group as a dataset."""
    return tree[name].to_dataset()


def records(tree: xr.DataTree, name: str, dim: str) -> list[dict[str, Any]]:
    """Read the one-dimensional variables of a group row by row; the row's own name is under `dim`."""
    if name not in tree.children:
        return []
    data = group(tree, name)
    columns = [str(column) for column, array in data.data_vars.items() if array.dims == (dim,)]
    return [
        {dim: data[dim].values[index]} | {column: data[column].values[index] for column in columns}
        for index in range(data.sizes.get(dim, 0))
    ]


def attribute(tree: xr.DataTree, name: str) -> str:
    """Get an attribute of the root as text."""
    return str(tree.attrs.get(name, ""))


def stretches(near: npt.ArrayLike, far: npt.ArrayLike) -> tuple[tuple[float, float], ...]:
    """Stretches of distance [m], (near, far), from arrays of their ends, without the padding; `far` may be infinite."""
    ends = zip(np.ravel(np.asarray(near)), np.ravel(np.asarray(far)), strict=True)
    return tuple((float(a), float(b)) for a, b in ends if np.isfinite(a) and not np.isnan(b))

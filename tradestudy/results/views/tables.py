"""Results as tables: one for each group and each set of dimensions among its variables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from tradestudy.errors import OutOfRangeError, nearest
from tradestudy.results.views.groups import swept_paths

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


_SAME_PLACE: Final = 5e-3  # of a distance: what three digits leave open


@dataclass(frozen=True, kw_only=True)
class Table:
    """The variables of a group that share their dimensions.

    Parameters
    ----------
    data
        The group.
    dims
        The dimensions; none for single values.
    variables
        Names of the variables.
    """

    data: xr.Dataset
    dims: tuple[str, ...]
    variables: tuple[str, ...]

    @property
    def swept(self) -> tuple[str, ...]:
        """The dimensions that are swept parameters."""
        paths = swept_paths(self.data)
        return tuple(dim for dim in self.dims if dim in paths)

    def frame(self) -> pd.DataFrame:
        """One row for each combination of coordinates; ``attrs["units"]`` contains the unit of each column."""
        import pandas as pd

        chosen = self.data[list(self.variables)]
        frame = chosen.to_dataframe(dim_order=list(self.dims)) if self.dims else pd.DataFrame([chosen.to_pandas()])
        frame = frame[list(self.variables)]
        frame.attrs["units"] = {variable: self.data[variable].attrs.get("units", "") for variable in self.variables}
        return frame


def tables_of(tree: xr.DataTree) -> Mapping[str, Table]:
    """All tables of a results tree by name, such as ``depth_by_camera_distance``.

    A sweep adds columns to a table but keeps its name, unless the group has another table of that name.
    """
    tables = {}
    for group in tree.children.values():
        data, swept = group.to_dataset(), swept_paths(group)
        by_dims: dict[tuple[str, ...], list[str]] = {}
        for variable, array in data.data_vars.items():
            by_dims.setdefault(tuple(map(str, array.dims)), []).append(str(variable))
        for dims, names in by_dims.items():
            unswept = tuple(dim for dim in dims if dim not in swept)
            named = dims if unswept in by_dims else unswept
            over = "_by_" + "_".join(named) if named else ""
            tables[f"{group.name}{over}".replace("/", "_")] = Table(data=data, dims=dims, variables=tuple(names))
    return tables


def table_named(tree: xr.DataTree, name: str) -> Table:
    """One table of a results tree.

    Raises
    ------
    OutOfRangeError
        If the results have no such table; the message lists those that exist.
    """
    tables = tables_of(tree)
    if name not in tables:
        close = nearest(name, tables)
        remedy = "" if close is None else f"nearest: '{close}'"
        raise OutOfRangeError("these results have no such table", value=name, limit=", ".join(tables), remedy=remedy)
    return tables[name]


def budget_frame(tree: xr.DataTree, camera: str, distance: float) -> pd.DataFrame:
    """The uncertainty budget of a camera at a distance [m]: one row per input or correlated pair of inputs.

    Raises
    ------
    OutOfRangeError
        The results have no budget, or none of this camera or at this distance; the message lists those that exist.
    """
    if "budget" not in tree.children:
        raise OutOfRangeError(
            "these results have no uncertainty budget",
            value=", ".join(tree.children),
            limit="a study with cameras that measure depth and, if it sweeps values, decision.at",
            remedy="run such a study",
        )
    data = tree["budget"].to_dataset()
    cameras, distances = data["camera"].to_numpy().tolist(), data["distance"].to_numpy()
    if camera not in cameras:
        raise OutOfRangeError("no camera with a budget has this key", value=camera, limit=", ".join(cameras))
    nearest_place = int(np.argmin(np.abs(distances - distance)))
    # Negated, so that NaN is refused as well.
    if not abs(distances[nearest_place] - distance) <= _SAME_PLACE * distance:
        raise OutOfRangeError(
            "no uncertainty budget at this distance",
            value=f"{distance:g} m",
            limit=", ".join(f"{present:g} m" for present in distances),
            remedy="add the distance to decision.at",
        )
    budget = data.isel(distance=nearest_place).sel(camera=camera).drop_vars("camera")
    rows = budget[[variable for variable in budget.data_vars if "source" in budget[variable].dims]]
    of_camera = (rows["distribution"] != "") | np.isfinite(rows["correlation"])
    frame = rows.drop_vars("distance").isel(source=np.flatnonzero(of_camera)).to_dataframe()
    frame.attrs["units"] = {variable: rows[variable].attrs["units"] for variable in map(str, rows.data_vars)}
    frame.attrs |= {str(name): float(value) for name, value in budget.variables.items() if not value.dims}
    return frame

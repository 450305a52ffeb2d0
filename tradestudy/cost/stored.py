"""Costs on disk: in files of their own beside the results, whole or not at all, and read by runs of the same study."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, Final

import numpy as np
import xarray as xr

from tradestudy.machine import identity
from tradestudy.results import GROUPS
from tradestudy.storage import replacing

COST: Final = "cost.nc"
SUMMARY: Final = "cost.json"


def write_cost(cost: xr.Dataset, directory: Path) -> None:
    """Write ``cost.nc`` and, for people, ``cost.json``."""
    content = xr.DataTree.from_dict({"/cost": cost}).to_netcdf(engine="h5netcdf")
    with replacing(directory / SUMMARY) as temporary:
        temporary.write_text(json.dumps(_summary(cost), indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    with replacing(directory / COST) as temporary:
        temporary.write_bytes(content)


def read_cost(directory: Path, study_hash: str) -> xr.Dataset | None:
    """The last cost of a study on this machine; None where there is none, or only one that cannot be shown.

    That is one of another study or machine, a damaged one, or one of an older program with other variables.

    Parameters
    ----------
    directory
        The study's output folder.
    study_hash
        Of the study that asks.
    """
    try:
        with xr.open_datatree(directory / COST, engine="h5netcdf") as opened:
            cost = opened["cost"].to_dataset().load()
        machine = json.loads(str(cost.attrs["machine"]))
    except (OSError, ValueError, KeyError, RuntimeError):
        return None
    whole = set(map(str, cost.data_vars)) == set(GROUPS["cost"])
    return cost if whole and cost.attrs.get("study_hash") == study_hash and machine == identity() else None


def _summary(cost: xr.Dataset) -> dict[str, Any]:
    """Entries as rows, and what they are of."""
    names = [str(name) for name, array in cost.data_vars.items() if array.dims == ("entry",)]
    quantities = [str(name) for name, array in cost.data_vars.items() if array.dims[:1] == ("cost_quantity",)]
    return {
        **{key: _plain(value) for key, value in cost.attrs.items()},
        "digit": _plain(cost["digit"].values),
        "quantities": {
            str(key): {name: _plain(cost[name].values[row]) for name in quantities}
            for row, key in enumerate(cost["cost_quantity"].values)
        },
        "entries": [{name: _plain(cost[name].values[row]) for name in names} for row in range(cost.sizes["entry"])],
    }


def _plain(value: Any) -> Any:
    """A value as JSON can hold it: no infinity, no NaN."""
    if isinstance(value, np.ndarray):
        return [_plain(one) for one in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else str(value)
    return value

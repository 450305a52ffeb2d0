"""Costs on disk: in files of their own beside the results, whole or not at all, and read by runs of the same study."""

from __future__ import annotations

import json
import math
import shlex
from pathlib import Path
from typing import Any, Final

import numpy as np
import xarray as xr

from tradestudy.machine import identity
from tradestudy.results import GROUPS
from tradestudy.results.storage import replacing

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
    cost = _read(directory)
    return cost if cost is not None and not _why_not(cost, study_hash) else None


def why_not_shown(directory: Path, study_hash: str) -> str:
    """Why a cost that lies there is none that `read_cost` finds, as the end of a sentence; empty where it is found.

    Parameters
    ----------
    directory, study_hash
        As for `read_cost`.
    """
    cost = _read(directory)
    return "" if cost is None else _why_not(cost, study_hash)


def _read(directory: Path) -> xr.Dataset | None:
    """What lies there; None for nothing, and for what is damaged."""
    try:
        with xr.open_datatree(directory / COST, engine="h5netcdf") as opened:
            cost = opened["cost"].to_dataset().load()
        json.loads(str(cost.attrs["machine"]))
    except (OSError, ValueError, KeyError, RuntimeError):
        return None
    return cost


def _why_not(cost: xr.Dataset, study_hash: str) -> str:
    if cost.attrs.get("study_hash") != study_hash:
        options = json.loads(str(cost.attrs.get("options", "null")))
        how = (
            "by an earlier program"
            if options is None
            else f"with {shlex.join(options)}"
            if options
            else "without options"
        )
        return f"was measured for {cost.attrs.get('study')} as it stood then, {how}"
    if json.loads(str(cost.attrs["machine"])) != identity():
        return "was measured on another machine"
    if set(map(str, cost.data_vars)) != set(GROUPS["cost"]):
        return "was measured by an earlier program, which measured other things"
    return ""


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

"""Results over the designs of a sweep, with the swept parameters as leading dimensions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import xarray as xr

from tradestudy.results import dataset
from tradestudy.study.varying import SweepAxis


def over_designs(
    group: str,
    values: Mapping[str, Any],
    coordinates: Mapping[str, Any],
    axes: Sequence[SweepAxis],
    attributes: Mapping[str, Any] | None = None,
) -> xr.Dataset:
    """A group of results whose variables may start with the swept parameters, in the order of the axes."""
    swept = {axis.path: list(axis.labels) for axis in axes}
    result = dataset(group, values, {**swept, **coordinates}, leading=tuple(swept), attributes=attributes)
    for axis in axes:
        result[axis.path].attrs = {
            "units": axis.units,
            "long_name": axis.path,
            "declared": axis.declared,
            "measures": "" if axis.dimension is None else axis.dimension.name,
        }
    return result

"""The group ``/depth_of_field``: the blur criterion of the answer, and where a camera is sharp by it."""

from __future__ import annotations

import xarray as xr

from tradestudy.results.views.groups import group, stretches


def by_first_criterion(tree: xr.DataTree) -> xr.Dataset:
    """``/depth_of_field`` by the blur criterion of the answer: the first."""
    return group(tree, "depth_of_field").isel(sharp=0)


def sharp_stretches(one: xr.Dataset, name: str) -> tuple[tuple[float, float], ...]:
    """Stretches of distance [m] of one camera by one criterion, (near, far): ``sharp``, ``slice`` or ``gap``."""
    return stretches(one[f"{name}_near"].values, one[f"{name}_far"].values)

"""What depth uncertainty is made of most, by its declared parts and by its drawn sources."""

from __future__ import annotations

import numpy as np
import xarray as xr

from tradestudy.results.views.groups import group


def largest_part(depth: xr.Dataset, camera: str, distance: float) -> str | None:
    """The part that alone gives the largest uncertainty at the computed distance nearest to one [m], if any does."""
    parts = depth["depth_uncertainty_part"].sel(camera=camera).sel(distance=distance, method="nearest")
    return _largest(parts, "part")


def largest_source(tree: xr.DataTree, camera: str, distance: float) -> str | None:
    """The source that alone gives the largest uncertainty on the axis at a computed distance [m], if any does."""
    sources = group(tree, "sensitivity")["source_uncertainty"].sel(camera=camera, field="axis", distance=distance)
    return _largest(sources, "source")


def _largest(values: xr.DataArray, dim: str) -> str | None:
    array = np.asarray(values.values, dtype=np.float64)
    return str(values[dim].values[int(np.nanargmax(array))]) if np.isfinite(array).any() else None

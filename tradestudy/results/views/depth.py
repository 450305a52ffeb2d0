"""Depth of one design and depth of field: arrays by camera, where each is usable or sharp, what decides it most."""

from __future__ import annotations

import numpy as np
import xarray as xr

from tradestudy.results.depth import distances_without_decision
from tradestudy.results.views.groups import FloatArray, group, has, stretches
from tradestudy.units import significant


def swept(depth: xr.Dataset) -> tuple[str, ...]:
    """The names of the swept parameters: the dimensions that a study without a sweep does not have."""
    return tuple(str(d) for d in depth["depth_uncertainty"].dims if d not in ("camera", "distance"))


def nominal(tree: xr.DataTree) -> xr.Dataset:
    """``/depth`` of one design: the declared value of every swept parameter, or the first where that is not swept."""
    depth = group(tree, "depth")
    return depth.isel({name: _declared_place(depth[name]) or 0 for name in swept(depth)})


def nominal_is_declared(tree: xr.DataTree) -> bool:
    """Whether the design of :func:`nominal` is the one that the study declares, and ``/decision`` is about."""
    depth = group(tree, "depth")
    return all(_declared_place(depth[name]) is not None for name in swept(depth))


def _declared_place(coordinate: xr.DataArray) -> int | None:
    """Where the declared value, which the coordinate carries as an attribute, stands among the swept ones."""
    same = np.flatnonzero(coordinate.values == coordinate.attrs.get("declared"))
    return int(same[0]) if same.size else None


def of_camera(depth: xr.Dataset, variable: str, camera: str, **where: str) -> FloatArray:
    """One variable of one camera, over distance."""
    return np.asarray(depth[variable].sel({"camera": camera, **where}).values, dtype=np.float64)


def where_usable(depth: xr.Dataset, camera: str) -> tuple[tuple[float, float], ...]:
    """Where a camera is usable, as (near, far) in metres; empty where it nowhere is."""
    return stretches(of_camera(depth, "usable_near", camera), of_camera(depth, "usable_far", camera))


def broken_limits(camera: xr.Dataset) -> tuple[tuple[str, ...], float]:
    """The limits that a camera breaks where it breaks fewest, and that distance [m], of ``/depth`` of one camera."""
    broken = camera["limit_met"].transpose("distance", "limit").values == 0
    best = int(np.argmin(broken.sum(axis=1)))
    return tuple(map(str, camera["limit"].values[broken[best]])), float(camera["distance"].values[best])


def field_words(field: float) -> str:
    """Name a place in the field: 0 the axis, 1 the corner of the sensor."""
    return f"{significant(100.0 * field)} % of the way to the corner" if field else "on the axis"


def told_places(tree: xr.DataTree) -> FloatArray:
    """Get the distances [m] of tables: those declared; without a decision, a few from end to end of the range."""
    if has(tree, "decision") and "place" in tree["decision"].coords:
        return np.asarray(group(tree, "decision")["place"].values, dtype=np.float64)
    return distances_without_decision(np.asarray(group(tree, "depth")["distance"].values, dtype=np.float64))


def told_depth(tree: xr.DataTree) -> xr.Dataset:
    """Depth at the declared distances themselves; on the study's grid where none are declared."""
    return group(tree, "depth_at_places") if has(tree, "depth_at_places") else nominal(tree)


def by_first_criterion(tree: xr.DataTree) -> xr.Dataset:
    """``/depth_of_field`` by the blur criterion of the answer: the first."""
    return group(tree, "depth_of_field").isel(sharp=0)


def sharp_stretches(one: xr.Dataset, name: str) -> tuple[tuple[float, float], ...]:
    """Stretches of distance [m] of one camera by one criterion, (near, far): ``sharp``, ``slice`` or ``gap``."""
    return stretches(one[f"{name}_near"].values, one[f"{name}_far"].values)


def largest_part(depth: xr.Dataset, camera: str, distance: float) -> str | None:
    """The part with the largest share of the variance at the computed distance nearest to one [m], if it is known."""
    return _largest(shares_at(depth, camera, distance), "part")


def shares_at(depth: xr.Dataset, camera: str, distance: float) -> xr.DataArray:
    """The shares of the variance of inverse depth over the parts, at the computed distance nearest to one [m]."""
    return depth["variance_share"].sel(camera=camera).sel(distance=distance, method="nearest")


def decided_by_calibration(depth: xr.Dataset, camera: str) -> bool:
    """Whether anything but the noise of a measurement moves what a camera reads."""
    return bool(np.nanmax(np.append(of_camera(depth, "depth_uncertainty_way", camera, way="calibration"), 0.0)) > 0.0)


def largest_source(tree: xr.DataTree, camera: str, distance: float) -> str | None:
    """The source that alone gives the largest uncertainty on the axis at a distance of ``/sensitivity`` [m], if any."""
    sources = group(tree, "sensitivity")["source_uncertainty"].sel(camera=camera, field=0.0, distance=distance)
    return _largest(sources, "source")


def _largest(values: xr.DataArray, dim: str) -> str | None:
    array = np.asarray(values.values, dtype=np.float64)
    return str(values[dim].values[int(np.nanargmax(array))]) if np.isfinite(array).any() else None

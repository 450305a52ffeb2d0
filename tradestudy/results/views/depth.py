"""Views of depth and depth of field: arrays by camera, usable and sharp ranges, and the largest error sources."""

from __future__ import annotations

import numpy as np
import xarray as xr

from tradestudy.results.depth import distances_without_decision
from tradestudy.results.views.groups import FloatArray, group, has, ranges_of
from tradestudy.units import significant


def swept(depth: xr.Dataset) -> tuple[str, ...]:
    """The names of the swept parameters: the dimensions of ``/depth`` beside camera and distance."""
    return tuple(str(d) for d in depth["depth_uncertainty"].dims if d not in ("camera", "distance"))


def nominal(tree: xr.DataTree) -> xr.Dataset:
    """``/depth`` of one design: every swept parameter at its declared value, or at its first if that is not swept."""
    depth = group(tree, "depth")
    return depth.isel({name: _declared_place(depth[name]) or 0 for name in swept(depth)})


def nominal_is_declared(tree: xr.DataTree) -> bool:
    """Whether :func:`nominal` returns the declared design, which ``/decision`` describes."""
    depth = group(tree, "depth")
    return all(_declared_place(depth[name]) is not None for name in swept(depth))


def _declared_place(coordinate: xr.DataArray) -> int | None:
    """Index of the declared value (an attribute of the coordinate) among the swept values; None if it is not there."""
    same = np.flatnonzero(coordinate.values == coordinate.attrs.get("declared"))
    return int(same[0]) if same.size else None


def of_camera(depth: xr.Dataset, variable: str, camera: str, **where: str) -> FloatArray:
    """One variable of one camera over distance."""
    return np.asarray(depth[variable].sel({"camera": camera, **where}).values, dtype=np.float64)


def where_usable(depth: xr.Dataset, camera: str) -> tuple[tuple[float, float], ...]:
    """The usable ranges of a camera, as (near, far) in metres; empty where it is usable nowhere."""
    return ranges_of(of_camera(depth, "usable_near", camera), of_camera(depth, "usable_far", camera))


def broken_limits(camera: xr.Dataset) -> tuple[tuple[str, ...], float]:
    """The limits that a camera breaks at the distance where it breaks fewest, and that distance [m].

    Expects ``/depth`` of one camera.
    """
    broken = camera["limit_met"].transpose("distance", "limit").values == 0
    best = int(np.argmin(broken.sum(axis=1)))
    return tuple(map(str, camera["limit"].values[broken[best]])), float(camera["distance"].values[best])


def field_words(field: float) -> str:
    """Name a place in the field: 0 the axis, 1 the corner of the sensor."""
    return f"{significant(100.0 * field)} % of the way to the corner" if field else "on the axis"


def table_distances(tree: xr.DataTree) -> FloatArray:
    """The distances [m] that tables list: the declared ones or, without a decision, a few that span the range."""
    if has(tree, "decision") and "place" in tree["decision"].coords:
        return np.asarray(group(tree, "decision")["place"].values, dtype=np.float64)
    return distances_without_decision(np.asarray(group(tree, "depth")["distance"].values, dtype=np.float64))


def table_depth(tree: xr.DataTree) -> xr.Dataset:
    """Depth at the declared distances; where none are declared, on the study's grid."""
    return group(tree, "depth_at_places") if has(tree, "depth_at_places") else nominal(tree)


def by_first_criterion(tree: xr.DataTree) -> xr.Dataset:
    """``/depth_of_field`` by the first blur criterion, which decides the answer."""
    return group(tree, "depth_of_field").isel(sharp=0)


def sharp_ranges(one: xr.Dataset, name: str) -> tuple[tuple[float, float], ...]:
    """Ranges of distance [m] of one camera by one criterion, as (near, far): ``sharp``, ``slice`` or ``gap``."""
    return ranges_of(one[f"{name}_near"].values, one[f"{name}_far"].values)


def largest_part(depth: xr.Dataset, camera: str, distance: float) -> str | None:
    """The part with the largest share of the variance at the computed distance nearest to `distance` [m], if known."""
    return _largest(shares_at(depth, camera, distance), "part")


def largest_parts(depth: xr.Dataset, camera: str) -> list[str | None]:
    """The part with the largest share of the variance at every computed distance, None where no share is known."""
    shares = np.asarray(depth["variance_share"].sel(camera=camera).transpose("distance", "part").values)
    largest = np.argmax(np.where(np.isnan(shares), -np.inf, shares), axis=1)
    names = [str(name) for name in depth["part"].values]
    known = np.isfinite(shares).any(axis=1)
    return [names[place] if there else None for place, there in zip(largest, known, strict=True)]


def shares_at(depth: xr.Dataset, camera: str, distance: float) -> xr.DataArray:
    """The share of each part in the variance of inverse depth, at the computed distance nearest to `distance` [m]."""
    return depth["variance_share"].sel(camera=camera).sel(distance=distance, method="nearest")


def decided_by_calibration(depth: xr.Dataset, camera: str) -> bool:
    """Whether calibration, and not measurement noise alone, contributes to a camera's depth uncertainty."""
    return bool(np.nanmax(np.append(of_camera(depth, "depth_uncertainty_way", camera, way="calibration"), 0.0)) > 0.0)


def largest_source(tree: xr.DataTree, camera: str, distance: float) -> str | None:
    """The error source with the largest uncertainty of its own on the axis, at a distance of ``/sensitivity`` [m]."""
    sources = group(tree, "sensitivity")["source_uncertainty"].sel(camera=camera, field=0.0, distance=distance)
    return _largest(sources, "source")


def _largest(values: xr.DataArray, dim: str) -> str | None:
    array = np.asarray(values.values, dtype=np.float64)
    return str(values[dim].values[int(np.nanargmax(array))]) if np.isfinite(array).any() else None

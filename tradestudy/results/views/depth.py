"""Views of depth and depth of field: arrays by camera, usable and sharp ranges, and the largest error sources."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt
import xarray as xr

from tradestudy.results import distances_without_decision
from tradestudy.results.views.groups import FloatArray, group, has, ranges_of
from tradestudy.units import significant

_SEEN_TWICE: Final = ("overlap", "availability")  # limits on the share of points
_MEASURED: Final = (
    "depth_discrimination",
    "depth_uncertainty",
    "depth_uncertainty_by_error_source",
    "depth_error_radius",
    "depth_error_radius_by_error_source",
    "depth_quantile",
    "variance_share",
    "equivalent_baseline",
    "failed_fraction",
)


def swept(depth: xr.Dataset) -> tuple[str, ...]:
    """The names of the swept parameters: the dimensions of ``/depth`` besides camera and distance."""
    return tuple(str(d) for d in depth["depth_uncertainty"].dims if d not in ("camera", "distance"))


def nominal(tree: xr.DataTree) -> xr.Dataset:
    """``/depth`` of one design: every swept parameter at its declared value, or at its first if that is not swept."""
    depth = group(tree, "depth")
    return depth.isel({name: _declared_place(depth[name]) or 0 for name in swept(depth)})


def nominal_is_declared(tree: xr.DataTree) -> bool:
    """Whether `nominal` returns the declared design, which ``/decision`` describes."""
    depth = group(tree, "depth")
    return all(_declared_place(depth[name]) is not None for name in swept(depth))


def _declared_place(coordinate: xr.DataArray) -> int | None:
    """Index of the declared value (an attribute of the coordinate) among the swept values; None if it is not one."""
    same = np.flatnonzero(coordinate.values == coordinate.attrs.get("declared"))
    return int(same[0]) if same.size else None


def of_camera(depth: xr.Dataset, variable: str, camera: str, **where: str) -> FloatArray:
    """One variable of one camera over distance."""
    return np.asarray(depth[variable].sel({"camera": camera, **where}).values, dtype=np.float64)


def where_measured(depth: xr.Dataset) -> xr.Dataset:
    """``/depth`` with NaN where a camera sees no point twice: it measures nothing, although its formula has a value."""
    if "limit_value" not in depth:
        return depth
    shares = depth["limit_value"].sel(limit=[name for name in _SEEN_TWICE if name in depth["limit"].values])
    seen = ~(shares <= 0.0).any("limit")
    return depth.assign({name: depth[name].where(seen) for name in _MEASURED if name in depth})


def where_usable(depth: xr.Dataset, camera: str) -> tuple[tuple[float, float], ...]:
    """The usable ranges of a camera, as (near, far) in metres; empty where it is usable nowhere."""
    return ranges_of(of_camera(depth, "usable_near", camera), of_camera(depth, "usable_far", camera))


def field_words(field: float, corner: str = "") -> str:
    """A field position in words: 0 is the axis, 1 the corner of the sensor; towards any corner if none is named."""
    return (
        f"{significant(100.0 * field)} % of the way to the {f'{corner} ' * bool(corner)}corner"
        if field
        else "on the axis"
    )


def worst_corner(off: xr.Dataset, variable: str = "depth_uncertainty") -> xr.DataArray:
    """The largest value of ``/depth_field`` towards any corner that the camera sees."""
    return off[variable].max("corner")


def table_distances(tree: xr.DataTree) -> FloatArray:
    """The distances [m] that tables list: the declared ones or, without a decision, a few that span the range."""
    if has(tree, "decision") and "place" in tree["decision"].coords:
        return np.asarray(group(tree, "decision")["place"].values, dtype=np.float64)
    return distances_without_decision(np.asarray(group(tree, "depth")["distance"].values, dtype=np.float64))


def table_depth(tree: xr.DataTree) -> xr.Dataset:
    """Depth at the declared distances or, where none are declared, on the study's grid; see `where_measured`."""
    return where_measured(group(tree, "depth_at_places") if has(tree, "depth_at_places") else nominal(tree))


def by_first_criterion(tree: xr.DataTree) -> xr.Dataset:
    """``/depth_of_field`` by the first blur criterion, which decides the answer."""
    return group(tree, "depth_of_field").isel(sharp=0)


def sharp_ranges(one: xr.Dataset, name: str) -> tuple[tuple[float, float], ...]:
    """Ranges of distance [m] of one camera by one criterion, as (near, far): ``sharp``, ``slice`` or ``gap``."""
    return ranges_of(one[f"{name}_near"].values, one[f"{name}_far"].values)


def least_broken(broken: npt.NDArray[np.bool_]) -> int:
    """Index of the distance at which a camera violates the fewest limits; ``broken`` is (distance, limit)."""
    return int(np.argmin(broken.sum(axis=1)))


def by_design(depth: xr.Dataset, variable: xr.DataArray, *dims: str) -> npt.NDArray[Any]:
    """Values of a variable over (designs, *dims), the last swept parameter varying fastest."""
    sizes = [variable.sizes[name] for name in dims]
    return variable.transpose(*swept(depth), *dims).values.reshape(-1, *sizes)


def largest_parts(depth: xr.Dataset) -> tuple[npt.NDArray[np.object_], FloatArray]:
    """The part with the largest share of the variance and this share, over (designs, cameras, distances).

    Where no share is known, the part is None and its share −∞.
    """
    shares = by_design(depth, depth["variance_share"], "camera", "distance", "part")
    shares = np.where(np.isnan(shares), -np.inf, shares)
    largest = depth["part"].values.astype(object)[np.argmax(shares, axis=-1)]
    largest[~np.isfinite(shares).any(axis=-1)] = None
    return np.asarray(largest), np.asarray(shares.max(axis=-1))


def shares_at(depth: xr.Dataset, camera: str, distance: float) -> xr.DataArray:
    """The share of each part in the variance of inverse depth, at the computed distance nearest to `distance` [m]."""
    return depth["variance_share"].sel(camera=camera).sel(distance=distance, method="nearest")


def decided_by_calibration(depth: xr.Dataset, camera: str) -> bool:
    """Whether calibration, and not measurement noise alone, contributes to a camera's depth uncertainty."""
    return bool(
        np.nanmax(
            np.append(of_camera(depth, "depth_uncertainty_by_error_source", camera, error_source="calibration"), 0.0)
        )
        > 0.0
    )


def largest_source(tree: xr.DataTree, camera: str, distance: float) -> str | None:
    """The error source with the largest uncertainty of its own on the axis, at a distance of ``/sensitivity`` [m]."""
    sources = group(tree, "sensitivity")["source_uncertainty"].sel(camera=camera, field=0.0, distance=distance)
    array = np.asarray(sources.values, dtype=np.float64)
    return str(sources["source"].values[int(np.nanargmax(array))]) if np.isfinite(array).any() else None

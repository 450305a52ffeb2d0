"""The group ``/depth`` as figures need it: one nominal design, arrays by camera, and where each camera is usable."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tradestudy.figures.style import LineStyle, line_style
from tradestudy.wording import distance

if TYPE_CHECKING:
    import xarray as xr

FloatArray = npt.NDArray[np.float64]
_SLIVER = 0.01  # of the range of the study


@dataclass(frozen=True, kw_only=True)
class Camera:
    """A camera as every figure names and draws it."""

    key: str
    title: str
    family: str
    style: LineStyle


def cameras(tree: xr.DataTree) -> tuple[Camera, ...]:
    """The cameras that measure depth, as every figure names and draws them; all where results hold no depth."""
    if "depth" not in tree.children:
        return all_cameras(tree)
    measured = {str(key) for key in tree["depth"].to_dataset()["camera"].values}
    return tuple(camera for camera in all_cameras(tree) if camera.key in measured)


def all_cameras(tree: xr.DataTree) -> tuple[Camera, ...]:
    """All cameras of a study; their order gives the colours."""
    group = tree["cameras"].to_dataset()
    return tuple(
        Camera(
            key=str(key),
            title=str(group["title"].sel(camera=key).item()),
            family=str(group["family"].sel(camera=key).item()),
            style=line_style(order),
        )
        for order, key in enumerate(group["camera"].values)
    )


def swept(depth: xr.Dataset) -> tuple[str, ...]:
    """The names of the swept parameters: the dimensions that a study without a sweep does not have."""
    return tuple(str(d) for d in depth["depth_uncertainty"].dims if d not in ("camera", "distance"))


def nominal(tree: xr.DataTree) -> xr.Dataset:
    """``/depth`` of one design: the declared value of every swept parameter, or the first where that is not swept."""
    depth = tree["depth"].to_dataset()
    return depth.isel({name: _declared_place(depth[name]) or 0 for name in swept(depth)})


def nominal_is_declared(tree: xr.DataTree) -> bool:
    """Whether the design of :func:`nominal` is the one that the study declares, and ``/decision`` is about."""
    depth = tree["depth"].to_dataset()
    return all(_declared_place(depth[name]) is not None for name in swept(depth))


def _declared_place(coordinate: xr.DataArray) -> int | None:
    """Where the declared value, which the coordinate carries as an attribute, stands among the swept ones."""
    same = np.flatnonzero(coordinate.values == coordinate.attrs.get("declared"))
    return int(same[0]) if same.size else None


def of_camera(depth: xr.Dataset, variable: str, camera: Camera, **where: str) -> FloatArray:
    """One variable of one camera, over distance."""
    return np.asarray(depth[variable].sel({"camera": camera.key, **where}).values, dtype=np.float64)


def usable_intervals(depth: xr.Dataset, camera: Camera) -> tuple[tuple[float, float], ...]:
    """Where a camera is usable, as (near, far) in metres; empty where it nowhere is."""
    near, far = of_camera(depth, "usable_near", camera), of_camera(depth, "usable_far", camera)
    return tuple((a, b) for a, b in zip(near, far, strict=True) if np.isfinite(a) and not np.isnan(b))


def has_winners(tree: xr.DataTree) -> bool:
    """Whether the results name a best camera for every distance, of the design that the curves show."""
    named = "decision" in tree.children and "best_camera" in tree["decision"].data_vars
    return named and nominal_is_declared(tree)


def candidates(tree: xr.DataTree) -> tuple[str, ...]:
    """The cameras among which a decision names the best, in the order of the figures; none where all are candidates."""
    declared = str(tree["decision"].attrs.get("candidates", "")).split(", ") if "decision" in tree.children else []
    chosen = tuple(camera.key for camera in cameras(tree) if camera.key in declared)
    return chosen if len(chosen) < len(cameras(tree)) else ()


def winners(tree: xr.DataTree, way: str = "both") -> Iterator[tuple[float, float, str]]:
    """Stretches of distance with one best camera: (from, to, camera), camera "" where none is usable.

    Between two computed distances the stretch ends at the end of a usable range or at the crossover that lies there;
    where neither does, half way (in logarithm).
    """
    best = tree["decision"].to_dataset()["best_camera"].sel(way=way)
    names = [str(name) for name in best.values]
    every = np.asarray(best["distance"].values, dtype=np.float64)
    exact = _exact_ends(tree, way)
    start, start_distance = 0, float(every[0])
    for index in range(1, len(names) + 1):
        if index == len(names):
            yield start_distance, float(every[-1]), names[start]
        elif names[index] != names[start]:
            low, high = float(every[index - 1]), float(every[index])
            between = exact[(exact >= low) & (exact <= high)]
            end = float(between[0]) if between.size else float(np.sqrt(low * high))
            yield start_distance, end, names[start]
            start, start_distance = index, end


def told_winners(tree: xr.DataTree) -> Iterator[tuple[float, float, str]]:
    """The stretches of `winners` without slivers: hundredths of the range whose ends read the same in three digits."""
    found = list(winners(tree))
    whole = found[-1][1] - found[0][0]
    return (one for one in found if distance(one[0]) != distance(one[1]) or one[1] - one[0] > _SLIVER * whole)


def _exact_ends(tree: xr.DataTree, way: str) -> FloatArray:
    """Distances [m] at which the best camera can change: ends of usable ranges, and crossovers of the own reading."""
    ends = [np.empty(0)]
    if nominal_is_declared(tree):
        depth = nominal(tree)
        ends += [depth["usable_near"].values.ravel(), depth["usable_far"].values.ravel()]
    decision = tree["decision"].to_dataset()
    if "crossover_distance" in decision:
        ends.append(decision["crossover_distance"].sel(way=way).values[0].ravel())
    every = np.concatenate(ends).astype(np.float64)
    return np.asarray(every[np.isfinite(every)])

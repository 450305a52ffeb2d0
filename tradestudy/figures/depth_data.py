"""The group ``/depth`` as figures need it: one nominal design, arrays by camera, and where each camera is usable."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tradestudy.figures.style import LineStyle, line_style

if TYPE_CHECKING:
    import xarray as xr

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Camera:
    """A camera as every figure names and draws it."""

    key: str
    title: str
    family: str
    style: LineStyle


def cameras(tree: xr.DataTree) -> tuple[Camera, ...]:
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
    """``/depth`` at the first value of every swept parameter."""
    depth = tree["depth"].to_dataset()
    return depth.isel(dict.fromkeys(swept(depth), 0))


def of_camera(depth: xr.Dataset, variable: str, camera: Camera, **where: str) -> FloatArray:
    """One variable of one camera, over distance."""
    return np.asarray(depth[variable].sel({"camera": camera.key, **where}).values, dtype=np.float64)


def usable_intervals(depth: xr.Dataset, camera: Camera) -> tuple[tuple[float, float], ...]:
    """Where a camera is usable, as (near, far) in metres; empty where it nowhere is."""
    near, far = of_camera(depth, "usable_near", camera), of_camera(depth, "usable_far", camera)
    return tuple((a, b) for a, b in zip(near, far, strict=True) if np.isfinite(a) and not np.isnan(b))


def winners(tree: xr.DataTree, way: str = "both") -> Iterator[tuple[float, float, str]]:
    """Stretches of distance with one best camera: (from, to, camera), camera "" where none is usable.

    The stretch ends half way (in logarithm) between two computed distances.
    """
    best = tree["decision"].to_dataset()["best_camera"].sel(way=way)
    names = [str(name) for name in best.values]
    distance = np.asarray(best["distance"].values, dtype=float)
    edges = np.concatenate([distance[:1], np.sqrt(distance[1:] * distance[:-1]), distance[-1:]])
    start = 0
    for index in range(1, len(names) + 1):
        if index == len(names) or names[index] != names[start]:
            yield float(edges[start]), float(edges[index]), names[start]
            start = index

"""Depth measured in rendered pictures, against the prediction: numbers and sentences."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

import numpy as np
import xarray as xr

from tradestudy.results.views.groups import camera_titles, group, has
from tradestudy.units import FRACTION, LENGTH, pretty, significant
from tradestudy.wording import listed

_NUMBERS: Final = ("spread", "spread_error", "bias", "bias_error", "predicted", "filled")


def measured_numbers(tree: xr.DataTree) -> list[dict[str, Any]]:
    """The depth that each camera measured, of the scene and of each plane; NaN where it measured nothing."""
    found: list[dict[str, Any]] = []
    titles = camera_titles(tree)
    for name, camera in (("pictures", "mapped_camera"), ("depth_loop", "camera")):
        if not has(tree, name, "depth_spread"):
            continue
        table = group(tree, name)[[f"depth_{number}" for number in _NUMBERS]].to_dataframe().reset_index()
        for row in table.rename(columns=lambda column: str(column).removeprefix("depth_")).to_dict("records"):
            values = {str(key): value for key, value in row.items() if key != camera}
            found.append({"camera": titles[row[camera]], "of": "scene" if name == "pictures" else "plane", **values})
    return found


def measured_words(tree: xr.DataTree, *, of_scene: str = "In pictures of the scene, ") -> tuple[str, ...]:
    """How well cameras measured planes and the scene, without full stops; empty if the study measured neither.

    ``of_scene`` begins the sentences on the scene; empty where a heading says it.
    """
    return (*_of_planes(tree), *(f"{of_scene}{sentence}" for sentence in _of_scene(tree)))


def _of_planes(tree: xr.DataTree) -> Iterator[str]:
    """For each camera, the range over its planes of the ratio of measured to predicted spread."""
    if not has(tree, "depth_loop", "depth_spread"):
        return
    data, titles = group(tree, "depth_loop"), camera_titles(tree)
    reached: list[str] = []
    failed: dict[str, list[str]] = {}  # the cameras, by the reason that all their planes share
    for name in data["camera"].values:
        over = data["depth_relative_spread"].sel(camera=name).values
        over, title = over[np.isfinite(over)], titles[str(name)]
        if not over.size:
            reasons = np.unique(data["reason"].sel(camera=name).values.astype(str))
            failed.setdefault(f": {reasons[0]}" if reasons.size == 1 and reasons[0] else "", []).append(title)
            continue
        low, high = significant(float(over.min()), 2), significant(float(over.max()), 2)
        reached.append(f"{low} for {title}" if low == high else f"{low} to {high} for {title}")
    if reached:
        yield f"In pictures of planes, the ratio of measured to predicted depth spread is {'; '.join(reached)}"
    for reason, cameras in failed.items():
        yield f"In pictures of planes, {listed(cameras)} measured nothing{reason}"


def _of_scene(tree: xr.DataTree) -> Iterator[str]:
    """Spread, bias and fill rate of each camera."""
    if not has(tree, "pictures", "map_depth"):
        return
    data, titles = group(tree, "pictures"), camera_titles(tree)
    for k in range(data.sizes["mapped_camera"]):
        yield _one(data.isel(mapped_camera=k), titles)


def _one(row: xr.Dataset, titles: Mapping[str, str]) -> str:
    title = titles[str(row["mapped_camera"].item())]
    spread, bias, predicted, filled = (
        float(row[f"depth_{name}"].item()) for name in ("spread", "bias", "predicted", "filled")
    )
    if not np.isfinite(spread):
        return f"{title} measured nothing"
    suffix = f" (predicted uncertainty: ±{pretty(predicted, LENGTH, digits=2)})" if np.isfinite(predicted) else ""
    return (
        f"{title} measured {pretty(filled, FRACTION, digits=2)} of the points visible in two pictures, with a "
        f"spread of ±{pretty(spread, LENGTH, digits=2)}{suffix} and a bias of {pretty(bias, LENGTH, digits=2)}"
    )

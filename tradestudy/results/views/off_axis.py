"""How depth off the optical axis compares with that on it, in words."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import xarray as xr

from tradestudy.results import judged_uncertainty
from tradestudy.results.views.depth import field_words, nominal, nominal_is_declared, where_usable
from tradestudy.results.views.groups import camera_titles, group, has
from tradestudy.units import significant
from tradestudy.wording import distance, with_article

_CLEARLY_WORSE: Final = 1.1  # times the depth uncertainty on the axis


def off_axis_words(tree: xr.DataTree) -> list[str]:
    """How much less certain depth is off the axis, where it is most so; cameras that it hardly affects are left out."""
    if not has(tree, "depth_field", "depth_uncertainty") or not nominal_is_declared(tree):
        return []
    depth, off, titles = nominal(tree), group(tree, "depth_field"), camera_titles(tree)
    on_axis, off_axis = judged_uncertainty(depth), judged_uncertainty(off)
    distances = np.asarray(depth["distance"].values, dtype=np.float64)
    found = []
    for camera in map(str, depth["camera"].values):
        usable = np.zeros(distances.shape, dtype=bool)
        for near, far in where_usable(depth, camera):
            usable |= (near <= distances) & (distances <= far)
        there = off_axis.sel(camera=camera).transpose("field", "corner", "distance").values
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(usable, there / on_axis.sel(camera=camera).values, np.nan)
        if not np.any(ratio > _CLEARLY_WORSE):
            continue
        field, corner, place = np.unravel_index(np.nanargmax(ratio), ratio.shape)
        worst = float(ratio[field, corner, place])
        times = f"up to {significant(worst, 3)} times as uncertain" if math.isfinite(worst) else "unbounded"
        towards = field_words(float(off["field"].values[field]), str(off["corner"].values[corner]))
        where = f"{towards}, at {distance(float(distances[place]))}"
        found.append(f"depth by {with_article(titles[camera])} is {times} ({where})")
    return found

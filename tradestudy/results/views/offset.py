"""How far the median of a camera's measurements lies from the true depth, in words."""

from __future__ import annotations

from typing import Final

import numpy as np
import xarray as xr

from tradestudy.results.views.depth import nominal, of_camera, where_measured
from tradestudy.results.views.groups import camera_titles, has
from tradestudy.units import FRACTION, LENGTH, pretty
from tradestudy.wording import distance, with_article

_REPORTED: Final = 0.1  # of the depth uncertainty


def offset_words(tree: xr.DataTree) -> list[str]:
    """The cameras whose median is off by more than a tenth of the depth uncertainty where they are usable.

    Each with the distance at which the offset is the largest share of the depth uncertainty.
    """
    if not has(tree, "depth", "depth_quantile"):
        return []
    depth, titles, found = where_measured(nominal(tree)), camera_titles(tree), []
    median = depth["depth_quantile"].sel(error_source="both").sel(quantile=0.5, method="nearest")
    for camera in map(str, depth["camera"].values):
        places = np.asarray(depth["distance"].values, dtype=np.float64)
        offset = np.asarray(median.sel(camera=camera).values, dtype=np.float64) - places
        with np.errstate(divide="ignore", invalid="ignore"):
            shares = np.abs(offset) / of_camera(depth, "depth_uncertainty", camera)
        shares = np.where(of_camera(depth, "usable", camera) > 0.0, np.nan_to_num(shares, nan=0.0, posinf=0.0), 0.0)
        worst = int(np.argmax(shares))
        if shares[worst] <= _REPORTED:
            continue
        side = "far" if offset[worst] > 0.0 else "near"
        off = pretty(abs(float(offset[worst])), LENGTH, digits=2)
        of_it = pretty(float(shares[worst]), FRACTION, digits=2)
        found.append(
            f"half of all measurements by {with_article(titles[camera])} are at least {off} too {side} at "
            f"{distance(float(places[worst]))}, {of_it} of the depth uncertainty there"
        )
    return found

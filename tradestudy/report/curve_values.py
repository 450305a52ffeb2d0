"""What the results say of the curves in figures, so that a page tells values of the results and no others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import xarray as xr

from tradestudy.results.views.depth import nominal
from tradestudy.results.views.groups import FloatArray, has
from tradestudy.units import FRACTION, pretty

CURVES: Final = ("depth_uncertainty", "depth_quantile", "depth_discrimination", "variance_share")
"""The variables of ``/depth`` that are shown for every design."""


@dataclass(frozen=True, kw_only=True)
class CurveValues:
    """A curve of the results over distance [m], in SI.

    Parameters
    ----------
    x, value
        Distance, and the value there.
    low, high
        What stands beside it: the ends of an interval, or the value to the other side.
    beside
        What they are called: "95 %"; empty where they are the value nearer and farther.
    """

    x: FloatArray
    value: FloatArray
    low: FloatArray | None = None
    high: FloatArray | None = None
    beside: str = ""


def curve_values(tree: xr.DataTree) -> Mapping[str, CurveValues]:
    """Curves over distance by the name that figures give them: ``depth_uncertainty/stereo``."""
    return depth_values(nominal(tree)) if has(tree, "depth") else {}


def depth_values(depth: xr.Dataset) -> dict[str, CurveValues]:
    """The curves of one design."""
    x = np.asarray(depth["distance"].values, dtype=np.float64)
    quantiles = depth["depth_quantile"].sel(way="both").transpose("camera", "quantile", "distance").values
    steps = depth["depth_discrimination"].transpose("side", "camera", "distance")
    nearer, farther = (steps.sel(side=side).values for side in ("nearer", "farther"))
    shares = depth["variance_share"].transpose("part", "camera", "distance").values
    uncertainty = depth["depth_uncertainty"].transpose("camera", "distance").values
    ends = depth["quantile"].values
    beside = pretty(float(ends[-1] - ends[0]), FRACTION)
    found = {}
    for k, camera in enumerate(map(str, depth["camera"].values)):
        found[f"depth_uncertainty/{camera}"] = CurveValues(
            x=x, value=uncertainty[k], low=quantiles[k, 0], high=quantiles[k, -1], beside=beside
        )
        found[f"depth_discrimination/{camera}"] = CurveValues(x=x, value=nearer[k], low=nearer[k], high=farther[k])
        for number, part in enumerate(map(str, depth["part"].values)):
            found[f"variance_share:{part}/{camera}"] = CurveValues(x=x, value=shares[number, k])
    return found

"""The results behind the curves of figures, so that pages show exact values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import xarray as xr

from tradestudy.results import judged_uncertainty
from tradestudy.results.views.depth import by_design, nominal, where_measured
from tradestudy.results.views.groups import FloatArray, has
from tradestudy.units import FRACTION, pretty


@dataclass(frozen=True, kw_only=True)
class CurveValues:
    """A curve of the results over distance [m], in SI.

    Parameters
    ----------
    x, value
        Distances, and the values there.
    low, high
        Values shown beside it: the ends of an interval, or the steps nearer and farther.
    beside
        Name of the interval, such as "95 %"; empty for steps nearer and farther.
    """

    x: FloatArray
    value: FloatArray
    low: FloatArray | None = None
    high: FloatArray | None = None
    beside: str = ""


def curve_values(tree: xr.DataTree) -> Mapping[str, CurveValues]:
    """Curves over distance, by the name that figures give them, such as ``depth_uncertainty/stereo``."""
    return depth_values(nominal(tree))[0] if has(tree, "depth") else {}


def depth_values(depth: xr.Dataset) -> list[dict[str, CurveValues]]:
    """The curves of every design of ``/depth``; the last parameter varies fastest."""
    depth = where_measured(depth)
    x, ends = np.asarray(depth["distance"].values, dtype=np.float64), depth["quantile"].values
    beside = pretty(float(ends[-1] - ends[0]), FRACTION)
    low, high = (
        by_design(depth, depth["depth_quantile"].sel(error_source="both").isel(quantile=end), "camera", "distance")
        for end in (0, -1)
    )
    nearer, farther = (
        by_design(depth, depth["depth_discrimination"].sel(side=side), "camera", "distance")
        for side in ("nearer", "farther")
    )
    shares = by_design(depth, depth["variance_share"], "part", "camera", "distance")
    uncertainty, judged = (
        by_design(depth, values, "camera", "distance")
        for values in (depth["depth_uncertainty"], judged_uncertainty(depth))
    )
    parts = list(map(str, depth["part"].values))

    def of_camera(design: int, k: int, camera: str) -> dict[str, CurveValues]:
        at = design, k
        return {
            **{
                f"{name}/{camera}": CurveValues(x=x, value=values[at], low=low[at], high=high[at], beside=beside)
                for name, values in (("depth_uncertainty", uncertainty), ("judged_uncertainty", judged))
            },
            f"depth_discrimination/{camera}": CurveValues(x=x, value=nearer[at], low=nearer[at], high=farther[at]),
            **{
                f"variance_share:{part}/{camera}": CurveValues(x=x, value=shares[design, number, k])
                for number, part in enumerate(parts)
            },
        }

    cameras = list(map(str, depth["camera"].values))
    return [
        {name: curve for k, camera in enumerate(cameras) for name, curve in of_camera(design, k, camera).items()}
        for design in range(len(uncertainty))
    ]

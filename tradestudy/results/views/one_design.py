"""One design of a sweep as if the study declared it, so that everything that is said of the study can be said of it."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping

import numpy as np
import xarray as xr

from tradestudy.results.views.depth import nominal, swept
from tradestudy.results.views.groups import group, has

_OF_DEPTH = (
    "depth_uncertainty",
    "usable",
    "usable_near",
    "usable_far",
    "variance_share",
    "limit_met",
)  # that answers use
_SAID_ALONG = ("says", "priority", "quantity", "of")  # of a requirement, in every design


def design_places(tree: xr.DataTree) -> Iterator[dict[str, int]]:
    """Where every design stands along the swept parameters, the last parameter first to move; none without a sweep."""
    if not has(tree, "depth") or not (names := swept(depth := group(tree, "depth"))):
        return
    for places in itertools.product(*(range(depth.sizes[name]) for name in names)):
        yield dict(zip(names, places, strict=True))


def shown_place(tree: xr.DataTree) -> dict[str, int]:
    """Where the design that figures show stands: the declared one, if it is among those swept."""
    depth, one = group(tree, "depth"), nominal(tree)
    return {name: int(np.flatnonzero(depth[name].values == one[name].values)[0]) for name in swept(depth)}


def tree_of_design(tree: xr.DataTree, place: Mapping[str, int]) -> xr.DataTree:
    """What the results say of one design: its depth, the best camera along the distance, and its requirements."""
    groups = {"/cameras": group(tree, "cameras"), "/depth": group(tree, "depth")[list(_OF_DEPTH)].isel(place)}
    if has(tree, "decision", "design_best_camera_along"):
        groups["/decision"] = _decision(group(tree, "decision"), place)
    if has(tree, "requirements", "design_reason"):
        groups["/requirements"] = _requirements(group(tree, "requirements"), place)
    return xr.DataTree.from_dict(groups)


def _decision(decision: xr.Dataset, place: Mapping[str, int]) -> xr.Dataset:
    """The same variables, of noise and calibration together, as far as the run computed them in every design."""
    one = decision.isel(place)
    found = {"best_camera": one["design_best_camera_along"].expand_dims(way=["both"])}
    if "design_crossover_distance" in one:
        crossings = one["design_crossover_distance"].rename(design_crossing="crossing")
        found["crossover_distance"] = crossings.expand_dims(reading=["as declared"], way=["both"])
    return xr.Dataset(found, attrs=decision.attrs).drop_vars(list(place), errors="ignore")


def _requirements(requirements: xr.Dataset, place: Mapping[str, int]) -> xr.Dataset:
    """The same variables; what decides the worst value is not known of every design."""
    one = requirements.isel(place).drop_vars(list(place))
    nothing = xr.full_like(one["met"], np.nan, dtype=float)
    return xr.Dataset(
        {
            **{name: one[name] for name in _SAID_ALONG},
            "met": one["design_met"],
            "camera_deciding": one["design_camera"],
            "margin_percent": one["design_margin_percent"],
            "margin_sigma": one["design_margin_sigma"],
            "within_tolerance": one["design_within_tolerance"],
            "reason": one["design_reason"],
            **({"limited_by": one["design_limited_by"]} if "design_limited_by" in one else {}),  # earlier runs lack it
            "place": nothing,
            "conformity": nothing,
            "rests_on": xr.full_like(one["says"], ""),
            "rests_on_share": nothing,
        }
    )

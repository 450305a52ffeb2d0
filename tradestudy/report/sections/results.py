"""Results: usable ranges, depth discrimination and uncertainty, error sources, swept designs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import xarray as xr

from tradestudy.figures.drawing import Drawing
from tradestudy.report.document import Block, Column, Heading, Paragraph, Table, Text, pictures_of, say
from tradestudy.report.sections.disparity_causes import describe_disparity_causes
from tradestudy.results.views.depth import least_broken, nominal
from tradestudy.results.views.groups import group, has, titles_in
from tradestudy.wording import distance, in_words

_NOWHERE = "nowhere"
_MISSING = (
    " For a camera that is usable nowhere, the table names the limits that it misses where it misses the fewest, and "
    "the nearest such distance."
)


def describe_results(tree: xr.DataTree, drawings: Mapping[str, Drawing]) -> Iterator[Block]:
    """Write the results, one part per question; a part whose group is missing is left out."""
    if has(tree, "depth"):
        yield Heading(text="Results", anchor="results")
        yield from _usable_range(tree)
        if "requirement_margins" in drawings:  # the first page shows margins instead
            yield from pictures_of(drawings, "whole_range")
        yield Heading(text="What decides the uncertainty", anchor="parts", level=2)
        yield from pictures_of(drawings, "variance_shares")
        yield Heading(text="Depth discrimination and uncertainty", anchor="depth", level=2)
        yield from pictures_of(drawings, "close_range", "mid_range")
        yield from _pictured(drawings, "Off the axis", "off-axis", "off_axis")
        yield from _over_the_picture(tree, drawings)
        yield from describe_disparity_causes(tree)
        yield from _pictured(drawings, "Swept designs", "sweeps", "sweep_map", "pareto")


def _pictured(drawings: Mapping[str, Drawing], title: str, anchor: str, *names: str) -> Iterator[Block]:
    """Show figures under a heading of their own; nothing if the run has none of them."""
    if pictures := tuple(pictures_of(drawings, *names)):
        yield Heading(text=title, anchor=anchor, level=2)
        yield from pictures


def _over_the_picture(tree: xr.DataTree, drawings: Mapping[str, Drawing]) -> Iterator[Block]:
    """Show maps of depth uncertainty for each rig that has any."""
    if not has(tree, "depth_map"):
        return
    yield Heading(text="Over the picture", anchor="depth-map", level=2)
    for key in map(str, group(tree, "depth_map")["camera"].values):
        drawing = drawings[f"depth-map-{key}"]
        yield Paragraph(drawing.alt)
        yield from pictures_of(drawings, drawing.name)


def _usable_range(tree: xr.DataTree) -> Iterator[Block]:
    depth = nominal(tree)
    rows: list[tuple[Text, ...]] = []
    for key, title in titles_in(tree, "depth").items():
        camera = depth.sel(camera=key)
        intervals = [
            (distance(float(near)), in_words(str(near_limit)), distance(float(far)), in_words(str(far_limit)))
            for near, far, near_limit, far_limit in zip(
                camera["usable_near"].values,
                camera["usable_far"].values,
                camera["near_limit"].values,
                camera["far_limit"].values,
                strict=True,
            )
            if np.isfinite(near) and not np.isnan(far)
        ]
        rows += [(title, *interval) for interval in intervals] or [(title, _NOWHERE, _what_is_missing(camera), "", "")]
    nowhere = any(row[1] == _NOWHERE for row in rows)
    yield Heading(text="Where each camera is usable", anchor="usable-range", level=2)
    yield Table(
        name="usable-range-table",
        caption=say(
            "Usable distances, and the limit that sets each end (explained in section [](#method-usable)).{missing}",
            missing=_MISSING if nowhere else "",
        ),
        columns=(
            Column(title="Camera", weight=3),
            Column(title="From", align="right"),
            Column(title="set by", weight=2),
            Column(title="To", align="right"),
            Column(title="set by", weight=2),
        ),
        rows=tuple(rows),
    )


def _what_is_missing(camera: xr.Dataset) -> str:
    """Name the limits that fail at the distance where the fewest do, for a camera that is usable nowhere."""
    broken = camera["limit_met"].transpose("distance", "limit").values == 0
    best = least_broken(broken)
    names = camera["limit"].values[broken[best]]
    return f"{', '.join(map(in_words, names))} (at {distance(float(camera['distance'].values[best]))})"

"""The cameras of a results tree as every figure names and draws them."""

from __future__ import annotations

from dataclasses import dataclass

import xarray as xr

from tradestudy.figures.style import LineStyle, line_style
from tradestudy.results.views.cameras import camera_titles, titles_in


@dataclass(frozen=True, kw_only=True)
class CameraTrace:
    """What stands for a camera on every figure."""

    key: str
    title: str
    style: LineStyle


def traces(tree: xr.DataTree) -> tuple[CameraTrace, ...]:
    """Of the cameras that measure depth; of all where results hold no depth."""
    return traces_in(tree, "depth") if "depth" in tree.children else all_traces(tree)


def traces_in(tree: xr.DataTree, name: str) -> tuple[CameraTrace, ...]:
    """Of the cameras that a group is about."""
    keys = titles_in(tree, name)
    return tuple(trace for trace in all_traces(tree) if trace.key in keys)


def all_traces(tree: xr.DataTree) -> tuple[CameraTrace, ...]:
    """Of all cameras of a study; their order gives the colours."""
    titles = camera_titles(tree).items()
    return tuple(
        CameraTrace(key=key, title=title, style=line_style(order)) for order, (key, title) in enumerate(titles)
    )

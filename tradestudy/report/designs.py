"""The designs of a sweep for a page that steps through them: curves, usable ranges, best cameras and what is said."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import xarray as xr

from tradestudy.report.curve_values import CURVES, CurveValues, depth_values
from tradestudy.report.document import Block, Table
from tradestudy.report.sections.answer import describe_design
from tradestudy.report.sections.registers import describe_requirements
from tradestudy.results.views.decision import tied, winners
from tradestudy.results.views.depth import swept, where_usable
from tradestudy.results.views.designs import path_words, value_words
from tradestudy.results.views.groups import group, has
from tradestudy.results.views.one_design import design_places, shown_place, tree_of_design
from tradestudy.wording import listed

MOST_DESIGNS: Final = 500  # with more, a page would be too large to be sent about


@dataclass(frozen=True, kw_only=True)
class DesignAxis:
    """One swept parameter.

    Parameters
    ----------
    says
        What it is, with its camera.
    words, values
        Of every step; values in SI, or None for what is chosen by name.
    shown
        The step that the report shows.
    """

    says: str
    words: tuple[str, ...]
    values: tuple[float | None, ...]
    shown: int


@dataclass(frozen=True, kw_only=True)
class PageDesign:
    """One design: its curves by name, usable stretches [m] by camera, best cameras by stretch, and blocks by name."""

    curves: Mapping[str, CurveValues]
    usable: Mapping[str, tuple[tuple[float, float], ...]]
    best: tuple[tuple[float, float, tuple[str, ...]], ...]
    blocks: Mapping[str, Block]


@dataclass(frozen=True, kw_only=True)
class PageDesigns:
    """All designs, the last parameter first to move."""

    axes: tuple[DesignAxis, ...]
    designs: tuple[PageDesign, ...]


def page_designs(tree: xr.DataTree) -> PageDesigns | None:
    """Every design of a sweep; None without one, or with more designs than a page can hold."""
    places = list(design_places(tree))
    if not 1 < len(places) <= MOST_DESIGNS:
        return None
    depth, shown = group(tree, "depth"), shown_place(tree)
    axes = tuple(_axis(tree, depth[path], shown[path]) for path in swept(depth))
    curves = depth[list(CURVES)].load()
    return PageDesigns(
        axes=axes,
        designs=tuple(_design(tree, place, curves.isel(place), axes) for place in places),
    )


def _axis(tree: xr.DataTree, coordinate: xr.DataArray, shown: int) -> DesignAxis:
    numeric = coordinate.dtype.kind in "fiu"
    return DesignAxis(
        says=path_words(tree, str(coordinate.name)),
        words=tuple(value_words(coordinate, value) for value in coordinate.values),
        values=tuple(float(value) if numeric else None for value in coordinate.values),
        shown=shown,
    )


def _design(
    tree: xr.DataTree, place: Mapping[str, int], curves: xr.Dataset, axes: tuple[DesignAxis, ...]
) -> PageDesign:
    own = tree_of_design(tree, place)
    words = listed([f"{axis.says} {axis.words[step]}" for axis, step in zip(axes, place.values(), strict=True)])
    callouts: dict[str, Block] = {one.name: one for one in describe_design(own, words)}
    tables: dict[str, Block] = {one.name: one for one in describe_requirements(own) if isinstance(one, Table)}
    return PageDesign(
        curves=depth_values(curves),
        usable={str(key): where_usable(own["depth"].to_dataset(), str(key)) for key in curves["camera"].values},
        best=tuple((start, end, tied(names)) for start, end, names in winners(own))
        if has(own, "decision", "best_camera")
        else (),
        blocks={**callouts, **tables},
    )

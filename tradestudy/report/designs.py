"""The designs of a sweep, for pages that step through them: curves, usable ranges, best cameras and sentences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import xarray as xr

from tradestudy.report.curve_values import CurveValues, depth_values
from tradestudy.report.document import Block, Callout, Table
from tradestudy.report.sections.answer import describe_design
from tradestudy.report.sections.registers import requirement_table
from tradestudy.results.views.decision import (
    BestCameras,
    best_cameras_of_designs,
    camera_depths,
    design_places,
    requirements_of_designs,
    shown_place,
    tied,
)
from tradestudy.results.views.depth import swept
from tradestudy.results.views.designs import path_words, value_words
from tradestudy.results.views.groups import camera_titles, group
from tradestudy.results.views.requirement_conclusions import conclusions_of_design
from tradestudy.wording import listed

MOST_DESIGNS: Final = 500  # with more designs, a page would be too large to share


@dataclass(frozen=True, kw_only=True)
class DesignAxis:
    """One swept parameter.

    Parameters
    ----------
    says
        Its name and camera, in words.
    words, values
        The value of each step in words, and in SI; None for choices by name.
    shown
        Number of the step that the report shows.
    """

    says: str
    words: tuple[str, ...]
    values: tuple[float | None, ...]
    shown: int


@dataclass(frozen=True, kw_only=True)
class PageDesign:
    """One design: curves by name, usable stretches [m] by camera, best cameras by stretch, and blocks by name."""

    curves: Mapping[str, CurveValues]
    usable: Mapping[str, tuple[tuple[float, float], ...]]
    best: tuple[tuple[float, float, tuple[str, ...]], ...]
    blocks: Mapping[str, Block]


@dataclass(frozen=True, kw_only=True)
class PageDesigns:
    """All designs; the last parameter varies fastest."""

    axes: tuple[DesignAxis, ...]
    designs: tuple[PageDesign, ...]


def page_designs(tree: xr.DataTree) -> PageDesigns | None:
    """All designs of a sweep; None without a sweep, or with more designs than a page can contain."""
    places = list(design_places(tree))
    if not 1 < len(places) <= MOST_DESIGNS:
        return None
    depth, shown, titles = group(tree, "depth"), shown_place(tree), camera_titles(tree)
    axes = tuple(_axis(tree, depth[path], shown[path]) for path in swept(depth))
    return PageDesigns(
        axes=axes,
        designs=tuple(
            PageDesign(
                curves=curves,
                usable={key: camera.usable for key, camera in cameras.items()},
                best=() if best is None else tuple((start, end, tied(names)) for start, end, names in best.ranges),
                blocks=_blocks(titles, best, rows, _words(axes, place)),
            )
            for place, curves, cameras, best, rows in zip(
                places,
                depth_values(depth),
                camera_depths(depth),
                best_cameras_of_designs(tree),
                requirements_of_designs(tree),
                strict=True,
            )
        ),
    )


def _words(axes: tuple[DesignAxis, ...], place: Mapping[str, int]) -> str:
    return listed([f"{axis.says} {axis.words[step]}" for axis, step in zip(axes, place.values(), strict=True)])


def _blocks(
    titles: Mapping[str, str], best: BestCameras | None, rows: Sequence[Mapping[str, Any]], words: str
) -> dict[str, Block]:
    """The blocks of a page that are about one design, by name."""
    blocks: list[Callout | Table] = [*describe_design(best, conclusions_of_design(rows, titles), words)]
    if rows:
        blocks.append(requirement_table(rows, titles))
    return {one.name: one for one in blocks}


def _axis(tree: xr.DataTree, coordinate: xr.DataArray, shown: int) -> DesignAxis:
    numeric = coordinate.dtype.kind in "fiu"
    return DesignAxis(
        says=path_words(tree, str(coordinate.name)),
        words=tuple(value_words(coordinate, value) for value in coordinate.values),
        values=tuple(float(value) if numeric else None for value in coordinate.values),
        shown=shown,
    )

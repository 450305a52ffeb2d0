"""The data of an HTML page: results behind the curves of its figures, the designs of a sweep, and both as JSON."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import compress, groupby
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import xarray as xr

from tradestudy.errors import escaped
from tradestudy.figures.drawing import Curve, Panel, Plotted
from tradestudy.report.document import Block, Callout, Table
from tradestudy.report.sections.answer import describe_design
from tradestudy.report.sections.registers import requirement_table
from tradestudy.results import judged_uncertainty
from tradestudy.results.views.decision import (
    BestCameras,
    best_cameras_of_designs,
    camera_depths,
    design_places,
    requirements_of_designs,
    shown_place,
    tied,
)
from tradestudy.results.views.depth import by_design, nominal, swept, where_measured
from tradestudy.results.views.designs import path_words, value_words
from tradestudy.results.views.groups import FloatArray, camera_titles, group, has
from tradestudy.results.views.requirement_conclusions import conclusions_of_design
from tradestudy.units import FRACTION, pretty
from tradestudy.wording import limit_words, listed


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
    unusable
        Where its camera is not usable: first and last place in `x`, and the limits that it breaks there, in words.
    """

    x: FloatArray
    value: FloatArray
    low: FloatArray | None = None
    high: FloatArray | None = None
    beside: str = ""
    unusable: tuple[tuple[int, int, str], ...] = ()


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
    broken = by_design(depth, depth["limit_met"], "camera", "distance", "limit") == 0
    limits = [limit_words(str(limit)) for limit in depth["limit"].values]

    def of_camera(design: int, k: int, camera: str) -> dict[str, CurveValues]:
        at = design, k
        interval = {"low": low[at], "high": high[at], "beside": beside, "unusable": _stretches(broken[at], limits)}
        return {
            **{
                f"{variable}/{camera}": CurveValues(x=x, value=values[at], **interval)
                for variable, values in (("depth_uncertainty", uncertainty), ("judged_uncertainty", judged))
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


def _stretches(broken: npt.NDArray[np.bool_], limits: Sequence[str]) -> tuple[tuple[int, int, str], ...]:
    """Stretches of places at which the same limits are broken, of shape (place, limit): first, last, and the limits."""
    words = [listed(list(compress(limits, row))) for row in broken.tolist()]
    runs = [(limit, [place for place, _ in run]) for limit, run in groupby(enumerate(words), lambda place: place[1])]
    return tuple((places[0], places[-1], limit) for limit, places in runs if limit)


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
    return {block.name: block for block in blocks}


def _axis(tree: xr.DataTree, coordinate: xr.DataArray, shown: int) -> DesignAxis:
    numeric = coordinate.dtype.kind in "fiu"
    return DesignAxis(
        says=path_words(tree, str(coordinate.name)),
        words=tuple(value_words(coordinate, value) for value in coordinate.values),
        values=tuple(float(value) if numeric else None for value in coordinate.values),
        shown=shown,
    )


_FARTHEST: Final = 1e9  # m
_DIGITS: Final = 3  # digits that the script shows
_NEAR_TIE: Final = 1e-3  # of the last digit: far above the rounding error of single floats


@dataclass(frozen=True)
class _Pool:
    """The arrays of a page, without repetition, as single floats in base64."""

    texts: list[str] = field(default_factory=list)
    places: dict[bytes, int] = field(default_factory=dict)

    def place(self, values: FloatArray | None) -> int | None:
        if values is None or not values.size:
            return None
        raw = _displayed_alike(values).tobytes()
        if raw not in self.places:
            self.places[raw] = len(self.texts)
            self.texts.append(base64.b64encode(raw).decode())
        return self.places[raw]

    def curve(self, values: CurveValues) -> list[int | str | None]:
        return [*(self.place(array) for array in (values.x, values.value, values.low, values.high)), values.beside]


def page_data(
    figures: Mapping[str, Plotted],
    values: Mapping[str, CurveValues],
    designs: PageDesigns | None = None,
    write: Callable[[Block], str] = str,
) -> str:
    """Write JSON for the script of a page, safe inside an HTML element.

    Parameters
    ----------
    figures
        Figures of the page, by name.
    values
        Results behind curves, by the name of the curve, such as ``depth_uncertainty/stereo``.
    designs
        Designs of a sweep.
    write
        Turns a block about a design into HTML.
    """
    pool = _Pool()
    data = {
        "figures": {
            name: [_panel(name, panel, values, pool) for panel in figure.panels] for name, figure in figures.items()
        },
        "values": {name: pool.curve(curve) for name, curve in values.items()},
        "unusable": _unusable(values),
        "designs": None if designs is None else _designs(designs, pool, write),
    }
    return json.dumps({**data, "arrays": pool.texts}, ensure_ascii=False, separators=(",", ":")).replace("<", "\\u003c")


def _panel(figure: str, panel: Panel, values: Mapping[str, CurveValues], pool: _Pool) -> dict[str, Any]:
    """A panel as the script reads it, with the identifiers of the page."""
    return {
        "id": f"{figure}-{panel.id}",
        "title": escaped(panel.title, lines=True),
        "box": [round(end, 2) for end in panel.box],
        "x": vars(panel.x),
        "y": vars(panel.y),
        "anchors": [[f"{figure}-{text}", *moves] for text, *moves in panel.anchors],
        "curves": [_curve(figure, curve, values, pool) for curve in panel.curves],
    }


def _curve(figure: str, curve: Curve, values: Mapping[str, CurveValues], pool: _Pool) -> dict[str, Any]:
    """A curve as the script reads it, without data if the results have its values."""
    fields = {name: escaped(getattr(curve, name), lines=True) for name in ("kind", "label", "name", "color")}
    # A third part of a name, such as “usable”, only says where a curve is drawn.
    sent = () if "/".join(curve.name.split("/")[:2]) in values else ("x", "y", "top")
    return {
        **fields,
        **({"unit": curve.unit} if curve.kind == "map" else {}),
        "id": f"{figure}-{curve.id}",
        **{name: pool.place(np.frombuffer(getattr(curve, name))) for name in sent},
    }


def _designs(every: PageDesigns, pool: _Pool, write: Callable[[Block], str]) -> dict[str, Any]:
    """The data of the sliders, with a list entry per design, and distances with as many digits as figures show."""
    return {
        "axes": [vars(axis) for axis in every.axes],
        "curves": {
            name: [pool.curve(design.curves[name])[1:4] for design in every.designs] for name in every.designs[0].curves
        },
        "unusable": [_unusable(design.curves) for design in every.designs],
        "usable": [
            {camera: [[_short(near), _short(far)] for near, far in ranges] for camera, ranges in design.usable.items()}
            for design in every.designs
        ],
        "best": [
            [[_short(start), _short(end), names] for start, end, names in design.best] for design in every.designs
        ],
        "blocks": [{name: write(block) for name, block in design.blocks.items()} for design in every.designs],
    }


def _unusable(curves: Mapping[str, CurveValues]) -> dict[str, tuple[tuple[int, int, str], ...]]:
    """Where each camera is not usable."""
    return {name.partition("/")[2]: curve.unusable for name, curve in curves.items() if curve.unusable}


def _short(distance: float) -> float:
    return float(f"{min(distance, _FARTHEST):.5g}")  # JSON has no infinity


def _displayed_alike(values: FloatArray) -> npt.NDArray[np.float32]:
    """Single floats that the script writes with the same digits as the doubles; near a tie, the rounded number."""
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        single = values.astype("<f4")
        digits = np.abs(values) / 10.0 ** (np.floor(np.log10(np.abs(values))) - (_DIGITS - 1))
        close = np.flatnonzero(np.abs(digits % 1.0 - 0.5) < _NEAR_TIE)
    single[close] = [float(f"{value:.{_DIGITS - 1}e}") for value in values[close].tolist()]
    return single

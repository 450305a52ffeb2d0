"""A figure: its name, its description in words, how to draw it, and, once drawn, the content of its panels."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tradestudy.figures.style import StudyFigure


@dataclass(frozen=True, kw_only=True)
class ValueTable:
    """The numbers behind bars, arrows, maps or pictures, as literal texts; :class:`Curve` has those behind curves."""

    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, kw_only=True)
class Drawing:
    """One figure of a report; captions and alternative texts are literal.

    Parameters
    ----------
    name
        Name of its file, and of references to it.
    caption
        What it shows and how to read it.
    alt
        What a person who sees the figure would notice, with numbers.
    draw
        Draws the figure.
    values
        Makes the tables of numbers of a figure with bars, arrows, maps or pictures.
    """

    name: str
    caption: str
    alt: str
    draw: Callable[[], StudyFigure]
    values: Callable[[], tuple[ValueTable, ...]] = tuple


@dataclass(frozen=True, kw_only=True)
class Scale:
    """One axis of a panel.

    Parameters
    ----------
    kind
        "linear", "log" or "symlog", which is linear within ``linear_within`` of 0.
    low, high
        Its ends, in the units of the data.
    label, unit, factor
        Its name, its unit, and the factor that converts data to that unit.
    names
        The words that label some values instead of numbers.
    """

    kind: str
    low: float
    high: float
    linear_within: float
    label: str
    unit: str
    factor: float
    names: Mapping[str, str]


@dataclass(frozen=True, kw_only=True)
class Curve:
    """What one artist of matplotlib shows.

    Parameters
    ----------
    id
        Identifier of its group in the SVG.
    kind
        "line", "points", "band" (from `y` up to `top`), "map", or "shape", which has no data to show. A map has the
        edges of its columns as `x`, those of its rows as `y`, and the values of its cells, row by row, as `top`.
    label
        Whose curve it is, such as a camera's or an error source's. Pages show or hide all artists of a label together.
    name
        The variable of the results and the camera, from the artist's `gid`: ``depth_uncertainty/stereo``.
    color
        As ``#rrggbb``.
    x, y, top
        Data, as bytes of little-endian doubles; empty where a kind has none.
    unit
        Unit of the values of a map.
    """

    id: str
    kind: str
    label: str
    name: str
    color: str
    x: bytes = b""
    y: bytes = b""
    top: bytes = b""
    unit: str = ""


@dataclass(frozen=True, kw_only=True)
class Panel:
    """One pair of axes, with its `box` (left, top, right, bottom) in the units of the SVG.

    `anchors` lists texts placed at data coordinates: the identifier of each, and whether it moves along x and along y.
    """

    id: str
    title: str
    box: tuple[float, float, float, float]
    x: Scale
    y: Scale
    curves: tuple[Curve, ...]
    anchors: tuple[tuple[str, bool, bool], ...]


@dataclass(frozen=True, kw_only=True)
class Plotted:
    """A drawn figure and the content of its panels."""

    svg: bytes
    panels: tuple[Panel, ...] = ()

"""A figure: its name, what it shows in words, how to draw it, and, once drawn, what its panels show."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tradestudy.figures.style import StudyFigure


@dataclass(frozen=True, kw_only=True)
class ValueTable:
    """Numbers that a figure shows other than by curves, whose values pages read from :class:`Curve`. Literal texts."""

    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, kw_only=True)
class Drawing:
    """One figure of a report.

    Parameters
    ----------
    name
        Of the file and of references to it.
    caption
        What is drawn and how to read it. Literal text.
    alt
        What a person who sees the figure would notice, with its numbers. Literal text.
    draw
        Makes the figure.
    values
        Makes the tables of a figure with bars, arrows, maps or pictures.
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
        "linear", "log" or "symlog"; linear within ``linear_within`` of 0.
    low, high
        Its ends, in data units.
    label, unit, factor
        Its name without the unit, the unit, and what a data value is multiplied by to be in that unit.
    names
        What stands at a value instead of a number.
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
    """What one artist shows.

    Parameters
    ----------
    id
        Of its group in the SVG.
    kind
        "line", "points", "band" (from `y` up to `top`) or "shape", whose data are not shown.
    label
        Whose curve it is: a camera, a part; artists of one label are switched together.
    name
        The variable of the results and the camera, as the artist's `gid` says: ``depth_uncertainty/stereo``.
    color
        As ``#rrggbb``.
    x, y, top
        Data, as bytes of little-endian doubles; empty where the kind has none.
    """

    id: str
    kind: str
    label: str
    name: str
    color: str
    x: bytes = b""
    y: bytes = b""
    top: bytes = b""


@dataclass(frozen=True, kw_only=True)
class Panel:
    """One pair of axes, its `box` (left, top, right, bottom) in the units of the SVG.

    `anchors` are texts placed at data coordinates, by the identifiers of their groups: whether they move with x and y.
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
    """A drawn figure and what can be read in its panels."""

    svg: bytes
    panels: tuple[Panel, ...] = ()

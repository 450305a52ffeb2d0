"""Curves that need no legend: each is named where it ends, and those that lie on one another stay visible."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from textwrap import wrap
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes

from tradestudy.figures.fonts import printable
from tradestudy.figures.style import DECLARED, SOFT, panel_size, readable, shortened
from tradestudy.results.views.groups import FloatArray

SMALLEST: Final = 7.5  # points: the size of names
_LETTERS, _LINES = 24, 2  # of a name, at most
_LINE_HEIGHT: Final = 1.3  # of the size of letters
# Without clipping by boxes and circles, in which matplotlib spends a tenth of the time of a figure.
_JOINING: Final = {"arrowstyle": "-", "patchA": None, "shrinkA": 0.0, "shrinkB": 0.0}
_UNSEEN: Final = 0.1  # pixels, 100 per inch: less than a tenth of a point, as rounding to whole steps adds a sixth
_BESIDE: Final = 12.0  # points between a panel and the names
_TOGETHER: Final = 0.007  # of the height of a panel: closer curves look like one curve
_LONG_TOGETHER: Final = 0.1  # of the points: one curve hides another that is this close at more of them

Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class NamedCurve:
    """A curve as it is drawn, in the units of its axes."""

    name: str
    color: str
    x: FloatArray
    y: FloatArray


def name_ends(axes: Axes, curves: Sequence[NamedCurve]) -> None:
    """Write the name of every curve right of the panel, level with the end of what is visible of it.

    Names keep the order of the ends and move apart where they would touch; a grey line joins each to its curve. Set the
    scales and limits of the axes first. A curve without a visible point gets no name.
    """
    ends = [(curve, end) for curve in curves if (end := _end(axes, curve)) is not None]
    if not ends:
        return
    names = [_lines(curve.name) for curve, _ in ends]
    width, height = panel_size(axes)
    sizes = np.array([_height(name) for name in names]) / height
    levels = np.array([_fraction(axes, "y", end[1]) for _, end in ends])
    # Of curves that leave through the top edge, the one that leaves first gets the highest name.
    levels -= 1e-6 * np.array([_fraction(axes, "x", end[0]) for _, end in ends])
    placed = spread(levels, sizes)
    # A name level with an end at the edge of the panel needs no line.
    edge = 1.0 - _BESIDE / width
    joined = [
        abs(level - ideal) * height > 0.5 * SMALLEST or _fraction(axes, "x", end[0]) < edge
        for (_, end), level, ideal in zip(ends, placed, levels, strict=True)
    ]
    for (curve, end), name, level, is_joined in zip(ends, names, placed, joined, strict=True):
        axes.annotate(
            name,
            end,
            xytext=(1.0 + _BESIDE / width, level),
            textcoords="axes fraction",
            color=readable(curve.color),
            fontsize=SMALLEST,
            linespacing=1.0,
            va="center",
            annotation_clip=False,
            label=curve.name,
            gid=DECLARED,
            arrowprops={**_JOINING, "color": SOFT, "alpha": 0.5, "linewidth": 0.4, "relpos": (-0.02, 0.5)}
            if is_joined
            else None,
        )


def names_fit(axes: Axes, names: Sequence[str]) -> bool:
    """Whether `name_ends` can write all these names beside a panel, in full."""
    written = [_lines(name) for name in names]
    _, height = panel_size(axes)
    return sum(map(_height, written)) <= height and not any(name.endswith("…") for name in written)


def _height(name: str) -> float:
    """Height of a written name [points]."""
    return _LINE_HEIGHT * SMALLEST * (1 + name.count("\n"))


def fill(axes: Axes, x: FloatArray, low: FloatArray, high: FloatArray, is_known: Flags, **look: Any) -> None:
    """Fill the area between two curves where they are known, with the points that a page can show; set limits first.

    Points that are dropped lie within a tenth of a point of the chord of those that stay: a chord misses a curve by an
    eighth of its second difference, which grows with the square of the number of steps that the chord spans.
    """
    (_, bottom), (_, top) = axes.transAxes.transform([(0.0, 0.0), (1.0, 1.0)])
    edges = [axes.transData.transform(np.column_stack([x, edge]))[:, 1] for edge in (low, high)]
    # What lies beyond the panel ends one height outside it; a gap counts as a jump.
    levels = np.where(
        is_known, np.clip(np.nan_to_num(edges, nan=bottom), 2.0 * bottom - top, 2.0 * top - bottom), np.inf
    )
    levels = np.nan_to_num(levels, posinf=2.0 * (top - bottom))
    bends = np.abs(np.diff(levels, 2, axis=1)).max(axis=0) / (8.0 * _UNSEEN)
    passed = np.floor(np.cumsum([0.0, *np.sqrt(bends), 1.0]))  # the last step of 1 keeps the last point
    kept = np.flatnonzero(np.diff(passed, prepend=-1.0))
    axes.fill_between(x[kept], low[kept], high[kept], where=is_known[kept].tolist(), linewidth=0.0, **look)


def name_places(axes: Axes, places: Sequence[float], names: Sequence[str]) -> None:
    """Write a vertical name above the panel at each place on its horizontal axis; names that would touch move apart."""
    if not places:
        return
    width, height = panel_size(axes)
    room = np.full(len(places), _LINE_HEIGHT * SMALLEST / width)
    ideal = np.array([_fraction(axes, "x", place) for place in places])
    for place, name, across in zip(ideal, names, spread(ideal, room), strict=True):
        axes.annotate(
            printable(name),
            (place, 1.0),
            xycoords="axes fraction",
            xytext=(across, 1.0 + _BESIDE / height),
            textcoords="axes fraction",
            fontsize=SMALLEST,
            rotation=90,
            ha="center",
            va="bottom",
            arrowprops={**_JOINING, "linewidth": 0.5, "relpos": (0.5, 0.0)},
            gid=DECLARED,
        )


def _lines(name: str) -> str:
    """A name on at most two lines."""
    lines = wrap(printable(name), _LETTERS) or [""]
    return "\n".join([*lines[: _LINES - 1], shortened(" ".join(lines[_LINES - 1 :]), _LETTERS)]).strip()


def _end(axes: Axes, curve: NamedCurve) -> tuple[float, float] | None:
    """Where a curve ends in the panel: at its last point there, or at the edge through which it leaves."""
    (left, right), (bottom, top) = sorted(axes.get_xlim()), sorted(axes.get_ylim())
    is_known = ~(np.isnan(curve.x) | np.isnan(curve.y))
    inside = np.flatnonzero(is_known & (curve.x >= left) & (curve.x <= right) & (curve.y >= bottom) & (curve.y <= top))
    if not inside.size:
        return None
    last = int(inside[-1])
    # A curve that leaves through the top or bottom goes on to its next point, cut off at the edge.
    beyond = min(last + 1, len(curve.x) - 1)
    if is_known[beyond] and left <= curve.x[beyond] <= right:
        last = beyond
    return float(curve.x[last]), float(np.clip(curve.y[last], bottom, top))


def _fraction(axes: Axes, which: str, value: float) -> float:
    """Position of a value between the limits of an axis."""
    axis, limits = (axes.xaxis, axes.get_xlim()) if which == "x" else (axes.yaxis, axes.get_ylim())
    low, high, here = axis.get_transform().transform(np.array([*limits, value]))
    return float((here - low) / (high - low))


def spread(ideal: FloatArray, sizes: FloatArray) -> FloatArray:
    """Place labels of these sizes between 0 and 1 without overlap, in order and as close as possible to ideal centres.

    This minimises the sum of squared shifts: neighbours that would overlap form a block about their mean. Labels that
    need more room than there is are centred.
    """
    order = np.argsort(ideal, kind="stable")
    blocks: list[tuple[float, float, list[int]]] = []  # centre, size, members
    for label in order:
        block = (_kept(float(ideal[label]), float(sizes[label])), float(sizes[label]), [int(label)])
        while blocks and blocks[-1][0] + blocks[-1][1] / 2.0 > block[0] - block[1] / 2.0:
            centre, size, members = blocks.pop()
            together = [*members, *block[2]]
            offsets = np.cumsum(sizes[together]) - sizes[together] / 2.0
            whole = size + block[1]
            # The sum of squared shifts is least where the block begins at the mean of what its members ask for.
            block = (_kept(float(np.mean(ideal[together] - offsets)) + whole / 2.0, whole), whole, together)
        blocks.append(block)
    placed = np.empty(len(ideal))
    for centre, size, members in blocks:
        placed[members] = centre - size / 2.0 + np.cumsum(sizes[members]) - sizes[members] / 2.0
    return placed


def _kept(centre: float, size: float) -> float:
    """The centre of a block once it is moved into the panel; the middle if the block does not fit."""
    return 0.5 if size >= 1.0 else min(max(centre, size / 2.0), 1.0 - size / 2.0)


def beneath(curves: Sequence[FloatArray], limits: tuple[float, float]) -> list[int]:
    """Count, for each curve, the later ones that hide part of it on a logarithmic axis; all have the same abscissas.

    A curve under n others is drawn n steps wider, so that its colour shows on both sides of theirs.
    """
    low, high = np.log(limits)
    levels = [np.log(np.where(np.isfinite(curve) & (curve > 0.0), curve, np.nan)) for curve in curves]
    return [sum(_cover(curve, other, high - low) for other in levels[k + 1 :]) for k, curve in enumerate(levels)]


def _cover(curve: FloatArray, other: FloatArray, height: float) -> bool:
    apart = np.abs(curve - other)
    gaps = apart[np.isfinite(apart)]
    return bool(gaps.size and np.mean(gaps < _TOGETHER * height) > _LONG_TOGETHER)

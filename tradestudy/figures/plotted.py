"""Draw a figure and read its curves, so that a page can show their values."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.collections import PolyCollection, QuadMesh
from matplotlib.colors import to_hex
from matplotlib.container import ErrorbarContainer
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.text import Text
from matplotlib.ticker import FixedFormatter

from tradestudy.figures.drawing import Curve, Panel, Plotted, Scale
from tradestudy.figures.style import SOFT, StudyFigure

_MOST_CELLS: Final = 20_000  # of a map, each of which takes 5 bytes of a page
_POINTS_PER_INCH: Final = 72.0
_UNNAMED: Final = re.compile(r"_child\d+|_nolegend_|")  # the labels that matplotlib gives to unnamed artists
_TICK: Final = re.compile(r"(\d[\d.,]*)\s*(.*)")
_UNIT: Final = re.compile(r"\[([^\]]+)\]|\(([^)]*m)\)$")

Numbers = npt.NDArray[np.float64]


def plotted(figure: StudyFigure) -> Plotted:
    """Draw a figure and read its curves, in the order in which they were plotted."""
    with _identified(figure) as gids:
        svg = figure.svg()
        return Plotted(svg=svg, panels=tuple(_panel(figure, axes, gids) for axes in _panels(figure)))


def _panels(figure: StudyFigure) -> list[Axes]:
    return [axes for axes in figure.axes if axes.get_visible() and axes.axison and axes.get_label() != "<colorbar>"]


@contextmanager
def _identified(figure: StudyFigure) -> Iterator[Mapping[Artist, str]]:
    """Give every panel and artist an identifier that is unique in the SVG; yields the original `gid` of each."""
    gids: dict[Artist, str | None] = {}
    for place, axes in enumerate(_panels(figure)):
        for number, artist in enumerate((axes, *_artists(axes))):
            gids[artist] = artist.get_gid()
            artist.set_gid(f"panel-{place}-{number}")
    try:
        yield {artist: gid or "" for artist, gid in gids.items()}
    finally:
        for artist, gid in gids.items():
            artist.set_gid(gid)


def _artists(axes: Axes) -> tuple[Artist, ...]:
    return (*axes.lines, *axes.collections, *axes.patches, *axes.texts, *axes.images)


def _panel(figure: StudyFigure, axes: Axes, gids: Mapping[Artist, str]) -> Panel:
    width, height = figure.get_size_inches() * _POINTS_PER_INCH
    box = axes.get_position()
    errors = dict(_errors(axes))
    return Panel(
        id=_identifier(axes),
        title=axes.get_title(loc="left") or axes.get_title(),
        box=(box.x0 * width, (1.0 - box.y1) * height, box.x1 * width, (1.0 - box.y0) * height),
        x=_scale(
            axes.xaxis,
            axes.get_xlim(),
            [figure.get_supxlabel(), *(panel.get_xlabel() for panel in axes.get_shared_x_axes().get_siblings(axes))],
        ),
        y=_scale(
            axes.yaxis,
            axes.get_ylim(),
            [figure.get_supylabel(), *(panel.get_ylabel() for panel in axes.get_shared_y_axes().get_siblings(axes))],
        ),
        curves=tuple(curve for artist in _artists(axes) for curve in _curves(axes, artist, gids[artist], errors)),
        anchors=tuple(_anchors(axes)),
    )


def _identifier(artist: Artist) -> str:
    return str(artist.get_gid())


def _scale(axis: Axis, ends: tuple[float, float], shared: Sequence[str]) -> Scale:
    """Read an axis; one without a label takes that of an axis that shares its limits, or of the figure."""
    formatter = axis.get_major_formatter()
    label = " ".join((axis.get_label_text() or max(shared, key=len)).split())
    # If a formatter writes any number, how it writes 1 shows its factor and unit.
    places, ticks = np.asarray(axis.get_majorticklocs(), dtype=np.float64).tolist(), [(1.0, formatter(1.0))]
    if isinstance(formatter, FixedFormatter):
        ticks = list(zip(places, formatter.seq, strict=False))
    elif not ticks[0][1]:  # as of an axis whose ticks have texts
        ticks = [(place, text) for place in places if (text := formatter(place))]
    written = _written(ticks)
    names = {} if written else {f"{place:g}": text for place, text in ticks}
    factor, suffix = written or (1.0, "")
    unit = _UNIT.search(label)
    return Scale(
        kind=axis.get_scale(),
        low=float(ends[0]),
        high=float(ends[1]),
        linear_within=float(getattr(axis.get_transform(), "linthresh", 0.0)),
        label=_UNIT.sub("", label).strip(),
        unit=suffix or ((unit[1] or unit[2]) if unit else ""),
        factor=factor,
        names=names,
    )


def _written(ticks: Sequence[tuple[float, str]]) -> tuple[float, str] | None:
    """The factor from data to the numbers on their axis, and the text after these numbers; None if ticks are names."""
    written = set()
    for place, text in ticks:
        tick = _TICK.fullmatch(text.lstrip("+"))
        if tick is None:
            return None
        if place:  # 0 gives no factor
            written.add((round(float(tick[1].replace(",", "")) / place, 9), tick[2]))
    return written.pop() if len(written) == 1 else None


def _curves(axes: Axes, artist: Artist, name: str, errors: Mapping[Line2D, tuple[str, Numbers]]) -> Iterator[Curve]:
    """The curves that an artist shows; none if it has no name or does not lie at data coordinates."""
    label = str(artist.get_label() or "")  # histograms have None
    of_bars, bars = errors.get(artist, ("", None)) if isinstance(artist, Line2D) else ("", None)
    label = of_bars if _UNNAMED.fullmatch(label) else label
    common: dict[str, Any] = {"id": _identifier(artist), "name": name, "label": label}
    if not name and (not label or isinstance(artist, Text)):
        return
    if isinstance(artist, Line2D) and artist.get_transform() is axes.transData:
        x, y = (np.asarray(values, dtype=np.float64) for values in artist.get_data())
        line: Any = artist.get_color()
        kind = "points" if artist.get_linestyle() in ("None", "", " ") else "line"
        yield Curve(kind=kind, color=to_hex(line), x=_stored(x), y=_stored(y), **common)
        if bars is not None:
            yield Curve(kind="band", color=to_hex(line), **_stored_band(bars), **common)
    elif isinstance(artist, (QuadMesh, AxesImage)):
        unit = _UNIT.search(label)
        words = {"label": _UNIT.sub("", label).strip(), "unit": (unit[1] or unit[2]) if unit else ""}
        yield Curve(kind="map", color="", **_stored_map(artist), **common | words)
    elif isinstance(artist, PolyCollection) and len(artist.get_facecolor()):
        shade: Any = artist.get_facecolor()
        color = to_hex(shade[0])
        vertices = np.concatenate([path.vertices for path in artist.get_paths()] or [np.empty((0, 2))])
        yield Curve(kind="band", color=color, **_stored_band(np.asarray(vertices, dtype=np.float64)), **common)
    else:
        face: Any = artist.get_facecolor() if isinstance(artist, Patch) else SOFT
        color = to_hex(face)
        yield Curve(kind="shape", color=color, **common)


def _errors(axes: Axes) -> Iterator[tuple[Line2D, tuple[str, Numbers]]]:
    """Vertical error bars, by the markers in their middle: the label and the ends of each."""
    for container in axes.containers:
        if isinstance(container, ErrorbarContainer) and container.lines[0] is not None:
            line, _, bars = container.lines
            # A bar without finite ends has no points.
            ends = [
                np.concatenate([np.empty((0, 2)), *(segment for segment in bar.get_segments() if len(segment))])
                for bar in bars
            ]
            label = str(container.get_label())
            if container.has_yerr and not _UNNAMED.fullmatch(label):
                yield line, (label, ends[-1])


def _stored_band(vertices: Numbers) -> dict[str, Any]:
    """The lowest and the highest ordinate of an outline at each abscissa."""
    x, place = np.unique(vertices[:, 0], return_inverse=True)
    low, high = np.full(x.shape, np.inf), np.full(x.shape, -np.inf)
    np.minimum.at(low, place, vertices[:, 1])
    np.maximum.at(high, place, vertices[:, 1])
    return {"x": _stored(x), "y": _stored(low), "top": _stored(high)}


def _stored_map(shown: QuadMesh | AxesImage) -> dict[str, Any]:
    """The edges of the columns and rows of a map, and its values; nothing where a page could not contain them all."""
    values = np.ma.filled(np.ma.asarray(shown.get_array(), dtype=np.float64), np.nan)
    if values.ndim != 2 or values.size > _MOST_CELLS:
        return {}
    if isinstance(shown, QuadMesh):
        corners = np.asarray(shown.get_coordinates(), dtype=np.float64)
        across, up = corners[0, :, 0], corners[:, 0, 1]
    else:
        left, right, bottom, top = shown.get_extent()  # the values begin with the row at the origin
        first, last = (top, bottom) if shown.origin == "upper" else (bottom, top)
        across, up = (
            np.linspace(*ends, n + 1)
            for ends, n in zip(((left, right), (first, last)), values.shape[::-1], strict=True)
        )
    return {"x": _stored(across), "y": _stored(up), "top": _stored(values)}


def _anchors(axes: Axes) -> Iterator[tuple[str, bool, bool]]:
    for text in axes.texts:
        moves = _moves(axes, text)
        if any(moves) and text.get_text():
            yield _identifier(text), *moves


def _moves(axes: Axes, text: Text) -> tuple[bool, bool]:
    """Whether a text is placed at data coordinates along x and along y."""
    coordinates = getattr(text, "xycoords", None)
    if coordinates is None:  # not an annotation
        at_data = text.get_transform() is axes.transData
        return at_data, at_data
    across, up = coordinates if isinstance(coordinates, tuple) else (coordinates, coordinates)
    beside = getattr(text, "anncoords", "data") == "axes fraction"  # names beside a panel stay there
    return across == "data" and not beside, up == "data" and not beside


def _stored(values: Numbers) -> bytes:
    return values.astype("<f8").tobytes()

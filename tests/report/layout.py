"""Whether a figure can be read: no text on another, none beyond the canvas, none cut off."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from tradestudy.figures.style import styled

_TOUCH = 1.5  # points that boxes may share: letters fill less than their boxes
_LEAST_LETTERS = 7.0  # points


def unreadable(figure: Figure) -> list[str]:
    """What is wrong with the texts of a figure as it is drawn; nothing where all can be read."""
    with styled():
        canvas = FigureCanvasAgg(figure)
        figure.draw_without_rendering()
        boxes = [(text, box) for text in _texts(figure) if (box := _box(text, canvas)) is not None]
    page = Bbox.from_bounds(0.0, 0.0, *(figure.get_size_inches() * 72.0))
    found = [f"{text.get_text()!r} leaves the canvas" for text, box in boxes if not _inside(box, page)]
    found += [f"{text.get_text()!r} is cut off" for text, _ in boxes if text.get_text().endswith("…")]
    found += [f"{text.get_text()!r} is too small" for text, _ in boxes if text.get_fontsize() < _LEAST_LETTERS]
    for (one, first), (other, second) in itertools.combinations(boxes, 2):
        if _overlap(first, second):
            found.append(f"{one.get_text()!r} lies on {other.get_text()!r}")
    return found


def _texts(figure: Figure) -> Iterator[Text]:
    """Every visible text; tick labels only where their ticks are inside the axis."""
    hidden = {axes for axes in figure.findobj(Axes) if not axes.get_visible()}
    ticks: set[Text] = set()
    for axes in figure.findobj(Axes):
        for axis in (axes.xaxis, axes.yaxis):
            every = [label for tick in (*axis.majorTicks, *axis.minorTicks) for label in (tick.label1, tick.label2)]
            shown = set(axis.get_ticklabels(which="both")) if axes not in hidden else set()
            low, high = sorted(axis.get_view_interval())
            slack = 1e-9 * (high - low)
            ticks |= {
                label
                for label in every
                if label not in shown
                or not low - slack <= label.get_position()[0 if axis is axes.xaxis else 1] <= high + slack
            }
    for text in figure.findobj(Text):
        if text in ticks or not text.get_visible() or not text.get_text().strip() or text.axes in hidden:
            continue
        yield text


def _box(text: Text, canvas: FigureCanvasAgg) -> Bbox | None:
    """The box of the letters alone, without the arrow of an annotation, in points; upright texts too."""
    box = Text.get_window_extent(text, canvas.get_renderer())
    scale = 72.0 / text.get_figure(root=True).dpi
    return Bbox(box.get_points() * scale) if box.width > 0.0 and box.height > 0.0 else None


def _inside(box: Bbox, page: Bbox) -> bool:
    return bool(
        box.x0 >= page.x0 - _TOUCH
        and box.y0 >= page.y0 - _TOUCH
        and box.x1 <= page.x1 + _TOUCH
        and box.y1 <= page.y1 + _TOUCH
    )


def _overlap(one: Bbox, other: Bbox) -> bool:
    across = min(one.x1, other.x1) - max(one.x0, other.x0)
    up = min(one.y1, other.y1) - max(one.y0, other.y0)
    return across > _TOUCH and up > _TOUCH

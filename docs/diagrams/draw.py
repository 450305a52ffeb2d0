"""Draw the diagrams of the documentation: ``python docs/diagrams/draw.py`` writes the SVG files beside this one.

Every ray obeys the thin-lens equation at the lenses drawn, which are wider and stronger than real ones, to show
angles.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Final

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

HERE: Final = Path(__file__).parent
WIDTH: Final = 4.2  # inches: a telephone shows it nearly at full size
INK, SOFT, BLUE, RED, GOLD, GROUND = "#1c1f24", "#5b626c", "#0072b2", "#b84a00", "#8a6d00", "#ffffff"
PALE_BLUE, PALE_RED = "#d3e6f3", "#f7dccb"
DARK: Final = {
    INK: "#e8eaed", SOFT: "#a9b0ba", GROUND: "#15171a",
    BLUE: "#6db8ee", RED: "#ff9d5c", GOLD: "#dcb43a", PALE_BLUE: "#123c58", PALE_RED: "#5a2f14",
}  # fmt: skip
"""Each colour on a light ground, and what replaces it where the reader prefers a dark one."""


def image_distance(focal_length: float, object_distance: float) -> float:
    """Where a thin lens forms the image, 1/b = 1/f - 1/a; an object distance below 0 is behind the lens."""
    return 1.0 / (1.0 / focal_length - 1.0 / object_distance)


def baseline_within_the_pupil() -> Figure:
    """Two microlenses see a point through two parts of the main lens's pupil."""
    focal_length, object_distance, array, gap, pitch, half = 2.0, 5.0, 4.6, 0.62, 0.75, 0.36
    image = image_distance(focal_length, object_distance)
    figure, axes = _panel(3.3, (-5.4, 6.0), (-3.3, 3.9))
    _lens(axes, 0.0, 3.0)
    _text(axes, 0.0, 3.15, "main lens", side="center", below=False)
    seen_from = []
    for centre, colour, pale in ((pitch, BLUE, PALE_BLUE), (-pitch, RED, PALE_RED)):
        edges = [-(centre + side * half) * image / (array - image) for side in (1.0, -1.0)]
        axes.fill([-object_distance, 0.0, 0.0], [0.0, *edges], color=pale, linewidth=0.0)
        axes.fill([0.0, image, 0.0], [edges[0], 0.0, edges[1]], color=pale, linewidth=0.0)
        part = -centre * image / (array - image)
        hit = centre * (array + gap - image) / (array - image)
        ends = [0.0, centre - half, hit, centre + half]
        axes.fill([image, array, array + gap, array], ends, color=pale, linewidth=0.0)
        axes.plot([-object_distance, 0.0, image, array + gap], [0.0, part, 0.0, hit], color=colour, linewidth=1.4)
        seen_from.append(part)
    for centre in (2.0 * pitch, pitch, 0.0, -pitch, -2.0 * pitch):
        _lens(axes, array, half, centre, thickness=0.09)
    axes.plot([array + gap] * 2, [-2.1, 2.1], color=INK, linewidth=2.0)
    axes.plot([-object_distance, image], [0.0, 0.0], "o", color=INK, markersize=4.0)
    _arrow(axes, (-0.45, seen_from[0]), (-0.45, seen_from[1]))
    _text(axes, -0.6, 0.0, "baseline", side="right", middle=True, colour=INK, weight="bold")
    _text(axes, -5.3, -0.3, "point")
    axes.plot([image, image], [0.15, 1.25], color=SOFT, linewidth=0.8)
    _text(axes, image, 1.3, "its image", side="center", below=False)
    _text(axes, array - 0.1, 2.3, "microlenses", side="center", below=False)
    _text(axes, array + gap + 0.1, -2.3, "sensor", side="center")
    return figure


def planes_and_pupils() -> Figure:
    """Where the distances of a thick lens count from: its principal planes, and its pupils, which are images."""
    focal_length, object_distance, entrance, front, rear, rim = 2.0, 4.6, 0.5, -0.5, 0.5, 0.95
    image = rear + image_distance(focal_length, object_distance)
    leaving = rear + image_distance(focal_length, -entrance)
    start, pupil = front - object_distance, front + entrance
    figure, axes = _panel(3.3, (-5.6, 4.9), (-3.5, 2.9))
    axes.plot([start, image + 0.5], [0.0, 0.0], color=SOFT, linewidth=0.8)
    for sign in (1.0, -1.0):
        height = sign * rim * object_distance / (object_distance + entrance)
        axes.plot([start, front, rear, image], [0.0, height, height, 0.0], color=BLUE, linewidth=1.4)
        axes.plot([front, pupil], [height, sign * rim], color=BLUE, linewidth=1.0, linestyle=(0, (2, 2)))
    for x, name in ((front, "H"), (rear, "H′")):
        axes.plot([x, x], [-1.5, 1.5], color=INK, linewidth=1.2, linestyle=(0, (4, 2)))
        _text(axes, x, 1.55, name, side="center", below=False, colour=INK, weight="bold")
    for x, radius, colour, side, name in (
        (pupil, rim, RED, "right", "entrance pupil"),
        (leaving, rim * focal_length / (focal_length + entrance), GOLD, "left", "exit pupil"),
    ):
        for sign in (1.0, -1.0):
            axes.plot([x, x], [sign * radius, sign * 1.4], color=colour, linewidth=2.4)
        axes.plot([x, x], [1.4, 2.3], color=colour, linewidth=0.8)
        _text(axes, x, 2.35, name, side=side, below=False, colour=colour)
    axes.plot([image, image], [-1.0, 1.0], color=INK, linewidth=2.0)
    _text(axes, image, 1.1, "array", side="center", below=False)
    for left, right, y, words in (
        (start, front, -1.9, "distances of a plenoptic camera"),
        (start, pupil, -2.7, "distances of any other camera"),
        (rear, image, -1.9, "to the array"),
    ):
        _arrow(axes, (left, y), (right, y))
        _text(axes, (left + right) / 2.0, y - 0.08, words, side="center")
    return figure


def keplerian_and_galilean() -> Figure:
    """The image of the main lens lies before the microlenses, or would lie behind them."""
    figure = _sheet(4.5)
    object_distance, array, gap, radius = 5.0, 3.6, 0.75, 0.8
    for k, (title, before_array) in enumerate(
        (("Keplerian: image before the array", 1.3), ("Galilean: image behind the array", -1.6))
    ):
        image = array - before_array
        axes = _axes(figure, (0.0, 0.5 - 0.5 * k, 1.0, 0.5), (-5.4, 6.0), (-1.9, 2.4))
        height = 1.5
        for edge in (radius * 0.4, -radius * 0.4):
            pupil = edge * image / -before_array
            axes.plot([-object_distance, 0.0, array], [0.0, pupil, edge], color=BLUE, linewidth=1.3)
            axes.plot([array, array + gap], [edge, 0.0], color=BLUE, linewidth=1.3)
            beyond = [array, image] if before_array < 0.0 else []
            axes.plot(beyond, [edge, 0.0][: len(beyond)], color=BLUE, linewidth=1.0, linestyle=(0, (3, 2)))
        _lens(axes, 0.0, height)
        _lens(axes, array, 0.62, thickness=0.14)
        axes.plot([array + gap] * 2, [-0.75, 0.75], color=INK, linewidth=2.0)
        axes.plot([-object_distance], [0.0], "o", color=INK, markersize=4.0)
        axes.plot([image], [0.0], "o", color=INK, markersize=4.0, fillstyle="full" if before_array > 0.0 else "none")
        _text(axes, -5.3, 2.3, title, colour=INK, weight="bold")
        _text(axes, -5.3, -0.25, "point")
        _text(axes, 0.0, -1.6, "main lens", side="center")
        _text(axes, image + (0.1 if before_array < 0.0 else -0.1), -0.3, "image", side="center")
        _text(axes, array - 0.1, -0.85, "microlens", side="right")
        _text(axes, array + gap, -0.85, "sensor", side="left")
    return figure


def total_covering_plane() -> Figure:
    """How many microlenses see a point depends on how far before the array its image lies."""
    gap, pitch = 1.0, 1.0
    figure, axes = _panel(4.2, (-4.3, 2.9), (-1.0, 8.3))
    centres = [k + 0.5 for k in range(7)]
    for centre in centres:
        _lens(axes, 0.0, 0.46, centre, thickness=0.12)
    axes.plot([gap] * 2, [0.0, 7.0], color=INK, linewidth=2.0)
    # By matched f-numbers, the light of a point widens by one pitch over each gap.
    for virtual_depth, height, colour, pale in (
        (1.0, 0.75, RED, PALE_RED),
        (2.0, 3.0, BLUE, PALE_BLUE),
        (3.0, 5.5, BLUE, PALE_BLUE),
    ):
        reach = 0.5 * virtual_depth * pitch
        axes.fill([-virtual_depth * gap, 0.0, 0.0], [height, height - reach, height + reach], color=pale, linewidth=0.0)
        for edge in (height - reach, height + reach):
            axes.plot([-virtual_depth * gap, 0.0], [height, edge], color=colour, linewidth=1.2)
        axes.plot([-virtual_depth * gap], [height], "o", color=colour, markersize=4.5)
        for centre in centres:
            if abs(centre - height) < reach:  # the light of the point covers the middle of this microlens
                _lens(axes, 0.0, 0.46, centre, thickness=0.12, fill=colour)
    axes.plot([-2.0 * gap] * 2, [-0.1, 7.1], color=SOFT, linewidth=1.0, linestyle=(0, (4, 3)))
    _text(axes, -1.15, 0.75, "v = 1", side="right", middle=True, colour=RED, weight="bold")
    _text(axes, -2.15, 3.0, "v = 2", side="right", middle=True, colour=BLUE, weight="bold")
    _text(axes, -3.15, 5.5, "v = 3", side="right", middle=True, colour=BLUE, weight="bold")
    for height, words in ((0.75, "one\nmicrolens\nsees it"), (3.0, "two"), (5.5, "three")):
        _text(axes, gap + 0.15, height, words, middle=True)
    _text(axes, -2.0, 7.15, "image of the total\ncovering plane", side="center", below=False, colour=INK)
    _text(axes, 0.0, -0.15, "micro-\nlenses", side="center")
    _text(axes, gap, -0.15, "sensor", side="center")
    return figure


def yaw_pitch_roll() -> Figure:
    """How the right camera can be rotated, and what each rotation does to its picture."""
    figure = _sheet(4.6)
    rows = (
        ("Yaw, from above", "the picture moves\nsideways: an error\nof disparity, and\nso of depth"),
        ("Pitch, from the right", "the picture moves\nup or down: rows\nno longer match"),
        ("Roll, from the front", "the picture turns:\ndisparity changes\nfrom top to bottom"),
    )
    for k, (title, words) in enumerate(rows):
        axes = _axes(figure, (0.0, 1.0 - (k + 1) / 3.0, 1.0, 1.0 / 3.0), (0.0, 12.6), (-2.1, 2.5))
        _text(axes, 0.2, 2.4, title, colour=INK, weight="bold")
        turn = math.radians(16.0)
        if k == 0:
            _camera(axes, (1.0, -0.9), 0.0)
            axes.plot([1.55, 2.85], [-0.9, -0.9], color=SOFT, linewidth=2.0)
            _camera(axes, (3.4, -0.9), 0.0, ghost=True)
            _camera(axes, (3.4, -0.9), turn)
            _text(axes, 1.0, -1.35, "left", side="center")
            _text(axes, 3.4, -1.35, "right", side="center")
            shift, angle = (0.5, 0.0), 0.0
        elif k == 1:
            _camera(axes, (1.4, -0.4), -math.pi / 2.0, ghost=True)
            _camera(axes, (1.4, -0.4), -math.pi / 2.0 + turn)
            shift, angle = (0.0, -0.42), 0.0
        else:
            for x, rotated in ((1.0, 0.0), (3.4, 0.0), (3.4, turn)):
                ghost = x > 2.0 and rotated == 0.0
                _frame(axes, (x, -0.3), (1.7, 1.2), rotated, SOFT if ghost else INK, dashed=ghost)
                axes.plot([x], [-0.3], "o", color=INK, markersize=6.0, fillstyle="none")
            shift, angle = (0.0, 0.0), turn
        _frame(axes, (6.1, -0.2), (2.0, 1.5), 0.0, SOFT, dashed=True)
        _frame(axes, (6.1 + shift[0], -0.2 + shift[1]), (2.0, 1.5), angle, BLUE)
        _text(axes, 8.0, -0.2, words, middle=True, colour=INK)
    return figure


def overlap_and_occlusion() -> Figure:
    """What both cameras of a stereo rig see, and what a step hides from one of them."""
    figure = _sheet(5.4)
    baseline, half_field, distance = 1.6, math.tan(math.radians(30.0)), 3.6
    axes = _axes(figure, (0.0, 0.46, 1.0, 0.54), (-4.1, 4.1), (-1.0, 4.9))
    width = half_field * distance
    left, right = -baseline / 2.0, baseline / 2.0
    for x, colour in ((left, BLUE), (right, RED)):
        axes.plot([x - width, x, x + width], [distance, 0.0, distance], color=colour, linewidth=1.3)
        axes.plot([x], [0.0], "o", color=colour, markersize=5.0)
    meet = baseline / 2.0 / half_field
    axes.fill([0.0, right - width, left + width], [meet, distance, distance], color=PALE_BLUE, linewidth=0.0, zorder=0)
    axes.plot([left - width, right + width], [distance] * 2, color=INK, linewidth=1.6)
    _text(axes, 0.0, 3.1, "overlap", side="center", middle=True, colour=INK, weight="bold")
    _arrow(axes, (left, -0.25), (right, -0.25))
    _text(axes, 0.0, -0.33, "baseline B", side="center")
    _arrow(axes, (left - width, distance + 0.25), (left + width, distance + 0.25))
    _text(axes, left, distance + 0.33, "width W that the left camera sees", side="center", below=False)
    _arrow(axes, (3.55, 0.0), (3.55, distance))
    _text(axes, 3.45, 0.8, "Z", side="right")
    _text(axes, -4.0, 0.6, "overlap =\n1 − B/W", colour=INK)

    axes = _axes(figure, (0.0, 0.0, 1.0, 0.46), (-4.1, 4.1), (-0.7, 4.35))
    far, near = 3.6, 2.5
    edge = 1.2
    hidden = [x + (edge - x) * far / near for x in (right, left)]
    for x, ground, colour in ((left, hidden[1], BLUE), (right, hidden[0], RED)):
        axes.plot([x, ground], [0.0, far], color=colour, linewidth=1.3)
        axes.plot([x], [0.0], "o", color=colour, markersize=5.0)
    axes.fill([edge, *hidden], [near, far, far], color=PALE_RED, linewidth=0.0, zorder=0)
    axes.plot([-3.0, edge, edge, 3.0], [near, near, far, far], color=INK, linewidth=1.6)
    axes.plot(hidden, [far, far], color=RED, linewidth=4.0)
    _arrow(axes, (3.25, near), (3.25, far))
    _text(axes, 3.35, (near + far) / 2.0, "h", middle=True)
    _text(
        axes,
        4.0,
        far + 0.12,
        "hidden from the left camera:\na strip of width h B/Z",
        below=False,
        side="right",
        colour=INK,
    )
    _text(axes, -1.8, near + 0.1, "step", below=False, side="center")
    _arrow(axes, (-3.4, 0.0), (-3.4, near))
    _text(axes, -3.3, near / 2.0, "Z", middle=True)
    _text(axes, left, -0.15, "left", side="center")
    _text(axes, right, -0.15, "right", side="center")
    return figure


DIAGRAMS: Final[dict[str, Callable[[], Figure]]] = {
    "baseline-within-the-pupil": baseline_within_the_pupil,
    "planes-and-pupils": planes_and_pupils,
    "keplerian-and-galilean": keplerian_and_galilean,
    "total-covering-plane": total_covering_plane,
    "yaw-pitch-roll": yaw_pitch_roll,
    "overlap-and-occlusion": overlap_and_occlusion,
}


def write(folder: Path) -> None:
    """Write every diagram as SVG, with colours for a light and a dark ground."""
    with matplotlib.rc_context({"svg.hashsalt": "diagrams", "font.family": "DejaVu Sans"}):
        for name, draw in DIAGRAMS.items():
            path = folder / f"{name}.svg"
            draw().savefig(path, metadata={"Date": None, "Creator": None})
            path.write_text(_with_dark_colours(path.read_text(encoding="utf-8")), encoding="utf-8")


def _with_dark_colours(svg: str) -> str:
    rules = "".join(
        f'[style*="{place}: {light}"]{{{place}:{dark} !important}}'
        for light, dark in DARK.items()
        for place in ("fill", "stroke")
    )
    return re.sub(r"(<svg[^>]*>)", rf"\1<style>@media (prefers-color-scheme: dark){{{rules}}}</style>", svg, count=1)


def _sheet(height: float) -> Figure:
    return Figure(figsize=(WIDTH, height), facecolor=GROUND)


def _axes(
    figure: Figure, place: tuple[float, float, float, float], x: tuple[float, float], y: tuple[float, float]
) -> Axes:
    axes = figure.add_axes(place)
    axes.set_axis_off()
    axes.set_xlim(*x)
    axes.set_ylim(*y)
    return axes


def _panel(height: float, x: tuple[float, float], y: tuple[float, float]) -> tuple[Figure, Axes]:
    figure = _sheet(height)
    return figure, _axes(figure, (0.0, 0.0, 1.0, 1.0), x, y)


def _text(
    axes: Axes,
    x: float,
    y: float,
    words: str,
    *,
    side: str = "left",
    below: bool = True,
    middle: bool = False,
    colour: str = SOFT,
    weight: str = "normal",
) -> None:
    height = "center" if middle else "top" if below else "bottom"
    axes.text(x, y, words, ha=side, va=height, color=colour, fontsize=9.5, fontweight=weight, linespacing=1.15)


def _lens(axes: Axes, x: float, radius: float, y: float = 0.0, *, thickness: float = 0.3, fill: str = "none") -> None:
    """A biconvex lens across the x axis."""
    angles = [math.pi * k / 40.0 for k in range(41)]
    outline = [(thickness * math.sin(a), radius * math.cos(a)) for a in angles]
    outline += [(-dx, dy) for dx, dy in reversed(outline)]
    axes.fill(
        [x + dx for dx, _ in outline],
        [y + dy for _, dy in outline],
        facecolor=fill,
        edgecolor=INK,
        linewidth=1.2,
        zorder=3,
    )


def _arrow(axes: Axes, start: tuple[float, float], end: tuple[float, float]) -> None:
    axes.annotate(
        "", end, start, arrowprops={"arrowstyle": "<->", "color": INK, "linewidth": 1.2, "shrinkA": 0, "shrinkB": 0}
    )


def _frame(
    axes: Axes,
    middle: tuple[float, float],
    size: tuple[float, float],
    turn: float,
    colour: str,
    *,
    dashed: bool = False,
) -> None:
    """A rectangle turned about its middle."""
    corners = [(dx * size[0] / 2.0, dy * size[1] / 2.0) for dx, dy in ((-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1))]
    x = [middle[0] + dx * math.cos(turn) - dy * math.sin(turn) for dx, dy in corners]
    y = [middle[1] + dx * math.sin(turn) + dy * math.cos(turn) for dx, dy in corners]
    axes.plot(x, y, color=colour, linewidth=1.4, linestyle=(0, (3, 2)) if dashed else "-")


def _camera(axes: Axes, at: tuple[float, float], turn: float, *, ghost: bool = False) -> None:
    """A camera from above: its housing, and its optical axis, which points up at no turn."""
    colour = SOFT if ghost else INK
    _frame(axes, at, (1.1, 0.7), turn, colour, dashed=ghost)
    tip = (at[0] - 2.4 * math.sin(turn), at[1] + 2.4 * math.cos(turn))
    line = {
        "arrowstyle": "->",
        "color": colour if ghost else BLUE,
        "linewidth": 1.3,
        "linestyle": "--" if ghost else "-",
    }
    axes.annotate("", tip, at, arrowprops=line)


if __name__ == "__main__":
    write(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE)

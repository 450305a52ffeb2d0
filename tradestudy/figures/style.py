"""The look of all figures: one page width, one font, one colour and line style per camera, reproducible bytes."""

from __future__ import annotations

import contextlib
import io
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import matplotlib
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.backend_bases import RendererBase
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter, NullLocator
from matplotlib.transforms import Bbox

from tradestudy.figures.fonts import printable
from tradestudy.results.views.finding import cameras_by_weight
from tradestudy.results.views.groups import FloatArray, camera_titles, titles_in

PAGE_WIDTH = 6.8  # inches: the text width of an A4 page
INK, SOFT, FAINT = "#1c1f24", "#5b626c", "#d9dde2"
DECLARED = "declared"
"""The `gid` of artists that are right only for the declared design and the full range of the axes."""

# Okabe and Ito's colours, safe for colour-blind readers, yellow left out (too pale on white).
_COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
# Seven colours and five line styles share no divisor, so that pairs of the two repeat only after 35 cameras.
_DASHES: tuple[Any, ...] = ("-", (0, (5, 1.6)), (0, (1.2, 1.2)), (0, (6, 1.4, 1.2, 1.4)), (0, (9, 2.5)))
SMALL, PANEL_TITLE = 7.0, 8.0  # points: the smallest letters, and titles of panels that are small
_MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">", "p", "h")

_LENGTH_UNITS = ((1e6, "km"), (1e3, "m"), (1.0, "mm"), (1e-3, "µm"), (1e-6, "nm"))  # sizes in millimetres

_RC: dict[Any, Any] = {
    "svg.hashsalt": "tradestudy",  # gives the same identifiers inside the SVG in every run
    "svg.fonttype": "path",  # letters look the same everywhere without an installed font
    "text.parse_math": False,  # a "$" in a camera's name is a dollar
    "text.usetex": False,
    "font.family": ["DejaVu Sans"],
    "font.size": 8.5,
    "axes.titlesize": 9.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titley": 1.0,  # by default, its place is found again in every pass of the layout
    "axes.labelsize": 8.5,
    "axes.labelcolor": INK,
    "axes.edgecolor": SOFT,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.grid": True,
    "grid.color": FAINT,
    "grid.linewidth": 0.5,
    "xtick.color": SOFT,
    "ytick.color": SOFT,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "xtick.minor.width": 0.4,
    "ytick.minor.width": 0.4,
    "text.color": INK,
    "lines.linewidth": 1.6,
    "lines.dash_capstyle": "butt",
    "legend.frameon": False,
    "legend.fontsize": 8,
    "legend.handlelength": 3.4,
    "figure.facecolor": "white",
    "figure.constrained_layout.use": True,
    "hatch.linewidth": 0.4,
    "path.simplify": True,
    "path.simplify_threshold": 0.15,
}


@dataclass(frozen=True, kw_only=True)
class LineStyle:
    """How one camera (or one part of an uncertainty) is drawn in every figure."""

    color: str
    dash: Any
    marker: str

    def handle(self, **more: Any) -> Line2D:
        """Its sample in a legend; `more` adds or replaces properties of the line."""
        return Line2D([], [], **{"color": self.color, "linestyle": self.dash, **more})


def line_style(order: int) -> LineStyle:
    """The style of a camera, by its place in the order of ``/cameras``."""
    return LineStyle(
        color=_COLORS[order % len(_COLORS)],
        dash=_DASHES[order % len(_DASHES)],
        marker=_MARKERS[order % len(_MARKERS)],
    )


def readable(color: str) -> str:
    """A colour for letters on white, darkened if necessary until its contrast is 4.5 (WCAG 2, level AA)."""
    rgb = np.array(to_rgb(color))
    while 1.05 / (_luminance(rgb) + 0.05) < _CONTRAST:
        rgb = 0.95 * rgb
    return to_hex(tuple(rgb.tolist()))


def letters_on(color: str) -> str:
    """The colour of letters on a filled area: nearly black or white, whichever has the higher contrast.

    On dark pages, colours of cameras become lighter and white becomes dark; other fills stay, and so do their letters.
    """
    light = _luminance(np.array(to_rgb(color))) + 0.05
    if 1.05 / light <= light / (_luminance(np.array(to_rgb(_ON_COLOR))) + 0.05):
        return _ON_COLOR
    return "white" if to_hex(color).upper() in _COLORS else _ALWAYS_WHITE


def _luminance(rgb: FloatArray) -> float:
    """Relative luminance of an sRGB colour."""
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    return float(linear @ (0.2126, 0.7152, 0.0722))


_CONTRAST: Final = 4.5
_ALWAYS_WHITE: Final = "#fefefe"  # not white, which dark pages replace
_ON_COLOR: Final = "#1b1e23"  # not INK, which dark pages replace by a light colour although they keep light fills
_HANDLE, _LETTER = 6.5, 0.58  # of a legend, in units of its font size: a line with gaps, and a mean letter
LONGEST_LABEL: Final = 44  # characters
PANELS_IN_A_ROW: Final = 3  # at most, of one camera each
MOST_CAMERAS: Final = 18  # in a figure: their names fit beside a panel, and their panels on a page


@contextlib.contextmanager
def styled() -> Iterator[None]:
    """Apply the settings of all figures for a while, whatever those of a notebook are; restore these afterwards."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_RC)
        yield


class _Panel(Axes):
    """Axes that measure the room for their labels and names once for each layout, which asks twice."""

    _beyond: FloatArray | None = None  # the panel, on each side, as the first pass has measured it [pixels]

    def get_tightbbox(
        self, renderer: RendererBase | None = None, *, for_layout_only: bool = False, **how: Any
    ) -> Bbox | None:
        if for_layout_only and self._beyond is not None and self.get_visible():
            self.apply_aspect()
            ends, self._beyond = np.asarray(self.get_window_extent(renderer).extents) + self._beyond, None
            return Bbox.from_extents(*ends.tolist())
        box: Bbox | None = super().get_tightbbox(renderer, for_layout_only=for_layout_only, **how)
        if for_layout_only and box is not None:
            self._beyond = np.asarray(box.extents) - self.get_window_extent(renderer).extents
        return box


class StudyFigure(Figure):
    """A figure that is drawn in the style of the reports wherever it is shown, even in a notebook."""

    def add_subplot(self, *where: Any, **how: Any) -> Axes:
        """Add a panel as matplotlib does."""
        panel: Axes = super().add_subplot(*where, axes_class=_Panel, **how)
        return panel

    def svg(self) -> bytes:
        """The figure as SVG; equal figures give equal bytes."""
        buffer, canvas, dpi = io.BytesIO(), self.canvas, self.dpi
        nothing = {"Date": None, "Creator": None, "Format": None, "Type": None}
        try:
            with styled():
                # This finds the layout while it draws; `savefig` would draw everything twice, only for the layout.
                FigureCanvasSVG(self).print_svg(buffer, metadata=nothing)  # type: ignore[no-untyped-call]
        finally:
            self.set_canvas(canvas)
            self.dpi = dpi
        return buffer.getvalue()

    def _repr_svg_(self) -> str:
        return self.svg().decode()


def new_figure(height: float) -> StudyFigure:
    """Make an empty figure as wide as a page, height in inches; call this, and all that fills it, inside `styled`."""
    return StudyFigure(figsize=(PAGE_WIDTH, height), layout="constrained")


def panel_size(axes: Axes) -> tuple[float, float]:
    """Width and height of a panel in points, before the final layout, which changes them a little."""
    figure, box = axes.get_figure(root=True), axes.get_position()
    assert figure is not None
    width, height = figure.get_size_inches()
    return 72.0 * box.width * float(width), 72.0 * box.height * float(height)


def shortened(text: str, longest: int = LONGEST_LABEL) -> str:
    """Shorten text to fit a legend or a label."""
    text = printable(text)
    return text if len(text) <= longest else text[: longest - 1].rstrip() + "…"


def plain_number(value: float, _position: int | None = None) -> str:
    """Write a tick label, with a power of ten only where a person would use one."""
    if value == 0 or not math.isfinite(value):
        return "0" if value == 0 else str(value)
    exponent = math.floor(math.log10(abs(value)) + 1e-9)
    if -4 <= exponent <= 5:
        return f"{value:.{max(0, 3 - exponent)}f}".rstrip("0").rstrip(".") if exponent < 3 else f"{value:,.0f}"
    superscript = str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    mantissa = value / 10.0**exponent
    return f"10{superscript}" if math.isclose(mantissa, 1.0) else f"{mantissa:g}·10{superscript}"


def length_tick(millimetres: float, _position: int | None = None) -> str:
    """Write a tick label for a length in millimetres, in the unit that a person expects: 0.01 is "10 µm"."""
    # A length that rounding has made a little too small keeps its unit; one too short for all takes the smallest.
    size, unit = next(
        (size, unit) for size, unit in _LENGTH_UNITS if abs(millimetres) >= size * (1 - 1e-9) or size == 1e-6
    )
    return f"{plain_number(millimetres / size)} {unit}"


def distance_label(farthest: float) -> str:
    """Name an axis of distances that ends at `farthest` [m]: in millimetres below 0.1 m, as in sentences."""
    return "distance [mm]" if farthest < 0.1 else "distance [m]"


def distance_axis(axes: Axes, ends: tuple[float, float], *, dense: bool = False) -> None:
    """Make the horizontal axis a logarithmic one of distances [m], with ticks in the unit of its `distance_label`."""
    log_axis(axes, "x", dense=dense, tick=distance_tick(ends[1]), ends=ends)
    axes.set_xlim(ends)


def distance_tick(farthest: float) -> Callable[[float, int | None], str]:
    """The function that writes the ticks of an axis of distances [m] that ends at `farthest`."""
    return (lambda metres, _position: plain_number(metres * 1e3)) if farthest < 0.1 else plain_number


def log_axis(
    axes: Axes,
    which: str,
    *,
    dense: bool = False,
    tick: Callable[[float, int | None], str] = plain_number,
    ends: tuple[float, float] | None = None,
) -> None:
    """Make an axis logarithmic, with plain numbers.

    Its ticks are powers of ten; between `ends` less than a factor of 3000 apart also 3; and if `dense`, less than a
    factor of 30 apart, or with fewer than two powers of ten between them, 2 and 5 instead. Less than a factor of 10
    apart, they are 1, 2, 3, 5 and 7; less than a factor of 4 apart, they are evenly spaced, since none of these may
    lie between the ends.
    """
    subs: tuple[float, ...] = (1.0, 2.0, 5.0) if dense else (1.0,)
    if ends is not None:
        powers_of_ten = math.floor(math.log10(ends[1])) - math.ceil(math.log10(ends[0])) + 1
        if ends[1] < 10.0 * ends[0]:
            subs = (1.0, 2.0, 3.0, 5.0, 7.0)
        elif dense or ends[1] < 30.0 * ends[0] or powers_of_ten < 2:
            subs = (1.0, 2.0, 5.0)
        elif ends[1] < 3000.0 * ends[0]:
            subs = (1.0, 3.0)
    axis = axes.xaxis if which == "x" else axes.yaxis
    (axes.set_xscale if which == "x" else axes.set_yscale)("log")
    axis.set_major_locator(LogLocator(base=10.0, subs=subs, numticks=20))
    axis.set_major_formatter(FuncFormatter(tick))
    axis.set_minor_locator(NullLocator())  # minor ticks would take a quarter of the time of a figure
    axis.set_minor_formatter(NullFormatter())
    if ends is not None and ends[1] < 4.0 * ends[0]:
        axis.set_major_locator(MaxNLocator(nbins=4))


def legend(
    figure: StudyFigure,
    handles: Sequence[Line2D | Patch],
    labels: Sequence[str],
    columns: int,
    *,
    longest: int = LONGEST_LABEL,
) -> Legend:
    """Draw a legend under the figure, in as many of these columns as fit.

    Labels are literal, even if they start with an underscore, and shortened where too long.
    """
    shown = [shortened(label, longest) for label in labels]
    size = float(matplotlib.rcParams["legend.fontsize"])
    widths = [size * (_HANDLE + _LETTER * len(label)) for label in shown]
    while columns > 1 and _widest_row(widths, columns) > 72.0 * figure.get_figwidth():
        columns -= 1
    # matplotlib would leave out labels that begin with an underscore, so numbers stand for them in this call.
    drawn = figure.legend(
        handles, [f"{number}" for number in range(len(labels))], loc="outside lower center", ncols=columns
    )
    for text, label in zip(drawn.get_texts(), shown, strict=True):
        text.set_text(label)
    return drawn


def _widest_row(widths: Sequence[float], columns: int) -> float:
    """Width of the entries of a legend, which fill one column after the other."""
    rows = -(-len(widths) // columns)
    return sum(max(widths[first : first + rows]) for first in range(0, len(widths), rows))


def camera_panels(
    figure: StudyFigure, count: int, distance: FloatArray, in_a_row: int = PANELS_IN_A_ROW, *, dense: bool = False
) -> list[Axes]:
    """Make panels for `count` cameras over these distances [m], in rows; hide those left over."""
    columns = min(in_a_row, count)
    grid = figure.subplots(-(-count // columns), columns, sharex=True, sharey=True, squeeze=False)
    for axes in grid.flat[count:]:
        axes.set_visible(False)
    ends = float(distance[0]), float(distance[-1])
    distance_axis(grid[0, 0], ends, dense=dense)  # which the other panels share
    for column in range(columns):
        last = grid[(count - 1 - column) // columns, column]
        last.set_xlabel(distance_label(ends[1]))
        last.tick_params(labelbottom=True)
    return list(grid.flat[:count])


def named_rows(axes: Axes, names: Sequence[str]) -> None:
    """Prepare rows for bars with these names, the first at the top."""
    axes.set(yticks=range(len(names)), yticklabels=names, ylim=(len(names) - 0.4, -0.6))
    axes.grid(visible=False, axis="y")
    axes.tick_params(axis="y", length=0)


@dataclass(frozen=True, kw_only=True)
class CameraTrace:
    """The title and line style of a camera in every figure."""

    key: str
    title: str
    style: LineStyle

    def shows(self, variable: str, where: str = "") -> dict[str, Any]:
        """Label and identifier of an artist that shows a variable of this camera; `where` adds a further condition."""
        return {"label": self.title, "gid": "/".join(filter(None, (variable, self.key, where)))}


def traces(tree: xr.DataTree, name: str = "depth", most: int = MOST_CAMERAS) -> tuple[CameraTrace, ...]:
    """The traces of the cameras of a group that figures show; :func:`selection_words` names their choice."""
    every = titles_in(tree, name)
    keys = cameras_by_weight(tree, name)[:most] if len(every) > most else every  # their order does not show
    return tuple(trace for trace in all_traces(tree) if trace.key in keys)


def selection_words(tree: xr.DataTree, name: str = "depth") -> str:
    """Say which cameras of a group figures leave out; empty if none."""
    if (count := len(titles_in(tree, name))) <= MOST_CAMERAS:
        return ""
    return (
        f" The figure shows {MOST_CAMERAS} of {count} cameras: first those that meet requirements or are best at some "
        "distance, then those that the decision compares, then those nearly as certain. The tables contain all."
    )


def all_traces(tree: xr.DataTree) -> tuple[CameraTrace, ...]:
    """The traces of all cameras of a study; their order gives the colours."""
    titles = camera_titles(tree).items()
    return tuple(
        CameraTrace(key=key, title=title, style=line_style(order)) for order, (key, title) in enumerate(titles)
    )

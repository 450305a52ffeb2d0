"""Depth of field as bars over distance, and lateral resolution against distance, with captions and alt texts."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from tradestudy.figures.curves import NamedCurve, beneath, name_ends
from tradestudy.figures.drawing import Drawing
from tradestudy.figures.style import (
    FAINT,
    INK,
    SMALL,
    SOFT,
    CameraTrace,
    StudyFigure,
    all_traces,
    legend,
    length_tick,
    letters_on,
    log_axis,
    named_rows,
    new_figure,
    shortened,
    styled,
)
from tradestudy.figures.value_tables import focus_tables
from tradestudy.results.views.depth import by_first_criterion, sharp_ranges
from tradestudy.results.views.groups import FloatArray, camera_titles
from tradestudy.units import LENGTH, PIXELS, pretty


def focus_drawings(tree: xr.DataTree) -> Iterator[Drawing]:
    """The bars of depth of field and the curves of lateral resolution."""
    yield Drawing(
        name="depth-of-field",
        caption="What each camera keeps sharp, measured from its principal plane: "
        + _criterion_words(tree)
        + ". Neighbouring shades are images of a stack or types of microlenses"
        + (
            "; dotted lines are gaps between them."
            if np.isfinite(by_first_criterion(tree)["gap_near"].values).any()
            else "."
        )
        + _thin_words(tree)
        + " Right: the coarsest resolution within the scene; grey where not all of it is sharp.",
        alt="Bars of depth of field over working distance, one row per camera. " + _sharp_words(tree),
        draw=partial(draw_depth_of_field, tree),
        values=partial(focus_tables, tree),
    )
    yield Drawing(
        name="lateral-resolution",
        caption="Size of the detail that each camera resolves: the largest of the sampling interval, the geometric "
        "blur and the radius of the Airy disc, all on the object. Full colour: where "
        + _criterion_words(tree)
        + "; pale: elsewhere.",
        alt="Log-log chart of resolved detail against distance. " + _resolution_words(tree),
        draw=partial(draw_lateral_resolution, tree),
    )


def _criterion_words(tree: xr.DataTree) -> str:
    first = by_first_criterion(tree)
    measure = str(first["diffraction"].item())
    blur = "the blur of defocus alone" if measure == "none" else f"the blur of defocus and the {measure} of diffraction"
    return f"{blur} is at most {pretty(float(first['blur_px']), PIXELS)}"


def _thin_words(tree: xr.DataTree) -> str:
    data = tree["depth_of_field"].to_dataset()
    if "equal_resolution" not in data.attrs:
        return ""
    size = pretty(float(data.attrs["equal_resolution"]), LENGTH)
    return f" Thin lines below the bars: where {size} on the object is resolved, for a comparison at equal resolution."


def _sharp_words(tree: xr.DataTree) -> str:
    data = by_first_criterion(tree)
    sentences = []
    for key, title in camera_titles(tree).items():
        ranges = sharp_ranges(data.sel(camera=key), "sharp")
        where = " and ".join(f"{pretty(a, LENGTH)} to {pretty(b, LENGTH)}" for a, b in ranges) or "nowhere"
        sentences.append(f"{title}: sharp {where}. ")
    return "".join(sentences)


def _resolution_words(tree: xr.DataTree) -> str:
    data = tree["depth_of_field"].to_dataset()
    middle = (float(data.attrs["scene_near"]) + float(data.attrs["scene_far"])) / 2.0
    sizes = data["lateral_resolution"].sel(distance=middle, method="nearest")
    place = pretty(float(sizes["distance"]), LENGTH)
    values = [
        f"{title} {pretty(size, LENGTH)}"
        for key, title in camera_titles(tree).items()
        if np.isfinite(size := float(sizes.sel(camera=key)))
    ]
    return f"At {place}: " + "; ".join(values) + "."


MM = 1e3
_ROW = 0.27  # inches
_PALE = 0.4  # opacity where a camera is not sharp
_SCENE = "#F5E7B8"
_SHADES = (1.0, 0.6)  # neighbouring slices alternate


@styled()
def draw_depth_of_field(tree: xr.DataTree) -> StudyFigure:
    """Draw one row per camera: slices sharp by the first criterion, above where it resolves a detail of equal size."""
    data, shown = by_first_criterion(tree), all_traces(tree)
    distance = np.asarray(data["distance"].values, dtype=np.float64) * MM
    figure = new_figure(0.95 + _ROW * len(shown))
    axes = figure.subplots()
    log_axis(axes, "x", dense=True)
    axes.set_xlim(distance[0], distance[-1])
    _scene_band(axes, data)
    equal = "resolved_near" in data
    for row, camera in enumerate(shown):
        stretches = data.sel(camera=camera.key)
        _slices(axes, sharp_ranges(stretches, "slice"), row, camera)
        _far_end(axes, sharp_ranges(stretches, "sharp"), row, camera)
        _lines(axes, sharp_ranges(stretches, "gap"), row - 0.08, linewidth=0.6, linestyle=(0, (1, 1)))
        if equal:
            _lines(axes, sharp_ranges(stretches, "resolved"), row + 0.27, linewidth=1.4, solid_capstyle="butt")
    named_rows(axes, [shortened(camera.title) for camera in shown])
    axes.set_xlabel("distance from the principal plane [mm]")
    _resolution_beside(axes, data, shown)
    handles: list[Any] = [Patch(color=_SCENE, linewidth=0), Patch(color=SOFT, linewidth=0)]
    labels = ["the scene", "sharp (shades: images or types)"]
    if equal:
        handles.append(Line2D([], [], color=INK, linewidth=1.4))
        labels.append(f"resolves {pretty(float(data.attrs['equal_resolution']), LENGTH)} or finer")
    legend(figure, handles, labels, columns=3)
    return figure


def _scene_band(axes: Axes, data: xr.Dataset) -> None:
    near, far = float(data.attrs["scene_near"]) * MM, float(data.attrs["scene_far"]) * MM
    axes.axvspan(near, far, color=_SCENE, linewidth=0, zorder=0)


def _clipped(axes: Axes, stretch: tuple[float, float]) -> tuple[float, float] | None:
    """The part of a stretch that lies in the panel, in millimetres; None if no part does."""
    first, last = axes.get_xlim()
    near, far = max(stretch[0] * MM, first), min(stretch[1] * MM, last)
    return (near, far) if near < far else None


def _slices(axes: Axes, slices: tuple[tuple[float, float], ...], row: int, camera: CameraTrace) -> None:
    """Draw the slices of one camera, neighbours in different shades."""
    for number, stretch in enumerate(slices):
        if (inside := _clipped(axes, stretch)) is not None:
            near, far = inside
            shade = _SHADES[number % len(_SHADES)]
            axes.barh(row - 0.08, far - near, 0.44, near, color=camera.style.color, alpha=shade, linewidth=0)


def _far_end(axes: Axes, sharp: tuple[tuple[float, float], ...], row: int, camera: CameraTrace) -> None:
    """Write the far end of what is sharp if it lies beyond the panel."""
    last = axes.get_xlim()[1]
    for near, far in sharp:
        if near * MM < last < far * MM:
            axes.annotate(
                "to ∞" if np.isinf(far) else f"to {pretty(far, LENGTH)}",
                (last, row - 0.08),
                xytext=(-3, 0),
                textcoords="offset points",
                ha="right",
                va="center",
                color=letters_on(camera.style.color),
                fontsize=SMALL,
                fontweight="bold",
            )


def _lines(axes: Axes, stretches: tuple[tuple[float, float], ...], height: float, **style: Any) -> None:
    """Draw the part of each stretch that lies in the panel as a line."""
    for stretch in stretches:
        if (inside := _clipped(axes, stretch)) is not None:
            axes.plot(inside, [height] * 2, color=INK, **style)


def _resolution_beside(axes: Axes, data: xr.Dataset, shown: tuple[CameraTrace, ...]) -> None:
    """Write what each camera resolves on the scene, to the right of its row."""
    for row, camera in enumerate(shown):
        share = float(data["scene_share"].sel(camera=camera.key))
        text = pretty(float(data["scene_resolution"].sel(camera=camera.key)), LENGTH) if share > 0 else "–"
        axes.annotate(
            text,
            (1.0, row),
            xycoords=("axes fraction", "data"),
            xytext=(40, 0),
            textcoords="offset points",
            ha="right",
            va="center",
            fontsize=SMALL,
            color=INK if share >= 1.0 else SOFT,
            annotation_clip=False,
        )
    axes.annotate(
        "resolves\nin scene",
        (1.0, 1.0),
        xycoords="axes fraction",
        xytext=(40, 2),
        textcoords="offset points",
        ha="right",
        va="bottom",
        fontsize=SMALL,
        color=SOFT,
        annotation_clip=False,
    )


@styled()
def draw_lateral_resolution(tree: xr.DataTree) -> StudyFigure:
    """Draw the size of detail that each camera resolves, in full colour where it is sharp by the first criterion."""
    data, shown = by_first_criterion(tree), all_traces(tree)
    distance = np.asarray(data["distance"].values, dtype=np.float64)
    figure = new_figure(3.9)
    axes = figure.subplots()
    log_axis(axes, "x", dense=True)
    log_axis(axes, "y", dense=True, tick=length_tick)
    axes.set_xlim(distance[0] * MM, distance[-1] * MM)
    _scene_band(axes, data)
    sizes = [np.asarray(data["lateral_resolution"].sel(camera=c.key).values, dtype=np.float64) * MM for c in shown]
    limits = _size_limits(np.concatenate(sizes))
    axes.set(ylim=limits, xlabel="distance from the principal plane [mm]", ylabel="detail resolved on the object")
    for camera, size, under in zip(shown, sizes, beneath(sizes, limits), strict=True):
        sharp = _inside(distance, sharp_ranges(data.sel(camera=camera.key), "sharp"))
        line = {"color": camera.style.color, "linestyle": camera.style.dash, "label": camera.title}
        line["zorder"] = 2.0 - 0.01 * under
        axes.plot(distance * MM, size, linewidth=0.8 + 0.8 * under, alpha=_PALE, **line)
        line |= camera.shows("lateral_resolution", "usable")
        axes.plot(distance * MM, np.where(sharp, size, np.nan), linewidth=1.8 + 1.2 * under, **line)
    name_ends(
        axes,
        [
            NamedCurve(name=c.title, color=c.style.color, x=distance * MM, y=size)
            for c, size in zip(shown, sizes, strict=True)
        ],
    )
    handles: list[Any] = [Line2D([], [], color=SOFT, linewidth=1.8, alpha=alpha) for alpha in (1.0, _PALE)]
    handles.append(Patch(color=_SCENE, linewidth=0))
    labels = ["sharp", "not sharp", "the scene"]
    if "equal_resolution" in data.attrs:
        equal = float(data.attrs["equal_resolution"])
        axes.axhline(equal * MM, color=INK, linewidth=0.9)
        handles.append(Line2D([], [], color=INK, linewidth=0.9))
        labels.append(f"equal resolution, {pretty(equal, LENGTH)}")
    legend(figure, handles, labels, columns=4)
    axes.grid(visible=True, color=FAINT)
    return figure


def _inside(distance: FloatArray, where: tuple[tuple[float, float], ...]) -> Any:
    held = np.zeros(distance.shape, dtype=bool)
    for near, far in where:
        held |= (distance >= near) & (distance <= far)
    return held


def _size_limits(size: FloatArray) -> tuple[float, float]:
    """Limits from below the finest detail up to the coarsest, at most three decades above."""
    finite = size[np.isfinite(size) & (size > 0.0)]
    if not finite.size:
        return 1e-3, 1.0
    low = float(finite.min()) / 1.4
    return low, min(float(finite.max()) * 1.4, low * 1e3)

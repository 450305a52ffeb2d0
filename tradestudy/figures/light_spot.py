"""The light spot by every method, side by side, and the spread of single points."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.gridspec import SubplotSpec
from matplotlib.image import AxesImage

from tradestudy.figures.curves import NamedCurve, beneath, name_ends
from tradestudy.figures.drawing import Drawing
from tradestudy.figures.style import (
    PANEL_TITLE,
    SMALL,
    SOFT,
    StudyFigure,
    line_style,
    log_axis,
    new_figure,
    plain_number,
    shortened,
    styled,
)
from tradestudy.figures.value_tables import light_tables
from tradestudy.light_methods import short_title
from tradestudy.results.views.groups import FloatArray
from tradestudy.results.views.wave_optics import element_title, reference_method
from tradestudy.units import FRACTION, LENGTH, pretty, significant

_DARKEST = 1e-4  # decades of the cut
_SPREADS = {
    "half_energy_radius": "50 % of the light",
    "energy_radius_80": "80 % of the light",
    "rms_width": "RMS distance",
    "full_width": "full width at half maximum",
}
_VARIED = {
    "f_number": "f-number",
    "wavelength": "wavelength (nm)",
    "field_angle": "field angle (°)",
    "defocus": "defocus (waves)",
}
_SHOWN_IN = {"f_number": 1.0, "wavelength": 1e9, "field_angle": 180.0 / np.pi, "defocus": 1.0}


def light_drawings(tree: xr.DataTree) -> Iterator[Drawing]:
    """The figures of ``/images`` and ``/point_spread``, with what they show in words."""
    if "images" in tree.children:
        data = tree["images"].to_dataset()
        reference = reference_method(data)
        yield Drawing(
            name="light_spot",
            caption="The light spot on the detector by every method, relative to the brightest pixel of all."
            + (
                f" Below: the difference from {short_title(reference)}, in per cent of its brightest pixel."
                if data.sizes["propagator"] > 1
                else ""
            )
            + " Bottom: a cut through the middle row of pixels.",
            alt="Images of a spot behind an array of microlenses. " + _image_words(data, reference),
            draw=partial(draw_light_spot, tree),
            values=partial(light_tables, tree),
        )
    if "point_spread" in tree.children:
        spread = tree["point_spread"].to_dataset()
        yield Drawing(
            name="point_spread",
            caption="Spread of a point behind each lens, one quantity varied at a time: radii of the circles around "
            "the thin-lens image that contain 50 % and 80 % of the light; root-mean-square distance of the light from "
            f"that image, within {plain_number(float(spread.attrs['rms_radius']))} Airy radii; full width at half "
            "maximum. Defocus is in waves of path at the rim of the pupil. Solid: Kirchhoff, with its numerical error "
            "as a bar; pale and dotted: Fresnel. Grey line: pixel pitch."
            + (" A bar across the whole panel: the error exceeds the width." if _undetermined(spread) else ""),
            alt="Line charts of widths, one row per lens, one column per varied quantity. " + _spread_words(spread),
            draw=partial(draw_point_spread, tree),
        )


def _image_words(data: xr.Dataset, reference: str) -> str:
    sentences = []
    for method in data["propagator"].values:
        image = data.sel(propagator=method)
        text = f"{short_title(str(method))}: {int(image['lit_pixels'])} lit pixels"
        if method != reference:
            difference = float(image["difference"].sel(against=reference))
            text += f", summed difference from {short_title(reference)} {pretty(difference, FRACTION)}"
        sentences.append(text + ". ")
    return "".join(sentences)


@styled()
def draw_light_spot(tree: xr.DataTree) -> StudyFigure:
    """Draw the images, their signed differences from the reference below them, and a cut through all at the foot."""
    data = tree["images"].to_dataset()
    reference = reference_method(data)
    others = [str(method) for method in data["propagator"].values if method != reference]
    methods = [*others, reference]
    image = data["image"]
    exact = np.asarray(image.sel(propagator=reference).values, dtype=float)
    brightest = float(max(image.sel(propagator=method).max() for method in methods))
    figure = new_figure(5.6 if others else 3.9)
    grid = figure.add_gridspec(3 if others else 2, len(methods) + 1, width_ratios=[*[1.0] * len(methods), 0.07])
    for column, method in enumerate(methods):
        axes = figure.add_subplot(grid[0, column])
        shown = _picture(axes, data, np.asarray(image.sel(propagator=method)) / brightest, "inferno", 0.0, 1.0)
        axes.set_title(short_title(method).replace(" + ", " +\n"), fontsize=PANEL_TITLE)
    _scale(figure, shown, grid[0, -1], "light on a pixel")
    if others:
        changes = {
            method: 100 * (np.asarray(image.sel(propagator=method).values) - exact) / float(exact.max())
            for method in others
        }
        span = max(float(np.abs(change).max()) for change in changes.values()) or 1.0
        for column, method in enumerate(others):
            axes = figure.add_subplot(grid[1, column])
            changed = _picture(axes, data, changes[method], "RdBu_r", -span, span)
            axes.set_title(
                f"minus {short_title(reference)}".replace(" + ", " +\n"), fontsize=SMALL, fontweight="normal"
            )
        _scale(figure, changed, grid[1, len(others)].subgridspec(1, 12)[0], "% of the brightest pixel")
    _cut(figure.add_subplot(grid[-1, :]), data, methods)
    return figure


def _scale(figure: StudyFigure, shown: AxesImage, place: SubplotSpec, label: str) -> None:
    bar = figure.colorbar(shown, cax=figure.add_subplot(place))
    bar.set_label(label, fontsize=SMALL)
    bar.ax.tick_params(labelsize=SMALL)
    bar.outline.set_visible(False)


def _picture(axes: Axes, data: xr.Dataset, values: FloatArray, colors: str, low: float, high: float) -> AxesImage:
    """Draw one image in micrometres with the edges of the microlens cells."""
    x, y = (np.asarray(data[axis].values, dtype=float) * 1e6 for axis in ("column", "row"))
    step = (x[1] - x[0]) / 2
    extent = (x[0] - step, x[-1] + step, y[0] - step, y[-1] + step)
    shown = axes.imshow(values, origin="lower", extent=extent, cmap=colors, vmin=low, vmax=high, interpolation="none")
    axes.grid(visible=False)
    color = "white" if colors == "inferno" else SOFT
    axes.add_collection(LineCollection(_cells(data), colors=color, linewidths=0.35, alpha=0.6), autolim=False)
    ticks, (first, last) = [extent[0], 0.0, extent[1]], (f"{end:.0f}".replace("-", "−") for end in extent[:2])
    is_left = axes.get_subplotspec().is_first_col()  # type: ignore[union-attr]  # it was added to a grid
    axes.set_xticks(ticks, [first, "0", f"{last} µm"] if is_left else [""] * len(ticks))
    axes.set_yticks([])
    axes.spines[:].set_visible(False)
    return shown


def _cells(data: xr.Dataset) -> list[FloatArray]:
    """Closed outlines of the microlens cells in micrometres."""
    pitch = 1e6 * float(data.attrs["microlens_pitch"])
    corners, reach = (6, pitch / 3**0.5) if data.attrs["microlens_layout"] == "hexagonal" else (4, pitch / 2**0.5)
    angle = np.pi / corners + 2 * np.pi * np.arange(corners + 1) / corners
    outline = reach * np.column_stack([np.cos(angle), np.sin(angle)])
    centres = 1e6 * np.column_stack([data["microlens_x"].values, data["microlens_y"].values])
    return [centre + outline for centre in centres]


def _cut(axes: Axes, data: xr.Dataset, methods: list[str]) -> None:
    """Draw the light along the middle row of pixels over four decades, down to where only waves reach."""
    x = np.asarray(data["column"].values, dtype=float) * 1e6
    middle = data.sizes["row"] // 2
    top = float(data["image"].sel(propagator=methods[-1]).max())
    styles = {str(method): line_style(order) for order, method in enumerate(data["propagator"].values)}
    cuts = [
        np.maximum(
            np.asarray(data["image"].sel(propagator=method).isel(row=middle).values, dtype=float) / top, _DARKEST
        )
        for method in methods
    ]
    for method, cut, under in zip(methods, cuts, beneath(cuts, (_DARKEST, 2.0)), strict=True):
        style = styles[method]
        axes.plot(
            x, cut, color=style.color, linestyle=style.dash, linewidth=1.2 + 1.2 * under, label=short_title(method)
        )
    log_axis(axes, "y")
    axes.set(
        ylim=(_DARKEST, 2),
        xlim=(x[0], x[-1]),
        xlabel="place along the middle row of pixels (µm)",
        ylabel="light, brightest = 1",
    )
    drawn = zip(methods, cuts, strict=True)
    name_ends(axes, [NamedCurve(name=short_title(m), color=styles[m].color, x=x, y=cut) for m, cut in drawn])


@styled()
def draw_point_spread(tree: xr.DataTree) -> StudyFigure:
    """Draw widths against each varied quantity, with a row per lens."""
    data = tree["point_spread"].to_dataset()
    elements, varied = ([str(v) for v in data[dim].values] for dim in ("element", "varied"))
    figure = new_figure(0.5 + 1.9 * len(elements))
    panels = figure.subplots(len(elements), len(varied), squeeze=False, sharey="row")
    for row, element in enumerate(elements):
        for column, quantity in enumerate(varied):
            _spread_panel(panels[row, column], data.sel(element=element, varied=quantity), _SHOWN_IN[quantity])
        panels[row, 0].set_ylabel(f"{shortened(element_title(data, element), 24)} (µm)")
        panels[row, 0].set_ylim(bottom=0)
    for axes, quantity in zip(panels[-1], varied, strict=True):
        axes.set_xlabel(_VARIED[quantity])
    for axes, element in zip(panels[:, -1], elements, strict=True):
        name_ends(axes, list(_widths(data.sel(element=element, varied=varied[-1]), _SHOWN_IN[varied[-1]])))
    return figure


def _widths(data: xr.Dataset, scale: float) -> Iterator[NamedCurve]:
    """Draw the curves of a panel by Kirchhoff's integral."""
    place = scale * np.asarray(data["value"].values, dtype=float)
    for order, (variable, words) in enumerate(_SPREADS.items()):
        values = 1e6 * np.asarray(data[variable].sel(propagator="kirchhoff").values, dtype=float)
        yield NamedCurve(name=words, color=line_style(order).color, x=place, y=values)


def _spread_panel(axes: Axes, data: xr.Dataset, scale: float) -> None:
    place = scale * np.asarray(data["value"].values, dtype=float)
    axes.axhline(1e6 * float(data.attrs["pixel_pitch"]), color=SOFT, linewidth=0.8)
    for method in ("fresnel", "kirchhoff"):
        exact = method == "kirchhoff"
        for order, (variable, words) in enumerate(_SPREADS.items()):
            style = line_style(order)
            axes.errorbar(
                place,
                1e6 * np.asarray(data[variable].sel(propagator=method).values, dtype=float),
                yerr=1e6 * np.asarray(data[f"{variable}_error"].sel(propagator=method).values, dtype=float)
                if exact
                else None,
                color=style.color,
                linestyle="-" if exact else (0, (1, 1.5)),
                linewidth=1.2 if exact else 0.9,
                alpha=1.0 if exact else 0.55,
                marker=style.marker if exact else None,
                markersize=3,
                elinewidth=0.7,
                label=words if exact else f"{words}, Fresnel",
            )


def _undetermined(data: xr.Dataset) -> bool:
    """Whether the error of any drawn width exceeds the width itself."""
    exact = data.sel(propagator="kirchhoff")
    return any(bool((exact[f"{variable}_error"] > exact[variable]).any()) for variable in _SPREADS)


def _spread_words(data: xr.Dataset) -> str:
    """The half-energy radius and Strehl ratio of every lens as declared, in words."""
    sentences = []
    for element in data["element"].values:
        lens = data.sel(element=element, varied="f_number")
        values = np.asarray(lens["value"].values, dtype=float)
        step = int(np.nanargmin(np.abs(values - float(lens["standing"]))))
        for method in data["propagator"].values:
            point = lens.sel(propagator=method).isel(step=step)
            radius = float(point["half_energy_radius"])
            if np.isfinite(radius):
                sentences.append(
                    f"{lens['title'].item()} at f/{significant(float(values[step]))} by {short_title(str(method))}: "
                    "half the light within "
                    f"{pretty(radius, LENGTH)}, Strehl ratio {significant(float(point['strehl_ratio']))}. "
                )
    return "".join(sentences)

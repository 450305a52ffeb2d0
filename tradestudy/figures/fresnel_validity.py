"""Fresnel against Kirchhoff: error over f-number, criteria that predict it, and the criterion printed in the paper."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from tradestudy.figures.curves import NamedCurve, beneath, name_ends
from tradestudy.figures.drawing import Drawing, ValueTable
from tradestudy.figures.style import (
    FAINT,
    INK,
    SMALL,
    SOFT,
    StudyFigure,
    line_style,
    new_figure,
    plain_number,
    shortened,
    styled,
)
from tradestudy.figures.value_tables import Tables
from tradestudy.results.views.groups import FloatArray
from tradestudy.results.views.wave_optics import element_title, middle_window, published_place
from tradestudy.units import FRACTION, LENGTH, NUMBER, pretty, significant

_ROOM = 1.4  # an axis ends at this factor beyond the largest and the smallest error
_ZEROS = {"first": "smaller zero", "second": "larger zero"}  # of eq. 27
_F_NUMBERS = (1, 1.4, 2, 2.8, 4, 5.6, 8, 11, 16, 22, 32, 45, 64)
_PERCENT = (0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1, 3, 10, 30, 100, 300, 1000, 3000, 10000)


def fresnel_drawings(tree: xr.DataTree) -> Iterator[Drawing]:
    """The figures of ``/fresnel_validity``, with what they show in words."""
    data = tree["fresnel_validity"].to_dataset()
    window = plain_number(middle_window(data))
    waves, phase = _wavelength_words(data), _first_phase(data)
    limit = pretty(data.attrs["error_limit"], FRACTION)
    aside = ""
    if "off_axis_error" in data:
        aside = (
            f" Lower charts: {np.degrees(data.attrs['field_angle']):.2g}° off the axis, at "
            f"{pretty(data.attrs['field_wavelength'], LENGTH)}."
        )
    yield Drawing(
        name="fresnel_error",
        caption="Error of Fresnel's point-spread function in focus on the axis, against f-number: summed difference "
        f"from Kirchhoff's over {window} Airy radii. Bands: {waves}. Stars: values of Figure 6 of “Diffraction model "
        "of a plenoptic camera for in-situ space exploration” (the paper). Dotted: the camera's f-number. Parabolic: "
        "with spherical aberration, as in the paper; stigmatic: without it on the axis; perfect: without aberrations."
        + aside,
        alt="Log-log charts of error against f-number, one column per lens, one line per lens phase. " + _words(data),
        draw=partial(draw_fresnel_error, tree),
    )
    yield Drawing(
        name="fresnel_criteria",
        caption="Minimum f-number for Fresnel's approximation. Bars: ranges over the wavelengths, and for eq. 27 also "
        f"over a quarter wave of path. Blue: the f-number from which the computed error ({phase} phase) stays below "
        f"{limit}; the others are criteria in closed form. Shaded: the paper's criterion; diamonds: its values as "
        "printed. Dotted: the camera's f-number.",
        alt="Bar chart of minimum f-numbers, one panel per lens, one row per criterion. " + _criteria_words(data),
        draw=partial(draw_fresnel_criteria, tree),
        values=partial(_criteria_tables, data),
    )
    yield Drawing(
        name="paper_eq27",
        caption="f-numbers by both zeros of eq. 27 while the path from object to image grows by two quarter waves, a "
        f"fraction of a micrometre. Lines: {waves}. Black: the f-number that the paper prints for the larger zero.",
        alt="Charts of minimum f-number against extra path within one quarter wave. The smaller zero falls from "
        "infinity, the larger one drifts by a fifth and jumps back. " + _sweep_words(data),
        draw=partial(draw_paper_eq27, tree),
        values=partial(_zero_tables, data),
    )


def _wavelength_words(data: xr.Dataset) -> str:
    waves = [float(w) for w in data["wavelength"].values]
    if len(waves) == 1:
        return pretty(waves[0], LENGTH)
    return f"wavelengths from {pretty(waves[0], LENGTH)} to {pretty(waves[-1], LENGTH)}"


def _first_phase(data: xr.Dataset) -> str:
    """The phase of which the criteria and the described errors are: parabolic, where the study asks for it."""
    return str(data["lens_phase"].values[0])


def _words(data: xr.Dataset) -> str:
    sentences = []
    phase = _first_phase(data)
    point = data["published_point_error"].sel(metric="l1", window=middle_window(data), lens_phase=phase)
    for element in data["element"].values:
        values = np.asarray(point.sel(element=element).values, dtype=float)
        place = published_place(data, str(element))
        low, high = pretty(float(values.min()), FRACTION), pretty(float(values.max()), FRACTION)
        sentences.append(f"{element_title(data, element)} at f/{significant(place)}, {phase} phase: {low} to {high}. ")
    return "".join(sentences)


@styled()
def draw_fresnel_error(tree: xr.DataTree) -> StudyFigure:
    """Draw error against f-number, with a column per lens, and a second row for the point off the axis."""
    data = tree["fresnel_validity"].to_dataset()
    rows = 2 if "off_axis_error" in data else 1
    elements = [str(element) for element in data["element"].values]
    figure = new_figure(0.3 + 2.45 * rows)
    panels = figure.subplots(rows, len(elements), squeeze=False, sharey="row", sharex=True)
    window = middle_window(data)
    errors = ("psf_error", "off_axis_error")[:rows]
    for row, (line, variable) in enumerate(zip(panels, errors, strict=True)):
        shown = [
            _error_panel(axes, data, element, data[variable].sel(element=element, metric="l1", window=window), row == 0)
            for axes, element in zip(line, elements, strict=True)
        ]
        positive = np.concatenate([curve.y[curve.y > 0.0] for curves in shown for curve in curves])
        line[0].set_ylim(float(positive.min()) / _ROOM, float(positive.max()) * _ROOM)  # of the whole row
        for axes, curves in zip(line, shown, strict=True):
            name_ends(axes, curves)
    for axes, element in zip(panels[0], elements, strict=True):
        axes.set_title(shortened(element_title(data, element)))
    for axes in panels[-1]:
        axes.set_xlabel("f-number")
    panels[0, 0].set_ylabel("error on the axis")
    if rows == 2:
        panels[1, 0].set_ylabel(f"error {np.degrees(data.attrs['field_angle']):.2g}° off the axis")
    return figure


def _error_panel(axes: Axes, data: xr.Dataset, element: str, error: xr.DataArray, is_on_axis: bool) -> list[NamedCurve]:
    """Draw one line per lens phase over f-number; a band where the error has a wavelength dimension."""
    f_number = np.asarray(data["f_number"].values, dtype=float)
    _f_number_axis(axes, f_number)
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(FixedLocator(_PERCENT))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _position: f"{plain_number(value)} %"))
    phases = [str(phase) for phase in data["lens_phase"].values]
    every = [100 * np.asarray(error.sel(lens_phase=phase).values, dtype=float) for phase in phases]
    middle = [lines[(len(lines) - 1) // 2] if lines.ndim == 2 else lines for lines in every]
    positive = [values[np.isfinite(values) & (values > 0.0)] for values in middle]
    ends = min(float(values.min()) for values in positive), max(float(values.max()) for values in positive)
    for order, (phase, lines, under) in enumerate(zip(phases, every, beneath(middle, ends), strict=True)):
        style = line_style(order)
        if lines.ndim == 2:
            axes.fill_between(
                f_number, lines.min(axis=0), lines.max(axis=0),
                color=style.color, alpha=0.18, linewidth=0, label=phase,
            )  # fmt: skip
        axes.plot(
            f_number,
            middle[order],
            color=style.color,
            linestyle=style.dash,
            linewidth=1.6 + 1.2 * under,
            label=phase,
        )
    limit = 100 * float(data.attrs["error_limit"])
    axes.axhline(limit, color=INK, linewidth=0.7)
    axes.annotate(
        f"{plain_number(limit)} %", (f_number[-1], limit), xytext=(-2, 2), textcoords="offset points", ha="right",
        fontsize=SMALL, color=INK,
    )  # fmt: skip
    _mark_camera(axes, data, element)
    published = data[["published_f_number", "published_error"]].sel(element=element)
    if is_on_axis and np.isfinite(float(published["published_error"])):
        axes.plot(
            float(published["published_f_number"]),
            100 * float(published["published_error"]),
            marker="*",
            markersize=10,
            color=INK,
            markeredgecolor="white",
            zorder=5,
        )
    return [
        NamedCurve(name=phase, color=line_style(order).color, x=f_number, y=values)
        for order, (phase, values) in enumerate(zip(phases, middle, strict=True))
    ]


def _mark_camera(axes: Axes, data: xr.Dataset, element: str) -> None:
    """Draw the f-number of the camera as a dotted line."""
    camera = float(data["camera_f_number"].sel(element=element))
    axes.axvline(camera, color=SOFT, linewidth=0.9, linestyle=(0, (1, 1.5)))


def _f_number_axis(axes: Axes, inside: FloatArray) -> None:
    axes.set_xscale("log")
    axes.set_xlim(float(inside.min()), float(inside.max()))
    axes.xaxis.set_major_locator(FixedLocator(_F_NUMBERS))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _position: f"f/{plain_number(value)}"))


def _criteria(data: xr.Dataset, element: str) -> list[tuple[str, FloatArray, bool]]:
    """List every criterion with its f-numbers over the wavelengths, and whether they follow from computed errors."""
    lens = data.sel(element=element)

    def of(variable: str, **where: Any) -> FloatArray:
        return np.asarray(lens[variable].sel(**where).values, dtype=float)

    zeros = [of("paper_eq27_sweep", zero=zero) for zero in ("first", "second")]
    closed_forms = [
        ("eq. 27, smaller zero", zeros[0].ravel(), False),
        ("eq. 27, larger zero", zeros[1].ravel(), False),
        ("one radian of phase (Goodman)", of("goodman_f_number"), False),
        *(
            (f"{plain_number(float(waves))} waves of path", of("path_error_f_number", path_error=waves), False)
            for waves in data["path_error"].values
        ),
        ("plane wave, bare hole (Southwell)", of("southwell_f_number"), False),
    ]
    limits = lens["limit_f_number"].sel(lens_phase=_first_phase(data))
    measured = [("peak", limits.sel(metric="peak").isel(window=0))] + [
        (f"{plain_number(float(window))} Airy radii", limits.sel(metric="l1", window=window))
        for window in data["window"].values
    ]
    return closed_forms + [
        (f"computed, {measure}", np.asarray(limit.values, dtype=float), True) for measure, limit in measured
    ]


@styled()
def draw_fresnel_criteria(tree: xr.DataTree) -> StudyFigure:
    """Draw one row per criterion: a bar over the wavelengths, with an arrow where it leaves the axis."""
    data = tree["fresnel_validity"].to_dataset()
    elements = [str(element) for element in data["element"].values]
    names = [criterion for criterion, _, _ in _criteria(data, elements[0])]
    figure = new_figure(1.0 + 0.24 * len(names))
    panels = figure.subplots(1, len(elements), squeeze=False, sharey=True)[0]
    for axes, element in zip(panels, elements, strict=True):
        _criteria_panel(axes, data, element)
        axes.set(title=shortened(element_title(data, element)), xlabel="minimum f-number")
    panels[0].set(yticks=range(len(names)), yticklabels=names, ylim=(len(names) - 0.4, -0.6))
    return figure


def _criteria_panel(axes: Axes, data: xr.Dataset, element: str) -> None:
    f_number = np.asarray(data["f_number"].values, dtype=float)
    low, high = min(1.0, float(f_number[0])), 24.0
    _f_number_axis(axes, np.array([low, high]))
    axes.xaxis.set_major_locator(FixedLocator(_F_NUMBERS[::2]))
    axes.grid(visible=False, axis="y")
    _mark_camera(axes, data, element)
    for row, (_, values, measured) in enumerate(_criteria(data, element)):
        color = line_style(0).color if measured else (line_style(1).color if row < 2 else SOFT)
        if np.all(values == 0):  # below the limit at every f-number compared
            axes.annotate(
                "", (low, row), xytext=(float(f_number[0]), row), arrowprops={"arrowstyle": "->", "color": color}
            )
            axes.plot(float(f_number[0]), row, marker="|", color=color, markersize=7)
            continue
        start, end = max(float(values.min()), float(f_number[0])), float(values.max())
        axes.plot([start, min(end, high)], [row, row], color=color, linewidth=4.5, solid_capstyle="butt")
        if end > high:
            axes.annotate("", (high, row), xytext=(high / 1.25, row), arrowprops={"arrowstyle": "->", "color": color})
        if end / start < 1.02:  # too short a bar to be seen
            axes.plot(start, row, marker="o", markersize=4.5, color=color)
    printed = float(data["published_minimum"].sel(element=element))
    if np.isfinite(printed):
        axes.plot([printed, printed], [0, 1], linestyle="", marker="D", markersize=4.5, color=INK, zorder=5)
    axes.axhspan(-0.6, 1.5, color=FAINT, alpha=0.45, linewidth=0, zorder=0)


def _criteria_tables(data: xr.Dataset) -> Tables:
    elements = [str(element) for element in data["element"].values]
    every = [_criteria(data, element) for element in elements]
    rows = [
        (criteria[0][0], *(_ends_words(values) for _, values, _ in criteria)) for criteria in zip(*every, strict=True)
    ]
    columns = ("Criterion", *(element_title(data, element) for element in elements))
    return (ValueTable(caption="Minimum f-numbers over the wavelengths", columns=columns, rows=tuple(rows)),)


def _zero_tables(data: xr.Dataset) -> Tables:
    elements = [str(element) for element in data["element"].values]
    rows = []
    for zero, zero_words in _ZEROS.items():
        for wave in data["wavelength"].values:
            sweep = data["paper_eq27_sweep"].sel(zero=zero, wavelength=wave)
            ends = [_ends_words(np.asarray(sweep.sel(element=element).values, dtype=float)) for element in elements]
            rows.append((f"{zero_words}, {pretty(float(wave), LENGTH)}", *ends))
    columns = ("Zero", *(element_title(data, element) for element in elements))
    return (ValueTable(caption="Minimum f-numbers of eq. 27 within a quarter wave", columns=columns, rows=tuple(rows)),)


def _ends_words(values: FloatArray) -> str:
    """Write the ends of a range of f-numbers; 0 stands for a smallest compared one that is already large enough."""
    low, high = (pretty(float(end), NUMBER) if end > 0.0 else "below all" for end in (values.min(), values.max()))
    return low if low == high else f"{low} to {high}"


def _criteria_words(data: xr.Dataset) -> str:
    sentences = []
    for element in data["element"].values:
        parts = [
            f"{criterion} {significant(float(values.min()))} to "
            f"{significant(float(values.max())) if np.isfinite(values.max()) else 'infinity'}"
            for criterion, values, _ in _criteria(data, str(element))
            if values.max() > 0
        ]
        sentences.append(f"{element_title(data, element)}: {'; '.join(parts)}. ")
    return "".join(sentences)


@styled()
def draw_paper_eq27(tree: xr.DataTree) -> StudyFigure:
    """Draw both zeros over one quarter-wave period, in one panel per lens, since they belong to one criterion."""
    data = tree["fresnel_validity"].to_dataset()
    elements = [str(element) for element in data["element"].values]
    figure = new_figure(2.9)
    panels = figure.subplots(1, len(elements), squeeze=False)[0]
    share = np.asarray(data["quarter_wave"].values, dtype=float)
    waves = data["wavelength"].values
    for axes, element in zip(panels, elements, strict=True):
        sweep = data["paper_eq27_sweep"].sel(element=element)
        printed = float(data["published_minimum"].sel(element=element))
        top = 1.15 * max(float(sweep.sel(zero="second").max()) * 1.6, printed if np.isfinite(printed) else 0.0)
        drawn: list[NamedCurve] = []
        for number, wave in enumerate(waves):
            for order, zero in enumerate(_ZEROS):
                values = np.asarray(sweep.sel(zero=zero, wavelength=wave).values, dtype=float)
                style, middle = line_style(order), number == (len(waves) - 1) // 2
                x, y = np.concatenate([share, 1 + share]), np.concatenate([values, values])
                axes.plot(
                    x,
                    y,
                    color=style.color,
                    linestyle=style.dash,
                    linewidth=1.7 if middle else 0.7,
                    alpha=1.0 if middle else 0.6,
                )
                if middle:
                    drawn.append(NamedCurve(name=_ZEROS[zero], color=style.color, x=x, y=y))
        if np.isfinite(printed):
            axes.axhline(printed, color=INK, linewidth=0.9, linestyle=(0, (4, 2)))
            axes.annotate(
                f"printed: {plain_number(printed)}", (2, printed), xytext=(-2, 2), textcoords="offset points",
                ha="right", va="bottom", fontsize=SMALL,
            )  # fmt: skip
        axes.set(
            xlim=(0, 2),
            ylim=(0, top),
            title=shortened(element_title(data, element)),
            xlabel="extra path [quarter waves]",
        )
        name_ends(axes, drawn)
    panels[0].set_ylabel("minimum f-number of eq. 27")
    return figure


def _sweep_words(data: xr.Dataset) -> str:
    sentences = []
    for element in data["element"].values:
        second = data["paper_eq27_sweep"].sel(element=element, zero="second")
        first = data["paper_eq27_f_number"].sel(element=element, zero="first")
        title = element_title(data, element)
        sentences.append(
            f"{title}: the larger zero lies between {significant(float(second.min()))} and "
            f"{significant(float(second.max()))}; the smaller one, at the declared lengths, between "
            f"{significant(float(first.min()))} and {significant(float(first.max()))}. "
        )
    return "".join(sentences)

"""Where Fresnel may replace Kirchhoff: the answer, the errors by every measure, the criteria."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import xarray as xr

from tradestudy.figures.drawing import Drawing
from tradestudy.report.document import (
    Block,
    Bullets,
    Callout,
    Column,
    Equation,
    Heading,
    Paragraph,
    Spans,
    Table,
    Text,
    pictures_of,
    say,
)
from tradestudy.report.words import length, share
from tradestudy.results.views.groups import FloatArray, group, has
from tradestudy.results.views.wave_optics import element_title, middle_window, published_place, where_fresnel
from tradestudy.units import significant
from tradestudy.wording import listed

_METRICS = {"peak": "Peak", "l1": "L1", "largest": "Largest"}


def describe_fresnel_answer(tree: xr.DataTree) -> Iterator[Block]:
    """Say how large the error of Fresnel's law is at the f-numbers of the camera, on the axis and off it."""
    if not has(tree, "fresnel_validity", "psf_error"):
        return
    data = group(tree, "fresnel_validity")
    yield Heading(text="The answer", anchor="fresnel-answer")
    yield Callout(
        title="Error of Fresnel's approximation in the cameras",
        blocks=(
            Paragraph(
                f"The error of Fresnel's point-spread function is its absolute difference from Kirchhoff's, integrated "
                f"within {significant(middle_window(data))} Airy radii and divided by the integral of Kirchhoff's. "
                "It is the error of one point in focus; pixels, which add up the light of many points, differ less: a "
                "study with a light spot computes by how much. "
                "Parabolic lenses have spherical aberration, stigmatic ones none on the axis, perfect ones none at all."
            ),
            Bullets(tuple(_findings(data))),
        ),
        tone="answer",
    )


def describe_fresnel_validity(tree: xr.DataTree) -> Iterator[Block]:
    """Explain how the error is measured, and write its size by every measure."""
    if not has(tree, "fresnel_validity", "psf_error"):
        return
    data = group(tree, "fresnel_validity")
    yield Heading(text="Fresnel against Kirchhoff", anchor="fresnel-validity")
    yield from _measures(data)
    for element in data["element"].values:
        yield _error_table(data, str(element))
    yield _limit_table(data)


def describe_fresnel_criteria(tree: xr.DataTree, drawings: Mapping[str, Drawing]) -> Iterator[Block]:
    """Compare the computed f-numbers with criteria in closed form, among them the paper's."""
    if not has(tree, "fresnel_validity", "psf_error"):
        return
    data = group(tree, "fresnel_validity")
    yield Heading(text="Criteria in closed form", anchor="fresnel-criteria")
    yield from pictures_of(drawings, "fresnel_criteria")
    yield _criteria_table(data)
    yield from _printed_criterion(data, drawings)


def _range(values: FloatArray) -> str:
    """Write the smallest and the largest share as a range, or one share if they read the same."""
    low, high = share(float(np.min(values))), share(float(np.max(values)))
    return low if low == high else f"{low} to {high}"


def _findings(data: xr.Dataset) -> Iterator[Spans]:
    used = data.sel(metric="l1", window=middle_window(data))
    yield say(
        "**On the axis**, at the f-numbers of the camera and wavelengths from {start} to {end}, take: {each}.",
        start=length(float(data["wavelength"].values[0])),
        end=length(float(data["wavelength"].values[-1])),
        each=_advice(used, "camera_point_error"),
    )
    if "off_axis_error" in data:
        yield say(
            "**{angle}° off the axis**, at the same f-numbers and {wavelength}, take: {each}. There, a parabolic or "
            "stigmatic lens has coma and distortion, which Fresnel's approximation ignores.",
            angle=significant(float(np.degrees(data.attrs["field_angle"])), 2),
            wavelength=length(float(data.attrs["field_wavelength"])),
            each=_advice(used, "off_axis_camera_error", "off_axis_error"),
        )


def _advice(used: xr.Dataset, errors: str, curves: str = "") -> str:
    """Which method to take behind each lens, by its phase; with `curves`, also from which f-number Fresnel suffices."""
    limit, phases, sentences = float(used.attrs["error_limit"]), list(map(str, used["lens_phase"].values)), []
    for element in used["element"].values:
        of_element, advice = used.sel(element=element), []
        by_phase = {phase: np.ravel(of_element[errors].sel(lens_phase=phase).values) for phase in phases}
        for method in ("Kirchhoff", "Fresnel"):
            alike = [phase for phase in phases if bool(np.all(by_phase[phase] <= limit)) == (method == "Fresnel")]
            if not alike:
                continue
            detail = f"Fresnel errs by {_range(np.concatenate([by_phase[phase] for phase in alike]))}"
            if curves:
                curve = of_element[curves]
                from_here = max(_from_f_number(curve.sel(lens_phase=phase), limit) for phase in alike)
                # Otherwise it suffices at all or none of the f-numbers tried, which may lie beside that of the camera.
                detail += f" and suffices {where_fresnel(from_here)}" if 0.0 < from_here < np.inf else ""
            which = "whatever the phase" if 1 < len(phases) == len(alike) else f"if {listed(alike, 'or')}"
            advice.append(f"{method} {which} ({detail})")
        f_number = significant(float(of_element["camera_f_number"]))
        sentences.append(f"{element_title(used, str(element)).lower()}, f/{f_number}: {', '.join(advice)}")
    return "; ".join(sentences)


def _from_f_number(errors: xr.DataArray, limit: float) -> float:
    """The f-number from which errors stay within a limit, between those tried as for a power law; or 0, or infinity."""
    tried, above = errors["f_number"].values, np.flatnonzero(errors.values > limit)
    if not above.size:
        return 0.0
    # The last f-number above the limit and the next, in reverse, because `np.interp` needs rising errors.
    ends = slice(above[-1] + 1, above[-1] - 1 if above[-1] else None, -1)
    logs = np.log(errors.values[ends]), np.log(tried[ends])
    return float(np.exp(np.interp(np.log(limit), *logs))) if above[-1] + 1 < tried.size else np.inf


def _measures(data: xr.Dataset) -> Iterator[Block]:
    yield Paragraph(
        say(
            "Both point-spread functions are computed in the plane of the thin-lens image, Fresnel's from paths to "
            "second order and Kirchhoff's from exact paths and obliquity factors. Neither is rescaled. The paper does "
            "not define the measure of its “percentage of error”, the window or the wavelength, so the report shows "
            "several of each. *I*~F~ and *I*~K~ are the two intensities, *I*(0) is that at the image point, and "
            "integrals and maxima are those over the window:"
        )
    )
    yield Equation(
        typst='"peak" = abs((I_F (0)) / (I_K (0)) - 1), quad'
        ' "L1" = (integral abs(I_F - I_K) dif A) / (integral I_K dif A), quad'
        ' "largest" = (max abs(I_F - I_K)) / (max I_K)',
        alt="Peak is the absolute value of I F over I K at the image point, less one. L1 is the integral of the "
        "absolute difference over the integral of I K, both over the window. Largest is the largest absolute "
        "difference over the largest I K.",
    )
    yield Paragraph(
        say(
            "To second order, all lens phases are the same parabola, so they share Fresnel's point-spread function, "
            "but not Kirchhoff's. With the paper's *parabolic* phase, the exact paths differ from the parabola by a "
            "spherical aberration *W* ≈ *r*^4^/8 (1/*a*³ + 1/*b*³), where *r* is the distance from the axis in the "
            "pupil, *a* the object distance and *b* the image distance. A *stigmatic* lens cancels this aberration "
            "for the axial point at its object distance, a *perfect* lens for every point. On the axis, these two "
            "agree. The numerical error is at most {error} of the numbers below.",
            error=share(float((data["published_point_error_numerical"] / data["published_point_error"]).max())),
        )
    )


def _error_table(data: xr.Dataset, element: str) -> Table:
    lens = data.sel(element=element)
    place = published_place(data, element)
    waves, windows = data["wavelength"].values, data["window"].values
    columns = [("peak", windows[0])] + [(m, w) for m in ("l1", "largest") for w in windows]
    rows: list[tuple[Text, ...]] = []
    for phase in data["lens_phase"].values:
        rows.append((f"{str(phase).capitalize()} lens phase",))
        for wave in waves:
            point = lens["published_point_error"].sel(lens_phase=phase, wavelength=wave)
            rows.append((length(float(wave)), *(share(float(point.sel(metric=m, window=w))) for m, w in columns)))
    stated = float(lens["published_error"])
    return Table(
        name=f"fresnel-error-{element}",
        caption=f"{element_title(data, element)} at f/{significant(place)}: error of Fresnel's point-spread function "
        "by each measure, at each wavelength. Numbers in the column heads: radius of the window in Airy radii.",
        columns=(
            Column(title="Wavelength", weight=1),
            *(
                Column(title=_METRICS[m] if m == "peak" else f"{_METRICS[m]}, {significant(float(w))}", align="right")
                for m, w in columns
            ),
        ),
        rows=tuple(rows),
        notes=(f"The paper states {share(stated)} at f/{significant(place)}.",) if np.isfinite(stated) else (),
    )


def _limit_table(data: xr.Dataset) -> Table:
    limit, window = share(float(data.attrs["error_limit"])), middle_window(data)
    columns = [("peak", float(data["window"].values[0])), ("l1", window), ("largest", window)]
    rows: list[tuple[Text, ...]] = []
    for element in data["element"].values:
        rows.append((element_title(data, str(element)),))
        for phase in data["lens_phase"].values:
            for wave in data["wavelength"].values:
                limits = data["limit_f_number"].sel(element=element, lens_phase=phase, wavelength=wave)
                cells = (_least(float(limits.sel(metric=m, window=w)), data) for m, w in columns)
                rows.append((f"{phase}, {length(float(wave))}", *cells))
    return Table(
        name="fresnel-limits",
        caption=f"Smallest f-number above which the error on the axis stays below {limit}, by each measure, within "
        f"{significant(window)} Airy radii.",
        columns=(
            Column(title="Lens phase and light", weight=1),
            *(Column(title=_METRICS[metric], align="right") for metric, _ in columns),
        ),
        rows=tuple(rows),
    )


def _least(value: float, data: xr.Dataset) -> str:
    if value == 0.0:
        return f"< {significant(float(data['f_number'][0]))}"
    return significant(value) if np.isfinite(value) else f"> {significant(float(data['f_number'][-1]))}"


def _criteria_table(data: xr.Dataset) -> Table:
    waves = data["wavelength"].values
    rows: list[tuple[Text, ...]] = []
    for element in data["element"].values:
        lens = data.sel(element=element)
        printed = float(lens["published_minimum"])
        stated = f"; printed in the paper: {significant(printed)}" if np.isfinite(printed) else ""
        rows.append((f"{element_title(data, str(element))}{stated}",))
        named: list[tuple[str, xr.DataArray]] = [
            ("eq. 27, smaller zero", lens["paper_eq27_f_number"].sel(zero="first")),
            ("eq. 27, larger zero", lens["paper_eq27_f_number"].sel(zero="second")),
            ("one radian of neglected phase (Goodman)", lens["goodman_f_number"]),
            *(
                (f"{significant(float(e))} waves of neglected path", lens["path_error_f_number"].sel(path_error=e))
                for e in data["path_error"].values
            ),
            ("plane wave behind a bare hole (Southwell)", lens["southwell_f_number"]),
        ]
        rows += [
            (criterion, *(significant(float(values.sel(wavelength=w))) for w in waves)) for criterion, values in named
        ]
    return Table(
        name="fresnel-criteria-table",
        caption="Minimum f-number for Fresnel by closed-form criteria.",
        columns=(
            Column(title="Criterion", weight=1),
            *(Column(title=length(float(w)), align="right") for w in waves),
        ),
        rows=tuple(rows),
        notes=(
            "Goodman's condition ignores the lens and treats each side of it separately, so that the shorter distance "
            "decides; he calls it sufficient, not necessary. Southwell's case: on the axis of a circular hole, at the "
            f"image distance, with an error of {share(float(data.attrs['error_limit']))} of the largest intensity.",
        ),
    )


def _printed_criterion(data: xr.Dataset, drawings: Mapping[str, Drawing]) -> Iterator[Block]:
    yield Heading(text="The paper's criterion, eq. 27", anchor="paper-eq27", level=2)
    yield Equation(
        typst="F = gamma / (2 R), quad R^4 = (8 (alpha + beta) - 2 l) / (1 / alpha^3 + 1 / beta^3)",
        alt="F equals gamma over two R; R to the fourth equals the quantity eight times alpha plus beta, less two l, "
        "over the sum of one over alpha cubed and one over beta cubed.",
        reference="paper, eq. 27",
    )
    yield Paragraph(
        say(
            "*F* is the f-number, and γ, *R*, α and β are the focal length, the radius of the pupil, and the distances "
            "of object and image, all divided by the wavelength. The largest integer *l* not above 4 (α + β) gives the "
            "smaller zero *R*, the integer before it the larger zero. So the numerator is twice the fractional part of "
            "4 (α + β), plus 2 for the larger zero. This part is the fraction of a quarter wave left over on the path "
            "from object to image."
        )
    )
    yield from pictures_of(drawings, "paper_eq27")
    second = data["paper_eq27_sweep"].sel(zero="second")
    spans = " and ".join(
        f"between {significant(float(second.sel(element=e).min()))} and "
        f"{significant(float(second.sel(element=e).max()))} for the {element_title(data, str(e)).lower()}"
        + (f" (printed: {significant(p)})" if np.isfinite(p := float(data["published_minimum"].sel(element=e))) else "")
        for e in data["element"].values
    )
    yield Paragraph(
        say(
            "At all wavelengths of the study, the larger zero gives an f-number {spans}. The smaller zero can give any "
            "f-number above a minimum: it depends on the fractional part, which magnifies a relative change of a "
            "length up to {condition} times. So no reproducible reading gives the printed numbers. A bound of ε "
            "waves on the neglected path gives a criterion that changes smoothly with all lengths:",
            spans=spans,
            condition=significant(float(data["paper_eq27_condition"].max()), 2),
        )
    )
    yield Equation(
        typst="F_min = f / 2 [(1 / a^3 + 1 / b^3) / (8 lambda epsilon)]^(1/4)",
        alt="F min equals f over two, times the fourth root of the sum of one over a cubed and one over b cubed, over "
        "eight lambda epsilon.",
    )

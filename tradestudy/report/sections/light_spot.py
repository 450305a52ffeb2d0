"""The light spot by every method: the answer, the images, their computing times, and the spread of points."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np
import xarray as xr

from tradestudy.figures.drawing import Drawing
from tradestudy.light_methods import legs_of, long_title, title_within_a_sentence
from tradestudy.report.document import (
    Block,
    Bullets,
    Callout,
    Column,
    Heading,
    Paragraph,
    Spans,
    Table,
    Text,
    pictures_of,
    say,
)
from tradestudy.report.words import length, share, with_error
from tradestudy.results.views.groups import group, has
from tradestudy.results.views.wave_optics import reference_method
from tradestudy.units import significant
from tradestudy.wording import listed

_NOT_STATED = "The discretisation and the machine behind the published times are unknown."
_SOURCES = {
    "incoherent disc": "The points of the spot radiate independently. Each spherical",
    "coherent disc": "The spot is coherent: one wave, of one phase over the disc. This",
    "point": "The spot is a point. Its spherical",
}
_LAWS = {
    "geometric": "**Paraxial rays** give each pixel the light from the part of the pupil that it sees.",
    "exact-rays": "**Exact rays** follow the exact directions of Kirchhoff's integral, without diffraction and "
    "interference.",
    "boundary-wave": "The **boundary wave** is the leading term of the difference between rays and Kirchhoff's "
    "integral: a wave from the rim of the main lens, or of every microlens that is fully lit and out of focus. It is "
    "added to the rays.",
    "fresnel": "**Fresnel** expands the path to second order and leaves out the obliquity factor (eqs. 17 to 22 of "
    "the paper).",
    "kirchhoff": "**Kirchhoff** keeps the exact path and the obliquity factor on each leg (eqs. 9 to 16 of the paper).",
}
_ERRORS = {
    True: "combines the errors of replacing the spot by a finite number of points (found by comparison with points "
    "between them), of the image of each point (found by an independent computation), of the integration over pixels, "
    "and of leaving out the part of a large spot that hardly lights the microlenses. Wave methods with the same "
    "sampling use the same points, so that part of this error cancels in the differences between their images.",
    False: "is found by comparison with an image from fewer nodes and samples, and with direct quadrature at random "
    "places.",
}
_VARIED = {"f_number": "f-number", "wavelength": "wavelength", "field_angle": "field angle", "defocus": "defocus"}


def describe_light_spot_answer(tree: xr.DataTree, run: Mapping[str, Any]) -> Iterator[Block]:
    """Say how the picture of the study is computed, how far methods differ on the detector, and how long each takes."""
    if not has(tree, "images", "image"):
        return
    data = group(tree, "images")
    yield Heading(text="The answer", anchor="light-spot-answer")
    yield Callout(
        title="Which method",
        blocks=(Paragraph(_chosen(data, run, reference_method(data))),),
        tone="answer",
    )
    yield _comparison(data, run)
    if any(data["published_words"].values):
        yield Paragraph(_NOT_STATED)


def describe_light_spot(tree: xr.DataTree, run: Mapping[str, Any], drawings: Mapping[str, Drawing]) -> Iterator[Block]:
    """Explain how the images are computed, and write how far single points spread."""
    if has(tree, "images", "image"):
        yield Heading(text="How the light spot is computed", anchor="light-spot")
        yield from _method(group(tree, "images"))
        yield from _benchmarks(group(tree, "images"), run)
    if has(tree, "point_spread", "value"):
        yield Heading(text="How far points spread", anchor="point-spread")
        yield from pictures_of(drawings, "point_spread")
        data = group(tree, "point_spread")
        for element in data["element"].values:
            yield _spread_table(data, str(element))


def _seconds(run: Mapping[str, Any], step: str) -> float:
    """The measured seconds in the record of the run; NaN if it has none."""
    return float(run.get("seconds", {}).get(step, "nan"))


def _duration(seconds: float) -> str:
    return f"{significant(seconds, 2)}\N{NO-BREAK SPACE}s" if np.isfinite(seconds) else "—"


def _chosen(data: xr.Dataset, run: Mapping[str, Any], reference: str) -> Spans:
    """Say which methods suffice, and describe the picture of the study: its difference from the reference, its time."""
    picture, compared = data["chosen_image"], data["image"].sel(propagator=reference)
    same = [
        str(method) for method in data["propagator"].values if (data["image"].sel(propagator=method) == picture).all()
    ]
    if reference in same:
        comparison = "Its method is the reference of the table"
    elif same:
        comparison = "It is the same picture as in the table"
    else:
        difference = share(float(abs(picture - compared).sum() / compared.sum()))
        took = f"computed in {_duration(_seconds(run, 'image: chosen'))}"
        comparison = f"Its difference from the reference, summed over all pixels, is {difference}; {took}"
    error, tolerance = float(data["chosen_error"]), float(data.attrs["chosen_tolerance"])
    suffice = [
        title_within_a_sentence(method)
        for method in map(str, data["propagator"].values)
        if method == reference or float(data["difference"].sel(propagator=method, against=reference)) <= tolerance
    ]
    return say(
        "**For pictures to {tolerance}, take {suffice}.** The picture of the study is computed by {method}; its stated "
        "error of {error} is {side} the {tolerance} to which it is sampled. {found}.",
        suffice=listed(suffice, "or"),
        method=title_within_a_sentence(str(data.attrs["chosen_method"])),
        error=share(error),
        side="above" if error > tolerance else "within",
        tolerance=share(tolerance),
        found=comparison,
    )


def _comparison(data: xr.Dataset, run: Mapping[str, Any]) -> Table:
    reference, tolerance = reference_method(data), float(data.attrs["compared_tolerance"])
    fallback = "image: chosen" if data.sizes["propagator"] == 1 else ""  # a study that declares no methods
    rows: list[tuple[Text, ...]] = []
    for method in map(str, data["propagator"].values):
        image = data.sel(propagator=method)
        rows.append(
            (
                long_title(method),
                _duration(
                    _seconds(run, f"image: {method}" if f"image: {method}" in run.get("seconds", {}) else fallback)
                ),
                str(image["published_words"].item()) or "—",
                share(error := float(image["numerical_error"])) + f" (above {share(tolerance)})" * (error > tolerance),
                *(
                    "—" if method == reference else share(float(image[variable].sel(against=reference)))
                    for variable in ("difference", "difference_l2")
                ),
                str(int(image["lit_pixels"])),
                share(float(image["outside_geometric"])) if "outside_geometric" in data else "—",
                share(float(image["power"])),
            )
        )
    return Table(
        name="light-spot-table",
        caption="Computing times, errors and light of the images.",
        columns=(
            Column(title="Method", weight=3),
            Column(title="Time", align="right"),
            Column(title="Published", align="right", weight=1),
            Column(title="Error", align="right"),
            Column(title="Difference", align="right"),
            Column(title="RMS", align="right"),
            Column(title="Lit", unit="px", align="right"),
            Column(title="Beyond rays", align="right"),
            Column(title="Power", align="right"),
        ),
        rows=tuple(rows),
        notes=(
            "Time: on this machine. Published: the time that the paper states. Error: the stated numerical error, as a "
            "root mean square over pixels, relative to the root mean square of the image; marked if above the "
            "tolerance. Difference: the absolute differences from the reference (marked —), summed "
            "over pixels, relative to its sum. RMS: the root mean square of these differences, relative to that of the "
            "reference. Lit: number of pixels with more than 1 % of the light of the brightest. Beyond rays: fraction "
            "of the light that falls on pixels that paraxial rays leave dark. Power: fraction of the pupil's light "
            "that reaches the detector.",
        ),
    )


def _method(data: xr.Dataset) -> Iterator[Block]:
    source = str(data.attrs["source"])
    yield Paragraph(
        say(
            "{source} wave is limited by the pupil of the main lens, receives the phase of this lens, and travels to "
            "the array (the first leg). There each microlens limits it by its aperture, adds its own phase, and sends "
            "it on to the detector (the second leg), where the fields behind all microlenses add. The intensity is "
            "integrated over each pixel{sum}. Light: {light}; phase of the main lens: {main}, of the microlenses: "
            "{micro}. The array: {array}.",
            source=_SOURCES[source],
            sum=", and the intensities of all points of the spot are averaged" if source == "incoherent disc" else "",
            light=_light(data),
            main=str(data.attrs["main_lens_phase"]),
            micro=str(data.attrs["microlens_phase"]),
            array=_array(data),
        )
    )
    methods = [*map(str, data["propagator"].values), str(data.attrs["chosen_method"])]
    used = {leg for method in methods for leg in legs_of(method)}
    yield Bullets(
        (
            *(say(text) for leg, text in _LAWS.items() if leg in used),
            say("The **stated error** of an image " + _ERRORS[source == "incoherent disc"]),
        )
    )


def _light(data: xr.Dataset) -> str:
    """Write the wavelength, or all wavelengths with their shares."""
    wavelengths = [length(float(value)) for value in data["wavelength"].values]
    if len(wavelengths) == 1:
        return wavelengths[0]
    shares = map(share, data["spectral_share"].values.tolist())
    lines = ", ".join(f"{amount} at {where}" for amount, where in zip(shares, wavelengths, strict=True))
    mean = length(float(data.attrs["mean_wavelength"]))
    chosen = "adds them too" if data.attrs["chosen_spectrum"] else "uses the mean alone"
    return (
        f"{lines}, added as intensities (mean {mean}; the picture by the chosen models {chosen}; rays do not "
        "depend on wavelength)"
    )


def _array(data: xr.Dataset) -> str:
    kinds = dict.fromkeys(float(value) for value in data["microlens_focal_length"].values)
    counts = ", ".join(
        f"{int((data['microlens_focal_length'] == kind).sum())} microlenses with a focal length of {length(kind)}"
        for kind in sorted(kinds)
    )
    apertures = f"{data.attrs['microlens_aperture']} apertures {length(float(data.attrs['microlens_aperture_width']))}"
    pitch = length(float(data.attrs["microlens_pitch"]))
    layout = data.attrs["microlens_layout"]
    return f"{layout}, {pitch} from lens to lens, {apertures} wide; {counts}"


def _benchmarks(data: xr.Dataset, run: Mapping[str, Any]) -> Iterator[Table]:
    if "benchmark_error" not in data:
        return
    names = [str(case) for case in data["benchmark"].values]
    yield Table(
        name="light-benchmarks",
        caption="Parts of the computation, timed on this machine. Stated error: root mean square error of the "
        "intensity, found by comparison with direct quadrature, relative to the root mean square of the intensity.",
        columns=(
            Column(title="Case", weight=1),
            Column(title="Time", align="right"),
            Column(title="Stated error", align="right"),
        ),
        rows=tuple(
            (case, _duration(_seconds(run, case)), share(float(data["benchmark_error"].sel(benchmark=case)), 2))
            for case in names
        ),
        notes=(
            "Parabolic: the paper's lens, with spherical aberration; stigmatic: without it on the axis; perfect: "
            "without aberrations. Main lens alone: the shortest of three runs, without the comparison that gives the "
            "error. One source point: one run, including this comparison. Other work on the machine lengthens all "
            "times.",
        ),
    )


def _spread_table(data: xr.Dataset, element: str) -> Table:
    lens = data.sel(element=element, propagator="kirchhoff")
    rows: list[tuple[Text, ...]] = []
    for varied, unit in zip(data["varied"].values, data["varied_units"].values, strict=True):
        rows.append((_VARIED[str(varied)].capitalize(),))
        for step in range(data.sizes["step"]):
            point = lens.sel(varied=varied).isel(step=step)
            if np.isfinite(float(point["value"])):
                rows.append((_value(float(point["value"]), str(unit)), *_measures(point)))
    return Table(
        name=f"point-spread-{element}",
        caption=f"{lens['title'].item()!s}, Kirchhoff: spread of a point, one quantity varied at a time.",
        columns=(
            Column(title="Varied", weight=1),
            *(
                Column(title=title, align="right")
                for title in ("FWHM", "50 %", "80 %", "RMS", "Strehl", "MTF", "Outside rays", "Neighbours")
            ),
        ),
        rows=tuple(rows),
        notes=(
            "FWHM: full width at half maximum. 50 %, 80 %: radii of the circles around the thin-lens image that "
            "contain these fractions of the pupil's light. RMS: root-mean-square distance of the light from the "
            f"thin-lens image, within {significant(float(data.attrs['rms_radius']))} Airy radii. MTF: at half the "
            "Nyquist frequency of the pixels, in the direction of the field angle. Outside rays: fraction of the light "
            "outside the disc that paraxial rays fill, which in focus is a point. Neighbours: fraction of the light on "
            "the eight pixels around the one centred on the image. Defocus: in waves of path at the rim of the pupil, "
            "positive for a nearer object."
            + (" —: not within the computed window." if any("—" in row for row in rows) else ""),
        ),
    )


def _value(value: float, unit: str) -> str:
    if unit == "m":
        return length(value)
    if unit == "rad":
        return f"{significant(float(np.degrees(value)))}°"
    if unit == "1":
        return f"f/{significant(value)}"
    return f"{significant(value)} {'wave' if abs(value) == 1.0 else 'waves'}"


def _measures(point: xr.Dataset) -> Iterator[str]:
    for measure in ("full_width", "half_energy_radius", "energy_radius_80", "rms_width"):
        yield _or_dash(float(point[measure]), partial(with_error, error=float(point[f"{measure}_error"])))
    yield _or_dash(float(point["strehl_ratio"]), significant)
    for measure in ("transfer_half_nyquist", "outside_geometric", "neighbour_share"):
        yield _or_dash(float(point[measure]), share)


def _or_dash(value: float, write: Any) -> str:
    return str(write(value)) if np.isfinite(value) else "—"

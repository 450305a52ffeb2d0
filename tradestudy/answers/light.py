"""/images: the light spot by the chosen models, and by every method side by side."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np
import xarray as xr

from tradestudy.effects import Models
from tradestudy.execution import Steps
from tradestudy.execution.steps import Progress, Seconds, timed
from tradestudy.models.light_spot import spot_models
from tradestudy.models.point_spreads import (
    MEASURES,
    SpreadMethod,
    base_values,
    lens_and_point,
    spread_measures,
    varied_values,
)
from tradestudy.models.spot_images import (
    STEP,
    compared_models,
    image_difference,
    light_benchmarks,
    light_path,
    lit_pixels,
    spot_picture,
)
from tradestudy.optics.arrays import FloatArray
from tradestudy.results import dataset
from tradestudy.study.schema.wave_optics import ElementPart, LightSpotPart, MethodName, PointSpreadPart

LIT_ABOVE = 0.01


def _report(progress: Progress, begin: float, end: float, share: float) -> None:
    progress(STEP, begin + share * (end - begin))


def images_group(part: LightSpotPart, steps: Steps, seconds: Seconds, models: Models) -> xr.Dataset:
    """/images over (propagator, row, column); wall seconds of each go to ``seconds`` as ``image: METHOD``.

    Parameters
    ----------
    part
        The spot, the methods to compare, and their tolerance.
    steps
        How parts of the pictures are computed.
    seconds
        Receives the seconds that the pictures took.
    models
        The chosen models, which compute ``chosen_image``; without methods it is the only image.
    """
    chosen = spot_models(models)
    compared = [compared_models(part, method) for method in part.methods]
    to_compute = compared if chosen in compared else [*compared, chosen]
    pictures, progress = {}, steps.progress
    for done, picture_models in enumerate(to_compute):
        ends = done / len(to_compute), (done + 1) / len(to_compute)
        progress(STEP, ends[0])
        label = f"image: {picture_models.method}" if picture_models in compared else "image: chosen"
        with timed(seconds, label):
            pictures[picture_models] = spot_picture(part, picture_models, partial(_report, progress, *ends), steps)
    shown = compared or to_compute
    shown_pictures = [pictures[models] for models in shown]
    progress(STEP, 1.0)
    benchmarks: dict[str, float] = {}
    if part.benchmarks:
        progress("benchmarks of light", 0.0)
        benchmarks = light_benchmarks(part, seconds)
    methods = [models.method for models in shown]
    images = np.stack([picture.pixels for picture in shown_pictures])
    numerical = np.array([picture.numerical_error for picture in shown_pictures])
    power, norms = images.sum(axis=(1, 2)), np.linalg.norm(images, axis=(1, 2))
    of_sum = numerical * math.sqrt(images[0].size) * norms / power  # Cauchy–Schwarz: from L2 to L1
    differences = np.array([[image_difference(image, other) for other in images] for image in images])
    differences_l2 = np.array([[np.linalg.norm(image - other) for other in images] for image in images]) / norms
    pitch, count = part.detector.pixel_pitch, part.detector.pixels
    centres = pitch * (np.arange(count) - (count - 1) / 2)
    lenses = light_path(part).microlenses
    values = {
        "image": images,
        "numerical_error": numerical,
        "power": power,
        "power_error": of_sum * power,
        "lit_pixels": [lit_pixels(image, LIT_ABOVE) for image in images],
        **_against_geometric(methods, images, of_sum),
        "difference": differences,
        "difference_error": (1.0 + differences) * (of_sum[:, np.newaxis] + of_sum),
        "difference_l2": differences_l2,
        "difference_l2_error": (1.0 + differences_l2) * (numerical[:, np.newaxis] + numerical),
        **({"benchmark_error": list(benchmarks.values())} if benchmarks else {}),
        **_published(part, methods),
    }
    values |= {
        "chosen": [float(method == chosen.method) for method in methods],
        "chosen_image": pictures[chosen].pixels,
        "chosen_error": pictures[chosen].numerical_error,
        "spectral_share": [share for _, share in part.lines],
        "microlens_x": lenses.centres[:, 0],
        "microlens_y": lenses.centres[:, 1],
        "microlens_focal_length": lenses.focal_lengths,
    }
    result = dataset(
        "images",
        values,
        {
            "propagator": methods,
            "against": methods,
            "row": centres,
            "column": centres,
            "wavelength": [wavelength for wavelength, _ in part.lines],
            **({"benchmark": list(benchmarks)} if benchmarks else {}),
        },
        attributes={
            "mean_wavelength": part.mean_wavelength,
            "source": _source(part),
            "microlens_layout": lenses.layout,
            "microlens_pitch": lenses.pitch,
            "microlens_aperture": lenses.aperture,
            "microlens_aperture_width": lenses.aperture_width,
            "main_lens_phase": part.main_lens.lens_phase,
            "microlens_phase": part.microlenses.lens_phase,
            "compared_tolerance": shown[0].tolerance,
            "chosen_method": chosen.method,
            "chosen_tolerance": chosen.tolerance,
            "chosen_crosstalk": float(not chosen.separate),
            "chosen_pixel_integration": float(chosen.integrated),
            "chosen_source_extent": float(not chosen.point),
            "chosen_spectrum": float(not chosen.monochromatic),
        },
    )
    for label in ("row", "column"):
        result[label].attrs = {"units": "m", "long_name": f"position of the {label} on the detector"}
    result["wavelength"].attrs = {"units": "m", "long_name": "wavelength of a spectral line", "symbol": "λ"}
    return result


def _source(part: LightSpotPart) -> str:
    if part.spot.is_point:
        return "point"
    return "coherent disc" if part.spot.coherent else "incoherent disc"


def _against_geometric(methods: list[MethodName], images: FloatArray, of_sum: FloatArray) -> Mapping[str, Any]:
    if "geometric" not in methods:
        return {}
    dark = images[methods.index("geometric")] == 0.0
    share = images[:, dark].sum(axis=1) / images.sum(axis=(1, 2))
    return {"outside_geometric": share, "outside_geometric_error": of_sum}


def _published(part: LightSpotPart, methods: list[MethodName]) -> Mapping[str, Any]:
    by_method = {published.method: published for published in part.published_times}
    shown = [by_method.get(method) for method in methods]
    return {
        "published_seconds": [
            math.nan if published is None or published.takes is None else published.takes for published in shown
        ],
        "published_words": ["" if published is None else published.says for published in shown],
        "published_source": ["" if published is None else published.source for published in shown],
    }


METHODS: Final[tuple[SpreadMethod, ...]] = ("fresnel", "kirchhoff")
_UNITS: Final = {"f_number": "1", "wavelength": "m", "field_angle": "rad", "defocus": "wave"}
_STEP: Final = "point spread"


@dataclass(frozen=True, kw_only=True)
class _Point:
    """One lens with one parameter varied."""

    part: PointSpreadPart
    lens: ElementPart
    changed: tuple[str, float]
    method: SpreadMethod


def _measured(point: _Point) -> Mapping[str, tuple[float, float]]:
    """Every measure with its numerical error."""
    part = point.part
    return spread_measures(
        lens_and_point(part, point.lens, dict([point.changed])),
        method=point.method,
        window=part.window,
        rms_radius=part.rms_radius,
        pixel_pitch=part.pixel_pitch,
        tolerance=part.tolerance,
    )


def point_spread_group(part: PointSpreadPart, steps: Steps, seconds: Seconds, models: Models) -> xr.Dataset:
    """/point_spread over (element, propagator, varied, step).

    Both laws are computed, because each checks the other; ``chosen`` marks the one that the tolerance on widths
    requires.
    """
    elements = list(part.elements.values())
    varied = varied_values(part)
    longest = max(map(len, varied.values()))
    shape = (len(elements), len(METHODS), len(varied), longest)
    values = {measure + suffix: np.full(shape, np.nan) for measure in MEASURES for suffix in ("", "_error")}
    parameters = list(varied.items())
    places = [place for place in itertools.product(*map(range, shape)) if place[3] < len(parameters[place[2]][1])]
    points, labels = [], []
    for element, method, which, number in places:
        parameter, chosen = parameters[which]
        points.append(
            _Point(part=part, lens=elements[element], changed=(parameter, chosen[number]), method=METHODS[method])
        )
        labels.append(f"{elements[element].title}, {METHODS[method]}, {parameter} {chosen[number]:g}")
    with timed(seconds, _STEP):
        measured = steps.map(_STEP, _measured, points, labels)
    for place, measures in zip(places, measured, strict=True):
        for measure, (value, error) in measures.items():
            values[measure][place], values[f"{measure}_error"][place] = value, error
    padded = [[*chosen, *[np.nan] * (longest - len(chosen))] for chosen in varied.values()]
    return dataset(
        "point_spread",
        {
            "title": [element.title for element in elements],
            "airy_radius": [lens_and_point(part, element, {}).airy_radius for element in elements],
            "value": [padded] * len(elements),
            "varied_units": [_UNITS[parameter] for parameter in varied],
            "standing": [[base_values(part, element)[parameter] for parameter in varied] for element in elements],
            **values,
            "chosen": [float(models["main_lens_diffraction"] == method) for method in METHODS],
        },
        {"element": list(part.elements), "propagator": list(METHODS), "varied": list(varied)},
        attributes={"window": part.window, "rms_radius": part.rms_radius, "pixel_pitch": part.pixel_pitch},
    )

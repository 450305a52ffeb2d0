"""/point_spread: the width of the point spread of each lens, with one parameter varied at a time."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import xarray as xr

from tradestudy.analysis.point_spreads import (
    MEASURES,
    SpreadMethod,
    base_values,
    case_of,
    spread_measures,
    varied_values,
)
from tradestudy.effects import Models
from tradestudy.execution import Steps
from tradestudy.execution.steps import Seconds, timed
from tradestudy.results import dataset
from tradestudy.study.schema.wave_optics import ElementPart, PointSpreadPart

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
        case_of(part, point.lens, dict([point.changed])),
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
    values = {name + suffix: np.full(shape, np.nan) for name in MEASURES for suffix in ("", "_error")}
    named = list(varied.items())
    places = [place for place in itertools.product(*map(range, shape)) if place[3] < len(named[place[2]][1])]
    points, labels = [], []
    for element, method, what, number in places:
        name, chosen = named[what]
        points.append(_Point(part=part, lens=elements[element], changed=(name, chosen[number]), method=METHODS[method]))
        labels.append(f"{elements[element].title}, {METHODS[method]}, {name} {chosen[number]:g}")
    with timed(seconds, _STEP):
        found = steps.map(_STEP, _measured, points, labels)
    for place, one in zip(places, found, strict=True):
        for measure, (value, error) in one.items():
            values[measure][place], values[f"{measure}_error"][place] = value, error
    padded = [[*chosen, *[np.nan] * (longest - len(chosen))] for chosen in varied.values()]
    return dataset(
        "point_spread",
        {
            "title": [element.title for element in elements],
            "airy_radius": [case_of(part, element, {}).airy_radius for element in elements],
            "value": [padded] * len(elements),
            "varied_units": [_UNITS[name] for name in varied],
            "standing": [[base_values(part, element)[name] for name in varied] for element in elements],
            **values,
            "chosen": [float(models["main_lens_diffraction"] == method) for method in METHODS],
        },
        {"element": list(part.elements), "propagator": list(METHODS), "varied": list(varied)},
        attributes={"window": part.window, "rms_radius": part.rms_radius, "pixel_pitch": part.pixel_pitch},
    )

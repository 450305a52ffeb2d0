"""/point_spread: the width of the point spread of each lens, with one parameter varied at a time."""

from __future__ import annotations

import itertools
from typing import Final

import numpy as np
import xarray as xr

from tradestudy.analysis.point_spreads import (
    MEASURES,
    SpreadMethod,
    case_of,
    spread_measures,
    standing_values,
    varied_values,
)
from tradestudy.effects.models import Models
from tradestudy.execution.steps import Progress, Seconds, timed
from tradestudy.results import dataset
from tradestudy.study.schema.wave_optics import PointSpreadPart

METHODS: Final[tuple[SpreadMethod, ...]] = ("fresnel", "kirchhoff")
_UNITS: Final = {"f_number": "1", "wavelength": "m", "field_angle": "rad", "defocus": "wave"}
_STEP: Final = "point spread"


def point_spread_group(part: PointSpreadPart, progress: Progress, seconds: Seconds, models: Models) -> xr.Dataset:
    """/point_spread over (element, propagator, varied, step).

    Both laws are computed, because each checks the other; ``chosen`` marks the one that the tolerance on widths
    requires.
    """
    elements = list(part.elements.values())
    varied = varied_values(part)
    steps = max(map(len, varied.values()))
    shape = (len(elements), len(METHODS), len(varied), steps)
    values = {name + suffix: np.full(shape, np.nan) for name in MEASURES for suffix in ("", "_error")}
    places = [
        place for place in itertools.product(*map(range, shape)) if place[3] < len(list(varied.values())[place[2]])
    ]
    with timed(seconds, _STEP):
        for number, place in enumerate(places):
            progress(_STEP, number / len(places))
            element, method, what, step = place
            name = list(varied)[what]
            case = case_of(part, elements[element], {name: varied[name][step]})
            found = spread_measures(
                case,
                method=METHODS[method],
                window=part.window,
                rms_radius=part.rms_radius,
                pixel_pitch=part.pixel_pitch,
                tolerance=part.tolerance,
            )
            for measure, (value, error) in found.items():
                values[measure][place], values[f"{measure}_error"][place] = value, error
    progress(_STEP, 1.0)
    padded = [[*chosen, *[np.nan] * (steps - len(chosen))] for chosen in varied.values()]
    return dataset(
        "point_spread",
        {
            "title": [element.title for element in elements],
            "airy_radius": [case_of(part, element, {}).airy_radius for element in elements],
            "value": [padded] * len(elements),
            "varied_units": [_UNITS[name] for name in varied],
            "standing": [[standing_values(part, element)[name] for name in varied] for element in elements],
            **values,
            "chosen": [float(models["main_lens_diffraction"] == method) for method in METHODS],
        },
        {"element": list(part.elements), "propagator": list(METHODS), "varied": list(varied)},
        attributes={"window": part.window, "rms_radius": part.rms_radius, "pixel_pitch": part.pixel_pitch},
    )

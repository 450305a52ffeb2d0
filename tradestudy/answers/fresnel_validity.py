"""/fresnel_validity: the measured error of the Fresnel point-spread function, and criteria that predict it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import xarray as xr

from tradestudy.execution import Steps
from tradestudy.execution.steps import Seconds, timed
from tradestudy.models.point_spreads import (
    METRICS,
    goodman_f_number,
    limit_f_number,
    paper_zeros,
    path_error_f_number,
    psf_differences,
    southwell_f_number,
)
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.fresnel_validity import paper_eq27_sweep
from tradestudy.optics.propagation.lens import LensPhase
from tradestudy.optics.psf_difference import PsfDifference
from tradestudy.results import dataset
from tradestudy.study.schema.wave_optics import ElementPart, FresnelValidityPart, listed

_SWEEP_POINTS: Final = 1025  # enough to follow the smaller zero to twice its minimum and beyond
_STEP: Final = "Fresnel against Kirchhoff, on axis"
_OFF_AXIS_STEP: Final = "Fresnel against Kirchhoff, off axis"
_Differences = npt.NDArray[np.object_]  # of differences by lens phase


def fresnel_validity_group(part: FresnelValidityPart, steps: Steps, seconds: Seconds) -> xr.Dataset:
    """/fresnel_validity over elements, lens phases, wavelengths, f-numbers, metrics and windows."""
    elements = list(part.elements.values())
    f_numbers = listed(part.f_numbers)
    with timed(seconds, _STEP):
        compared = [(*f_numbers, _published_f_number(element), element.f_number) for element in elements]
        differences = _differences_at(part, compared, steps, step=_STEP, field_angle=0.0, wavelengths=part.wavelengths)
        on_axis, published, used = np.split(differences, [len(f_numbers), len(f_numbers) + 1], axis=2)
        limits = _limits(part, elements, f_numbers, on_axis, steps)
    values = {
        **_laid_out(part, on_axis, "psf_error"),
        **_of_one_f_number(part, published, "published_point_error"),
        **_of_one_f_number(part, used, "camera_point_error"),
    }
    attributes: dict[str, Any] = {"error_limit": part.error_limit}
    if part.off_axis is not None:
        attributes |= {"field_angle": part.off_axis.field_angle, "field_wavelength": part.off_axis.wavelength}
        angle, waves = part.off_axis.field_angle, (part.off_axis.wavelength,)
        with timed(seconds, _OFF_AXIS_STEP):
            compared = [(*f_numbers, element.f_number) for element in elements]
            differences = _differences_at(
                part, compared, steps, step=_OFF_AXIS_STEP, field_angle=angle, wavelengths=waves
            )
        swept, used = np.split(differences, [len(f_numbers)], axis=2)
        off_axis = _laid_out(part, swept, "off_axis_error") | _of_one_f_number(part, used, "off_axis_camera_error")
        values |= {variable: errors[:, :, 0] for variable, errors in off_axis.items()}
    result = dataset(
        "fresnel_validity",
        {**_declared(elements), **values, "limit_f_number": limits, **_criteria(part, elements)},
        {
            "element": list(part.elements),
            "lens_phase": list(part.lens_phases),
            "wavelength": list(part.wavelengths),
            "f_number": list(f_numbers),
            "metric": list(METRICS),
            "window": list(part.windows),
            "zero": ["first", "second"],
            "quarter_wave": list(np.arange(_SWEEP_POINTS) / _SWEEP_POINTS),
            "path_error": list(part.path_errors),
        },
        attributes=attributes,
    )
    for coordinate, units, long_name in (
        ("wavelength", "m", "wavelength"),
        ("f_number", "1", "focal length divided by pupil diameter"),
        ("window", "1", "radius of the window, in Airy radii"),
        ("quarter_wave", "1", "growth of a + b in λ/4 since a jump"),
        ("path_error", "wave", "allowed length of the neglected path"),
    ):
        result[coordinate].attrs = {"units": units, "long_name": long_name}
    return result


def _declared(elements: list[ElementPart]) -> Mapping[str, Any]:
    published = [element.published_error for element in elements]
    return {
        "title": [element.title for element in elements],
        "focal_length": [element.focal_length for element in elements],
        "object_distance": [element.object_distance for element in elements],
        "image_distance": [element.image_distance for element in elements],
        "camera_f_number": [element.f_number for element in elements],
        "published_f_number": [math.nan if error is None else error.f_number for error in published],
        "published_error": [math.nan if error is None else error.error for error in published],
        "published_minimum": [element.published_minimum_f_number or math.nan for element in elements],
    }


@dataclass(frozen=True, kw_only=True)
class _Pair:
    """The lens, light and f-number for which both laws are computed."""

    part: FresnelValidityPart
    element: ElementPart
    f_number: float
    field_angle: float
    wavelength: float


def _differences(pair: _Pair) -> Mapping[LensPhase, PsfDifference]:
    return psf_differences(
        pair.element,
        f_number=pair.f_number,
        field_angle=pair.field_angle,
        wavelength=pair.wavelength,
        lens_phases=pair.part.lens_phases,
        windows=pair.part.windows,
        tolerance=pair.part.tolerance,
    )


def _stacked(part: FresnelValidityPart, differences: Mapping[LensPhase, PsfDifference], suffix: str) -> FloatArray:
    """Shape (lens phase, metric, window)."""
    return np.array(
        [[getattr(differences[phase], metric + suffix) for metric in METRICS] for phase in part.lens_phases]
    )


def _published_f_number(element: ElementPart) -> float:
    """The f-number of a published error; the lens's own without one."""
    return element.published_error.f_number if element.published_error else element.f_number


def _differences_at(
    part: FresnelValidityPart,
    f_numbers: Sequence[tuple[float, ...]],
    steps: Steps,
    *,
    step: str,
    field_angle: float,
    wavelengths: tuple[float, ...],
) -> _Differences:
    """Differences of every lens at its own f-numbers, equally many for each, shape (element, wavelength, f-number)."""
    elements = list(part.elements.values())
    shape = (len(elements), len(wavelengths), len(f_numbers[0]))
    pairs = [
        _Pair(
            part=part,
            element=elements[e],
            f_number=f_numbers[e][f],
            field_angle=field_angle,
            wavelength=wavelengths[w],
        )
        for e, w, f in itertools.product(*map(range, shape))
    ]
    labels = [f"{pair.element.title}, f/{pair.f_number:g}, {pair.wavelength:g} m" for pair in pairs]
    differences = np.empty(len(pairs), dtype=object)
    differences[:] = steps.map(step, _differences, pairs, labels)
    return differences.reshape(shape)


def _laid_out(part: FresnelValidityPart, differences: _Differences, variable: str) -> dict[str, FloatArray]:
    """Errors and their numerical errors, shape (element, lens phase, wavelength, f-number, metric, window)."""
    return {
        variable + label: np.moveaxis(
            np.array(
                [[[_stacked(part, difference, suffix) for difference in row] for row in rows] for rows in differences]
            ),
            3,
            1,
        )
        for label, suffix in (("", ""), ("_numerical", "_error"))
    }


def _of_one_f_number(part: FresnelValidityPart, differences: _Differences, variable: str) -> dict[str, FloatArray]:
    """Like `_laid_out`, without the dimension of f-numbers."""
    return {variable: values[:, :, :, 0] for variable, values in _laid_out(part, differences, variable).items()}


@dataclass(frozen=True, kw_only=True)
class _LensInLight:
    """One lens in light of one wavelength, and the known differences at all f-numbers."""

    part: FresnelValidityPart
    element: ElementPart
    wavelength: float
    known: Mapping[float, Mapping[LensPhase, PsfDifference]]


def _limits(
    part: FresnelValidityPart,
    elements: list[ElementPart],
    f_numbers: tuple[float, ...],
    on_axis: _Differences,
    steps: Steps,
) -> FloatArray:
    """f-numbers at the limit, shape (element, lens phase, wavelength, metric, window)."""
    points = [
        _LensInLight(
            part=part,
            element=element,
            wavelength=wavelength,
            known=dict(zip(f_numbers, on_axis[e, w], strict=True)),
        )
        for e, element in enumerate(elements)
        for w, wavelength in enumerate(part.wavelengths)
    ]
    labels = [f"{point.element.title}, {point.wavelength:g} m" for point in points]
    limits = np.array(steps.map("f-numbers at the limit", _limits_of, points, labels))
    return np.moveaxis(limits.reshape(len(elements), len(part.wavelengths), *limits.shape[1:]), 2, 1)


def _limits_of(lens: _LensInLight) -> FloatArray:
    """Shape (lens phase, metric, window)."""
    part = lens.part
    shape = (len(part.lens_phases), len(METRICS), len(part.windows))
    limits = np.full(shape, np.nan)
    for index in itertools.product(*map(range, shape)):

        def error_at(f_number: float, index: tuple[int, ...] = index) -> float:
            phase, metric, window = index
            differences = lens.known.get(f_number) or _differences(
                _Pair(part=part, element=lens.element, f_number=f_number, field_angle=0.0, wavelength=lens.wavelength)
            )
            return float(getattr(differences[part.lens_phases[phase]], METRICS[metric])[window])

        limits[index] = limit_f_number(error_at, tuple(lens.known), part.error_limit)
    return limits


def _criteria(part: FresnelValidityPart, elements: list[ElementPart]) -> Mapping[str, Any]:
    wavelengths = np.asarray(part.wavelengths)
    zeros = [paper_zeros(element, part.wavelengths) for element in elements]
    return {
        "paper_eq27_f_number": [zero for zero, _ in zeros],
        "paper_eq27_condition": [condition for _, condition in zeros],
        "paper_eq27_sweep": [
            [
                paper_eq27_sweep(
                    focal_length=element.focal_length,
                    object_distance=element.object_distance,
                    wavelength=wavelength,
                    points=_SWEEP_POINTS,
                )
                for wavelength in part.wavelengths
            ]
            for element in elements
        ],
        "path_error_f_number": [
            path_error_f_number(element, wavelengths[:, None], np.asarray(part.path_errors)) for element in elements
        ],
        "goodman_f_number": [goodman_f_number(element, wavelengths) for element in elements],
        "southwell_f_number": [southwell_f_number(element, wavelengths, part.error_limit) for element in elements],
    }

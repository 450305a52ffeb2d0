"""Errors of the Fresnel point-spread function for the declared lenses of a study, each computed once."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache

import numpy as np

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.fresnel_validity import (
    bounded_minimum_f_number,
    collimated_minimum_distance,
    goodman_minimum_f_number,
    paper_eq27,
)
from tradestudy.optics.propagation import LensPhase
from tradestudy.optics.psf_difference import PsfDifference, fresnel_psf_difference
from tradestudy.study.schema.wave_optics import ElementPart, PsfMetric

METRICS: tuple[PsfMetric, ...] = ("peak", "l1", "largest")
_ROOT_TOLERANCE = 1e-4


@lru_cache(maxsize=4096)
def psf_differences(
    element: ElementPart,
    *,
    f_number: float,
    field_angle: float,
    wavelength: float,
    lens_phases: tuple[LensPhase, ...],
    windows: tuple[float, ...],
    tolerance: float,
) -> Mapping[LensPhase, PsfDifference]:
    """`fresnel_psf_difference` of a declared lens, cached."""
    return fresnel_psf_difference(
        focal_length=element.focal_length,
        object_distance=element.object_distance,
        f_number=f_number,
        field_angle=field_angle,
        wavelength=wavelength,
        lens_phases=lens_phases,
        windows=windows,
        tolerance=tolerance,
    )


def limit_f_number(error_at: Callable[[float], float], f_numbers: Sequence[float], limit: float) -> float:
    """Smallest f-number above which an error stays below a limit.

    Parameters
    ----------
    error_at
        Error at an f-number.
    f_numbers
        Increasing; searched from the largest down, so that errors below the answer do not matter.
    limit
        The limit.

    Returns
    -------
    float
        0 if the error is below the limit at all of them, infinity if it exceeds the limit at the largest.
    """
    if error_at(f_numbers[-1]) > limit:
        return math.inf
    for below, above in zip(f_numbers[-2::-1], f_numbers[:0:-1], strict=True):
        if error_at(below) > limit:
            return _crossing(error_at, below, above, limit)
    return 0.0


def _crossing(error_at: Callable[[float], float], low: float, high: float, limit: float) -> float:
    """Root by regula falsi (Illinois) on logarithms, where the error is nearly a straight line."""
    target = math.log(limit)
    x, y = [math.log(low), math.log(high)], [math.log(error_at(end)) - target for end in (low, high)]
    kept = -1
    while x[1] - x[0] > _ROOT_TOLERANCE:
        at = x[0] - y[0] * (x[1] - x[0]) / (y[1] - y[0])
        value = math.log(error_at(math.exp(at))) - target
        if abs(value) < _ROOT_TOLERANCE:
            return math.exp(at)
        side = 0 if value > 0 else 1
        x[side], y[side] = at, value
        if kept == side:
            y[1 - side] /= 2
        kept = side
    return math.exp((x[0] + x[1]) / 2)


def paper_zeros(element: ElementPart, wavelengths: Sequence[float]) -> tuple[FloatArray, FloatArray]:
    """Both zeros of the criterion as the paper prints it, shape (wavelength, 2), and its condition number."""
    found = paper_eq27(
        focal_length=element.focal_length, object_distance=element.object_distance, wavelength=np.asarray(wavelengths)
    )
    zeros = np.stack([found.first_zero_f_number, found.second_zero_f_number], axis=-1)
    return zeros, found.condition_number


def path_error_f_number(element: ElementPart, wavelength: FloatArray | float, waves: FloatArray | float) -> FloatArray:
    """Smallest f-number at which the path length that Fresnel neglects is at most a given number of waves."""
    return bounded_minimum_f_number(
        focal_length=element.focal_length,
        object_distance=element.object_distance,
        image_distance=element.image_distance,
        wavelength=wavelength,
        path_error_waves=waves,
    )


def goodman_f_number(element: ElementPart, wavelength: FloatArray | float) -> FloatArray:
    """Smallest f-number by Goodman's condition, leg by leg."""
    return goodman_minimum_f_number(
        focal_length=element.focal_length,
        object_distance=element.object_distance,
        image_distance=element.image_distance,
        wavelength=wavelength,
    )


def southwell_f_number(element: ElementPart, wavelength: FloatArray, error: float) -> FloatArray:
    """Smallest f-number at which Fresnel holds to an error in the image plane of a bare hole lit by a plane wave.

    The required distance grows as the 4/3 power of the radius, so one radius gives all others.
    """
    radius = element.focal_length / 2  # f/1
    needed = collimated_minimum_distance(aperture_radius=radius, wavelength=wavelength, intensity_error=error)
    return np.asarray((needed / element.image_distance) ** 0.75)

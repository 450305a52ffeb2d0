"""Hard cases of phases: paths from 10 µm to 10⁸ m, Fresnel numbers from 1e-3 to 1e6, fast and slow lenses."""

from __future__ import annotations

from typing import Final

import numpy as np

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.fresnel_validity import collimated_axis_intensity, dropped_path
from tradestudy.optics.propagation.paths import SphericalPath
from tradestudy.units import LENGTH, pretty
from tradestudy.verification.hard_cases.case import Family, Law, NumericCase

_GREEN: Final = 550e-9


def _phase(z: float, rho: float, wavelength: float) -> FloatArray:
    path = SphericalPath(x=0.0, y=0.0, distance=z)
    return 2 * np.pi / wavelength * path.value(np.asarray(rho), np.asarray(0.0))


def _naive_single(z: float, rho: float, wavelength: float) -> FloatArray:
    distance, radius, k = np.float32(z), np.float32(rho), np.float32(2 * np.pi / wavelength)
    return np.asarray(k * (np.sqrt(distance * distance + radius * radius) - distance))


def _single(z: float, rho: float, wavelength: float) -> FloatArray:
    path = SphericalPath(x=0.0, y=0.0, distance=z)
    value = path.value(np.asarray(rho, dtype=np.float32), np.asarray(0.0, dtype=np.float32))
    return np.asarray(2 * np.pi / wavelength * value)


PHASE: Final = Law(
    name="phase k (√(z² + ρ²) − z)",
    naive=lambda z, rho, wavelength: 2 * np.pi / wavelength * (np.sqrt(np.float64(z) ** 2 + np.float64(rho) ** 2) - z),
    ours=_phase,
    magnified=False,
)
SINGLE_PRECISION: Final = Law(
    name="phase k (√(z² + ρ²) − z) of single-precision input",
    naive=_naive_single,
    ours=_single,
    epsilon=2.0**-23,
)


def _naive_dropped(rho: float, a: float, b: float) -> FloatArray:
    legs = (np.sqrt(np.float64(d) ** 2 + rho**2) - d - rho**2 / (2 * d) for d in (a, b))
    return np.asarray(sum(legs))


DROPPED_PATH: Final = Law(
    name="path that Fresnel's approximation neglects",
    naive=_naive_dropped,
    ours=lambda rho, a, b: dropped_path(aperture_radius=rho, object_distance=a, image_distance=b),
    magnified=False,
)


def _naive_axis(z: float, radius: float, wavelength: float) -> FloatArray:
    path = np.sqrt(np.float64(z) ** 2 + radius**2)
    return np.asarray(np.abs(1 - z / path * np.exp(2j * np.pi / wavelength * (path - z))) ** 2)


AXIS: Final = Law(
    name="intensity on the axis behind a hole",
    naive=_naive_axis,
    ours=lambda z, radius, wavelength: collimated_axis_intensity(
        distance=z, aperture_radius=radius, wavelength=wavelength
    )[0],
)


def _path(z: float, ratio: float, wavelength: float = _GREEN) -> NumericCase:
    light = "" if wavelength == _GREEN else f", λ = {pretty(wavelength, LENGTH)}"
    return NumericCase(
        name=f"z = {pretty(z, LENGTH)}, ρ/z = {ratio:g}{light}",
        law=PHASE,
        inputs={"z": z, "rho": ratio * z, "wavelength": wavelength},
    )


def _in_single(z: float, rho: float) -> NumericCase:
    inputs = {"z": float(np.float32(z)), "rho": float(np.float32(rho)), "wavelength": _GREEN}
    return NumericCase(name=f"float32, z = {z:g} m, ρ = {rho:g} m", law=SINGLE_PRECISION, inputs=inputs)


def _lens(f_number: float) -> NumericCase:
    focal_length, a = 12.5e-3, 0.15
    inputs = {"rho": focal_length / (2 * f_number), "a": a, "b": a * focal_length / (a - focal_length)}
    return NumericCase(name=f"neglected path at f/{f_number:g}", law=DROPPED_PATH, inputs=inputs)


def _hole(fresnel_number: float, radius: float = 1e-3, wavelength: float = _GREEN) -> NumericCase:
    return NumericCase(
        name=f"hole of radius {radius / wavelength:.3g} λ at Fresnel number {fresnel_number:g}",
        law=AXIS,
        inputs={"z": radius**2 / (fresnel_number * wavelength), "radius": radius, "wavelength": wavelength},
    )


PHASES: Final = Family(
    name="phases",
    title="Phases and paths",
    cases=(
        *(_path(z, ratio) for z in (1e-5, 1.0, 1e8) for ratio in (1e-12, 1e-6, 1e-3, 1.0, 10.0)),
        *(_path(z, 1e-4, wavelength) for z in (1e-5, 1e8) for wavelength in (100e-9, 1e-3)),
        _in_single(1.0, 1e-3),
        _in_single(0.15, 2e-3),
        _in_single(1e6, 1e-2),
        *(_lens(f_number) for f_number in (0.5, 3.8, 100.0, 1000.0)),
        NumericCase(
            name="neglected path of a plane wave focused at 1 m",
            law=DROPPED_PATH,
            inputs={"rho": 1e-5, "a": 1e8, "b": 1.0},
        ),
        *(_hole(number) for number in (1e-3, 0.3, 12.3, 1e3 + 0.3, 1e6 + 0.3)),
        _hole(0.3, radius=2.0 * _GREEN),
        _hole(1.3, radius=1e-6, wavelength=100e-9),
        _hole(1.3, radius=5e-3, wavelength=1e-3),
    ),
)

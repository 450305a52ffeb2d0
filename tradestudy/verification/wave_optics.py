"""Hard cases of wave optics: phases of long paths, fields behind an aperture, and the fractional part in eq. 27."""

from __future__ import annotations

from typing import Final

import numpy as np

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.fresnel_validity import collimated_axis_intensity, dropped_path, paper_eq27
from tradestudy.optics.propagation.aperture import aperture_field
from tradestudy.optics.propagation.lens import CircularLens, PointSource
from tradestudy.optics.propagation.paths import SphericalPath
from tradestudy.optics.propagation.targets import TargetPoints
from tradestudy.optics.propagation.wave_optics import FieldAccuracy
from tradestudy.units import LENGTH, pretty
from tradestudy.verification.case import Family, Law, NumericCase, Stated

_GREEN: Final = 550e-9
_FAR: Final = 1e8
"""Distance [m] of a source that counts as infinitely distant; a lens of half that focal length has no effect."""

_TOLERANCE: Final = 1e-7
_NAIVE_GRID: Final = 256


def _naive(radius: float, f: float, a: float, x: float, z: float, wavelength: float) -> float:
    """Sum over a square grid inside the aperture, with phases of complete paths."""
    axis = (np.arange(_NAIVE_GRID) + 0.5) * (2.0 * radius / _NAIVE_GRID) - radius
    u, v = np.meshgrid(axis, axis)
    inside = u**2 + v**2 <= radius**2
    u, v = u[inside], v[inside]
    b = a * f / (a - f)
    incoming, outgoing = np.sqrt(a**2 + u**2 + v**2), np.sqrt((x - u) ** 2 + v**2 + z**2)
    lens = -incoming - np.sqrt(b**2 + u**2 + v**2)
    field = np.exp(2j * np.pi / wavelength * (incoming + lens + outgoing)) * (a / incoming**2) * (z / outgoing**2)
    return float(np.abs(np.sum(field) * (axis[1] - axis[0]) ** 2 / wavelength**2) ** 2)


def _ours(radius: float, f: float, a: float, x: float, z: float, wavelength: float) -> Stated:
    field = aperture_field(
        source=PointSource(distance=a),
        lens=CircularLens(radius=radius, focal_length=f, lens_phase="perfect"),
        targets=TargetPoints(x=x, y=0.0, distance=z),
        wavelength=wavelength,
        method="kirchhoff",
        accuracy=FieldAccuracy(tolerance=_TOLERANCE),
    )
    value = float(field.intensity[()])
    return Stated(value=value, error=field.error.intensity * value)


INTENSITY: Final = Law(name="intensity behind a perfect lens or a bare hole", naive=_naive, ours=_ours)


def _in_focus(f_number: float) -> NumericCase:
    f, a = 12.5e-3, 0.15
    return _case(f"in focus at f/{f_number:g}", radius=f / (2.0 * f_number), f=f, a=a, x=0.0, z=a * f / (a - f))


def _hole(name: str, radius: float, x: float, z: float, wavelength: float = _GREEN) -> NumericCase:
    """A hole without a lens, lit from infinity."""
    return _case(name, radius=radius, f=_FAR / 2.0, a=_FAR, x=x, z=z, wavelength=wavelength)


def _case(name: str, *, wavelength: float = _GREEN, **inputs: float) -> NumericCase:
    return NumericCase(name=name, law=INTENSITY, inputs={**inputs, "wavelength": wavelength})


FIELDS: Final = Family(
    name="fields",
    title="Fields behind an aperture",
    cases=(
        *(_in_focus(f_number) for f_number in (0.5, 3.8, 1000.0)),
        _hole("on axis, 10 µm behind a hole 4 µm wide", 2e-6, 0.0, 1e-5),
        _hole("off axis, 2 λ behind a hole 4 λ wide", 2.0 * _GREEN, 0.6e-6, 2.0 * _GREEN),
        _hole("on the edge of the shadow", 50e-6, 50e-6, 2e-3),
        _hole("deep in the shadow", 50e-6, 120e-6, 2e-3),
        _hole("three metres off axis, one metre behind the hole", 5.0 * _GREEN, 3.0, 1.0),
        _hole("λ = 100 nm", 1e-6, 0.5e-6, 1e-5, 100e-9),
        _hole("λ = 1 mm", 5e-3, 2e-3, 0.05, 1e-3),
    ),
)


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


def _on_axis_behind_hole(fresnel_number: float, radius: float = 1e-3, wavelength: float = _GREEN) -> NumericCase:
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
        *(_on_axis_behind_hole(number) for number in (1e-3, 0.3, 12.3, 1e3 + 0.3, 1e6 + 0.3)),
        _on_axis_behind_hole(0.3, radius=2.0 * _GREEN),
        _on_axis_behind_hole(1.3, radius=1e-6, wavelength=100e-9),
        _on_axis_behind_hole(1.3, radius=5e-3, wavelength=1e-3),
    ),
)


def _naive_part(f: float, a: float, wavelength: float) -> FloatArray:
    return np.asarray(np.fmod(4.0 * (a + a * f / (a - f)) / np.float64(wavelength), 1.0))


def _naive_zero(f: float, a: float, wavelength: float, more: int) -> FloatArray:
    b, s = a * f / (a - f), _naive_part(f, a, wavelength)
    radius4 = (2.0 * s + more) * wavelength / (1.0 / a**3 + 1.0 / b**3)
    return np.asarray(f / (2.0 * radius4**0.25))


# The law treats inputs as decimal numbers, so that nothing is rounded before the fractional part is taken.
FRACTIONAL_PART: Final = Law(
    name="fractional part of 4 (a + b)/λ",
    naive=_naive_part,
    ours=lambda f, a, wavelength: paper_eq27(focal_length=f, object_distance=a, wavelength=wavelength).fractional_part,
    magnified=False,
)
FIRST_ZERO: Final = Law(
    name="f-number of the smaller zero",
    naive=lambda f, a, wavelength: _naive_zero(f, a, wavelength, 0),
    ours=lambda f, a, wavelength: (
        paper_eq27(focal_length=f, object_distance=a, wavelength=wavelength).first_zero_f_number
    ),
    magnified=False,
)
SECOND_ZERO: Final = Law(
    name="f-number of the larger zero",
    naive=lambda f, a, wavelength: _naive_zero(f, a, wavelength, 2),
    ours=lambda f, a, wavelength: (
        paper_eq27(focal_length=f, object_distance=a, wavelength=wavelength).second_zero_f_number
    ),
    magnified=False,
)

# f = 50 mm and a = 100 mm make a + b = 200 mm: exactly 1.6 million quarter waves of 500 nm.
_PERIOD: Final = {
    "at the jump": 500e-9,
    "a millionth of the period after the jump": 4.999999999996875e-07,
    "a quarter of the period after the jump": 4.99999921875012e-07,
    "half a period after the jump": 4.99999843750049e-07,
    "three quarters of the period after the jump": 4.9999976562511e-07,
    "a millionth of the period before the next jump": 4.99999687500508e-07,
}


def _at(name: str, law: Law, wavelength: float) -> NumericCase:
    return NumericCase(name=name, law=law, inputs={"f": 0.05, "a": 0.1, "wavelength": wavelength})


EQUATION_27: Final = Family(
    name="equation-27",
    title="Minimum f-number by eq. 27",
    cases=(
        *(_at(f"fractional part {where}", FRACTIONAL_PART, light) for where, light in _PERIOD.items()),
        *(_at(f"smaller zero {where}", FIRST_ZERO, light) for where, light in _PERIOD.items()),
        *(_at(f"larger zero {where}", SECOND_ZERO, light) for where, light in _PERIOD.items()),
        NumericCase(
            name="fractional part of the paper's camera",
            law=FRACTIONAL_PART,
            inputs={"f": 0.0125, "a": 0.15, "wavelength": 550e-9},
        ),
        NumericCase(
            name="fractional part at 10⁸ m",
            law=FRACTIONAL_PART,
            inputs={"f": 0.0125, "a": 1e8, "wavelength": 450e-9},
        ),
    ),
)

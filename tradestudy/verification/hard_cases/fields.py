"""Hard cases of fields behind an aperture: f/0.5 to f/1000, holes of a few λ, the shadow's edge, far off axis."""

from __future__ import annotations

from typing import Final

import numpy as np

from tradestudy.optics.propagation import CircularLens, FieldAccuracy, PointSource, TargetPoints, aperture_field
from tradestudy.verification.hard_cases.case import Family, Law, NumericCase, Stated

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
    found = aperture_field(
        source=PointSource(distance=a),
        lens=CircularLens(radius=radius, focal_length=f, lens_phase="perfect"),
        targets=TargetPoints(x=x, y=0.0, distance=z),
        wavelength=wavelength,
        method="kirchhoff",
        accuracy=FieldAccuracy(tolerance=_TOLERANCE),
    )
    value = float(found.intensity[()])
    return Stated(value=value, error=found.error.intensity * value)


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

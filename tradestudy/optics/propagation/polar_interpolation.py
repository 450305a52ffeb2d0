"""A field that hardly changes around the chief ray: few harmonics in the angle, Chebyshev points in the radius."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.propagation.direct import ComplexArray
from tradestudy.optics.propagation.sampling import bessel_margin
from tradestudy.optics.propagation.upsampling import apply_along_rows, lagrange

_FEWEST_ANGLES = 12
_TAIL = 3.0  # times the tolerance: the last harmonics of the ring that has most of them, where all rings count
_CUBIC = 0.024  # error of interpolation through four points: this times the fourth power of the phase per step

FieldAt = Callable[[FloatArray, FloatArray], ComplexArray | None]


@dataclass(frozen=True, kw_only=True)
class PolarField:
    """A smooth field about a centre, Σ g_j(r) exp(i j φ).

    Attributes
    ----------
    centre
        [m].
    radius
        Up to which it is known [m].
    harmonics
        j, shape (harmonics,).
    table
        g_j at equal steps of the radius, one step beyond either end, shape (steps + 3, harmonics).
    """

    centre: tuple[float, float]
    radius: float
    harmonics: FloatArray
    table: ComplexArray

    def at(self, x: FloatArray, y: FloatArray) -> ComplexArray:
        """Field at points, by four neighbouring radii; `x` and `y` broadcast."""
        a, b = np.broadcast_arrays(x - self.centre[0], y - self.centre[1])
        a, b = a.ravel(), b.ravel()
        r = np.hypot(a, b)
        steps = self.table.shape[0] - 3
        place = r * (steps / self.radius)
        cell = np.minimum(place.astype(int), steps - 1)
        t = place - cell
        weights = (
            t * (t - 1) * (2 - t) / 6,
            (t + 1) * (t - 1) * (t - 2) / 2,
            t * (t + 1) * (2 - t) / 2,
            t * (t * t - 1) / 6,
        )
        turn = np.where(r > 0, a + 1j * b, 1.0) / np.where(r > 0, r, 1.0)
        middle = self.harmonics.size // 2
        power = [np.ones_like(turn)]
        for _ in range(middle):
            power.append(power[-1] * turn)
        total = np.zeros(r.size, dtype=np.complex128)
        columns = np.ascontiguousarray(self.table.T)
        for j, column in zip(range(-middle, middle + 1), columns, strict=True):
            value = sum(w * column[cell + i] for i, w in enumerate(weights))
            total += value * (power[j] if j >= 0 else power[-j].conj())
        return total


def polar_field(
    field: FieldAt, *, centre: tuple[float, float], radius: float, wavenumber: float, tolerance: float, most: int
) -> PolarField | None:
    """Sample a field on rings about a centre; None where that takes more than `most` points, or has no answer.

    Parameters
    ----------
    field
        Field at flat points, or None where it cannot be given.
    centre
        About which the field changes little with the angle [m].
    radius
        Radius of the disc [m].
    wavenumber
        Largest wavenumber of the field along any direction [rad/m]: a plane wave of m radians over the radius needs as
        many Chebyshev points on the diameter as a Bessel function of argument m has orders above the tolerance.
    tolerance
        Relative to the largest field met.
    most
        Number of points from which on it does not pay.
    """
    turns = wavenumber * radius
    steps = math.ceil(turns * (_CUBIC / tolerance) ** 0.25) + 4
    # Out to the last step of the table: polynomials of this degree magnify what is wrong a step beyond their points.
    reach = 1 + 1 / steps
    half = math.ceil((reach * turns + bessel_margin(reach * turns, tolerance)) / 2) + 1
    rings = reach * radius * np.cos(np.pi * (np.arange(half) + 0.5) / (2 * half))
    known = _harmonics(field, centre, rings, _TAIL * tolerance, most)
    if known is None:
        return None
    harmonics = np.arange(known.shape[1]) - known.shape[1] // 2
    # At the radius −r lies the opposite angle: odd harmonics change sign there.
    onto = lagrange(np.arange(-1, steps + 2) / steps, 2 * half, np.array([-reach, reach]))
    sign = np.where(harmonics % 2 == 0, 1.0, -1.0)
    table = apply_along_rows(onto, np.concatenate([known, known[::-1] * sign]))
    return PolarField(centre=centre, radius=radius, harmonics=harmonics.astype(float), table=table)


def _harmonics(
    field: FieldAt, centre: tuple[float, float], radii: FloatArray, tolerance: float, most: int
) -> ComplexArray | None:
    """Angular Fourier coefficients −m … m on rings, shape (rings, 2m + 1), m doubled until the last two are small."""
    values: ComplexArray = np.zeros((radii.size, 0), dtype=np.complex128)
    angles = _FEWEST_ANGLES
    while radii.size * angles <= most:
        # The angles before are every other one of these.
        new = np.arange(angles) if values.size == 0 else np.arange(1, angles, 2)
        angle = 2 * np.pi * new / angles
        x = centre[0] + np.multiply.outer(radii, np.cos(angle))
        y = centre[1] + np.multiply.outer(radii, np.sin(angle))
        flat = field(x.ravel(), y.ravel())
        if flat is None:
            return None
        found: ComplexArray = flat.reshape(x.shape)
        values = np.stack([values, found], axis=2).reshape(radii.size, angles) if values.size else found
        coefficients = np.fft.fft(values, axis=1) / angles
        size = np.abs(coefficients).max(axis=0)
        half = angles // 2
        if size[[half - 1, half, half + 1]].max() <= tolerance * size.max():
            return np.asarray(np.roll(coefficients, half - 1, axis=1)[:, : 2 * half - 1])
        angles *= 2
    return None

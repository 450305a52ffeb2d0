"""Intensity behind an aperture in multiple precision: whole paths on a polar rule, fine enough for thirty digits."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import mpmath as mp

RINGS, ANGLES = 64, 200


@cache
def gauss_legendre(count: int, digits: int) -> tuple[tuple[mp.mpf, mp.mpf], ...]:
    """Nodes and weights on [0, 1]."""
    rule = []
    with mp.workdps(digits):
        for i in range(1, count + 1):
            x = mp.cos(mp.pi * (i - mp.mpf(1) / 4) / (count + mp.mpf(1) / 2))
            for _ in range(8):
                before, value = mp.mpf(1), x
                for n in range(2, count + 1):
                    before, value = value, ((2 * n - 1) * x * value - (n - 1) * before) / n
                slope = count * (x * value - before) / (x * x - 1)
                x -= value / slope
            rule.append(((x + 1) / 2, 1 / ((1 - x * x) * slope * slope)))
    return tuple(rule)


def intensity(rings: int, angles: int, digits: int) -> Callable[..., mp.mpf]:
    """|∬ exp(i k (r + lens + s)) (a/r²)(z/s²) dq / λ²|² by so many nodes; one angle where the target is on the axis."""

    def exact(radius: mp.mpf, f: mp.mpf, a: mp.mpf, x: mp.mpf, z: mp.mpf, wavelength: mp.mpf) -> mp.mpf:
        b = a * f / (a - f)
        total, around = mp.mpc(0), 1 if x == 0 else angles
        # The integrand is even about the plane of the target: half the angles suffice.
        turns = [(0, 1)] if x == 0 else [(0, 1), *((j, 2) for j in range(1, angles // 2)), (angles // 2, 1)]
        for t, weight in gauss_legendre(rings, digits):
            rho = radius * t
            incoming, to_image = mp.sqrt(a * a + rho * rho), mp.sqrt(b * b + rho * rho)
            ring = mp.mpc(0)
            for j, twice in turns:
                s = mp.sqrt(z * z + rho * rho + x * x - 2 * x * rho * mp.cospi(mp.mpf(2 * j) / around))
                # The lens takes the path from the source away and adds the one to its image.
                ring += twice * mp.expjpi(2 * (s - to_image) / wavelength) * z / (s * s)
            total += weight * t * ring * a / (incoming * incoming)
        return abs(total * radius**2 * 2 * mp.pi / around / wavelength**2) ** 2

    return exact

"""Writes references.json of the hard cases: thirty digits and condition numbers, with mpmath.

Nothing of the package computes here: each law is written again as textbooks have it, in 90 digits, where its
cancellations do no harm. Inputs are taken as the doubles that they are, or as the decimals that they print as where the
law says so. Run by hand: ``python -m tests.hard.generate_references``.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import mpmath as mp

from tests.hard.field_reference import ANGLES, RINGS, intensity
from tradestudy.verification import all_families, geometry, wave_optics
from tradestudy.verification.case import Law, NumericCase

FILE = Path(__file__).parents[2] / "tradestudy" / "verification" / "references.json"
DIGITS = 90
STEPS = (mp.mpf(10) ** -30, mp.mpf(10) ** -33)  # a quotient that grows between them belongs to a jump or a root
LARGEST = mp.mpf(2) ** 1024  # rounds to infinity as a double

Exact = Callable[..., mp.mpf]


def divided(a: mp.mpf, b: mp.mpf) -> mp.mpf:
    """a/b with the poles that the laws declare as infinity."""
    return mp.inf if b == 0 else a / b


def image(a: mp.mpf, f: mp.mpf) -> mp.mpf:
    return f if mp.isinf(a) else divided(a * f, a - f)


def shift(a: mp.mpf, f: mp.mpf) -> mp.mpf:
    return mp.mpf(0) if mp.isinf(a) else divided(f * f, a - f)


def micro_image(x: mp.mpf, a: mp.mpf, z: mp.mpf, f: mp.mpf, gap: mp.mpf) -> mp.mpf:
    return divided(x * gap, z - image(a, f))


def equation_8(disparity: mp.mpf, baseline: mp.mpf, z: mp.mpf, gap: mp.mpf, f: mp.mpf) -> mp.mpf:
    """Beyond infinity is infinity: no point in front of the camera gives such a disparity."""
    if disparity == 0:
        return mp.inf
    b = z - gap * baseline / disparity
    return divided(f * b, b - f) if b > f else mp.inf


def stereo_depth(disparity: mp.mpf, baseline: mp.mpf, f: mp.mpf, angle: mp.mpf | int = 0) -> mp.mpf:
    inverse = 2 / baseline * mp.tan(mp.atan(disparity / (2 * f)) + angle / 2)
    return 1 / inverse if inverse > 0 else mp.inf


def midpoint(left: mp.mpf, right: mp.mpf, baseline: mp.mpf) -> mp.mpf:
    """Both rays lie in one plane: the midpoint is where they cross."""
    return baseline / (left - right) if left > right else mp.inf


def disparity(distance: mp.mpf, baseline: mp.mpf, f: mp.mpf, angle: mp.mpf) -> mp.mpf:
    half = mp.mpf(0) if mp.isinf(distance) else mp.atan(baseline / (2 * distance))
    return 2 * f * mp.tan(half - angle / 2)


def phase(z: mp.mpf, rho: mp.mpf, wavelength: mp.mpf) -> mp.mpf:
    return 2 * mp.pi / wavelength * (mp.sqrt(z * z + rho * rho) - z)


def dropped(rho: mp.mpf, a: mp.mpf, b: mp.mpf) -> mp.mpf:
    return sum(mp.sqrt(d * d + rho * rho) - d - rho * rho / (2 * d) for d in (a, b))


def axis(z: mp.mpf, radius: mp.mpf, wavelength: mp.mpf) -> mp.mpf:
    path = mp.sqrt(z * z + radius * radius)
    return abs(1 - z / path * mp.expjpi(2 * (path - z) / wavelength)) ** 2


def fractional_part(f: mp.mpf, a: mp.mpf, wavelength: mp.mpf) -> mp.mpf:
    quarters = 4 * (a + a * f / (a - f)) / wavelength
    # 1.6 million quarter waves are a whole number only to the digits of this arithmetic.
    nearest = mp.nint(quarters)
    return mp.mpf(0) if abs(quarters - nearest) < mp.mpf(10) ** (20 - DIGITS) else quarters - mp.floor(quarters)


def zero(f: mp.mpf, a: mp.mpf, wavelength: mp.mpf, more: int) -> mp.mpf:
    b = a * f / (a - f)
    numerator = 2 * fractional_part(f, a, wavelength) + more
    return divided(f / 2, mp.root(numerator * wavelength / (1 / a**3 + 1 / b**3), 4))


def near(focus: mp.mpf, f: mp.mpf, pupil: mp.mpf, blur: mp.mpf) -> mp.mpf:
    """Image distances whose blur is A |b₀ − b|/b = c: b = b₀ A/(A − c) is the near limit."""
    return _imaged_to(image(focus, f) * pupil / (pupil - blur), f)


def far(focus: mp.mpf, f: mp.mpf, pupil: mp.mpf, blur: mp.mpf) -> mp.mpf:
    b = image(focus, f) * pupil / (pupil + blur)
    return _imaged_to(b, f) if b > f else mp.inf


def _imaged_to(b: mp.mpf, f: mp.mpf) -> mp.mpf:
    return f * b / (b - f)


def blur(a: mp.mpf, focus: mp.mpf, f: mp.mpf, pupil: mp.mpf) -> mp.mpf:
    return pupil * abs(image(a, f) - image(focus, f)) / image(a, f)


def depth_quantile(probability: str) -> Exact:
    """1/Z is normal about its true value: quantiles of Z are those of 1/Z from the other end."""

    def exact(distance: mp.mpf, baseline: mp.mpf, yaw: mp.mpf) -> mp.mpf:
        score = mp.sqrt(2) * mp.erfinv(1 - 2 * mp.mpf(probability))
        return 1 / (1 / distance + yaw / baseline * score)

    return exact


def spread(x: int, y: int) -> Exact:
    """Standard deviation of a weighted sum of two parameters."""
    return lambda xx, xy, yy: mp.sqrt(x * x * xx + 2 * x * y * xy + y * y * yy)


LAWS: Mapping[str, Exact] = {
    geometry.IMAGE_DISTANCE.name: image,
    geometry.FOCUS_SHIFT.name: shift,
    geometry.ROUND_TRIP.name: lambda a, f: a,
    geometry.BLUR.name: blur,
    geometry.RELAY_DISTANCE.name: lambda a, z, f: z - image(a, f),
    geometry.RELAY_DISTANCE_TO_SCALE.name: lambda a, z, f: z - image(a, f),
    geometry.MICRO_IMAGE.name: micro_image,
    geometry.EQUATION_8.name: equation_8,
    geometry.DEPTH.name: stereo_depth,
    geometry.TURNED_DEPTH.name: stereo_depth,
    geometry.TURNED_DISPARITY.name: disparity,
    geometry.MIDPOINT.name: midpoint,
    wave_optics.PHASE.name: phase,
    wave_optics.SINGLE_PRECISION.name: phase,
    wave_optics.DROPPED_PATH.name: dropped,
    wave_optics.AXIS.name: axis,
    wave_optics.FRACTIONAL_PART.name: fractional_part,
    wave_optics.FIRST_ZERO.name: lambda f, a, wavelength: zero(f, a, wavelength, 0),
    wave_optics.SECOND_ZERO.name: lambda f, a, wavelength: zero(f, a, wavelength, 2),
    wave_optics.INTENSITY.name: intensity(RINGS, ANGLES, DIGITS),
    geometry.NEAR.name: near,
    geometry.FAR.name: far,
    geometry.EXTENT.name: lambda **inputs: far(**inputs) - near(**inputs),
    geometry.ALLOWANCE.name: lambda criterion, spot: mp.sqrt(criterion**2 - spot**2),
    "2.5 % quantile of stereo depth": depth_quantile("0.025"),
    "50 % quantile of stereo depth": depth_quantile("0.5"),
    "97.5 % quantile of stereo depth": depth_quantile("0.975"),
    "u(x − y), error relative to u(x)": spread(1, -1),
    "u(x + y), error relative to u(x)": spread(1, 1),
    "u(x + y)": spread(1, 1),
    "u(x + y + z)": spread(2, 2),  # z is x + y
    "u(x + y − z), error relative to u(x)": spread(0, 0),
}
COARSE: Mapping[str, Exact] = {wave_optics.INTENSITY.name: intensity(40, 130, DIGITS)}
# Errors of differences that pass through zero are relative to what is subtracted.
SCALES: Mapping[str, Exact] = {
    geometry.RELAY_DISTANCE_TO_SCALE.name: lambda a, z, f: z - f,
    geometry.EXTENT.name: lambda focus, **_: focus,
    **{f"u(x {signs}), error relative to u(x)": lambda xx, **_: mp.sqrt(xx) for signs in ("− y", "+ y", "+ y − z")},
}
DECIMAL = (wave_optics.FRACTIONAL_PART, wave_optics.FIRST_ZERO, wave_optics.SECOND_ZERO)


def row(case: NumericCase, *, quick: bool = False) -> dict[str, str]:
    """The stored reference of a case; `quick` takes the coarse rule where there is one, and no condition number."""
    with mp.workdps(DIGITS):
        exact, inputs = LAWS[case.law.name], numbers(case.law, case.inputs)
        rough = COARSE.get(case.law.name, exact)  # four digits are enough of a condition number
        value = (rough if quick else exact)(**inputs)
        if value > LARGEST:
            value = mp.inf
        scale = SCALES[case.law.name](**inputs) if case.law.name in SCALES else value
        found = {"value": printed(value)}
        if not quick:
            found["condition_number"] = mp.nstr(condition(rough, inputs, value, scale), 4)
        return found | ({"scale": printed(scale)} if case.law.name in SCALES else {})


def numbers(law: Law, inputs: Mapping[str, float]) -> dict[str, mp.mpf]:
    return {name: mp.mpf(repr(value) if law in DECIMAL else value) for name, value in inputs.items()}


def printed(value: mp.mpf) -> str:
    return "inf" if mp.isinf(value) else mp.nstr(value, 30)


def condition(exact: Exact, inputs: Mapping[str, mp.mpf], value: mp.mpf, scale: mp.mpf) -> mp.mpf:
    """Σ |x ∂y/∂x| over the scale, by central differences in many digits; infinite at a pole."""
    if mp.isinf(value) or scale == 0:
        return mp.inf
    coarse, fine = (sum(abs(move) for move in moves(exact, inputs, step)) / abs(scale) for step in STEPS)
    return fine if fine <= 2 * coarse else mp.inf


def moves(exact: Exact, inputs: Mapping[str, mp.mpf], step: mp.mpf) -> Iterator[mp.mpf]:
    """x ∂y/∂x for every input that can be moved in proportion."""
    for name, x in inputs.items():
        if mp.isfinite(x) and x != 0:
            above, below = (exact(**{**inputs, name: x * (1 + sign * step)}) for sign in (1, -1))
            yield (above - below) / (2 * step)


def table(*, quick: bool = False) -> dict[str, dict[str, dict[str, str]]]:
    """All references by family and case."""
    tables = {
        family.name: {case.name: row(case, quick=quick) for case in family.cases if isinstance(case, NumericCase)}
        for family in all_families()
    }
    return {name: rows for name, rows in tables.items() if rows}


if __name__ == "__main__":
    FILE.write_text(json.dumps(table(), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")

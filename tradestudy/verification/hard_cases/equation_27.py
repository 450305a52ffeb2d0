"""Hard cases of the printed minimum f-number (eq. 27): the fractional part of millions of quarter waves."""

from __future__ import annotations

from typing import Final

import numpy as np

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.paper_equation_27 import paper_eq27
from tradestudy.verification.hard_cases.case import Family, Law, NumericCase


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

"""The minimum f-number by the paper's equation 27 as printed, and why it must not be trusted."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import numpy.typing as npt

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.fresnel_validity import bounded_minimum_f_number, require_all_positive


@dataclass(frozen=True, kw_only=True)
class PaperEq27:
    """Both readings of the printed criterion, with their condition number.

    Attributes
    ----------
    fractional_part
        Fractional part s of 4 (a + b)/λ, in [0, 1).
    first_zero_f_number
        f-number from the zero with numerator 2 s; infinite where s = 0.
    second_zero_f_number
        f-number from the zero with numerator 2 s + 2, "the bigger one" of the text.
    condition_number
        |d ln s/d ln λ| = 4 (a + b)/(λ s): s magnifies a relative change of any length by this factor,
        ``first_zero_f_number`` by a quarter of it, and ``second_zero_f_number`` by a quarter of it times s/(s + 1).
    """

    fractional_part: FloatArray
    first_zero_f_number: FloatArray
    second_zero_f_number: FloatArray
    condition_number: FloatArray


def paper_eq27(*, focal_length: float, object_distance: float, wavelength: npt.ArrayLike) -> PaperEq27:
    """Minimal f-number for Fresnel as printed: F = γ/(2 R), R⁴ = (8 (α + β) − 2 l)/(1/α³ + 1/β³).

    Lengths are in units of the wavelength, and l is an integer next to 4 (α + β). With s, the fractional part of
    4 (α + β), the first two zeros have the numerators 2 s and 2 s + 2.

    **Not to be trusted.** s repeats with every quarter wave of a + b, so that 0.01 nm of wavelength can move
    the first zero from 5.4 to 16.6. In terms of the dropped path the two zeros are the bounded criterion at
    s/4 and (s + 1)/4 waves (see `fresnel_validity.bounded_minimum_f_number`): the second one drifts and jumps between a
    quarter and half a wave, the first one between nothing and a quarter. `paper_eq27_sweep` shows the whole
    period.

    Parameters
    ----------
    focal_length
        Focal length f [m].
    object_distance
        Object distance a > f [m]; the image distance b = a f/(a − f) follows exactly.
    wavelength
        Wavelengths λ > 0 [m], any shape.

    Returns
    -------
    PaperEq27
        Arrays of the shape of ``wavelength``.

    Raises
    ------
    OutOfRangeError
        If a ≤ f, or a length is not positive and finite.

    Notes
    -----
    "Diffraction model of a plenoptic camera for in-situ space exploration", eqs. 27 and 28. The fractional
    part is taken in exact rational arithmetic of the decimal numbers written by the inputs, because
    4 (a + b)/λ is of order 10⁶ and a wrong last digit of b already changes s; see ``condition_number`` for what the
    inputs themselves allow.
    """
    require_all_positive("focal length", focal_length)
    require_all_positive("wavelength", wavelength)
    require_all_positive("object distance", object_distance)
    if not object_distance > focal_length:
        raise OutOfRangeError(
            "object distance within the focal length",
            value=f"{object_distance:g} m",
            limit=f"> {focal_length:g} m",
            remedy="move the object beyond the focal length: the printed criterion assumes a real image",
        )
    wavelengths = np.asarray(wavelength, dtype=np.float64)
    f, a = _decimal(focal_length), _decimal(object_distance)
    b = a * f / (a - f)
    quarters = [4 * (a + b) / _decimal(float(w)) for w in wavelengths.ravel()]
    s = np.array([float(q - (q.numerator // q.denominator)) for q in quarters]).reshape(wavelengths.shape)
    total = np.array([float(q) for q in quarters]).reshape(wavelengths.shape)
    with np.errstate(divide="ignore"):  # s = 0: the first zero lies on the axis, its f-number is infinite
        condition = total / s
    first, second = (
        bounded_minimum_f_number(
            focal_length=focal_length,
            object_distance=object_distance,
            image_distance=float(b),
            wavelength=wavelengths,
            path_error_waves=waves,
        )
        for waves in (s / 4, (s + 1) / 4)
    )
    return PaperEq27(
        fractional_part=s,
        first_zero_f_number=first,
        second_zero_f_number=second,
        condition_number=condition,
    )


@dataclass(frozen=True, kw_only=True)
class PaperEq27Sweep:
    """The printed criterion over one quarter-wave period of a + b.

    Attributes
    ----------
    extra_path
        Change of a + b [m], from zero up to (not including) λ/4 beyond the last jump.
    first_zero_f_number, second_zero_f_number
        As in `PaperEq27`, at each extra path.
    """

    extra_path: FloatArray
    first_zero_f_number: FloatArray
    second_zero_f_number: FloatArray


def paper_eq27_sweep(
    *, focal_length: float, object_distance: float, wavelength: float, points: int = 257
) -> PaperEq27Sweep:
    """Both zeros of the printed criterion while a + b grows by one quarter wave.

    The first value belongs to s = 0 (a + b a whole number of quarter waves), so the sweep shows the full excursion
    whatever the nominal fractional part is: the first zero falls from infinity to the start of the second zero, and the
    second one falls by a factor of 2^(1/4) = 1.19. Changing a + b by less than λ/4 changes 1/a³ + 1/b³ by less than
    10⁻⁵.

    Parameters
    ----------
    focal_length, object_distance, wavelength
        As in `paper_eq27` [m], scalars.
    points
        Number of samples, at least 2; equally spaced, without the end of the period.

    Raises
    ------
    OutOfRangeError
        As in `paper_eq27`, or if ``points`` < 2.
    """
    if points < 2:
        raise OutOfRangeError("too few points for a sweep", value=str(points), limit="≥ 2")
    paper_eq27(focal_length=focal_length, object_distance=object_distance, wavelength=wavelength)
    s = np.arange(points) / points
    image_distance = object_distance * focal_length / (object_distance - focal_length)
    first, second = (
        bounded_minimum_f_number(
            focal_length=focal_length,
            object_distance=object_distance,
            image_distance=image_distance,
            wavelength=wavelength,
            path_error_waves=waves,
        )
        for waves in (s / 4, (s + 1) / 4)
    )
    return PaperEq27Sweep(extra_path=s * wavelength / 4, first_zero_f_number=first, second_zero_f_number=second)


def _decimal(value: float) -> Fraction:
    """Return the decimal number that prints as this float: 550e-9 means 550 nm, not a binary fraction."""
    return Fraction(repr(float(value)))

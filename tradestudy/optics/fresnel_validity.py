"""Smallest f-numbers for which the Fresnel approximation holds, in closed form.

A lens turns the paths object → aperture → image into a difference whose quadratic part cancels. What the Fresnel
approximation drops is, to lowest order, ``W(r) = (r⁴/8) (1/a³ + 1/b³)`` at the aperture radius r. Every criterion here
bounds that path in its own way. All are necessary conditions for a single point source on the axis; none replaces the
measured difference of two point-spread functions.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import numpy.typing as npt

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray


def dropped_path(
    *, aperture_radius: npt.ArrayLike, object_distance: npt.ArrayLike, image_distance: npt.ArrayLike
) -> FloatArray:
    """Path that Fresnel drops at the rim: W = Σ [ρ²/(d + √(d² + ρ²)) − ρ²/(2 d)], d = a, b.

    Exact beyond the quartic term −(ρ⁴/8)(1/a³ + 1/b³), and free of the cancellation in √(d² + ρ²) − d.

    Parameters
    ----------
    aperture_radius
        ρ ≥ 0 [m].
    object_distance, image_distance
        Legs a and b [m]; a < 0 for a virtual object, infinite for a plane wave; all arguments are broadcast together.

    Returns
    -------
    ndarray
        W [m], ≤ 0 for real legs: the true path is shorter than the parabola.

    Raises
    ------
    OutOfRangeError
        If a leg is zero or not a number, or the radius is negative.
    """
    rho = np.asarray(aperture_radius, dtype=np.float64)
    if not np.all(rho >= 0):
        raise OutOfRangeError("aperture radius", value=str(rho.min()), limit="≥ 0 m")
    return _leg_excess(rho, object_distance) + _leg_excess(rho, image_distance)


def bounded_minimum_f_number(
    *,
    focal_length: npt.ArrayLike,
    object_distance: npt.ArrayLike,
    image_distance: npt.ArrayLike,
    wavelength: npt.ArrayLike,
    path_error_waves: npt.ArrayLike,
) -> FloatArray:
    """Smallest f-number with at most ε waves of dropped path: F = (f/2) [(1/a³ + 1/b³)/(8 λ ε)]^¼.

    This follows from |W| = (r⁴/8)|1/a³ + 1/b³| ≤ ε λ at the rim r = f/(2F). Unlike the criterion printed in the paper,
    it is monotone and smooth in every argument. Legs may be signed (a < 0: virtual object); where the two cancel, the
    answer is 0.

    Parameters
    ----------
    focal_length
        f > 0 [m].
    object_distance, image_distance
        a and b [m], non-zero; infinite for a plane wave.
    wavelength
        λ > 0 [m].
    path_error_waves
        ε ≥ 0 [waves]: 0.25 for Rayleigh's quarter wave; 0 gives an infinite f-number.

    Returns
    -------
    ndarray
        F_min, broadcast over all arguments.

    Raises
    ------
    OutOfRangeError
        If a length is outside the ranges above.

    Notes
    -----
    Validity: only W's quartic term is used; the next one is smaller by r²/(2 b²), 1 % at F = 3.8. Rayleigh's
    quarter-wave rule: M. Born and E. Wolf, *Principles of Optics*, 7th ed., section 9.1.
    """
    require_all_positive("focal length", focal_length)
    require_all_positive("wavelength", wavelength)
    eps = np.asarray(path_error_waves, dtype=np.float64)
    if not np.all(eps >= 0):
        raise OutOfRangeError("path error", value=f"{np.min(eps):g} waves", limit="≥ 0 waves")
    f = np.asarray(focal_length, dtype=np.float64)
    curvature = np.abs(_inverse_cube(object_distance) + _inverse_cube(image_distance))
    with np.errstate(divide="ignore"):  # no finite f-number gives the exact path, ε = 0
        return np.asarray(f / 2 * (curvature / (8 * np.asarray(wavelength) * eps)) ** 0.25)


def goodman_minimum_f_number(
    *,
    focal_length: npt.ArrayLike,
    object_distance: npt.ArrayLike,
    image_distance: npt.ArrayLike,
    wavelength: npt.ArrayLike,
) -> FloatArray:
    """Smallest f-number at which each leg alone drops at most 1 rad: F = (f/2) [π/(4 λ d³)]^¼, d = min(a, b).

    Goodman's condition does not include a lens. So each leg is judged alone, and the shorter one decides. One radian is
    1/(2π) waves.

    Parameters
    ----------
    focal_length, object_distance, image_distance, wavelength
        As in `bounded_minimum_f_number` [m].

    Raises
    ------
    OutOfRangeError
        As in `bounded_minimum_f_number`.

    Notes
    -----
    J. W. Goodman, *Introduction to Fourier Optics*, 3rd ed. (Roberts, 2005), section 4.2.2, z³ = (π/4λ) r⁴ for points
    on axis, with his example: 1 cm and 0.5 µm give 25 cm. He requires z to be *much larger* than this, and calls the
    condition sufficient, not necessary.
    """
    require_all_positive("focal length", focal_length)
    require_all_positive("wavelength", wavelength)
    steepest = np.maximum(np.abs(_inverse_cube(object_distance)), np.abs(_inverse_cube(image_distance)))
    f = np.asarray(focal_length, dtype=np.float64)
    return np.asarray(f / 2 * (np.pi * steepest / (4 * np.asarray(wavelength))) ** 0.25)


def collimated_axis_intensity(
    *, distance: npt.ArrayLike, aperture_radius: npt.ArrayLike, wavelength: npt.ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Axial intensity behind a circular hole in a plane wave: (Rayleigh–Sommerfeld I, Fresnel).

    |1 − (z/ρ) e^{ik(ρ − z)}|² with ρ = √(z² + R²), and 4 sin²(π R²/(2 λ z)), for an incident intensity of 1.

    Parameters
    ----------
    distance
        z > 0 [m].
    aperture_radius
        R > 0 [m].
    wavelength
        λ > 0 [m].

    Returns
    -------
    tuple of ndarray
        Rayleigh–Sommerfeld and Fresnel intensity, in the shape of the arguments broadcast together.

    Raises
    ------
    OutOfRangeError
        If an argument is not positive and finite.

    Notes
    -----
    H. Osterberg and L. W. Smith, "Closed solutions of Rayleigh's diffraction integral for axial points", J.
    Opt. Soc. Am. 51, 1050–1054 (1961).
    """
    for name, value in (("distance", distance), ("aperture radius", aperture_radius)):
        require_all_positive(name, value)
    require_all_positive("wavelength", wavelength)
    z, R, lam = (np.asarray(v, dtype=np.float64) for v in (distance, aperture_radius, wavelength))
    rho = np.hypot(z, R)
    phase = 2 * np.pi / lam * (R**2 / (rho + z))
    exact = (1 - z / rho) ** 2 + 4 * (z / rho) * np.sin(phase / 2) ** 2
    fresnel = 4 * np.sin(np.pi * R**2 / (2 * lam * z)) ** 2
    return np.asarray(exact), np.asarray(fresnel)


def collimated_minimum_distance(
    *, aperture_radius: npt.ArrayLike, wavelength: npt.ArrayLike, intensity_error: npt.ArrayLike
) -> FloatArray:
    """Distance behind a hole in a plane wave beyond which Fresnel's axial intensity errs by at most δ of its peak.

    z = R (π R/(8 λ δ))^⅓: the dropped path R⁴/(8 z³) changes the axial intensity 4 sin² by at most π R⁴/(8 λ z³) of its
    peak.

    Parameters
    ----------
    aperture_radius
        R > 0 [m].
    wavelength
        λ > 0 [m].
    intensity_error
        δ in (0, 1): error of the axial intensity, relative to its peak value of 4.

    Raises
    ------
    OutOfRangeError
        If an argument is outside its range.

    Notes
    -----
    The problem is that of W. H. Southwell, "Validity of the Fresnel approximation in the near field", J. Opt. Soc. Am.
    71, 7–14 (1981): a uniformly lit circular aperture, exact law against Fresnel's. The criterion and its constant are
    derived here from the closed forms of `collimated_axis_intensity`; they are not that article's. The amplitude factor
    z/ρ adds at most R²/(4 z²).
    """
    require_all_positive("aperture radius", aperture_radius)
    require_all_positive("wavelength", wavelength)
    delta = np.asarray(intensity_error, dtype=np.float64)
    if not np.all((delta > 0) & (delta < 1)):
        raise OutOfRangeError("intensity error", value=str(intensity_error), limit="in (0, 1)")
    R = np.asarray(aperture_radius, dtype=np.float64)
    return np.asarray(R * np.cbrt(np.pi * R / (8 * np.asarray(wavelength) * delta)))


def _inverse_cube(leg: npt.ArrayLike) -> FloatArray:
    """1/d³ of a signed leg; zero at infinity."""
    d = np.asarray(leg, dtype=np.float64)
    if np.any(np.isnan(d)) or np.any(d == 0):
        raise OutOfRangeError("leg from lens to object or image", value=str(leg), limit="non-zero")
    return np.asarray(d**-3.0)


def _leg_excess(rho: FloatArray, leg: npt.ArrayLike) -> FloatArray:
    """Exact minus quadratic path of one signed leg, in a form that does not cancel."""
    d = np.asarray(leg, dtype=np.float64)
    if np.any(np.isnan(d)) or np.any(d == 0):
        raise OutOfRangeError("leg from lens to object or image", value=str(leg), limit="non-zero")
    curvature = 1 / d
    t = (rho * curvature) ** 2
    root = np.sqrt(1 + t)
    return np.asarray(-(rho**2) * curvature * t / (2 * (1 + root) ** 2))


def require_all_positive(name: str, value: npt.ArrayLike) -> None:
    """Refuse values that are not positive and finite.

    Raises
    ------
    OutOfRangeError
        If any value is zero, negative, infinite or not a number.
    """
    array = np.asarray(value, dtype=np.float64)
    if not np.all((array > 0) & np.isfinite(array)):
        raise OutOfRangeError(name, value=f"{np.min(array):g}", limit="positive and finite")


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


def paper_eq27_sweep(*, focal_length: float, object_distance: float, wavelength: float, points: int) -> FloatArray:
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
        Number of samples, at least 2; equally spaced in a + b, from the last jump up to (not including) λ/4 beyond it.

    Returns
    -------
    f-number of the first and the second zero, as in `PaperEq27`, shape (2, points).

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
    return bounded_minimum_f_number(
        focal_length=focal_length,
        object_distance=object_distance,
        image_distance=image_distance,
        wavelength=wavelength,
        path_error_waves=np.stack([s / 4, (s + 1) / 4]),
    )


def _decimal(value: float) -> Fraction:
    """Return the decimal number that prints as this float: 550e-9 means 550 nm, not a binary fraction."""
    return Fraction(repr(float(value)))

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.fresnel_validity import (
    bounded_minimum_f_number,
    collimated_axis_intensity,
    collimated_minimum_distance,
    dropped_path,
    goodman_minimum_f_number,
    paper_eq27,
    paper_eq27_sweep,
)

MAIN = {"focal_length": 12.5e-3, "object_distance": 150e-3}
MICRO = {"focal_length": 0.432e-3, "object_distance": 13.64e-3}


def image_distance(lens: dict[str, float]) -> float:
    return lens["object_distance"] * lens["focal_length"] / (lens["object_distance"] - lens["focal_length"])


def printed_criterion_at_fifty_digits(
    focal: str, distance: str, wavelength: str, numerator_offset: int
) -> tuple[mpmath.mpf, mpmath.mpf]:
    """Equations 27 and 28 as printed, in units of the wavelength, straight through mpmath."""
    with mpmath.workdps(50):
        f, a, lam = mpmath.mpf(focal), mpmath.mpf(distance), mpmath.mpf(wavelength)
        alpha, beta, gamma = a / lam, a * f / (a - f) / lam, f / lam
        largest_l = mpmath.floor(4 * (alpha + beta))
        numerator = 8 * (alpha + beta) - 2 * (largest_l - numerator_offset)
        radius = mpmath.root(numerator / (1 / alpha**3 + 1 / beta**3), 4)
        return 4 * (alpha + beta) - largest_l, gamma / (2 * radius)


@pytest.mark.parametrize(("focal", "distance"), [("12.5e-3", "150e-3"), ("0.432e-3", "13.64e-3")])
@pytest.mark.parametrize("wavelength", ["400e-9", "532.0e-9", "550e-9", "550.01e-9", "633.28e-9", "700e-9"])
def test_printed_criterion_agrees_with_fifty_digits(focal: str, distance: str, wavelength: str) -> None:
    result = paper_eq27(focal_length=float(focal), object_distance=float(distance), wavelength=float(wavelength))
    s, first = printed_criterion_at_fifty_digits(focal, distance, wavelength, 0)
    _, second = printed_criterion_at_fifty_digits(focal, distance, wavelength, 1)
    assert float(result.fractional_part) == pytest.approx(float(s), rel=1e-14)
    assert float(result.first_zero_f_number) == pytest.approx(float(first), rel=1e-13)
    assert float(result.second_zero_f_number) == pytest.approx(float(second), rel=1e-13)


def test_one_hundredth_of_a_nanometre_triples_the_first_zero() -> None:
    result = paper_eq27(wavelength=[550e-9, 550.01e-9], **MAIN)
    assert np.round(result.first_zero_f_number, 1).tolist() == [5.4, 16.6]


@pytest.mark.parametrize(("lens", "expected"), [(MAIN, (3.8, 5.2)), (MICRO, (1.7, 2.4))])
def test_range_of_the_bigger_zero_over_the_visible(lens: dict[str, float], expected: tuple[float, float]) -> None:
    second = paper_eq27(wavelength=np.linspace(400e-9, 700e-9, 20_001), **lens).second_zero_f_number
    assert (round(float(second.min()), 1), round(float(second.max()), 1)) == expected
    jumps = np.abs(np.diff(np.log(second)))
    assert np.exp(jumps.max()) - 1 <= 2**0.25 - 1 + 1e-12
    if lens is MICRO:  # sampled finely enough that a whole jump falls between two samples
        assert np.exp(jumps.max()) - 1 > 0.18


def test_smaller_zero_has_no_upper_end() -> None:
    first = paper_eq27(wavelength=np.linspace(400e-9, 700e-9, 20_001), **MAIN).first_zero_f_number
    assert first.min() == pytest.approx(4.5, abs=0.1)
    at_resonance = 4 * (MAIN["object_distance"] + image_distance(MAIN)) / 1_190_082
    assert paper_eq27(wavelength=at_resonance * (1 - 1e-12), **MAIN).first_zero_f_number > 100


def test_condition_number_predicts_the_change() -> None:
    lam, step = 550e-9, 1e-9
    here = paper_eq27(wavelength=lam, **MAIN)
    there = paper_eq27(wavelength=lam * (1 + step), **MAIN)
    assert float(there.fractional_part / here.fractional_part - 1) == pytest.approx(
        -float(here.condition_number) * step, rel=1e-5
    )
    assert 1.8e6 < here.condition_number < 1.9e6


def test_whole_number_of_quarter_waves_puts_the_first_zero_on_the_axis() -> None:
    # f = 1 mm, a = 2 mm, b = 2 mm: 4 (a + b)/λ = 32000 at 0.5 µm
    result = paper_eq27(focal_length=1e-3, object_distance=2e-3, wavelength=0.5e-6)
    assert result.fractional_part == 0
    assert np.isposinf(result.first_zero_f_number)
    assert np.isposinf(result.condition_number)
    assert result.second_zero_f_number == pytest.approx(0.5e-3 * (2 / 8e-9 / (2 * 0.5e-6)) ** 0.25)


def test_sweep_is_the_printed_criterion_at_moved_distance() -> None:
    first, second = paper_eq27_sweep(wavelength=550e-9, points=64, **MAIN)
    assert np.isposinf(first[0])
    assert np.all(np.diff(first[1:]) < 0)
    assert second[0] / second[-1] == pytest.approx((1 + 63 / 64) ** 0.25)
    # moving the object so that a + b grows by the sweep's path walks along the swept curve
    here = paper_eq27(wavelength=550e-9, **MAIN)
    index = 63
    path = ((index / 64 - float(here.fractional_part)) * 550e-9) / 4
    rate = 1 - (MAIN["focal_length"] / (MAIN["object_distance"] - MAIN["focal_length"])) ** 2  # d(a + b)/da
    moved = paper_eq27(
        focal_length=MAIN["focal_length"],
        object_distance=MAIN["object_distance"] + path / rate,
        wavelength=550e-9,
    )
    assert float(moved.fractional_part) == pytest.approx(index / 64, abs=1e-6)
    assert float(moved.first_zero_f_number) == pytest.approx(first[index], rel=2e-5)


def test_bounded_criterion_gives_the_known_numbers() -> None:
    for lens, expected in ((MAIN, 4.84), (MICRO, 2.17)):
        f_number = bounded_minimum_f_number(
            focal_length=lens["focal_length"],
            object_distance=lens["object_distance"],
            image_distance=image_distance(lens),
            wavelength=550e-9,
            path_error_waves=0.25,
        )
        assert round(float(f_number), 2) == expected


@pytest.mark.parametrize("lens", [MAIN, MICRO])
def test_bounded_criterion_leaves_the_exact_path_at_its_bound(lens: dict[str, float]) -> None:
    b = image_distance(lens)
    f_number = bounded_minimum_f_number(
        focal_length=lens["focal_length"],
        object_distance=lens["object_distance"],
        image_distance=b,
        wavelength=550e-9,
        path_error_waves=0.25,
    )
    with mpmath.workdps(40):
        r, lam = mpmath.mpf(lens["focal_length"]) / (2 * mpmath.mpf(float(f_number))), mpmath.mpf(550e-9)
        dropped = sum(
            mpmath.sqrt(d**2 + r**2) - d - r**2 / (2 * d) for d in (mpmath.mpf(lens["object_distance"]), mpmath.mpf(b))
        )
        # the next term of the series is r²/(2 b²) of it
        assert float(-dropped / lam) == pytest.approx(0.25, rel=float(r**2 / (2 * mpmath.mpf(b) ** 2)) * 1.1)


@pytest.mark.parametrize("legs", [(0.15, 0.0136), (-1.6e-3, 0.587e-3), (np.inf, 0.0125)])
def test_the_neglected_path_agrees_with_forty_digits(legs: tuple[float, float]) -> None:
    for radius in (1e-6, 1e-4, 5e-4):
        with mpmath.workdps(60):
            r = mpmath.mpf(radius)
            expected = mpmath.mpf(0)
            for leg in legs:
                if np.isfinite(leg):
                    d = mpmath.mpf(leg)
                    expected += mpmath.sign(d) * (mpmath.sqrt(d**2 + r**2) - abs(d)) - r**2 / (2 * d)
            expected = float(expected)
        value = dropped_path(aperture_radius=radius, object_distance=legs[0], image_distance=legs[1])
        assert float(value) == pytest.approx(expected, rel=1e-13)


def test_virtual_object_offsets_the_image_leg() -> None:
    arguments = {"focal_length": 1e-3, "wavelength": 550e-9, "path_error_waves": 0.25}
    assert bounded_minimum_f_number(object_distance=-2e-3, image_distance=2e-3, **arguments) == 0
    virtual = bounded_minimum_f_number(object_distance=-4e-3, image_distance=2e-3, **arguments)
    real = bounded_minimum_f_number(object_distance=4e-3, image_distance=2e-3, **arguments)
    assert float(virtual / real) == pytest.approx((7 / 9) ** 0.25)


def test_goodman_example_of_a_centimetre() -> None:
    f_number = goodman_minimum_f_number(
        focal_length=0.05, object_distance=np.inf, image_distance=0.25, wavelength=0.5e-6
    )
    assert 0.05 / (2 * float(f_number)) == pytest.approx(1e-2, rel=0.015)


def test_goodman_f_number_puts_one_radian_on_the_shorter_leg() -> None:
    b = image_distance(MAIN)
    f_number = goodman_minimum_f_number(
        focal_length=MAIN["focal_length"],
        object_distance=MAIN["object_distance"],
        image_distance=b,
        wavelength=550e-9,
    )
    radius = MAIN["focal_length"] / (2 * float(f_number))
    path = dropped_path(aperture_radius=radius, object_distance=np.inf, image_distance=b)
    assert 2 * np.pi * float(-path) / 550e-9 == pytest.approx(1, rel=2 * (radius / b) ** 2)
    assert np.cbrt(np.pi / (4 * 550e-9) * radius**4) == pytest.approx(b)


def test_axial_closed_form_against_quadrature() -> None:
    radius, distance, lam = 20e-6, 100e-6, 550e-9
    with mpmath.workdps(30):
        k, z = 2 * mpmath.pi / mpmath.mpf(lam), mpmath.mpf(distance)

        def integrand(rho: mpmath.mpf) -> mpmath.mpc:
            # Rayleigh–Sommerfeld I in full: (1/2π) (1/R − ik) (z/R) e^{ikR}/R, over rings
            slant = mpmath.sqrt(rho**2 + z**2)
            return rho * (1 / slant - 1j * k) * z / slant * mpmath.exp(1j * k * slant) / slant

        field = mpmath.quad(integrand, mpmath.linspace(0, mpmath.mpf(radius), 9))
        expected = float(abs(field) ** 2)
    exact, _ = collimated_axis_intensity(distance=distance, aperture_radius=radius, wavelength=lam)
    assert float(exact) == pytest.approx(expected, rel=1e-11)


def test_collimated_distance_bounds_the_axial_error_and_is_not_wasteful() -> None:
    radius, lam, tolerance = 1e-3, 550e-9, 0.02
    limit = float(collimated_minimum_distance(aperture_radius=radius, wavelength=lam, intensity_error=tolerance))
    z = limit * np.linspace(1.0, 1.1, 40_001)
    exact, fresnel = collimated_axis_intensity(distance=z, aperture_radius=radius, wavelength=lam)
    error = np.abs(exact - fresnel) / 4
    assert error.max() <= tolerance + radius**2 / (4 * limit**2)
    assert error.max() >= 0.95 * tolerance
    nearer, fresnel_nearer = collimated_axis_intensity(distance=z / 2, aperture_radius=radius, wavelength=lam)
    assert np.abs(nearer - fresnel_nearer).max() / 4 > 6 * tolerance


@pytest.mark.parametrize(
    "call",
    [
        lambda: paper_eq27(focal_length=12.5e-3, object_distance=12.5e-3, wavelength=550e-9),
        lambda: paper_eq27(focal_length=12.5e-3, object_distance=0.15, wavelength=0.0),
        lambda: paper_eq27(focal_length=12.5e-3, object_distance=np.inf, wavelength=550e-9),
        lambda: paper_eq27_sweep(focal_length=12.5e-3, object_distance=0.15, wavelength=550e-9, points=1),
        lambda: bounded_minimum_f_number(
            focal_length=1.0, object_distance=0.0, image_distance=1.0, wavelength=1e-6, path_error_waves=1
        ),
        lambda: bounded_minimum_f_number(
            focal_length=1.0, object_distance=1.0, image_distance=1.0, wavelength=1e-6, path_error_waves=-1
        ),
        lambda: dropped_path(aperture_radius=-1.0, object_distance=1.0, image_distance=1.0),
        lambda: dropped_path(aperture_radius=1.0, object_distance=np.nan, image_distance=1.0),
        lambda: collimated_minimum_distance(aperture_radius=1.0, wavelength=1e-6, intensity_error=0.0),
        lambda: collimated_axis_intensity(distance=np.inf, aperture_radius=1.0, wavelength=1e-6),
    ],
)
def test_impossible_arguments_are_refused(call) -> None:
    with pytest.raises(OutOfRangeError):
        call()

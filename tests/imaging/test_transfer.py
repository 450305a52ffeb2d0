"""Transfer functions against their integrals at many digits, against pupils on a grid, and against each other."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from tradestudy.errors import UnaffordableError
from tradestudy.imaging.optical_transfer import correction_at, kirchhoff_correction, kirchhoff_transfers, lattice_points
from tradestudy.imaging.transfer import (
    airy_transfer,
    disc_transfer,
    fresnel_transfer,
    square_transfer,
)

WAVELENGTH = 550e-9


def test_disc_is_the_transform_of_its_line_spread() -> None:
    """Chords of the disc: ∫ (4/π) √(1 − u²) cos(q u) du over a half, at 30 digits."""
    with mpmath.workdps(30):
        for q in (1e-6, 1e-3, 0.3, 2.0, 3.8317, 7.0, 40.0):
            exact = (4 / mpmath.pi) * mpmath.quad(
                lambda u, q=q: mpmath.sqrt(1 - u * u) * mpmath.cos(q * u), mpmath.linspace(0, 1, 20)
            )
            assert float(disc_transfer(q / np.pi, 1.0)) == pytest.approx(float(exact), abs=2e-15)
    assert disc_transfer(5.0, 0.0) == 1.0


def test_airy_is_the_common_area_of_two_sheared_pupils() -> None:
    with mpmath.workdps(30):
        for s in (0.0, 0.05, 0.4, 0.77, 0.999):
            area = 4 * mpmath.quad(lambda x: mpmath.sqrt(1 - x * x), [s, 1]) / mpmath.pi
            found = airy_transfer(s / (WAVELENGTH * 4.0), WAVELENGTH, 4.0)
            assert float(found) == pytest.approx(float(area), abs=1e-15)
    assert airy_transfer(1.0 / (WAVELENGTH * 3.9), WAVELENGTH, 4.0) == 0.0


def pupil_autocorrelation(waves: np.ndarray | float, size: int = 1024) -> tuple[np.ndarray, np.ndarray]:
    """Autocorrelation of a unit pupil by FFT on a grid: shear over twice the radius, and its value along x."""
    x = (np.arange(size) - size // 2) * (4.0 / size)
    r2 = x[None, :] ** 2 + x[:, None] ** 2
    # A pixel cut by the rim counts by its share, or the edge costs a digit.
    inside = np.clip((1.0 - np.sqrt(r2)) / (4.0 / size) + 0.5, 0.0, 1.0)
    pupil = inside * np.exp(2j * np.pi * (waves(r2) if callable(waves) else waves * r2))
    spectrum = np.abs(np.fft.fft2(pupil)) ** 2
    row = np.fft.ifft2(spectrum)[0].real
    # Over the pupil's area: at no shear at all, pixels on the rim would count by the square of their share.
    return np.arange(1, size // 2) * (4.0 / size) / 2.0, row[1 : size // 2] * (4.0 / size) ** 2 / np.pi


@pytest.mark.parametrize("waves", [0.0, 0.2, 1.0, 3.0])
def test_hopkins_is_the_autocorrelation_of_the_pupil(waves: float) -> None:
    shear, exact = pupil_autocorrelation(waves)
    f_number = 4.0
    blur = 8.0 * f_number * waves * WAVELENGTH  # W20 = c / 8N
    found = fresnel_transfer(shear / (WAVELENGTH * f_number), WAVELENGTH, f_number, blur)
    assert np.max(np.abs(found - exact)) < 4e-4


def test_hopkins_in_focus_is_airy_and_far_out_of_focus_the_disc() -> None:
    nu = np.linspace(0.0, 1.2 / (WAVELENGTH * 8.0), 50)
    for blur in (0.0, 1e-15):  # the closed form, and the integral
        np.testing.assert_allclose(
            fresnel_transfer(nu, WAVELENGTH, 8.0, blur), airy_transfer(nu, WAVELENGTH, 8.0), atol=1e-15
        )
    blur = 200 * WAVELENGTH * 8.0
    low = np.linspace(0.0, 3.0 / blur, 40)
    np.testing.assert_allclose(
        fresnel_transfer(low, WAVELENGTH, 8.0, blur), disc_transfer(low, blur), atol=1.4 * WAVELENGTH * 8.0 * low[-1]
    )


@pytest.mark.parametrize("periods", [200, 800])
def test_far_out_of_focus_disc_times_airy_errs_by_less_than_stated(periods: int) -> None:
    """What pictures take for waves beyond a blur of 200 λN."""
    N = 8.0
    blur = periods * WAVELENGTH * N
    nu = np.linspace(0.0, 1.0 / (WAVELENGTH * N), 2001)
    product = disc_transfer(nu, blur) * airy_transfer(nu, WAVELENGTH, N)
    assert np.max(np.abs(fresnel_transfer(nu, WAVELENGTH, N, blur) - product)) < 0.2 / periods**0.5


@pytest.mark.parametrize("blur", [0.4e-6, 4e-6, 20e-6, 100e-6, 400e-6])
def test_hopkins_against_its_integral_at_many_digits(blur: float) -> None:
    """From a twentieth of a wave of defocus to as much as waves are taken for."""
    f_number = 3.8
    with mpmath.workdps(25):
        for s in (0.1, 0.5, 0.8):
            nu = s / (WAVELENGTH * f_number)
            a = mpmath.pi * blur * nu
            exact = (4 / mpmath.pi) * mpmath.quad(
                lambda x, a=a, s=s: mpmath.sqrt(abs(1 - (x + s) ** 2)) * mpmath.cos(a * x),
                mpmath.linspace(0, 1 - s, 12 + int(blur / 8e-6)),
            )
            assert float(fresnel_transfer(nu, WAVELENGTH, f_number, blur)) == pytest.approx(float(exact), abs=1e-14)


def test_a_hopeless_defocus_is_refused_with_the_remedy() -> None:
    with pytest.raises(UnaffordableError, match="use the disc of rays"):
        fresnel_transfer(np.linspace(0, 1e5, 5), WAVELENGTH, 4.0, 0.1)


def kirchhoff(f_number: float, plane_shift: float, lens_phase: str = "perfect"):
    f, a = 12.5e-3, 0.15
    b = a * f / (a - f)
    aperture = f / f_number
    nu = np.linspace(0.0, 0.95 * aperture / (WAVELENGTH * b), 24)
    plane = b + plane_shift
    value, error = kirchhoff_transfers(
        nu[np.newaxis],
        wavelength=WAVELENGTH,
        aperture_diameter=aperture,
        focal_length=np.array([f]),
        plane_distance=np.array([plane]),
        defocus_waves=np.array([aperture**2 / 8 * (1 / a + 1 / plane - 1 / f) / WAVELENGTH]),
        lens_phase=lens_phase,
    )
    return nu, value[0], float(error[0]), b / aperture, aperture * abs(plane_shift) / b


@pytest.mark.parametrize("shift", [0.0, 0.15e-3])
def test_kirchhoff_tends_to_fresnel_at_high_f_number(shift: float) -> None:
    differences = []
    for f_number in (2.8, 5.6, 16.0):
        nu, found, error, working, blur = kirchhoff(f_number, shift)
        plane = working * (1 + shift / (0.15 * 12.5e-3 / (0.15 - 12.5e-3)))
        fresnel = fresnel_transfer(nu, WAVELENGTH, plane, blur)
        differences.append(float(np.max(np.abs(found - fresnel))))
        assert found[0] == pytest.approx(1.0, abs=1e-9)
        assert error < 5e-3
    assert differences[2] < 4e-4
    assert differences[2] < differences[0]


def test_kirchhoff_of_the_parabolic_lens_has_its_spherical_aberration() -> None:
    """W = r⁴/8 (1/a³ + 1/b³), put into a pupil on a grid."""
    f_number, f, a = 5.6, 12.5e-3, 0.15
    b = a * f / (a - f)
    radius = f / f_number / 2
    rim = radius**4 / 8 * (1 / a**3 + 1 / b**3) / WAVELENGTH
    nu, found, _, working, _ = kirchhoff(f_number, 0.0, "parabolic")
    shear, exact = pupil_autocorrelation(lambda r2: rim * r2**2)
    expected = np.interp(WAVELENGTH * working * nu, np.append(0.0, shear), np.append(1.0, exact))
    assert np.max(np.abs(found - expected)) < 6e-3
    # It is no small thing: the perfect lens is elsewhere.
    assert np.max(np.abs(found - airy_transfer(nu, WAVELENGTH, working))) > 0.03


def test_kirchhoff_of_a_converging_wave_and_of_a_distant_point() -> None:
    """A Galilean microlens: light on its way to a point behind it; and a star."""
    aperture = 60e-6
    for distance, f in ((-1.2e-3, 0.45e-3), (np.inf, 0.45e-3)):
        plane = 1 / (1 / f - 1 / distance)
        nu = np.linspace(0.0, 0.9 / (WAVELENGTH * plane / aperture), 9)
        found, _ = kirchhoff_transfers(
            nu[np.newaxis],
            wavelength=WAVELENGTH,
            aperture_diameter=aperture,
            focal_length=np.array([f]),
            plane_distance=np.array([plane]),
            defocus_waves=np.zeros(1),
            lens_phase="perfect",
        )
        np.testing.assert_allclose(found[0], airy_transfer(nu, WAVELENGTH, plane / aperture), atol=8e-3)


@pytest.mark.parametrize(("f_number", "lens_phase", "digits"), [(9.8, "perfect", 1e-5), (5.6, "parabolic", 1e-4)])
def test_interpolating_kirchhoff_is_as_good_as_computing_every_distance(f_number, lens_phase, digits) -> None:
    f, focus = 18.3e-3, 55e-3
    plane, aperture = f * focus / (focus - f), f / f_number
    distance = np.array([50.3e-3, 55.02e-3, 58e-3, focus])
    nu = np.linspace(0.0, 0.9 / (WAVELENGTH * plane / aperture), 12)
    waves = aperture**2 / 8 * (1 / distance + 1 / plane - 1 / f) / WAVELENGTH
    common = {"wavelength": WAVELENGTH, "aperture_diameter": aperture, "lens_phase": lens_phase}
    kirchhoff_correction.cache_clear()
    lens = {**common, "focal_length": np.full(4, f), "plane_distance": np.full(4, plane), "defocus_waves": waves}
    value, error = kirchhoff_transfers(np.tile(nu, (4, 1)), **lens)
    assert kirchhoff_correction.cache_info().misses == len(lattice_points(**lens))
    for k, a in enumerate(distance):
        own, _ = kirchhoff_correction(WAVELENGTH, aperture, f, float(a), plane, lens_phase)
        blur = aperture * plane * abs(1 / f - 1 / a - 1 / plane)
        alone = fresnel_transfer(nu, WAVELENGTH, plane / aperture, blur)
        alone = alone + correction_at(own, WAVELENGTH * plane / aperture * nu)
        assert np.max(np.abs(value[k] - alone)) < digits
        assert np.max(np.abs(value[k] - alone)) < error[k]


def test_the_pixel_is_the_transform_of_a_square() -> None:
    x, w = np.linspace(-0.5, 0.5, 4001), 0.8
    for nu_x, nu_y in ((0.3, 0.1), (1.7, -0.4)):
        along = [np.trapezoid(np.cos(2 * np.pi * nu * w * x), x) for nu in (nu_x, nu_y)]
        assert float(square_transfer(nu_x, nu_y, w)) == pytest.approx(along[0] * along[1], abs=1e-6)
    assert square_transfer(3.0, 2.0, 0.0) == 1.0

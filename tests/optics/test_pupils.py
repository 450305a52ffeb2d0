"""Aberrations and amplitudes of an aperture, against closed forms, plain quadrature and another program."""

from __future__ import annotations

import numpy as np
import pytest
from prysm import propagation
from prysm.polynomials import noll_to_nm, zernike_nm
from scipy.special import erf, j1

from tradestudy import optics
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.propagation.pupil import Pupil, ZernikePath, noll_order
from tradestudy.optics.quadrature import disc_nodes

WAVELENGTH = 550e-9
LENS = {"focal_length": 50e-3, "f_number": 2.8, "wavelength": WAVELENGTH}
RADIUS = 50e-3 / 5.6
SEVERAL = {2: 0.05, 5: -0.2, 7: 0.1, 8: 0.15, 9: 0.07, 11: -0.25, 14: 0.06, 23: 0.04}


def rays_of_disc() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gauss–Legendre in the radius itself, not in its square as the code under test has it, with other angles."""
    t, w = np.polynomial.legendre.leggauss(60)
    rho, angle = (t + 1) / 2, 2 * np.pi * (np.arange(150) + 0.3) / 150
    weight = np.outer(w / 2 * rho, np.full(angle.size, 2 * np.pi / angle.size))
    return np.outer(rho, np.cos(angle)).ravel(), np.outer(rho, np.sin(angle)).ravel(), weight.ravel()


def test_noll_orders_are_another_programs_and_polynomials_have_unit_variance() -> None:
    assert [noll_order(j) for j in range(1, 154)] == [noll_to_nm(j) for j in range(1, 154)]
    nodes = disc_nodes(radius=2e-3, radial_count=24, angular_count=60)
    values = np.array(
        [ZernikePath(zernikes={j: 1.0}, radius=2e-3).value(nodes.x, nodes.y) for j in (*range(1, 30), 150)]
    )
    assert (values * nodes.weights) @ values.T / nodes.weights.sum() == pytest.approx(np.eye(30), abs=1e-12)


def test_polynomials_are_those_of_nolls_table() -> None:
    r, angle = 0.7, 0.4
    table = {
        4: np.sqrt(3) * (2 * r**2 - 1),
        5: np.sqrt(6) * r**2 * np.sin(2 * angle),
        7: np.sqrt(8) * (3 * r**3 - 2 * r) * np.sin(angle),
        8: np.sqrt(8) * (3 * r**3 - 2 * r) * np.cos(angle),
        11: np.sqrt(5) * (6 * r**4 - 6 * r**2 + 1),
        18: np.sqrt(12) * (5 * r**5 - 4 * r**3) * np.cos(3 * angle),
    }
    x, y = np.array(3e-3 * r * np.cos(angle)), np.array(3e-3 * r * np.sin(angle))
    for index, truth in table.items():
        assert ZernikePath(zernikes={index: 2.0}, radius=3e-3).value(x, y) == pytest.approx(2 * truth, rel=1e-13)


def test_derivatives_are_differences_of_the_path() -> None:
    path = ZernikePath(zernikes=SEVERAL, radius=1.0)
    x, y, h = np.array([0.3, -0.8]), np.array([0.5, 0.1]), 1e-5
    here = path.expansion(x, y)
    assert here.p_x == pytest.approx((path.value(x + h, y) - path.value(x - h, y)) / (2 * h), rel=1e-7)
    assert here.p_y == pytest.approx((path.value(x, y + h) - path.value(x, y - h)) / (2 * h), rel=1e-7)
    for name, a, b, part in (("xx", h, 0.0, 0), ("xy", 0.0, h, 0), ("yy", 0.0, h, 1)):
        slopes = [path.slope(x + s * a, y + s * b)[part] for s in (1, -1)]
        assert getattr(here, name) == pytest.approx((slopes[0] - slopes[1]) / (2 * h), rel=1e-6)


@pytest.mark.parametrize("waves", [0.05, 0.2, 0.6])
def test_strehl_ratio_on_the_axis_has_its_closed_form(waves: float) -> None:
    """∫₀¹ exp(2πi a Z(√t)) dt: a sinc for defocus, Fresnel's integrals for spherical aberration."""

    def on_axis(index: int) -> tuple[float, float]:
        pupil = Pupil.from_waves({index: waves}, wavelength=WAVELENGTH)
        psf = optics.point_spread(**LENS, method="fresnel", pupil=pupil, window=4)
        return float(psf.at(0.0, 0.0)) / psf.reference_peak, psf.sample_error / psf.reference_peak

    value, error = on_axis(4)
    assert value == pytest.approx(np.sinc(2 * np.sqrt(3) * waves) ** 2, abs=error + 1e-12)
    value, error = on_axis(11)
    # 6 t² − 6 t + 1 = 6 (t − ½)² − ½, and ∫ exp(i c s²) ds from −½ to ½ = √(π/−ic) erf(√(−ic)/2).
    c = 2 * np.pi * waves * np.sqrt(5) * 6
    assert value == pytest.approx(abs(np.sqrt(np.pi / (-1j * c)) * erf(np.sqrt(-1j * c) / 2)) ** 2, abs=error + 1e-12)


def test_several_aberrations_agree_with_another_program() -> None:
    """Coma and the rest point where prysm has them; its staircase rim shrinks with its samples."""
    ours = optics.point_spread(
        **LENS, method="fresnel", pupil=Pupil.from_waves(SEVERAL, wavelength=WAVELENGTH), window=8
    )
    step = ours.spacings[0]
    differences = []
    for samples in (128, 512):
        axis = 2 / samples * (np.arange(samples) - samples // 2)
        u, v = np.meshgrid(axis, axis)
        rho, angle = np.hypot(u, v), np.arctan2(v, u)
        path = sum(a * zernike_nm(*noll_to_nm(j), rho, angle, norm=True) for j, a in SEVERAL.items())
        wave = propagation.Wavefront.from_amp_and_phase(
            (rho <= 1).astype(float), path * WAVELENGTH * 1e9, WAVELENGTH * 1e6, 2 * RADIUS / samples * 1e3
        )
        count = ours.x.size + 1  # prysm's origin is at count // 2
        theirs = np.abs(wave.focus_fixed_sampling(50.0, step * 1e6, count).data) ** 2
        theirs = theirs[1:, 1:]
        scale = np.sum(theirs * ours.intensity) / np.sum(theirs**2)
        differences.append(float(np.linalg.norm(scale * theirs - ours.intensity) / np.linalg.norm(ours.intensity)))
    assert differences[1] < 1e-3
    assert differences[1] < differences[0] / 4
    assert np.linalg.norm(scale * theirs[::-1, ::-1] - ours.intensity) > 0.3 * np.linalg.norm(ours.intensity)


def transfer_by_autocorrelation(frequency: float, angle: float) -> float:
    """|∫∫ P(u + s/2) P*(u − s/2) du|/π over the lens where both pupils overlap, s = λ N f on a pupil of radius ½."""
    s = 2 * WAVELENGTH * 2.8 * frequency  # shift over the radius
    t, w = np.polynomial.legendre.leggauss(120)
    half = np.arccos(s / 2)
    along, total = half * t, 0.0
    pupil = ZernikePath(zernikes=SEVERAL, radius=1.0)
    for a, g in zip(along, half * w, strict=True):
        across, jacobian = np.sin(a), np.cos(a)
        reach = np.cos(a) - s / 2
        p, q = reach * t, np.full(t.size, across)
        phases = [
            pupil.value(
                (p + m * s / 2) * np.cos(angle) - q * np.sin(angle), (p + m * s / 2) * np.sin(angle) + q * np.cos(angle)
            )
            for m in (1, -1)
        ]
        total += g * jacobian * reach * np.sum(w * np.exp(2j * np.pi * (phases[0] - phases[1])))
    return abs(total) / np.pi


def test_transfer_is_the_autocorrelation_of_the_pupil_within_its_error() -> None:
    psf = optics.point_spread(**LENS, method="fresnel", pupil=Pupil.from_waves(SEVERAL, wavelength=WAVELENGTH))
    frequency = np.array([50e3, 150e3, 400e3])
    for angle in (0.0, 1.0):
        mtf = psf.modulation_transfer(frequency, angle=angle)
        truth = [transfer_by_autocorrelation(float(f), angle) for f in frequency]
        assert np.all(np.abs(mtf.value - truth) <= mtf.error)
        assert mtf.error.max() < 0.02


def amplitude(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.asarray(np.exp(-(x**2) - 0.5 * y**2 + 0.3 * x * y) * (1 + 0.2 * x))


def path(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.asarray(WAVELENGTH * (0.4 * np.sin(2 * x + y) + 0.3 * x * y**2))


@pytest.mark.parametrize("as_array", [False, True])
def test_any_pupil_by_exact_paths_is_plain_quadrature(as_array: bool) -> None:
    axis = np.linspace(-1, 1, 81)
    given = {
        name: function(axis[None, :] + 0 * axis[:, None], axis[:, None] + 0 * axis) if as_array else function
        for name, function in (("amplitude", amplitude), ("path", path))
    }
    source = optics.PointSource(x=1e-3, y=-2e-3, distance=0.5)
    psf = optics.point_spread(**LENS, source=source, pupil=Pupil(**given, zernikes={6: 0.1 * WAVELENGTH}), window=4)
    x, y, w = rays_of_disc()
    u, v, w = RADIUS * x, RADIUS * y, RADIUS**2 * w
    image = 0.5 * 50e-3 / 0.45
    k = 2 * np.pi / WAVELENGTH
    r = np.sqrt((u - source.x) ** 2 + (v - source.y) ** 2 + source.distance**2)
    to_image = np.sqrt((u - psf.centre[0]) ** 2 + (v - psf.centre[1]) ** 2 + image**2)
    aberration = path(x, y) + 0.1 * WAVELENGTH * np.sqrt(6) * (x**2 - y**2)
    behind = source.distance / r**2 * amplitude(x, y) * np.exp(1j * k * (aberration - to_image))
    power = np.sum(w * np.abs(behind) ** 2)
    for i, j in ((40, 40), (30, 47), (55, 22)):
        s = np.sqrt((u - psf.x[j]) ** 2 + (v - psf.y[i]) ** 2 + image**2)
        truth = abs(np.sum(w * behind * image / (WAVELENGTH * s**2) * np.exp(1j * k * s))) ** 2 / power
        assert psf.intensity[i, j] == pytest.approx(truth, abs=psf.sample_error + 3e-8 * psf.reference_peak)
    assert psf.relative_error <= 1e-6


@pytest.mark.parametrize("obscuration", [0.3, 0.7])
def test_a_dark_middle_leaves_the_pattern_of_a_ring(obscuration: float) -> None:
    """Born and Wolf, section 8.6.2: both discs' patterns, one less the other."""
    psf = optics.point_spread(**LENS, method="fresnel", pupil=Pupil(obscuration=obscuration), window=8)
    v = np.pi * np.hypot(psf.x, psf.y[:, None] + 1e-300) / (WAVELENGTH * 2.8)
    v = np.maximum(v, 1e-9)
    ring = (2 * j1(v) / v - obscuration * 2 * j1(obscuration * v) / v) / (1 - obscuration**2)
    assert np.abs(psf.relative_intensity - ring**2).max() < 1e-8
    area = np.pi * RADIUS**2 * (1 - obscuration**2)
    assert psf.reference_peak == pytest.approx(area / (WAVELENGTH * 50e-3) ** 2, rel=1e-9)
    assert psf.relative_error <= 1e-6


def behind_focus(method: str, pupil: Pupil, tolerance: float) -> optics.ApertureField:
    return optics.aperture_field(
        source=optics.PointSource.at_infinity(),
        lens=optics.CircularLens(radius=RADIUS, focal_length=50e-3, lens_phase="perfect", pupil=pupil),
        targets=optics.TargetGrid.centred(centre=(30e-6, 0.0), pitch=10e-6, count=33, distance=48.5e-3),
        wavelength=WAVELENGTH,
        method=method,
        accuracy=optics.FieldAccuracy(tolerance=tolerance),
    )


def test_rays_and_boundary_waves_follow_zernike_aberrations() -> None:
    coma = Pupil.from_waves({8: 0.3, 6: 0.2}, wavelength=WAVELENGTH)
    truth = behind_focus("kirchhoff", coma, 1e-4).intensity
    waves = behind_focus("boundary_wave", coma, 0.05)
    assert waves.handed_over < 0.5
    assert np.linalg.norm(waves.intensity - truth) < waves.error.intensity * np.linalg.norm(truth)
    rays = behind_focus("geometric", coma, 0.05).intensity
    without = behind_focus("geometric", Pupil(), 0.05).intensity
    # Rays lack the fringes of the edge, but light and dark of the aberration is theirs.
    smooth = [one.reshape(3, 11, 3, 11).mean(axis=(1, 3)) for one in (truth, rays, without)]
    assert np.abs(smooth[1] / smooth[0] - 1).max() < 0.25 * np.abs(smooth[2] / smooth[0] - 1).max()


def test_impossible_pupils_are_refused() -> None:
    for wrong in (
        {"zernikes": {0: 1e-7}},
        {"zernikes": {154: 1e-7}},
        {"zernikes": {4: np.inf}},
        {"obscuration": 1.0},
        {"path": np.zeros((8, 9))},
        {"amplitude": np.full((9, 9), np.nan)},
    ):
        with pytest.raises(OutOfRangeError):
            Pupil(**wrong)
    with pytest.raises(OutOfRangeError, match="one finite number"):
        optics.point_spread(**LENS, pupil=Pupil(amplitude=lambda x, y: np.full_like(x, np.nan)), window=4)
    for method in ("geometric", "boundary_wave"):
        with pytest.raises(OutOfRangeError, match="fit Zernike"):
            behind_focus(method, Pupil(path=path), 0.05)
    for method in ("geometric", "boundary_wave"):
        for uneven in (Pupil(amplitude=amplitude), Pupil(obscuration=0.2)):
            with pytest.raises(OutOfRangeError, match="kirchhoff"):
                behind_focus(method, uneven, 0.05)

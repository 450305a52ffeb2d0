"""Fields against closed forms, conservation laws, symmetries and limits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import fresnel, j0, j1, jv

from tradestudy.optics.propagation.aperture import aperture_field, lens_wave
from tradestudy.optics.propagation.kernels import ApertureSamples, FresnelKernel, KirchhoffKernel, direct_sum
from tradestudy.optics.propagation.lens import CircularLens, PointSource
from tradestudy.optics.propagation.sampling import NodeCounts
from tradestudy.optics.propagation.targets import TargetGrid, TargetPoints
from tradestudy.optics.propagation.wave_optics import FieldAccuracy, propagate_wave, sample_wave
from tradestudy.optics.quadrature import disc_nodes, rectangle_nodes

WAVELENGTH = 550e-9
WAVENUMBER = 2 * math.pi / WAVELENGTH
SOURCE = PointSource(distance=0.15)


def main_lens(phase: str = "perfect", f_number: float = 3.8, **options) -> CircularLens:
    return CircularLens(radius=12.5e-3 / f_number / 2, focal_length=12.5e-3, lens_phase=phase, **options)


def run(method: str, targets, *, source=SOURCE, lens=None, tolerance=1e-7, wavelength=WAVELENGTH, **options):
    return aperture_field(
        source=source,
        lens=lens or main_lens(),
        targets=targets,
        wavelength=wavelength,
        method=method,
        accuracy=FieldAccuracy(tolerance=tolerance),
        **options,
    )


def test_fresnel_in_focus_is_airy():
    lens = main_lens()
    _, _, b = lens.image_of(SOURCE)
    grid = TargetGrid.centred(centre=(0.0, 0.0), pitch=0.31e-6, count=65, distance=b)
    x, y, _ = grid.coordinates()
    v = (WAVENUMBER * lens.radius * np.hypot(x, y) / b).reshape(grid.shape)
    v[32, 32] = 1.0
    airy = (2 * j1(v) / v) ** 2
    airy[32, 32] = 1.0
    peak = (math.pi * lens.radius**2 / (WAVELENGTH**2 * 0.15 * b)) ** 2
    np.testing.assert_allclose(run("fresnel", grid).intensity, peak * airy, rtol=1e-6, atol=1e-8 * peak)


@pytest.mark.parametrize("waves", [0.7, -2.3])
def test_fresnel_out_of_focus_is_lommel(waves: float):
    """I(u, v) = (2/u)² (U1² + U2²), Born and Wolf 8.8.1, by the series of Bessel functions."""
    lens = main_lens()
    _, _, b = lens.image_of(SOURCE)
    # 1/a + 1/z − 1/f = 2 W λ/R² puts W waves of defocus on the rim.
    distance = 1 / (1 / b + 2 * waves * WAVELENGTH / lens.radius**2)
    r = np.linspace(0.0, 12e-6, 30)
    u = -WAVENUMBER * lens.radius**2 * (1 / b - 1 / distance)
    v = WAVENUMBER * lens.radius * r / distance

    def lommel(order: int) -> np.ndarray:
        s = np.arange(60)
        signs, powers = (-1.0) ** s, 2 * s + order
        with np.errstate(divide="ignore", invalid="ignore"):  # v = 0 is set below
            terms = signs * (u / v[:, None]) ** powers * jv(powers, v[:, None])
        at_zero = np.sum(signs * (u / 2) ** powers / np.asarray([math.factorial(p) for p in powers], dtype=float))
        return np.where(v == 0, at_zero, np.nansum(terms, axis=1))

    expected = (2 / u) ** 2 * (lommel(1) ** 2 + lommel(2) ** 2)
    peak = (math.pi * lens.radius**2 / (WAVELENGTH**2 * 0.15 * distance)) ** 2
    found = run("fresnel", TargetPoints(x=r, y=0.0, distance=distance)).intensity / peak
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-8)


def plane_wave(radius: float):
    def sample(counts: NodeCounts) -> ApertureSamples:
        nodes = disc_nodes(radius=radius, radial_count=counts.radial, angular_count=counts.angular)
        return ApertureSamples(nodes=nodes, field=np.ones(nodes.count, dtype=complex))

    return sample


def test_rayleigh_sommerfeld_on_the_axis_of_a_bare_aperture():
    """U(z) = exp(i k z) − z/ρ exp(i k ρ), ρ² = z² + R², exact for a plane wave on a disc."""
    radius, z = 20e-6, np.linspace(15e-6, 900e-6, 40)
    rim = np.hypot(z, radius)
    exact = np.exp(1j * WAVENUMBER * z) - z / rim * np.exp(1j * WAVENUMBER * rim)
    result = propagate_wave(
        sample=plane_wave(radius),
        counts=NodeCounts(radial=60, angular=8),
        kernel=KirchhoffKernel(wavelength=WAVELENGTH, obliquity="rayleigh-sommerfeld-1"),
        targets=TargetPoints(x=0.0, y=0.0, distance=z),
        accuracy=FieldAccuracy(tolerance=1e-9),
    )
    np.testing.assert_allclose(result.field, exact, atol=1e-9)


def test_square_aperture_by_fresnel_is_the_product_of_fresnel_integrals():
    side, z, centre = 100e-6, 3e-3, (30e-6, -20e-6)

    def sample(counts: NodeCounts) -> ApertureSamples:
        nodes = rectangle_nodes(width=side, height=side, counts=(counts.radial, counts.angular), centre=centre)
        return ApertureSamples(nodes=nodes, field=np.ones(nodes.count, dtype=complex))

    grid = TargetGrid(x_start=-40e-6, y_start=-90e-6, x_pitch=5e-6, y_pitch=4e-6, x_count=33, y_count=36, distance=z)
    result = propagate_wave(
        sample=sample,
        counts=NodeCounts(radial=40, angular=40),
        kernel=FresnelKernel(wavelength=WAVELENGTH),
        targets=grid,
        accuracy=FieldAccuracy(tolerance=1e-8),
    )
    scale = math.sqrt(2 / (WAVELENGTH * z))

    def along(t: np.ndarray, middle: float) -> np.ndarray:
        (s1, c1), (s2, c2) = fresnel(scale * (middle - side / 2 - t)), fresnel(scale * (middle + side / 2 - t))
        return (c2 - c1) + 1j * (s2 - s1)

    exact = np.outer(along(grid.y_axis, centre[1]), along(grid.x_axis, centre[0])) / 2j
    exact = exact * np.exp(1j * WAVENUMBER * z)
    np.testing.assert_allclose(result.field, exact, atol=2e-8)


def test_encircled_energy_of_fresnel_and_conservation_of_kirchhoff():
    lens = main_lens()
    _, _, b = lens.image_of(SOURCE)
    radius = 8e-6
    disc = disc_nodes(radius=radius, radial_count=40, angular_count=8)
    targets = TargetPoints(x=disc.x, y=disc.y, distance=b)
    through = math.pi * lens.radius**2 / (WAVELENGTH * 0.15) ** 2
    v = WAVENUMBER * lens.radius * radius / b
    share = float(np.sum(run("fresnel", targets).intensity * disc.weights) / through)
    assert share == pytest.approx(1 - j0(v) ** 2 - j1(v) ** 2, rel=1e-7)
    # Kirchhoff, out of focus: the power through two planes is the power through the aperture, up to the tail outside.
    powers = []
    for distance, half in ((b * 1.015, 80e-6), (b * 0.985, 80e-6)):
        disc = disc_nodes(radius=half, radial_count=130, angular_count=4)
        field = run(
            "kirchhoff",
            TargetPoints(x=disc.x, y=disc.y, distance=distance),
            obliquity="rayleigh-sommerfeld-1",
            tolerance=1e-6,
        )
        powers.append(float(np.sum(field.intensity * disc.weights) / through))
    # Intensity in a plane counts power divided by the cosine: 1 + R²/(4 b²) on average; the tail is 2/(π k R r/b).
    tail = 2 / (math.pi * WAVENUMBER * lens.radius * 80e-6 / b)
    for power in powers:
        assert 1 - 2 * tail < power < 1 + (lens.radius / b) ** 2 / 2
    assert powers[0] == pytest.approx(powers[1], rel=2e-3)


@pytest.mark.parametrize("method", ["kirchhoff", "fresnel", "boundary_wave", "geometric"])
def test_moving_and_turning_everything_changes_nothing(method: str):
    source, shift, turn = np.asarray([1e-3, 0.4e-3]), np.asarray([0.3e-3, -0.7e-3]), 0.61
    distance = 14.2e-3
    offset = 40e-6 * (np.random.default_rng(2).random((2, 30)) - 0.5)
    rotation = np.asarray([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    image = -source * distance / 0.15

    def at(matrix: np.ndarray, move: np.ndarray) -> np.ndarray:
        s = matrix @ source + move
        p = matrix @ (image[:, None] + offset) + move[:, None]
        return run(
            method,
            TargetPoints(x=p[0], y=p[1], distance=distance),
            source=PointSource(x=s[0], y=s[1], distance=0.15),
            lens=main_lens("parabolic", centre=(move[0], move[1])),
            tolerance=1e-1 if method == "boundary_wave" else 1e-7,
        ).intensity

    here = at(np.eye(2), np.zeros(2))
    assert here.max() > 0
    scale = 1e-3 if method == "boundary_wave" else 1e-7  # its poles are taken to a hundredth of its tolerance
    np.testing.assert_allclose(at(np.eye(2), shift), here, atol=scale * here.max())
    np.testing.assert_allclose(at(rotation, np.zeros(2)), here, atol=scale * here.max())


@pytest.mark.parametrize("method", ["kirchhoff", "fresnel"])
@pytest.mark.parametrize("counts", [(40, 31), (31, 40), (128, 128)])
def test_the_image_lies_where_the_thin_lens_puts_it(method: str, counts: tuple[int, int]):
    """Not mirrored, not shifted by a pixel: even and odd counts, interpolated and not."""
    columns, rows = counts
    lens, source = main_lens(), PointSource(x=1.1e-3, y=-0.6e-3, distance=0.15)
    x, y, b = lens.image_of(source)
    assert x == pytest.approx(-1.1e-3 * b / 0.15)
    row, column = rows // 3, 2 * columns // 3
    pitch = 0.6e-6
    grid = TargetGrid(
        x_start=x - column * pitch,
        y_start=y - row * pitch,
        x_pitch=pitch,
        y_pitch=pitch,
        x_count=columns,
        y_count=rows,
        distance=b,
    )
    intensity = run(method, grid, source=source).intensity
    assert np.unravel_index(np.argmax(intensity), intensity.shape) == (row, column)
    left, right = intensity[row, column - 1], intensity[row, column + 1]
    assert left == pytest.approx(right, rel=0.02)


def peak(method: str, f_number: float, phase: str, wavelength: float = 450e-9) -> float:
    lens = main_lens(phase, f_number, **({"focus_distance": 0.15} if phase == "stigmatic" else {}))
    _, _, b = lens.image_of(SOURCE)
    targets = TargetPoints(x=0.0, y=0.0, distance=b)
    return float(run(method, targets, lens=lens, wavelength=wavelength, tolerance=1e-8).intensity)


@pytest.mark.parametrize(
    ("f_number", "phase", "percent"),
    [(5.8, "parabolic", "8.6"), (3.8, "parabolic", "889"), (5.8, "stigmatic", "0.6"), (3.8, "stigmatic", "1.5")],
)
def test_peak_of_fresnel_over_kirchhoff_at_450_nm(f_number: float, phase: str, percent: str):
    ratio = peak("fresnel", f_number, phase) / peak("kirchhoff", f_number, phase)
    digits = len(percent.split(".")[1]) if "." in percent else 0
    assert f"{100 * (ratio - 1):.{digits}f}" == percent


def test_obliquities_differ_by_what_their_cosines_say():
    """In the focus all of the aperture is in phase: the peak is the squared mean of the obliquity, in closed form."""
    lens = main_lens()
    x, y, b = lens.image_of(SOURCE)
    focus = TargetPoints(x=x, y=y, distance=b)
    paper, textbook, full = (
        float(run("kirchhoff", focus, obliquity=o, tolerance=1e-9).intensity)
        for o in ("paper", "textbook", "rayleigh-sommerfeld-1")
    )
    # Behind a perfect lens the wave points to the target: only the source's own cosine is left of the difference,
    # a/r = 1 − q²/(2 a²), 1 − R²/(4 a²) on average.
    assert textbook / paper - 1 == pytest.approx(2 * lens.radius**2 / (4 * 0.15**2), rel=1e-2)
    near = (1 + 1 / (WAVENUMBER * b) ** 2) * (1 + 1 / (WAVENUMBER * 0.15) ** 2)
    assert full / paper == pytest.approx(near, abs=2e-12)
    # With the direction before the lens, nearly along the axis, (1 + cos)/2 stands where cos stood:
    # mean of (1 − cos)/(2 cos) is R²/(8 b²) in the field.
    wave = lens_wave(source=SOURCE, lens=lens, wavelength=WAVELENGTH, obliquity="textbook")
    samples = sample_wave(wave, NodeCounts(radial=20, angular=12))
    before = ApertureSamples(nodes=samples.nodes, field=samples.field, axial_cosine=np.ones(samples.nodes.count))
    kernel = KirchhoffKernel(wavelength=WAVELENGTH, obliquity="textbook")
    changed = abs(direct_sum(before, kernel, *focus.coordinates())[0]) ** 2
    assert changed / textbook - 1 == pytest.approx(lens.radius**2 / (4 * b**2), rel=1e-2)
    assert f"{100 * (changed / paper - 1):.1f}" == "0.4"


def test_kirchhoff_tends_to_fresnel_with_the_square_of_a_stigmatic_aperture():
    """The cosine and 1/r leave (R/b)²/2 of the peak: order 2; a parabolic lens adds aberration, order 8 in R."""
    f_numbers = np.asarray([30.0, 42.0, 60.0, 85.0, 120.0])
    gap = [peak("fresnel", n, "stigmatic") / peak("kirchhoff", n, "stigmatic") - 1 for n in f_numbers]
    slope = np.polyfit(np.log(1 / f_numbers), np.log(gap), 1)[0]
    assert slope == pytest.approx(2.0, abs=0.02)
    wide = np.asarray([6.0, 6.6, 7.3, 8.0])
    aberration = [peak("kirchhoff", n, "stigmatic") / peak("kirchhoff", n, "parabolic") - 1 for n in wide]
    assert np.polyfit(np.log(1 / wide), np.log(aberration), 1)[0] == pytest.approx(8.0, abs=0.3)


def test_light_tends_to_rays_with_the_root_of_the_wavelength():
    """Inside the shadow's edge the boundary wave is what is left; its amplitude falls as √λ."""
    lens = CircularLens(radius=56.8e-6, focal_length=0.432e-3, lens_phase="perfect")
    source = PointSource(distance=13.64e-3)
    ring = disc_nodes(radius=6e-6, radial_count=6, angular_count=1)
    radius = np.concatenate([ring.x, [7e-6, 8e-6, 9e-6]])
    targets = TargetPoints(x=radius[radius > 2.5e-6], y=0.0, distance=0.6e-3)
    wavelengths = 600e-9 / 2.0 ** np.arange(0, 5)
    gap = []
    for base in wavelengths:
        squares = []
        for wavelength in base * np.linspace(0.9, 1.1, 5):  # averages the interference of the two edge rays
            wave, ray = (
                run(m, targets, source=source, lens=lens, wavelength=wavelength, tolerance=1e-6)
                for m in ("kirchhoff", "geometric")
            )
            squares.append(np.mean(np.abs(wave.field / ray.field - 1) ** 2))
        gap.append(math.sqrt(np.mean(squares)))
    slope = np.polyfit(np.log(wavelengths), np.log(gap), 1)[0]
    assert gap[-1] < 0.2
    assert slope == pytest.approx(0.5, abs=0.08)

"""The parts of the chain, each against something it does not contain."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
from scipy.special import j1

from tradestudy.errors import OutOfRangeError, UnaffordableError
from tradestudy.optics.chain.accuracy import ChainAccuracy, integrate_pixels
from tradestudy.optics.chain.array_field import PupilWave, direct_field, fast_phase, field_table, leg_kernel
from tradestudy.optics.chain.arriving_light import field_spacing, ray_reach, table_reader, table_tolerance
from tradestudy.optics.chain.detector_transfer import (
    PatchPlan,
    choose_transfer,
    detector_field,
    fresnel_reach,
    patch_fields,
    patch_law,
    response,
)
from tradestudy.optics.chain.microlens_nodes import cell_node_count, cell_nodes
from tradestudy.optics.chain.point_image import plan_point
from tradestudy.optics.chain.scene import LightPath, Microlenses, PixelGrid, hexagonal_centres, square_centres
from tradestudy.optics.propagation.kernels import ApertureSamples, direct_sum
from tradestudy.optics.propagation.lens import CircularLens, PointSource
from tradestudy.optics.quadrature import disc_nodes

WAVELENGTH = 550e-9
PITCH = 26e-6


def microlenses(**changes: object) -> Microlenses:
    settings: dict[str, object] = {
        "centres": square_centres(pitch=PITCH, count=3),
        "focal_lengths": np.full(9, 76e-6),
        "aperture": "circular",
        "aperture_width": 24e-6,
        "pitch": PITCH,
        "layout": "square",
        "gaps": "opaque",
        "lens_phase": "parabolic",
    }
    return Microlenses(**(settings | changes))


def small_path(**changes: object) -> LightPath:
    settings: dict[str, object] = {
        "main_lens": CircularLens(radius=0.15e-3, focal_length=2e-3, lens_phase="parabolic"),
        "microlenses": microlenses(),
        "array_distance": 2.5e-3,
        "detector_distance": 0.1e-3,
        "pixels": PixelGrid(pitch=4e-6, shape=(15, 17)),
    }
    return LightPath(**(settings | changes))


def plane_wave_integral_of_polygon(corners: np.ndarray, f: tuple[float, float]) -> complex:
    """∬ exp(2πi f·x) over a polygon by Gauss's theorem, edge by edge."""
    total = 0j
    k = 2 * np.pi * np.asarray(f)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        edge, middle = b - a, (a + b) / 2
        normal = np.array([edge[1], -edge[0]])
        total += (k @ normal) * np.exp(1j * k @ middle) * np.sinc(k @ edge / (2 * np.pi))
    return complex(total / (1j * (k @ k)))


@pytest.mark.parametrize("f", [(1.3e5, 0.4e5), (0.0, 3e5), (-2e5, 2.1e5)])
def test_nodes_integrate_plane_waves_over_apertures(f: tuple[float, float]) -> None:
    cycles = 12e-6 * math.hypot(*f)
    disc = cell_nodes(microlenses(), cycles=cycles)
    z = 2 * np.pi * cycles
    value = disc.weights @ np.exp(2j * np.pi * (f[0] * disc.x + f[1] * disc.y))
    assert value == pytest.approx(np.pi * 12e-6**2 * 2 * j1(z) / z, abs=1e-8 * np.pi * 12e-6**2)
    square = cell_nodes(microlenses(aperture="square"), cycles=cycles)
    value = square.weights @ np.exp(2j * np.pi * (f[0] * square.x + f[1] * square.y))
    truth = 24e-6**2 * np.sinc(24e-6 * f[0]) * np.sinc(24e-6 * f[1])
    assert value == pytest.approx(truth, abs=1e-8 * 24e-6**2)


@pytest.mark.parametrize(("aperture", "width"), [("circular", 22e-6), ("square", 18e-6)])
@pytest.mark.parametrize("layout", ["square", "hexagonal"])
def test_aperture_and_clear_gap_fill_the_cell(aperture: str, width: float, layout: str) -> None:
    centres = np.zeros((1, 2))
    lenses = microlenses(
        centres=centres,
        focal_lengths=np.ones(1),
        aperture=aperture,
        aperture_width=width,
        layout=layout,
        gaps="clear",
    )
    f = (1.1e5, -0.7e5)
    nodes = cell_nodes(lenses, cycles=width / 2 * math.hypot(*f))
    sides = 4 if layout == "square" else 6
    angles = 2 * np.pi * (np.arange(sides) + 0.5) / sides
    corners = PITCH / 2 / np.cos(np.pi / sides) * np.column_stack([np.cos(angles), np.sin(angles)])
    value = nodes.weights @ np.exp(2j * np.pi * (f[0] * nodes.x + f[1] * nodes.y))
    assert value == pytest.approx(plane_wave_integral_of_polygon(corners, f), abs=1e-8 * PITCH**2)
    area = nodes.weights[nodes.in_lens].sum()
    assert lenses.fill_factor == pytest.approx(area / nodes.weights.sum(), rel=1e-9)


@pytest.mark.parametrize("cycles", [0.4, 3.0, 27.0])
@pytest.mark.parametrize("aperture", ["circular", "square"])
@pytest.mark.parametrize(("layout", "gaps"), [("square", "opaque"), ("square", "clear"), ("hexagonal", "clear")])
def test_nodes_are_counted_as_they_are_placed(cycles: float, aperture: str, layout: str, gaps: str) -> None:
    lenses = microlenses(aperture=aperture, aperture_width=18e-6, layout=layout, gaps=gaps)
    assert cell_node_count(lenses, cycles=cycles) == cell_nodes(lenses, cycles=cycles).x.size


@pytest.mark.parametrize("law", ["fresnel", "kirchhoff"])
def test_a_point_is_refused_where_its_nodes_and_samples_exceed_the_memory(law: str) -> None:
    source = PointSource(x=0.1e-3, y=-0.05e-3, distance=24e-3)
    wave = PupilWave(path=small_path(), source=source, wavelength=WAVELENGTH, method="kirchhoff")
    point = plan_point(wave, law, ChainAccuracy(tolerance=1e-2))
    plan, plane = point.detector, point.plane
    scarce = ChainAccuracy(tolerance=1e-2, memory_limit=0.99 * plan.memory(plane.count))
    with pytest.raises(UnaffordableError, match=f"{plane.count} nodes, {plan.transfer.count}² samples"):
        plan_point(wave, law, scarce)


def test_too_few_nodes_are_wrong() -> None:
    z = 2 * np.pi * 6
    nodes = cell_nodes(microlenses(), cycles=3)
    value = nodes.weights @ np.exp(2j * np.pi * 6 / 12e-6 * nodes.x) / nodes.weights.sum()
    assert abs(value - 2 * j1(z) / z) > 1e-3


def test_main_lens_field_in_focus_is_the_airy_pattern() -> None:
    """Fresnel in the image plane: |U|² = P A/(λ z)² (2 J1(v)/v)², v = π D r/(λ z)."""
    source = PointSource(x=0.1e-3, y=-0.05e-3, distance=24e-3)
    image = 24e-3 * 2e-3 / 22e-3
    wave = PupilWave(path=small_path(array_distance=image), source=source, wavelength=WAVELENGTH, method="fresnel")
    table = field_table(
        wave,
        low=(-15e-6, -10e-6),
        high=(15e-6, 12e-6),
        spacing=0.7e-6,
        node_density=1.0,
        tolerance=1e-8,
        memory_limit=2e9,
    )
    chief = wave.path.chief_point(source)
    rng = np.random.default_rng(1)
    x, y = rng.uniform(-10e-6, 10e-6, (2, 50))
    value = np.abs(table_reader(wave, table)(chief[0] + x, chief[1] + y)) ** 2
    v = 2 * np.pi * 0.15e-3 * np.hypot(x, y) / (WAVELENGTH * image)
    peak = wave.power() * np.pi * 0.15e-3**2 / (WAVELENGTH * image) ** 2
    np.testing.assert_allclose(value, peak * (2 * j1(v) / v) ** 2, atol=2e-4 * peak)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3, 1e-4, 1e-5, 1e-6])
def test_main_lens_field_agrees_with_direct_quadrature_on_just_enough_samples(tolerance: float) -> None:
    wave = PupilWave(
        path=small_path(),
        source=PointSource(x=0.3e-3, y=0.1e-3, distance=24e-3),
        wavelength=WAVELENGTH,
        method="kirchhoff",
    )
    accuracy = ChainAccuracy(tolerance=tolerance)
    chief = np.array(wave.path.chief_point(wave.source))
    rng = np.random.default_rng(2)
    at = chief + rng.uniform(-25e-6, 25e-6, (60, 2))
    at[:20, 0] = chief[0] + 25e-6  # where the end of the table matters most
    truth = direct_field(wave, at[:, 0], at[:, 1])
    enough = field_spacing(wave, accuracy)
    errors = []
    for spacing in (enough, 3 * enough):
        table = field_table(
            wave,
            low=(-25e-6, -25e-6),
            high=(25e-6, 25e-6),
            spacing=spacing,
            node_density=1.0,
            tolerance=table_tolerance(accuracy),
            memory_limit=2e9,
        )
        value = table_reader(wave, table)(at[:, 0], at[:, 1])
        errors.append(float(np.linalg.norm(value - truth) / np.linalg.norm(truth)))
    assert errors[0] < tolerance
    assert errors[1] > 0.1  # beyond Nyquist's limit


def test_without_its_fast_phase_the_field_holds_no_steeper_waves_than_from_the_rim() -> None:
    wave = PupilWave(
        path=small_path(), source=PointSource(x=0.3e-3, distance=24e-3), wavelength=WAVELENGTH, method="kirchhoff"
    )
    chief = wave.path.chief_point(wave.source)
    x = chief[0] + np.linspace(-60e-6, 60e-6, 481)
    field = direct_field(wave, x, np.full_like(x, chief[1]))
    slow = field * np.exp(-1j * fast_phase(wave, x, np.full_like(x, chief[1])))
    steeper = np.abs(np.fft.fftfreq(x.size, x[1] - x[0])) > 1.15 * 0.15e-3 / (wave.path.array_distance * WAVELENGTH)
    shares = []
    for one in (field, slow):
        power = np.abs(np.fft.fft(one * np.blackman(x.size))) ** 2
        shares.append(float(power[steeper].sum() / power.sum()))
    assert shares[1] < 1e-6 < 1e-3 < shares[0]


def test_too_much_memory_is_refused_with_the_setting_to_change() -> None:
    wave = PupilWave(path=small_path(), source=PointSource(distance=24e-3), wavelength=WAVELENGTH, method="fresnel")
    with pytest.raises(UnaffordableError, match="field sampling"):
        field_table(
            wave,
            low=(-1e-3, -1e-3),
            high=(1e-3, 1e-3),
            spacing=0.1e-6,
            node_density=1.0,
            tolerance=1e-4,
            memory_limit=1e8,
        )


@pytest.mark.parametrize("paraxial", [False, True])
def test_transfer_is_the_plain_sum_of_kernels(paraxial: bool) -> None:
    """A handful of point sources on the array, at 30 digits: exp(iks) z/(iλ s²), or its parabola."""
    rng = np.random.default_rng(3)
    x, y = rng.uniform(-12e-6, 12e-6, (2, 6))
    strengths = rng.normal(size=6) + 1j * rng.normal(size=6)
    distance = 0.1e-3
    transfer = choose_transfer(
        wavelength=WAVELENGTH,
        distance=distance,
        paraxial=paraxial,
        node_reach=12e-6,
        target_reach=10e-6,
        kept_reach=120e-6,
        spacing=0.15e-6,
    )
    field = detector_field(
        response(transfer),
        x=x,
        y=y,
        strengths=strengths,
        start=np.array([-10e-6, -9e-6]),
        shape=(121, 134),
        tolerance=1e-9,
    )
    with mpmath.workdps(30):
        k = 2 * mpmath.pi / mpmath.mpf(WAVELENGTH)
        for row, column in ((0, 0), (60, 70), (117, 11)):
            px, py, z = mpmath.mpf(-10e-6 + 0.15e-6 * column), mpmath.mpf(-9e-6 + 0.15e-6 * row), mpmath.mpf(distance)
            total = mpmath.mpc(0)
            for qx, qy, c in zip(x, y, strengths, strict=True):
                rho2 = (px - mpmath.mpf(qx)) ** 2 + (py - mpmath.mpf(qy)) ** 2
                if paraxial:
                    kernel = mpmath.exp(1j * k * rho2 / (2 * z)) / (1j * mpmath.mpf(WAVELENGTH) * z)
                else:
                    s = mpmath.sqrt(rho2 + z**2)
                    kernel = mpmath.exp(1j * k * (s - z)) * z / (1j * mpmath.mpf(WAVELENGTH) * s**2)
                total += mpmath.mpc(c) * kernel
            assert field[row, column] == pytest.approx(complex(total), abs=1e-3 / (WAVELENGTH * distance))


def test_too_coarse_samples_are_refused() -> None:
    with pytest.raises(OutOfRangeError, match="more samples"):
        choose_transfer(
            wavelength=WAVELENGTH,
            distance=0.1e-3,
            paraxial=False,
            node_reach=8e-6,
            target_reach=40e-6,
            kept_reach=80e-6,
            spacing=0.5e-6,
        )


def test_the_law_of_a_patch_keeps_to_the_memory_limit() -> None:
    """The limit is the size of the table that NumPy reports: one byte less refuses it, with the remedy."""
    leg = {"wavelength": WAVELENGTH, "distance": 0.3e-3}
    reach = fresnel_reach(**leg, half_side=30e-6, node_reach=36e-6, farthest=0.0, tolerance=1e-4)
    plan = PatchPlan(**leg, spacing=1e-6, half=30, reach=reach, farthest=0.0)
    ratio = patch_law(plan, memory_limit=2e9).ratio
    assert ratio is not None
    with pytest.raises(UnaffordableError, match="memory limit"):
        patch_law(plan, memory_limit=ratio.nbytes - 1)
    assert patch_law(plan, memory_limit=1.1 * ratio.nbytes).ratio is not None


@pytest.mark.parametrize("middle", [(0.0, 0.0), (90e-6, -50e-6), (200e-6, 160e-6)])
@pytest.mark.parametrize("paraxial", [False, True])
def test_field_on_a_patch_is_the_sum_over_the_nodes(paraxial: bool, middle: tuple[float, float]) -> None:
    """A lens of f/4, up to 40° beside its patch, against the plain sum of its nodes on samples all over the patch."""
    rng = np.random.default_rng(4)
    distance, radius, half_side, tolerance = 0.3e-3, 36e-6, 30e-6, 1e-4
    nodes = disc_nodes(radius=radius, radial_count=120, angular_count=450)
    sine = np.array(middle) if paraxial else np.array(middle) / math.hypot(1, math.hypot(*middle) / distance)
    k = 2 * np.pi / WAVELENGTH
    towards = k * (nodes.x * sine[0] + nodes.y * sine[1]) / distance - k * (nodes.x**2 + nodes.y**2) / 1e-3
    field = np.exp(1j * towards)
    leg = {"wavelength": WAVELENGTH, "distance": distance}
    farthest = math.hypot(*middle)
    reach = fresnel_reach(**leg, half_side=half_side, node_reach=radius, farthest=farthest, tolerance=tolerance)
    spacing = 0.49 / reach.band(radius, **leg)
    plan = PatchPlan(
        **leg,
        spacing=spacing,
        half=math.ceil(half_side / spacing),
        reach=None if paraxial else reach,
        farthest=farthest,
    )
    strengths = np.stack([field * nodes.weights, 2j * field * nodes.weights])
    middles = np.array([middle, middle])
    fields = patch_fields(
        patch_law(plan, memory_limit=2e9),
        x=nodes.x,
        y=nodes.y,
        strengths=strengths,
        middles=middles,
        tolerance=tolerance / 20,
    )
    rows, columns = rng.integers(0, plan.side, (2, 60))
    at = np.array(middle) + spacing * (np.column_stack([columns, rows]) - plan.half)
    kernel = leg_kernel(WAVELENGTH, paraxial)
    z = np.full(60, distance)
    truth = direct_sum(ApertureSamples(nodes=nodes, field=field), kernel, at[:, 0], at[:, 1], z)
    truth *= np.exp(-1j * k * distance)
    error = np.linalg.norm(fields[0][rows, columns] - truth) / np.linalg.norm(truth)
    assert error < 3 * tolerance
    np.testing.assert_allclose(fields[1], 2j * fields[0], atol=1e-4 * np.abs(fields).max())


def test_pixel_integration_of_a_fringe() -> None:
    """∬ (1 + cos(2π f x) cos(2π g y)) over a pixel has a closed form; the correction is of sixth order."""
    pitch, shape = 5e-6, (3, 4)
    f, g = 1.3e5, 0.9e5
    errors = []
    for count in (4, 8):
        h = pitch / count
        x = h * (np.arange(shape[1] * count + 6) - 2.5)
        y = h * (np.arange(shape[0] * count + 6) - 2.5)
        samples = 1 + np.outer(np.cos(2 * np.pi * g * y), np.cos(2 * np.pi * f * x))
        value, stated = integrate_pixels(samples, per_pixel=count, spacing=h)
        edge_x, edge_y = pitch * np.arange(5), pitch * np.arange(4)
        along_x = np.diff(np.sin(2 * np.pi * f * edge_x)) / (2 * np.pi * f)
        along_y = np.diff(np.sin(2 * np.pi * g * edge_y)) / (2 * np.pi * g)
        truth = pitch**2 + np.outer(along_y, along_x)
        errors.append(np.linalg.norm(value - truth) / np.linalg.norm(truth))
        assert errors[-1] < stated
    assert 7 < math.log2(errors[0] / errors[1]) < 9.5


def test_rays_find_the_image_of_eq_4() -> None:
    """σ = (x_off − x') b_L/a_L from the centre of each microlens, in focus."""
    depth, gap = 2.5e-3 - 24e-3 * 2e-3 / 22e-3, 0.1e-3
    focal = 1 / (1 / depth + 1 / gap)
    path = small_path(microlenses=microlenses(focal_lengths=np.full(9, focal)))
    source = PointSource(x=0.02e-3, y=0.01e-3, distance=24e-3)
    reach = ray_reach(path, source)
    image = np.array(path.image_at_array(source)[:2])
    local = (path.microlenses.centres - image) * gap / depth
    lit = np.linalg.norm(path.microlenses.centres - path.chief_point(source), axis=1) < 10e-6
    assert lit.any()
    np.testing.assert_allclose(reach.image[lit], (path.microlenses.centres + local)[lit], atol=1e-12)
    assert np.all(reach.spread[lit] < 1e-12)


@pytest.mark.parametrize("in_focus", [False, True])
def test_rays_through_clear_gaps_keep_their_direction(in_focus: bool) -> None:
    """Strong lenses bend their rim's rays; beside them a ray of the pupil's centre travels straight on."""
    lenses = microlenses(gaps="clear", focal_lengths=np.full(9, 1.0))
    strong = microlenses(gaps="clear", focal_lengths=np.full(9, 20e-6))
    array = 24e-3 * 2e-3 / 22e-3 if in_focus else 2.5e-3
    source = PointSource(distance=24e-3)
    straight, bent = (ray_reach(small_path(microlenses=one, array_distance=array), source) for one in (lenses, strong))
    # without power: landing = x (1 + b/z) − u b/z, so every ray moves by at most (|x| + R) b/z
    farthest = np.linalg.norm(lenses.centres, axis=1) + PITCH / math.sqrt(2)
    assert np.all(straight.travel <= (farthest + 0.15e-3) * 0.1e-3 / array * (1 + 1e-9))
    np.testing.assert_allclose(straight.image, bent.image, atol=1e-12)
    # a rim ray of the strong lens is bent by (w/2) b/f more
    assert np.all(np.abs(bent.travel - 12e-6 * 0.1e-3 / 20e-6) <= straight.travel + 1e-12)


@pytest.mark.parametrize(
    "changes",
    [
        {"aperture_width": 27e-6},
        {"aperture": "hexagonal"},
        {"gaps": "grey"},
        {"focal_lengths": np.ones(8)},
        {"centres": square_centres(pitch=20e-6, count=3)},
        {"layout": "hexagonal", "aperture": "square", "centres": hexagonal_centres(pitch=PITCH, rings=1)[:9]},
        {"focal_lengths": np.zeros(9)},
    ],
)
def test_impossible_microlenses_are_refused(changes: dict[str, object]) -> None:
    with pytest.raises(OutOfRangeError):
        microlenses(**changes)


def test_impossible_paths_are_refused() -> None:
    for changes in ({"array_distance": 0.0}, {"detector_distance": -1.0}):
        with pytest.raises(OutOfRangeError):
            small_path(**changes)
    with pytest.raises(OutOfRangeError):
        PixelGrid(pitch=0.0, shape=(3, 3))


def test_hexagonal_lattice_has_six_nearest_neighbours_at_the_pitch() -> None:
    centres = hexagonal_centres(pitch=PITCH, rings=2)
    assert centres.shape == (19, 2)
    distance = np.sort(np.linalg.norm(centres, axis=1))
    np.testing.assert_allclose(distance[1:7], PITCH)
    assert distance[7] > 1.7 * PITCH

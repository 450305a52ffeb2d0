"""Rays on one leg and waves on the other, against integrals written here, other programs, and their limits."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from tests.optics.small_chain import PITCH, ROW, WAVELENGTH, camera, relative
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.chain.accuracy import ChainAccuracy, ChainImage
from tradestudy.optics.chain.image import chain_image, separate_image
from tradestudy.optics.chain.microlens_nodes import Disc, cell_nodes, lit_nodes
from tradestudy.optics.chain.scene import FRESNEL, GEOMETRIC, Legs, LightPath, Microlenses, PixelGrid, hexagonal_centres
from tradestudy.optics.chain.sources import DiscSource, moved, moved_image
from tradestudy.optics.propagation.aperture import aperture_field
from tradestudy.optics.propagation.lens import CircularLens, PointSource
from tradestudy.optics.propagation.targets import TargetPoints
from tradestudy.optics.propagation.wave_optics import FieldAccuracy

IMAGE = 24e-3 * 2e-3 / 22e-3  # thin lens, of every source below
FAST = ChainAccuracy(tolerance=1e-3)
RAYS_KIRCHHOFF = Legs(to_array="geometric", to_detector="kirchhoff")
RAYS_FRESNEL = Legs(to_array="geometric", to_detector="fresnel")
KIRCHHOFF_RAYS = Legs(to_array="kirchhoff", to_detector="geometric")
FRESNEL_RAYS = Legs(to_array="fresnel", to_detector="geometric")
MIXED = (RAYS_KIRCHHOFF, RAYS_FRESNEL, KIRCHHOFF_RAYS, FRESNEL_RAYS)
ON, OFF = PointSource(distance=24e-3), PointSource(x=0.13e-3, y=-0.06e-3, distance=24e-3)


def image(path: LightPath, source: PointSource | DiscSource, legs: Legs, **settings: object) -> ChainImage:
    values = {"wavelength": WAVELENGTH, "accuracy": FAST, "rng": np.random.default_rng(7)} | settings
    return chain_image(path, source, legs=legs, **values)


def propagated(method: str, dx: np.ndarray, dy: np.ndarray, z: float) -> np.ndarray:
    """Equations 10 and 18 with every constant phase."""
    k, rho2 = 2 * np.pi / WAVELENGTH, dx**2 + dy**2
    if method == "fresnel":
        return np.exp(1j * k * (z + rho2 / (2 * z))) / (1j * WAVELENGTH * z)
    s = np.sqrt(rho2 + z**2)
    return np.exp(1j * k * s) * z / (1j * WAVELENGTH * s**2)


def lit_polar(half: float, towards: complex, radius: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rings about the centre of an aperture, each only as far round as it lies inside a disc about `towards`."""
    apart = abs(towards)
    stops = sorted({0.0, half, *(r for r in (abs(radius - apart),) if r < half)})
    x, y, w = [], [], []
    t, g = np.polynomial.legendre.leggauss(60)
    for start, stop in pairwise(stops):
        bent = np.pi / 2 * t
        for r, wr in zip((start + stop) / 2 + (stop - start) / 2 * np.sin(bent),
                         g * np.pi / 2 * np.cos(bent) * (stop - start) / 2, strict=True):  # fmt: skip
            cosine = (r**2 + apart**2 - radius**2) / (2 * r * apart)
            if cosine < 1:
                widest = math.acos(max(cosine, -1.0))
                angle = np.angle(towards) + widest * t
                x.append(r * np.cos(angle))
                y.append(r * np.sin(angle))
                w.append(wr * r * widest * g)
    return tuple(np.concatenate(part) if part else np.empty(0) for part in (x, y, w))


def brute_pixels(path: LightPath, source: PointSource, method: str, pixels: list[tuple[int, int]]) -> np.ndarray:
    """The sphere about the main image, cut by the shadow of the pupil, through each microlens on to pixels."""
    depth, k = path.array_distance - IMAGE, 2 * np.pi / WAVELENGTH
    image_x, image_y = (-IMAGE / 24e-3 * c for c in (source.x, source.y))
    chief = -path.array_distance / 24e-3 * complex(source.x, source.y)
    shadow = path.main_lens.radius * abs(depth) / IMAGE
    t, g = np.polynomial.legendre.leggauss(7)
    h = path.pixels.pitch
    at = [(path.pixels.edges_x[j] + h * (1 + a) / 2, path.pixels.edges_y[i] + h * (1 + b) / 2)
          for i, j in pixels for a in t for b in t]  # fmt: skip
    sx, sy = np.array(at).T
    field = np.zeros(sx.size, dtype=complex)
    lenses = path.microlenses
    for (cx, cy), f in zip(lenses.centres, lenses.focal_lengths, strict=True):
        q, p, w = lit_polar(lenses.aperture_width / 2, chief - complex(cx, cy), shadow)
        rho2 = (cx + q - image_x) ** 2 + (cy + p - image_y) ** 2
        away = rho2 / (2 * depth) if method == "fresnel" else math.copysign(1, depth) * np.sqrt(depth**2 + rho2)
        left = w * np.exp(1j * k * (away - (q**2 + p**2) / (2 * f))) / (math.sqrt(np.pi) * shadow)
        field += propagated(method, sx[:, None] - cx - q, sy[:, None] - cy - p, path.detector_distance) @ left
    weights = np.outer(g, g).ravel() * h**2 / 4
    return np.abs(field.reshape(len(pixels), -1)) ** 2 @ weights


@pytest.mark.parametrize("method", ["fresnel", "kirchhoff"])
@pytest.mark.parametrize("array_distance", [2.5e-3, 1.9e-3])
def test_rays_then_waves_are_the_integral_over_what_the_pupil_lights(method: str, array_distance: float) -> None:
    path = camera(array_distance=array_distance)
    legs = Legs(to_array="geometric", to_detector=method)
    done = image(path, OFF, legs, accuracy=ChainAccuracy(tolerance=1e-4))
    order = np.argsort(done.pixels.ravel())[::-1][[0, 3, 12, done.pixels.size // 3]]
    pixels = [(int(i), int(j)) for i, j in zip(*np.unravel_index(order, done.pixels.shape), strict=True)]
    truth = brute_pixels(path, OFF, method, pixels)
    assert relative(np.array([done.pixels[at] for at in pixels]), truth) < 2e-4
    assert done.numerical_error < 5e-4


def test_a_fully_lit_microlens_is_a_lens_that_the_main_image_lights() -> None:
    """Another program of the package: Kirchhoff through one aperture; it dims the wave by 1/r, here by 0.14 %."""
    path = camera(
        centres=np.zeros((1, 2)),
        focal_lengths=np.full(1, 76e-6),
        pixels=PixelGrid(pitch=2e-6, shape=(11, 11), integrated=False),
    )
    depth = path.array_distance - IMAGE
    done = image(path, ON, RAYS_KIRCHHOFF, accuracy=ChainAccuracy(tolerance=1e-4))
    x, y = (c.ravel() for c in np.meshgrid(2e-6 * (np.arange(11) - 5), 2e-6 * (np.arange(11) - 5)))
    alone = aperture_field(
        source=PointSource(distance=depth),
        lens=CircularLens(radius=12e-6, focal_length=76e-6, lens_phase="parabolic"),
        targets=TargetPoints(x=x, y=y, distance=1e-4),
        wavelength=WAVELENGTH,
        method="kirchhoff",
        accuracy=FieldAccuracy(tolerance=1e-6),
    )
    shadow = 0.1e-3 * depth / IMAGE
    truth = alone.intensity * (WAVELENGTH * depth) ** 2 / (np.pi * shadow**2) * 4e-12
    assert relative(done.pixels.ravel(), truth) < 2e-3
    # The overlap of two discs in closed form is all of the smaller one.
    assert done.microlens_share == pytest.approx((12e-6 / shadow) ** 2, rel=1e-9)


def overlap(r: float, s: float, d: float) -> float:
    """Area common to two discs."""
    a, b = (d**2 + r**2 - s**2) / (2 * d * r), (d**2 + s**2 - r**2) / (2 * d * s)
    root = math.sqrt((-d + r + s) * (d + r - s) * (d - r + s) * (d + r + s))
    return r**2 * math.acos(a) + s**2 * math.acos(b) - root / 2


@pytest.mark.parametrize(("x", "y", "radius"), [(14e-6, -9e-6, 11e-6), (-30e-6, 50e-6, 55e-6), (2e-6, 1e-6, 10.5e-6)])
def test_nodes_on_the_lit_part_of_a_lens(x: float, y: float, radius: float) -> None:
    lenses = camera().microlenses
    nodes = lit_nodes(lenses, Disc(x=x, y=y, radius=radius), cycles=1.0)
    assert nodes.weights.sum() == pytest.approx(overlap(12e-6, radius, math.hypot(x, y)), rel=1e-7)
    assert np.all(np.hypot(nodes.x, nodes.y) <= 12e-6 * (1 + 1e-9))
    assert np.all(np.hypot(nodes.x - x, nodes.y - y) <= radius * (1 + 1e-9))


@pytest.mark.parametrize("layout", ["square", "hexagonal"])
@pytest.mark.parametrize(("aperture", "width"), [("circular", 24e-6), ("square", 17e-6)])
def test_nodes_on_the_lit_part_of_a_clear_cell(layout: str, aperture: str, width: float) -> None:
    """A shadow and its complement: the plane wave over what is lit and over what is not add up to the whole cell.

    A straight edge x cos a + y sin a < c is a disc of 1 m, which bends it by 1e-10 m.
    """
    lenses = camera(centres=np.zeros((1, 2)), focal_lengths=np.ones(1), aperture=aperture, aperture_width=width,
                    layout=layout, gaps="clear").microlenses  # fmt: skip
    f = np.array([1.1e5, -0.7e5])
    cycles = width / 2 * float(np.hypot(*f))
    whole = cell_nodes(lenses, cycles=cycles)
    for angle, c in ((0.4, 3e-6), (2.0, -7e-6)):
        normal = np.array([math.cos(angle), math.sin(angle)])
        sides = [
            lit_nodes(lenses, Disc(x=s * (1 + s * c) * normal[0], y=s * (1 + s * c) * normal[1], radius=1.0),
                      cycles=cycles) for s in (1, -1)
        ]  # fmt: skip
        for inside in (True, False):
            parts, truth = (
                sum(n.weights[n.in_lens == inside] @ np.exp(2j * np.pi * (f[0] * n.x + f[1] * n.y)[n.in_lens == inside])
                    for n in several)
                for several in (sides, [whole])
            )  # fmt: skip
            assert parts == pytest.approx(truth, abs=2e-5 * PITCH**2)
        for side, n in zip((1, -1), sides, strict=True):
            assert side * (n.x * normal[0] + n.y * normal[1] - c) @ n.weights > 0


def landing_rectangle(path: LightPath, source: PointSource, lens: int, i: int, j: int) -> tuple[np.ndarray, np.ndarray]:
    """Corners on the array whose rays, traced one by one, land on the corners of a pixel."""
    centre, f = path.microlenses.centres[lens], path.microlenses.focal_lengths[lens]
    main_image = np.array([source.x, source.y]) * -IMAGE / 24e-3

    def lands(x: np.ndarray) -> np.ndarray:
        slope = (x - main_image) / (path.array_distance - IMAGE) - (x - centre) / f
        return x + path.detector_distance * slope

    start, step = lands(centre), (lands(centre + 1e-6) - lands(centre)) / 1e-6
    edges = np.array([[path.pixels.edges_x[j + n], path.pixels.edges_y[i + n]] for n in (0, 1)])
    return np.sort(centre + (edges - start) / step, axis=0)


@pytest.mark.parametrize("method", ["fresnel", "kirchhoff"])
@pytest.mark.parametrize("focal_length", [50e-6, 0.2e-3])
def test_waves_then_rays_land_the_irradiance_of_the_array(method: str, focal_length: float) -> None:
    """A pixel inside the blur of one lens holds |U|² over the rectangle that its corners' rays come from."""
    path = camera(centres=np.zeros((1, 2)), focal_lengths=np.full(1, focal_length),
                  pixels=PixelGrid(pitch=2e-6, shape=(15, 15)))  # fmt: skip
    source = PointSource(x=0.05e-3, y=-0.02e-3, distance=24e-3)
    done = image(path, source, Legs(to_array=method, to_detector="geometric"), accuracy=ChainAccuracy(tolerance=1e-4))
    t, g = np.polynomial.legendre.leggauss(90)
    radius, angle = 0.1e-3 * np.sqrt((1 + t) / 2), 2 * np.pi * np.arange(90) / 90
    u, v = np.outer(radius, np.cos(angle)).ravel(), np.outer(radius, np.sin(angle)).ravel()
    w = np.repeat(g, 90) * np.pi * 0.1e-3**2 / 180
    before = w * propagated(method, u - source.x, v - source.y, 24e-3)
    power = np.sum(np.abs(before) ** 2 / w)
    behind = before * np.exp(-2j * np.pi / WAVELENGTH * (u**2 + v**2) / (2 * 2e-3))
    checked = 0
    s, h = np.polynomial.legendre.leggauss(6)
    for i, j in ((7, 7), (6, 8), (8, 6), (7, 5)):
        low, high = landing_rectangle(path, source, 0, i, j)
        if np.hypot(*np.maximum(np.abs(low), np.abs(high))) > 12e-6:
            continue
        x, y = (c.ravel() for c in np.meshgrid(*(a + (b - a) * (1 + s) / 2 for a, b in zip(low, high, strict=True))))
        field = propagated(method, x[:, None] - u, y[:, None] - v, 2.5e-3) @ behind
        truth = np.outer(h, h).ravel() @ np.abs(field) ** 2 * np.prod(high - low) / 4 / power
        assert done.pixels[i, j] == pytest.approx(truth, rel=1e-3)
        checked += 1
    assert checked >= 2


@pytest.mark.parametrize("legs", [RAYS_FRESNEL, FRESNEL_RAYS])
@pytest.mark.parametrize("array_distance", [2.5e-3, 1.9e-3])
def test_energy_is_kept(legs: Legs, array_distance: float) -> None:
    path = camera(array_distance=array_distance, pixels=PixelGrid(pitch=6e-6, shape=(25, 35)))
    done = image(path, OFF, legs)
    if legs.to_detector == "geometric":  # no light is diffracted beside the detector
        assert done.pixels.sum() == pytest.approx(done.microlens_share, rel=1e-12)
        assert done.microlens_share == pytest.approx(image(path, OFF, FRESNEL).microlens_share, rel=1e-3)
    else:
        assert 0.98 * done.microlens_share < done.pixels.sum() < done.microlens_share
        assert done.microlens_share == pytest.approx(image(path, OFF, GEOMETRIC).pixels.sum(), rel=1e-4)


@pytest.mark.parametrize(
    ("legs", "limit"), [(RAYS_FRESNEL, FRESNEL), (RAYS_FRESNEL, GEOMETRIC), (FRESNEL_RAYS, GEOMETRIC)]
)
def test_mixtures_approach_rays_and_waves_as_the_wavelength_shrinks(legs: Legs, limit: Legs) -> None:
    """Edges blur by √λ, so that the L1 difference falls about as fast."""
    path = camera(focal_lengths=np.full(3, 50e-6), array_distance=2.7e-3)
    differences = []
    for wavelength in (800e-9, 200e-9):
        settings = {"wavelength": wavelength, "accuracy": ChainAccuracy(tolerance=1e-2)}
        value, truth = (image(path, ON, each, **settings).pixels for each in (legs, limit))
        differences.append(float(np.abs(value - truth).sum() / truth.sum()))
    assert math.log(differences[0] / differences[1], 4) == pytest.approx(0.6, abs=0.25)
    assert differences[1] < 0.3


@pytest.mark.parametrize("legs", MIXED)
@pytest.mark.parametrize("symmetry", [(-1, 1, False), (1, 1, True)])
def test_moving_the_scene_moves_the_image(legs: Legs, symmetry: tuple[int, int, bool]) -> None:
    """Mirrors and turns of everything: no pixel is mirrored or shifted by the code itself."""
    centres, middle = PITCH * np.array([[0.0, 0.0], [-1.0, 0.3]]), np.array([-8e-6, 4e-6])

    def turned(one: tuple[int, int, bool]) -> ChainImage:
        path = camera(centres=moved(centres, one), focal_lengths=np.array([60e-6, 110e-6]),
                      pixels=PixelGrid(pitch=4e-6, shape=(15, 15), centre=tuple(moved(middle, one))))  # fmt: skip
        x, y = moved(np.array([OFF.x, OFF.y]), one)
        return image(path, PointSource(x=float(x), y=float(y), distance=24e-3), legs)

    before, after = turned((1, 1, False)), turned(symmetry)
    difference = relative(after.pixels, moved_image(before.pixels, symmetry))
    assert difference <= before.numerical_error + after.numerical_error + 1e-9 < 5e-3
    assert relative(before.pixels[::-1], before.pixels) > 0.1


@pytest.mark.parametrize("legs", [RAYS_FRESNEL, FRESNEL_RAYS])
def test_what_moves_with_the_chief_ray_stays_the_same(legs: Legs) -> None:
    """To second order a source moved by s moves its light by −s z/a on the array and −s (z + b_L)/a on the detector."""
    shift = np.array([0.09e-3, -0.16e-3])
    still = image(camera(), OFF, legs)
    away = camera(
        centres=ROW - shift * 2.5e-3 / 24e-3,
        pixels=PixelGrid(pitch=4e-6, shape=(9, 23), centre=tuple(-shift * 2.6e-3 / 24e-3)),
    )
    gone = image(away, PointSource(x=OFF.x + shift[0], y=OFF.y + shift[1], distance=24e-3), legs)
    assert relative(gone.pixels, still.pixels) < still.numerical_error + gone.numerical_error < 5e-3


@pytest.mark.parametrize("legs", MIXED)
def test_stated_error_covers_the_true_one_on_random_cameras(legs: Legs) -> None:
    rng = np.random.default_rng(5)
    ratios = []
    for _ in range(3):
        path = camera(
            array_distance=rng.choice([rng.uniform(1.7e-3, 2.0e-3), rng.uniform(2.4e-3, 2.8e-3)]),
            detector_distance=rng.uniform(0.08e-3, 0.14e-3),
            focal_lengths=rng.uniform(60e-6, 130e-6, 3),
            gaps=rng.choice(["opaque", "clear"]),
        )
        source = PointSource(x=rng.uniform(-0.2e-3, 0.2e-3), y=rng.uniform(-0.1e-3, 0.1e-3), distance=24e-3)
        rough = image(path, source, legs, accuracy=ChainAccuracy(tolerance=1e-2))
        finer = ChainAccuracy(tolerance=2e-5, microlens_nodes=2.0, pupil_nodes=1.5, field_sampling=1.2)
        ratios.append(rough.numerical_error / relative(rough.pixels, image(path, source, legs, accuracy=finer).pixels))
    assert min(ratios) > 0.5
    assert np.count_nonzero(np.array(ratios) > 1) >= 2
    assert np.median(ratios) < 30


def points_mean(path: LightPath, source: DiscSource, legs: Legs) -> np.ndarray:
    """Points on rings of equal area, weighted by nothing else."""
    total = []
    for ring in range(5):
        radius = source.diameter / 2 * math.sqrt((ring + 0.5) / 5)
        for n in range(12):
            angle = 2 * np.pi * (n + 0.37 * ring) / 12
            point = PointSource(x=source.x + radius * math.cos(angle), y=source.y + radius * math.sin(angle),
                                distance=source.distance)  # fmt: skip
            total.append(image(path, point, legs, accuracy=ChainAccuracy(tolerance=3e-2)).pixels)
    return np.mean(total, axis=0)


@pytest.mark.parametrize(
    ("legs", "diameter", "focal_length"),
    [
        (RAYS_FRESNEL, 0.1e-3, 76e-6),
        (FRESNEL_RAYS, 0.1e-3, 50e-6),  # lenses far from focus move the landing farther than the disc …
        (FRESNEL_RAYS, 0.4e-3, 78e-6),  # … and lenses near it less
    ],
)
def test_disc_is_the_mean_of_its_points(legs: Legs, diameter: float, focal_length: float) -> None:
    path = camera(centres=ROW[1:], focal_lengths=np.full(2, focal_length), pixels=PixelGrid(pitch=6e-6, shape=(7, 11)))
    source = DiscSource(diameter=diameter, distance=24e-3, x=-0.05e-3)
    done = image(path, source, legs, accuracy=ChainAccuracy(tolerance=1e-2))
    assert done.numerical_error < 0.03
    # sixty points leave steps of a sixtieth of the light where pixels cut them
    assert relative(done.pixels, points_mean(path, source, legs)) < 0.05


@pytest.mark.parametrize("legs", MIXED)
def test_small_disc_is_a_point(legs: Legs) -> None:
    point = image(camera(), OFF, legs)
    done = image(camera(), DiscSource(diameter=1e-7, x=OFF.x, y=OFF.y, distance=OFF.distance), legs)
    assert relative(done.pixels, point.pixels) < done.numerical_error + point.numerical_error < 0.02


def test_a_disc_in_focus_is_cut_exactly_by_the_pixels() -> None:
    """A microlens in focus images the disc sharply; the share of its area on a pixel says how bright that pixel is.

    The pupil's shadow lights the whole lens from the middle third of the disc, where diffraction leaves ripples of
    a few per cent.
    """
    depth = 2.5e-3 - IMAGE
    path = camera(
        main_lens=CircularLens(radius=0.4e-3, focal_length=2e-3, lens_phase="parabolic"),
        centres=np.zeros((1, 2)),
        focal_lengths=np.full(1, 1 / (1 / depth + 1 / 0.1e-3)),
        pixels=PixelGrid(pitch=4e-6, shape=(5, 5)),
    )
    source = DiscSource(diameter=0.5e-3, distance=24e-3)
    done = image(path, source, FRESNEL_RAYS, accuracy=ChainAccuracy(tolerance=1e-2))
    radius = 0.25e-3 * IMAGE / 24e-3 * 0.1e-3 / depth  # of its image behind the lens: 7.1 µm
    fine = (np.arange(500) - 249.5) / 500 * 20e-6
    inside = np.hypot(fine[:, None], fine) <= radius
    share = inside.reshape(5, 100, 5, 100).mean(axis=(1, 3)) * 16e-12 / (np.pi * radius**2)
    blur = 0.4e-3 * depth / IMAGE
    assert relative(done.pixels, share * (12e-6 / blur) ** 2) < 0.05


@pytest.mark.parametrize("second", ["geometric", "fresnel", "kirchhoff"])
def test_boundary_wave_to_the_array_is_kirchhoffs_within_its_stated_error(second: str) -> None:
    path = camera(main_lens=CircularLens(radius=0.25e-3, focal_length=2e-3, lens_phase="perfect"))
    edge, area = (
        image(path, ON, Legs(to_array=first, to_detector=second), accuracy=ChainAccuracy(tolerance=1e-2))
        for first in ("boundary_wave", "kirchhoff")
    )
    assert relative(edge.pixels, area.pixels) < edge.numerical_error + area.numerical_error < 0.03
    assert 0 <= edge.handed_over < 0.5
    assert area.handed_over == 0


def test_boundary_wave_of_a_disc() -> None:
    path = camera(main_lens=CircularLens(radius=0.25e-3, focal_length=2e-3, lens_phase="perfect"))
    disc = DiscSource(diameter=0.1e-3, distance=24e-3)
    edge, area = (
        image(path, disc, Legs(to_array=first, to_detector="geometric"), accuracy=ChainAccuracy(tolerance=1e-2))
        for first in ("boundary_wave", "kirchhoff")
    )
    assert relative(edge.pixels, area.pixels) < edge.numerical_error + area.numerical_error < 0.03


@pytest.mark.parametrize("second", ["geometric", "kirchhoff"])
@pytest.mark.parametrize("tolerance", [0.1, 1e-2, 1e-5])
def test_what_the_boundary_wave_leaves_out_is_stated_and_not_refused(second: str, tolerance: float) -> None:
    """Aberrations and few Fresnel zones: the leading term is good to a tenth of a per cent, whatever the tolerance."""
    edge, area = (
        image(camera(), OFF, Legs(to_array=first, to_detector=second), accuracy=ChainAccuracy(tolerance=each))
        for first, each in (("boundary_wave", tolerance), ("kirchhoff", min(tolerance, 1e-4)))
    )
    truth = relative(edge.pixels, area.pixels)
    assert truth > max(2e-4, 5 * area.numerical_error)
    assert truth < edge.numerical_error < 5 * truth


@pytest.mark.parametrize("second", ["geometric", "kirchhoff"])
def test_what_the_boundary_wave_of_a_disc_leaves_out_is_stated(second: str) -> None:
    disc = DiscSource(diameter=0.1e-3, distance=24e-3)
    edge, area = (
        image(camera(), disc, Legs(to_array=first, to_detector=second), accuracy=ChainAccuracy(tolerance=1e-3))
        for first in ("boundary_wave", "kirchhoff")
    )
    truth = relative(edge.pixels, area.pixels)
    assert truth > max(2e-4, area.numerical_error)
    assert truth < edge.numerical_error < 5 * truth


@pytest.mark.parametrize("legs", [RAYS_KIRCHHOFF, KIRCHHOFF_RAYS])
def test_microlenses_without_a_main_lens_and_one_in_the_dark(legs: Legs) -> None:
    """Each microlens with its own pixels; the one beyond the shadow of the pupil gives none by rays."""
    path = camera(array_distance=2.35e-3, pixels=PixelGrid(pitch=4e-6, shape=(6, 20)))
    alone = separate_image(path, ON, wavelength=WAVELENGTH, legs=legs, accuracy=FAST, rng=np.random.default_rng(0))
    one = replace(path.microlenses, centres=ROW[1:2], focal_lengths=np.full(1, 76e-6))
    middle = image(replace(path, microlenses=one), ON, legs)
    own = slice(7, 13)
    assert relative(alone.pixels[:, own], middle.pixels[:, own]) < alone.numerical_error + middle.numerical_error + 1e-9
    if legs == RAYS_KIRCHHOFF:
        assert np.all(alone.pixels[:, :6] == 0)
    assert np.isfinite(alone.numerical_error)


def test_squares_of_pixels_without_microlens_light_are_dark_by_rays() -> None:
    """A source whose light misses every lens gives nothing, with no error."""
    away, disc = PointSource(x=1e-3, distance=24e-3), DiscSource(diameter=1e-5, distance=24e-3, x=1e-3)
    for legs in (RAYS_KIRCHHOFF, RAYS_FRESNEL, Legs(to_array="geometric", to_detector="boundary_wave")):
        for source in (away, disc):
            done = image(camera(), source, legs)
            assert not done.pixels.any()
            assert done.numerical_error == 0
        assert image(camera(), away, legs).microlens_share == 0


def test_cases_beyond_rays_are_refused() -> None:
    disc = DiscSource(diameter=1e-4, distance=24e-3, coherent=True)
    for legs in (*MIXED, Legs(to_array="boundary_wave", to_detector="kirchhoff")):
        with pytest.raises(OutOfRangeError, match="coherent"):
            image(camera(), disc, legs)
    in_focus = camera(array_distance=IMAGE + 1e-6)
    for source in (ON, replace(disc, coherent=False)):
        for legs in MIXED:
            with pytest.raises(OutOfRangeError, match="zones"):
                image(in_focus, source, legs)
    centres = camera(pixels=PixelGrid(pitch=4e-6, shape=(9, 23), integrated=False))
    for source in (ON, replace(disc, coherent=False)):
        with pytest.raises(OutOfRangeError, match="whole pixels"):
            image(centres, source, KIRCHHOFF_RAYS)


def test_ripples_of_a_coarse_field_are_stated() -> None:
    """The image lies just behind the array: at 5 % its field is sampled hardly finer than needed."""
    path = LightPath(
        main_lens=CircularLens(
            radius=0.6926e-3, focal_length=6.8169e-3, lens_phase="stigmatic", focus_distance=64.514e-3
        ),
        microlenses=Microlenses(
            centres=hexagonal_centres(pitch=31.62e-6, rings=1),
            focal_lengths=np.array([0.37938e-3, 0.43277e-3, 0.46611e-3])[np.arange(7) % 3],
            aperture="circular",
            aperture_width=28.54e-6,
            pitch=31.62e-6,
            layout="hexagonal",
            gaps="opaque",
            lens_phase="parabolic",
        ),
        array_distance=7.15458e-3,
        detector_distance=0.19031e-3,
        pixels=PixelGrid(pitch=8.4317e-6, shape=(12, 12)),
    )
    source = PointSource(x=-58.22e-6, y=-71.39e-6, distance=73.824e-3)
    found, finest = (
        image(path, source, FRESNEL_RAYS, wavelength=503.7e-9, accuracy=accuracy)
        for accuracy in (
            ChainAccuracy(tolerance=5e-2),
            ChainAccuracy(tolerance=1e-5, pupil_nodes=1.3, microlens_nodes=1.5, field_sampling=1.4),
        )
    )
    assert relative(found.pixels, finest.pixels) < found.numerical_error < 5e-2

"""The whole chain against nested quadrature written here, against rays, and against what must stay the same."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.optics.small_chain import PITCH, WAVELENGTH, camera, relative
from tradestudy.errors import OutOfRangeError, UnaffordableError
from tradestudy.optics.chain.accuracy import ChainAccuracy, ChainImage
from tradestudy.optics.chain.image import chain_image, spectral_image
from tradestudy.optics.chain.scene import (
    FRESNEL,
    GEOMETRIC,
    KIRCHHOFF,
    KIRCHHOFF_FRESNEL,
    Legs,
    LightPath,
    PixelGrid,
    hexagonal_centres,
    square_centres,
)
from tradestudy.optics.chain.sources import DiscSource, moved, moved_image, orbits, source_nodes, symmetries
from tradestudy.optics.propagation.lens import CircularLens, PointSource
from tradestudy.optics.propagation.pupil import Pupil

FAST = ChainAccuracy(tolerance=1e-3)


def image(path: LightPath, source: PointSource | DiscSource, legs: Legs = KIRCHHOFF, **settings: object) -> ChainImage:
    accuracy = settings.pop("accuracy", FAST)
    return chain_image(
        path, source, wavelength=WAVELENGTH, legs=legs, accuracy=accuracy, rng=np.random.default_rng(7), **settings
    )


def kernel(legs_method: str, dx: np.ndarray, dy: np.ndarray, z: float) -> np.ndarray:
    """Equations 10 and 18 without the constant phase."""
    k = 2 * np.pi / WAVELENGTH
    rho2 = dx**2 + dy**2
    if legs_method == "fresnel":
        return np.exp(1j * k * rho2 / (2 * z)) / (1j * WAVELENGTH * z)
    s = np.sqrt(rho2 + z**2)
    return np.exp(1j * k * rho2 / (s + z)) * z / (1j * WAVELENGTH * s**2)


def polar(radius: float, rings: int, angles: int, inner: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gauss–Legendre in the radius itself, not in its square as the code under test has it."""
    t, w = np.polynomial.legendre.leggauss(rings)
    r = inner + (radius - inner) * (t + 1) / 2
    angle = 2 * np.pi * (np.arange(angles) + 0.3) / angles
    weight = np.outer(w * (radius - inner) / 2 * r, np.full(angles, 2 * np.pi / angles))
    return np.outer(r, np.cos(angle)).ravel(), np.outer(r, np.sin(angle)).ravel(), weight.ravel()


def clear(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.ones_like(x)


def nested_pixels(
    path: LightPath,
    source: PointSource,
    legs: Legs,
    pixels: list[tuple[int, int]],
    main: Callable[[np.ndarray, np.ndarray], np.ndarray] = clear,
    micro: Callable[[np.ndarray, np.ndarray], np.ndarray] = clear,
) -> np.ndarray:
    """Equations 14 and 22 as nested sums over pupil, microlenses and pixels; `main` and `micro` are what pupils do.

    More nodes, both ways and on both lenses, change no pixel by more than 3e-5 of the brightest one.
    """
    lenses = path.microlenses
    dark = path.main_lens.pupil.obscuration if path.main_lens.pupil else 0.0
    u, v, w = polar(path.main_lens.radius, 32, 96, dark * path.main_lens.radius)
    k = 2 * np.pi / WAVELENGTH
    before = kernel(legs.to_array, u - source.x, v - source.y, source.distance)
    passed = main(u / path.main_lens.radius, v / path.main_lens.radius)
    pupil_power = np.sum(w * np.abs(before * passed) ** 2)
    behind = w * passed * before * np.exp(-1j * k * (u**2 + v**2) / (2 * path.main_lens.focal_length))
    t, g = np.polynomial.legendre.leggauss(7)
    h = path.pixels.pitch
    at = [
        (path.pixels.edges_x[j] + h * (1 + a) / 2, path.pixels.edges_y[i] + h * (1 + b) / 2)
        for i, j in pixels
        for a in t
        for b in t
    ]
    sx, sy = np.array(at).T
    field = np.zeros(sx.size, dtype=complex)
    for (cx, cy), f in zip(lenses.centres, lenses.focal_lengths, strict=True):
        if lenses.aperture == "circular":
            q, p, a = polar(lenses.aperture_width / 2, 20, 58)
        else:
            n, m = np.polynomial.legendre.leggauss(52)
            q, p = (c.ravel() * lenses.aperture_width / 2 for c in np.meshgrid(n, n))
            a = np.outer(m, m).ravel() * lenses.aperture_width**2 / 4
        x, y = cx + q, cy + p
        arriving = np.concatenate(
            [
                kernel(legs.to_array, x[part, None] - u, y[part, None] - v, path.array_distance) @ behind
                for part in np.array_split(np.arange(x.size), 20)
            ]
        )
        left = a * micro(q / lenses.reach, p / lenses.reach) * arriving * np.exp(-1j * k * (q**2 + p**2) / (2 * f))
        field += kernel(legs.to_detector, sx[:, None] - x, sy[:, None] - y, path.detector_distance) @ left
    weights = np.outer(g, g).ravel() * h**2 / 4
    return np.abs(field.reshape(len(pixels), -1)) ** 2 @ weights / pupil_power


@functools.cache
def brightest(name: str) -> list[tuple[int, int]]:
    """The two brightest pixels of a case and one far from them."""
    path, source, legs = CASES[name]
    pixels = image(path, source, legs).pixels
    order = np.argsort(pixels.ravel())[::-1]
    picks = [int(order[0]), int(order[3]), int(order[order.size // 3])]
    return [(int(i), int(j)) for i, j in zip(*np.unravel_index(picks, pixels.shape), strict=True)]


ON, OFF = PointSource(distance=24e-3), PointSource(x=0.13e-3, y=-0.06e-3, distance=24e-3)
PAIR = {"centres": PITCH * np.array([[0.0, 0.0], [1.0, 0.0]]), "focal_lengths": np.array([70e-6, 85e-6])}
CASES: dict[str, tuple[LightPath, PointSource, Legs]] = {
    "kirchhoff": (camera(**PAIR), OFF, KIRCHHOFF),
    "fresnel": (camera(**PAIR), OFF, FRESNEL),
    "mixture": (camera(**PAIR), ON, KIRCHHOFF_FRESNEL),
    "reversed mixture": (camera(**PAIR), OFF, Legs(to_array="fresnel", to_detector="kirchhoff")),
    "square apertures": (
        camera(aperture="square", centres=np.zeros((1, 2)), focal_lengths=np.full(1, 76e-6)),
        OFF,
        KIRCHHOFF,
    ),
    "galilean": (camera(**PAIR | {"focal_lengths": np.full(2, 0.22e-3)}, array_distance=2.0e-3), OFF, KIRCHHOFF),
    "unfocused": (
        camera(**PAIR | {"focal_lengths": np.full(2, 0.1e-3)}, array_distance=24 / 11 * 1e-3),
        OFF,
        KIRCHHOFF,
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_chain_is_the_nested_integral(name: str) -> None:
    path, source, legs = CASES[name]
    done = image(path, source, legs, accuracy=ChainAccuracy(tolerance=1e-4))
    truth = nested_pixels(path, source, legs, brightest(name))
    value = np.array([done.pixels[at] for at in brightest(name)])
    assert relative(value, truth) < 2e-4
    assert done.numerical_error < 5e-4


def test_stated_error_covers_the_true_one_on_random_cameras_and_is_tight() -> None:
    rng = np.random.default_rng(11)
    ratios = []
    for _ in range(6):
        path = camera(
            array_distance=rng.uniform(1.9e-3, 2.7e-3),
            detector_distance=rng.uniform(0.08e-3, 0.14e-3),
            focal_lengths=rng.uniform(60e-6, 130e-6, 3),
        )
        source = PointSource(x=rng.uniform(-0.2e-3, 0.2e-3), y=rng.uniform(-0.1e-3, 0.1e-3), distance=24e-3)
        rough = image(path, source, accuracy=ChainAccuracy(tolerance=3e-3))
        truth = image(path, source, accuracy=ChainAccuracy(tolerance=1e-5)).pixels
        ratios.append(rough.numerical_error / relative(rough.pixels, truth))
    assert np.sum(np.array(ratios) >= 1) >= 5
    assert min(ratios) > 0.5
    assert np.median(ratios) < 10


@pytest.mark.parametrize("accuracy", [FAST, ChainAccuracy(tolerance=0.15), ChainAccuracy(diffraction_reach=0.5)])
def test_the_comparison_of_an_image_reaches_farther_and_is_otherwise_coarser(accuracy: ChainAccuracy) -> None:
    """Edges of far microlenses come in steps of their pitch: a shorter reach may miss the very same ones."""
    other = accuracy.compared()
    assert other.fresnel_lengths / accuracy.fresnel_lengths == pytest.approx(max(1.5, 1 / accuracy.diffraction_reach))
    assert accuracy.tolerance < other.tolerance <= 0.2
    assert all(getattr(other, knob) < 1 for knob in ("pupil_nodes", "microlens_nodes", "field_sampling"))


def test_the_stated_error_grows_with_fewer_nodes() -> None:
    """At half and a quarter of the microlens nodes the statement grows with the error."""
    truth = image(camera(), OFF, accuracy=ChainAccuracy(tolerance=1e-5)).pixels
    stated, true = [], []
    for factor in (1.0, 0.5, 0.25):
        done = image(camera(), OFF, accuracy=replace(FAST, microlens_nodes=factor))
        stated.append(done.numerical_error)
        true.append(relative(done.pixels, truth))
    assert stated[0] < stated[1] < stated[2]
    assert all(s > t / 2 for s, t in zip(stated, true, strict=True))


def test_direct_check_confirms_the_fast_path() -> None:
    done = image(camera(), OFF, accuracy=ChainAccuracy(tolerance=1e-5))
    assert done.direct_check["field on the array"] < 1e-3
    assert done.direct_check["intensity on the detector"] < 1e-2


def test_clear_cells_without_power_have_no_effect() -> None:
    """Lenses without power in clear cells let the main lens's light pass as if there were no array."""
    lenses = square_centres(pitch=PITCH, count=3)
    path = camera(
        centres=lenses,
        focal_lengths=np.full(9, 1e3),
        gaps="clear",
        array_distance=2.3e-3,
        pixels=PixelGrid(pitch=4e-6, shape=(9, 9), centre=(1e-6, 0.0)),
    )
    through = image(path, ON, FRESNEL, accuracy=ChainAccuracy(tolerance=1e-4))
    u, v, w = polar(path.main_lens.radius, 60, 150)
    k = 2 * np.pi / WAVELENGTH
    behind = w * kernel("fresnel", u, v, 24e-3) * np.exp(-1j * k * (u**2 + v**2) / (2 * 2e-3))
    t, g = np.polynomial.legendre.leggauss(5)
    pixels = np.zeros((9, 9))
    for i in range(9):
        for j in range(9):
            x = path.pixels.edges_x[j] + 2e-6 * (1 + t)
            y = path.pixels.edges_y[i] + 2e-6 * (1 + t)
            along_x = kernel("fresnel", x[:, None] - u, 0.0, 2.4e-3) * 1j * WAVELENGTH * 2.4e-3
            along_y = kernel("fresnel", y[:, None] - v, 0.0, 2.4e-3)
            field = (along_y * behind) @ along_x.T
            pixels[i, j] = (2e-6) ** 2 * g @ np.abs(field) ** 2 @ g
    pixels /= np.sum(w * np.abs(kernel("fresnel", u, v, 24e-3)) ** 2)
    assert relative(through.pixels, pixels) < 0.02  # what passes beside the nine cells is missing
    assert np.unravel_index(np.argmax(pixels), pixels.shape) == np.unravel_index(
        np.argmax(through.pixels), pixels.shape
    )


def test_energy_is_kept_behind_the_array() -> None:
    path = camera(pixels=PixelGrid(pitch=6e-6, shape=(25, 35)))
    done = image(path, OFF, FRESNEL)
    assert done.pixels.sum() == pytest.approx(done.microlens_share, rel=0.02)
    assert done.pixels.sum() < done.microlens_share


@pytest.mark.parametrize("symmetry", [(-1, 1, False), (1, -1, False), (1, 1, True), (-1, 1, True)])
def test_moving_the_scene_moves_the_image(symmetry: tuple[int, int, bool]) -> None:
    """Mirrors and quarter turns of everything: no pixel is mirrored or shifted by the code itself."""
    centres = PITCH * np.array([[0.0, 0.0], [1.0, 0.3]])
    path = camera(
        centres=centres,
        focal_lengths=np.array([70e-6, 85e-6]),
        pixels=PixelGrid(pitch=4e-6, shape=(15, 15), centre=(8e-6, 4e-6)),
    )
    shifted = moved(np.array([OFF.x, OFF.y]), symmetry)
    turned = camera(
        centres=moved(centres, symmetry),
        focal_lengths=np.array([70e-6, 85e-6]),
        pixels=PixelGrid(pitch=4e-6, shape=(15, 15), centre=tuple(moved(np.array([8e-6, 4e-6]), symmetry))),
    )
    source = PointSource(x=float(shifted[0]), y=float(shifted[1]), distance=OFF.distance)
    before, after = image(path, OFF), image(turned, source)
    difference = relative(after.pixels, moved_image(before.pixels, symmetry))
    assert difference < before.numerical_error + after.numerical_error < 5e-3
    assert relative(before.pixels[::-1], before.pixels) > 0.1


def test_image_lies_where_rays_put_it() -> None:
    waves, rays = image(camera(), OFF).pixels, image(camera(), OFF, GEOMETRIC).pixels
    x, y = (np.convolve(e, [0.5, 0.5], "valid") for e in (camera().pixels.edges_x, camera().pixels.edges_y))
    for pixels in (waves, rays):
        pixels /= pixels.sum()
    assert (waves @ x).sum() == pytest.approx((rays @ x).sum(), abs=2e-6)
    assert (waves.T @ y).sum() == pytest.approx((rays.T @ y).sum(), abs=2e-6)


def test_waves_approach_rays_as_the_wavelength_shrinks() -> None:
    """Defocused lenses, so that rays have a finite density; diffraction blurs their edges by √λ."""
    path = camera(focal_lengths=np.full(3, 50e-6))
    rays = image(path, ON, GEOMETRIC).pixels
    differences = []
    for wavelength in (1600e-9, 400e-9, 100e-9):
        waves = chain_image(
            path,
            ON,
            wavelength=wavelength,
            legs=FRESNEL,
            accuracy=ChainAccuracy(tolerance=1e-2),
            rng=np.random.default_rng(0),
        ).pixels
        differences.append(float(np.abs(waves - rays).sum() / rays.sum()))
    assert differences[0] > 1.1 * differences[1] > 2 * differences[2]


def test_kirchhoff_approaches_fresnel_as_angles_shrink() -> None:
    """Widths times t, lengths times t²: Fresnel's image only scales, what it drops falls as the squared angle, t⁻²."""
    differences, fresnel = [], []
    for t in (1.0, 2.0):
        path = camera(
            main_lens=CircularLens(radius=t * 0.1e-3, focal_length=t**2 * 2e-3, lens_phase="parabolic"),
            centres=t * PITCH * np.array([[0.0, 0.0], [1.0, 0.0]]),
            focal_lengths=t**2 * np.full(2, 76e-6),
            aperture_width=t * 24e-6,
            pitch=t * PITCH,
            array_distance=t**2 * 2.5e-3,
            detector_distance=t**2 * 0.1e-3,
            pixels=PixelGrid(pitch=t * 4e-6, shape=(7, 9)),
        )
        source = PointSource(x=t * 0.05e-3, distance=t**2 * 24e-3)
        accuracy = ChainAccuracy(tolerance=1e-5)
        fresnel.append(image(path, source, FRESNEL, accuracy=accuracy).pixels)
        differences.append(relative(fresnel[-1], image(path, source, accuracy=accuracy).pixels))
    assert relative(fresnel[1], fresnel[0]) < 2e-4
    assert differences[0] > 1e-2
    assert math.log2(differences[0] / differences[1]) == pytest.approx(2, abs=0.3)


def test_spectrum_is_the_weighted_mean() -> None:
    settings = {"legs": FRESNEL, "accuracy": FAST, "rng": np.random.default_rng(0)}
    both = spectral_image(
        camera(), ON, wavelengths=np.array([450e-9, 650e-9]), weights=np.array([1.0, 3.0]), **settings
    )
    blue, red = (chain_image(camera(), ON, wavelength=w, **settings).pixels for w in (450e-9, 650e-9))
    np.testing.assert_allclose(both.pixels, (blue + 3 * red) / 4, rtol=1e-12)
    assert relative(blue, red) > 0.05
    assert 0 < both.numerical_error < 1e-2


def test_incoherent_spot_is_the_mean_of_its_points() -> None:
    """Against a Cartesian midpoint rule over the disc, weighted by the share of each cell inside it."""
    path = camera(
        centres=square_centres(pitch=PITCH, count=3),
        focal_lengths=np.full(9, 76e-6),
        pixels=PixelGrid(pitch=4e-6, shape=(21, 21)),
    )
    source = DiscSource(diameter=0.24e-3, distance=24e-3)
    spot = image(path, source, FRESNEL, accuracy=ChainAccuracy(tolerance=1e-2))
    axis = 0.24e-3 * (np.arange(9) - 4) / 9
    fine = 0.24e-3 / 9 * (np.arange(40) - 19.5) / 40
    total, weight = np.zeros(path.pixels.shape), 0.0
    group = symmetries(path, source)
    assert len(group) == 8
    for x in axis[4:]:
        for y in axis[4:]:
            inside = float(np.mean(np.hypot(x + fine[:, None], y + fine) <= 0.12e-3))
            if y > x or inside == 0:
                continue
            point = image(path, PointSource(x=x, y=y, distance=24e-3), FRESNEL, accuracy=ChainAccuracy(tolerance=1e-2))
            places = {(round(a * 1e9), round(b * 1e9)) for a, b in (moved(np.array([x, y]), s) for s in group)}
            mean = np.mean([moved_image(point.pixels, s) for s in group], axis=0)
            total += inside * len(places) * mean
            weight += inside * len(places)
    assert relative(spot.pixels, total / weight) < 0.02
    assert spot.numerical_error < 0.02
    for one in group:
        assert relative(moved_image(spot.pixels, one), spot.pixels) < 1e-6


def test_small_spot_is_a_point_coherent_or_not() -> None:
    point = image(camera(), OFF)
    for coherent in (False, True):
        disc = DiscSource(diameter=1e-7, x=OFF.x, y=OFF.y, distance=OFF.distance, coherent=coherent)
        done = image(camera(), disc)
        assert relative(done.pixels, point.pixels) < done.numerical_error + point.numerical_error < 0.02


def test_coherent_disc_adds_fields() -> None:
    """Two halves of a wave cancel: a coherent disc as wide as the pupil resolves is far from the incoherent one."""
    disc = DiscSource(diameter=0.3e-3, distance=24e-3, coherent=True)
    coherent = image(camera(), disc, FRESNEL)
    assert coherent.numerical_error < 0.02
    incoherent = image(camera(), replace(disc, coherent=False), FRESNEL, accuracy=ChainAccuracy(tolerance=1e-2))
    assert relative(coherent.pixels / coherent.pixels.sum(), incoherent.pixels / incoherent.pixels.sum()) > 0.1
    np.testing.assert_allclose(coherent.pixels, coherent.pixels[::-1], atol=1e-3 * coherent.pixels.max())


def traced(path: LightPath, source: DiscSource | PointSource, count: int) -> np.ndarray:
    """Monte Carlo of paraxial rays, the thin lens applied ray by ray."""
    rng = np.random.default_rng(5)

    def disc(radius: float) -> np.ndarray:
        r, angle = radius * np.sqrt(rng.random(count)), 2 * np.pi * rng.random(count)
        return np.column_stack([r * np.cos(angle), r * np.sin(angle)])

    u = disc(path.main_lens.radius)
    s = disc(source.diameter / 2 if isinstance(source, DiscSource) else 0.0) + np.array([source.x, source.y])
    slope = (u - s) / source.distance - u / path.main_lens.focal_length
    x = u + path.array_distance * slope
    lenses = path.microlenses
    nearest = np.argmin(np.linalg.norm(x[:, None] - lenses.centres, axis=-1), axis=1)
    q = x - lenses.centres[nearest]
    half = lenses.aperture_width / 2
    inside = np.linalg.norm(q, axis=1) <= half if lenses.aperture == "circular" else np.abs(q).max(axis=1) <= half
    sides = 4 if lenses.layout == "square" else 6
    normals = np.array([[np.cos(a), np.sin(a)] for a in 2 * np.pi * np.arange(sides) / sides])
    passes = inside | ((q @ normals.T).max(axis=1) <= lenses.pitch / 2 if lenses.gaps == "clear" else False)
    slope = slope - np.where(inside, 1 / lenses.focal_lengths[nearest], 0.0)[:, None] * q
    y = (x + path.detector_distance * slope)[passes]
    return np.histogram2d(y[:, 1], y[:, 0], bins=[path.pixels.edges_y, path.pixels.edges_x])[0] / count


@pytest.mark.parametrize("gaps", ["opaque", "clear"])
@pytest.mark.parametrize("layout", ["square", "hexagonal"])
@pytest.mark.parametrize("extended", [False, True])
def test_rays_agree_with_monte_carlo(gaps: str, layout: str, extended: bool) -> None:
    centres = square_centres(pitch=PITCH, count=3) if layout == "square" else hexagonal_centres(pitch=PITCH, rings=1)
    path = camera(
        centres=centres,
        focal_lengths=np.linspace(60e-6, 90e-6, centres.shape[0]),
        layout=layout,
        gaps=gaps,
        aperture_width=22e-6,
        pixels=PixelGrid(pitch=6e-6, shape=(15, 15)),
    )
    source = DiscSource(diameter=0.2e-3, x=0.05e-3, distance=24e-3) if extended else OFF
    done = image(path, source, GEOMETRIC)
    count = 400_000
    noise = math.sqrt(done.pixels.sum() / count) / float(np.linalg.norm(done.pixels))
    assert relative(traced(path, source, count), done.pixels) < 1.5 * noise + 2 * done.numerical_error
    assert done.numerical_error < 0.01


def test_rays_of_lenses_in_focus_fall_on_points() -> None:
    depth = 2.5e-3 - 24 / 11 * 1e-3
    focal = 1 / (1 / depth + 1 / 0.1e-3)
    path = camera(focal_lengths=np.full(3, focal))
    pixels = image(path, ON, GEOMETRIC).pixels
    assert np.count_nonzero(pixels > 1e-12) == 3
    blur = 0.1e-3 * depth / (24 / 11 * 1e-3)
    assert pixels[4, 11] == pytest.approx((12e-6 / blur) ** 2, rel=2e-3)


def test_orbits_count_every_source_node_once() -> None:
    path = camera(centres=square_centres(pitch=PITCH, count=3), focal_lengths=np.full(9, 76e-6),
                  pixels=PixelGrid(pitch=4e-6, shape=(9, 9)))  # fmt: skip
    for x, expected in ((0.0, 8), (1e-4, 2)):
        source = DiscSource(diameter=1e-4, x=x, distance=24e-3)
        group = symmetries(path, source)
        assert len(group) == expected
        nodes = source_nodes(path, source, wavelength=WAVELENGTH, density=1.0)
        chosen = list(orbits(nodes, 2, group))
        assert sum(size for _, size in chosen) == len(nodes.rings[2])
        assert len(chosen) <= len(nodes.rings[2]) / expected + 2


def test_types_break_the_symmetry() -> None:
    path = camera(pixels=PixelGrid(pitch=4e-6, shape=(9, 23)))
    assert symmetries(path, DiscSource(diameter=1e-4, distance=24e-3)) == [(1, 1, False), (1, -1, False)]


def test_impossible_combinations_are_refused() -> None:
    with pytest.raises(OutOfRangeError, match="method"):
        Legs(to_array="ray", to_detector="fresnel")
    with pytest.raises(OutOfRangeError, match="coherent"):
        image(camera(), DiscSource(diameter=1e-4, distance=24e-3, coherent=True), GEOMETRIC)
    with pytest.raises(OutOfRangeError, match="wavelength"):
        chain_image(camera(), ON, wavelength=0.0, legs=FRESNEL, accuracy=FAST, rng=np.random.default_rng(0))
    with pytest.raises(OutOfRangeError, match="spectrum"):
        spectral_image(
            camera(),
            ON,
            wavelengths=np.ones(2),
            weights=np.ones(3),
            legs=FRESNEL,
            accuracy=FAST,
            rng=np.random.default_rng(0),
        )
    with pytest.raises(UnaffordableError, match="GB"):
        image(camera(), ON, accuracy=ChainAccuracy(memory_limit=1e6))
    for changes in ({"tolerance": 0.0}, {"source_sampling": -1.0}):
        with pytest.raises(OutOfRangeError):
            ChainAccuracy(**changes)
    for changes in ({"diameter": 0.0}, {"distance": -1.0}):
        with pytest.raises(OutOfRangeError):
            DiscSource(**({"diameter": 1e-4, "distance": 1.0} | changes))


def test_an_image_beyond_its_tolerance_says_so() -> None:
    source = PointSource(distance=20e-3)
    good = image(camera(), source)
    assert good.tolerance == FAST.tolerance
    assert good.within_tolerance
    starved = image(camera(), source, accuracy=replace(FAST, microlens_nodes=0.3))
    assert relative(starved.pixels, good.pixels) > FAST.tolerance
    assert not starved.within_tolerance
    spectrum = spectral_image(
        camera(),
        source,
        wavelengths=np.array([500e-9, 600e-9]),
        weights=np.ones(2),
        legs=KIRCHHOFF,
        accuracy=replace(FAST, microlens_nodes=0.3),
        rng=np.random.default_rng(7),
    )
    assert not spectrum.within_tolerance


@pytest.mark.parametrize("changes", [{"detector_distance": 0.4e-6}, {"aperture_width": 0.5e-6}])
def test_apertures_and_distances_below_a_wavelength_are_refused(changes: dict[str, float]) -> None:
    with pytest.raises(OutOfRangeError, match="vector diffraction"):
        image(camera(**changes), PointSource(distance=20e-3))


def aberrated(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A third of a wave of coma along y and half a wave of astigmatism, in Noll's polynomials written out."""
    r2 = x**2 + y**2
    return np.exp(2j * np.pi * (np.sqrt(8) * (3 * r2 - 2) * y / 3 + np.sqrt(6) * (x**2 - y**2) / 2))


def shaded(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.exp(-(x**2) - (y - 0.2) ** 2 + 2j * np.pi * 0.2 * np.sin(2 * x))


SHADED = Pupil(
    amplitude=lambda x, y: np.exp(-(x**2) - (y - 0.2) ** 2), path=lambda x, y: 0.2 * WAVELENGTH * np.sin(2 * x)
)
RING = Pupil(obscuration=0.4)
ABERRATED = Pupil.from_waves({7: 1 / 3, 6: 0.5}, wavelength=WAVELENGTH)


@pytest.mark.parametrize(
    ("main", "micro", "legs"),
    [(ABERRATED, SHADED, KIRCHHOFF), (SHADED, ABERRATED, FRESNEL), (RING, None, KIRCHHOFF)],
    ids=["main", "micro", "ring"],
)
def test_pupils_of_both_lenses_are_those_of_nested_sums(main: Pupil, micro: Pupil | None, legs: Legs) -> None:
    plain = camera(**PAIR)
    path = replace(
        plain,
        main_lens=replace(plain.main_lens, pupil=main),
        microlenses=replace(plain.microlenses, pupil=micro),
    )
    found = image(path, OFF, legs)
    order = np.argsort(found.pixels.ravel())[::-1][[0, 3, 60]]
    picks = [(int(i), int(j)) for i, j in zip(*np.unravel_index(order, found.pixels.shape), strict=True)]
    laws = {id(ABERRATED): aberrated, id(SHADED): shaded, id(RING): clear, id(None): clear}
    truth = nested_pixels(path, OFF, legs, picks, laws[id(main)], laws[id(micro)])
    allowed = found.numerical_error * np.linalg.norm(found.pixels)
    assert np.abs([found.pixels[at] for at in picks] - truth).max() < allowed < 3e-3 * np.linalg.norm(found.pixels)
    assert relative(found.pixels, image(plain, OFF, legs).pixels) > 0.1


def test_a_spot_behind_round_aberrations_is_the_mean_of_its_points_and_others_are_refused() -> None:
    plain = camera(**PAIR)
    spherical = Pupil.from_waves({11: 0.2}, wavelength=WAVELENGTH)
    path = replace(
        plain,
        main_lens=replace(plain.main_lens, pupil=spherical),
        microlenses=replace(plain.microlenses, pupil=ABERRATED),
    )
    accuracy = ChainAccuracy(tolerance=1e-2)
    disc = DiscSource(diameter=12e-6, distance=24e-3)
    spot = image(path, disc, accuracy=accuracy)
    radius = 6e-6 * np.sqrt(0.5 + np.array([[-1], [1]]) / np.sqrt(12))  # Gauss's two points in the squared radius
    angle = 2 * np.pi * (np.arange(3) + 0.2) / 3
    at = zip((radius * np.cos(angle)).ravel(), (radius * np.sin(angle)).ravel(), strict=True)
    points = [image(path, PointSource(x=x, y=y, distance=24e-3), accuracy=accuracy) for x, y in at]
    truth = np.mean([point.pixels for point in points], axis=0)
    assert relative(spot.pixels, truth) < spot.numerical_error + max(point.numerical_error for point in points) < 0.01
    assert relative(image(plain, disc, accuracy=accuracy).pixels, truth) > 0.1
    with pytest.raises(OutOfRangeError, match="4, 11 and 22"):
        image(replace(path, main_lens=replace(plain.main_lens, pupil=ABERRATED)), disc)
    with pytest.raises(OutOfRangeError, match="fresnel or kirchhoff"):
        image(path, ON, GEOMETRIC)


def test_a_star_is_what_far_points_tend_to_through_the_chain() -> None:
    path = camera(**PAIR, array_distance=2.2e-3)
    star = image(path, PointSource.at_infinity(angle_x=0.004)).pixels
    differences = [
        relative(image(path, PointSource(x=a * math.tan(0.004), distance=a)).pixels, star) for a in (2.0, 2e3)
    ]
    assert differences[1] < 2e-5 < differences[0]
    rays = image(path, PointSource.at_infinity(angle_x=0.004), GEOMETRIC).pixels
    assert relative(rays, image(path, PointSource(x=8.000043, distance=2e3), GEOMETRIC).pixels) < 1e-4

"""Microlenses act as fixed lenses, near focus too, and fast ones obey the law of each leg: against other programs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss
from scipy.interpolate import CubicSpline
from scipy.special import j0

import tradestudy
from tests.optics.angular_spectrum import angular_spectrum_image
from tests.optics.small_chain import camera as small_chain
from tests.optics.small_chain import relative
from tradestudy import optics
from tradestudy.errors import OutOfRangeError

WAVELENGTH = 550e-9


def camera(**changes: object) -> optics.MicrolensCamera:
    """An unfocused plenoptic camera like the first Lytro, f/2, in focus at 0.5 m, with all lenses as by default."""
    usual: dict[str, object] = {
        "focal_length": 6.45e-3,
        "f_number": 2.0,
        "array_distance": 1 / (1 / 6.45e-3 - 1 / 0.5),
        "microlens_focal_lengths": 25e-6,
        "microlens_pitch": 13.8986e-6,
        "gap": 25e-6,
        "pixel_pitch": 1.4e-6,
    }
    return optics.MicrolensCamera(**(usual | changes))  # type: ignore[arg-type]  # values of several kinds


def slow() -> optics.MicrolensCamera:
    """An unfocused camera at f/22, in focus at 1 m."""
    return camera(
        focal_length=50e-3, f_number=22.0, array_distance=1 / (1 / 50e-3 - 1.0), microlens_focal_lengths=2.2e-3,
        microlens_pitch=100e-6, gap=2.2e-3, pixel_pitch=5e-6,
    )  # fmt: skip


def illum() -> optics.MicrolensCamera:
    """Lenses like those of the Lytro Illum."""
    return camera(
        focal_length=9.98445e-3, array_distance=9.847916e-3, microlens_focal_lengths=40.087e-6, microlens_pitch=20e-6,
        gap=40.087e-6,
    )  # fmt: skip


def shipped() -> optics.MicrolensCamera:
    """The unfocused R5, in focus at 150 mm."""
    return tradestudy.load("studies/hand_lens.yaml").cameras["r5-unfocused"].light_chain()


def of_path(path: optics.LightPath, distance: float, legs: optics.Legs, tolerance: float) -> optics.ChainImage:
    return optics.chain_image(
        path, optics.PointSource(distance=distance), wavelength=WAVELENGTH, legs=legs,
        accuracy=optics.ChainAccuracy(tolerance=tolerance), rng=np.random.default_rng(0),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("of", "distance", "per_pixel", "across"),
    [
        (camera, 0.5, 14, 600),
        pytest.param(camera, 0.499, 14, 600, marks=pytest.mark.slow),
        (camera, 0.49, 14, 700),
        (slow, 1.0, 10, 900),
        (slow, 0.98, 10, 900),
        pytest.param(shipped, 0.15, 12, 700, marks=pytest.mark.slow),
        (shipped, 0.149, 12, 700),
    ],
    ids=["f/2", "f/2, 0.2 µm off", "f/2, 2 µm off", "f/22", "f/22, 60 µm off", "shipped", "shipped, 8 µm off"],
)
def test_an_unfocused_camera_in_focus_or_close_to_it(of, distance: float, per_pixel: int, across: int) -> None:  # type: ignore[no-untyped-def]  # a function of this module
    """By default, and exactly in focus; a phase that follows the source errs by 27 to 85 % here."""
    lenses, point = of(), optics.PointSource(distance=distance)
    image = optics.microlens_image(lenses, point, wavelength=WAVELENGTH, tolerance=1e-2)
    path = lenses.light_path(point, wavelength=WAVELENGTH)
    truth = angular_spectrum_image(path, distance, WAVELENGTH, law="kirchhoff", per_pixel=per_pixel, across=across)
    assert relative(image.pixels, truth) < image.numerical_error + 1e-3
    assert 0.95 < image.pixels.sum() < 1.0


@pytest.mark.parametrize("aside", [3e-6, 6.5e-6])
def test_light_focused_beside_the_middle_of_a_microlens(aside: float) -> None:
    path = camera().light_path(optics.PointSource(distance=0.5), wavelength=WAVELENGTH)
    lenses = path.microlenses
    moved = replace(path, microlenses=replace(lenses, centres=lenses.centres + np.array([aside, 0.0])))
    image = of_path(moved, 0.5, optics.KIRCHHOFF, 1e-2)
    truth = angular_spectrum_image(moved, 0.5, WAVELENGTH, law="kirchhoff", per_pixel=14, across=600)
    assert relative(image.pixels, truth) < image.numerical_error + 6e-3  # the other program's soft edges lose light


@pytest.mark.parametrize("phase", ["perfect", "stigmatic"])
@pytest.mark.parametrize("distance", [0.5, 0.499, 0.49])
def test_phases_that_follow_the_source_are_refused_near_focus(phase: optics.LensPhase, distance: float) -> None:
    lenses, point = camera(microlens_phase=phase), optics.PointSource(distance=distance)
    with pytest.raises(OutOfRangeError) as refusal:
        optics.microlens_image(lenses, point, wavelength=WAVELENGTH, tolerance=2e-2)
    assert "use the parabolic lens phase" in str(refusal.value) or "or the parabolic lens phase" in str(refusal.value)
    if distance == 0.499:
        assert f"{phase} microlenses, whose phase follows the source" in str(refusal.value)
        assert "≤ 0.02" in str(refusal.value)
    # Paraxial legs know a single lens.
    if phase == "perfect":
        same = optics.microlens_image(lenses, point, wavelength=WAVELENGTH, legs=optics.FRESNEL, tolerance=2e-2)
        fixed = optics.microlens_image(camera(), point, wavelength=WAVELENGTH, legs=optics.FRESNEL, tolerance=2e-2)
        np.testing.assert_array_equal(same.pixels, fixed.pixels)


def test_the_tolerance_decides_whether_a_phase_may_follow_the_source() -> None:
    """Far from focus it changes the image a little; a stigmatic lens with another focus is an element of its own."""
    path, distance = small_chain(), 20e-3
    depth = path.image_at_array(optics.PointSource(distance=distance))[2]

    def image(tolerance: float, **phase: object) -> optics.ChainImage:
        changed = replace(path, microlenses=replace(path.microlenses, **phase))
        return of_path(changed, distance, optics.KIRCHHOFF, tolerance)

    fixed, follows = image(5e-2), {"lens_phase": "stigmatic", "focus_distance": depth}
    change = relative(image(5e-2, **follows).pixels, fixed.pixels)
    assert 1e-3 < change < 5e-2
    with pytest.raises(OutOfRangeError, match="stigmatic microlenses, whose phase follows the source"):
        image(change / 2, **follows)
    own = image(change / 2, lens_phase="stigmatic", focus_distance=1e15)
    assert relative(own.pixels, fixed.pixels) > change / 2
    assert own.within_tolerance


def fresnel_on_axis(path: optics.LightPath, distance: float) -> np.ndarray:
    """Fresnel's image by one microlens on the axis: two Hankel transforms, and Gauss's rule over every pixel."""
    lens, micro = path.main_lens, path.microlenses
    rings, weights = (c / 2 for c in leggauss(400))
    u, area = lens.radius * (rings + 0.5), 2 * np.pi * lens.radius**2 * (rings + 0.5) * weights
    x, cell = (c * micro.aperture_width / 2 / lens.radius for c in (u, area))
    cell = cell * micro.aperture_width / 2 / lens.radius
    z, b, k = path.array_distance, path.detector_distance, 2 * np.pi / WAVELENGTH
    wave = np.exp(1j * k / 2 * u**2 * (1 / distance - 1 / lens.focal_length + 1 / z)) / (np.sqrt(np.pi) * lens.radius)
    arriving = j0(k * np.outer(x, u) / z) @ (area * wave) / (WAVELENGTH * z)
    behind = arriving * np.exp(1j * k / 2 * x**2 * (1 / z - 1 / micro.focal_lengths[0] + 1 / b))
    far = np.linspace(0.0, 1.01 * np.hypot(path.pixels.edges_x[-1], path.pixels.edges_y[-1]), 4000)
    intensity = CubicSpline(far, np.abs(j0(k * np.outer(far, x) / b) @ (cell * behind) / (WAVELENGTH * b)) ** 2)
    inside, share = (c / 2 for c in leggauss(8))
    columns, rows = (
        (edges[:-1, None] + path.pixels.pitch * (inside + 0.5)).ravel()
        for edges in (path.pixels.edges_x, path.pixels.edges_y)
    )  # fmt: skip
    light = intensity(np.hypot(columns, rows[:, None])).reshape(rows.size // 8, 8, columns.size // 8, 8)
    return np.asarray(np.einsum("ipjq,p,q->ij", light, share, share) * path.pixels.pitch**2)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3, 1e-4])
@pytest.mark.parametrize(("of", "distance"), [(camera, 0.3), (illum, 1.0)], ids=["Lytro", "Illum"])
def test_fresnels_law_behind_a_fast_microlens_equals_two_hankel_transforms(
    of, distance: float, tolerance: float
) -> None:  # type: ignore[no-untyped-def]  # a function of this module
    """Its nodes must resolve the tangent of the steepest direction: those for its sine invented light."""
    path = of().light_path(optics.PointSource(distance=distance), wavelength=WAVELENGTH)
    middle = int(np.argmin(np.linalg.norm(path.microlenses.centres, axis=1)))
    path = replace(path, microlenses=path.microlenses.only(middle))
    image = of_path(path, distance, optics.FRESNEL, tolerance)
    truth = fresnel_on_axis(path, distance)
    assert relative(image.pixels, truth) < image.numerical_error < 3 * tolerance
    assert image.pixels.sum() < truth.sum() * (1 + tolerance)


@pytest.mark.parametrize(
    ("of", "distance"),
    [(camera, 0.3), pytest.param(illum, 1.0, marks=pytest.mark.slow)],
    ids=["Lytro", "Illum"],
)
def test_fresnels_share_of_the_light_converges_below_all_that_enters(of, distance: float) -> None:  # type: ignore[no-untyped-def]  # a function of this module
    path = of().light_path(optics.PointSource(distance=distance), wavelength=WAVELENGTH)
    shares = [of_path(path, distance, optics.FRESNEL, t).pixels.sum() for t in (1e-1, 1e-2, 1e-3, 1e-4)]
    steps = np.diff(shares)
    assert np.abs(steps).max() < 2.5e-3
    assert abs(steps[-1]) < 1e-3
    assert max(shares) < np.pi / np.sqrt(12)  # the open part of the array


def test_fresnels_law_differs_from_kirchhoffs_by_what_both_laws_do_elsewhere() -> None:
    """An f/1.8 microlens: 11 % in each program."""
    path = camera().light_path(optics.PointSource(distance=0.3), wavelength=WAVELENGTH)
    fresnel, kirchhoff = (of_path(path, 0.3, legs, 1e-3) for legs in (optics.FRESNEL, optics.KIRCHHOFF))
    truths = [
        angular_spectrum_image(path, 0.3, WAVELENGTH, law=law, per_pixel=12, across=700)
        for law in ("fresnel", "kirchhoff")
    ]
    for found, truth in zip((fresnel, kirchhoff), truths, strict=True):
        assert relative(found.pixels, truth) < found.numerical_error + 1e-3
    apart = relative(fresnel.pixels, kirchhoff.pixels)
    assert 0.05 < apart == pytest.approx(relative(*truths), abs=2e-3)

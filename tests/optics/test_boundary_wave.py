"""Rays and the wave from the edge against the area integral."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tradestudy.errors import NotConvergedError
from tradestudy.optics.propagation.aperture import aperture_field, lens_wave
from tradestudy.optics.propagation.boundary_wave import edge_field, fewest_zones, find_rays, ray_fields
from tradestudy.optics.propagation.hybrid import unchecked_hybrid_field
from tradestudy.optics.propagation.kernels import KirchhoffKernel, direct_sum
from tradestudy.optics.propagation.lens import CircularLens, PointSource
from tradestudy.optics.propagation.sampling import Limits, NodeCounts
from tradestudy.optics.propagation.targets import TargetGrid, TargetPoints
from tradestudy.optics.propagation.wave_optics import FieldAccuracy, nodes_for, sample_wave

WAVELENGTH = 550e-9
MICRO = {"radius": 0.432e-3 / 7.6, "focal_length": 0.432e-3}
OBJECT = PointSource(x=0.3e-3, y=-0.1e-3, distance=13.64e-3)


def micro(phase: str) -> CircularLens:
    return CircularLens(**MICRO, lens_phase=phase, focus_distance=13.64e-3 if phase == "stigmatic" else None)


def detector(phase: str, distance: float, pitch: float = 0.9e-6, count: int = 40) -> TargetGrid:
    x, y, b = micro(phase).image_of(OBJECT)
    return TargetGrid.centred(centre=(x * distance / b, y * distance / b), pitch=pitch, count=count, distance=distance)


def full_kirchhoff(source: PointSource, radius: float, x, y, z) -> np.ndarray:
    """(1/4π) ∬ (U ∂G/∂n − G ∂U/∂n) for U = exp(ikr)/r and G = exp(iks)/s, every term kept, over a disc."""
    k = 2 * math.pi / WAVELENGTH
    t, w = np.polynomial.legendre.leggauss(90)
    rho, angle = radius * (t + 1) / 2, 2 * math.pi * np.arange(220) / 220
    u, v = np.outer(rho, np.cos(angle)).ravel(), np.outer(rho, np.sin(angle)).ravel()
    area = np.repeat(radius / 2 * w * rho * 2 * math.pi / 220, 220)
    r = np.sqrt(source.distance**2 + (u - source.x) ** 2 + (v - source.y) ** 2)
    total = []
    for px, py, pz in zip(x, y, z, strict=True):
        s = np.sqrt((px - u) ** 2 + (py - v) ** 2 + pz**2)
        waves = np.exp(1j * k * (r + s)) / (r * s)
        total.append(
            np.sum(area * waves * ((1 / s - 1j * k) * pz / s - (1j * k - 1 / r) * source.distance / r)) / (4 * math.pi)
        )
    return np.asarray(total)


def test_exact_for_a_spherical_wave_even_on_the_shadow_of_the_edge():
    """Maggi and Rubinowicz: rays and edge are the whole Kirchhoff integral, near terms and all."""
    # A lens of no power: what passes is the spherical wave of the source.
    bare = CircularLens(radius=40e-6, focal_length=1e30, lens_phase="parabolic")
    source = PointSource(x=20e-6, y=10e-6, distance=0.9e-3)
    wave = lens_wave(source=source, lens=bare, wavelength=WAVELENGTH, obliquity="textbook")
    kernel = KirchhoffKernel(wavelength=WAVELENGTH, obliquity="textbook")
    z, magnification = 0.7e-3, 1 + 0.7 / 0.9
    # Rays through aperture radii from the middle, by the edge itself, to well outside.
    share = np.asarray([0.0, 0.3, 0.8, 0.95, 0.999, 1.0, 1.0 + 1e-6, 1.001, 1.1, 1.6])
    bearing = 0.7 * np.arange(share.size)
    x = source.x + (40e-6 * share * np.cos(bearing) - source.x) * magnification
    y = source.y + (40e-6 * share * np.sin(bearing) - source.y) * magnification
    z = np.full(x.size, z)
    rays = find_rays(wave, x, y, z, all_branches=False)
    np.testing.assert_allclose(np.hypot(rays.u[0], rays.v[0]), 40e-6 * share, atol=1e-15)
    from_edge, failed = edge_field(wave=wave, kernel=kernel, rays=rays, x=x, y=y, z=z, count=160, tolerance=1e-12)
    on_the_shadow = share == 1.0
    np.testing.assert_array_equal(failed, on_the_shadow)  # that one is handed over
    # LensWave carries the 1/(iλ) of the paper's source leg; the free wave exp(ikr)/r does not.
    found = (ray_fields(wave, kernel, rays, x, y, z)[0] + from_edge) * 1j * WAVELENGTH
    exact = full_kirchhoff(source, 40e-6, x, y, z)
    kept = ~on_the_shadow
    np.testing.assert_allclose(found[kept], exact[kept], atol=3e-8 * np.abs(exact).max())
    # The free wave itself differs by more than that where the ray passes the middle: the test sees the edge.
    free = np.exp(2j * math.pi / WAVELENGTH * np.hypot(z + source.distance, np.hypot(x - source.x, y - source.y)))
    free /= np.hypot(z + source.distance, np.hypot(x - source.x, y - source.y))
    assert np.abs(free - exact)[0] > 0.05 * np.abs(exact[0])


@pytest.mark.parametrize(
    ("phase", "obliquity", "tolerance"),
    [
        ("perfect", "textbook", 1e-2),
        ("perfect", "paper", 2e-2),
        ("perfect", "rayleigh-sommerfeld-1", 2e-2),
        ("stigmatic", "paper", 5e-2),
        ("parabolic", "paper", 0.1),
    ],
)
@pytest.mark.parametrize("distance", [0.568e-3, 0.36e-3])
def test_defocused_microlens_image_agrees_with_kirchhoff(phase, obliquity, tolerance, distance):
    targets = detector(phase, distance)
    hybrid, area = (
        aperture_field(
            source=OBJECT,
            lens=micro(phase),
            targets=targets,
            wavelength=WAVELENGTH,
            method=method,
            obliquity=obliquity,
            accuracy=FieldAccuracy(tolerance=t),
        )
        for method, t in (("boundary_wave", tolerance), ("kirchhoff", 1e-7))
    )
    error = np.linalg.norm(hybrid.intensity - area.intensity) / np.linalg.norm(area.intensity)
    assert error <= hybrid.error.intensity <= tolerance
    assert hybrid.handed_over <= 0.2
    assert hybrid.effort.nodes < 0.1 * area.effort.nodes


def test_near_focus_every_point_goes_to_kirchhoff_and_is_right():
    lens = micro("perfect")
    _, _, b = lens.image_of(OBJECT)
    targets = detector("perfect", b, count=24)
    hybrid, area = (
        aperture_field(
            source=OBJECT,
            lens=lens,
            targets=targets,
            wavelength=WAVELENGTH,
            method=method,
            accuracy=FieldAccuracy(tolerance=1e-5),
        )
        for method in ("boundary_wave", "kirchhoff")
    )
    assert hybrid.handed_over == 1.0
    np.testing.assert_allclose(hybrid.intensity, area.intensity, atol=1e-5 * area.intensity.max())


def test_fewest_zones_of_a_spherical_wave_are_its_fresnel_number():
    lens = micro("perfect")
    axial = PointSource(distance=OBJECT.distance)
    b = lens.image_of(axial)[2]
    wave = lens_wave(source=axial, lens=lens, wavelength=WAVELENGTH)
    for z in (0.9 * b, b, 1.3 * b):
        number = lens.radius**2 * abs(1 / z - 1 / b) / WAVELENGTH
        # Paraxial; the steepest ray of the cone lengthens both distances by its secant, 1.4 times at most.
        steepest = 1 + (lens.radius / (0.9 * b)) ** 2
        assert number / steepest**1.5 - 1e-6 <= fewest_zones(wave, z) <= number + 1e-6
    # Spherical aberration: the paraxial focus is the cusp of a caustic, on which the middle of the lens has no zones.
    aberrated = lens_wave(source=axial, lens=micro("parabolic"), wavelength=WAVELENGTH)
    assert fewest_zones(aberrated, b) < 1e-2 < 1.0 < fewest_zones(aberrated, 1.3 * b)


@pytest.mark.parametrize(("phase", "defocus"), [("perfect", 0.2e-6), ("stigmatic", 1e-6), ("parabolic", 0.5e-6)])
def test_a_large_grid_near_focus_is_left_to_kirchhoff(phase, defocus):
    """Rays and edge would take many times as long there, one target at a time."""
    lens = micro(phase)
    targets = detector(phase, lens.image_of(OBJECT)[2] + defocus, pitch=0.1e-6, count=200)
    settings = {"source": OBJECT, "lens": lens, "targets": targets, "wavelength": WAVELENGTH}
    hybrid, area = (
        aperture_field(method=method, accuracy=FieldAccuracy(tolerance=1e-6), **settings)
        for method in ("boundary_wave", "kirchhoff")
    )
    assert hybrid.method == "boundary_wave"
    assert hybrid.handed_over == 1.0
    np.testing.assert_array_equal(hybrid.field, area.field)
    assert hybrid.error == area.error
    assert hybrid.effort.nodes == area.effort.nodes


def test_interpolated_grid_equals_points():
    grid = detector("parabolic", 0.6e-3, pitch=0.3e-6, count=90)
    x, y, z = (c[::37] for c in grid.coordinates())
    fields = [
        aperture_field(
            source=OBJECT,
            lens=micro("parabolic"),
            targets=targets,
            wavelength=WAVELENGTH,
            method="boundary_wave",
            accuracy=FieldAccuracy(tolerance=0.1),
        ).field.ravel()
        for targets in (grid, TargetPoints(x=x, y=y, distance=z))
    ]
    np.testing.assert_allclose(fields[0][::37], fields[1], atol=5e-3 * np.abs(fields[1]).max())


def test_points_beyond_the_leading_term_are_refused():
    with pytest.raises(NotConvergedError, match="boundary wave"):
        aperture_field(
            source=OBJECT,
            lens=micro("parabolic"),
            targets=detector("parabolic", 0.568e-3),
            wavelength=WAVELENGTH,
            method="boundary_wave",
            accuracy=FieldAccuracy(tolerance=1e-6),
        )


def relative_intensity(field: np.ndarray, exact: np.ndarray) -> float:
    return float(np.linalg.norm(np.abs(field) ** 2 - np.abs(exact) ** 2) / np.linalg.norm(np.abs(exact) ** 2))


@pytest.mark.parametrize(
    ("phase", "distance", "pitch", "count"),
    [
        ("perfect", 0.3e-3, 0.4e-6, 220),
        ("perfect", 0.568e-3, 0.9e-6, 40),
        ("stigmatic", 0.36e-3, 0.55e-6, 100),
        ("parabolic", 0.568e-3, 0.9e-6, 40),
        ("parabolic", 0.7e-3, 0.4e-6, 220),
    ],
)
def test_a_looser_tolerance_costs_a_microlens_image_no_more_than_it_allows(phase, distance, pitch, count):
    """Against Kirchhoff's integral; what is left at the tightest tolerance is the leading term's own error."""
    targets = detector(phase, distance, pitch, count)
    settings = {"source": OBJECT, "lens": micro(phase), "wavelength": WAVELENGTH}
    exact = aperture_field(
        targets=targets, method="kirchhoff", accuracy=FieldAccuracy(tolerance=1e-6), **settings
    ).field
    wave = lens_wave(**settings)
    errors = {}
    for tolerance in (0.1, 0.02, 1e-3):
        done = unchecked_hybrid_field(
            wave=wave,
            kernel=KirchhoffKernel(wavelength=WAVELENGTH, obliquity="paper"),
            targets=targets,
            tolerance=tolerance,
            limits=Limits(),
        )
        assert done.handed_over == 0
        errors[tolerance] = relative_intensity(done.field, exact)
    for tolerance, error in errors.items():
        assert error < 1.3 * errors[1e-3] + 0.02 * tolerance
    assert 1e-4 < errors[1e-3] < 0.015


@pytest.mark.parametrize(
    ("x", "left", "right"),
    [
        (0.22923e-3, -0.40997e-3, 0.36363e-3),
        pytest.param(0.68180e-3, -0.46257e-3, 0.32455e-3, marks=pytest.mark.slow),
        pytest.param(1.41024e-3, -0.53673e-3, 0.25039e-3, marks=pytest.mark.slow),
        (2.00000e-3, -0.59681e-3, 0.19031e-3),
    ],
)
def test_a_looser_tolerance_costs_a_main_lens_field_no_more_than_it_allows(x, left, right):
    """A defocused f/3.8 lens with aberrations, its blur on the array of a plenoptic camera: corners, and random points.

    Corners of the grid lie on the rim of the rings that the field is interpolated from.
    """
    source = PointSource(x=x, distance=150e-3)
    lens = CircularLens(radius=12.5e-3 / 7.6, focal_length=12.5e-3, lens_phase="parabolic")
    count, distance, half = 405, 15.271e-3, (right - left) / 2
    grid = TargetGrid(
        x_start=left, y_start=-half, x_pitch=(right - left) / (count - 1), y_pitch=2 * half / (count - 1),
        x_count=count, y_count=count, distance=distance,
    )  # fmt: skip
    wave = lens_wave(source=source, lens=lens, wavelength=WAVELENGTH)
    kernel = KirchhoffKernel(wavelength=WAVELENGTH, obliquity="paper")
    ends = np.array([0, count - 1, count * (count - 1), count**2 - 1])
    pick = np.concatenate([ends, np.random.default_rng(3).integers(count**2, size=120)])
    points = TargetPoints(**{name: c[pick] for name, c in zip(("x", "y", "distance"), grid.coordinates(), strict=True)})
    nodes = nodes_for(wave, kernel, points, FieldAccuracy(tolerance=1e-4))
    exact = direct_sum(sample_wave(wave, nodes), kernel, *points.coordinates())
    common = {"wave": wave, "kernel": kernel, "limits": Limits()}
    own = relative_intensity(unchecked_hybrid_field(targets=points, tolerance=1e-4, **common).field, exact)
    assert 1e-3 < own < 0.015
    for tolerance in (0.1, 0.05):
        done = unchecked_hybrid_field(targets=grid, tolerance=tolerance, **common)
        assert relative_intensity(done.field.ravel()[pick], exact) < 1.3 * own + 0.02 * tolerance


def test_too_few_edge_nodes_show_in_the_stated_error():
    stated = [
        aperture_field(
            source=OBJECT,
            lens=micro("perfect"),
            targets=detector("perfect", 0.568e-3, count=20),
            wavelength=WAVELENGTH,
            method="boundary_wave",
            obliquity="textbook",
            accuracy=FieldAccuracy(tolerance=1e-3),
            counts=NodeCounts(radial=1, angular=nodes),
        ).error.intensity
        for nodes in (64, 16, 8)
    ]
    assert stated[0] < 0.01
    assert 2 * stated[0] < stated[1] < stated[2]


def test_error_falls_with_the_number_of_fresnel_zones():
    """The leading term: the relative error of the field falls at least as the wavelength."""
    wavelengths = 600e-9 / 2.0 ** np.arange(4)
    gap = []
    for wavelength in wavelengths:
        hybrid, area = (
            aperture_field(
                source=OBJECT,
                lens=micro("perfect"),
                targets=detector("perfect", 0.6e-3, pitch=1.1e-6, count=9),
                wavelength=wavelength,
                method=method,
                obliquity="textbook",
                accuracy=FieldAccuracy(tolerance=t),
            ).field
            for method, t in (("boundary_wave", 0.05), ("kirchhoff", 1e-8))
        )
        gap.append(np.linalg.norm(hybrid - area) / np.linalg.norm(area))
    slope = np.polyfit(np.log(wavelengths), np.log(gap), 1)[0]
    assert slope > 0.9

"""Spots of points on the axis against the general propagator and against the integral over the whole pupil."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tradestudy.errors import OutOfRangeError, UnaffordableError
from tradestudy.optics.axial_spot import axial_fresnel_spot, axial_kirchhoff_spot
from tradestudy.optics.propagation.aperture import aperture_field, lens_wave
from tradestudy.optics.propagation.lens import CircularLens, LensPhase, PointSource
from tradestudy.optics.propagation.result import Method
from tradestudy.optics.propagation.targets import TargetPoints
from tradestudy.optics.propagation.wave_optics import FieldAccuracy
from tradestudy.optics.quadrature import disc_nodes

STEREO = [  # focal length [m], f-number, wavelength [m]
    (8e-3, 1.4, 1e-6),
    (2e-3, 2.0, 550e-9),
    (30e-3, 5.6, 400e-9),
    (12e-3, 16.0, 1e-6),
]
MICROLENS = [(0.4e-3, 4.0, 550e-9), (0.4e-3, 4.0, 1e-6)]


def case(focal_length: float, f_number: float, wavelength: float, waves: float) -> dict[str, float]:
    """A plane behind the focus, and the point that stands so many waves of defocus from where it is sharp."""
    aperture, plane = focal_length / f_number, 1.02 * focal_length
    return {
        "wavelength": wavelength,
        "aperture_diameter": aperture,
        "focal_length": focal_length,
        "object_distance": 1.0 / (1.0 / focal_length - 1.0 / plane + 8.0 * wavelength * waves / aperture**2),
        "plane_distance": plane,
    }


def radii(of: dict[str, float], waves: float, count: int = 40) -> np.ndarray:
    """As far as pictures take the spot: the geometric blur and 12 periods λ N."""
    period = of["wavelength"] * of["plane_distance"] / of["aperture_diameter"]
    return np.linspace(0.0, (0.6 * 8.0 * abs(waves) + 12.0) * period, count)


def propagated(of: dict[str, float], r: np.ndarray, method: Method, lens_phase: LensPhase) -> tuple[np.ndarray, float]:
    source = PointSource(distance=of["object_distance"])
    lens = CircularLens(radius=of["aperture_diameter"] / 2, focal_length=of["focal_length"], lens_phase=lens_phase)
    field = aperture_field(
        source=source,
        lens=lens,
        targets=TargetPoints(x=r, y=0.0, distance=of["plane_distance"]),
        wavelength=of["wavelength"],
        method=method,
        accuracy=FieldAccuracy(tolerance=1e-6),
    )
    wave = lens_wave(source=source, lens=lens, wavelength=of["wavelength"], paraxial=method == "fresnel")
    pupil = disc_nodes(radius=lens.radius, radial_count=12, angular_count=24)
    return field.intensity / float(pupil.weights @ np.abs(wave.amplitude(pupil.x, pupil.y)) ** 2), field.error.intensity


def relative(found: np.ndarray, exact: np.ndarray) -> float:
    return float(np.linalg.norm(found - exact) / np.linalg.norm(exact))


@pytest.mark.parametrize("lens_phase", ["perfect", "parabolic"])
@pytest.mark.parametrize("waves", [0.0, 0.3, 3.0, 20.0, -3.0])
@pytest.mark.parametrize("lens", [*STEREO, *MICROLENS])
def test_kirchhoff_agrees_with_the_general_propagator(lens, waves: float, lens_phase: LensPhase) -> None:
    of = case(*lens, waves)
    r = radii(of, waves)
    exact, off = propagated(of, r, "kirchhoff", lens_phase)
    found, error = axial_kirchhoff_spot(r, **of, lens_phase=lens_phase)
    assert relative(found, exact) < off + error
    assert relative(found, exact) < 1e-5
    # Microlenses 20 waves out of focus blur over several of their own diameters: the series in η ends later.
    assert error < (1e-4 if lens in MICROLENS and waves == 20.0 else 1e-5)


def test_kirchhoff_is_the_integral_over_the_whole_pupil() -> None:
    """Square roots of squares summed on 400 × 400 nodes, with nothing taken off the paths: light that converges."""
    of = case(0.4e-3, 3.8, 550e-9, 2.0) | {"object_distance": -1.2e-3}
    r, b, a = np.linspace(0.0, 20e-6, 9), of["plane_distance"], of["object_distance"]
    k, rim = 2 * np.pi / of["wavelength"], of["aperture_diameter"] / 2
    pupil = disc_nodes(radius=rim, radial_count=400, angular_count=400)
    rho = np.hypot(pupil.x, pupil.y)
    before = -np.sqrt(a**2 + rho**2)
    field = np.exp(1j * k * (before - rho**2 / (2 * of["focal_length"]))) / before**2
    s = np.sqrt((pupil.x - r[:, np.newaxis]) ** 2 + pupil.y**2 + b**2)
    spot = np.abs((np.exp(1j * k * s) * b / (of["wavelength"] * s**2)) @ (pupil.weights * field)) ** 2
    exact = spot / float(pupil.weights @ np.abs(field) ** 2)
    found, error = axial_kirchhoff_spot(r, **of, lens_phase="parabolic")
    assert relative(found, exact) < max(error, 1e-9)
    assert error < 1e-6


@pytest.mark.parametrize("f_number", [2.0, 4.0])
def test_the_stated_error_covers_points_far_off_the_axis(f_number: float) -> None:
    """As far as the plane is behind the lens, where the series in η converges slowest."""
    of = case(0.4e-3, f_number, 1e-6, 1.0)
    r = np.linspace(0.9, 1.1, 40) * of["plane_distance"]
    exact, off = propagated(of, r, "kirchhoff", "perfect")
    found, error = axial_kirchhoff_spot(r, **of, lens_phase="perfect")
    assert relative(found, exact) < error + off
    assert error < 0.01


@pytest.mark.parametrize("waves", [0.0, 3.0, 20.0])
def test_fresnel_agrees_with_the_general_propagator(waves: float) -> None:
    of = case(8e-3, 2.0, 550e-9, waves)
    r = radii(of, waves, count=300)
    exact, off = propagated(of, r, "fresnel", "perfect")
    lengths = {key: of[key] for key in ("wavelength", "aperture_diameter", "plane_distance")}
    assert relative(axial_fresnel_spot(r, **lengths, defocus_waves=waves), exact) < off + 1e-10


def test_a_point_at_infinity_and_its_image_at_infinity_are_ordinary() -> None:
    of = case(8e-3, 4.0, 550e-9, 0.0)
    r = radii(of, 0.0)
    for lens_phase in ("perfect", "parabolic"):
        far, _ = axial_kirchhoff_spot(r, **of | {"object_distance": 1e9}, lens_phase=lens_phase)
        star, _ = axial_kirchhoff_spot(r, **of | {"object_distance": math.inf}, lens_phase=lens_phase)
        np.testing.assert_allclose(star, far, rtol=1e-6, atol=1e-6 * far.max())
    near, _ = axial_kirchhoff_spot(r, **of | {"object_distance": 8e-3 * (1 + 1e-9)}, lens_phase="perfect")
    parallel, _ = axial_kirchhoff_spot(r, **of | {"object_distance": 8e-3}, lens_phase="perfect")
    np.testing.assert_allclose(parallel, near, rtol=1e-6, atol=1e-6 * near.max())


def test_cases_beyond_the_axial_integral_are_refused() -> None:
    of = case(80e-3, 4.0, 550e-9, 0.0)
    with pytest.raises(OutOfRangeError, match="stigmatic"):
        axial_kirchhoff_spot(np.zeros(1), **of, lens_phase="stigmatic")
    with pytest.raises(UnaffordableError, match="use rays"):
        axial_kirchhoff_spot(np.zeros(1), **of | {"object_distance": 1e-5}, lens_phase="perfect")

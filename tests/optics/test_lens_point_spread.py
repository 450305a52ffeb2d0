"""From lens data to numbers in one call, against Airy's closed forms and against another program."""

from __future__ import annotations

import functools
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.special import j0, j1

from tradestudy import optics
from tradestudy.errors import OutOfRangeError

LENS = {"focal_length": 50e-3, "f_number": 8.0, "wavelength": 550e-9}
SCALE = 550e-9 * 8.0


@functools.cache
def airy() -> optics.LensPointSpread:
    return optics.point_spread(**LENS, method="fresnel", tolerance=1e-7)


def within(measured: optics.Measured, truth: object) -> bool:
    return bool(np.all(np.abs(measured.value - truth) <= measured.error))


def test_a_lens_without_aberration_has_airys_numbers_within_the_stated_errors() -> None:
    psf = airy()
    v = np.pi * np.hypot(psf.x[200], psf.y[190]) / SCALE
    assert psf.relative_intensity[190, 200] == pytest.approx((2 * j1(v) / v) ** 2, abs=1e-8)
    assert within(psf.strehl_ratio(), 1.0)
    assert within(psf.width(), 1.0289939 * SCALE) or psf.width().value == pytest.approx(1.0289939 * SCALE, rel=1e-7)
    radius = np.array([2e-6, 10e-6, 60e-6])
    v = np.pi * radius / SCALE
    assert within(psf.encircled_energy(radius), 1 - j0(v) ** 2 - j1(v) ** 2)
    s = np.array([0.1, 0.5, 0.9])
    truth = 2 / np.pi * (np.arccos(s) - s * np.sqrt(1 - s**2))
    for angle in (0.0, 0.6):
        mtf = psf.modulation_transfer(s / SCALE, angle=angle)
        assert within(mtf, truth)
        assert mtf.error.max() < 0.02


def test_a_star_is_the_limit_of_ever_farther_points() -> None:
    star = optics.point_spread(**LENS, source=optics.PointSource.at_infinity(angle_x=0.02, angle_y=-0.01), window=6)
    differences = []
    for distance in (1e4, 1e6):
        point = optics.PointSource(x=distance * np.tan(0.02), y=-distance * np.tan(0.01), distance=distance)
        near = optics.point_spread(**LENS, source=point, window=6)
        differences.append(np.linalg.norm(near.intensity - star.intensity) / np.linalg.norm(star.intensity))
        assert near.centre == pytest.approx(star.centre, rel=1e-5)
    assert differences[1] < differences[0] / 50 < 1e-5
    assert star.centre == pytest.approx((-50e-3 * np.tan(0.02), 50e-3 * np.tan(0.01)))


def test_metrics_take_fields_on_any_regular_grid_with_their_error() -> None:
    psf = airy()
    radius = np.array(6e-6)
    shares = []
    axis = np.linspace(-15e-6, 15e-6, 61)
    oblong = {"x_start": -15e-6, "y_start": -14e-6, "x_pitch": 0.4e-6, "y_pitch": 0.5e-6, "x_count": 78, "y_count": 60}
    for targets in (
        optics.TargetGrid(**oblong, distance=50e-3),
        optics.TargetPoints(x=axis, y=axis[:, None], distance=50e-3),
    ):
        field = optics.aperture_field(
            source=optics.PointSource.at_infinity(),
            lens=optics.CircularLens(radius=50e-3 / 16, focal_length=50e-3, lens_phase="perfect"),
            targets=targets,
            wavelength=550e-9,
            method="fresnel",
            accuracy=optics.FieldAccuracy(tolerance=1e-3),
        )
        share = optics.encircled_energy(field, centre=(0.0, 0.0), radius=radius)
        assert within(share, psf.encircled_energy(radius).value)
        assert share.error > field.error.intensity / 10
        assert np.isfinite(
            optics.modulation_transfer(field, frequency_x=np.array(5e4), frequency_y=np.array(0.0)).value
        )
        shares.append(float(share.value))
    assert shares[0] == pytest.approx(shares[1], abs=1e-4)


def test_points_that_form_no_grid_are_refused_by_metrics() -> None:
    field = optics.aperture_field(
        source=optics.PointSource.at_infinity(),
        lens=optics.CircularLens(radius=1e-3, focal_length=50e-3, lens_phase="perfect"),
        targets=optics.TargetPoints(x=np.arange(3) * 1e-6, y=0.0, distance=50e-3),
        wavelength=550e-9,
        method="kirchhoff",
        accuracy=optics.FieldAccuracy(tolerance=1e-3),
    )
    with pytest.raises(OutOfRangeError, match="TargetGrid"):
        optics.window_share(field)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"f_number": 0.0}, "f-number: 0 "),
        ({"focal_length": float("nan")}, "focal length: nan m "),
        ({"focal_length": -50e-3}, "focal length: -0.05 m "),
        ({"wavelength": 550.0}, r"wavelength: 550 m .*0\.00625 m.*550e-9"),
        ({"window": -1.0}, "window: -1 "),
        ({"window": 1.0}, r"window: 1 .*1\.5"),
        ({"focus_distance": 20e-3}, "focus beyond the focal length"),
        ({"tolerance": 1.0}, "tolerance"),
        ({"method": "fraunhofer"}, "method"),
    ],
)
def test_impossible_lenses_are_refused(change: dict[str, object], said: str) -> None:
    with pytest.raises(OutOfRangeError, match=said):
        optics.point_spread(**(LENS | change))


@pytest.mark.parametrize(
    ("distance", "said"),
    [(float("inf"), r"source .* not inf.*PointSource\.at_infinity"), (0.15, r"not 0\.15.*PointSource\(distance=…\)")],
)
def test_a_distance_instead_of_a_source_is_a_wrong_type(distance: float, said: str) -> None:
    with pytest.raises(TypeError, match=said):
        optics.point_spread(**(LENS | {"source": distance}))


def test_the_smallest_window_is_sampled_finely_enough_for_error_estimates() -> None:
    assert optics.point_spread(**LENS, window=1.5).width().error > 0.0


def test_frequencies_beyond_the_samples_are_refused_with_the_cutoff() -> None:
    cutoff = 1 / SCALE
    assert airy().modulation_transfer(1.01 * cutoff).value < 1e-3
    for frequency in (100 * cutoff, np.nan):
        with pytest.raises(OutOfRangeError, match=rf"{re.escape(f'{frequency:g}')} 1/m .*cutoff, {cutoff:g} 1/m"):
            airy().modulation_transfer(frequency)


def test_results_print_shape_spacing_and_error_instead_of_arrays() -> None:
    psf = optics.point_spread(**LENS, window=4)
    for text in ("kirchhoff", "81 × 81", f"{psf.spacing:.3g} m", f"{psf.relative_error:.1g}"):
        assert text in repr(psf)
    assert f"{psf.width()}" in repr(psf.width())
    many = psf.modulation_transfer(np.linspace(0, 1 / SCALE, 50))
    assert "(50,)" in repr(many)
    field = optics.aperture_field(
        source=optics.PointSource(distance=0.15),
        lens=optics.CircularLens(radius=1.5e-3, focal_length=12.5e-3, lens_phase="parabolic"),
        targets=optics.TargetGrid.centred(centre=(0.0, 0.0), pitch=0.5e-6, count=33, distance=13.64e-3),
        wavelength=550e-9,
        method="kirchhoff",
        accuracy=optics.FieldAccuracy(tolerance=1e-4),
    )
    for text in ("kirchhoff", "33 × 33", "5e-07", f"{field.error.intensity:.1g}"):
        assert text in repr(field)
    spot = optics.PointSpread(x=psf.x, y=psf.y, intensity=psf.intensity, pupil_power=1.0)
    assert all(len(repr(result)) < 150 for result in (psf, many, field, spot))


def test_the_plot_has_spot_cuts_energy_and_transfer(tmp_path: Path) -> None:
    psf = optics.point_spread(**LENS, window=8)
    figure = psf.plot(tmp_path / "spot.svg")
    assert (tmp_path / "spot.svg").stat().st_size > 10_000
    assert [axes.get_xlabel() for axes in figure.axes] == [
        "x, µm", "position, µm", "radius about the chief ray, µm", "spatial frequency, 1/mm",
    ]  # fmt: skip
    assert "± " in figure.axes[0].get_title()


@pytest.mark.parametrize("lens_phase", ["perfect", "stigmatic"])
def test_a_lens_focused_at_infinity_images_in_its_focal_plane(lens_phase: str) -> None:
    lens = {"focal_length": 50e-3, "f_number": 8, "wavelength": 550e-9, "tolerance": 1e-3, "lens_phase": lens_phase}
    default, focused = optics.point_spread(**lens), optics.point_spread(focus_distance=np.inf, **lens)
    np.testing.assert_array_equal(focused.intensity, default.intensity)
    near = optics.PointSource(distance=200.0)  # imaged 12.5 µm behind
    assert optics.point_spread(source=near, focus_distance=np.inf, **lens).strehl_ratio().value < 1.0


def test_a_spot_wider_than_its_window_has_no_width() -> None:
    """A source at 1 m before a 50 mm lens at f/2.8 focused at 2 m: geometry alone makes a disc of 460 µm."""
    lens = {"focal_length": 50e-3, "f_number": 2.8, "wavelength": 550e-9, "focus_distance": 2.0, "tolerance": 1e-3}
    blurred = optics.point_spread(source=optics.PointSource(distance=1.0), **lens)
    with pytest.raises(OutOfRangeError, match="window"):
        blurred.width()

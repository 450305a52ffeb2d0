"""Bounds of light pictures: their parts against closed forms, and a sample of the audit measured anew."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import integrate, special

from tests.campaigns.light_bounds import TOLERANCE, by_effect, by_slot, measured, ratios
from tests.campaigns.light_cases import LightCase, bounds_of, changes_of, random_case
from tradestudy.effects.light_scene import LightScene
from tradestudy.effects.light_slots import spectrum_in_picture
from tradestudy.effects.picture_change import (
    disc_envelope,
    edge_wave,
    frequencies,
    light_behind_neighbours,
    picture_change,
)
from tradestudy.effects.point_images import PointImage, diffraction_of_points
from tradestudy.optics.chain import DiscSource, LightPath, Microlenses, PixelGrid, square_centres
from tradestudy.optics.propagation import CircularLens, PointSource


def scene(**changes: object) -> LightScene:
    """The paper's light spot: 3 × 3 microlenses in focus on a disc of 4 mm at 150 mm."""
    path = LightPath(
        main_lens=CircularLens(radius=12.5e-3 / 7.6, focal_length=12.5e-3, lens_phase="parabolic"),
        microlenses=Microlenses(
            centres=square_centres(pitch=126.5e-6, count=3), focal_lengths=np.full(9, 0.432e-3), aperture="circular",
            aperture_width=0.432e-3 / 3.8, pitch=126.5e-6, layout="square", gaps="opaque", lens_phase="parabolic",
        ),
        array_distance=15.271e-3, detector_distance=0.587e-3, pixels=PixelGrid(pitch=5.5e-6, shape=(69, 69)),
    )  # fmt: skip
    spot = LightScene(path=path, source=DiscSource(diameter=4e-3, distance=0.15), wavelength=550e-9)
    return replace(spot, **changes)  # type: ignore[arg-type]  # of many types


def test_widths_are_those_of_two_thin_lenses() -> None:
    spot, image = scene(), 0.15 * 12.5e-3 / (0.15 - 12.5e-3)
    depth = 15.271e-3 - image
    assert spot.spot_radius == pytest.approx(2e-3 * image / 0.15 * 0.587e-3 / depth, rel=1e-9)
    assert spot.blur_on_array == pytest.approx(12.5e-3 / 7.6 * depth / image, rel=1e-9)
    assert spot.cutoff == pytest.approx(0.432e-3 / 3.8 / (550e-9 * 0.587e-3), rel=1e-9)
    assert spot.blur_on_detector < 0.1e-6  # in focus, but for the rounding of what the study declares
    assert spot.main_fresnel_number == pytest.approx(
        (12.5e-3 / 7.6) ** 2 / 550e-9 * depth / (image * 15.271e-3), rel=1e-9
    )


def test_the_edge_wave_is_that_of_a_straight_edge() -> None:
    """∫ |U − U_rays|² dv at a straight edge from Fresnel's integrals, put around a disc of √(2N) in v."""

    def beside(v: float) -> float:
        s, c = special.fresnel(v)
        return float(((0.5 - c) ** 2 + (0.5 - s) ** 2) / 2)  # the same on both sides

    total = 2 * integrate.quad(beside, 0, 60, limit=2000)[0] + 2 / (2 * math.pi**2 * 60)  # its tail is 1/(2 π² v²)
    for zones in (4.0, 100.0):
        share = total * 2 * math.pi / (math.pi * math.sqrt(2 * zones))  # rim over area, lengths in v
        assert edge_wave(zones) == pytest.approx(math.sqrt(share), rel=2e-3)
    assert edge_wave(0.0) == 1.0


def test_a_change_of_the_picture_follows_parseval() -> None:
    """Twice as wide in space, a Gaussian change has half the norm: ∫ exp(−2 (f l)²) f df = 1/(4 l²)."""
    spot = scene()
    f = frequencies(spot)
    unit = picture_change(spot, np.exp(-((f * 30e-6) ** 2)))
    assert picture_change(spot, 0.1 * np.exp(-((f * 30e-6) ** 2))) == pytest.approx(0.1 * unit, rel=1e-12)
    ratio = unit / picture_change(spot, np.exp(-((f * 60e-6) ** 2)))
    assert ratio == pytest.approx(2.0, rel=2e-3)


def test_exact_rays_land_where_spherical_aberration_sends_them() -> None:
    """W = r⁴/8 (1/a³ + 1/b³) on axis: the slope is r³/2 of the same, R³/4 of it the root mean square over the pupil."""
    radius, a, f = 0.2e-3, 0.1, 10e-3
    b = a * f / (a - f)
    image = PointImage(
        lens=CircularLens(radius=radius, focal_length=f, lens_phase="parabolic"), source=PointSource(distance=a),
        image_distance=b, centre=(0.0, 0.0), wavelength=550e-9,
    )  # fmt: skip
    assert image.displacement == pytest.approx(b * radius**3 / 4 * (1 / a**3 + 1 / b**3), rel=2e-3)
    assert image.blur < 1e-12
    assert image.brightness == pytest.approx(radius**2 / b**2, rel=2e-3)  # the mean of 2 r²/b²
    perfect = replace(image, lens=replace(image.lens, lens_phase="perfect"))
    assert perfect.displacement < 1e-12


def test_half_of_the_airy_pattern_lies_within_the_radius_of_the_bound() -> None:
    image = PointImage(
        lens=CircularLens(radius=2e-3, focal_length=10e-3, lens_phase="perfect"), source=PointSource(distance=0.1),
        image_distance=0.1 / 9, centre=(0.0, 0.0), wavelength=550e-9,
    )  # fmt: skip
    v = 2 * math.pi / 550e-9 * 2e-3 / (0.1 / 9) * image.diffraction_radius
    assert 1 - special.j0(v) ** 2 - special.j1(v) ** 2 == pytest.approx(0.5, abs=2e-4)


def test_the_envelope_of_a_disc_is_never_exceeded_and_hardly_too_large() -> None:
    x = np.linspace(1e-6, 200.0, 200_001)
    envelope, exact = disc_envelope(x), np.abs(2 * special.j1(x) / x)
    assert np.all(envelope >= exact * (1 - 1e-15))
    assert np.max(exact[x > 1.5] / envelope[x > 1.5]) > 0.999
    peaks = special.jnp_zeros(1, 60)
    assert np.all(disc_envelope(peaks) < 1.05 * np.abs(2 * special.j1(peaks) / peaks))


def test_diffraction_takes_as_much_light_beyond_a_border_as_an_airy_pattern_has_outside() -> None:
    """All rays land in the middle of their cells, m from the border: 1 − E(m) = J₀² + J₁², its rings averaged."""
    spot = scene()
    spot.__dict__["margins"] = np.full(3, 60e-6)
    v = math.pi * spot.cutoff * 60e-6 + np.linspace(-math.pi, math.pi, 2001)
    assert light_behind_neighbours(spot) == pytest.approx(np.mean(special.j0(v) ** 2 + special.j1(v) ** 2), rel=0.02)


def test_a_wider_pupil_needs_kirchhoff_sooner() -> None:
    def bound(radius: float) -> float:
        image = PointImage(
            lens=CircularLens(radius=radius, focal_length=10e-3, lens_phase="parabolic"),
            source=PointSource(distance=0.1), image_distance=0.1 / 9, centre=(0.0, 0.0), wavelength=550e-9,
        )  # fmt: skip
        return diffraction_of_points([image]).model("fresnel").change_of("psf_width")

    assert 1e-4 < bound(0.2e-3) < bound(0.5e-3) < bound(1.5e-3)


def test_one_wavelength_has_nothing_to_leave_out() -> None:
    slot = spectrum_in_picture(scene(), wavelengths=np.array([550e-9]), weights=np.ones(1))
    assert slot.model_names == ("off",)
    assert slot.model("off").change_of("pixel_intensity") == 0.0


def test_no_bound_is_stated_inside_the_focal_spot() -> None:
    path = scene().path
    focused = scene(path=replace(path, array_distance=0.15 * 12.5e-3 / (0.15 - 12.5e-3) + 2e-6))
    bounds = bounds_of(LightCase(scene=focused, wavelengths=np.array([500e-9, 600e-9])))
    assert all(math.isinf(bound) for bound in bounds.values())
    assert "focal spot" in focused.why_unbounded


def test_bounds_hold_on_every_light_path_of_the_audit_and_are_not_idle() -> None:
    """What was kept of the audit against bounds computed anew; none, or all of a path, may be without a bound."""
    changes, _ = measured()
    pairs = by_effect(changes)
    bounded = [{number for number, bound, _ in found if math.isfinite(bound)} for found in pairs.values()]
    everywhere = [{number for number, _, _ in found} for found in pairs.values()]
    stated = set.union(*bounded)
    assert all(numbers == stated & of for numbers, of in zip(bounded, everywhere, strict=True))
    assert len(stated) > 0.85 * len(changes) > 200
    exceeded = {(number, name) for name, found in pairs.items() for number, bound, change in found if change > bound}
    # One miss in 2 300, by 0.6 of its bound. A bound of the boundary wave that held case 45, too, would be idle: three
    # times this one, which is 56 times the change in the median.
    assert exceeded <= {(45, "main_lens_diffraction: boundary_wave")}
    for slot, found in by_slot(pairs).items():
        assert np.median(ratios(found)) <= 30.0, slot


@pytest.mark.parametrize("number", [2, 52, 258])
def test_bounds_hold_on_random_light_paths(number: int) -> None:
    case, kept = random_case(np.random.default_rng([0, number])), measured()[0][str(number)]
    bounds = bounds_of(case)
    for effect, change in changes_of(case, TOLERANCE, sorted(bounds)).items():
        assert change <= bounds[effect] < 100.0, effect
        assert change == pytest.approx(kept[effect], rel=0.01, abs=1e-4), effect

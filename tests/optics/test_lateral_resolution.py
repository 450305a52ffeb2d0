"""Lateral resolution on the object: against rays traced through the camera, and its depth of field against scanning."""

import math

import mpmath
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.depth_of_field import depth_of_field
from tradestudy.optics.lateral_resolution import (
    depth_of_field_at_resolution,
    focused_plenoptic_depth_of_field_at_resolution,
    focused_plenoptic_lateral_resolution,
    lateral_resolution,
)
from tradestudy.optics.plenoptic_depth_of_field import relay_depth_of_field, view_pupil_diameter

LENS = {
    "focus_distance": 0.15,
    "focal_length": 12.5e-3,
    "pupil_diameter": 12.5e-3 / 3.8,
    "sample_pitch": 5.5e-6,
    "wavelength": 550e-9,
}
RELAY = {
    "mla_distance": 14.773e-3,
    "microlens_gap": 0.568e-3,
    "focal_length": 12.5e-3,
    "inverse_focus_virtual_depth": 0.4565,
    "microlens_aperture": 126.5e-6,
    "pixel_pitch": 5.5e-6,
    "pupil_diameter": 12.5e-3 / 3.8,
    "wavelength": 550e-9,
}
RADIUS_IN_WAVELENGTHS_PER_F_NUMBER = float(mpmath.besseljzero(1, 1) / mpmath.pi)  # first zero of J₁, over π: 1.2197


def through_thin_lens(height, slope, centre, focal_length):
    """Bend a ray at a thin lens."""
    return slope - (height - centre) / focal_length


def test_sample_of_a_conventional_camera_is_a_pixel_seen_from_the_middle_of_the_lens():
    a0, f, p = LENS["focus_distance"], LENS["focal_length"], LENS["sample_pitch"]
    b0 = 1 / (1 / f - 1 / a0)
    for a in (0.08, 0.15, 1.0):
        # Straight rays from two neighbouring pixels through the centre of the lens to the object.
        assert lateral_resolution(a, **LENS).sampling == pytest.approx(abs(0 - p) / b0 * a, rel=1e-12)


def test_blur_on_the_object_is_where_rays_of_one_pixel_through_the_edge_of_the_pupil_land():
    a0, f, A = LENS["focus_distance"], LENS["focal_length"], LENS["pupil_diameter"]
    b0 = 1 / (1 / f - 1 / a0)
    for a in (0.05, 0.12, 0.2, 3.0):
        landed = []
        for edge in (-A / 2, A / 2):  # backwards from the middle of the sensor
            slope = through_thin_lens(edge, edge / b0, 0.0, f)
            landed.append(edge + slope * a)
        assert lateral_resolution(a, **LENS).blur == pytest.approx(abs(landed[1] - landed[0]), rel=1e-9)


def test_focus_at_infinity_blurs_by_the_pupil_everywhere():
    at_infinity = {**LENS, "focus_distance": math.inf}
    found = lateral_resolution([0.1, 1.0, 100.0], **at_infinity)
    np.testing.assert_allclose(found.blur, LENS["pupil_diameter"], rtol=1e-14)
    np.testing.assert_allclose(found.size[:2], LENS["pupil_diameter"], rtol=1e-14)
    assert found.size[2] == pytest.approx(100.0 * 5.5e-6 / 12.5e-3, rel=1e-14)


def test_unfocused_plenoptic_camera_samples_by_its_microlenses():
    pupil = view_pupil_diameter(0.15, focal_length=12.5e-3, pixel_pitch=5.5e-6, microlens_focal_length=0.432e-3)
    unfocused = {**LENS, "pupil_diameter": pupil, "sample_pitch": 126.5e-6}
    conventional = lateral_resolution(0.15, **LENS).sampling
    assert lateral_resolution(0.15, **unfocused).sampling / conventional == pytest.approx(23.0, rel=1e-12)


def test_focused_plenoptic_camera_keeps_one_over_virtual_depth_of_the_resolution():
    # At 150 mm |v| is 2: twice the size that one pixel has in the main lens's image plane, f/(a − f) its magnification.
    in_focus = {**RELAY, "inverse_focus_virtual_depth": 0.5}
    assert focused_plenoptic_lateral_resolution(0.15, **in_focus).size == pytest.approx(2 * 5.5e-6 * 11.0, rel=1e-3)


@pytest.mark.parametrize("distance", [0.10, 0.115, 0.2, 0.6])
def test_focused_plenoptic_resolution_is_what_backward_rays_of_the_pixels_cover(distance):
    z, b_L, f, w0, D, p, *_ = RELAY.values()
    f_L = b_L / (1 + w0)

    def object_height(pixel, on_lens):
        """A ray from a point of the detector through a point of the central microlens, back to the object."""
        slope = (on_lens - pixel) / b_L
        slope = through_thin_lens(on_lens, slope, 0.0, f_L)
        on_main_lens = on_lens + slope * z
        return on_main_lens + through_thin_lens(on_main_lens, slope, 0.0, f) * distance

    sample = abs(object_height(p, 0.0) - object_height(0.0, 0.0))
    blur = abs(object_height(0.0, D / 2) - object_height(0.0, -D / 2))
    found = focused_plenoptic_lateral_resolution(distance, **RELAY)
    assert found.sampling == pytest.approx(sample, rel=1e-9)
    assert found.blur == pytest.approx(blur, rel=1e-9)


@pytest.mark.parametrize(
    ("distance", "pupil", "f_number", "expected"),
    [
        # f/32, 12 mm: A 375 µm. Rayleigh's 1.22 λ a/A by hand: 1.21967 · 0.55 µm · 800.
        (0.3, 375e-6, 800.0, 536.65e-6),
        (0.15, 12.5e-3 / 3.8, 45.6, 30.589e-6),
    ],
)
def test_diffraction_is_the_angle_of_the_first_dark_ring_of_the_pupil_times_the_distance(
    distance, pupil, f_number, expected
):
    lens = {**LENS, "pupil_diameter": pupil, "focus_distance": distance}
    found = lateral_resolution(distance, **lens)
    assert found.diffraction == pytest.approx(expected, rel=1e-4)
    assert found.diffraction == pytest.approx(RADIUS_IN_WAVELENGTHS_PER_F_NUMBER * 550e-9 * f_number, rel=1e-9)
    assert found.size == pytest.approx(max(found.sampling, found.diffraction))


def test_the_airy_radius_is_where_the_diffraction_integral_of_the_pupil_vanishes():
    """∫ exp(i k x ξ/a) over the disc of the pupil, by quadrature: zero at the stated radius, not before."""
    a, A, wavelength = 0.3, 375e-6, 550e-9
    radius = float(lateral_resolution(a, **{**LENS, "pupil_diameter": A, "focus_distance": a}).diffraction)

    def amplitude(offset):
        half, wave = A / 2, 2 * mpmath.pi / wavelength * offset / a
        return float(
            mpmath.quad(lambda xi: 2 * mpmath.sqrt(abs(half**2 - xi**2)) * mpmath.cos(wave * xi), [-half, 0, half])
            / (mpmath.pi * half**2)
        )

    assert abs(amplitude(radius)) < 1e-6
    assert all(amplitude(share * radius) > 0.02 for share in (0.0, 0.5, 0.95))


def test_the_part_of_the_pupil_behind_one_microlens_diffracts_unless_it_exceeds_the_pupil():
    f, z, D, A = (RELAY[k] for k in ("focal_length", "mla_distance", "microlens_aperture", "pupil_diameter"))
    for distance, limited_by_pupil in ((0.15, False), (0.2, False), (1.0, False), (0.0815, True)):
        b = 1 / (1 / f - 1 / distance)
        part = D * b / abs(z - b)
        assert (part > A) == limited_by_pupil
        expected = RADIUS_IN_WAVELENGTHS_PER_F_NUMBER * 550e-9 * distance / min(part, A)
        found = focused_plenoptic_lateral_resolution(distance, **RELAY)
        assert found.diffraction == pytest.approx(expected, rel=1e-9)
    # By hand at 150 mm: 1.21967 · 0.55 µm · 0.568/0.1265 = 3.012 µm on the sensor, |v| 2.0007, 11 times larger.
    assert focused_plenoptic_lateral_resolution(0.15, **RELAY).diffraction == pytest.approx(66.3e-6, rel=1e-3)


@settings(max_examples=120, deadline=None)
@given(
    focus=st.floats(1.1, 100.0),
    f_number=st.floats(1.2, 20.0),
    pitch=st.floats(1e-6, 200e-6),
    resolution=st.floats(2e-6, 5e-3),
    wavelength=st.floats(300e-9, 3e-6),
)
def test_limits_at_equal_resolution_enclose_exactly_the_resolved_distances(
    focus, f_number, pitch, resolution, wavelength
):
    f = 20e-3
    part = {
        "focus_distance": focus * f,
        "focal_length": f,
        "pupil_diameter": f / f_number,
        "sample_pitch": pitch,
        "wavelength": wavelength,
    }
    found = depth_of_field_at_resolution(resolution, **part)
    distance = np.geomspace(0.05 * f, 1e4 * f, 3001)
    resolved = lateral_resolution(distance, **part).size <= resolution
    edge = (
        np.zeros(distance.shape, dtype=bool)
        if found.empty
        else (np.isclose(distance, found.near, rtol=1e-9) | np.isclose(distance, found.far, rtol=1e-9))
    )
    np.testing.assert_array_equal(found.contains(distance)[~edge], resolved[~edge])
    assert bool(found.reason) == bool(found.empty)


@settings(max_examples=150, deadline=None)
@given(
    array=st.floats(0.9, 1.4),
    gap=st.floats(0.2e-3, 1e-3),
    inverse=st.floats(-0.6, 0.6),
    aperture=st.floats(50e-6, 200e-6),
    pixel=st.floats(2e-6, 10e-6),
    resolution=st.floats(3e-6, 2e-3),
    f_number=st.floats(1.2, 20.0),
    wavelength=st.floats(300e-9, 3e-6),
    keplerian=st.booleans(),
)
def test_limits_of_a_microlens_type_enclose_exactly_the_resolved_distances(
    array, gap, inverse, aperture, pixel, resolution, f_number, wavelength, keplerian
):
    f = 12.5e-3
    part = {
        "mla_distance": array * f,
        "microlens_gap": gap,
        "focal_length": f,
        "inverse_focus_virtual_depth": inverse,
        "microlens_aperture": aperture,
        "pixel_pitch": pixel,
        "pupil_diameter": f / f_number,
        "wavelength": wavelength,
    }
    assume(array * f > gap)
    found = focused_plenoptic_depth_of_field_at_resolution(resolution, keplerian=keplerian, **part)
    shift = np.geomspace(1e-5, 3.0, 3001) * f
    distance = f + f * f / shift
    side = (array * f - f - shift >= 0) == keplerian
    resolved = (focused_plenoptic_lateral_resolution(distance, **part).size <= resolution) & side
    edge = (
        np.zeros(distance.shape, dtype=bool)
        if found.empty
        else (np.isclose(distance, found.near, rtol=1e-7) | np.isclose(distance, found.far, rtol=1e-7))
    )
    np.testing.assert_array_equal(found.contains(distance)[~edge], resolved[~edge])
    assert bool(found.reason) == bool(found.empty)


def test_plenoptic_gain_in_depth_of_field_shrinks_when_resolution_is_made_equal():
    # A conventional camera held to one pixel is asked for a detail that the plenoptic one does not resolve.
    per_pixel = relay_depth_of_field(
        0.4565,
        blur_diameter=5.5e-6,
        keplerian=True,
        **{name: RELAY[name] for name in ("microlens_aperture", "microlens_gap", "mla_distance", "focal_length")},
    )
    conventional = depth_of_field(0.15, 12.5e-3, 12.5e-3 / 3.8, 5.5e-6)
    resolution = float(focused_plenoptic_lateral_resolution(0.165, **RELAY).size)
    fair = depth_of_field_at_resolution(resolution, **{**LENS, "focus_distance": 0.165})
    plenoptic = focused_plenoptic_depth_of_field_at_resolution(resolution, keplerian=True, **RELAY)
    assert plenoptic.extent / fair.extent < 0.5 * per_pixel.extent / conventional.extent


@pytest.mark.parametrize(
    "call",
    [
        lambda: lateral_resolution(-1.0, **LENS),
        lambda: lateral_resolution(1.0, **{**LENS, "focus_distance": 0.01}),
        lambda: depth_of_field_at_resolution(0.0, **LENS),
        lambda: depth_of_field_at_resolution(1e-3, **{**LENS, "sample_pitch": 0.0}),
        lambda: focused_plenoptic_lateral_resolution(0.01, **RELAY),
        lambda: focused_plenoptic_depth_of_field_at_resolution(
            1e-3, keplerian=True, **{**RELAY, "microlens_gap": -1e-3}
        ),
    ],
)
def test_impossible_arguments_are_refused(call):
    with pytest.raises(OutOfRangeError) as refused:
        call()
    assert refused.value.remedy


def test_a_resolution_that_nothing_reaches_is_reported():
    too_fine = depth_of_field_at_resolution(1e-6, **LENS)
    assert too_fine.empty
    assert all(cause in too_fine.reason for cause in ("samples", "blur", "diffraction"))
    beyond = focused_plenoptic_depth_of_field_at_resolution(1e-6, keplerian=True, **RELAY)
    assert beyond.empty
    assert "this side of the array" in beyond.reason

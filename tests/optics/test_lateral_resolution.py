"""Lateral resolution on the object: against rays traced through the camera, and its depth of field against scanning."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.depth_of_field import depth_of_field, relay_depth_of_field, view_pupil_diameter
from tradestudy.optics.lateral_resolution import (
    depth_of_field_at_resolution,
    focused_plenoptic_depth_of_field_at_resolution,
    focused_plenoptic_lateral_resolution,
    lateral_resolution,
)

LENS = {"focus_distance": 0.15, "focal_length": 12.5e-3, "pupil_diameter": 12.5e-3 / 3.8, "sample_pitch": 5.5e-6}
RELAY = {
    "mla_distance": 14.773e-3,
    "microlens_gap": 0.568e-3,
    "focal_length": 12.5e-3,
    "inverse_focus_virtual_depth": 0.4565,
    "microlens_aperture": 126.5e-6,
    "pixel_pitch": 5.5e-6,
}


def through_thin_lens(height, slope, centre, focal_length):
    """Bend a ray at a thin lens."""
    return slope - (height - centre) / focal_length


def test_sample_of_a_conventional_camera_is_a_pixel_seen_from_the_middle_of_the_lens():
    a0, f, p = LENS["focus_distance"], LENS["focal_length"], LENS["sample_pitch"]
    b0 = 1 / (1 / f - 1 / a0)
    small_pupil = {**LENS, "pupil_diameter": 1e-9}
    for a in (0.08, 0.15, 1.0):
        # Straight rays from two neighbouring pixels through the centre of the lens to the object.
        assert lateral_resolution(a, **small_pupil) == pytest.approx(abs(0 - p) / b0 * a, rel=1e-12)


def test_blur_on_the_object_is_where_rays_of_one_pixel_through_the_edge_of_the_pupil_land():
    a0, f, A = LENS["focus_distance"], LENS["focal_length"], LENS["pupil_diameter"]
    b0 = 1 / (1 / f - 1 / a0)
    for a in (0.05, 0.12, 0.2, 3.0):
        landed = []
        for edge in (-A / 2, A / 2):  # backwards from the middle of the sensor
            slope = through_thin_lens(edge, edge / b0, 0.0, f)
            landed.append(edge + slope * a)
        assert lateral_resolution(a, **LENS) == pytest.approx(abs(landed[1] - landed[0]), rel=1e-9)


def test_focus_at_infinity_blurs_by_the_pupil_everywhere():
    at_infinity = {**LENS, "focus_distance": math.inf}
    np.testing.assert_allclose(lateral_resolution([0.1, 1.0], **at_infinity), LENS["pupil_diameter"], rtol=1e-14)
    assert lateral_resolution(100.0, **at_infinity) == pytest.approx(100.0 * 5.5e-6 / 12.5e-3, rel=1e-14)


def test_unfocused_plenoptic_camera_samples_by_its_microlenses():
    pupil = view_pupil_diameter(0.15, focal_length=12.5e-3, pixel_pitch=5.5e-6, microlens_focal_length=0.432e-3)
    unfocused = {**LENS, "pupil_diameter": pupil, "sample_pitch": 126.5e-6}
    conventional = lateral_resolution(0.15, **LENS)
    assert lateral_resolution(0.15, **unfocused) / conventional == pytest.approx(23.0, rel=1e-12)


def test_focused_plenoptic_camera_keeps_one_over_virtual_depth_of_the_resolution():
    # At 150 mm |v| is 2: twice the size that one pixel has in the main lens's image plane, f/(a − f) its magnification.
    in_focus = {**RELAY, "inverse_focus_virtual_depth": 0.5}
    assert focused_plenoptic_lateral_resolution(0.15, **in_focus) == pytest.approx(2 * 5.5e-6 * 11.0, rel=1e-3)


@pytest.mark.parametrize("distance", [0.10, 0.115, 0.2, 0.6])
def test_focused_plenoptic_resolution_is_what_backward_rays_of_the_pixels_cover(distance):
    z, b_L, f, w0, D, p = RELAY.values()
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
    assert found == pytest.approx(max(sample, blur), rel=1e-9)


@settings(max_examples=120, deadline=None)
@given(
    focus=st.floats(1.1, 100.0),
    f_number=st.floats(1.2, 20.0),
    pitch=st.floats(1e-6, 200e-6),
    resolution=st.floats(2e-6, 5e-3),
)
def test_limits_at_equal_resolution_enclose_exactly_the_resolved_distances(focus, f_number, pitch, resolution):
    f = 20e-3
    part = {
        "focus_distance": focus * f,
        "focal_length": f,
        "pupil_diameter": f / f_number,
        "sample_pitch": pitch,
    }
    found = depth_of_field_at_resolution(resolution, **part)
    distance = np.geomspace(0.05 * f, 1e4 * f, 3001)
    resolved = lateral_resolution(distance, **part) <= resolution
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
    keplerian=st.booleans(),
)
def test_limits_of_a_microlens_type_enclose_exactly_the_resolved_distances(
    array, gap, inverse, aperture, pixel, resolution, keplerian
):
    f = 12.5e-3
    part = {
        "mla_distance": array * f,
        "microlens_gap": gap,
        "focal_length": f,
        "inverse_focus_virtual_depth": inverse,
        "microlens_aperture": aperture,
        "pixel_pitch": pixel,
    }
    assume(array * f > gap)
    found = focused_plenoptic_depth_of_field_at_resolution(resolution, keplerian=keplerian, **part)
    shift = np.geomspace(1e-5, 3.0, 3001) * f
    distance = f + f * f / shift
    side = (array * f - f - shift >= 0) == keplerian
    resolved = (focused_plenoptic_lateral_resolution(distance, **part) <= resolution) & side
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
    resolution = float(focused_plenoptic_lateral_resolution(0.165, **RELAY))
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
    assert all(cause in too_fine.reason for cause in ("samples", "blur"))
    beyond = focused_plenoptic_depth_of_field_at_resolution(1e-6, keplerian=True, **RELAY)
    assert beyond.empty
    assert "this side of the array" in beyond.reason

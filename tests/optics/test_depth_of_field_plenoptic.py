"""Depth of field of plenoptic cameras: against rays traced through both lenses, published figures, another program."""

import math

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.depth_of_field import union
from tradestudy.optics.plenoptic_depth_of_field import (
    inverse_focus_virtual_depth,
    microlens_focal_length,
    relay_blur_diameter,
    relay_depth_of_field,
    touching_inverse_virtual_depths,
    view_pupil_diameter,
)

PIXEL = 5.5e-6
# Total covering plane at 150 mm with matched f-numbers.
R5_RELAY = {
    "microlens_aperture": 126.5e-6,
    "microlens_gap": 126.5e-6 * 3.8 * 12.5e-3 * (150 / 137.5) / (12.5e-3 - 2 * 126.5e-6 * 3.8),
    "mla_distance": 12.5e-3 * (150 / 137.5) / (1 - 2 * 126.5e-6 * 3.8 / 12.5e-3),
    "focal_length": 12.5e-3,
}

# ---- microlenses ----------------------------------------------------------------------------------------------------


def test_published_virtual_depths_of_three_touching_types():
    inverse = touching_inverse_virtual_depths(pixels_per_lens=23.0)
    smallest, largest = 1 / (inverse + 1 / 23), 1 / (inverse - 1 / 23)  # sharp where |1/v − 1/v₀| ≤ c/D
    np.testing.assert_allclose(smallest, [2.00, 2.42, 3.07], atol=5e-3)
    np.testing.assert_allclose(largest, [2.42, 3.07, 4.18], atol=5e-3)
    np.testing.assert_allclose(largest[:-1], smallest[1:], rtol=1e-14)


def test_published_depth_of_field_of_the_three_types_in_front_of_the_camera():
    assert R5_RELAY["microlens_gap"] == pytest.approx(0.568e-3, abs=0.5e-6)
    assert R5_RELAY["mla_distance"] == pytest.approx(14.773e-3, abs=1e-6)
    inverse = touching_inverse_virtual_depths(pixels_per_lens=23.0)
    found = relay_depth_of_field(inverse, **R5_RELAY, blur_diameter=PIXEL, keplerian=True)
    np.testing.assert_allclose(found.near, [0.150, 0.187, 0.307], atol=0.6e-3)
    np.testing.assert_allclose(found.far[:2], [0.187, 0.307], atol=0.6e-3)
    assert found.far[2] == math.inf
    together = union(found)
    assert together.complete
    assert len(together.overlaps) == 0


def test_types_given_by_focal_lengths_are_those_they_were_designed_with():
    for sign in (1, -1):
        inverse = sign * touching_inverse_virtual_depths(pixels_per_lens=23.0)
        f_L = microlens_focal_length(inverse, 0.5e-3)
        np.testing.assert_allclose(1 / f_L, 1 / (0.5e-3 / inverse) + 1 / 0.5e-3, rtol=1e-14)  # 1/a_L + 1/b_L
        np.testing.assert_allclose(inverse_focus_virtual_depth(f_L, 0.5e-3), inverse, rtol=1e-13)


def micro_image_blur(object_distance, inverse_focus, part):
    """Trace the rays of an axial point through main lens and both edges of a central microlens to the detector."""
    with mpmath.workdps(30):
        a, w0 = mpmath.mpf(object_distance), mpmath.mpf(inverse_focus)
        f, z, b_L, D = (
            mpmath.mpf(part[k]) for k in ("focal_length", "mla_distance", "microlens_gap", "microlens_aperture")
        )
        f_L = b_L / (1 + w0)
        hits = []
        for edge in (D / 2, -D / 2):
            # A ray leaves the main lens at height h with slope h (1/a − 1/f): it meets the array at h + z slope.
            bend = 1 / a - 1 / f
            height = edge / (1 + z * bend)
            slope = height * bend - edge / f_L
            hits.append(edge + slope * b_L)
        return float(abs(hits[0] - hits[1]))


@settings(max_examples=150, deadline=None)
@given(
    inverse=st.floats(-0.6, 0.6),
    focus=st.floats(0.9, 1.3),
    gap=st.floats(0.2e-3, 1e-3),
    blur=st.floats(1e-6, 20e-6),
)
def test_rays_through_the_edges_of_a_microlens_give_the_allowed_blur(inverse, focus, gap, blur):
    part = {
        "focal_length": 12.5e-3,
        "mla_distance": 12.5e-3 * focus,
        "microlens_gap": gap,
        "microlens_aperture": 120e-6,
    }
    keplerian = inverse > 0
    found = relay_depth_of_field(inverse, **part, blur_diameter=blur, keplerian=keplerian)
    if found.empty:
        assert found.reason
        return
    assert 0 < found.near <= found.far
    for limit in (float(found.near), float(found.far)):
        # A limit in the focal plane ends that side of the array; next to it a double holds few digits of a − f.
        if math.isfinite(limit) and 1e-5 < limit - 12.5e-3 < 1e3:
            assert micro_image_blur(limit, inverse, part) == pytest.approx(blur, rel=1e-9)
    if math.isinf(found.far):
        assert micro_image_blur(1e12, inverse, part) <= blur * (1 + 1e-6)
    middle = 2 / (1 / float(found.near) + 1 / float(found.far))
    if math.isfinite(middle):
        assert micro_image_blur(middle, inverse, part) <= blur * (1 + 1e-9)


def test_blur_of_a_microlens_agrees_with_its_edge_rays():
    for a in (0.12, 0.15, 0.3, 2.0):
        part = R5_RELAY
        s = part["focal_length"] ** 2 / (a - part["focal_length"])
        v = (part["mla_distance"] - part["focal_length"] - s) / part["microlens_gap"]
        found = relay_blur_diameter(v, 0.4, part["microlens_aperture"])
        assert found == pytest.approx(micro_image_blur(a, 0.4, part), rel=1e-9)


def test_galilean_types_are_ordered_the_other_way_and_reach_infinity_with_the_first():
    part = {**R5_RELAY, "mla_distance": 11.6e-3, "microlens_gap": 0.43e-3}
    inverse = -touching_inverse_virtual_depths(pixels_per_lens=23.0)
    found = relay_depth_of_field(inverse, **part, blur_diameter=PIXEL, keplerian=False)
    assert found.far[0] == math.inf
    np.testing.assert_allclose(found.near[:-1], found.far[1:], rtol=1e-9)
    assert union(found).complete


def test_types_without_a_sharp_distance_give_a_reason():
    other_side = relay_depth_of_field(-0.5, **R5_RELAY, blur_diameter=PIXEL, keplerian=True)
    assert other_side.empty
    assert "other side" in other_side.reason
    beyond = relay_depth_of_field(0.1, **R5_RELAY, blur_diameter=PIXEL, keplerian=True)
    assert beyond.empty
    assert "beyond infinity" in beyond.reason
    nothing = relay_depth_of_field(0.4, **R5_RELAY, blur_diameter=np.nan, keplerian=True)
    assert nothing.empty
    assert "no blur" in nothing.reason


def test_types_beyond_an_infinitely_distant_image_are_refused_with_the_number_that_fits():
    with pytest.raises(OutOfRangeError, match="≤ 5") as refused:
        touching_inverse_virtual_depths(pixels_per_lens=20.0, types=6)
    assert refused.value.value == "6"
    assert len(touching_inverse_virtual_depths(pixels_per_lens=20.0, types=5)) == 5


# ---- refusals -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "call",
    [
        lambda: inverse_focus_virtual_depth(-0.4e-3, 0.5e-3),
        lambda: microlens_focal_length(-1.0, 0.5e-3),
        lambda: relay_blur_diameter(2.0, 0.5, 0.0),
        lambda: relay_depth_of_field(0.4, **{**R5_RELAY, "mla_distance": 0.0}, blur_diameter=PIXEL, keplerian=True),
        lambda: touching_inverse_virtual_depths(pixels_per_lens=0.0),
        lambda: view_pupil_diameter(0.15, focal_length=12.5e-3, pixel_pitch=0.0, microlens_focal_length=0.432e-3),
    ],
)
def test_impossible_lenses_and_criteria_are_refused_with_a_remedy(call):
    with pytest.raises(OutOfRangeError) as refused:
        call()
    assert refused.value.remedy
    assert refused.value.limit

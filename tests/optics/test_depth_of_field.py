"""Depth of field: against thin lenses at 40 digits, rays traced from the pupil's edge, and published figures."""

import itertools
import math

import mpmath
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.depth_of_field import (
    DepthOfField,
    blur_allowance,
    depth_of_field,
    diffraction_diameter,
    diffraction_inclusive_depth_of_field,
    focus_stack,
    hyperfocal_distance,
    images_needed,
    intersection,
    inverse_focus_virtual_depth,
    microlens_focal_length,
    object_distance_of_magnification,
    object_distance_of_working_distance,
    plan_focus_stack,
    refocus_distance,
    refocused_depth_of_field,
    relay_blur_diameter,
    relay_depth_of_field,
    touching_inverse_virtual_depths,
    union,
    view_depth_of_field,
    view_pupil_diameter,
    virtual_depth_limits,
)

R5_LENS = {"focal_length": 12.5e-3, "pupil_diameter": 12.5e-3 / 3.8}
PIXEL = 5.5e-6
# Total covering plane at 150 mm with matched f-numbers.
R5_RELAY = {
    "microlens_aperture": 126.5e-6,
    "microlens_gap": 126.5e-6 * 3.8 * 12.5e-3 * (150 / 137.5) / (12.5e-3 - 2 * 126.5e-6 * 3.8),
    "mla_distance": 12.5e-3 * (150 / 137.5) / (1 - 2 * 126.5e-6 * 3.8 / 12.5e-3),
    "focal_length": 12.5e-3,
}

cameras = st.fixed_dictionaries(
    {
        "focal_length": st.floats(2e-3, 0.3),
        "f_number": st.floats(1.2, 32.0),
        "focus": st.floats(1.05, 1e4),  # in focal lengths
        "blur": st.floats(1e-6, 100e-6),
    }
)


def lens(camera):
    f = camera["focal_length"]
    return camera["focus"] * f, f, f / camera["f_number"], camera["blur"]


# ---- one lens -------------------------------------------------------------------------------------------------------


@settings(max_examples=150, deadline=None)
@given(camera=cameras)
def test_limits_agree_with_the_thin_lens_at_forty_digits(camera):
    a0, f, A, c = lens(camera)
    found = depth_of_field(a0, f, A, c)
    with mpmath.workdps(40):
        a0_, f_, A_, c_ = (mpmath.mpf(x) for x in (a0, f, A, c))
        b0 = 1 / (1 / f_ - 1 / a0_)

        def distance(b):
            return 1 / (1 / f_ - 1 / b)

        near = distance(b0 / (1 - c_ / A_)) if c_ != A_ else f_
        assert abs(found.near / near - 1) < 1e-12
        b_far = b0 / (1 + c_ / A_)
        condition = float(f_ / abs(b_far - f_))  # what one rounding of the inputs does to the far limit
        assume(condition < 1e6)
        if b_far > f_:
            assert abs(found.far / distance(b_far) - 1) < 1e-12 * max(1.0, condition / 100)
        else:
            assert found.far == math.inf


def blur_of_edge_rays(distance, a0, f, A):
    """Trace the two rays of an axial point through the edges of the pupil to the sensor."""
    b0 = 1 / (1 / f - 1 / a0)
    heights = []
    for edge in (A / 2, -A / 2):
        slope = (0.0 if math.isinf(distance) else edge / distance) - edge / f
        heights.append(edge + slope * b0)
    return abs(heights[0] - heights[1])


@settings(max_examples=150, deadline=None)
@given(camera=cameras)
def test_edge_rays_from_every_limit_make_the_blur_allowed(camera):
    a0, f, A, c = lens(camera)
    assume(c / A > 1e-5)  # below it, rounding of the edge ray (1e-16 A) shows at 1e-9 of the blur
    found = depth_of_field(a0, f, A, c)
    assert blur_of_edge_rays(float(found.near), a0, f, A) == pytest.approx(c, rel=1e-9)
    if np.isfinite(found.far):
        assert blur_of_edge_rays(float(found.far), a0, f, A) == pytest.approx(c, rel=1e-9)
    else:
        assert blur_of_edge_rays(math.inf, a0, f, A) <= c * (1 + 1e-9)


@settings(max_examples=150, deadline=None)
@given(camera=cameras, factor=st.floats(1.0, 3.0))
def test_limits_enclose_the_focus_and_are_monotone_in_aperture_and_blur(camera, factor):
    a0, f, A, c = lens(camera)
    found = depth_of_field(a0, f, A, c)
    assert 0 < found.near <= a0 <= found.far
    for wider in (depth_of_field(a0, f, A, c * factor), depth_of_field(a0, f, A / factor, c)):
        assert wider.near <= found.near
        assert wider.far >= found.far * (1 - 1e-15)


@settings(max_examples=150, deadline=None)
@given(camera=cameras)
def test_far_limit_is_infinite_exactly_from_the_hyperfocal_distance_on(camera):
    _, f, A, c = lens(camera)
    hyperfocal = float(hyperfocal_distance(f, A, c))
    assert hyperfocal == pytest.approx(f**2 / (camera["f_number"] * c) + f, rel=1e-14)
    at = depth_of_field([hyperfocal, hyperfocal * 2, math.inf], f, A, c)
    assert np.all(np.isinf(at.far))
    assert at.near[2] == pytest.approx(f * A / c, rel=1e-12)  # focused at infinity: one focal length before H
    assume(A / c > 2.0)
    assert np.isfinite(depth_of_field(hyperfocal * (1 - 1e-9), f, A, c).far)


def test_no_blur_allowed_leaves_the_plane_of_focus():
    found = depth_of_field([0.15, 2.0, math.inf], 12.5e-3, 3e-3, 0.0)
    np.testing.assert_array_equal(found.far[2], math.inf)
    np.testing.assert_allclose(found.near[:2], [0.15, 2.0], rtol=1e-14)
    np.testing.assert_allclose(found.far[:2], [0.15, 2.0], rtol=1e-14)


def test_published_depth_of_field_of_the_conventional_camera():
    found = depth_of_field(0.15, R5_LENS["focal_length"], R5_LENS["pupil_diameter"], PIXEL)
    assert found.extent == pytest.approx(5.5e-3, rel=5e-3)
    assert hyperfocal_distance(**R5_LENS, blur_diameter=PIXEL) == pytest.approx(7.49, abs=5e-3)


def test_mahli_by_its_scale_on_the_object():
    a = object_distance_of_magnification(18.3e-3, 7.4 / 15.0)
    assert a == pytest.approx(55.4e-3, abs=0.05e-3)
    extent = depth_of_field(a, 18.3e-3, 18.3e-3 / 9.8, np.array([1.0, 2.0]) * 7.4e-6).extent
    np.testing.assert_allclose(extent, [0.89e-3, 1.78e-3], atol=5e-6)
    nearer = object_distance_of_working_distance(22.5e-3, reference_working_distance=25e-3, reference_object_distance=a)
    assert a - nearer == pytest.approx(2.5e-3, rel=1e-12)
    assert 0.75e-3 < depth_of_field(nearer, 18.3e-3, 18.3e-3 / 9.8, 7.4e-6).extent < 0.89e-3


# ---- diffraction ----------------------------------------------------------------------------------------------------


def test_diffraction_diameters_are_those_of_the_airy_pattern():
    with mpmath.workdps(30):
        ring = 2 * mpmath.besseljzero(1, 1) / mpmath.pi
        half = 2 * mpmath.findroot(lambda x: (2 * mpmath.besselj(1, x) / x) ** 2 - 0.5, 1.6) / mpmath.pi
        assert diffraction_diameter(1e-6, 1.0, "airy-diameter") == pytest.approx(float(ring) * 1e-6, rel=1e-14)
        assert diffraction_diameter(1e-6, 1.0, "fwhm") == pytest.approx(float(half) * 1e-6, rel=1e-14)
    assert diffraction_diameter(1e-6, 1.0, "none") == 0.0


@pytest.mark.parametrize(
    ("f_number", "magnification", "diameter_um"),
    [(3.8, 12.5 / 137.5, 5.6), (0.5871 / 0.1265, 0.0, 6.2), (9.8, 7.4 / 15.0, 19.6)],
)
def test_published_airy_diameters_of_the_flagships(f_number, magnification, diameter_um):
    found = diffraction_diameter(550e-9, f_number * (1 + magnification), "airy-diameter")
    assert found * 1e6 == pytest.approx(diameter_um, abs=0.06)


def test_diffraction_alone_beyond_the_criterion_is_said_in_words_and_numbers():
    found = diffraction_inclusive_depth_of_field(
        [0.15, 1.0], *R5_LENS.values(), PIXEL, wavelength=550e-9, measure="airy-diameter"
    )
    assert found.empty.tolist() == [True, False]
    assert "5.56 µm" in found.reason
    assert "5.5 µm" in found.reason
    assert found.extent[0] == 0.0
    assert not found.contains(0.15)[0]


def test_blur_and_diffraction_meet_the_criterion_in_quadrature_at_the_limits():
    a0, (f, A), c = 0.15, R5_LENS.values(), 2 * PIXEL
    for measure in ("airy-diameter", "fwhm"):
        found = diffraction_inclusive_depth_of_field(a0, f, A, c, wavelength=550e-9, measure=measure)
        spot = float(diffraction_diameter(550e-9, 1 / (1 / f - 1 / a0) / A, measure))
        for limit in (found.near, found.far):
            assert math.hypot(blur_of_edge_rays(float(limit), a0, f, A), spot) == pytest.approx(c, rel=1e-9)
        assert found.reason == ""
    geometric = diffraction_inclusive_depth_of_field(a0, f, A, c, wavelength=550e-9, measure="none")
    assert geometric.extent == depth_of_field(a0, f, A, c).extent


def test_stopping_down_ends_by_shrinking_the_diffraction_inclusive_figure():
    f_numbers = np.array([2.0, 3.8, 8.0, 16.0])
    found = diffraction_inclusive_depth_of_field(
        0.15, 12.5e-3, 12.5e-3 / f_numbers, 2 * PIXEL, wavelength=550e-9, measure="airy-diameter"
    )
    assert found.extent[1] > found.extent[0]
    assert found.extent[3] == 0.0


def test_a_spot_as_large_as_the_criterion_leaves_the_plane_of_focus():
    allowance = blur_allowance([5e-6, 5e-6], [5e-6, 3e-6])
    np.testing.assert_allclose(allowance.geometric_diameter, [0.0, 4e-6], rtol=1e-12)
    assert not np.any(allowance.exceeded)


# ---- stacks and unions ----------------------------------------------------------------------------------------------


def limits(*pairs):
    near, far = np.array(pairs, dtype=float).T
    return DepthOfField(near=near, far=far)


@pytest.mark.parametrize(
    ("slices", "covered", "gaps", "overlaps"),
    [
        (limits((1, 2), (3, 4)), [[1, 2], [3, 4]], [[2, 3]], []),
        (limits((3, 4), (1, 2)), [[1, 2], [3, 4]], [[2, 3]], []),
        (limits((1, 3), (2, 4)), [[1, 4]], [], [[2, 3]]),
        (limits((1, 9), (2, 4), (3, 5)), [[1, 9]], [], [[2, 5]]),
        (limits((1, 2), (2, 3)), [[1, 3]], [], []),
        (limits((1, 2 - 1e-12), (2, 3)), [[1, 3]], [], []),
        (limits((1, 2 + 1e-12), (2, 3)), [[1, 3]], [], []),
        (limits((1, 2), (np.nan, np.nan), (5, np.inf)), [[1, 2], [5, np.inf]], [[2, 5]], []),
        (limits((1, np.inf), (5, np.inf)), [[1, np.inf]], [], [[5, np.inf]]),
        (limits((np.nan, np.nan)), [], [], []),
    ],
)
def test_union_shows_what_is_covered_what_is_missing_and_what_is_doubled(slices, covered, gaps, overlaps):
    found = union(slices)
    for rows, expected in ((found.covered, covered), (found.gaps, gaps), (found.overlaps, overlaps)):
        np.testing.assert_allclose(rows, np.reshape(expected, (-1, 2)), rtol=1e-11)
    assert found.complete == (len(covered) == 1)


def test_two_lenses_of_a_stereo_rig_share_what_both_keep_sharp():
    both = intersection(limits((1, 4), (1, 2), (np.nan, np.nan)), limits((2, np.inf), (3, 4), (1, 2)))
    np.testing.assert_array_equal(both.near, [2, np.nan, np.nan])
    np.testing.assert_array_equal(both.far, [4, np.nan, np.nan])
    assert "do not meet" in both.reason


@settings(max_examples=60, deadline=None)
@given(
    near=st.floats(0.03, 0.5),
    stretch=st.one_of(st.floats(1.001, 3.0), st.just(math.inf)),
    f_number=st.floats(1.5, 16.0),
    blur_px=st.floats(0.5, 4.0),
)
def test_planned_stack_covers_the_range_with_the_fewest_images(near, stretch, f_number, blur_px):
    part = {"focal_length": 12.5e-3, "pupil_diameter": 12.5e-3 / f_number, "blur_diameter": blur_px * PIXEL}
    needed = images_needed(near, near * stretch, **part)
    assume(needed <= 300)
    stack = plan_focus_stack(near, near * stretch, images=needed, **part)
    assert stack.images == needed
    assert stack.union.complete
    assert stack.union.covered[0, 0] <= near * (1 + 1e-9)
    assert stack.union.covered[0, 1] >= near * stretch * (1 - 1e-9)
    if needed > 1:
        short = plan_focus_stack(near, near * stretch, images=needed - 1, **part)
        missing = (
            len(short.union.gaps) > 0 or short.union.covered[0, 0] > near or short.union.covered[-1, 1] < near * stretch
        )
        assert missing


def test_stack_reports_the_gaps_between_coarse_slices():
    stack = focus_stack([0.160, 0.140, 0.150], **R5_LENS, blur_diameter=PIXEL)
    assert stack.focus_distances.tolist() == [0.140, 0.150, 0.160]
    single = depth_of_field(np.array([0.140, 0.150, 0.160]), *R5_LENS.values(), PIXEL)
    expected = np.stack((single.far[:-1], single.near[1:]), axis=-1)
    np.testing.assert_allclose(stack.union.gaps, expected, rtol=1e-14)
    assert np.all(stack.union.gaps[:, 1] > stack.union.gaps[:, 0])


def test_blur_given_per_image_stays_with_its_image():
    stack = focus_stack([0.2, 0.1], **R5_LENS, blur_diameter=[20e-6, 5e-6])
    assert stack.slices.near[0] == depth_of_field(0.1, *R5_LENS.values(), 5e-6).near
    assert stack.slices.near[1] == depth_of_field(0.2, *R5_LENS.values(), 20e-6).near


# ---- microlenses ----------------------------------------------------------------------------------------------------


def test_published_virtual_depths_of_three_touching_types():
    inverse = touching_inverse_virtual_depths(pixels_per_lens=23.0)
    smallest, largest = virtual_depth_limits(inverse, PIXEL, 23 * PIXEL)
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
def test_rays_through_the_edges_of_a_microlens_make_the_blur_allowed(inverse, focus, gap, blur):
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


def test_blur_of_a_microlens_is_what_its_edge_rays_make():
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


def test_types_without_a_sharp_distance_say_why():
    other_side = relay_depth_of_field(-0.5, **R5_RELAY, blur_diameter=PIXEL, keplerian=True)
    assert other_side.empty
    assert "other side" in other_side.reason
    beyond = relay_depth_of_field(0.1, **R5_RELAY, blur_diameter=PIXEL, keplerian=True)
    assert beyond.empty
    assert "beyond infinity" in beyond.reason
    nothing = relay_depth_of_field(0.4, **R5_RELAY, blur_diameter=np.nan, keplerian=True)
    assert nothing.empty
    assert "no blur" in nothing.reason


def test_types_that_would_pass_an_infinitely_distant_image_are_refused_with_how_many_fit():
    with pytest.raises(OutOfRangeError, match="≤ 5") as refused:
        touching_inverse_virtual_depths(pixels_per_lens=20.0, types=6)
    assert refused.value.value == "6"
    assert len(touching_inverse_virtual_depths(pixels_per_lens=20.0, types=5)) == 5


# ---- unfocused ------------------------------------------------------------------------------------------------------

# PlenoptiSign 1.1.3 (C. Hahne, A. Aggoun, SoftwareX 10, 2019), run as a program of its own: refocusing distances d
# from the microlens array in mm for its shift parameter a. Thin lenses (H1H2 = 0 for both) with the exit pupil in the
# plane of the main lens (d_A' = b_U); d_f is its focusing distance, also from the array.
PLENOPTISIGN = [
    pytest.param(
        {"f": 193.2935, "d_f": 4000.0, "b_U": 203.66317189676258, "p_p": 0.009, "p_M": 0.125, "f_s": 2.75},
        {
            0.0: 4000.0,
            0.5: 1585.217740623372,
            1.0: 1048.0917548011657,
            2.0: 678.7104313191852,
            -1 / 11: 5768.467851081213,
        },
        id="its default camera as a thin lens",
    ),
    pytest.param(
        {"f": 12.5, "d_f": 163.63636363636363, "b_U": 13.636363636363637, "p_p": 0.0055, "p_M": 0.1265, "f_s": 0.432},
        {
            0.5: 43.59131139493473,
            1.0: 30.27522491706789,
            0.25: 63.57377541360283,
            -0.1: 769.3190977972486,
            -0.25: math.inf,
        },
        id="a hand lens focused at 150 mm",
    ),
]


@pytest.mark.parametrize(("camera", "distances"), PLENOPTISIGN)
def test_refocusing_distances_are_those_of_an_independent_program(camera, distances):
    c = {name: value * 1e-3 for name, value in camera.items()}
    a0 = c["d_f"] - c["b_U"]
    B = view_pupil_diameter(a0, focal_length=c["f"], pixel_pitch=c["p_p"], microlens_focal_length=c["f_s"])
    found = refocus_distance(list(distances), a0, focal_length=c["f"], view_pupil_diameter=B, microlens_pitch=c["p_M"])
    expected = np.array(list(distances.values())) * 1e-3
    np.testing.assert_allclose(found + c["b_U"], expected, rtol=1e-11)


UNFOCUSED = {"focal_length": 12.5e-3, "pixel_pitch": PIXEL, "microlens_focal_length": 0.432e-3}


def test_views_of_a_point_refocused_on_are_shifted_by_whole_shifts():
    # Rays from the point through the middles of neighbouring views land so many microlenses apart on the array.
    a0, f, p = 0.15, 12.5e-3, 126.5e-6
    B = float(view_pupil_diameter(a0, **UNFOCUSED))
    z = 1 / (1 / f - 1 / a0)
    for shift in (-0.1, 0.2, 0.7, 1.0):
        a = float(refocus_distance(shift, a0, focal_length=f, view_pupil_diameter=B, microlens_pitch=p))
        on_array = [h + h * (1 / a - 1 / f) * z for h in (0.0, B)]
        assert (on_array[1] - on_array[0]) / p == pytest.approx(shift, rel=1e-9)


def test_refocusing_ends_at_infinity_and_at_the_focal_plane():
    a0, f, p = 0.15, 12.5e-3, 126.5e-6
    B = float(view_pupil_diameter(a0, **UNFOCUSED))
    found = refocus_distance([-5.0, -1.0, B / p, 3.0], a0, focal_length=f, view_pupil_diameter=B, microlens_pitch=p)
    assert found.tolist() == [math.inf, math.inf, f, f]


def test_single_views_are_sharp_up_to_a_shift_of_one_microlens():
    a0, f, p = 0.5, 50e-3, 126.5e-6
    B = float(view_pupil_diameter(a0, focal_length=f, pixel_pitch=20e-6, microlens_focal_length=0.6e-3))
    view = view_depth_of_field(a0, focal_length=f, view_pupil_diameter=B, blur_diameter=p)
    ends = refocus_distance([1.0, -1.0], a0, focal_length=f, view_pupil_diameter=B, microlens_pitch=p)
    np.testing.assert_allclose([view.near, view.far], ends, rtol=1e-12)


def test_adding_shifted_views_blurs_by_the_criterion_at_the_limits_of_a_refocused_image():
    a0, f, A, p = 0.15, 12.5e-3, 12.5e-3 / 3.8, 126.5e-6
    z = 1 / (1 / f - 1 / a0)
    for refocused in (0.11, 0.15, 0.2):
        found = refocused_depth_of_field(refocused, a0, focal_length=f, pupil_diameter=A, blur_diameter=p)
        for limit in (float(found.near), float(found.far)):
            # Rays through both edges of the pupil, each view moved so that the refocused point lines up.
            on_array = {a: [h + h * (1 / a - 1 / f) * z for h in (-A / 2, A / 2)] for a in (limit, refocused)}
            spread = [x - moved for x, moved in zip(on_array[limit], on_array[refocused], strict=True)]
            assert abs(spread[1] - spread[0]) == pytest.approx(p, rel=1e-9)


# ---- refusals -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "call",
    [
        lambda: depth_of_field(10e-3, 12.5e-3, 3e-3, 5e-6),
        lambda: depth_of_field(1.0, 12.5e-3, 3e-3, -5e-6),
        lambda: depth_of_field(1.0, 12.5e-3, 0.0, 5e-6),
        lambda: hyperfocal_distance(-12.5e-3, 3e-3, 5e-6),
        lambda: diffraction_diameter(0.0, 4.0, "fwhm"),
        lambda: diffraction_diameter(550e-9, 4.0, "rayleigh"),
        lambda: blur_allowance(0.0, 1e-6),
        lambda: images_needed(0.2, 0.1, **R5_LENS, blur_diameter=PIXEL),
        lambda: images_needed(0.01, 0.1, **R5_LENS, blur_diameter=PIXEL),
        lambda: images_needed(0.1, 0.2, **R5_LENS, blur_diameter=0.0),
        lambda: plan_focus_stack(0.1, 0.2, images=0, **R5_LENS, blur_diameter=PIXEL),
        lambda: plan_focus_stack(0.1, 0.2, images=2, **R5_LENS, blur_diameter=1.0),
        lambda: inverse_focus_virtual_depth(-0.4e-3, 0.5e-3),
        lambda: microlens_focal_length(-1.0, 0.5e-3),
        lambda: relay_blur_diameter(2.0, 0.5, 0.0),
        lambda: relay_depth_of_field(0.4, **{**R5_RELAY, "mla_distance": 0.0}, blur_diameter=PIXEL, keplerian=True),
        lambda: touching_inverse_virtual_depths(pixels_per_lens=0.0),
        lambda: refocus_distance(1.0, 0.01, focal_length=12.5e-3, view_pupil_diameter=1e-4, microlens_pitch=1e-4),
        lambda: view_pupil_diameter(0.15, **{**UNFOCUSED, "pixel_pitch": 0.0}),
        lambda: refocused_depth_of_field(0.01, 0.15, **R5_LENS, blur_diameter=1e-4),
        lambda: object_distance_of_magnification(18.3e-3, 0.0),
        lambda: object_distance_of_working_distance(
            -1.0, reference_working_distance=0.02, reference_object_distance=0.05
        ),
    ],
)
def test_impossible_lenses_and_criteria_are_refused_with_a_remedy(call):
    with pytest.raises(OutOfRangeError) as refused:
        call()
    assert refused.value.remedy
    assert refused.value.limit


def test_one_image_is_enough_when_the_blur_allowed_exceeds_the_pupil():
    assert images_needed(0.05, math.inf, **R5_LENS, blur_diameter=4e-3) == 1


def test_arrays_broadcast():
    found = depth_of_field(np.array([0.1, 0.2, 0.3])[:, np.newaxis], 12.5e-3, np.array([1e-3, 3e-3]), 5e-6)
    assert found.near.shape == found.far.shape == (3, 2)
    for i, j in itertools.product(range(3), range(2)):
        assert found.far[i, j] == depth_of_field([0.1, 0.2, 0.3][i], 12.5e-3, [1e-3, 3e-3][j], 5e-6).far

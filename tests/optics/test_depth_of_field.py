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
    object_distance_of_magnification,
    plan_focus_stack,
    union,
)

R5_LENS = {"focal_length": 12.5e-3, "pupil_diameter": 12.5e-3 / 3.8}
PIXEL = 5.5e-6

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
def test_edge_rays_from_every_limit_give_the_allowed_blur(camera):
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


def test_the_mahli_camera_given_by_its_scale_on_the_object():
    a = object_distance_of_magnification(18.3e-3, 7.4 / 15.0)
    assert a == pytest.approx(55.4e-3, abs=0.05e-3)
    extent = depth_of_field(a, 18.3e-3, 18.3e-3 / 9.8, np.array([1.0, 2.0]) * 7.4e-6).extent
    np.testing.assert_allclose(extent, [0.89e-3, 1.78e-3], atol=5e-6)
    nearer = a - (25e-3 - 22.5e-3)  # another working distance; the principal plane stays where it is in the lens
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


def test_diffraction_alone_beyond_the_criterion_is_reported_with_numbers():
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
        lambda: object_distance_of_magnification(18.3e-3, 0.0),
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

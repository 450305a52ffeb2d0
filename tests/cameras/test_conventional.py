"""Conventional cameras: published depths of field, rays traced to the sensor, and stacks held to covering by search."""

import math
from dataclasses import replace

import mpmath
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from tradestudy.cameras.calibrated_pair import CalibratedCamera
from tradestudy.cameras.conventional.design import ConventionalCamera, FocusStackPlan
from tradestudy.cameras.focus import BlurCriterion, EveryObjectFocus, SingleLensFocus
from tradestudy.cameras.parts import Lens, Sensor
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.lens_model import IDEAL

MAHLI_LENS = Lens(focal_length=18.3e-3, f_number=9.8)
MAHLI_SENSOR = Sensor(columns=1600, rows=1200, pixel_pitch=7.4e-6)
R5_LENS = Lens(focal_length=12.5e-3, f_number=3.8)
R5_SENSOR = Sensor(columns=2048, rows=2048, pixel_pitch=5.5e-6)


def sharp(blur_px=1.0, measure="none"):
    return BlurCriterion(blur_px=blur_px, measure=measure, wavelength=550e-9)


def traced_blur(distance, focus_distance, lens):
    """Where the two rays from the edges of the pupil land on the sensor, apart, at thirty digits."""
    with mpmath.workdps(30):
        a, a0, f = (mpmath.mpf(value) for value in (distance, focus_distance, lens.focal_length))
        half = f / mpmath.mpf(lens.f_number) / 2
        sensor = 1 / (1 / f - 1 / a0)
        landed = [edge + (edge / a - edge / f) * sensor for edge in (half, -half)]
        return float(abs(landed[0] - landed[1]))


def mahli(focus_distance, stack=None):
    return ConventionalCamera(lens=MAHLI_LENS, sensor=MAHLI_SENSOR, focus_distance=focus_distance, stack=stack)


def test_depth_of_field_published_for_a_working_distance_of_22_5_millimetres():
    # The instrument's description: about 14.5 µm per pixel and a depth of field of about 0.9 mm; the paper: 0.82 mm.
    camera = mahli(18.3e-3 * (1 + 14.5 / 7.4))
    found = camera.focus.lateral_resolution(camera.focus_distance, 550e-9)
    assert found.sampling == pytest.approx(14.5e-6, rel=1e-12)
    # By hand: N_w = 9.8 (1 + 7.4/14.5) = 14.80, Airy radius 1.22 · 0.55 µm · 14.80 = 9.93 µm on pixels of 7.4 µm.
    assert found.size == found.diffraction == pytest.approx(9.93e-6 * 14.5 / 7.4, rel=1e-3)
    assert camera.focus.sharp_range(sharp()).extent == pytest.approx(0.84e-3, abs=5e-6)
    assert camera.focus.sharp_range(sharp()).extent == pytest.approx(0.82e-3, rel=0.05)


def test_depth_of_field_published_for_the_lens_of_the_r5():
    camera = ConventionalCamera(lens=R5_LENS, sensor=R5_SENSOR, focus_distance=0.15)
    assert camera.focus.sharp_range(sharp()).extent == pytest.approx(5.5e-3, rel=5e-3)
    at_hyperfocal = ConventionalCamera(lens=R5_LENS, sensor=R5_SENSOR, focus_distance=7.4881)
    assert at_hyperfocal.focus.sharp_range(sharp()).slices.far[0] > 1e3
    beyond = ConventionalCamera(lens=R5_LENS, sensor=R5_SENSOR, focus_distance=7.50)
    assert beyond.focus.sharp_range(sharp()).slices.far[0] == math.inf
    assert beyond.focus.sharp_range(sharp()).extent == math.inf


@settings(max_examples=80, deadline=None)
@given(
    focal_length=st.floats(5e-3, 0.1),
    f_number=st.floats(1.4, 16.0),
    focus=st.floats(1.5, 200.0),
    blur_px=st.floats(0.3, 4.0),
    pixel=st.floats(2e-6, 15e-6),
)
def test_rays_from_the_limits_blur_by_just_what_is_allowed(focal_length, f_number, focus, blur_px, pixel):
    lens = Lens(focal_length=focal_length, f_number=f_number)
    assume(blur_px * pixel < lens.pupil_diameter / 4)
    found = SingleLensFocus(lens=lens, focus_distance=focus * focal_length, sample_pitch=pixel)
    limits = found.sharp_range(sharp(blur_px)).slices
    near, far = float(limits.near[0]), float(limits.far[0])
    assert near < found.focus_distance < far
    assert traced_blur(near, found.focus_distance, lens) == pytest.approx(blur_px * pixel, rel=1e-9)
    if math.isfinite(far) and far < 1e4 * focal_length * focus:  # beyond, the condition of the limit eats the digits
        assert traced_blur(far, found.focus_distance, lens) == pytest.approx(blur_px * pixel, rel=1e-9)
    hyperfocal = focal_length**2 / (f_number * blur_px * pixel) + focal_length
    if not math.isclose(found.focus_distance, hyperfocal, rel_tol=1e-9):
        assert math.isinf(far) == (found.focus_distance > hyperfocal)


@settings(max_examples=60, deadline=None)
@given(
    f_number=st.floats(2.0, 11.0),
    wider=st.floats(1.01, 2.0),
    blur_px=st.floats(0.5, 3.0),
    focus=st.floats(0.05, 2.0),
)
def test_the_geometric_depth_of_field_grows_with_blur_and_f_number(f_number, wider, blur_px, focus):
    def extent(number, blur):
        lens = Lens(focal_length=18.3e-3, f_number=number)
        focused = SingleLensFocus(lens=lens, focus_distance=focus, sample_pitch=7.4e-6)
        return focused.sharp_range(sharp(blur)).extent

    assert extent(f_number * wider, blur_px) >= extent(f_number, blur_px)
    assert extent(f_number, blur_px * wider) >= extent(f_number, blur_px)


def test_diffraction_alone_beyond_the_criterion_is_reported_with_both_diameters():
    found = mahli(55.4e-3).focus.sharp_range(sharp(1.0, "airy-diameter"))
    assert found.extent == 0.0
    assert found.share_of(0.05, 0.06) == 0.0
    assert "19.6 µm" in found.reason  # the Airy diameter published for this camera
    assert "7.4 µm" in found.reason


def test_diffraction_on_the_object_is_the_airy_pattern_of_the_pupil_seen_from_there():
    # 1.03 λ a/A, whatever the camera does behind its lens.
    camera = mahli(0.15)
    expected = 1.028993969962188 * 550e-9 * 0.15 / MAHLI_LENS.pupil_diameter
    assert camera.focus.lateral_resolution(0.15, 550e-9).diffraction_width == pytest.approx(expected, rel=1e-12)
    refocused = EveryObjectFocus(lens=MAHLI_LENS, sample_pitch=7.4e-6, mechanisms=1)
    assert refocused.lateral_resolution(0.15, 550e-9).diffraction_width == pytest.approx(expected, rel=1e-12)
    assert stacked().focus.lateral_resolution(0.15, 550e-9).diffraction_width == pytest.approx(expected, rel=1e-12)
    assert refocused.lateral_resolution(0.15, 550e-9).diffraction == pytest.approx(
        1.219669891 * 550e-9 * 0.15 / MAHLI_LENS.pupil_diameter, rel=1e-9
    )


# ---- focus stacks ---------------------------------------------------------------------------------------------------


def stacked(most_images=8, near=0.14, far=0.16):
    return mahli(0.15, FocusStackPlan(near=near, far=far, most_images=most_images))


@pytest.mark.parametrize("criterion", [sharp(), sharp(0.5), sharp(1.0, "fwhm"), sharp(3.0, "airy-diameter")])
def test_a_stack_has_the_fewest_images_that_cover_its_range(criterion):
    camera = stacked(most_images=50)
    found = camera.focus.sharp_range(criterion)
    assert found.share_of(0.14, 0.16) == pytest.approx(1.0, abs=1e-12)
    count = camera.focus.images(criterion, 0.14, 0.16)
    assert len(found.names) == count > 1
    # One image fewer leaves part of the range out, wherever a search over even spacings puts them.
    assert found.extent >= 0.02
    fewer = stacked(most_images=count - 1).focus.sharp_range(criterion)
    assert fewer.share_of(0.14, 0.16) < 1.0 - 1e-3
    starts = np.linspace(0.139, 0.15, 40)
    best = max(
        np.mean(
            np.any(
                [
                    mahli(focus).focus.sharp_range(criterion).slices.contains(np.linspace(0.14, 0.16, 201))
                    for focus in np.geomspace(start, end, count - 1)
                ],
                axis=0,
            )
        )
        for start, end in zip(starts, 0.3 - starts, strict=True)
    )
    assert best < 1.0


def test_too_few_images_leave_equal_gaps_that_are_reported():
    found = stacked(most_images=2).focus.sharp_range(sharp(0.5))
    assert len(found.names) == 2
    assert len(found.union.gaps) == 1
    assert len(found.union.overlaps) == 0
    gap_near, gap_far = found.union.gaps[0]
    middle = np.linspace(gap_near, gap_far, 11)[1:-1]
    for distance in middle:  # not sharp in either image, by rays
        for focus in stacked(most_images=2).focus.focus_distances(sharp(0.5)):
            assert traced_blur(distance, focus, MAHLI_LENS) > 0.5 * 7.4e-6


def test_a_stack_resolves_what_its_best_image_resolves():
    focus = stacked().focus
    distance = np.linspace(0.13, 0.17, 41)
    for wavelength in (1e-9, 550e-9):
        singles = [
            mahli(float(at)).focus.lateral_resolution(distance, wavelength).size
            for at in focus.focus_distances(sharp())
        ]
        np.testing.assert_array_equal(focus.lateral_resolution(distance, wavelength).size, np.min(singles, axis=0))


@pytest.mark.parametrize("resolution", [60e-6, 100e-6, 160e-6])
def test_a_stack_at_a_given_resolution_covers_all_that_its_pixels_allow(resolution):
    found = stacked(most_images=20).focus.sharp_range_at_resolution(resolution, 550e-9)
    pixel_limit = 18.3e-3 * (1 + resolution / 7.4e-6)  # beyond, a pixel in focus covers more
    airy_limit = resolution * MAHLI_LENS.pupil_diameter / (1.219669891 * 550e-9)  # beyond, the Airy radius does
    assert found.share_of(0.14, min(0.16, pixel_limit, airy_limit) * (1 - 1e-9)) == pytest.approx(1.0, abs=1e-9)


def test_a_stack_reaches_infinity_when_asked_to():
    found = stacked(most_images=100, near=0.2, far=math.inf).focus.sharp_range(sharp())
    assert found.slices.far[-1] == math.inf
    assert found.union.complete


def test_diffraction_can_rule_out_a_stack():
    found = stacked().focus
    assert found.images(sharp(1.0, "airy-diameter"), 0.14, 0.16) == 0
    assert found.sharp_range(sharp(1.0, "airy-diameter")).names == ()
    assert "exceeds" in found.sharp_range(sharp(1.0, "airy-diameter")).reason


# ---- refocusing on every object -------------------------------------------------------------------------------------


def test_lenses_that_refocus_are_sharp_everywhere_but_need_more_exposures():
    focus = EveryObjectFocus(lens=MAHLI_LENS, sample_pitch=7.4e-6, mechanisms=2)
    assert focus.sharp_range(sharp()).slices.near[0] == pytest.approx(18.3e-3)
    assert focus.sharp_range(sharp()).extent == math.inf
    assert focus.images(sharp(), 0.14, 0.16) == stacked().focus.images(sharp(), 0.14, 0.16)
    for wavelength in (100e-9, 2e-6):
        far = float(focus.sharp_range_at_resolution(100e-6, wavelength).slices.far[0])
        assert focus.lateral_resolution(far, wavelength).size == pytest.approx(100e-6, rel=1e-9)
    assert focus.sharp_range_at_resolution(1e-6, 2e-6).extent == 0.0


def test_lenses_that_refocus_are_sharp_up_to_where_their_diffraction_spot_fills_the_criterion():
    focus = EveryObjectFocus(lens=MAHLI_LENS, sample_pitch=7.4e-6, mechanisms=2)
    near = float(focus.sharp_range(sharp(2.0, "airy-diameter")).slices.near[0])
    image = 1 / (1 / 18.3e-3 - 1 / near)
    spot = 2 * float(mpmath.besseljzero(1, 1)) / math.pi * 550e-9 * image / MAHLI_LENS.pupil_diameter
    assert spot == pytest.approx(2 * 7.4e-6, rel=1e-12)
    assert focus.images(sharp(2.0, "airy-diameter"), 0.9 * near, 1.0) == 0
    nothing = focus.sharp_range(sharp(1.0, "airy-diameter"))
    assert nothing.extent == 0.0
    assert "exceeds" in nothing.reason


# ---- refusals -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "what"),
    [
        (lambda: mahli(15e-3), "focus"),
        (lambda: stacked(near=0.15, far=0.15), "near < far"),
        (lambda: stacked(near=10e-3), "focus"),
        (lambda: stacked(most_images=0), "at least 1"),
        (lambda: FocusStackPlan(near=0.1, far=0.2, most_images=3, time_per_image=0.0), "time"),
        (lambda: sharp(0.0), "blur"),
    ],
)
def test_impossible_cameras_are_refused_with_a_message(make, what):
    with pytest.raises(OutOfRangeError, match=what):
        make()


def test_a_picture_beside_the_axis_is_seen_under_the_difference_of_its_angles():
    """A principal point left of the picture: the edges lie 0.5 px and 1600.5 px to its right."""
    camera = mahli(math.inf)
    shifted = CalibratedCamera(focal_lengths=(2000.0, 2000.0), principal_point=(-1.0, 599.5), lens=IDEAL)
    across, diagonal = replace(camera, calibrated=shifted).fields_of_view
    assert across == pytest.approx(math.atan(1600.5 / 2000) - math.atan(0.5 / 2000), rel=1e-12)
    assert diagonal > across


def test_a_focus_at_which_one_lens_magnifies_over_a_thousand_times_is_refused():
    mahli(18.3e-3 * 1.00101)
    with pytest.raises(OutOfRangeError, match=r"1.01e\+03 times, with the sensor 18.5 m behind"):
        mahli(18.3e-3 * 1.00099)

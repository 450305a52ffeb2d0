"""Focus of focused plenoptic cameras and stereo rigs: published ranges, rays, and scans of what is resolved."""

import dataclasses
import math

import mpmath
import numpy as np
import pytest

from tradestudy.cameras.focus import BlurCriterion, SingleLensFocus

from . import builders


def sharp(blur_px=1.0, measure="none"):
    return BlurCriterion(blur_px=blur_px, measure=measure, wavelength=550e-9)


def one_type(camera):
    array = dataclasses.replace(camera.microlenses, focal_lengths=camera.microlenses.focal_lengths[:1])
    return dataclasses.replace(camera, microlenses=array)


def test_published_ranges_of_the_three_types_and_of_one():
    found = builders.r5().focus.sharp_range(sharp())
    assert found.names == ("type 1", "type 2", "type 3")
    np.testing.assert_allclose(found.slices.near, [0.150, 0.187, 0.307], atol=0.6e-3)
    np.testing.assert_allclose(found.slices.far[:2], [0.187, 0.307], atol=0.6e-3)
    assert found.slices.far[2] == math.inf
    assert found.extent == math.inf
    alone = one_type(builders.r5()).focus.sharp_range(sharp())
    assert alone.names == ("microlenses",)
    assert alone.extent == pytest.approx(0.0367, abs=1e-4)


def test_rays_from_each_limit_blur_by_one_pixel_under_the_microlens():
    camera = builders.r5()
    array, f, z = camera.microlenses, camera.main_lens.focal_length, camera.mla_distance
    found = camera.focus.sharp_range(sharp()).slices
    for f_L, near, far in zip(array.focal_lengths, found.near, found.far, strict=True):
        for distance in (near, far):
            if not math.isfinite(distance):
                continue
            with mpmath.workdps(30):
                hits = []
                for edge in (array.aperture_diameter / 2, -array.aperture_diameter / 2):
                    bend = 1 / mpmath.mpf(distance) - 1 / mpmath.mpf(f)
                    height = edge / (1 + z * bend)
                    slope = height * bend - mpmath.mpf(edge) / f_L
                    hits.append(edge + slope * array.gap)
                assert float(abs(hits[0] - hits[1])) == pytest.approx(5.5e-6, rel=1e-9)


def test_microlens_diffraction_opens_gaps_between_touching_types_and_then_removes_them():
    camera = builders.r5()
    gaps = camera.focus.sharp_range(sharp(1.0, "fwhm")).union.gaps
    assert len(gaps) == 2
    nothing = camera.focus.sharp_range(sharp(1.0, "airy-diameter"))
    assert nothing.extent == 0.0
    assert np.isnan(nothing.slices.near).all()
    assert "6.03 µm" in nothing.reason  # 2.44 · 550 nm · 0.568 mm / 126.5 µm


def test_equal_resolution_agrees_with_a_scan():
    camera = builders.r5()
    distance = np.linspace(0.1, 0.5, 4001)
    for resolution in (125e-6, 147e-6, 300e-6):
        found = camera.focus.sharp_range_at_resolution(resolution, 550e-9).union.covered
        resolved = camera.focus.lateral_resolution(distance, 550e-9).size <= resolution
        inside = np.any([(distance >= near) & (distance <= far) for near, far in found], axis=0)
        assert np.count_nonzero(resolved != inside) <= 2 * len(found)  # the points next to an end
        assert resolved.any()


def test_the_gain_over_a_conventional_camera_all_but_vanishes_at_equal_resolution():
    # Published for 165 mm and 147 µm: 14.8 mm against 18.2 mm.
    camera = builders.r5()
    conventional = SingleLensFocus(lens=camera.main_lens, focus_distance=0.165, sample_pitch=5.5e-6)
    assert conventional.sharp_range_at_resolution(147e-6, 550e-9).extent == pytest.approx(14.8e-3, abs=0.1e-3)
    assert camera.focus.sharp_range_at_resolution(147e-6, 550e-9).extent == pytest.approx(18.2e-3, abs=0.4e-3)
    assert camera.focus.sharp_range(sharp()).extent == math.inf


def test_outside_the_main_lens_nothing_is_resolved_and_nothing_fails():
    focus = builders.r5().focus
    assert np.isnan(focus.lateral_resolution([0.005, 12.5e-3], 550e-9).size).all()
    assert np.isnan(focus.lateral_resolution([0.005], 550e-9).diffraction_width).all()


def test_diffraction_on_the_object_is_that_of_the_part_of_the_pupil_behind_one_microlens():
    # One microlens sees through D b/|a_L| of the pupil: 1.03 λ a over that, seen from the object.
    camera = builders.r5()
    f, z, D = camera.main_lens.focal_length, camera.mla_distance, camera.microlenses.aperture_diameter
    for distance in (0.15, 0.2, 1.0):
        b = 1 / (1 / f - 1 / distance)
        part_of_pupil = D * b / (z - b)
        expected = 1.028993969962188 * 550e-9 * distance / part_of_pupil
        assert camera.focus.lateral_resolution(distance, 550e-9).diffraction_width == pytest.approx(expected, rel=1e-9)


def test_both_lenses_of_a_stereo_rig_have_one_depth_of_field():
    rig = builders.stereo()
    focus = rig.focus
    assert focus.sharp_range(sharp(2.0)).names == ("both lenses",)
    limits = focus.sharp_range(sharp(2.0)).slices
    assert rig.estimator_blur_px(limits.near[0]) == pytest.approx(2.0, rel=1e-9)
    assert rig.estimator_blur_px(limits.far[0]) == pytest.approx(2.0, rel=1e-9)
    refocusing = dataclasses.replace(rig, focus_distance=None)
    assert refocusing.focus.mechanisms == 2
    assert refocusing.focus.sharp_range(sharp()).extent == math.inf

"""Arrays of pinholes, microlenses on both sides of the gap, and views of a camera that is focused at infinity."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tradestudy
from tests.cameras.builders import F_MAIN, PITCH, depth_read, r5, unfocused
from tradestudy.cameras.focus import BlurCriterion
from tradestudy.cameras.parts import MicrolensArray
from tradestudy.depth.evaluation import depth_uncertainty
from tradestudy.errors import OutOfRangeError, StudyError

DISTANCES = np.array([0.2, 0.5, 1.0, 5.0])
GAP = 0.568093e-3


def array(*focal_lengths: float) -> MicrolensArray:
    return MicrolensArray(
        layout="hexagonal", pitch=PITCH, gap=GAP, focal_lengths=focal_lengths, aperture_diameter=0.3 * PITCH
    )


@pytest.mark.parametrize("z", [14.77255e-3, 11.9e-3])
def test_blur_behind_a_pinhole_is_its_shadow(z: float) -> None:
    camera = r5(microlenses=array(math.inf), mla_distance=z, estimator="adjacent-pair", lenses="all")
    image = F_MAIN * DISTANCES / (DISTANCES - F_MAIN)
    # Rays from the image, or towards it, through both edges of the aperture, at the sensor.
    edge = 0.15 * PITCH
    shadow = 2.0 * np.abs(edge * (z + GAP - image) / (z - image)) / 5.5e-6
    np.testing.assert_allclose(camera.blur_px(DISTANCES)[0], shadow, rtol=1e-12)
    (exposure,) = camera.exposures(0.5, {}, None, 0.0)
    cones = exposure.cones(np.zeros(1), np.zeros(1))
    own = np.argmin(np.hypot(*cones.slope))
    # From a pixel through the edge of the pinhole, straight to the main lens.
    assert cones.stop.by_lens[own] == pytest.approx(1.0 + z / GAP, rel=1e-12)


def test_the_depth_of_pinholes_is_that_of_lenses() -> None:
    pinholes, lenses = (
        r5(microlenses=one, estimator="least-squares", lenses="all") for one in (array(math.inf), array(0.4e-3))
    )
    for noise in (0.0, 1e-7):
        mine, theirs = (depth_read(one, DISTANCES, 0.5, pixel_noise=[noise]) for one in (pinholes, lenses))
        np.testing.assert_array_equal(mine, theirs)
    np.testing.assert_array_equal(pinholes.microlenses_seeing(DISTANCES), lenses.microlenses_seeing(DISTANCES))
    criterion = BlurCriterion(blur_px=2.0, measure="none", wavelength=550e-9)
    assert pinholes.focus.keplerian == (True,)
    assert pinholes.focus.sharp_range(criterion).reason == "the shadow of a pinhole is larger than the blur"


def test_types_on_both_sides_of_the_gap_work_on_their_own_side() -> None:
    camera = r5(microlenses=array(0.4e-3, GAP, 0.7e-3), estimator="same-type-pair")
    assert camera.focus.keplerian == (True, True, False)
    near, far = np.array([0.07]), np.array([0.5])
    assert camera.virtual_depth(near)[0] < 0.0 < camera.virtual_depth(far)[0]
    assert np.argmin(camera.blur_px(near)[:, 0]) == 2
    assert np.argmin(camera.blur_px(far)[:, 0]) < 2


@pytest.mark.parametrize("distance", [0.07, 0.15, 0.5])
def test_rendered_light_of_types_on_both_sides_of_the_gap_spreads_by_their_lens(distance: float) -> None:
    """From a height h on a lens, light of an image s behind the array meets the sensor at h (1 − g/s − g/f)."""
    lengths = (0.4e-3, GAP, 0.7e-3)
    camera = r5(microlenses=array(*lengths), estimator="same-type-pair")
    behind = 1.0 / (1.0 / camera.main_lens.focal_length - 1.0 / distance) - camera.mla_distance
    places = np.linspace(-4.0, 4.0, 81) * PITCH
    cones = camera.exposures(distance, {}, None, 0.0)[0].cones(places, np.zeros_like(places))
    by_lens = cones.start_by_lens + distance * cones.slope_by_lens
    by_pixel = cones.start_by_pixel + distance * cones.slope_by_pixel
    spread = np.broadcast_to(-by_lens / by_pixel, cones.pixel.shape)
    assert {*cones.lens_type.tolist()} == {0, 1, 2}
    for number, focal_length in enumerate(lengths):
        expected = 1.0 - GAP / behind - GAP / focal_length
        np.testing.assert_allclose(np.abs(spread[cones.lens_type == number]), abs(expected), rtol=1e-9)


@pytest.mark.parametrize("distance", [0.07, 0.5])
def test_depth_through_types_on_both_sides_of_the_gap_is_propagated_as_it_is_read(distance: float) -> None:
    camera = r5(microlenses=array(0.4e-3, GAP, 0.7e-3), estimator="same-type-pair", disparity_error_px=1e-4)
    assert depth_read(camera, distance, 0.0)[0] == pytest.approx(distance, rel=1e-9)
    step = 1e-9
    up, down = depth_read(camera, distance, 0.0, pixel_noise=[step, -step])
    noise = camera.disparity_error_px * camera.sensor.pixel_pitch
    sigma = float(depth_uncertainty(camera, np.array([distance]))[0])
    assert abs(up - down) / (2.0 * step) * noise == pytest.approx(sigma, rel=1e-5)


def test_a_pinhole_has_no_other_length() -> None:
    for wrong in (math.nan, 0.0, -math.inf):
        with pytest.raises(OutOfRangeError, match="finite and not zero, or infinite for a pinhole"):
            array(wrong)


def test_a_camera_focused_at_infinity_is_the_limit_of_one_focused_far_away() -> None:
    """Where z = f and d = Δu f/a."""
    camera, far = unfocused(focus_distance=math.inf), unfocused(focus_distance=1e9)
    assert camera.mla_distance == F_MAIN
    np.testing.assert_allclose(camera.disparity(DISTANCES), camera.estimator_baseline * F_MAIN / DISTANCES, rtol=1e-14)
    assert camera.disparity_of_infinity(1.0) == 0.0
    np.testing.assert_allclose(camera.depth_of_disparity(camera.disparity(DISTANCES), 1.0), DISTANCES, rtol=1e-14)
    criterion = BlurCriterion(blur_px=0.5, measure="none", wavelength=550e-9)

    def numbers(one: Any) -> list[Any]:
        picture = one.picture_geometry(DISTANCES)
        return [
            one.disparity(DISTANCES),
            one.equivalent_baseline(DISTANCES),
            one.refocusing.distance([1.0, 0.5]),
            picture.magnification,
            one.focus.sharp_range(criterion).slices.near,
            one.focus.lateral_resolution(DISTANCES, 550e-9).diffraction,
            depth_read(one, DISTANCES, 0.6, pixel_noise=[1e-7], array_tilt_x=[1e-4], distortion_k1=[0.01]),
            one.exposures(0.5, {}, None, 0.0)[0].cones(np.array([1e-3]), np.array([-2e-3])).slope,
        ]

    for mine, theirs in zip(numbers(camera), numbers(far), strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=1e-6)
    assert camera.refocusing.distance(-1.0) == math.inf
    with pytest.raises(OutOfRangeError, match="cannot focus that close"):
        replace(camera, focus_distance=math.nan)


STUDY = """
format: 2
study: both
title: Both
question: Which camera measures depth?
cameras:
  pinholes:
    kind: focused-plenoptic
    main_lens: {focal_length: 12.5 mm, f_number: 3.8}
    sensor: {pixels: [2048, 2048], pixel_pitch: 5.5 um}
    microlenses:
      {layout: hexagonal, pitch: 126.5 um, gap: f-number-matching, focal_lengths: pinhole, aperture_diameter: 40 um}
    focus: {total_covering_plane: 150 mm, relay: keplerian}
    depth: {estimator: adjacent-pair, disparity_error: 0.1 px}
  views:
    kind: unfocused-plenoptic
    main_lens: {focal_length: 12.5 mm, f_number: 3.8}
    sensor: {pixels: [2048, 2048], pixel_pitch: 5.5 um}
    microlenses: {layout: hexagonal, pitch: 126.5 um, focal_length: f-number-matching}
    focus: {distance: infinity}
    depth: {estimator: outermost-views, disparity_error: 0.1 px}
scene: {distances: {from: 0.2 m, to: 2 m, points: 5}, wavelength: 550 nm}
depth_of_field:
  range: [0.2 m, 1 m]
  criteria: {two-pixels: {blur: 2 px, diffraction: none}, airy: {blur: 2 px, diffraction: airy-diameter}}
"""


def test_studies_declare_pinholes_and_focus_at_infinity(tmp_path: Path) -> None:
    path = tmp_path / "both.yaml"
    path.write_text(STUDY)
    study = tradestudy.load(path)
    assert study.definition.designs["pinholes"].microlenses.focal_lengths == (math.inf,)
    assert study.definition.designs["views"].mla_distance == F_MAIN
    result = study.run()
    assert np.isfinite(result.data["depth"]["depth_uncertainty"].values).any()
    result.write(tmp_path / "out", pdf=False)
    path.write_text(STUDY.replace("pinhole,", "pinhole, types: 3,"))
    with pytest.raises(StudyError, match=r"pinholes have no focal lengths .*write 1"):
        tradestudy.load(path)

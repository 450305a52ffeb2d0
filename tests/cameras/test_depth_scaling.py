"""Depth that a calibration corrects by a quadratic function, against eq. 8 written out and against the plain camera."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

import tradestudy
from tests.cameras.builders import F_MAIN, depth_read, r5
from tradestudy.cameras.depth_camera import UsableCriteria
from tradestudy.cameras.focus import BlurCriterion
from tradestudy.cameras.focused_plenoptic.design import FocusedPlenoptic
from tradestudy.cameras.focused_plenoptic.focus import DepthScaling
from tradestudy.cameras.parts import Lens
from tradestudy.depth.evaluation import depth_uncertainty
from tradestudy.errors import OutOfRangeError, StudyError

A, B, C = 0.11, 0.9, 0.012
SCALING = DepthScaling(quadratic=A, linear=B, offset=C)
Z = np.array([0.25, 0.5, 1.0, 1.4])
M = A * Z**2 + B * Z + C


def scaled(scaling: DepthScaling = SCALING, **changes: Any) -> FocusedPlenoptic:
    return r5(depth_scaling=scaling, **changes)


def test_the_uncertainty_is_that_of_the_plain_camera_times_the_slope() -> None:
    small: dict[str, Any] = {"disparity_error_px": 1e-4}  # so that depth is linear in the noise
    found, plain = depth_uncertainty(scaled(**small), M), depth_uncertainty(r5(**small), Z)
    np.testing.assert_allclose(found, np.abs(2 * A * Z + B) * plain, rtol=1e-5)
    camera = r5(**small)
    v = camera.virtual_depth(Z)
    sigma_v = v**2 * small["disparity_error_px"] * 5.5e-6 / camera.estimator_baseline(Z)
    sigma = ((Z - F_MAIN) / F_MAIN) ** 2 * camera.microlenses.gap * sigma_v
    np.testing.assert_allclose(found, (2 * A * Z + B) * sigma, rtol=1e-4)


def test_draws_through_equation_8_and_the_scaling_give_the_same_depths() -> None:
    camera, noise = scaled(), np.random.default_rng(3).normal(0.0, 0.1 * 5.5e-6, 500)
    z, gap, baseline = camera.mla_distance, camera.microlenses.gap, r5().estimator_baseline(Z)
    image = F_MAIN * Z / (Z - F_MAIN)
    disparity = baseline * gap / (z - image) + noise[:, np.newaxis]
    image_read = z - gap * baseline / disparity
    read = F_MAIN * image_read / (image_read - F_MAIN)
    np.testing.assert_allclose(depth_read(camera, M, pixel_noise=noise), A * read**2 + B * read + C, rtol=1e-9)


def test_a_correction_that_changes_nothing_changes_no_number() -> None:
    distances = np.array([0.12, 0.5, 1.0, 30.0])
    criterion = BlurCriterion(blur_px=2.0, measure="none", wavelength=550e-9)

    def numbers(camera: FocusedPlenoptic) -> list[object]:
        picture, focus = camera.picture_geometry(distances), camera.focus
        errors = {"pixel_noise": [1e-7, -2e-7], "mla_distance": [1e-6, 2e-6], "distortion_k1": [0.01, 0.02]}
        limits = camera.limits(distances, UsableCriteria(virtual_depth=2.0, blur_px=2.0, disparity_step_px=1.0))
        return [
            depth_read(camera, distances, 0.7, **errors),
            *camera.depth_discrimination(distances),
            camera.equivalent_baseline(distances),
            camera.microlenses_seeing(distances),
            picture.magnification,
            picture.blur_px,
            picture.distance,
            *(limit.value for limit in limits.values()),
            *dataclasses.astuple(focus.sharp_range(criterion).slices)[:2],
            *dataclasses.astuple(focus.lateral_resolution(distances, 550e-9)),
            focus.lateral_resolution(distances, 550e-9).diffraction_width,
            camera.total_covering_plane,
        ]

    nothing = DepthScaling(offset=1e-18)  # passes through every formula
    assert not nothing.is_identity
    for mine, plain in zip(numbers(scaled(nothing)), numbers(r5()), strict=True):
        np.testing.assert_allclose(np.asarray(mine, float), np.asarray(plain, float), rtol=1e-12)


def test_every_quantity_at_a_metric_distance_is_that_of_the_modelled_distance() -> None:
    camera, plain = scaled(), r5()
    for name in ("virtual_depth", "disparity", "radius_over_pitch", "availability", "blur_px", "microlenses_seeing"):
        np.testing.assert_allclose(getattr(camera, name)(M), getattr(plain, name)(Z), rtol=1e-9)
    assert camera.total_covering_plane == pytest.approx(A * 0.15**2 + B * 0.15 + C, rel=1e-4)
    np.testing.assert_allclose(SCALING.metric(SCALING.modelled(M)), M, rtol=1e-14)
    near, far = camera.depth_discrimination(M)
    plain_near, plain_far = plain.depth_discrimination(Z)
    np.testing.assert_allclose(M - near, SCALING.metric(Z - plain_near), rtol=1e-9)
    np.testing.assert_allclose(M + far, SCALING.metric(Z + plain_far), rtol=1e-9)


def test_the_equally_precise_rig_is_equally_precise() -> None:
    camera = scaled(disparity_error_px=1e-4)
    sigma_of_rig = M**2 / (F_MAIN * camera.equivalent_baseline(M)) * 1e-4 * 5.5e-6
    np.testing.assert_allclose(depth_uncertainty(camera, M), sigma_of_rig, rtol=1e-4)


def test_sizes_on_the_object_are_those_of_its_ray() -> None:
    camera, plain = scaled(), r5()
    pictures = camera.picture_geometry(M).magnification, plain.picture_geometry(Z).magnification
    np.testing.assert_allclose(pictures[0] * M, pictures[1] * Z, rtol=1e-9)
    fine = camera.focus.lateral_resolution(M, 550e-9).sampling
    np.testing.assert_allclose(fine, 5.5e-6 / pictures[0], rtol=1e-9)


def test_the_sharp_range_ends_where_the_blur_reaches_its_limit() -> None:
    found = scaled().focus.sharp_range(BlurCriterion(blur_px=2.0, measure="none", wavelength=550e-9)).slices
    ends = np.array([[near, far] for near, far in zip(found.near, found.far, strict=True) if np.isfinite(far)])
    assert ends.size
    for kind, own in enumerate(ends):
        np.testing.assert_allclose(scaled().blur_px(own)[kind], 2.0, rtol=1e-9)


def test_depths_that_the_correction_cannot_give_are_refused_and_readings_beyond_them_fail() -> None:
    bent = DepthScaling(quadratic=-0.2, linear=1.0)  # 2 a Z + b is 0 at Z = 2.5 m, where M is 1.25 m
    camera = scaled(bent)
    with pytest.raises(OutOfRangeError, match=r"1\.3 m.*below 1\.25 m.*reduce the distances"):
        camera.virtual_depth([0.5, 1.3])
    far = 1.2499
    sigma = float(camera.noise(far))
    read = camera.read(
        np.array([far]), 0.0, {"pixel_noise": np.array([[3 * sigma], [0.0], [-3 * sigma], [-9 * sigma]])}
    )
    nearer, exact, beyond, farther = read.inverse_depth[:, 0]
    assert nearer > exact > 0.0 > beyond > farther
    assert exact == pytest.approx(1 / far, rel=1e-6)
    assert camera.depth_of_disparity(camera.disparity_of_infinity(1.0), 1.0) == np.inf
    no_depth = scaled(DepthScaling(offset=-1.0)).read(np.array([1.5]), 0.0, {"pixel_noise": np.array([[1e-4]])})
    assert np.isnan(no_depth.inverse_depth).all()
    assert not scaled(DepthScaling(offset=0.5)).images(0.4)
    for wrong in ({"linear": -1.0}, {"offset": np.nan}):
        with pytest.raises(OutOfRangeError):
            DepthScaling(**wrong)


def test_depth_of_field_at_a_resolution_is_refused() -> None:
    with pytest.raises(OutOfRangeError, match="lateral resolution is not computed"):
        scaled().focus.sharp_range_at_resolution(1e-3, 550e-9)


def test_a_galilean_camera_beyond_the_front_focal_point_reads_the_metric_depth_of_it() -> None:
    camera = scaled(main_lens=Lens(focal_length=F_MAIN, f_number=3.8), mla_distance=12.0e-3)
    crossed = camera.depth_of_disparity(np.abs(camera.disparity(M)), M)
    np.testing.assert_allclose(crossed, A * F_MAIN**2 + B * F_MAIN + C, rtol=1e-12)


def test_pictures_are_those_of_the_camera_without_the_correction() -> None:
    x, y = np.array([1e-3, -2e-3]), np.array([0.0, 3e-3])
    mine, plain = (one.exposures(0.3, {}, None, 0.0)[0].cones(x, y) for one in (scaled(), r5()))
    assert np.array_equal(mine.start, plain.start)
    assert np.array_equal(mine.slope, plain.slope)


def test_check_refuses_to_count_the_correction_as_an_error_of_the_matcher() -> None:
    loaded = tradestudy.load("studies/depth_loop.yaml", overrides=("cameras.raytrix-r5.depth.scaling.offset=1 mm",))
    with pytest.raises(StudyError, match=r"depth_loop: raytrix-r5 corrects measured depth \(depth\.scaling\).*leave"):
        loaded.check()

"""Stereo rigs with lenses that distort: what they see, read and share, by OpenCV, differences and counting."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from tests.cameras.builders import depth_read, stereo
from tradestudy import load
from tradestudy.cameras.camera import DerivedValue
from tradestudy.cameras.parts import Lens, Sensor
from tradestudy.cameras.stereo.design import StereoRig
from tradestudy.errors import OutOfRangeError, StudyError
from tradestudy.optics.lens_families import DoubleSphere, FieldOfView, KannalaBrandt
from tradestudy.optics.lens_model import LensModel, Rational
from tradestudy.units import ANGLE

LENSES = (
    KannalaBrandt(k1=-0.02, k2=0.005),
    FieldOfView(w=0.9),
    DoubleSphere(xi=-0.2, alpha=0.6),
    Rational(k1=-0.25, k2=0.05, p1=0.004, p2=-0.003, s1=0.002, tau_x=0.03),
)
STUDIES = Path(__file__).parents[2] / "studies"


def wide(lens: LensModel, **changes: object) -> StereoRig:
    """Half the sensor's width is 0.9 focal lengths."""
    sensor = Sensor(columns=640, rows=400, pixel_pitch=9e-6)
    return stereo(
        lens=Lens(focal_length=3.2e-3, f_number=2.8), sensor=sensor, distortion=lens, focus_distance=None, **changes
    )


def test_both_pictures_are_those_of_opencv() -> None:
    cv2 = pytest.importorskip("cv2")
    world = np.random.default_rng(4).uniform([-0.6, -0.3, 0.6], [0.6, 0.3, 2.0], (200, 3))
    for lens, projected in ((LENSES[3], cv2.projectPoints), (LENSES[0], cv2.fisheye.projectPoints)):
        rig = wide(lens)
        seen = np.stack(rig.observe({}, *world.T), axis=-1)
        coefficients = np.array(list(lens.coefficients().values()))
        for side, columns in ((0.05, slice(0, 2)), (-0.05, slice(2, 4))):
            moved = (world + np.array([side, 0.0, 0.0]))[:, None]
            expected = projected(moved, np.zeros(3), np.zeros(3), np.eye(3), coefficients)[0][:, 0]
            np.testing.assert_allclose(seen[:, columns] / rig.sensor.pixel_pitch, expected * 3.2e-3 / 9e-6, atol=1e-9)


@pytest.mark.parametrize("lens", LENSES, ids=lambda lens: lens.name)
@pytest.mark.parametrize("converging", [0.0, 0.2])
def test_a_perfect_calibration_reads_the_truth_wherever_both_see(lens: LensModel, converging: float) -> None:
    rig, z = wide(lens, convergence_angle=converging), np.array([0.5, 1.0, 3.0])
    for field in (0.0, 0.4, 0.7):
        assert depth_read(rig, z, field) == pytest.approx(z, rel=1e-9)
    assert not rig.read(z, 0.0, {}).no_overlap.any()


@pytest.mark.parametrize("lens", LENSES, ids=lambda lens: lens.name)
def test_disparity_its_inverse_and_its_slope_are_consistent(lens: LensModel) -> None:
    rig, z = wide(lens, convergence_angle=0.1), np.array([0.4, 0.8, 2.0])
    np.testing.assert_allclose(rig.depth_of_disparity(rig.disparity(z), z), z, rtol=1e-12)
    # One disparity step by finite differences of what both pictures show, and the depth that the noise of a step reads.
    step = 1e-4
    slope = (rig.disparity(z + step) - rig.disparity(z - step)) / (2.0 * step)
    assert rig.equivalent_baseline(z) == pytest.approx(-slope * z**2 / rig.principal_distance, rel=1e-6)
    noisy = depth_read(rig, z, 0.0, pixel_noise=1e-3 * 9e-6)
    assert noisy - z == pytest.approx(1e-3 * 9e-6 / slope, rel=2e-3)
    nearer, farther = rig.depth_discrimination(z)
    assert (nearer + farther) / 2.0 == pytest.approx(-0.1 * 9e-6 / slope, rel=2e-2)


@pytest.mark.parametrize("lens", LENSES, ids=lambda lens: lens.name)
@pytest.mark.parametrize("converging", [0.0, 0.5])
def test_overlap_is_what_the_pixels_of_one_camera_share_with_the_other(lens: LensModel, converging: float) -> None:
    rig, z, t = wide(lens, convergence_angle=converging), 0.6, converging / 2.0
    half = 0.9
    place = np.stack([(np.arange(20_000) + 0.5) / 10_000 * half - half, np.zeros(20_000)], axis=-1)
    rays = lens.unproject(place)
    direction = np.arctan2(rays[:, 0], rays[:, 2]) + t
    ahead = np.abs(direction) < math.pi / 2
    from_right = np.arctan2(z * np.tan(np.where(ahead, direction, 0.0)) - 0.1, z) + t
    there = lens.project(np.stack([np.sin(from_right), np.zeros(20_000), np.cos(from_right)], axis=-1))[:, 0]
    assert float(rig.overlap(z)) == pytest.approx(np.mean(ahead & (np.abs(there) <= half)), abs=3e-4)


def test_the_field_is_that_of_the_lens_and_ends_with_it() -> None:
    fisheye = wide(KannalaBrandt())
    assert fisheye.field_of_view == pytest.approx(1.8)  # r = θ, and half the width is 0.9 focal lengths
    assert fisheye.field_angle(0.5) == pytest.approx(0.5 * math.hypot(0.9, 0.9 * 400 / 640))
    barrel = wide(Rational(k1=-1.0 / 3.0))  # images nothing beyond 2/3
    end = float(barrel.distortion.valid_field)
    assert barrel.field_of_view == pytest.approx(2.0 * end)
    assert barrel.read(np.array([1.0]), 1.0, {}).no_overlap.all()
    rows = dict(barrel.properties())
    assert rows["lens model"] == "rational (k1 -0.333333)"
    assert rows["valid field of the lens model, from the axis"] == DerivedValue(end, ANGLE)
    # Pixels beyond it receive no light.
    (left, _) = barrel.exposures(1.0, {}, None, 0.0)
    assert (left.cones(np.array([0.0, 2.8e-3]), np.zeros(2)).light > 0.0).tolist() == [True, False]


def test_errors_of_radial_distortion_add_to_that_of_the_lens() -> None:
    one = wide(Rational(k1=-0.2, k2=0.03))
    other = wide(Rational(k1=-0.15, k2=0.05))
    changed = {"left_distortion_k1": 0.05, "left_distortion_k2": 0.02}
    np.testing.assert_allclose(
        one.observe(changed, 0.2, 0.1, 1.0)[:2], other.observe({}, 0.2, 0.1, 1.0)[:2], rtol=1e-14
    )
    with pytest.raises(OutOfRangeError, match="has no k1 and k2"):
        wide(FieldOfView(w=0.9)).observe(changed, 0.2, 0.1, 1.0)


def declared(*changes: str) -> StereoRig:
    cameras = load(
        STUDIES / "robot.yaml", [f"cameras.stereo-75mm.{change}" for change in changes]
    ).prepared.case.cameras
    rig = cameras["stereo-75mm"]
    assert isinstance(rig, StereoRig)
    return rig


def test_a_study_declares_a_lens_model_by_name() -> None:
    assert declared("distortion={model: rational, k1: -0.3, tau_x: 1 deg}").distortion == Rational(
        k1=-0.3, tau_x=math.radians(1.0)
    )
    assert declared("distortion={model: double-sphere, xi: -0.2, alpha: 0.6}").distortion == LENSES[2]
    with pytest.raises(StudyError, match="alpha"):
        declared("distortion={model: double-sphere, xi: -0.2}")
    with pytest.raises(StudyError, match="coefficient w of the lens model fov: 4"):
        declared("distortion={model: fov, w: 4 rad}")
    with pytest.raises(StudyError, match="has no k1 and k2"):
        declared(
            "distortion={model: fov, w: 0.9 rad}", "calibration.errors.left_distortion_k1={standard_deviation: 0.01}"
        )

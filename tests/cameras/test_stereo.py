"""The stereo rig against published figures, ray construction, and its own exact model perturbed."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.cameras.builders import depth_read, stereo
from tradestudy.cameras.depth_camera import UsableCriteria
from tradestudy.cameras.parts import Lens, focal_length_of_field_of_view
from tradestudy.errors import OutOfRangeError

YAW = math.radians(0.2)


def test_published_effect_of_yaw() -> None:
    exact = depth_read(stereo(), [0.5, 1.0], yaw=1e-9) - np.array([0.5, 1.0])
    # The published linear figures leave out 1 + x²/f², 1 % at 0.5 m.
    assert np.abs(exact) / 1e-9 * YAW == pytest.approx([8.7e-3, 34.9e-3], rel=0.015)
    far = depth_read(stereo(), 10.0, yaw=[-YAW, YAW]) - 10.0
    assert far[:, 0] == pytest.approx([5.36, -2.59], abs=0.005)
    assert np.isinf(depth_read(stereo(), 10.0, yaw=-0.0101))  # the pole is at Z = B/ψ


@pytest.mark.parametrize(
    ("focal_length", "near"),
    [
        (30.5e-3, 1.489),
        (focal_length_of_field_of_view(math.radians(65.24), 10.24e-3), 0.391),
        (focal_length_of_field_of_view(math.radians(65.24), 10.24e-3 * math.sqrt(2)), 0.552),
    ],
)
def test_published_distances_of_80_percent_overlap(focal_length: float, near: float) -> None:
    rig = stereo(lens=Lens(focal_length=focal_length, f_number=8.0))
    assert float(rig.overlap(near)) == pytest.approx(0.8, abs=5e-4)


def test_published_focal_lengths_and_fields() -> None:
    assert focal_length_of_field_of_view(math.radians(65.24), 10.24e-3) == pytest.approx(8.00e-3, abs=5e-6)
    assert focal_length_of_field_of_view(math.radians(65.24), 10.24e-3 * math.sqrt(2)) == pytest.approx(
        11.3e-3, abs=2e-5
    )
    assert math.degrees(stereo().field_of_view) == pytest.approx(19.06, abs=0.005)
    short = stereo(lens=Lens(focal_length=8.0e-3, f_number=8.0), baseline=20e-3)
    assert float(short.overlap(0.150)) == pytest.approx(0.90, abs=0.005)


@given(z=st.floats(0.05, 100.0), baseline=st.floats(0.01, 0.5), angle=st.floats(-2.5, 2.9), f=st.floats(5e-3, 50e-3))
def test_overlap_is_what_the_pixels_of_one_camera_share_with_the_other(
    z: float, baseline: float, angle: float, f: float
) -> None:
    rig = stereo(
        lens=Lens(focal_length=f, f_number=4.0), baseline=baseline, convergence_angle=angle, focus_distance=None
    )
    half = math.atan(rig.sensor.width / (2 * f))
    # Follow every pixel of the left camera to the plane, if it gets there, and ask the right camera whether it sees it.
    pixel = (np.arange(20_000) + 0.5) / 20_000 - 0.5
    direction = np.arctan(pixel * rig.sensor.width / f) + angle / 2
    ahead = np.abs(direction) < math.pi / 2
    x = -baseline / 2 + z * np.tan(np.where(ahead, direction, 0.0))
    seen = ahead & (np.abs(np.arctan2(x - baseline / 2, z) + angle / 2) <= half)
    assert float(rig.overlap(z)) == pytest.approx(np.mean(seen), abs=2e-4)


def test_views_that_never_meet_share_nothing() -> None:
    # Axes that meet at 3 cm behind 8 mm lenses look past each other from half a metre on.
    angle = 2 * math.atan(0.1 / (2 * 0.03))
    rig = stereo(lens=Lens(focal_length=8e-3, f_number=8.0), convergence_angle=angle)
    assert np.all(rig.overlap(np.array([0.5, 1.0, 2.8])) == 0.0)


def test_pitch_splits_the_two_rules_by_decimetres_at_ten_metres() -> None:
    by_disparity = float(depth_read(stereo(), 10.0, pitch=YAW)[0])
    by_midpoint = float(depth_read(stereo(triangulation="midpoint"), 10.0, pitch=YAW)[0])
    assert by_disparity == pytest.approx(10.0, abs=0.01)
    assert 0.1 < abs(by_midpoint - by_disparity) < 2.0


def test_rules_agree_where_rays_meet() -> None:
    z = np.geomspace(0.1, 1e3, 20)
    for angle in (0.0, 0.1):
        for rule in ("disparity", "midpoint"):
            rig = stereo(triangulation=rule, convergence_angle=angle)
            assert depth_read(rig, z) == pytest.approx(z, rel=1e-9)


def test_limits_and_their_bounds() -> None:
    limits = stereo().limits(np.array([0.5, 1.0, 1.6]), UsableCriteria(overlap=0.8, blur_px=1.0, disparity_step_px=0.1))
    assert limits["overlap"].met.tolist() == [False, False, True]
    assert limits["focus"].met.tolist() == [False, True, False]
    assert limits["last_disparity_step"].met.all()
    far = stereo().limits(np.array([3049.0, 3051.0]), UsableCriteria(disparity_step_px=0.1))["last_disparity_step"]
    assert far.met.tolist() == [True, False]  # f B / 0.1 px = 3050 m


def test_discrimination_grows_with_the_square_of_distance() -> None:
    z = np.array([0.5, 1.0, 2.0])
    nearer, farther = stereo().depth_discrimination(z)
    assert nearer == pytest.approx(z**2 * 1e-6 / (30.5e-3 * 0.1), rel=1e-3)
    assert np.all(farther > nearer)
    assert np.isinf(stereo().depth_discrimination(4000.0)[1])


def test_a_focus_next_to_the_focal_length_is_refused_by_its_magnification() -> None:
    """Exactly a thousand times is 30.5 mm · 1.001; the image then lies 1001 focal lengths behind the lens."""
    assert stereo(focus_distance=30.5e-3 * 1.0011).sensor_distance(30.5e-3 * 1.0011) < 30.5
    refusal = (
        r"magnification of the lenses at 30.52745 mm.*: 1.11e\+03 times.*33.9 m behind.*at most 1000 times.*increase"
    )
    with pytest.raises(OutOfRangeError, match=refusal):
        stereo(focus_distance=30.5e-3 * 1.0009)


def test_impossible_rigs_are_refused() -> None:
    with pytest.raises(OutOfRangeError, match="focus that close"):
        stereo(focus_distance=20e-3)
    with pytest.raises(OutOfRangeError, match="baseline"):
        stereo(baseline=0.0)
    with pytest.raises(OutOfRangeError, match="180"):
        stereo(convergence_angle=4.0)

"""The thin lens against 40-digit arithmetic, and against rays traced from the pupil's edge."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tradestudy.optics.thin_lens import blur_diameter, focus_shift, image_distance, object_distance

DISTANCES = np.geomspace(10e-3, 1e8, 41)
FOCAL_LENGTHS = (0.432e-3, 8e-3, 12.5e-3, 50e-3)


@pytest.mark.parametrize("f", FOCAL_LENGTHS)
def test_focus_shift_and_image_distance_to_1e_12(f: float) -> None:
    for a in DISTANCES[np.abs(DISTANCES - f) > 1e-3 * f]:
        with mpmath.workdps(40):
            b = 1 / (1 / mpmath.mpf(f) - 1 / mpmath.mpf(float(a)))
            shift = b - mpmath.mpf(f)
        assert float(focus_shift(a, f)) == pytest.approx(float(shift), rel=1e-12)
        assert float(image_distance(a, f)) == pytest.approx(float(b), rel=1e-12)


@given(a=st.floats(60e-3, 1e8), f=st.floats(1e-3, 50e-3))
def test_round_trip_keeps_every_digit_that_the_subtraction_of_f_keeps(a: float, f: float) -> None:
    # Condition of a → a − f and back is below a/(a − f) ≤ 6 each way.
    assert float(object_distance(focus_shift(a, f), f)) == pytest.approx(a, rel=20 * 2**-52)


def test_the_textbook_round_trip_loses_eight_digits_where_ours_loses_none() -> None:
    a, f = 1e8, 50e-3
    b = a * f / (a - f)
    naive = b * f / (b - f)
    assert abs(naive / a - 1) > 1e-9
    assert abs(float(object_distance(focus_shift(a, f), f)) / a - 1) < 1e-15


def test_limits() -> None:
    assert focus_shift(math.inf, 0.05) == 0.0
    assert np.isinf(focus_shift(0.05, 0.05))
    assert object_distance(0.0, 0.05) == math.inf
    assert object_distance(-0.0, 0.05) == math.inf
    assert focus_shift(0.02, 0.05) < -0.05  # a virtual image, before the lens


@pytest.mark.parametrize("a", [0.01, 0.03, 0.0306, 0.3, 0.96, 1.0, 1.04, 5.0, math.inf])
@pytest.mark.parametrize("a0", [0.5, 1.0, math.inf])
def test_blur_is_where_the_edge_rays_meet_the_sensor(a: float, a0: float) -> None:
    f, pupil = 30.5e-3, 30.5e-3 / 4
    sensor = 1 / (1 / f - 1 / a0)
    # A ray from the axial point through the pupil's edge is bent to the image point; follow it to the sensor.
    image = 1 / (1 / f - 1 / a)
    edge = pupil / 2 * (1 - sensor / image)
    assert float(blur_diameter(a, a0, f, pupil)) == pytest.approx(2 * abs(edge), rel=1e-12, abs=1e-17)


def test_published_blur_of_the_printed_rig() -> None:
    # f = 30.5 mm at f/4 focused at 1 m: 24 pixels of 10 µm at 0.5 m, one pixel at 0.96 and 1.04 m.
    blur = blur_diameter([0.5, 0.96, 1.04], 1.0, 30.5e-3, 30.5e-3 / 4) / 10e-6
    assert blur == pytest.approx([24.0, 1.0, 0.92], abs=0.05)


def test_an_object_in_the_front_focal_plane_fills_the_pupil() -> None:
    assert float(blur_diameter(30.5e-3, 1.0, 30.5e-3, 7e-3)) == pytest.approx(7e-3, rel=1e-12)
    assert blur_diameter(math.inf, math.inf, 30.5e-3, 7e-3) == 0.0

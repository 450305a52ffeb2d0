"""What a depth step hides and how a slope is foreshortened: against intersecting and projecting rays."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.triangulation import foreshortening_ratio, hidden_strip_width


def seen_through(view, edge_x, edge_z, floor_z):
    """Where a ray from a view past an edge meets the floor behind it."""
    return view + (edge_x - view) * floor_z / edge_z


@settings(max_examples=60, deadline=None)
@given(
    edge=st.floats(-0.2, 0.2),
    distance=st.floats(0.05, 5.0),
    height=st.floats(1e-4, 0.5),
    baseline=st.floats(1e-4, 0.2),
)
def test_strip_lies_between_the_rays_of_both_views_past_the_edge(edge, distance, height, baseline):
    floor = distance + height
    rays = [seen_through(view, edge, distance, floor) for view in (-baseline / 2, baseline / 2)]
    found = hidden_strip_width(height, distance, baseline)
    assert found == pytest.approx(abs(rays[1] - rays[0]), rel=1e-9, abs=1e-15)


def test_published_strips_of_a_stereo_rig_and_of_a_pupil():
    found = hidden_strip_width(10e-3, 0.150, [100e-3, 3.3e-3])
    np.testing.assert_allclose(found, [6.7e-3, 0.22e-3], rtol=6e-3)


@pytest.mark.parametrize("width", [0.2e-3, 1e-3, 5e-3, 20e-3])
def test_a_narrow_obstacle_hides_no_more_than_its_shadow(width):
    distance, height, baseline = 0.15, 10e-3, 0.1
    floor = distance + height
    shadows = [[seen_through(view, x, distance, floor) for x in (-width / 2, width / 2)] for view in (-0.05, 0.05)]
    x = np.linspace(-0.03, 0.03, 600_001)
    left, right = ((x > min(shadow)) & (x < max(shadow)) for shadow in shadows)
    only_one_view = np.count_nonzero(left & ~right) * (x[1] - x[0])
    found = hidden_strip_width(height, distance, baseline, obstacle_width=width)
    assert found == pytest.approx(only_one_view, abs=3 * (x[1] - x[0]))


def test_no_step_and_no_baseline_hide_nothing():
    assert hidden_strip_width(0.0, 0.15, 0.1) == 0.0
    assert hidden_strip_width(0.01, 0.15, 0.0) == 0.0
    assert hidden_strip_width(0.01, math.inf, 0.1) == 0.0


@settings(max_examples=60, deadline=None)
@given(
    tilt=st.floats(-1.4, 1.4),
    distance=st.floats(0.1, 5.0),
    baseline=st.floats(0.0, 0.2),
    lateral=st.floats(-0.3, 0.3),
)
def test_the_ratio_is_that_of_the_images_of_a_short_segment(tilt, distance, baseline, lateral):
    length = 1e-7 * distance
    images = []
    for view in (-baseline / 2, baseline / 2):
        begin = (lateral - view) / distance
        end = (lateral + length * math.cos(tilt) - view) / (distance + length * math.sin(tilt))
        images.append((end - begin) / length * distance)
    found = float(foreshortening_ratio(tilt, distance, baseline, lateral_position=lateral))
    if min(images) > 1e-3:
        assert found == pytest.approx(min(images) / max(images), abs=1e-4)
    elif min(images) < -1e-3:
        assert found == 0.0
    assert 0.0 <= found <= 1.0


def test_a_patch_across_the_view_looks_the_same_from_both_sides():
    assert foreshortening_ratio(0.0, 0.15, 0.1) == 1.0
    assert foreshortening_ratio(0.7, 0.15, 0.0) == 1.0


def test_stereo_foreshortens_a_steep_close_slope_that_a_pupil_sees_evenly():
    slope = math.radians(45)
    stereo, pupil = foreshortening_ratio(slope, 0.150, np.array([100e-3, 3.3e-3]))
    assert stereo == pytest.approx(0.5, rel=1e-12)  # (1 − 1/3)/(1 + 1/3)
    assert pupil > 0.97
    assert foreshortening_ratio(math.radians(72), 0.150, 100e-3) == 0.0  # the far view looks at its back


@pytest.mark.parametrize(
    "call",
    [
        lambda: hidden_strip_width(-1e-3, 0.15, 0.1),
        lambda: hidden_strip_width(1e-3, 0.0, 0.1),
        lambda: hidden_strip_width(1e-3, 0.15, -0.1),
        lambda: hidden_strip_width(1e-3, 0.15, 0.1, obstacle_width=-1.0),
        lambda: foreshortening_ratio(math.pi / 2, 0.15, 0.1),
        lambda: foreshortening_ratio(0.1, 0.0, 0.1),
        lambda: foreshortening_ratio(0.1, 0.15, -0.1),
    ],
)
def test_impossible_geometry_is_refused(call):
    with pytest.raises(OutOfRangeError) as refused:
        call()
    assert refused.value.limit

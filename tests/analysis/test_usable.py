"""Usable intervals: ends against closed forms, and boundaries of known conditions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.cameras.builders import r5, stereo
from tradestudy.cameras.depth_camera import UsableCriteria
from tradestudy.cameras.parts import Lens
from tradestudy.depth.distribution import DepthDistribution
from tradestudy.depth.usable import END_OF_STUDY, Interval, all_met, boundaries, evaluate_limits, usable_intervals

GRID = np.geomspace(0.05, 10.0, 401)


@given(edge=st.floats(0.06, 9.0))
def test_boundaries_are_found_to_the_last_digits(edge: float) -> None:
    (found,) = boundaries(lambda points: points >= edge, GRID)
    assert found.begins
    assert found.distance == pytest.approx(edge, rel=4e-15)
    (ended,) = boundaries(lambda points: points <= edge, GRID)
    assert not ended.begins
    assert ended.distance == pytest.approx(edge, rel=4e-15)


def test_two_intervals_and_their_ends_are_found() -> None:
    found = boundaries(lambda points: (points < 0.3) | (points > 2.0), GRID)
    assert [(pytest.approx(end.distance, rel=1e-12), end.begins) for end in found] == [(0.3, False), (2.0, True)]


@given(edge=st.floats(0.06, 9.0), power=st.floats(0.3, 3.0), sign=st.sampled_from([1.0, -1.0]))
def test_a_condition_with_a_margin_needs_fewer_trials(edge: float, power: float, sign: float) -> None:
    trials: dict[bool, int] = {True: 0, False: 0}

    def kept(points: np.ndarray) -> np.ndarray:
        trials[True] += 1
        return sign * (points**power - edge**power)

    def holds(points: np.ndarray) -> np.ndarray:
        trials[False] += 1
        return sign * (points**power - edge**power) >= 0.0

    (by_amount,), (by_truth,) = boundaries(kept, GRID), boundaries(holds, GRID)
    assert by_amount.begins == by_truth.begins == (sign > 0.0)
    assert by_amount.distance == pytest.approx(edge, rel=1e-14)
    assert by_amount.distance == pytest.approx(by_truth.distance, rel=1e-14)
    # As many where an edge of a trial happens to be the edge itself; one more where a straight line leads past it.
    assert trials[True] <= trials[False] + 1


def test_following_a_margin_takes_fewer_trials_than_bisection() -> None:
    trials = {True: 0, False: 0}

    def condition(edge: float, by_amount: bool, points: np.ndarray) -> np.ndarray:
        trials[by_amount] += 1
        amount = edge**2 - points**2
        return amount if by_amount else amount >= 0.0

    for edge in np.geomspace(0.06, 9.0, 40):
        for by_amount in (True, False):
            boundaries(partial(condition, float(edge), by_amount), GRID)
    assert trials[True] < 0.8 * trials[False]


@pytest.mark.parametrize("below", [-1.0, -np.inf, np.nan, -1e-300])
@pytest.mark.parametrize("above", [1.0, np.inf, 1e-300])
def test_a_margin_that_jumps_is_followed_too(below: float, above: float) -> None:
    edges = np.array([0.3, 2.0, 7.0])

    def kept(points: np.ndarray) -> np.ndarray:
        return np.where(np.searchsorted(edges, points, side="right") % 2 == 1, above, below)

    found = boundaries(kept, GRID, kept(GRID) > 0.0)
    assert [end.begins for end in found] == [True, False, True]
    np.testing.assert_allclose([end.distance for end in found], edges, rtol=1e-15)


@pytest.mark.parametrize(
    "criteria",
    [
        UsableCriteria(overlap=0.5, blur_px=5.0, relative_uncertainty=0.2),
        UsableCriteria(overlap=0.5, disparity_step_px=4.0, failed_fraction=1e-3),
        UsableCriteria(relative_uncertainty=0.03),
    ],
)
def test_following_only_the_broken_limits_finds_the_ends_of_all_limits(criteria: UsableCriteria) -> None:
    rig = stereo(lens=Lens(focal_length=30.5e-3, f_number=8.0), focus_distance=2.0)
    intervals = usable_intervals(rig, criteria, GRID)
    assert intervals
    plain = boundaries(lambda points: all_met(evaluate_limits(rig, criteria, points), points.shape), GRID)
    inside = [end for one in intervals for end in (one.near, one.far) if GRID[0] < end < GRID[-1]]
    np.testing.assert_allclose(inside, [end.distance for end in plain], rtol=1e-9)  # a line by differences


@pytest.mark.parametrize("blur_px", [2.0, 8.0])
def test_a_limit_that_is_broken_between_two_points_where_it_holds_is_followed_too(blur_px: float) -> None:
    """Before the plane of covering an R5 covers totally again, where blur and uncertainty are far off."""
    criteria = UsableCriteria(
        availability=0.95, virtual_depth=2.0, blur_px=blur_px, failed_fraction=0.025, relative_uncertainty=0.1
    )
    (dense,) = usable_intervals(r5(), criteria, np.geomspace(0.04, 1.0, 400))
    (sparse,) = usable_intervals(r5(), criteria, np.array([0.04, 0.3, 0.4, 0.5, 0.7, 1.0]))
    assert (sparse.near, sparse.far) == pytest.approx((dense.near, dense.far), rel=1e-12)
    assert (sparse.near_limit, sparse.far_limit) == (dense.near_limit, dense.far_limit)


def test_limits_requested_by_name_equal_those_of_all() -> None:
    criteria = UsableCriteria(overlap=0.8, blur_px=2.0, relative_uncertainty=0.02, failed_fraction=0.01)
    rig = stereo(lens=Lens(focal_length=30.5e-3, f_number=8.0), focus_distance=2.0)
    everything = evaluate_limits(rig, criteria, GRID)
    for names in (["focus"], ["relative_uncertainty"], ["overlap", "failed_fraction"]):
        found = evaluate_limits(rig, criteria, GRID, names)
        assert set(found) == set(names)
        for name in names:
            np.testing.assert_array_equal(found[name].value, everything[name].value)
            np.testing.assert_array_equal(found[name].met, everything[name].met)


def test_limits_of_geometry_need_no_depth() -> None:
    criteria = UsableCriteria(overlap=0.8, blur_px=2.0, relative_uncertainty=0.02, failed_fraction=0.01)

    def depth(*_: object) -> DepthDistribution:
        raise AssertionError("no depth was asked for")

    assert set(evaluate_limits(stereo(), criteria, GRID, ["overlap", "focus"], depth=depth)) == {"overlap", "focus"}


def test_overlap_ends_the_stereo_range_near_and_focus_far() -> None:
    rig = stereo(lens=Lens(focal_length=30.5e-3, f_number=8.0), focus_distance=2.0)
    (interval,) = usable_intervals(rig, UsableCriteria(overlap=0.8, blur_px=2.0), GRID)
    # 1 − B/W with W = Z w/f; thin lens far limit a₀ H/(H − a₀ + f) with H = f²/(N c) + f.
    w, f, c, focus = 10.24e-3, 30.5e-3, 20e-6, 2.0
    near = 0.1 / 0.2 * f / w
    H = f**2 / (8.0 * c) + f
    far = focus * (H - f) / (H - focus)
    blur_near = focus * (H - f) / (H + focus - 2 * f)
    assert interval.near == pytest.approx(max(near, blur_near), rel=1e-9)
    assert interval.near_limit == ("overlap" if near > blur_near else "focus")
    assert interval.far == pytest.approx(far, rel=1e-9)
    assert interval.far_limit == "focus"


def test_a_plenoptic_camera_is_not_usable_where_no_point_is_seen_twice() -> None:
    """Discs of the light of one point, on a lattice of pitch √3 p, meet no two centres below that diameter."""
    (interval,) = usable_intervals(r5(), UsableCriteria(), GRID[GRID > 0.1])
    assert 2.0 * float(r5().radius_over_pitch(interval.near)) == pytest.approx(math.sqrt(3), rel=1e-9)
    assert interval.near_limit == "availability"


def test_total_covering_plane_is_the_published_one() -> None:
    (interval,) = usable_intervals(r5(), UsableCriteria(virtual_depth=2.0), GRID[GRID > 0.1])
    assert interval.near == pytest.approx(0.150, rel=1e-4)
    assert interval.near_limit == "total_covering_plane"
    assert interval.far_limit == END_OF_STUDY
    assert interval.far == 10.0


def test_pole_limits_are_named() -> None:
    criteria = UsableCriteria(virtual_depth=2.0, failed_fraction=0.025)
    (interval,) = usable_intervals(r5(), criteria, GRID[GRID > 0.1])
    # P(N(0,1) > (d − d∞)/σ) = 0.025: d(a) − d∞ = 1.96 σ, with d = √3 p b_L / a_L.
    z, f, gap, base = 14.77255e-3, 12.5e-3, 0.568093e-3, math.sqrt(3) * 126.5e-6
    d = base * gap / (z - f) + 1.959963984540054 * 0.1 * 5.5e-6
    shift = z - f - base * gap / d
    assert interval.far == pytest.approx(f + f**2 / shift, rel=1e-7)
    assert interval.far_limit == "failed_fraction"


def test_nothing_usable_is_an_empty_list() -> None:
    assert usable_intervals(stereo(), UsableCriteria(overlap=0.8, blur_px=0.5), GRID) == ()


def ends_of(intervals: Sequence[Interval]) -> list[float]:
    return [end for one in intervals for end in (one.near, one.far)]


def test_few_distances_hide_neither_a_gap_nor_a_stretch() -> None:
    """Twelve distances are farther apart than an R5 is out of focus, and two farther than a pair is sharp."""
    criteria = UsableCriteria(blur_px=0.9)
    few, many = (usable_intervals(r5(), criteria, np.geomspace(0.2, 1.2, count)) for count in (12, 4001))
    assert len(few) > 1
    assert ends_of(few) == pytest.approx(ends_of(many), rel=1e-9)
    pair = stereo(focus_distance=1.0)
    sharp = UsableCriteria(blur_px=0.5)
    few, many = (usable_intervals(pair, sharp, np.geomspace(0.2, 9.0, count)) for count in (2, 4001))
    assert few
    assert ends_of(few) == pytest.approx(ends_of(many), rel=1e-9)

"""How many microlenses see a point: against brute-force counting, closed forms at 30 digits and published figures."""

import itertools
import math

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import qmc

from tradestudy.errors import OutOfRangeError, UnaffordableError
from tradestudy.optics.equivalent_baseline import least_squares_baseline, widest_pair_baseline
from tradestudy.optics.microlens_coverage import (
    covering_microlens_object_distance,
    covering_radius_over_pitch,
    mean_seen_count,
    projected_radius_over_pitch,
    seen_count_probability,
)

SECOND_VECTOR = {"hexagonal": (0.5, math.sqrt(3) / 2), "square": (0.0, 1.0)}
COUNTINGS = ("all_lenses", "given_type", "some_type", "every_type")


def lenses(layout, reach):
    """All lenses around the cell, and the type of each in the three-type array (neighbours always differ)."""
    n = math.ceil(reach / 0.8) + 8
    i, j = (index.ravel() for index in np.mgrid[-2 * n : 2 * n + 1, -n : n + 1])
    dx, dy = SECOND_VECTOR[layout]
    positions = np.stack((i + dx * j, dy * j), axis=-1)
    near = np.hypot(*positions.T) < reach + 6
    return positions[near], ((i + 2 * j) % 3)[near]


def points(layout, log2_count, periods=3):
    """Low-discrepancy positions in a cell of the lattice, or of the lattice of types."""
    share = qmc.Sobol(2, seed=7).random_base2(log2_count) * periods
    dx, dy = SECOND_VECTOR[layout]
    return np.stack((share[:, 0] + dx * share[:, 1], dy * share[:, 1]), axis=-1)


def counted_share(radius, layout, counting, at_least):
    """Count lenses around many points one by one."""
    centre, kind = lenses(layout, radius)
    where = points(layout, 13)
    seen = np.hypot(*(where[:, np.newaxis] - centre).transpose(2, 0, 1)) <= radius
    of_type = np.stack([np.sum(seen[:, kind == t], axis=1) for t in range(3)])
    count = {
        "all_lenses": np.sum(seen, axis=1),
        "given_type": of_type[1],
        "some_type": np.max(of_type, axis=0),
        "every_type": np.min(of_type, axis=0),
    }[counting]
    return np.mean(count >= at_least)


@pytest.mark.parametrize(
    ("layout", "types", "counting", "at_least", "radius"),
    [("hexagonal", 3, counting, k, r) for counting in COUNTINGS for k, r in ((1, 0.55), (2, 1.05), (3, 1.6), (5, 1.9))]
    + [("square", 1, "all_lenses", k, r) for k, r in ((1, 0.6), (2, 0.8), (4, 1.1), (9, 1.75))],
)
def test_share_of_points_agrees_with_counting_lenses_one_by_one(layout, types, counting, at_least, radius):
    exact = seen_count_probability(radius, at_least=at_least, layout=layout, types=types, counting=counting)
    assert exact == pytest.approx(counted_share(radius, layout, counting, at_least), abs=4e-3)


def overlap(distance, radius):
    """Area that two discs share, at 30 digits."""
    d, r = mpmath.mpf(distance), mpmath.mpf(radius)
    if d >= 2 * r:
        return mpmath.mpf(0)
    return 2 * r**2 * mpmath.acos(d / (2 * r)) - d / 2 * mpmath.sqrt(4 * r**2 - d**2)


@pytest.mark.parametrize(
    ("layout", "radius"), [("hexagonal", 0.62), ("hexagonal", 1.3), ("square", 0.93), ("square", 1.4)]
)
def test_first_two_moments_of_the_count_are_those_of_overlapping_discs(layout, radius):
    # Σ P(n ≥ k) = mean, and Σ (2k − 1) P(n ≥ k) = Σ over pairs of lenses of the overlap of their discs, over the cell.
    tail = np.array([float(seen_count_probability(radius, at_least=k, layout=layout)) for k in range(1, 17)])
    with mpmath.workdps(30):
        dx, dy = (mpmath.mpf(1) / 2, mpmath.sqrt(3) / 2) if layout == "hexagonal" else (mpmath.mpf(0), mpmath.mpf(1))
        cell = dy
        span = range(-4, 5)
        squared = mpmath.fsum(
            overlap(mpmath.hypot(i + dx * j, dy * j), radius) for i, j in itertools.product(span, span)
        )
        mean = mpmath.pi * mpmath.mpf(radius) ** 2 / cell
        assert tail.sum() == pytest.approx(float(mean), abs=1e-13)
        assert np.sum((2 * np.arange(1, 17) - 1) * tail) == pytest.approx(float(squared / cell), abs=1e-12)
    assert mean_seen_count(radius, layout=layout) == pytest.approx(float(mean), rel=1e-14)


def test_published_shares_of_points_seen_once_or_not_at_all():
    np.testing.assert_allclose(1 - seen_count_probability([0.75, 0.6], at_least=2), [0.26, 0.70], atol=0.005)
    assert mean_seen_count(1.5) == pytest.approx(0.907 * 3.0**2, rel=1e-3)
    assert mean_seen_count(1.5, types=3) == pytest.approx(0.907 * 3.0**2 / 3, rel=1e-3)


def test_published_shares_of_points_without_a_pair_of_the_same_type():
    some = 1 - seen_count_probability(1.0, at_least=2, types=3, counting="some_type")
    given_type = 1 - seen_count_probability([1.0, 1.21, 1.535], at_least=2, types=3, counting="given_type")
    assert some == pytest.approx(0.37, abs=0.005)
    np.testing.assert_allclose(given_type, [0.79, 0.39, 0.05], atol=0.007)


@pytest.mark.parametrize(
    ("counting", "at_least", "radius"),
    [
        ("all_lenses", 1, 1 / math.sqrt(3)),  # the corner of a cell
        ("all_lenses", 2, 1.0),  # a lens itself: its neighbours are one pitch away
        ("some_type", 2, 2 / math.sqrt(3)),
        ("given_type", 2, math.sqrt(3)),
        ("every_type", 2, math.sqrt(3)),
    ],
)
def test_every_point_is_covered_exactly_from_the_covering_radius_on(counting, at_least, radius):
    question = {"at_least": at_least, "types": 3, "counting": counting}
    assert covering_radius_over_pitch(**question) == pytest.approx(radius, rel=1e-14)
    inside = seen_count_probability([radius, radius * (1 - 1e-4), np.inf], **question)
    assert inside[0] == 1.0
    assert 0.99 < inside[1] < 1.0
    assert inside[2] == 1.0


def test_no_point_is_seen_by_two_lenses_before_discs_reach_half_a_pitch():
    shares = seen_count_probability([0.0, 0.3, 0.5, 0.5001], at_least=2)
    assert np.all(shares[:3] == 0.0)
    assert shares[3] > 0.0


@settings(max_examples=30, deadline=None)
@given(radius=st.floats(0.0, 4.0), at_least=st.integers(1, 6), counting=st.sampled_from(COUNTINGS))
def test_share_rises_with_the_disc_and_falls_with_the_number_asked_for(radius, at_least, counting):
    def share(r, k, how):
        return float(seen_count_probability(r, at_least=k, types=3, counting=how))

    p = share(radius, at_least, counting)
    rounding = 1e-12
    assert 0.0 <= p <= 1.0
    assert share(radius * 1.01, at_least, counting) >= p - rounding
    assert share(radius, at_least + 1, counting) <= p + rounding
    assert share(radius, at_least, "every_type") <= share(radius, at_least, "given_type") + rounding
    assert share(radius, at_least, "given_type") <= share(radius, at_least, "some_type") + rounding
    assert share(radius, at_least, "some_type") <= share(radius, at_least, "all_lenses") + rounding


def brute_force_baselines(radius, layout, log2_count):
    """1/B² of the widest pair and of least squares, averaged point by point over those with a pair."""
    centre, _ = lenses(layout, radius)
    inverse = []
    for where in points(layout, log2_count, periods=1):
        x = centre[np.hypot(*(centre - where).T) <= radius]
        if len(x) >= 2:
            widest = np.max(np.sum((x[:, np.newaxis] - x) ** 2, axis=-1))
            inverse.append((1 / widest, 0.5 / np.sum((x - x.mean(axis=0)) ** 2)))
    return 1 / np.sqrt(np.mean(inverse, axis=0))


@pytest.mark.parametrize("layout", ["hexagonal", "square"])
@pytest.mark.parametrize(
    ("radius", "log2_count", "sampling"), [(0.8, 12, 6e-3), (1.1, 12, 6e-3), (2.3, 11, 3e-3), (5.0, 9, 2e-3)]
)
def test_baselines_agree_with_averaging_over_points_one_by_one(layout, radius, log2_count, sampling):
    widest, least_squares = brute_force_baselines(radius, layout, log2_count)
    assert widest_pair_baseline(radius, layout=layout).over_pitch == pytest.approx(widest, rel=sampling)
    assert least_squares_baseline(radius, layout=layout).over_pitch == pytest.approx(least_squares, rel=sampling)


@pytest.mark.parametrize("radius", [8.0, 13.0])
def test_baselines_beyond_the_table_stay_within_their_stated_error(radius):
    widest, least_squares = brute_force_baselines(radius, "hexagonal", 6)
    for law, brute in ((widest_pair_baseline, widest), (least_squares_baseline, least_squares)):
        found = law(radius)
        sampling = 1e-3
        assert abs(found.over_pitch / brute - 1) <= found.relative_error + sampling
        assert found.relative_error < 0.011


def test_baselines_with_exactly_two_lenses_are_one_pitch():
    for law in (widest_pair_baseline, least_squares_baseline):
        assert law(0.5001).over_pitch == pytest.approx(1.0, rel=1e-9)
        assert law(0.51, types=3).over_pitch == pytest.approx(law(0.51).over_pitch, rel=1e-12)
        assert law(0.9, types=3, counting="given_type").over_pitch == pytest.approx(math.sqrt(3), rel=1e-3)


def test_baselines_give_the_known_growth_of_noise_with_virtual_depth():
    v = np.array([4.0, 5.0, 6.0])
    widest = math.sqrt(2) * v / widest_pair_baseline(v / 2).over_pitch
    assert np.all((widest > 1.5) & (widest < 1.6))
    flat = math.sqrt(2) * np.array([8.0, 12.0, 40.0]) ** 2 / least_squares_baseline([4.0, 6.0, 20.0]).over_pitch
    np.testing.assert_allclose(flat, 2.97, rtol=2e-3)
    assert flat[-1] == pytest.approx(4 * math.sqrt(math.sqrt(3) / math.pi), rel=1e-3)


def test_baseline_is_not_a_number_where_no_point_has_a_pair():
    found = widest_pair_baseline([0.3, 0.5, 0.8])
    assert np.isnan(found.over_pitch).tolist() == [True, True, False]
    assert np.isnan(found.relative_error).tolist() == [True, True, False]
    assert np.all(np.isfinite(least_squares_baseline([0.6, 30.0, 300.0]).over_pitch))


def test_disc_of_light_is_where_the_rays_from_the_edge_of_the_pupil_meet_the_array():
    z, pupil, pitch = 14.773e-3, 3.289e-3, 126.5e-6
    for a_L in (1.136e-3, 0.2e-3, -0.9e-3, -20e-3):
        b = z - a_L
        edge_ray_on_array = pupil / 2 * (1 - z / b)  # a straight ray from the edge through the axial image point
        found = projected_radius_over_pitch(
            microlens_object_distance=a_L, mla_distance=z, pupil_diameter=pupil, microlens_pitch=pitch
        )
        assert found == pytest.approx(abs(edge_ray_on_array) / pitch, rel=1e-12)


def test_disc_of_light_has_its_limits():
    part = {"mla_distance": 14.773e-3, "pupil_diameter": 3.289e-3, "microlens_pitch": 126.5e-6}
    assert projected_radius_over_pitch(microlens_object_distance=0.0, **part) == 0.0
    half_pupil = 3.289e-3 / 2 / 126.5e-6
    assert projected_radius_over_pitch(microlens_object_distance=-np.inf, **part) == pytest.approx(half_pupil)
    with pytest.raises(OutOfRangeError, match="front focal point"):
        projected_radius_over_pitch(microlens_object_distance=0.02, **part)


@pytest.mark.parametrize("keplerian", [True, False])
def test_covering_plane_has_the_disc_asked_for(keplerian):
    part = {"mla_distance": 14.773e-3, "pupil_diameter": 3.289e-3, "microlens_pitch": 126.5e-6}
    radius = np.array([0.6, 1.0, 2.0 / math.sqrt(3)])
    a_L = covering_microlens_object_distance(radius, keplerian=keplerian, **part)
    assert np.all((a_L > 0) == keplerian)
    np.testing.assert_allclose(projected_radius_over_pitch(microlens_object_distance=a_L, **part), radius, rtol=1e-12)


def test_covering_plane_at_virtual_depth_two_with_matched_f_numbers_close_to_the_array():
    # b_L/p = z/A; as a_L ≪ z the disc of one pitch is |v| = 2.
    z, pupil, pitch = 10.0, 1.0, 1e-6
    gap = pitch * z / pupil
    a_L = covering_microlens_object_distance(
        covering_radius_over_pitch(at_least=2),
        keplerian=True,
        mla_distance=z,
        pupil_diameter=pupil,
        microlens_pitch=pitch,
    )
    assert a_L / gap == pytest.approx(2.0, rel=1e-5)


def test_galilean_relay_cannot_have_a_disc_larger_than_the_pupil():
    with pytest.raises(OutOfRangeError, match="open the aperture"):
        covering_microlens_object_distance(
            2.0, keplerian=False, mla_distance=0.01, pupil_diameter=1e-3, microlens_pitch=0.5e-3
        )


@pytest.mark.parametrize(
    "question",
    [
        {"radius_over_pitch": -1.0},
        {"radius_over_pitch": np.nan},
        {"layout": "triangular"},
        {"types": 2},
        {"types": 3, "layout": "square"},
        {"counting": "none"},
        {"at_least": 0},
    ],
)
def test_questions_without_meaning_are_refused(question):
    asked = {"radius_over_pitch": 1.0, "at_least": 2, **question}
    with pytest.raises(OutOfRangeError):
        seen_count_probability(asked.pop("radius_over_pitch"), **asked)


def test_numbers_beyond_the_table_are_refused_with_the_limit():
    with pytest.raises(UnaffordableError, match="32"):
        seen_count_probability(5.0, at_least=33)


def test_a_baseline_of_types_that_are_not_named_is_refused():
    with pytest.raises(OutOfRangeError, match="given_type"):
        widest_pair_baseline(1.0, types=3, counting="some_type")

"""How many microlenses see a point: against brute-force counting, closed forms at 30 digits and published figures."""

import math

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import qmc

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.equivalent_baseline import equivalent_baseline
from tradestudy.optics.microlens_coverage import (
    PAIR_COVERING_RADIUS,
    covering_microlens_object_distance,
    mean_seen_count,
    pair_probability,
    projected_radius_over_pitch,
)

SECOND_VECTOR = {"hexagonal": (0.5, math.sqrt(3) / 2), "square": (0.0, 1.0)}
SAME_TYPE = math.sqrt(3)  # pitch of the lattice of each of three types


def lenses(layout, reach):
    """All lenses around the cell."""
    n = math.ceil(reach / 0.8) + 8
    i, j = (index.ravel() for index in np.mgrid[-2 * n : 2 * n + 1, -n : n + 1])
    dx, dy = SECOND_VECTOR[layout]
    positions = np.stack((i + dx * j, dy * j), axis=-1)
    return positions[np.hypot(*positions.T) < reach + 6]


def points(layout, log2_count):
    """Low-discrepancy positions in a cell of the lattice."""
    share = qmc.Sobol(2, seed=7).random_base2(log2_count)
    dx, dy = SECOND_VECTOR[layout]
    return np.stack((share[:, 0] + dx * share[:, 1], dy * share[:, 1]), axis=-1)


@pytest.mark.parametrize("layout", ["hexagonal", "square"])
@pytest.mark.parametrize("radius", [0.55, 0.6, 0.7, 0.75, 0.8, 0.9, 0.97])
def test_share_of_points_agrees_with_counting_lenses_one_by_one(layout, radius):
    centre = lenses(layout, radius)
    seen = np.hypot(*(points(layout, 13)[:, np.newaxis] - centre).transpose(2, 0, 1)) <= radius
    counted = np.mean(np.sum(seen, axis=1) >= 2)
    assert pair_probability(np.array(radius), layout=layout) == pytest.approx(counted, abs=2e-3)


def overlap(distance, radius):
    """Area that two discs share, at 30 digits."""
    d, r = mpmath.mpf(distance), mpmath.mpf(radius)
    if d >= 2 * r:
        return mpmath.mpf(0)
    return 2 * r**2 * mpmath.acos(d / (2 * r)) - d / 2 * mpmath.sqrt(4 * r**2 - d**2)


@pytest.mark.parametrize(
    ("layout", "radius"),
    [("hexagonal", r) for r in (0.5001, 0.52, 0.57, 0.58, 0.62, 0.74, 0.86)]
    + [("square", r) for r in (0.51, 0.6, 0.7)],
)
def test_share_of_points_follows_from_the_overlaps_of_discs(layout, radius):
    # Below the corner of a cell, no point has three lenses: the share is the overlap of pairs. From there to √3/2, each
    # point of a hexagonal cell has one to three, and the mean and the pairs per point give all three shares.
    with mpmath.workdps(30):
        cell = mpmath.sqrt(3) / 2 if layout == "hexagonal" else 1
        pairs = (3 if layout == "hexagonal" else 2) * overlap(1, radius) / cell
        mean = mpmath.pi * mpmath.mpf(radius) ** 2 / cell
        three = pairs - mean + 1
        exact = mean - 1 - three if layout == "hexagonal" and radius > 1 / math.sqrt(3) else pairs
    assert pair_probability(np.array(radius), layout=layout) == pytest.approx(float(exact), abs=1e-14)
    assert mean_seen_count(np.array(radius), layout=layout) == pytest.approx(float(mean), rel=1e-14)


def test_published_shares_of_points_seen_once_or_not_at_all():
    shares = 1 - pair_probability(np.array([0.75, 0.6]), layout="hexagonal")
    np.testing.assert_allclose(shares, [0.26, 0.70], atol=0.005)
    assert mean_seen_count(np.array(1.5), layout="hexagonal") == pytest.approx(0.907 * 3.0**2, rel=1e-3)


def test_published_shares_of_points_without_a_pair_of_the_same_type():
    given_type = 1 - pair_probability(np.array([1.0, 1.21, 1.535]) / SAME_TYPE, layout="hexagonal")
    np.testing.assert_allclose(given_type, [0.79, 0.39, 0.05], atol=0.007)


@pytest.mark.parametrize("layout", ["hexagonal", "square"])
def test_every_point_is_covered_exactly_from_the_covering_radius_on(layout):
    inside = pair_probability(PAIR_COVERING_RADIUS * np.array([1.0, 1.0 - 1e-4, np.inf]), layout=layout)
    assert inside[0] == 1.0
    assert 0.99 < inside[1] < 1.0
    assert inside[2] == 1.0


def test_no_point_is_seen_by_two_lenses_before_discs_reach_half_a_pitch():
    shares = pair_probability(np.array([0.0, 0.3, 0.5, 0.5001]), layout="hexagonal")
    assert np.all(shares[:3] == 0.0)
    assert shares[3] > 0.0


@settings(max_examples=30, deadline=None)
@given(radius=st.floats(0.0, 4.0), layout=st.sampled_from(["hexagonal", "square"]))
def test_share_rises_with_the_disc(radius, layout):
    share, wider = pair_probability(np.array([radius, radius * 1.01]), layout=layout)
    assert 0.0 <= share <= wider + 1e-12


def brute_force_baselines(radius, layout, log2_count):
    """1/B² of the widest pair and of least squares, averaged point by point over those with a pair."""
    centre = lenses(layout, radius)
    inverse = []
    for where in points(layout, log2_count):
        x = centre[np.hypot(*(centre - where).T) <= radius]
        if len(x) >= 2:
            widest = np.max(np.sum((x[:, np.newaxis] - x) ** 2, axis=-1))
            inverse.append((1 / widest, 0.5 / np.sum((x - x.mean(axis=0)) ** 2)))
    return 1 / np.sqrt(np.mean(inverse, axis=0))


def baseline(radius, judged, layout="hexagonal"):
    return equivalent_baseline(np.asarray(radius), layout=layout, judged=judged)


@pytest.mark.parametrize("layout", ["hexagonal", "square"])
@pytest.mark.parametrize(
    ("radius", "log2_count", "sampling"), [(0.8, 12, 6e-3), (1.1, 12, 6e-3), (2.3, 11, 3e-3), (5.0, 9, 2e-3)]
)
def test_baselines_agree_with_averaging_over_points_one_by_one(layout, radius, log2_count, sampling):
    widest, least_squares = brute_force_baselines(radius, layout, log2_count)
    assert baseline(radius, "widest-pair", layout) == pytest.approx(widest, rel=sampling)
    assert baseline(radius, "least-squares", layout) == pytest.approx(least_squares, rel=sampling)


@pytest.mark.parametrize("radius", [8.0, 13.0])
def test_baselines_beyond_the_table_stay_within_half_the_deficit_from_the_limit(radius):
    widest, least_squares = brute_force_baselines(radius, "hexagonal", 6)
    limits = {"widest-pair": 2 * radius, "least-squares": radius**2 * math.sqrt(math.pi / (math.sqrt(3) / 2))}
    for judged, brute in (("widest-pair", widest), ("least-squares", least_squares)):
        law, limit = baseline(radius, judged), limits[judged]
        sampling = 1e-3
        assert abs(law / brute - 1) <= abs(1 - law / limit) / 2 + sampling
        assert abs(1 - law / limit) < 0.02


def test_baselines_with_exactly_two_lenses_are_one_pitch():
    for judged in ("widest-pair", "least-squares"):
        assert baseline(0.5001, judged) == pytest.approx(1.0, rel=1e-9)


def test_baselines_give_the_known_growth_of_noise_with_virtual_depth():
    v = np.array([4.0, 5.0, 6.0])
    widest = math.sqrt(2) * v / baseline(v / 2, "widest-pair")
    assert np.all((widest > 1.5) & (widest < 1.6))
    flat = math.sqrt(2) * np.array([8.0, 12.0, 40.0]) ** 2 / baseline([4.0, 6.0, 20.0], "least-squares")
    np.testing.assert_allclose(flat, 2.97, rtol=2e-3)
    assert flat[-1] == pytest.approx(4 * math.sqrt(math.sqrt(3) / math.pi), rel=1e-3)


def test_baseline_is_not_a_number_where_no_point_has_a_pair():
    assert np.isnan(baseline([0.3, 0.5, 0.8], "widest-pair")).tolist() == [True, True, False]
    assert np.all(np.isfinite(baseline([0.6, 30.0, 300.0], "least-squares")))


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
        PAIR_COVERING_RADIUS,
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

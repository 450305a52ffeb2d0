"""The table of a camera against depth computed at the distances themselves, and what its readers may miss."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.analysis.plain_depths import of_rig
from tests.cameras.builders import r5, stereo, unfocused
from tradestudy.answers.decision import decide_pair
from tradestudy.cameras.calibration import Calibration, Propagation
from tradestudy.cameras.depth_camera import DepthCamera, UsableCriteria
from tradestudy.depth import table
from tradestudy.depth.evaluation import ERROR_SOURCES, distribution, imaged
from tradestudy.depth.table import distribution_between, judged_uncertainty
from tradestudy.study.prepared import Case
from tradestudy.uncertainty.distributions import Normal, Uniform

GRID = np.geomspace(0.05, 10.0, 401)
JUDGED = Propagation(judged=(0.05, 1.0, 10.0))


def random_camera(rng: np.random.Generator, propagation: Propagation = JUDGED) -> DepthCamera:
    """A camera of any kind that measures depth, with random noise and calibration errors."""
    pair = rng.random() < 0.5
    build = stereo if pair else (r5, unfocused)[int(rng.integers(2))]
    sources = [of_rig("yaw", Normal(mean=0.0, standard_deviation=float(rng.uniform(1e-5, 3e-3))))] if pair else []
    sources.append(of_rig("focal_length", Normal(mean=0.0, standard_deviation=float(rng.uniform(1e-7, 2e-5)))))
    return build(
        disparity_error_px=float(10.0 ** rng.uniform(-2.0, 0.3)),
        calibration=Calibration(groups=tuple(sources)),
        propagation=propagation,
    )


@pytest.mark.parametrize("seed", range(12))
def test_a_table_gives_what_is_computed_at_the_distances(seed: int) -> None:
    rng = np.random.default_rng(seed)
    camera = random_camera(rng)
    places = np.sort(np.exp(rng.uniform(np.log(GRID[0]), np.log(GRID[-1]), 300)))
    for source in ERROR_SOURCES:
        read, own = (
            distribution_between(camera, places, source),
            distribution(camera, imaged(camera, places), source),
        )
        np.testing.assert_array_equal(np.isfinite(read.judged), np.isfinite(own.judged))
        some = np.isfinite(own.judged)
        np.testing.assert_allclose(read.judged[some], own.judged[some], rtol=1e-6)
        np.testing.assert_allclose(read.quantile[:, some], own.quantile[:, some], rtol=1e-7)
        np.testing.assert_allclose(read.failed_fraction, own.failed_fraction, atol=1e-6)


def test_a_table_of_draws_adds_less_than_their_standard_error() -> None:
    exact = Propagation(model="exact", judged=(0.1, 0.5, 2.0, 10.0))
    camera = stereo(calibration=Calibration(groups=(of_rig("yaw", Uniform(low=-4e-3, high=4e-3)),)), propagation=exact)
    places = np.geomspace(0.31, 9.7, 41)
    read, own = distribution_between(camera, places), distribution(camera, places, "both")
    bounded = np.isfinite(own.judged)
    assert bounded.sum() > 20
    assert np.all(np.abs(read.judged - own.judged)[bounded] < own.judged_error[bounded])


def test_failures_of_a_feature_narrower_than_the_nodes_are_computed_there() -> None:
    """Around 81.23 mm, where the image lies on the microlenses, an R5 fails far more often than at the nodes around."""
    array = of_rig("mla_distance", Normal(mean=0.0, standard_deviation=1e-6))
    camera = r5(propagation=JUDGED, calibration=Calibration(groups=(array,)))
    places = np.linspace(0.0805, 0.082, 301)
    own = distribution(camera, places, "both").failed_fraction
    assert own.max() > 0.4
    np.testing.assert_allclose(distribution_between(camera, places).failed_fraction, own, atol=1e-7)


def test_beside_distances_without_a_depth_draws_are_interpolated(monkeypatch: pytest.MonkeyPatch) -> None:
    """A rig sees nothing nearer than 83 mm; only there, between two nodes, is the distribution computed."""
    exact = Propagation(model="exact", judged=(0.05, 0.5, 2.0, 10.0))
    yaw = of_rig("yaw", Uniform(low=-4e-3, high=4e-3))
    camera = stereo(calibration=Calibration(groups=(yaw,)), propagation=exact)
    nearest = float(GRID[np.isfinite(distribution(camera, GRID, "both").judged)][0])
    places = nearest * np.linspace(1.1, 1.3, 12)
    own = distribution(camera, places, "both")
    distribution_between(camera, places)  # makes the table
    computed = []
    monkeypatch.setattr(table, "distribution", lambda *asked: computed.append(asked))
    read = distribution_between(camera, places)
    assert np.all(np.abs(read.judged - own.judged) < own.judged_error)
    assert not computed


def test_beyond_the_range_of_the_study_and_without_one_depth_is_computed() -> None:
    for camera, places in ((stereo(propagation=JUDGED), [12.0, 40.0]), (stereo(), [0.5, 12.0])):
        own = distribution(camera, np.array(places), "both").judged
        np.testing.assert_array_equal(distribution_between(camera, np.array(places)).judged, own)


def test_no_pair_of_crossings_is_missed_in_random_studies() -> None:
    """Every change of the lead on a much denser grid is between two crossings that were found."""
    rng, missed, known = np.random.default_rng(11), 0, 0
    dense = np.geomspace(GRID[0], GRID[-1], 8001)
    for _ in range(12):
        cameras = {"first": random_camera(rng), "second": random_camera(rng)}
        case = Case(cameras=cameras, all_cameras=cameras, criteria=UsableCriteria(), distance=GRID, wavelength=550e-9)
        crossings = decide_pair(case, ("first", "second"), np.array([1.0])).crossings["both"]
        with np.errstate(divide="ignore", invalid="ignore"):  # unbounded intervals are valid
            ratio = np.divide(*(judged_uncertainty(one, dense) for one in cameras.values()))
        lead = np.sign(np.where(np.isnan(ratio) | (np.abs(ratio - 1.0) < 1e-8), 1.0, ratio) - 1.0)
        lead = lead[lead != 0.0]
        turns = int(np.sum(lead[1:] != lead[:-1]))
        missed += abs(turns - len(crossings))
        known += turns
    assert known > 5
    assert missed == 0


def test_tables_follow_changes_of_the_camera() -> None:
    camera = stereo(propagation=JUDGED)
    worse = replace(camera, disparity_error_px=2.0 * float(np.asarray(camera.disparity_error_px)))
    at = np.array([0.7])
    doubled = 2.0 * judged_uncertainty(camera, at, "noise")
    assert judged_uncertainty(worse, at, "noise") == pytest.approx(doubled, rel=0.01)


def test_a_table_of_draws_keeps_its_error_where_an_interval_is_about_to_become_unbounded() -> None:
    """There the scrambles differ so much that their spread would allow errors of three per cent."""
    exact = Propagation(model="exact", judged=(0.1, 0.5, 2.0, 10.0))
    yaw, baseline = (Normal(mean=0.0, standard_deviation=size) for size in (1.5e-2, 1e-3))
    errors = Calibration(groups=(of_rig("yaw", yaw), of_rig("baseline", baseline)))
    camera = stereo(calibration=errors, propagation=exact, disparity_error_px=3.0)
    places = np.geomspace(1.0, 9.9, 90)
    read, own = distribution_between(camera, places), distribution(camera, places, "both")
    bounded = np.isfinite(own.half_width)
    assert 60 < bounded.sum() < 90
    np.testing.assert_allclose(read.half_width[bounded], own.half_width[bounded], rtol=2e-3)

"""Exact propagation: what its stated error covers, what draws have in common, what they do not depend on."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom, t

from tests.analysis.plain_depths import (
    CENTRAL,
    PIXEL,
    B,
    half_width,
    of_rig,
    stereo_depth,
    yaw_and_noise_quantile,
)
from tests.analysis.test_depth import R5_CALIBRATION, STEREO_CALIBRATION
from tests.cameras.builders import r5, stereo
from tradestudy.cameras.calibration import Calibration, Propagation
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.depth import draws as depth_draws
from tradestudy.depth.distribution import DepthDistribution
from tradestudy.depth.draws import SCRAMBLES, exact_distribution, settled_draws
from tradestudy.depth.evaluation import distribution
from tradestudy.uncertainty.distributions import Normal, Uniform
from tradestudy.uncertainty.joint import JointDraws
from tradestudy.uncertainty.sources import ErrorClass

EXACT = Propagation(model="exact")
YAWED = Calibration(groups=(of_rig("yaw", Uniform(low=-4e-3, high=4e-3)),))
STRETCHED = Calibration(groups=(of_rig("baseline", Normal(mean=0.0, standard_deviation=0.08 * B)),))
SEEDS, CLAIMED = 200, 0.95


def covered(camera: DepthCamera, distance: float, true: float) -> int:
    """In how many of so many seeds the t-interval of the half width holds the true one."""
    reach, count = t.ppf(0.5 + CLAIMED / 2, SCRAMBLES - 1), 0
    for seed in range(SEEDS):
        one = replace(camera, propagation=replace(EXACT, seed=seed))
        found = distribution(one, np.array([distance]), "both")
        count += abs(found.half_width[0] - true) <= reach * found.half_width_error[0]
    return count


@pytest.mark.parametrize("distance", [1.0, 6.0])
def test_the_t_interval_covers_quadrature_over_a_uniform_yaw(distance: float) -> None:
    rig = stereo(disparity_error_px=1.0, calibration=YAWED)
    low, high = (yaw_and_noise_quantile(distance, p, noise=PIXEL, half=4e-3) for p in CENTRAL[0.6827])
    assert covered(rig, distance, (high - low) / 2.0) >= binom.ppf(0.005, SEEDS, CLAIMED)


def test_the_t_interval_covers_the_closed_form_of_an_uncertain_baseline() -> None:
    rig = stereo(disparity_error_px=4.0, calibration=STRETCHED)
    true = half_width(3.0, noise=4.0 * PIXEL, baseline=0.08 * B)
    assert covered(rig, 3.0, true) >= binom.ppf(0.005, SEEDS, CLAIMED)


def test_draws_are_doubled_until_the_t_interval_is_within_the_tolerance() -> None:
    rig, place = stereo(disparity_error_px=4.0, calibration=STRETCHED), np.array([3.0])
    counts = []
    for tolerance in (0.05, 2e-3, 5e-4):
        propagation = replace(EXACT, tolerance=tolerance, judged=(3.0,), max_draws=2**20)
        camera = replace(rig, propagation=propagation)
        found = exact_distribution(camera, place, 0.0, "both")
        assert found.converged(tolerance).all()
        true = half_width(3.0, noise=4.0 * PIXEL, baseline=0.08 * B)
        assert found.half_width[0] == pytest.approx(true, rel=2.0 * tolerance)
        counts.append(settled_draws(camera, 0.0, "both"))
    assert counts[0] < counts[1] < counts[2]
    few = replace(rig, propagation=replace(EXACT, tolerance=1e-6, judged=(3.0,), max_draws=2**12))
    assert settled_draws(few, 0.0, "both") * SCRAMBLES == 2**12
    assert not exact_distribution(few, place, 0.0, "both").converged(1e-6).any()


@pytest.mark.parametrize(
    "camera", [r5(calibration=R5_CALIBRATION), stereo(calibration=STEREO_CALIBRATION)], ids=["r5", "stereo"]
)
def test_quantiles_do_not_depend_on_threads_or_on_what_is_asked_together(
    camera: DepthCamera, monkeypatch: pytest.MonkeyPatch
) -> None:
    camera, places = replace(camera, propagation=EXACT), np.geomspace(0.4, 9.0, 7)
    together = exact_distribution(camera, places, 0.0, "both")
    monkeypatch.setattr(depth_draws, "_AT_ONCE", 2**11)
    monkeypatch.setattr(depth_draws, "_WORTH_THREADS", 1)
    for threads in (1, 5):
        monkeypatch.setattr(depth_draws.os, "cpu_count", lambda threads=threads: threads)
        again = exact_distribution(camera, places, 0.0, "both")
        np.testing.assert_array_equal(again.quantiles, together.quantiles)
        np.testing.assert_array_equal(again.failed, together.failed)
    for k, place in enumerate(places):
        alone = exact_distribution(camera, np.array([place]), 0.0, "both")
        np.testing.assert_allclose(alone.quantiles[:, :, 0], together.quantiles[:, :, k], rtol=1e-12)
        np.testing.assert_allclose(alone.failed[:, 0], together.failed[:, k], rtol=1e-9)


def test_other_seeds_have_other_draws_and_the_same_seed_the_same() -> None:
    camera = stereo(calibration=STEREO_CALIBRATION, propagation=replace(EXACT, judged=(1.0,)))
    widths, again, other = (
        exact_distribution(replace(camera, propagation=replace(EXACT, seed=seed)), np.array([1.0, 4.0]), 0.0, "both")
        for seed in (0, 0, 1)
    )
    assert len(widths.quantiles) == SCRAMBLES >= 8
    np.testing.assert_array_equal(widths.quantiles, again.quantiles)
    assert not np.any(widths.quantiles == other.quantiles)


def test_rows_of_a_posterior_are_the_distribution() -> None:
    """Against every row read by itself, with the noise as a fine grid of its quantiles."""
    rng = np.random.default_rng(11)
    yaw = rng.standard_t(4.0, 3000) * 1e-3
    baseline = 0.02 * B * rng.normal(size=3000) + 10.0 * yaw * B
    rows = JointDraws(
        name="rows", parameters=("yaw", "baseline"), draws=np.stack([yaw, baseline], axis=1), error_class=ErrorClass.RIG
    )
    rig = stereo(calibration=Calibration(groups=(rows,)), propagation=replace(EXACT, judged=(2.0,), tolerance=2e-3))
    found = distribution(rig, np.array([2.0]), "both")
    scores = Normal(mean=0.0, standard_deviation=0.1 * PIXEL).quantile((np.arange(200) + 0.5) / 200)
    plain = stereo_depth(2.0, {"yaw": yaw[:, None], "baseline": baseline[:, None], "pixel_noise": scores})
    low, high = np.quantile(plain, CENTRAL[0.6827])
    true = (high - low) / 2.0
    assert abs(found.half_width[0] - true) < 5.0 * found.half_width_error[0] + 1e-3 * true
    assert math.isclose(found.half_width[0], true, rel_tol=5e-3)


def test_the_failed_share_is_corrected_for_a_posterior_whose_mean_is_not_zero() -> None:
    """A yaw that moves infinity to about 100 m, where half of the draws fail: the line fails for as many."""
    rng = np.random.default_rng(11)
    draws = np.stack([rng.normal(-1e-3, 3e-4, 3000), rng.normal(0.0, 0.01 * B, 3000)], axis=1)
    rows = JointDraws(name="rows", parameters=("yaw", "baseline"), draws=draws, error_class=ErrorClass.RIG)
    few = replace(EXACT, judged=(2.0, 60.0, 100.0), max_draws=2**11)
    rig = stereo(disparity_error_px=0.5, calibration=Calibration(groups=(rows,)), propagation=few)
    many = replace(rig, propagation=replace(few, tolerance=1e-9, max_draws=2**18, seed=1))
    places = np.array([60.0, 100.0])
    true = exact_distribution(many, places, 0.0, "both").failures().mean(axis=0)
    assert 0.01 < true[0] < 0.05 < 0.4 < true[1] < 0.6
    errors = []
    for seed in range(20):
        one = replace(rig, propagation=replace(few, seed=seed))
        errors.append(exact_distribution(one, places, 0.0, "both").failures().mean(axis=0) - true)
    assert np.std(errors, axis=0).max() < 1.2e-3  # 1.9e-3 and 4.2e-3 without correction
    assert np.abs(np.mean(errors, axis=0)).max() < 5e-4


def test_without_tolerance_no_interval_has_converged_even_without_a_far_end() -> None:
    depths = np.stack([np.array([[0.9, 0.9], [1.0, 1.0], [far, np.inf]]) for far in (1.1, 1.2)])
    found = DepthDistribution(
        probabilities=(0.15865, 0.5, 0.84135),
        quantiles=depths,
        failures=lambda: np.array([[0.0, 0.2], [0.0, 0.3]]),
        radii=lambda: np.array([[0.1, 0.1], [0.15, 0.1]]),
    )
    assert not found.converged(0.0).any()
    assert found.converged(1e9).all()

"""The posterior of the measured rig: converged, checked at exact points, as wide as the Laplace fit."""

from dataclasses import replace

import numpy as np
import pytest

from tests.calibration.rig_draws import depth_of_draws
from tests.data.simulate_corners import FILE as SIMULATED
from tradestudy.calibration.corners.corner_file import read_corners
from tradestudy.calibration.corners.real_rig import fit_rig
from tradestudy.calibration.posteriors import (
    check_marginalisation,
    linearised_rig,
    log_posterior,
    posterior_names,
    sample_rig,
)
from tradestudy.cameras.calibrated_pair import RADIAL
from tradestudy.execution.executor import heard_by


@pytest.fixture(scope="module")
def rig(calibrated_webcams):
    return calibrated_webcams.fit


@pytest.mark.slow
def test_the_posterior_converges_and_holds_at_exact_points(calibrated_webcams):
    diagnostics = calibrated_webcams.sample.diagnostics
    assert calibrated_webcams.failures == ()
    assert diagnostics.lengths >= 50.0
    assert calibrated_webcams.check.efficiency > 0.975  # so no mean is off by more than 0.16 standard deviations
    assert calibrated_webcams.sample.names == posterior_names(RADIAL)


def test_the_posterior_is_as_wide_as_the_laplace_fit(rig, calibrated_webcams):
    draws = calibrated_webcams.sample.draws[:, :18]
    deviation = np.sqrt(np.diag(rig.covariance))
    # both scales are sampled, not fixed: a little wider on average, by less than a tenth
    np.testing.assert_allclose(draws.std(axis=0) / deviation, 1.0, atol=0.1)
    np.testing.assert_allclose((draws.mean(axis=0) - rig.explained.shared) / deviation, 0.0, atol=0.1)


def test_depth_of_this_rig(rig, calibrated_webcams):
    """Quantiles against first-order propagation of the Laplace covariance, where that holds."""
    distances = np.array([0.3, 0.5, 1.0, 2.0, 3.0, 5.0])
    shared = rig.explained.shared
    depths = depth_of_draws(shared, calibrated_webcams.sample.thinned(4000)[:, :18], distances)
    low, high = np.quantile(depths, [0.15865, 0.84135], axis=0)
    steps = 1e-2 * np.sqrt(np.diag(rig.covariance))
    slopes = np.array(
        [
            (
                depth_of_draws(shared, shared[None] + step, distances)
                - depth_of_draws(shared, shared[None] - step, distances)
            )[0]
            for step in np.diag(steps)
        ]
    ) / (2 * steps[:, None])
    linear = np.sqrt(np.einsum("id,ij,jd->d", slopes, rig.covariance, slopes))
    np.testing.assert_allclose((high - low) / 2, linear, rtol=0.06)
    # correlation matters: dropping it makes the depth error at 1 m several times larger
    diagonal = np.sqrt(np.einsum("id,i,id->d", slopes, np.diag(rig.covariance), slopes))
    assert diagonal[2] / linear[2] > 2.0


def test_the_check_refuses_a_wrong_marginalisation(rig, calibrated_webcams):
    """Linearised in the wrong place, the approximate posterior must fail the exact points."""
    away = rig.explained.shared + 40.0 * np.sqrt(np.diag(rig.covariance))
    views = linearised_rig(replace(rig, explained=replace(rig.explained, shared=away)))
    told: list[float] = []
    with heard_by(told.append):
        check = check_marginalisation(calibrated_webcams.sample.thinned(20), views, rig)
    assert told == pytest.approx(np.arange(1, 21) / 20, abs=1e-12)
    assert not check.passed


def test_motion_beyond_the_board_is_impossible(rig):
    fit = rig.explained
    views = linearised_rig(rig)
    parameters = np.array([*fit.shared, *rig.warp, np.log(0.12), 0.08])
    assert log_posterior(views, parameters, largest_motion=0.075) == -np.inf
    assert np.isfinite(log_posterior(views, parameters, largest_motion=0.085))
    assert log_posterior(views, parameters * np.append(np.ones(22), -1.0), largest_motion=0.085) == -np.inf


@pytest.mark.slow
def test_a_board_that_did_not_move_leaves_the_motion_free_down_to_zero():
    """Simulated without motion: the scale has no peak, and the chains converge all the same."""
    fit = fit_rig(read_corners(SIMULATED))
    sample = sample_rig(fit, rng=np.random.default_rng(0)).sample
    assert sample.diagnostics.converged, sample.diagnostics.failures
    motion = sample.draws[:, -1]
    assert motion.min() < 0.1 * motion.mean() < 2e-6

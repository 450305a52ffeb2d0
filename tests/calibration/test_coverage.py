"""Do the intervals cover? A sample of the campaign, and the power of the tests that judge it."""

import numpy as np
import pytest
from scipy.stats import binom

from tests.calibration.coverage import coverage_verdict, holm, rank_verdict, run_trials
from tests.calibration.radial_rig import SHARED_NAMES
from tests.calibration.random_poses import tilted_poses
from tests.calibration.rig_draws import depth_of_draws
from tests.calibration.trials import CalibrationTrial, normal_priors
from tradestudy.calibration.corners.real_rig import observe_pair
from tradestudy.calibration.synthetic_target import SyntheticTarget, flat_grid
from tradestudy.errors import OutOfRangeError

DISTANCES = np.array([0.3, 1.0, 3.0, 10.0])


def stereo_trial():
    centre = np.array([3050.0, 3050, 0, 0, 0, 0] * 2 + [0, 0, 0, -0.1, 0, 0])
    deviation = np.array([30.0, 30, 10, 10, 0.05, 0.2] * 2 + [np.radians(0.2)] * 3 + [1e-3] * 3)
    poses = tilted_poses(8, (0.8, 2.5), 0.05, 0.3, np.random.default_rng(0))
    return CalibrationTrial(
        target=SyntheticTarget(points=flat_grid(5, 4, 0.04), poses=poses, noise=np.full(4, 0.1)),
        model=observe_pair,
        priors=normal_priors(SHARED_NAMES, centre, deviation),
        measurement=depth_of_draws,
        distances=DISTANCES,
        draws=400,
    )


@pytest.fixture(scope="module")
def shares():
    return run_trials(stereo_trial().by_laplace, 200, 0)


@pytest.mark.slow
def test_depth_intervals_cover(shares):
    depths = shares[:, : len(DISTANCES)]
    verdict = coverage_verdict((depths > 0.025) & (depths < 0.975))
    assert verdict.trials == 200
    assert verdict.passed, verdict


@pytest.mark.slow
def test_truths_rank_uniformly(shares):
    verdict = rank_verdict(shares, bins=10)
    assert verdict.counts.shape == (len(DISTANCES) + 18, 10)
    assert verdict.passed, verdict.adjusted_p_values


@pytest.mark.slow
def test_overconfident_intervals_are_caught(shares):
    """The same truths ranked in draws of half the width must fail both tests."""
    from scipy.special import ndtr, ndtri

    half = ndtr(2.0 * ndtri(np.clip(shares, 1e-3, 1 - 1e-3)))
    assert not coverage_verdict((half > 0.025) & (half < 0.975)).passed
    assert not rank_verdict(half, bins=10).passed


def line_trial():
    """A camera that reads y = offset + slope Z, and depth as (y − offset)/slope."""

    def line(parameters, points):
        return parameters[..., 0, None, None] + parameters[..., 1, None, None] * points[..., 2:]

    def measurement(truth, draws, distances):
        return (truth[0] + truth[1] * distances - draws[:, :1]) / draws[:, 1:]

    poses = np.zeros((6, 6))
    poses[:, 5] = np.linspace(1.0, 2.0, 6)
    target = SyntheticTarget(
        points=np.zeros((1, 3)),
        poses=poses,
        noise=np.array([0.05]),
        rotation_deviation=1e-3,
        translation_deviation=1e-3,
    )
    return CalibrationTrial(
        target=target,
        model=line,
        priors=normal_priors(("offset", "slope"), np.array([0.0, 1.0]), np.array([0.5, 0.2])),
        measurement=measurement,
        distances=np.array([1.0, 3.0]),
    )


def test_sampled_posteriors_rank_like_laplace_draws():
    trial = line_trial()
    found, expected = run_trials(trial.by_sampling, 1, 0), run_trials(trial.by_laplace, 1, 0)
    # the same truth and data; 1000 draws, worth 400 at least, place a share to 0.025
    np.testing.assert_allclose(found, expected, atol=0.1)
    verdict = coverage_verdict(np.abs(run_trials(trial.by_laplace, 300, 1) - 0.5) < 0.475)
    assert verdict.passed, verdict


def test_trials_can_be_repeated_alone():
    def trial(rng):
        return rng.random(3)

    few, many = run_trials(trial, 3, 0), run_trials(trial, 7, 0)
    np.testing.assert_array_equal(few, many[:3])
    assert not np.array_equal(few, run_trials(trial, 3, 1))


def test_binomial_p_values_are_exact():
    """Two-sided p value: the sum of all outcomes no likelier than the one seen."""
    covered = np.zeros((60, 2), dtype=bool)
    covered[:52, 0] = True
    covered[:57, 1] = True
    mass = binom.pmf(np.arange(61), 60, 0.95)
    verdict = coverage_verdict(covered)
    for p, count in zip(verdict.p_values, (52, 57), strict=True):
        assert p == pytest.approx(mass[mass <= mass[count] * (1 + 1e-7)].sum(), rel=1e-9)


def test_multiplicity_is_controlled():
    """Right coverage in twenty cells passes all but about one time in a hundred; 92 % is refused with 2000 trials."""
    rng = np.random.default_rng(0)
    passed = [coverage_verdict(rng.random((500, 20)) < 0.95, level=0.05).passed for _ in range(150)]
    assert binom.cdf(np.sum(passed), 150, 0.95) > 1e-3
    assert not coverage_verdict(rng.random((2000, 5)) < 0.92).passed


def test_holm_s_method_agrees_with_a_worked_example():
    np.testing.assert_allclose(holm(np.array([0.01, 0.04, 0.03, 0.5])), [0.04, 0.09, 0.09, 0.5])


def test_too_few_trials_are_refused():
    with pytest.raises(OutOfRangeError, match="too few trials"):
        rank_verdict(np.zeros((50, 2)), bins=20)

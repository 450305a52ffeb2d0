"""The sampler on posteriors that are known, and on those that must be refused."""

import numpy as np
import pytest
from scipy.special import logsumexp

from tradestudy.calibration.laplace import LaplaceFit
from tradestudy.calibration.sampling import diagnose, sample_posterior
from tradestudy.errors import OutOfRangeError

NAMES = ("first", "second")
COVARIANCE = np.array([[4.0, 1.9], [1.9, 1.0]])


def correlated(parameters):
    return -0.5 * np.einsum("ni,ij,nj->n", parameters, np.linalg.inv(COVARIANCE), parameters)


def two_modes(parameters):
    return logsumexp([-0.5 * np.sum((parameters - c) ** 2, axis=1) for c in (-20.0, 20.0)], axis=0)


def starts(rng, shape=(4, 10, 2)):
    return rng.standard_normal(shape)


def test_a_correlated_normal_is_recovered():
    rng = np.random.default_rng(0)
    sample = sample_posterior(correlated, starts(rng), names=NAMES, rng=rng)
    diagnostics = sample.diagnostics
    assert diagnostics.converged, diagnostics.failures
    assert diagnostics.lengths >= 50.0
    assert diagnostics.r_hat.max() <= 1.01
    assert diagnostics.stuck_ensembles == ()
    error = np.sqrt(np.diag(COVARIANCE) / diagnostics.bulk_effective_size)
    assert np.all(np.abs(sample.draws.mean(axis=0)) < 4.0 * error)
    np.testing.assert_allclose(np.cov(sample.draws.T), COVARIANCE, rtol=0.12)
    assert sample.evaluations == 4 * 10 * (sample.chains.shape[1] + sample.warm_up_steps)


@pytest.mark.slow
def test_the_laplace_proposal_speeds_up_sampling_and_changes_nothing_else():
    names = tuple(f"p{k}" for k in range(8))
    scale = np.geomspace(1e-3, 1e3, 8)
    fit = LaplaceFit(names=names, mean=0.5 * scale, covariance=np.diag(1.5 * scale**2))

    def skewed(parameters):  # Gumbel: mean γ, variance π²/6, far from the proposal's normal
        z = parameters / scale
        return -np.sum(z + np.exp(-np.maximum(z, -500.0)), axis=1)

    lengths = []
    for proposal in (None, fit):
        rng = np.random.default_rng(1)
        begin = scale * (0.5 + 0.3 * rng.standard_normal((4, 20, 8)))
        sample = sample_posterior(skewed, begin, names=names, rng=rng, proposal=proposal, maximum_steps=1000)
        lengths.append(sample.diagnostics.autocorrelation_steps.max())
        mean, spread = sample.draws.mean(axis=0) / scale, sample.draws.std(axis=0) / scale
        np.testing.assert_allclose(mean, 0.5772156649, atol=0.1)
        np.testing.assert_allclose(spread, np.pi / np.sqrt(6), rtol=0.1)
    assert lengths[1] < 0.7 * lengths[0]


def test_the_seed_decides_every_bit_and_zero_is_a_seed():
    chains = []
    for seed in (0, 0, 1):
        rng = np.random.default_rng(seed)
        chains.append(sample_posterior(correlated, starts(rng), names=NAMES, rng=rng, maximum_steps=200).chains)
    np.testing.assert_array_equal(chains[0], chains[1])
    assert not np.array_equal(chains[0], chains[2])


def test_ensembles_stuck_in_two_modes_are_not_converged():
    rng = np.random.default_rng(0)
    begin = starts(rng) + np.array([-20.0, -20.0, 20.0, 20.0])[:, None, None]
    sample = sample_posterior(two_modes, begin, names=NAMES, rng=rng, maximum_steps=400)
    diagnostics = sample.diagnostics
    assert not diagnostics.converged
    assert diagnostics.r_hat.max() > 1.5
    assert any("ensembles disagree" in failure for failure in diagnostics.failures)
    assert diagnostics.stuck_ensembles == ()  # two against two: no single one is to blame


def test_one_stuck_ensemble_is_named():
    rng = np.random.default_rng(0)
    begin = starts(rng) + np.array([20.0, -20.0, 20.0, 20.0])[:, None, None]
    diagnostics = sample_posterior(two_modes, begin, names=NAMES, rng=rng, maximum_steps=300).diagnostics
    assert not diagnostics.converged
    assert diagnostics.stuck_ensembles == (1,)


def test_walkers_split_alike_between_two_modes_are_not_converged():
    """Ensembles that agree because each holds the same share of stuck walkers."""
    rng = np.random.default_rng(0)
    side = np.where(np.arange(10) < 5, -20.0, 20.0)
    chains = rng.standard_normal((4, 4000, 10, 2)) + side[:, None]
    diagnostics = diagnose(chains, np.full(4, 0.3), NAMES)
    assert diagnostics.r_hat.max() <= 1.01
    assert diagnostics.walker_r_hat.max() > 1.5
    assert any("walkers of one ensemble stay apart" in failure for failure in diagnostics.failures)


def test_walkers_that_never_move_are_not_converged():
    rng = np.random.default_rng(0)
    chains = np.broadcast_to(rng.standard_normal((4, 1, 10, 2)), (4, 1000, 10, 2)).copy()
    with np.errstate(invalid="ignore", divide="ignore"):  # 0/0 of a chain without variance is the case under test
        diagnostics = diagnose(chains, np.zeros(4), NAMES)
    assert not diagnostics.converged
    assert any(failure.startswith("acceptance 0 ") for failure in diagnostics.failures)


def test_too_short_a_run_is_reported():
    rng = np.random.default_rng(0)
    diagnostics = sample_posterior(correlated, starts(rng), names=NAMES, rng=rng, maximum_steps=200).diagnostics
    assert not diagnostics.converged
    assert any("too short" in failure for failure in diagnostics.failures)


@pytest.mark.parametrize(
    ("shape", "names", "word"),
    [
        ((3, 10, 2), NAMES, "too few independent ensembles.*3"),
        ((4, 2, 2), NAMES, "too few walkers"),
        ((4, 5, 2), NAMES, "too few walkers"),
        ((4, 10, 2), ("one",), "names and parameters"),
    ],
)
def test_impossible_runs_are_refused(shape, names, word):
    rng = np.random.default_rng(0)
    with pytest.raises(OutOfRangeError, match=word):
        sample_posterior(correlated, starts(rng, shape), names=names, rng=rng)


def test_starts_outside_the_prior_are_refused():
    rng = np.random.default_rng(0)

    def bounded(parameters):
        return np.where(parameters[:, 0] > 0, correlated(parameters), np.where(parameters[:, 1] > 0, -np.inf, np.nan))

    with pytest.raises(OutOfRangeError, match=r"not finite: \d+ of \d+ .*prior"):
        sample_posterior(bounded, starts(rng), names=NAMES, rng=rng)


def test_thinning_refuses_more_than_there_is():
    rng = np.random.default_rng(0)
    sample = sample_posterior(correlated, starts(rng), names=NAMES, rng=rng, maximum_steps=200)
    assert sample.thinned(7).shape == (7, 2)
    with pytest.raises(OutOfRangeError, match=r"draws.*\(allowed: 1 to "):
        sample.thinned(len(sample.draws) + 1)

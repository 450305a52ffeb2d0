"""R-hat and effective sizes against closed forms and against the paper's formulas written out."""

import math

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import norm, rankdata

from tradestudy.calibration.sampling import (
    bulk_effective_size,
    rank_normalised_split_r_hat,
    tail_effective_size,
)


def autoregressive(rng, rho, shape):
    """AR(1) chains started in equilibrium, unit variance."""
    noise = rng.standard_normal(shape) * math.sqrt(1 - rho**2)
    noise[:, 0] /= math.sqrt(1 - rho**2)
    return lfilter([1.0], [1.0, -rho], noise, axis=1)


def split_r_hat_by_the_letter(chains):
    """Eqs. 1–3, 14 of Vehtari et al., with loops."""
    halves = [half for chain in chains for half in (chain[: len(chain) // 2], chain[-(len(chain) // 2) :])]
    results = []
    for fold in (False, True):
        values = np.array([np.abs(h - np.median(halves)) if fold else h for h in halves])
        z = norm.ppf((rankdata(values).reshape(values.shape) - 3 / 8) / (values.size + 1 / 4))
        n = z.shape[1]
        between = n * np.var([np.mean(row) for row in z], ddof=1)
        within = np.mean([np.var(row, ddof=1) for row in z])
        results.append(math.sqrt(((n - 1) / n * within + between / n) / within))
    return max(results)


@pytest.mark.parametrize("shift", [0.0, 0.1, 1.0])
def test_r_hat_equals_the_formula_written_out(shift):
    rng = np.random.default_rng(0)
    chains = rng.standard_normal((4, 500)) + shift * np.arange(4)[:, None]
    expected = split_r_hat_by_the_letter(chains)
    assert rank_normalised_split_r_hat(chains[..., None]) == pytest.approx(expected, rel=1e-12)


def test_r_hat_sees_what_the_plain_one_misses():
    rng = np.random.default_rng(1)
    same_mean = rng.standard_normal((4, 2000)) * np.array([1, 1, 1, 3.0])[:, None]
    assert rank_normalised_split_r_hat(same_mean[..., None]) > 1.05
    # Cauchy chains without a mean, one of them shifted
    heavy = rng.standard_cauchy((4, 2000))
    assert rank_normalised_split_r_hat(heavy[..., None]) < 1.01
    assert rank_normalised_split_r_hat((heavy + np.array([0, 0, 0, 2.0])[:, None])[..., None]) > 1.05
    drifting = rng.standard_normal((4, 2000)) + np.linspace(0, 2, 2000)
    assert rank_normalised_split_r_hat(drifting[..., None]) > 1.05


def test_r_hat_of_stuck_chains_is_infinite():
    stuck = np.broadcast_to(np.arange(4.0)[:, None, None], (4, 100, 3))
    assert rank_normalised_split_r_hat(stuck) > 1e6 or math.isinf(rank_normalised_split_r_hat(stuck))
    assert math.isnan(rank_normalised_split_r_hat(np.ones((4, 100, 1))))


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9, -0.4])
def test_effective_size_of_autoregressive_chains(rho):
    """ESS of AR(1) is n (1 − ρ)/(1 + ρ); the estimate scatters by a few percent over seeds."""
    rng = np.random.default_rng(2)
    sizes = [bulk_effective_size(autoregressive(rng, rho, (4, 5000))[..., None]) for _ in range(12)]
    assert np.mean(sizes) == pytest.approx(20_000 * (1 - rho) / (1 + rho), rel=0.06)


def test_tail_effective_size_of_independent_draws():
    rng = np.random.default_rng(3)
    sizes = [tail_effective_size(rng.standard_normal((4, 5000, 1))) for _ in range(12)]
    assert np.mean(sizes) == pytest.approx(20_000, rel=0.1)
    slow_tail = autoregressive(rng, 0.95, (4, 5000))[..., None]
    assert tail_effective_size(slow_tail) < 3_000


def test_walkers_that_move_together_do_not_count_twice():
    rng = np.random.default_rng(4)
    chain = autoregressive(rng, 0.5, (4, 5000))[..., None]
    together = np.broadcast_to(chain, (4, 5000, 10))
    apart = autoregressive(rng, 0.5, (40, 5000)).reshape(4, 10, 5000).transpose(0, 2, 1)
    assert bulk_effective_size(together) == pytest.approx(bulk_effective_size(chain), rel=0.01)
    assert bulk_effective_size(apart) == pytest.approx(10 * 20_000 / 3, rel=0.1)

"""Values of information against closed forms and nested Monte Carlo."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.interpolate import BSpline
from scipy.stats import norm

from tradestudy.errors import OutOfRangeError
from tradestudy.uncertainty import decision
from tradestudy.uncertainty.decision import worth_of_all, worth_of_one

MEAN, PARTS = 0.5, (0.6, 0.8)  # Δ ~ N(0.5, 1), a sum of two independent parts


def expected_loss(mean: float, deviation: float) -> float:
    """E[max(0, Δ)] − max(0, E[Δ]) of a normal Δ: the unit normal loss of Raiffa and Schlaifer."""
    u = mean / deviation
    return deviation * (norm.pdf(u) + u * norm.cdf(u)) - max(0.0, mean)


def draws(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    parts = np.random.default_rng(seed).standard_normal((count, 2)) * PARTS
    return parts, np.stack([np.zeros(count), MEAN + parts.sum(axis=1)], axis=1)


def test_the_closed_form_has_the_published_values() -> None:
    assert expected_loss(0.5, 1.0) == pytest.approx(0.19780, abs=5e-6)
    assert expected_loss(0.5, 0.6) == pytest.approx(0.06798, abs=5e-6)


def test_perfect_and_partial_information_of_a_normal_difference() -> None:
    parts, utility = draws(2**14, 1)
    rng = np.random.default_rng(2)
    whole = worth_of_all(utility)
    assert whole.value == pytest.approx(0.19780, abs=3.0 * whole.error)
    assert whole.error < 0.004
    for column, deviation in enumerate(PARTS):
        one = worth_of_one(utility, parts[:, column], rng)
        assert one.value == pytest.approx(expected_loss(MEAN, deviation), abs=3.0 * one.error)
        assert one.error < 0.006


def test_estimates_of_few_draws_scatter_as_stated() -> None:
    """The mean over repetitions keeps the closed form within its own scatter, and errors are about that scatter."""
    rng = np.random.default_rng(5)
    found = [worth_of_one(utility, parts[:, 0], rng) for parts, utility in (draws(256, seed) for seed in range(40))]
    values = np.array([one.value for one in found])
    scatter = values.std(ddof=1)
    assert values.mean() == pytest.approx(expected_loss(MEAN, 0.6), abs=3.0 * scatter / math.sqrt(40))
    assert 0.5 < np.mean([one.error for one in found]) / scatter < 2.0


def test_an_assumption_that_changes_nothing_is_worth_nothing_despite_the_biased_maximum() -> None:
    rng = np.random.default_rng(3)
    found = []
    for seed in range(20):
        _, utility = draws(256, seed)
        found.append(worth_of_one(utility, np.random.default_rng(100 + seed).random(256), rng))
    assert np.mean([one.value for one in found]) < 0.02
    assert all(one.value <= 3.0 * one.error for one in found)
    assert np.mean([one.bias for one in found]) > 0.0


def test_a_curved_utility_agrees_with_nested_draws() -> None:
    """U₁ = sin(3 φ) + ε against U₂ = 0.2: E[U₁ | φ] is sin(3 φ), whose maximum with 0.2 is a quadrature."""
    rng = np.random.default_rng(7)
    parameter = rng.uniform(-1.0, 1.0, 2**12)
    utility = np.stack([np.sin(3.0 * parameter) + rng.standard_normal(2**12), np.full(2**12, 0.2)], axis=1)
    fine = np.linspace(-1.0, 1.0, 200_001)
    truth = np.mean(np.maximum(np.sin(3.0 * fine), 0.2)) - 0.2
    one = worth_of_one(utility, parameter, rng)
    assert one.value == pytest.approx(truth, abs=3.0 * one.error)
    assert one.error < 0.05 * truth


def test_a_constant_parameter_and_bad_utilities() -> None:
    _, utility = draws(64, 0)
    assert worth_of_one(utility, np.ones(64), np.random.default_rng(0)).value < 0.05
    with pytest.raises(OutOfRangeError, match="at least 32 draws"):
        worth_of_all(utility[:10])
    with pytest.raises(OutOfRangeError, match="1 non-finite"):
        worth_of_all(np.where(np.arange(64)[:, None] == 3, [[math.inf, 0.0]], utility))


def test_a_choice_of_two_is_worth_the_mean_of_the_better_answers() -> None:
    """U₂ − U₁ is 1 or −2, as likely, beside noise: knowing which is worth (1 + 0)/2 − max(0, −1/2) = 1/2."""
    rng = np.random.default_rng(3)
    choice = (np.arange(4096) % 2).astype(float)
    difference = np.where(choice == 0.0, 1.0, -2.0) + rng.standard_normal(4096)
    found = worth_of_one(np.stack([np.zeros(4096), difference], axis=1), choice, rng)
    assert found.value == pytest.approx(0.5, abs=3.0 * found.error)
    assert found.error < 0.03


@pytest.mark.parametrize("intervals", [1, 2, 3, 8])
def test_the_spline_basis_is_that_of_scipy(intervals: int) -> None:
    inner = np.linspace(0.0, 1.0, intervals + 1)
    ranks = np.concatenate([np.random.default_rng(0).random(1000), inner, np.nextafter(inner[1:], 0.0)])
    knots = np.concatenate([np.zeros(3), inner, np.ones(3)])
    expected = BSpline.design_matrix(ranks, knots, 3).toarray()
    np.testing.assert_allclose(decision._basis(ranks, intervals), expected, rtol=0.0, atol=1e-15)

"""Rank acceptabilities and central weights against closed forms and direct quadrature."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.stats import norm

from tradestudy.errors import OutOfRangeError
from tradestudy.uncertainty.distributions import FloatArray
from tradestudy.uncertainty.streams import point_generator, scrambled_sobol
from tradestudy.uncertainty.trade_off import Acceptability, ValueScale, WeightSpace, acceptability, rank_shares

UNIT = ValueScale(worst=0.0, best=1.0)
TRIANGLE = np.array([[1.0, 0.0], [0.0, 1.0], [0.6, 0.6]])


def ranked(values: FloatArray, weights: WeightSpace | None = None, errors: FloatArray | None = None) -> Acceptability:
    count = values.shape[1]
    weights = WeightSpace(low=(0.0,) * count, high=(1.0,) * count) if weights is None else weights
    errors = np.zeros(values.shape) if errors is None else errors
    return acceptability(values, errors, (UNIT,) * count, weights, seed=1)


def close(found: FloatArray, expected: FloatArray | list[float] | list[list[float]], error: FloatArray) -> None:
    """Within four of its standard errors, which are small."""
    assert np.nanmax(error) < 2e-3
    assert np.all(np.abs(found - np.array(expected)) <= 4.0 * error + 1e-12), (found, expected, error)


def test_three_alternatives_of_two_criteria() -> None:
    """A is first for w₁ > 0.6, B for w₁ < 0.4, C between; second and third by the order of the others."""
    found = ranked(TRIANGLE)
    close(found.rank, [[0.4, 0.1, 0.5], [0.4, 0.1, 0.5], [0.2, 0.8, 0.0]], found.rank_error)
    close(found.central[:, 0], [0.8, 0.2, 0.5], found.central_error[:, 0])
    np.testing.assert_allclose(found.central.sum(axis=1), 1.0, rtol=1e-12)
    np.testing.assert_allclose(found.rank.sum(axis=1), 1.0, rtol=1e-12)
    np.testing.assert_allclose(found.rank.sum(axis=0), 1.0, rtol=1e-12)


def test_an_order_of_two_criteria_leaves_half_of_the_weights() -> None:
    found = ranked(TRIANGLE, WeightSpace(low=(0.0, 0.0), high=(1.0, 1.0), order=(0, 1)))
    close(found.rank[:, 0], [0.8, 0.0, 0.2], found.rank_error[:, 0])
    close(found.central[[0, 2], 0], [0.8, 0.55], found.central_error[[0, 2], 0])
    assert np.isnan(found.central[1]).all()
    assert np.isnan(found.central_error[1]).all()
    assert 0.0 < found.rank_error[1, 0] < 1e-4


def test_a_range_of_a_weight() -> None:
    """w₁ from 0.5 to 0.8: A is first from 0.6 on."""
    found = ranked(TRIANGLE, WeightSpace(low=(0.5, 0.0), high=(0.8, 1.0)))
    close(found.rank[:, 0], [2 / 3, 0.0, 1 / 3], found.rank_error[:, 0])
    close(found.central[[0, 2], 0], [0.7, 0.55], found.central_error[[0, 2], 0])


def test_fixed_weights_rank_exactly_and_ties_share_their_ranks() -> None:
    weights = WeightSpace(low=(0.25, 0.75), high=(0.25, 0.75))
    found = ranked(np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 1.0], [1.0, 0.0]]), weights)
    np.testing.assert_array_equal(found.rank, [[0, 0, 0.5, 0.5], [0.5, 0.5, 0, 0], [0.5, 0.5, 0, 0], [0, 0, 0.5, 0.5]])
    assert not found.rank_error.any()
    np.testing.assert_allclose(found.central[1:3], [[0.25, 0.75]] * 2)
    assert np.isnan(found.central[[0, 3]]).all()
    assert found.draws == 1


def test_some_alternatives_can_tie() -> None:
    shares = np.array(rank_shares(np.array([[3.0, 1.0, 3.0, 2.0], [1.0, 1.0, 1.0, 1.0]])))
    np.testing.assert_array_equal(shares[:, 0], [[0.5, 0, 0.5, 0], [0.5, 0, 0.5, 0], [0, 0, 0, 1], [0, 1, 0, 0]])
    np.testing.assert_array_equal(shares[:, 1], np.full((4, 4), 0.25))


def quadrature(values: FloatArray, allowed: WeightSpace, cells: int = 700) -> tuple[FloatArray, FloatArray]:
    """First ranks and central weights on a fine midpoint grid of the triangle of three weights."""
    middle = (np.arange(cells) + 0.5) / cells
    first, second = (one.ravel() for one in np.meshgrid(middle, middle))
    weights = np.stack([first, second, 1.0 - first - second])
    keep = weights[2] > 0.0
    for low, high, row in zip(allowed.low, allowed.high, weights, strict=True):
        keep &= (row >= low) & (row <= high)
    for more, less in itertools.pairwise(allowed.order):
        keep &= weights[more] >= weights[less]
    weights = weights[:, keep]
    winner = np.argmax(values @ weights, axis=0)
    share = np.array([np.mean(winner == k) for k in range(len(values))])
    sums = np.array([weights[:, winner == k].sum(axis=1) for k in range(len(values))])
    return share, sums / np.maximum(share * winner.size, 1.0)[:, np.newaxis]


@pytest.mark.parametrize(
    "weights",
    [
        WeightSpace(low=(0.0,) * 3, high=(1.0,) * 3),
        WeightSpace(low=(0.0,) * 3, high=(1.0,) * 3, order=(2, 0, 1)),
        WeightSpace(low=(0.0,) * 3, high=(1.0,) * 3, order=(2, 1)),
        WeightSpace(low=(0.1, 0.0, 0.2), high=(1.0, 1.0, 1.0)),
        WeightSpace(low=(0.0, 0.0, 0.0), high=(0.5, 0.45, 0.4)),
        WeightSpace(low=(0.2, 0.1, 0.0), high=(0.4, 0.5, 1.0)),
    ],
)  # fmt: skip
def test_three_criteria_agree_with_a_fine_grid_of_weights(weights: WeightSpace) -> None:
    values = np.array([[0.9, 0.1, 0.3], [0.2, 0.95, 0.25], [0.3, 0.2, 0.8], [0.5, 0.45, 0.5]])
    found, (share, central) = ranked(values, weights), quadrature(values, weights)
    grid = 3e-3  # of this grid: about its perimeter over its cells
    assert np.nanmax(found.rank_error) < 2e-3
    np.testing.assert_allclose(found.rank[:, 0], share, atol=grid)
    known = share > 0.01
    np.testing.assert_allclose(found.central[known], central[known], atol=2 * grid)


def test_the_standard_error_is_that_of_other_seeds() -> None:
    values = np.array([[0.9, 0.1, 0.3], [0.2, 0.95, 0.25], [0.3, 0.2, 0.8]])
    space = WeightSpace(low=(0.0,) * 3, high=(1.0,) * 3)
    runs = [acceptability(values, np.zeros((3, 3)), (UNIT,) * 3, space, seed=seed) for seed in range(40)]
    for part in ("rank", "central"):
        spread = np.std([getattr(one, part) for one in runs], axis=0, ddof=1)
        claimed = np.sqrt(np.mean([getattr(one, f"{part}_error") ** 2 for one in runs], axis=0))
        assert np.all((claimed / spread > 0.6) & (claimed / spread < 1.7)), part


def test_an_uncertain_value_ranks_first_as_often_as_its_distribution_says() -> None:
    """Of one criterion: x ~ N(0.5, 0.1) against 0.6 is better with probability Φ(−1)."""
    found = ranked(np.array([[0.5], [0.6]]), errors=np.array([[0.1], [0.0]]))
    expected = float(norm.cdf(-1.0))
    close(found.rank[:, 0], [expected, 1.0 - expected], found.rank_error[:, 0])


@pytest.mark.parametrize(
    ("low", "high"),
    [
        ((0.0,) * 4, (1.0,) * 4),
        ((0.2, 0.1, 0.0, 0.3), (0.9, 1.0, 1.0, 1.0)),
        ((0.0,) * 4, (0.3, 0.3, 0.3, 0.3)),
        ((0.2, 0.2, 0.2, 0.0), (0.24, 0.26, 0.22, 1.0)),
        ((0.1, 0.25, 0.0, 0.0), (0.1, 0.25, 0.5, 0.6)),
    ],
)
def test_weights_are_uniform_within_their_ranges(low: tuple[float, ...], high: tuple[float, ...]) -> None:
    """The mean and covariance of plain rejection from the simplex, whatever map makes them."""
    space = WeightSpace(low=low, high=high)
    stream = scrambled_sobol(space.dimensions, point_generator(seed=3, point="test", replicate=0))
    found, _ = space.draw(stream, 2**14)
    np.testing.assert_allclose(found.sum(axis=0), 1.0, rtol=1e-12)
    free = [k for k in range(4) if high[k] > low[k]]
    rng = np.random.default_rng(5)
    rest = 1.0 - sum(low[k] for k in range(4) if k not in free)
    plain = rest * rng.dirichlet(np.ones(len(free)), size=2_000_000).T
    inside = np.all([(plain[i] >= low[k]) & (plain[i] <= high[k]) for i, k in enumerate(free)], axis=0)
    plain = plain[:, inside]
    assert plain.shape[1] > 100
    error = plain.std(axis=1) / np.sqrt(plain.shape[1])
    assert np.all(np.abs(found[free].mean(axis=1) - plain.mean(axis=1)) < 5 * error + 1e-4)
    scale = np.sqrt(np.outer(plain.var(axis=1), plain.var(axis=1)))
    difference = np.abs(np.cov(found[free]) - np.cov(plain)) / scale
    assert np.all(difference < 8 / np.sqrt(plain.shape[1]) + 5e-3)


def test_ten_narrow_ranges_can_be_drawn() -> None:
    for low, high in (((0.08,) * 10, (0.12,) * 10), ((0.0,) * 10, (0.12,) * 10), ((0.0,) * 10, (0.3,) * 10)):
        space = WeightSpace(low=low, high=high)
        found, _ = space.draw(scrambled_sobol(9, point_generator(seed=1, point="test", replicate=0)), 2**10)
        assert found.shape[1] >= 2**10
        np.testing.assert_allclose(found.mean(axis=1), 0.1, atol=2e-3)


@pytest.mark.parametrize(("low", "high"), [((0.6, 0.5), (1.0, 1.0)), ((0.0, 0.0), (0.4, 0.5))])
def test_ranges_without_weights_are_refused(low: tuple[float, ...], high: tuple[float, ...]) -> None:
    with pytest.raises(OutOfRangeError, match=r"minima sum to .*, maxima to"):
        WeightSpace(low=low, high=high)


def test_values_beyond_the_ends_score_as_the_ends() -> None:
    falling = ValueScale(worst=2.0, best=0.5)
    measured = np.array([3.0, 2.0, 1.25, 0.5, 0.1, np.nan, np.inf, -np.inf])
    np.testing.assert_allclose(falling.value(measured), [0, 0, 0.5, 1, 1, 0, 0, 1])
    assert falling.clips(measured).tolist() == [True, False, False, False, True, False, True, True]

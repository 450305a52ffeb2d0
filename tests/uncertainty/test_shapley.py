from itertools import combinations, permutations

import numpy as np
import pytest
from mpmath import mp, mpf

from tradestudy.errors import OutOfRangeError
from tradestudy.uncertainty.sensitivity import shapley_shares


def covariance_of(deviations, correlation):
    return np.asarray(correlation, float) * np.outer(deviations, deviations)


def by_permutations(sensitivity, covariance, parts):
    """Average gain over all orders of the parts, each conditional variance solved with 40 digits."""
    with mp.workdps(40):
        weights = mp.matrix([mpf(float(s)) for s in sensitivity])
        matrix = mp.matrix([[mpf(float(c)) for c in row] for row in covariance])

        def variance_given(rows):
            if not rows:
                return mpf(0)
            known = mp.matrix([[matrix[i, j] for j in rows] for i in rows])
            tied = mp.matrix([sum(matrix[i, j] * weights[j] for j in range(len(weights))) for i in rows])
            return (tied.T * mp.lu_solve(known, tied))[0]

        gains = [mpf(0)] * len(parts)
        orders = list(permutations(range(len(parts))))
        for order in orders:
            rows, before = [], mpf(0)
            for part in order:
                rows = [*rows, *parts[part]]
                after = variance_given(rows)
                gains[part] += after - before
                before = after
        return [float(gain / len(orders) / before) for gain in gains]


def random_case(rng, parameters, outputs):
    mixing = rng.standard_normal((parameters, parameters))
    return rng.standard_normal((parameters, outputs)), mixing @ mixing.T


def test_a_plenoptic_camera_with_distance_and_focal_length_tied():
    """1 m, both 1 µm, correlation 0.9, 6.24 and 6.40 mm of depth per µm with opposite signs."""
    shares = shapley_shares(
        np.array([[-6.24e3], [6.40e3]]), covariance_of([1e-6, 1e-6], [[1.0, 0.9], [0.9, 1.0]]), [[0], [1]]
    )
    np.testing.assert_allclose(shares[:, 0], [0.476, 0.524], atol=5e-4)


def test_shares_are_the_average_gain_over_all_orders():
    sensitivity, covariance = random_case(np.random.default_rng(3), 6, 2)
    parts = [[4, 0], [1], [2, 5], [3]]
    shares = shapley_shares(sensitivity, covariance, parts)
    for output in range(2):
        np.testing.assert_allclose(
            shares[:, output], by_permutations(sensitivity[:, output], covariance, parts), rtol=1e-11
        )


def test_a_correlation_that_is_nearly_one_keeps_its_weak_direction():
    gap = 1e-9
    sensitivity, covariance = np.array([1.0, -1.0, 2e-5]), np.eye(3)
    covariance[0, 1] = covariance[1, 0] = 1.0 - gap
    parts = [[0], [1], [2]]
    shares = shapley_shares(sensitivity[:, None], covariance, parts)[:, 0]
    np.testing.assert_allclose(shares, by_permutations(sensitivity, covariance, parts), rtol=1e-5)


def test_independent_parts_have_their_share_of_the_sum_of_variances():
    sensitivity, deviations = np.array([1.0, -2.0, 3.0, 0.5]), np.array([2e-6, 1e-3, 0.2, 5.0])
    shares = shapley_shares(sensitivity[:, None], np.diag(deviations**2), [[0, 2], [1], [3]])
    variance = (sensitivity * deviations) ** 2
    expected = np.array([variance[0] + variance[2], variance[1], variance[3]]) / variance.sum()
    np.testing.assert_allclose(shares[:, 0], expected, rtol=0.0, atol=1e-15)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_two_fully_correlated_parameters_share_equally(sign):
    covariance = covariance_of([2e-6, 1e-3, 1.0], [[1.0, sign, 0.0], [sign, 1.0, 0.0], [0.0, 0.0, 1.0]])
    shares = shapley_shares(np.array([[1e6], [0.0], [1.0]]), covariance, [[0], [1], [2]])
    np.testing.assert_allclose(shares[:, 0], [0.4, 0.4, 0.2], rtol=1e-12)


def test_shares_sum_to_one_and_do_not_depend_on_the_order_of_the_parameters():
    rng = np.random.default_rng(5)
    sensitivity, covariance = random_case(rng, 12, 40)
    covariance[:, 7] = covariance[7, :] = 0.0
    parts = [[0, 1, 2], [3, 4], [5], [6, 7], [8, 9, 10, 11]]
    shares = shapley_shares(sensitivity, covariance, parts)
    assert np.all(shares >= 0.0)
    np.testing.assert_allclose(shares.sum(axis=0), 1.0, rtol=0.0, atol=1e-12)
    order = rng.permutation(12)
    place = np.argsort(order)
    moved = shapley_shares(
        sensitivity[order], covariance[np.ix_(order, order)], [[int(place[row]) for row in part] for part in parts]
    )
    np.testing.assert_allclose(moved, shares, atol=1e-12)


def test_a_singular_covariance_of_few_draws_is_shared_completely():
    draws = np.random.default_rng(2).standard_normal((4, 9))
    sensitivity = np.random.default_rng(4).standard_normal((9, 3))
    shares = shapley_shares(sensitivity, np.cov(draws, rowvar=False), [[0, 1, 2], [3, 4], [5, 6, 7, 8]])
    np.testing.assert_allclose(shares.sum(axis=0), 1.0, atol=1e-12)
    # Any three parameters determine the other six: the second part alone leaves something open.
    assert np.all(shares[1] < shares[[0, 2]].min(axis=0))


def test_without_variance_there_is_nothing_to_share():
    covariance = covariance_of([1.0, 1.0], np.ones((2, 2)))
    shares = shapley_shares(np.array([[0.0, 1.0, np.nan, 1.0], [0.0, -1.0, 1.0, 1.0]]), covariance, [[0], [1]])
    assert np.all(np.isnan(shares[:, :3]))
    np.testing.assert_allclose(shares[:, 3], 0.5, rtol=1e-12)
    assert np.all(np.isnan(shapley_shares(np.ones((2, 1)), np.zeros((2, 2)), [[0], [1]])))


def test_double_loop_sampling_agrees():
    """Var(E[w | X_S]) from an outer loop over X_S and an inner one over the rest, in plain numpy."""
    rng = np.random.default_rng(11)
    weights = np.array([1.0, -2.0, 0.7])
    covariance = covariance_of([1.0, 0.6, 2.0], [[1.0, 0.8, -0.3], [0.8, 1.0, 0.1], [-0.3, 0.1, 1.0]])

    def worth(known):
        if len(known) in (0, 3):
            return weights @ covariance @ weights if known else 0.0
        known, rest = list(known), [i for i in range(3) if i not in known]
        outer = rng.multivariate_normal(np.zeros(len(known)), covariance[np.ix_(known, known)], size=20_000)
        regression = covariance[np.ix_(rest, known)] @ np.linalg.inv(covariance[np.ix_(known, known)])
        left = covariance[np.ix_(rest, rest)] - regression @ covariance[np.ix_(known, rest)]
        inner = rng.multivariate_normal(np.zeros(len(rest)), left, size=(20_000, 60))
        w = (outer @ weights[known])[:, None] + (inner + (outer @ regression.T)[:, None, :]) @ weights[rest]
        return np.var(np.mean(w, axis=1)) - np.mean(np.var(w, axis=1, ddof=1)) / 60

    value = {known: worth(known) for size in range(4) for known in combinations(range(3), size)}
    sampled = np.zeros(3)
    for order in permutations(range(3)):
        for k in range(3):
            sampled[order[k]] += value[tuple(sorted(order[: k + 1]))] - value[tuple(sorted(order[:k]))]
    sampled /= 6.0 * value[0, 1, 2]
    shares = shapley_shares(weights[:, None], covariance, [[0], [1], [2]])[:, 0]
    np.testing.assert_allclose(shares, sampled, atol=0.015)


def test_groups_that_do_not_partition_the_parameters_are_refused():
    with pytest.raises(OutOfRangeError, match="at most 12"):
        shapley_shares(np.ones((13, 1)), np.eye(13), [[i] for i in range(13)])
    with pytest.raises(OutOfRangeError, match="each of the 3 once"):
        shapley_shares(np.ones((3, 1)), np.eye(3), [[0], [1, 0]])

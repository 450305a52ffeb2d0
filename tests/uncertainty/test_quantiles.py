import numpy as np
import pytest

from tradestudy.uncertainty.outputs import order_quantile, quantiles_of, ranked_quantiles, valley_quantile

WATCHED = (0.025, 0.1586552539314570, 0.5, 0.8413447460685429, 0.975)


def rows(kind, n):
    rng = np.random.default_rng(1)
    values = rng.standard_normal((3, n))
    if kind == "infinite":
        values[0, rng.random(n) < 0.3] = np.inf
        values[1] = np.inf
    if kind == "tied":
        values = np.round(values)
    if kind == "falling":
        values = -np.sort(-values, axis=1)
    return values


@pytest.mark.parametrize("kind", ["normal", "infinite", "tied", "falling"])
@pytest.mark.parametrize("n", [1, 2, 3, 64, 4096, 5001])
@pytest.mark.parametrize(
    "probability",
    [WATCHED, 0.5, (0.0, 1.0), (0.975, 0.025, 0.5, 0.5), tuple(np.linspace(0.0, 1.0, 201))],
    ids=["watched", "median", "ends", "unsorted", "many"],
)
def test_quantiles_of_rows_in_any_order_are_those_of_the_sorted_rows(kind, n, probability):
    values = rows(kind, n)
    before = values.copy()
    found = quantiles_of(values, probability)
    np.testing.assert_array_equal(found, order_quantile(np.sort(values, axis=1), probability))
    np.testing.assert_array_equal(values, before)


@pytest.mark.parametrize("kind", ["normal", "infinite", "tied", "falling"])
@pytest.mark.parametrize("n", [1, 2, 3, 64, 5001])
@pytest.mark.parametrize("probability", [0.0, 0.1, 0.625, 0.6826894921370859, 0.95, 1.0])
def test_quantiles_of_rows_that_fall_and_then_rise_are_those_of_the_sorted_rows(kind, n, probability):
    valleys = np.abs(np.sort(rows(kind, n), axis=1) - 0.3)
    np.testing.assert_array_equal(valley_quantile(valleys, probability), quantiles_of(valleys, probability))


def test_quantiles_agree_with_hazen_positions_of_numpy():
    values = rows("normal", 5001)
    np.testing.assert_allclose(
        quantiles_of(values, WATCHED), np.quantile(values, WATCHED, axis=1, method="hazen"), rtol=1e-12
    )


def test_a_quantile_next_to_infinity_is_infinite():
    values = np.array([[np.inf, 3.0, 1.0, 2.0]])
    # Positions (k − 1/2)/4: 0.625 is the third draw itself, anything above leans on the infinite one.
    np.testing.assert_array_equal(quantiles_of(values, (0.625, 0.626, 1.0))[:, 0], [3.0, np.inf, np.inf])


def test_order_quantiles_are_the_middle_of_their_share():
    ascending = np.array([1.0, 2.0, 4.0, np.inf])
    assert order_quantile(ascending, 0.125) == 1.0
    assert order_quantile(ascending, 0.25) == 1.5
    assert order_quantile(ascending, 0.625) == 4.0
    assert order_quantile(ascending, 0.7) == np.inf
    assert order_quantile(ascending, 0.001) == 1.0


def test_ranked_quantiles_are_those_of_the_draws_that_have_a_rank():
    values = rows("normal", 5001)
    values[1, ::3] = np.nan
    values[2] = np.nan
    found = ranked_quantiles(np.sort(values, axis=1), np.array(WATCHED))
    np.testing.assert_array_equal(found[:, 0], order_quantile(np.sort(values[0]), WATCHED))
    np.testing.assert_array_equal(found[:, 1], order_quantile(np.sort(values[1][~np.isnan(values[1])]), WATCHED))
    assert np.all(np.isnan(found[:, 2]))

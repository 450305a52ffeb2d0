"""Propagation through a user's own function, against closed forms and published intervals."""

from __future__ import annotations

import doctest
from typing import Any

import numpy as np
import pint
import pytest
import xarray as xr
from scipy import stats

from tradestudy.errors import OutOfRangeError
from tradestudy.uncertainty import Normal, Uniform, any_function, propagate_through

UNIT = Normal(mean=0.0, standard_deviation=1.0)


def test_four_rectangular_inputs_have_the_published_interval() -> None:
    """JCGM 101:2008, 9.2.3: the sum of four rectangular inputs of unit standard uncertainty, 95 %: ±3.88."""
    end = np.sqrt(3.0)
    inputs = {name: Uniform(low=-end, high=end) for name in "abcd"}
    found = propagate_through(lambda a, b, c, d: a + b + c + d, inputs, coverage=[0.95], tolerance=0.002)
    assert found.converged
    np.testing.assert_allclose([found.low[0], found.high[0]], [-3.88, 3.88], atol=0.01)
    assert found.standard_deviation == pytest.approx(2.0, rel=2e-3)


def test_one_coverage_may_be_a_number() -> None:
    one, of_one = (propagate_through(lambda x: x, {"x": UNIT}, coverage=given) for given in (0.9, [0.9]))
    assert one.coverage == (0.9,)
    assert np.array_equal(one.half_width, of_one.half_width)


@pytest.mark.parametrize("coverage", [0.5, 0.6827, 0.99, 0.9999])
def test_any_coverage_of_a_skew_output(coverage: float) -> None:
    """The exponential of a normal is lognormal; what is stated as the error covers what is missed."""
    found = propagate_through(lambda x: np.exp(x), {"x": UNIT}, coverage=[coverage])
    ends = stats.lognorm.ppf([0.5 - coverage / 2.0, 0.5 + coverage / 2.0], 1.0)
    missed = np.abs([found.low[0] - ends[0], found.high[0] - ends[1]])
    assert found.converged
    assert np.all(missed <= 4.0 * found.error[0])
    assert found.error[0] <= 0.01 * found.half_width[0]


def test_correlated_inputs_cancel_or_add_and_outputs_keep_their_shape() -> None:
    def both(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.stack([x + y, x - y], axis=-1)

    found = propagate_through(both, {"x": UNIT, "y": UNIT}, correlation={("y", "x"): 0.6}, coverage=[0.6827, 0.95])
    assert found.low.shape == (2, 2)
    np.testing.assert_allclose(found.half_width[0], np.sqrt([3.2, 0.8]), rtol=0.01)
    np.testing.assert_allclose(found.median, 0.0, atol=0.02)


@pytest.mark.parametrize("coverage", [0.99, 0.999, 0.9999])
@pytest.mark.parametrize("distribution", [stats.norm(), stats.lognorm(1.0), stats.t(3)])
def test_wide_intervals_are_resolved_at_any_tolerance(coverage: float, distribution: Any) -> None:
    """The extreme draws of a replicate do not stand for the ends beyond them."""

    def function(x: np.ndarray) -> np.ndarray:
        return np.asarray(distribution.ppf(stats.norm.cdf(x)))

    found = propagate_through(function, {"x": UNIT}, coverage=coverage, tolerance=0.2)
    ends = distribution.ppf([0.5 - coverage / 2.0, 0.5 + coverage / 2.0])
    assert found.converged
    assert np.all(np.abs([found.low[0] - ends[0], found.high[0] - ends[1]]) <= 4.0 * found.error[0])


@pytest.mark.parametrize(("coverage", "ends"), [(0.9, [1.0, 6.0]), (0.5, [2.0, 4.0]), (0.99, [0.0, 8.0])])
def test_ends_between_discrete_values_are_resolved(coverage: float, ends: list[float]) -> None:
    """Poisson with mean 3: P(X = 0) = 4.98 %, so that replicates of 1024 draws cannot tell 0 from 1 at 5 %."""
    law = stats.poisson(3)
    assert law.ppf([0.5 - coverage / 2.0, 0.5 + coverage / 2.0]).tolist() == ends
    found = propagate_through(lambda x: law.ppf(x), {"x": Uniform(low=0.0, high=1.0)}, coverage=coverage)
    assert found.converged
    assert [found.low[0], found.high[0]] == ends


def test_a_step_next_to_an_end_is_not_taken_for_converged() -> None:
    inputs = {"x": Uniform(low=0.0, high=1.0)}
    found = propagate_through(lambda x: (x < 0.25005) * 1.0, inputs, coverage=0.5, most_draws=2**14)
    assert not found.converged
    assert found.error[0] >= 0.25
    assert propagate_through(lambda x: (x < 0.25005) * 1.0, inputs, coverage=0.5).high[0] == 1.0


@pytest.mark.parametrize("value", [0.1, 1.0 / 3.0, 1e6 + 0.1, 2.0])
def test_a_constant_output_converges_at_once(value: float) -> None:
    found = propagate_through(lambda x: 0.0 * x + value, {"x": UNIT})
    assert found.converged
    assert found.draws == 2**14
    assert found.low[0] == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize("scale", [1e-130, 1e130, 0.0])
def test_outputs_of_any_scale_with_squares_have_their_standard_deviation(scale: float) -> None:
    found = propagate_through(lambda x, y: scale * (x + y), [UNIT, UNIT])
    assert found.converged
    assert found.standard_deviation == pytest.approx(np.sqrt(2.0) * scale, rel=0.01)
    assert found.half_width[0] == pytest.approx(np.sqrt(2.0) * scale, rel=0.01)


def test_too_few_draws_are_refused_and_a_missed_tolerance_is_reported() -> None:
    with pytest.raises(OutOfRangeError, match=r"coverage of 0\.999999: 32768 .allowed: at least 536870912"):
        propagate_through(lambda x: x, {"x": UNIT}, coverage=[0.5, 0.999999], tolerance=1e-4, most_draws=2**15)
    found = propagate_through(lambda x: x, {"x": UNIT}, coverage=[0.95], tolerance=1e-4, most_draws=2**15)
    assert not found.converged
    assert found.draws <= 2**15


def test_the_same_seed_gives_the_same_numbers() -> None:
    one, other = (propagate_through(lambda x: x**2, {"x": UNIT}, seed=3) for _ in range(2))
    np.testing.assert_array_equal(one.high, other.high)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"coverage": [1.0]}, "coverage"),
        ({"coverage": []}, "coverage"),
        ({"tolerance": 0.0}, "tolerance"),
        ({"most_draws": 10}, "number of draws"),
        ({"seed": -1}, "seed"),
        ({"coverage": [[0.5]]}, "coverage"),
        ({"coverage": "95 %"}, "coverage: '95 %'"),
        ({"correlation": {("x", "z"): 0.5}}, "input: z .allowed: x"),
        ({"correlation": {"xy": 0.5}}, "a pair of names"),
        ({"correlation": {("x", "y", "x"): 0.5}}, "a pair of names"),
        ({"correlation": {("x", "y"): 0.5, ("y", "x"): 0.4}}, r"two correlations of x and y: 0\.5 and 0\.4"),
        ({"correlation": {("x", "constant"): 0.5}}, "constant input: constant"),
        ({"inputs": {"x": 3.0}}, "input 'x': 3.0"),
        ({"inputs": {1: UNIT}}, "by name"),
        ({"inputs": []}, "by name"),
        ({"correlation": [1]}, "pairs of names"),
        ({"correlation": {("x", "y"): float("nan")}}, "x and y: nan"),
        ({"correlation": {("x", "x"): 1.0}}, "x and x"),
        ({"correlation": {("x", "y"): "a"}}, "x and y: 'a'"),
        ({"correlation": {("x", 1): 0.5}}, "unknown input: 1"),
        ({"tolerance": "a"}, "tolerance: 'a'"),
        ({"most_draws": np.inf}, "number of draws: inf"),
        ({"seed": 1.5}, "seed: 1.5"),
        ({"function": lambda x, **_: [x[:1], x]}, "type object"),
        ({"inputs": {}, "function": lambda: np.zeros(1)}, "inputs"),
        ({"function": lambda x, **_: x + 1j}, "type complex128"),
        ({"function": lambda x, **_: np.ma.masked_less(x, 0.5)}, "masked values"),
        ({"function": lambda x, **_: np.zeros((x.size, 0))}, "no values"),
        ({"function": lambda x, **_: np.where(x < 0.5, x, np.nan)}, r"non-finite values: \d+ of \d+"),
        ({"function": lambda x, **_: np.sqrt(x)}, "non-finite"),
        (
            {"function": lambda x, y, **_: 1e200 * (x + y)},
            r"squares.*up to \d\S*e\+200 .*1e-140 to 1e\+140.*another unit",
        ),
        ({"function": lambda x, y, **_: 1e-200 * (x + y)}, r"squares.*up to \d\S*e-200 .*1e-140"),
        ({"function": lambda x, **_: x[:3]}, r"\(3,\) \(allowed: \(\d+,\)\)"),
        ({"function": lambda x, **_: pint.Quantity(x, "mm")}, r"returned a quantity.*'millimeter'\)> .*\.magnitude"),
        ({"function": lambda x, **_: xr.DataArray(pint.Quantity(x, "mm"))}, "returned a quantity"),
        ({"function": lambda x, **_: x.mean()}, r"\(\) \(allowed: \(\d+,\)\)"),
    ],
)
def test_impossible_requests_are_refused(settings: dict[str, object], message: str) -> None:
    function = settings.pop("function", lambda x, **_: x)
    inputs = settings.pop("inputs", {"x": UNIT, "y": UNIT, "constant": Uniform(low=1.0, high=1.0)})
    with np.errstate(invalid="ignore"), pytest.raises(OutOfRangeError, match=message):
        propagate_through(function, inputs, **settings)  # type: ignore[arg-type]  # wrong on purpose


def test_a_function_that_cannot_take_the_inputs_raises_its_own_error_and_learns_what_it_receives() -> None:
    with pytest.raises(TypeError, match="unexpected keyword argument 'y'") as raised:
        propagate_through(lambda x, z: x + z, {"x": UNIT, "y": UNIT})
    assert raised.value.__notes__ == ["The function receives the inputs x and y by name, each as an array of draws."]


def test_the_example_of_the_documentation_runs() -> None:
    assert doctest.testmod(any_function).failed == 0

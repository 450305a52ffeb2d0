"""Inputs of a propagation from pandas, scipy and numpy, against linear propagation by hand and moments of scipy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy import stats
from scipy.optimize import curve_fit

from tradestudy.errors import OutOfRangeError
from tradestudy.uncertainty import Empirical, Normal, Uniform, propagate_through

MEANS = {"focal_length": 2.65, "baseline": 75.0, "yaw": 0.1}
NAMES = list(MEANS)
COVARIANCE = np.array([[4e-4, -5e-3, 1e-5], [-5e-3, 0.09, 0.0], [1e-5, 0.0, 1e-4]])
TABLE = pd.DataFrame(COVARIANCE, index=NAMES, columns=NAMES)
WEIGHTS = np.array([30.0, 1.0, -7.0])
JOINT = stats.multivariate_normal(list(MEANS.values()), COVARIANCE)
DRAWS = JOINT.rvs(3001, random_state=np.random.default_rng(7)).round(4)
UNIT = Normal(0.0, 1.0)


def weighted(focal_length: np.ndarray, baseline: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    return np.stack([focal_length, baseline, yaw], axis=-1) @ WEIGHTS


@pytest.mark.parametrize(
    ("inputs", "covariance"),
    [
        (MEANS, TABLE),
        (MEANS, TABLE.loc[::-1, ["yaw", "focal_length", "baseline"]]),
        (pd.Series(MEANS)[::-1], TABLE),
        (MEANS, COVARIANCE),
        (list(MEANS.values()), COVARIANCE),
        (np.array(list(MEANS.values())), COVARIANCE.tolist()),
        (JOINT, None),
        ({tuple(NAMES): JOINT}, None),
        ({"yaw": 0.1, ("baseline",): 75.0, "focal_length": 2.65}, TABLE),
    ],
)
def test_a_covariance_propagates_as_by_hand(inputs: Any, covariance: Any) -> None:
    """A weighted sum of jointly normal inputs is normal with the variance wᵀ C w."""
    found = propagate_through(weighted, inputs, covariance=covariance, coverage=0.95, tolerance=2e-3)
    deviation = np.sqrt(WEIGHTS @ COVARIANCE @ WEIGHTS)
    assert found.converged
    assert found.standard_deviation == pytest.approx(deviation, rel=2e-3)
    assert found.half_width[0] == pytest.approx(stats.norm.ppf(0.975) * deviation, rel=2e-3)
    assert found.median == pytest.approx(WEIGHTS @ list(MEANS.values()), rel=1e-4)


@pytest.mark.parametrize(
    "inputs",
    [
        DRAWS,
        DRAWS.tolist(),
        pd.DataFrame(DRAWS, columns=NAMES),
        pd.DataFrame(DRAWS[:, ::-1], columns=NAMES[::-1]),
        {("yaw", "focal_length", "baseline"): pd.DataFrame(DRAWS, columns=NAMES)},
        {("yaw", "focal_length", "baseline"): DRAWS[:, [2, 0, 1]]},
    ],
)
def test_rows_of_draws_stay_whole(inputs: Any) -> None:
    """The quantiles of the outputs are those of the function of the rows; independent columns would give 1.7 times."""
    found = propagate_through(weighted, inputs, coverage=0.9, tolerance=3e-3)
    rows = DRAWS @ WEIGHTS
    spacing = 3.0 * np.diff(np.quantile(rows, [0.949, 0.951])).item()
    np.testing.assert_allclose([found.low[0], found.high[0]], np.quantile(rows, [0.05, 0.95]), atol=spacing)
    assert found.standard_deviation == pytest.approx(rows.std(), rel=3e-3)
    assert np.isin(found.values.round(6), rows.round(6)).all()  # noqa: PD011  # no DataFrame


def test_joint_and_independent_inputs_together() -> None:
    inputs = {"z": Uniform(low=-1.0, high=1.0), ("x", "y"): stats.multivariate_normal([0, 0], [[1, 0.9], [0.9, 1]])}
    found = propagate_through(lambda x, y, z: x - y + z, inputs, tolerance=2e-3)
    assert found.standard_deviation == pytest.approx(np.sqrt(0.2 + 1.0 / 3.0), rel=2e-3)


def test_correlated_inputs_beside_a_covariance() -> None:
    inputs = {"a": 1.0, "x": UNIT, "y": UNIT}
    found = propagate_through(
        lambda a, x, y: a + x + y,
        inputs,
        covariance=pd.DataFrame([[4.0]], index=["a"], columns=["a"]),
        correlation={("x", "y"): -0.5},
        tolerance=2e-3,
    )
    assert found.standard_deviation == pytest.approx(np.sqrt(4.0 + 1.0), rel=2e-3)


@pytest.mark.parametrize("positional", [True, False])
def test_distributions_of_scipy_have_their_moments(positional: bool) -> None:
    given = [stats.gamma(3.0, scale=0.5), stats.uniform(2.0, 3.0), stats.poisson(4.0), UNIT]
    inputs: Any = given if positional else dict(zip("abcd", given, strict=True))
    found = propagate_through(lambda a, b, c, d: a - 2.0 * b + c + d, inputs, tolerance=5e-3)
    assert found.standard_deviation == pytest.approx(np.sqrt(0.75 + 4.0 * 9.0 / 12.0 + 4.0 + 1.0), rel=3e-3)
    assert found.values.mean() == pytest.approx(1.5 - 7.0 + 4.0, abs=5e-3)  # noqa: PD011  # no DataFrame


def test_a_distribution_of_scipy_without_mean_has_its_quantiles() -> None:
    found = propagate_through(lambda x: x, {"x": stats.cauchy(2.0, 0.1)}, coverage=0.5)
    assert found.half_width[0] == pytest.approx(0.1, rel=0.01)
    assert found.median == pytest.approx(2.0, abs=1e-3)


def test_distributions_of_scipy_may_be_correlated() -> None:
    inputs = {"x": stats.norm(1.0, 2.0), "y": Normal(0.0, 3.0)}
    found = propagate_through(lambda x, y: x - y, inputs, correlation={("x", "y"): 0.8}, tolerance=2e-3)
    assert found.standard_deviation == pytest.approx(np.sqrt(4.0 + 9.0 - 2.0 * 0.8 * 6.0), rel=2e-3)


def test_the_result_of_a_fit_goes_in_as_it_comes_out() -> None:
    """The deviation of a fitted line in its middle is that of the noise over √n."""
    x = np.linspace(-1.0, 1.0, 50)
    y = 2.0 + 3.0 * x + np.random.default_rng(3).normal(0.0, 0.1, x.size)
    best, covariance = curve_fit(lambda x, a, b: a + b * x, x, y)
    found = propagate_through(lambda a, b: a + 0.0 * b, best, covariance=covariance, tolerance=2e-3)
    noise = np.sqrt(np.sum((y - best[0] - best[1] * x) ** 2) / (x.size - 2))
    assert found.standard_deviation == pytest.approx(noise / np.sqrt(x.size), rel=3e-3)


def test_parameters_may_be_given_by_position_as_in_scipy() -> None:
    assert Normal(1.0, 2.0).quantile(0.3) == pytest.approx(stats.norm(1.0, 2.0).ppf(0.3))
    assert Empirical(np.array([1.0, 3.0])).mean == 2.0
    with pytest.raises(TypeError):  # scipy's second number is the width, numpy's the upper limit
        Uniform(0.0, 1.0)  # type: ignore[misc]


def named(rows: Any, *names: Any) -> pd.DataFrame:
    return pd.DataFrame(rows, columns=list(names))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"inputs": {"x": 0.0, "y": 0.0}, "covariance": TABLE}, "without a mean: focal_length, baseline, yaw .*x, y"),
        ({"inputs": {"x": UNIT, "y": 0.0}, "covariance": np.eye(2)}, "without a mean: x .allowed: y"),
        ({"inputs": {"x": 0.0, "y": 0.0}, "covariance": np.eye(3)}, "2 x 2"),
        ({"inputs": [0.0, 0.0], "covariance": TABLE}, "without a mean"),
        ({"inputs": {"x": 0.0, "y": 1.0}, "covariance": named([[1.0]], "x").set_axis(["x"])}, "input 'y': 1.0"),
        ({"inputs": {"x": 0.0, "y": 1.0}, "covariance": named(np.eye(2), "x", "y")}, "rows of the covariance"),
        ({"inputs": {"x": 0.0, "y": 1.0}, "covariance": "abc"}, "covariance: 'abc'"),
        ({"inputs": {"x": 0.0, "y": 1.0}, "covariance": [[1.0, 2.0], [2.0, 1.0]]}, "semidefinite"),
        ({"inputs": {"x": DRAWS[:, 0], "y": DRAWS[:, 1]}}, "as one DataFrame"),
        ({"inputs": {"x": [1.0, 2.0], "y": UNIT}}, "as one DataFrame"),
        ({"inputs": DRAWS.T}, r"^the draws of the inputs 1, 2, 3 and 2998 more: .*a row for each draw"),
        ({"inputs": [DRAWS[:, 0], DRAWS[:, 1]]}, "a row for each draw"),
        ({"inputs": [[1.0, 2.0], [3.0]]}, "as one DataFrame"),
        ({"inputs": np.ma.masked_less(DRAWS, 0.1)}, "real numbers"),
        ({"inputs": np.where(DRAWS < 0.1, np.nan, DRAWS)}, "not finite"),
        ({"inputs": np.array(3.0)}, "at least one distribution"),
        ({"inputs": DRAWS[..., None]}, "at least one distribution"),
        ({"inputs": named(DRAWS, 0, 1, 2)}, "names of the columns of the draws: 0, 1, 2"),
        ({"inputs": named(DRAWS, "x", "y", "x")}, "a distinct name for each"),
        ({"inputs": named([["a", "b"]] * 3, "x", "y")}, "real numbers"),
        ({"inputs": {("x", "y"): named(DRAWS, "x", "y", "z")}}, "x, y, z .allowed: x, y"),
        ({"inputs": {("x", "y"): DRAWS}}, r"shape \(3001, 3\)"),
        ({"inputs": {("x", "y"): JOINT}}, "3 variables"),
        ({"inputs": {("x", "y"): UNIT}}, "draws of the inputs x and y"),
        ({"inputs": {("x", "y"): DRAWS[:, :2], "x": UNIT}}, "more than once: x|more than once"),
        ({"inputs": {("x",): UNIT, "x": UNIT}}, "at least one distribution"),
        ({"inputs": {("x", "y"): DRAWS[:, :2], "z": UNIT}, "correlation": {("x", "z"): 0.5}}, "joint distribution"),
        ({"inputs": {"x": stats.norm}}, "such as scipy.stats.norm"),
        ({"inputs": {"x": stats.gamma}}, "such as scipy.stats.norm"),
        ({"inputs": {"x": stats.norm([0.0, 1.0], 1.0)}}, "such as scipy.stats.norm"),
        ({"inputs": {"x": stats.norm(0.0, -1.0)}}, "such as scipy.stats.norm"),
        ({"inputs": {"x": "0.1"}}, "give Normal"),
    ],
)
def test_what_would_lose_a_correlation_or_has_no_meaning_is_refused(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(OutOfRangeError, match=message):
        propagate_through(lambda **_: np.zeros(1), **settings)

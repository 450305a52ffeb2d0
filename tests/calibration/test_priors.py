"""Priors: draws against distribution functions, densities against scipy, nonsense refused."""

import numpy as np
import pytest
from scipy.stats import kstest, norm, truncnorm, uniform

from tradestudy.calibration.laplace import (
    LaplaceFit,
    compare_log_posteriors,
    covariance_from_information,
)
from tradestudy.calibration.synthetic_target import Priors
from tradestudy.errors import NotConvergedError, OutOfRangeError

NAMES = ("free", "cut", "flat")
PRIORS = Priors(
    names=NAMES,
    mean=np.array([1.0, 2.0, 5.0]),
    standard_deviation=np.array([2.0, 1.0, np.inf]),
    lower=np.array([-np.inf, 1.5, 4.0]),
    upper=np.array([np.inf, np.inf, 7.0]),
)


def test_draws_follow_the_stated_distributions():
    draws = PRIORS.draw(np.random.default_rng(0), 20_000)
    stated = [norm(1.0, 2.0), truncnorm(-0.5, np.inf, 2.0, 1.0), uniform(4.0, 3.0)]
    for column, distribution in zip(draws.T, stated, strict=True):
        assert kstest(column, distribution.cdf).pvalue > 1e-3


def test_density_falls_off_as_scipy_says():
    points = np.array([[0.0, 1.6, 4.5], [1.0, 2.0, 6.9], [4.0, 3.7, 5.0]])
    expected = norm(1.0, 2.0).logpdf(points[:, 0]) + norm(2.0, 1.0).logpdf(points[:, 1])
    found = PRIORS.log_density(points)
    np.testing.assert_allclose(np.diff(found), np.diff(expected), rtol=1e-12)
    outside = np.array([[1.0, 1.4, 5.0], [1.0, 2.0, 3.9], [1.0, 2.0, 7.1]])
    assert np.all(PRIORS.log_density(outside) == -np.inf)


def test_scales_and_precisions():
    np.testing.assert_allclose(PRIORS.scale, [2.0, 1.0, 0.75])
    np.testing.assert_allclose(PRIORS.precision, [0.25, 1.0, 0.0])


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"standard_deviation": np.array([2.0, 0.0, 1.0])}, "cut needs a positive"),
        ({"standard_deviation": np.array([2.0, np.inf, 1.0])}, "cut is uniform without finite bounds"),
        ({"mean": np.array([1.0, 1.0, 5.0])}, "cut has its mean outside"),
        ({"mean": np.array([1.0, 2.0])}, "does not match their names"),
    ],
)
def test_nonsense_is_refused(change, word):
    fields = {k: getattr(PRIORS, k) for k in ("names", "mean", "standard_deviation", "lower", "upper")}
    with pytest.raises(OutOfRangeError, match=word):
        Priors(**(fields | change))


def test_laplace_draws_have_the_stated_covariance():
    scale = np.array([1e-6, 1.0, 1e4])
    correlation = np.array([[1.0, 0.996, 0.0], [0.996, 1.0, 0.0], [0.0, 0.0, 1.0]])
    fit = LaplaceFit(names=NAMES, mean=scale, covariance=correlation * np.outer(scale, scale))
    draws = fit.draw(np.random.default_rng(0), 40_000)
    np.testing.assert_allclose(np.corrcoef(draws.T), correlation, atol=0.02)
    np.testing.assert_allclose(draws.std(axis=0), scale, rtol=0.02)


def test_an_information_without_an_inverse_names_the_culprits():
    information = np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 1e8]])
    with pytest.raises(NotConvergedError, match=r"do not determine (free, cut|cut, free)"):
        covariance_from_information(information, NAMES)
    with pytest.raises(NotConvergedError, match="do not determine flat"):
        covariance_from_information(np.diag([1.0, 1.0, 0.0]), NAMES)
    np.testing.assert_allclose(
        covariance_from_information(np.diag([1e-12, 1.0, 1e12]), NAMES), np.diag([1e12, 1.0, 1e-12])
    )


def test_importance_check_has_the_closed_form_of_two_normals():
    """Proposal N(0, 1), exact N(m, 1): efficiency exp(−m²)."""
    draws = np.random.default_rng(0).standard_normal((200_000, 1))
    check = compare_log_posteriors(-0.5 * (draws[:, 0] - 0.3) ** 2, -0.5 * draws[:, 0] ** 2)
    assert check.efficiency == pytest.approx(np.exp(-0.09), rel=0.01)
    assert check.passed
    assert not compare_log_posteriors(-0.5 * (draws[:, 0] - 0.6) ** 2, -0.5 * draws[:, 0] ** 2).passed

import math
from itertools import pairwise

import numpy as np
import pint
import pytest
from scipy import integrate, stats

from tradestudy.errors import OutOfRangeError
from tradestudy.uncertainty.distributions import (
    Arcsine,
    CurvilinearTrapezoid,
    Empirical,
    Normal,
    StudentT,
    Triangular,
    Uniform,
)

PINT = pint.UnitRegistry(cache_folder=None)
PROBABILITY = np.concatenate([np.logspace(-9, -1, 17), np.linspace(0.11, 0.89, 40), 1 - np.logspace(-1, -9, 17)])

SCIPY_TWINS = [
    (Normal(mean=-2.0, standard_deviation=0.3), stats.norm(-2.0, 0.3)),
    (Uniform(low=-1.0, high=5.0), stats.uniform(-1.0, 6.0)),
    (Triangular(low=1.0, mode=1.5, high=4.0), stats.triang(0.5 / 3.0, 1.0, 3.0)),
    (Triangular(low=1.0, mode=1.0, high=4.0), stats.triang(0.0, 1.0, 3.0)),
    (StudentT(location=3.0, scale=2.0, degrees_of_freedom=4.5), stats.t(4.5, 3.0, 2.0)),
    (Arcsine(low=-1.0, high=2.0), stats.arcsine(-1.0, 3.0)),
]


@pytest.mark.parametrize(("mine", "scipy"), SCIPY_TWINS, ids=lambda value: type(value).__name__)
def test_quantile_mean_and_deviation_agree_with_scipy(mine, scipy):
    np.testing.assert_allclose(mine.quantile(PROBABILITY), scipy.ppf(PROBABILITY), rtol=1e-9, atol=1e-12)
    assert mine.mean == pytest.approx(scipy.mean(), rel=1e-12)
    assert mine.standard_deviation == pytest.approx(scipy.std(), rel=1e-12)


@pytest.mark.parametrize("width", [0.0, 2.0])
def test_unlimited_distributions_reach_infinity_unless_they_have_no_width(width):
    normal = Normal(mean=3.0, standard_deviation=width)
    student = StudentT(location=3.0, scale=width, degrees_of_freedom=4.5)
    for one in (normal, student):
        reach = np.inf if width else 3.0
        np.testing.assert_array_equal(one.quantile([0.0, 0.5, 1.0]), [-reach if width else 3.0, 3.0, reach])


def trapezoid_density(low, high, d):
    """Density printed in JCGM 101, 6.4.3.2."""
    x, w = 0.5 * (low + high), 0.5 * (high - low)

    def density(value):
        distance = abs(value - x)
        if distance > w + d:
            return 0.0
        return math.log((w + d) / max(distance, w - d)) / (4.0 * d)

    return density


@pytest.mark.parametrize("d", [0.01, 0.4, 1.49, 1.5])
def test_curvilinear_trapezoid_inverts_the_integral_of_its_printed_density(d):
    mine, density = CurvilinearTrapezoid(low=1.0, high=4.0, inexactness=d), trapezoid_density(1.0, 4.0, d)
    for p in (1e-6, 0.003, 0.05, 0.2, 0.49, 0.5, 0.7, 0.93, 0.9999):
        value = float(mine.quantile(p))
        corners = sorted({1.0 - d, 1.0 + d, 2.5, 4.0 - d, value})
        cumulative = sum(integrate.quad(density, a, b, epsabs=1e-14)[0] for a, b in pairwise(corners) if b <= value)
        assert cumulative == pytest.approx(p, abs=2e-10)


def test_curvilinear_trapezoid_has_the_moments_and_draws_of_the_two_stage_recipe():
    mine = CurvilinearTrapezoid(low=1.0, high=4.0, inexactness=0.7)
    first, second = np.random.default_rng(5).random((2, 400_000))
    low = 0.3 + 1.4 * first
    drawn = low + (5.0 - 2.0 * low) * second
    assert mine.standard_deviation == pytest.approx(np.std(drawn), rel=4e-3)
    for p in (0.01, 0.2, 0.5, 0.8, 0.99):
        assert np.mean(drawn <= mine.quantile(p)) == pytest.approx(p, abs=4.0 * math.sqrt(p * (1 - p) / 400_000))


def test_curvilinear_trapezoid_without_inexactness_is_uniform():
    mine = CurvilinearTrapezoid(low=1.0, high=4.0, inexactness=0.0)
    np.testing.assert_array_equal(mine.quantile(PROBABILITY), Uniform(low=1.0, high=4.0).quantile(PROBABILITY))


def test_student_t_states_no_moment_that_does_not_exist():
    cauchy = StudentT(location=1.0, scale=2.0, degrees_of_freedom=1.0)
    assert cauchy.mean is None
    assert cauchy.standard_deviation is None
    assert cauchy.quantile(0.75) == pytest.approx(3.0)
    assert StudentT(location=1.0, scale=2.0, degrees_of_freedom=2.0).standard_deviation is None
    assert StudentT(location=1.0, scale=2.0, degrees_of_freedom=2.0).mean == 1.0


def test_empirical_draws_are_returned_in_equal_shares():
    draws = np.array([3.0, 1.0, 2.0, 10.0])
    mine = Empirical(draws=draws)
    np.testing.assert_array_equal(mine.quantile((np.arange(8) + 0.5) / 8), [1, 1, 2, 2, 3, 3, 10, 10])
    np.testing.assert_array_equal(mine.quantile([0.0, 0.25, 1.0]), [1, 1, 10])
    assert mine.standard_deviation == pytest.approx(math.sqrt(12.5))


@pytest.mark.parametrize(
    ("build", "value", "limit"),
    [
        (lambda: Normal(mean=0.0, standard_deviation=-1.0), "-1", ">= 0"),
        (lambda: Normal(mean=math.nan, standard_deviation=1.0), "nan", "finite"),
        (lambda: Normal(mean=0.0, standard_deviation="0.1 px"), "0.1 px", "a number without unit"),
        (lambda: Normal(mean=0.0, standard_deviation=2 * PINT.deg), "2", "a number without unit"),
        (lambda: Uniform(low=0.0 * PINT.mm, high=1.0), "0.0", "a number without unit"),
        (lambda: Uniform(low=2.0, high=1.0), "2, 1", "low <= ... <= high"),
        (lambda: Triangular(low=0.0, mode=2.0, high=1.0), "0, 2, 1", "low <= ... <= high"),
        (lambda: StudentT(location=0.0, scale=1.0, degrees_of_freedom=0.0), "0", "> 0"),
        (lambda: Arcsine(low=math.inf, high=math.inf), "inf", "finite"),
        (lambda: CurvilinearTrapezoid(low=0.0, high=1.0, inexactness=0.6), "0.6", "0.5"),
        (lambda: Empirical(draws=np.array([1.0, math.nan])), "1 of them not finite", "two finite values"),
        (lambda: Empirical(draws=np.array([1.0])), "(1,)", "two finite values"),
    ],
)
def test_impossible_parameters_are_refused_with_value_and_limit(build, value, limit):
    with pytest.raises(OutOfRangeError) as caught:
        build()
    assert value in caught.value.value
    assert limit in caught.value.limit
    assert caught.value.remedy

import numpy as np
import pytest
from scipy import integrate
from scipy.special import ndtr

from tradestudy.errors import OutOfRangeError
from tradestudy.uncertainty.decision import (
    rank_probability,
)
from tradestudy.uncertainty.distributions import Normal
from tradestudy.uncertainty.sources import ErrorClass, Source, Sources

DRAWS = {"draws": 2**11, "replicates": 8, "seed": 0, "point": "decision"}


def sources(**deviations):
    return Sources(
        groups=tuple(
            Source(name=name, distribution=Normal(mean=0.0, standard_deviation=s), error_class=ErrorClass.RIG)
            for name, s in deviations.items()
        )
    )


def error_of(name, truth, gain=1.0):
    """A model whose depth error is exactly gain × the named source."""
    return lambda v: 1.0 / (truth + gain * v[name])


def test_rank_probability_of_two_normal_errors_has_its_closed_form():
    """P(|A| < |B|) = (2/π) atan(σ_B/σ_A) for independent centred normals."""
    truth, gain = np.array([5.0, 5.0, 5.0]), np.array([0.2, 1.0, 3.0])
    draws = {"draws": 2**11, "replicates": 16, "seed": 0, "point": "rank"}
    mine = rank_probability(error_of("a", truth), error_of("b", truth, gain), sources(a=0.01, b=0.01), truth, **draws)
    exact = 2.0 / np.pi * np.arctan(gain)
    assert np.all(np.abs(mine.first - exact) <= 4.0 * mine.first_error)
    assert np.all(mine.first_error < 5e-3)
    np.testing.assert_allclose(mine.first + mine.second + mine.neither, 1.0)
    np.testing.assert_allclose(mine.neither, 0.0, atol=1e-15)


def test_a_source_that_both_cameras_share_is_shared():
    truth = np.array([5.0])
    mine = rank_probability(
        error_of("t", truth, 0.99), error_of("t", truth), sources(t=0.01, other=0.5), truth, **DRAWS
    )
    np.testing.assert_array_equal(mine.first, 1.0)
    np.testing.assert_array_equal(mine.first_error, 0.0)


def test_failures_and_infinities_lose_and_two_of_them_rank_neither():
    truth = np.array([1.0])

    def failing(v):
        return np.where(v["a"] > 0.0, np.nan, 1.0)

    def infinite(v):
        return np.where(v["b"] > 0.0, -1.0, 0.9) + 0.0 * v["b"]

    mine = rank_probability(failing, infinite, sources(a=1.0, b=1.0), truth, **DRAWS)
    np.testing.assert_allclose([mine.first[0], mine.second[0], mine.neither[0]], [0.5, 0.25, 0.25], atol=5e-3)


def stereo(distance):
    return lambda v: 1.0 / distance + v["yaw"] / 0.1


def plenoptic(distance):
    return lambda v: 1.0 / distance + v["z"] / 12.5e-3**2


def test_impossible_draws_are_refused():
    with pytest.raises(OutOfRangeError, match="power of two"):
        rank_probability(stereo(1.0), stereo(1.0), sources(yaw=1.0), np.ones(1), **DRAWS | {"draws": 100})


def test_rank_probability_with_a_bias_agrees_with_direct_integration():
    truth, bias = np.array([2.0]), 0.015
    mine = rank_probability(
        lambda v: 1.0 / (truth + bias + v["a"]),
        error_of("b", truth),
        sources(a=0.01, b=0.02),
        truth,
        **DRAWS,
    )

    def integrand(x):
        density = np.exp(-0.5 * (x / 0.02) ** 2) / (0.02 * np.sqrt(2.0 * np.pi))
        return density * (ndtr((abs(x) - bias) / 0.01) - ndtr((-abs(x) - bias) / 0.01))

    exact = integrate.quad(integrand, -0.2, 0.2, points=[0.0])[0]
    assert mine.first[0] == pytest.approx(exact, abs=4.0 * mine.first_error[0])

import numpy as np
import pytest
from scipy import integrate
from scipy.special import ndtr

from tradestudy.errors import OutOfRangeError
from tradestudy.uncertainty.decision import (
    Draws,
    crossings,
    half_width,
    log_ratio,
    rank_probability,
    solve_in_replicates,
)
from tradestudy.uncertainty.distributions import Normal
from tradestudy.uncertainty.error_class import ErrorClass
from tradestudy.uncertainty.evaluation import Outcome
from tradestudy.uncertainty.sources import Source, Sources
from tradestudy.uncertainty.streams import plain_random, scrambled_sobol

DRAWS = Draws(draws=2**11, replicates=8, sampler=scrambled_sobol, seed=0, point="decision")


def sources(**deviations):
    return Sources(
        groups=tuple(
            Source(name=name, distribution=Normal(mean=0.0, standard_deviation=s), error_class=ErrorClass.RIG)
            for name, s in deviations.items()
        )
    )


def error_of(name, truth, gain=1.0):
    """A model whose depth error is exactly gain × the named source."""
    return lambda v: Outcome(values=1.0 / (truth + gain * v[name]))


@pytest.mark.parametrize("sampler", [scrambled_sobol, plain_random])
def test_rank_probability_of_two_normal_errors_has_its_closed_form(sampler):
    """P(|A| < |B|) = (2/π) atan(σ_B/σ_A) for independent centred normals."""
    truth, gain = np.array([5.0, 5.0, 5.0]), np.array([0.2, 1.0, 3.0])
    draws = Draws(draws=2**11, replicates=16, sampler=sampler, seed=0, point="rank")
    mine = rank_probability(error_of("a", truth), error_of("b", truth, gain), sources(a=0.01, b=0.01), truth, draws)
    exact = 2.0 / np.pi * np.arctan(gain)
    assert np.all(np.abs(mine.first - exact) <= 4.0 * mine.first_error)
    assert np.all(mine.first_error < 5e-3)
    np.testing.assert_allclose(mine.first + mine.second + mine.neither, 1.0)
    np.testing.assert_allclose(mine.neither, 0.0, atol=1e-15)


def test_a_source_that_both_cameras_share_is_shared():
    truth = np.array([5.0])
    mine = rank_probability(error_of("t", truth, 0.99), error_of("t", truth), sources(t=0.01, other=0.5), truth, DRAWS)
    np.testing.assert_array_equal(mine.first, 1.0)
    np.testing.assert_array_equal(mine.first_error, 0.0)


def test_failures_and_infinities_lose_and_two_of_them_are_neither():
    truth = np.array([1.0])

    def failing(v):
        return Outcome(values=1.0 + 0.0 * v["a"], no_overlap=v["a"] > 0.0)

    def infinite(v):
        return Outcome(values=np.where(v["b"] > 0.0, -1.0, 0.9) + 0.0 * v["b"])

    mine = rank_probability(failing, infinite, sources(a=1.0, b=1.0), truth, DRAWS)
    np.testing.assert_allclose([mine.first[0], mine.second[0], mine.neither[0]], [0.5, 0.25, 0.25], atol=5e-3)


def stereo(distance):
    return lambda v: Outcome(values=1.0 / distance + v["yaw"] / 0.1)


def plenoptic(distance):
    return lambda v: Outcome(values=1.0 / distance + v["z"] / 12.5e-3**2)


def test_half_width_is_that_of_the_closed_form():
    spread = 3.49e-3 / 0.1
    exact = 0.5 * (1.0 / (1.0 - spread) - 1.0 / (1.0 + spread))
    assert half_width(stereo(np.array([1.0])), sources(yaw=3.49e-3), DRAWS, 0)[0] == pytest.approx(exact, rel=1e-3)
    assert half_width(stereo(np.array([100.0])), sources(yaw=3.49e-3), DRAWS, 0)[0] == np.inf


def test_an_inverse_question_is_solved():
    """Which yaw stability gives half a 68 % interval of 8.7 mm at 0.5 m?  w = s/(1/Z² − s²), so s is a root."""
    target, distance = 8.7e-3, 0.5

    def quantity(yaw, replicate):
        width = half_width(stereo(np.array([distance])), sources(yaw=yaw), DRAWS, replicate)
        return float(np.log(width[0] / target))

    answer = solve_in_replicates(quantity, low=1e-5, high=1e-1, replicates=8)
    exact = 0.1 * (-1.0 + np.sqrt(1.0 + 4.0 * target**2 / distance**2)) / (2.0 * target)
    assert answer.value == pytest.approx(exact, abs=3.0 * answer.standard_error)
    assert answer.standard_error < 1e-3 * exact


def test_a_question_without_answer_in_the_bracket_is_refused_with_both_ends():
    with pytest.raises(OutOfRangeError, match=r"not reached in the bracket.* at 1 and .* at 2.*widen the bracket"):
        solve_in_replicates(lambda x, replicate: x + replicate, low=1.0, high=2.0, replicates=8)


def test_a_root_beside_an_infinite_width_is_found():
    answer = solve_in_replicates(lambda x, replicate: np.inf if x > 3.0 else x - 2.0, low=0.0, high=10.0, replicates=2)
    assert answer.value == pytest.approx(2.0, abs=1e-8)
    assert answer.standard_error == pytest.approx(0.0, abs=1e-12)


def test_two_curves_cross_where_they_should_with_their_monte_carlo_error():
    """Noise in inverse depth: stereo s, short-range camera c Z^-1 s: equal at Z = c."""
    spread = 2e-3

    def curve(distances, replicate):
        first = half_width(lambda v: Outcome(values=1.0 / distances + v["a"]), sources(a=spread), DRAWS, replicate)
        second = half_width(
            lambda v: Outcome(values=1.0 / distances + 0.73 / distances * v["b"]),
            sources(b=spread),
            DRAWS,
            replicate + 100,
        )
        return log_ratio(first, second)

    found = crossings(curve, np.geomspace(0.1, 5.0, 12), replicates=8)
    assert len(found) == 1
    assert found[0].value == pytest.approx(0.73, abs=3.0 * found[0].standard_error + 1e-6)
    assert 0.0 < found[0].standard_error < 1e-2
    assert crossings(curve, np.geomspace(1.0, 5.0, 5), replicates=8) == ()


def test_every_crossing_is_found_and_one_that_some_replicates_miss_is_not_resolved():
    distances = np.linspace(0.1, 7.0, 30)
    found = crossings(lambda x, r: np.sin(x) + 1e-3 * (r - 3.5), distances, replicates=8)
    np.testing.assert_allclose([c.value for c in found], [np.pi, 2.0 * np.pi], atol=1e-4)
    assert found[0].standard_error == pytest.approx(1e-3 * np.std(np.arange(8), ddof=1) / np.sqrt(8), rel=1e-3)
    on_the_grid = crossings(lambda x, r: x - 2.0, np.array([1.0, 2.0, 3.0]), replicates=8)
    assert [(c.value, c.standard_error) for c in on_the_grid] == [(2.0, 0.0)]
    gap = crossings(lambda x, r: np.where(x > 4.0, np.nan, np.sin(x)), distances, replicates=8)
    np.testing.assert_allclose([c.value for c in gap], [np.pi], atol=1e-8)
    touching = crossings(lambda x, r: (x - 2.9) * (x - 3.1) + (0.1 if r == 0 else 0.0), distances, replicates=8)
    assert [np.isinf(c.standard_error) for c in touching] == [True, True]


def test_log_ratio_has_its_limits():
    first, second = np.array([1.0, np.inf, 1.0, np.inf, 0.0, 0.0]), np.array([np.e, 1.0, np.inf, np.inf, 1.0, 0.0])
    np.testing.assert_allclose(log_ratio(first, second), [-1.0, np.inf, -np.inf, np.nan, -np.inf, np.nan])


def test_impossible_draws_are_refused():
    with pytest.raises(OutOfRangeError, match="power of two"):
        Draws(draws=100, replicates=8, sampler=scrambled_sobol, seed=0, point="")


def test_rank_probability_with_a_bias_agrees_with_direct_integration():
    truth, bias = np.array([2.0]), 0.015
    mine = rank_probability(
        lambda v: Outcome(values=1.0 / (truth + bias + v["a"])),
        error_of("b", truth),
        sources(a=0.01, b=0.02),
        truth,
        DRAWS,
    )

    def integrand(x):
        density = np.exp(-0.5 * (x / 0.02) ** 2) / (0.02 * np.sqrt(2.0 * np.pi))
        return density * (ndtr((abs(x) - bias) / 0.01) - ndtr((-abs(x) - bias) / 0.01))

    exact = integrate.quad(integrand, -0.2, 0.2, points=[0.0])[0]
    assert mine.first[0] == pytest.approx(exact, abs=4.0 * mine.first_error[0])

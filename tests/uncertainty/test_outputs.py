import numpy as np
import pytest

from tests.uncertainty.builders import plain_random
from tests.uncertainty.published_cases import STEREO_YAW
from tradestudy.uncertainty import evaluation
from tradestudy.uncertainty.distributions import Normal, StudentT, Uniform
from tradestudy.uncertainty.evaluation import Outcome, depth_from_inverse
from tradestudy.uncertainty.outputs import PROBABILITIES, order_quantile
from tradestudy.uncertainty.propagation import Sampling, propagate
from tradestudy.uncertainty.sources import ErrorClass, Source, Sources


def sampling(draws=2**14, **given):
    return Sampling(**({"absolute_tolerance": 0.0, "relative_tolerance": 0.0, "budget_draws": draws} | given))


def independent(**deviations):
    return Sources(
        groups=tuple(
            Source(name=name, distribution=Normal(mean=0.0, standard_deviation=s), error_class=ErrorClass.RIG)
            for name, s in deviations.items()
        )
    )


UNIT = Sources(groups=(Source(name="u", distribution=Uniform(low=0.0, high=1.0), error_class=ErrorClass.RIG),))


def run(model, sources, chosen=None, *, inverse_depth=False):
    return propagate(model, sources, chosen or sampling(), seed=0, point="outputs", inverse_depth=inverse_depth)


def failing(v):
    """A tenth is not a number, a fifth does not overlap, another fifth is out of range, some of it also NaN."""
    u = v["u"]
    values = np.where(u < 0.1, np.nan, u)
    values = np.where((u > 0.5) & (u < 0.55), np.nan, values)
    return Outcome(values=values, no_overlap=(u > 0.3) & (u < 0.5), out_of_range=(u > 0.5) & (u < 0.7))


def test_failures_are_counted_by_cause_and_quantiles_are_conditional():
    mine = run(failing, UNIT)
    np.testing.assert_allclose(mine.failed_fraction[:, 0], [0.1, 0.2, 0.2], atol=1e-3)
    assert mine.failed.sum() == pytest.approx(0.5 * mine.draws, abs=16)
    assert mine.failed_fraction[:, 0].sum() == pytest.approx(0.5, abs=1e-3)
    # What is left is uniform on (0.1, 0.3) and (0.7, 1.0): its median is where 0.25 of the probability lies below.
    assert mine.quantiles[2, 0] == pytest.approx(0.75, abs=1e-3)
    np.testing.assert_allclose(mine.quantiles[[0, 4], 0], [0.1125, 0.9875], atol=1e-3)


def test_draws_without_any_rank_end_the_search():
    chosen = sampling(2**20, absolute_tolerance=1e-6, relative_tolerance=0.0)
    mine = run(lambda v: Outcome(values=v["u"], no_overlap=True), UNIT, chosen)
    assert list(mine.status) == ["unranked"]
    assert mine.draws == 8 * 2**9
    np.testing.assert_array_equal(mine.failed[:, 0], [0, mine.draws, 0])
    assert np.all(np.isnan(mine.quantiles))
    assert mine.failed_fraction[:, 0].sum() == 1.0


def test_minus_infinity_and_infinite_inverse_depth_have_no_rank():
    mine = run(lambda v: Outcome(values=np.where(v["u"] < 0.25, -np.inf, v["u"])), UNIT)
    assert mine.failed_fraction[0, 0] == pytest.approx(0.25, abs=1e-3)
    mine = run(lambda v: Outcome(values=np.where(v["u"] < 0.25, np.inf, v["u"])), UNIT, inverse_depth=True)
    assert mine.failed_fraction[0, 0] == pytest.approx(0.25, abs=1e-3)


def test_disparities_that_are_not_positive_are_the_far_end_of_the_quantiles():
    mine = run(lambda v: Outcome(values=v["u"] - np.array([0.01, 0.1, 0.6])), UNIT, inverse_depth=True)
    assert np.all(mine.failed == 0)
    assert list(np.isinf(mine.quantiles[4])) == [False, True, True]
    # P(Z > z) = P(u < 0.1 + 1/z): the 84.1 % quantile is finite, the 97.5 % quantile is not.
    np.testing.assert_allclose(mine.quantiles[3, 1], 1.0 / (1.0 - PROBABILITIES[3] - 0.1), rtol=0.02)
    assert mine.quantiles[4, 1] == np.inf
    assert mine.quantiles_error[4, 1] == 0.0
    assert mine.quantiles[2, 2] == np.inf
    assert list(np.isinf(mine.half_width)) == [False, False, True]
    assert np.all(np.isnan(mine.standard_deviation))


def test_an_end_that_some_replicates_call_infinite_is_not_converged(monkeypatch):
    monkeypatch.setattr(evaluation, "scrambled_sobol", plain_random)
    chosen = sampling(2**12, absolute_tolerance=1e9, relative_tolerance=1.0)
    mine = run(lambda v: Outcome(values=v["u"] - 0.025), UNIT, chosen, inverse_depth=True)
    assert mine.quantiles[4, 0] == np.inf
    assert mine.quantiles_error[4, 0] == np.inf
    assert mine.status[0] == "budget"


def test_moments_appear_only_where_they_exist():
    """0.2° of yaw: infinity is 57 standard deviations of inverse depth away at 0.5 m, 2.9 at 10 m."""
    distances = np.array([0.5, 1.0, 3.0, 6.0, 10.0])
    sources = independent(yaw=STEREO_YAW.yaw_standard_deviation)
    mine = run(lambda v: Outcome(values=1.0 / distances + v["yaw"] / 0.1), sources, inverse_depth=True)
    assert list(np.isfinite(mine.standard_deviation)) == [True, True, True, False, False]
    np.testing.assert_array_equal(np.isnan(mine.mean), np.isnan(mine.standard_deviation))
    # Second-order bias of a reciprocal: u²/Z³ in inverse depth, i.e. Z³ s².
    spread = STEREO_YAW.yaw_standard_deviation / 0.1
    assert mine.mean[0] - 0.5 == pytest.approx(0.5**3 * spread**2, rel=0.02)


@pytest.mark.parametrize(
    ("sources", "model", "exist"),
    [
        (independent(x=1.0), lambda v: v["x"], True),
        (independent(x=1.0), lambda v: np.exp(v["x"]), True),
        (independent(x=1.0, y=1.0), lambda v: v["x"] / (v["y"] + 0.5), False),
        (UNIT, lambda v: -np.log(v["u"]), True),
        (UNIT, lambda v: v["u"] ** -0.25, True),
        (UNIT, lambda v: v["u"] ** -1.0, False),
        (UNIT, lambda v: -(v["u"] ** -1.0), False),
        (UNIT, lambda v: np.zeros_like(v["u"]), True),
    ],
    ids=["normal", "log-normal", "Cauchy", "exponential", "tail 4", "tail 1", "lower tail 1", "constant"],
)
def test_heavy_tails_are_found_in_outputs_of_any_kind(sources, model, exist):
    mine = run(lambda v: Outcome(values=model(v)), sources)
    assert bool(np.isfinite(mine.standard_deviation[0])) is exist


def test_a_source_without_variance_gives_no_moments_but_quantiles():
    t = StudentT(location=0.0, scale=1.0, degrees_of_freedom=2.0)
    sources = Sources(groups=(Source(name="x", distribution=t, error_class=ErrorClass.RIG),))
    mine = run(lambda v: Outcome(values=v["x"]), sources, sampling(2**16))
    assert np.isnan(mine.standard_deviation[0])
    assert mine.quantiles[4, 0] == pytest.approx(4.302653, rel=5e-3)  # printed in every table of t


def test_depth_from_inverse_depth_has_its_limits():
    depth = depth_from_inverse(np.array([2.0, 0.0, -1.0, np.nan, 5e-324]))
    np.testing.assert_array_equal(depth, [0.5, np.inf, np.inf, np.nan, np.inf])


def test_order_quantiles_are_the_middle_of_their_share():
    ascending = np.array([1.0, 2.0, 4.0, np.inf])
    assert order_quantile(ascending, 0.125) == 1.0
    assert order_quantile(ascending, 0.25) == 1.5
    assert order_quantile(ascending, 0.625) == 4.0
    assert order_quantile(ascending, 0.7) == np.inf
    assert order_quantile(ascending, 0.001) == 1.0

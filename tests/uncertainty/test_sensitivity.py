import numpy as np
import pytest
from scipy.special import ndtr

from tests.uncertainty.builders import correlated_normal, of_class, plain_random
from tradestudy.errors import OutOfRangeError
from tradestudy.uncertainty import evaluation
from tradestudy.uncertainty.distributions import Normal, StudentT, Uniform
from tradestudy.uncertainty.joint import GaussianCopula, JointDraws
from tradestudy.uncertainty.sensitivity import parameter_tornado, sobol_indices, tornado
from tradestudy.uncertainty.sources import ErrorClass, Source, Sources

RIG = ErrorClass.RIG


def normal(name, deviation):
    return Source(name=name, distribution=Normal(mean=0.0, standard_deviation=deviation), error_class=RIG)


def pair(correlation, deviations=(1.0, 1.0)):
    return correlated_normal(
        name="optics",
        parameters=("z", "f"),
        mean=np.zeros(2),
        standard_deviation=np.array(deviations),
        correlation=np.array([[1.0, correlation], [correlation, 1.0]]),
        error_class=RIG,
    )


def indices(model, sources, draws=2**11):
    return sobol_indices(model, sources, draws=draws, seed=0, point="s")


def test_bars_have_the_widths_of_their_sources():
    sources = Sources(groups=(normal("yaw", 0.03), normal("pixel", 0.01)))
    bars = tornado(
        lambda v: 1.0 + v["yaw"] + 2.0 * v["pixel"],
        sources,
        seed=0,
        point="t",
        inverse_depth=False,
    )
    assert bars.names == ("yaw", "pixel")
    np.testing.assert_allclose(bars.half_width[:, 0], [0.03, 0.02], rtol=1e-3)


UNIT = Sources(groups=(Source(name="u", distribution=Uniform(low=0.0, high=1.0), error_class=RIG),))
NEAR, FAR = ndtr(1.0), ndtr(-1.0)  # probabilities of inverse depth at the ends of an interval


def bar_of(model, *, inverse_depth=True, sources=UNIT, seed=0):
    """Half widths of the only bar, their errors, and the number of draws that they took."""
    draws = 0

    def counted(v):
        nonlocal draws
        draws += len(v[sources.parameters[0]])
        return model(v)

    found = tornado(counted, sources, seed=seed, point="bar", inverse_depth=inverse_depth)
    return found.half_width[0], found.half_width_error[0], draws


def test_bars_of_depth_under_a_yaw_error_have_their_closed_form_and_its_stated_error():
    distance, spread = np.array([0.5, 1.0, 3.0, 10.0]), 0.0349
    exact = 0.5 * (1.0 / (1.0 / distance - spread) - 1.0 / (1.0 / distance + spread))
    sources = Sources(groups=(normal("yaw", 0.1 * spread),))
    missed = []
    for seed in range(20):
        found, error, _ = bar_of(lambda v: 1.0 / distance + v["yaw"] / 0.1, sources=sources, seed=seed)
        assert np.all(2.365 * error <= 0.01 * found)
        missed.append(np.abs(found - exact) / exact)
    assert np.mean(np.array(missed) <= 0.01) >= 0.95


def test_a_bar_takes_more_draws_until_its_error_is_small_but_no_more_than_its_budget(monkeypatch):
    assert bar_of(lambda v: v["u"], inverse_depth=False)[2] == 8 * 2**9
    monkeypatch.setattr(evaluation, "scrambled_sobol", plain_random)
    found, error, draws = bar_of(lambda v: v["u"], inverse_depth=False)
    assert draws == 2**14
    assert found[0] == pytest.approx(0.5 * (NEAR - FAR), abs=4.0 * error[0])


def test_a_bar_without_a_far_end_is_infinite():
    beyond = np.array([0.01, 0.1, 0.6, 1.0])
    found, error, draws = bar_of(lambda v: v["u"] - beyond)
    np.testing.assert_allclose(found[:2], 0.5 / (FAR - beyond[:2]) - 0.5 / (NEAR - beyond[:2]), rtol=0.01)
    np.testing.assert_array_equal(found[2:], np.inf)
    np.testing.assert_array_equal(error[2:], 0.0)
    assert draws == 8 * 2**9


def test_a_far_end_that_only_some_replicates_find_infinite_is_as_uncertain(monkeypatch):
    monkeypatch.setattr(evaluation, "scrambled_sobol", plain_random)
    found, error, draws = bar_of(lambda v: v["u"] - FAR)
    assert found[0] == error[0] == np.inf
    assert draws == 2**14


def test_a_bar_is_that_of_the_draws_with_an_output():
    """What is left is uniform on (0.1, 0.3) and (0.7, 1.0), a probability of 0.5."""
    found, error, _ = bar_of(
        lambda v: np.where((v["u"] < 0.1) | (abs(v["u"] - 0.5) < 0.2), np.nan, v["u"]), inverse_depth=False
    )
    assert found[0] == pytest.approx(0.5 * ((0.5 + 0.5 * NEAR) - (0.1 + 0.5 * FAR)), abs=1e-3)
    found, error, draws = bar_of(lambda v: np.full_like(v["u"], np.nan))
    assert np.isnan([found[0], error[0]]).all()
    assert draws == 8 * 2**9


def test_a_group_moves_together_in_the_tornado():
    sources = Sources(groups=(pair(0.99), normal("pixel", 0.5)))
    bars = tornado(
        lambda v: v["z"] - v["f"] + v["pixel"],
        sources,
        seed=0,
        point="t",
        inverse_depth=False,
    )
    np.testing.assert_allclose(bars.half_width[:, 0], [np.sqrt(0.02), 0.5], rtol=1e-3)


@pytest.mark.parametrize(
    "group",
    [
        pair(-0.31),
        GaussianCopula(
            name="optics",
            parameters=("z", "f"),
            marginals=(Normal(mean=0, standard_deviation=1), Normal(mean=0, standard_deviation=1)),
            correlation=np.array([[1.0, 0.996], [0.996, 1.0]]),
            error_class=RIG,
        ),
        JointDraws(
            name="optics",
            parameters=("z", "f"),
            draws=np.random.default_rng(0).normal(size=(500, 2)) @ np.array([[1.0, 1.0], [0.0, 0.5]]),
            error_class=RIG,
        ),
    ],
    ids=["covariance", "copula", "posterior"],
)
def test_a_parameter_alone_is_refused_where_it_is_correlated(group):
    with pytest.raises(OutOfRangeError, match=r"correlated.*: [+-]0\.\d+ between z and f .*the whole group"):
        parameter_tornado(
            lambda v: v["z"] - v["f"],
            Sources(groups=(group,)),
            seed=0,
            point="t",
            inverse_depth=False,
        )


def test_weakly_correlated_parameters_get_a_bar_each_and_held_sources_stay_nominal():
    held = Source(name="held", distribution=Normal(mean=5.0, standard_deviation=9.0), error_class=ErrorClass.SESSION)
    sources = of_class(Sources(groups=(pair(0.29, (1.0, 3.0)), held)), [RIG])
    bars = parameter_tornado(
        lambda v: v["held"] / 5.0 * (v["z"] - v["f"]), sources, seed=0, point="t", inverse_depth=False
    )
    assert bars.names == ("z", "f")
    np.testing.assert_allclose(bars.half_width[:, 0], [1.0, 3.0], rtol=1e-3)


def test_grouped_indices_share_out_the_variance_of_correlated_parameters():
    """Y = z − f + p + z p: var of the group 2(1 − ρ), of p s², of the interaction s²."""
    rho, s = 0.9, 0.4
    mine = indices(
        lambda v: v["z"] - v["f"] + v["p"] + v["z"] * v["p"],
        Sources(groups=(pair(rho), normal("p", s))),
        draws=2**13,
    )
    group, noise = 2.0 * (1.0 - rho), s**2
    total = group + 2.0 * noise
    assert mine.names == ("optics", "p")
    np.testing.assert_allclose(mine.first[:, 0], [group / total, noise / total], atol=4.0 * mine.first_error.max())
    np.testing.assert_allclose(
        mine.total[:, 0], [(group + noise) / total, 2.0 * noise / total], atol=4.0 * mine.total_error.max()
    )
    assert mine.first_error.max() < 0.01
    assert mine.evaluations == 4 * 2**13 * 8


def test_an_output_with_one_bad_draw_is_refused_and_its_neighbours_are_not():
    def model(v):
        bad = np.where(v["a"] > 3.0, np.nan, v["a"])
        return np.concatenate([v["a"] + v["b"], bad, 0.0 * v["a"]], axis=1)

    mine = indices(model, Sources(groups=(normal("a", 1.0), normal("b", 1.0))))
    np.testing.assert_allclose(mine.first[:, 0], 0.5, atol=0.02)
    assert np.all(np.isnan(mine.first[:, 1:]))
    assert np.all(np.isnan(mine.total[:, 1:]))
    assert mine.refused[0] == ""
    assert "not finite" in mine.refused[1]
    assert "does not vary" in mine.refused[2]


def test_inverse_depth_has_indices_where_depth_is_infinite():
    sources = Sources(groups=(normal("yaw", 0.06), normal("pixel", 0.08)))
    inverse = indices(lambda v: 0.1 + v["yaw"] + v["pixel"], sources)
    np.testing.assert_allclose(inverse.first[:, 0], [0.36, 0.64], atol=0.01)

    def depth(v):
        w = 0.1 + v["yaw"] + v["pixel"]
        return np.where(w > 0.0, 1.0 / w, np.inf)

    assert "analyse inverse depth" in indices(depth, sources).refused[0]


def test_indices_do_not_depend_on_batches():
    sources = Sources(groups=(normal("a", 1.0), normal("b", 2.0)))
    model = lambda v: v["a"] * v["b"] + v["a"]  # noqa: E731  one line is the whole model
    first = sobol_indices(model, sources, draws=2**9, seed=0, point="s")
    second = sobol_indices(model, sources, draws=2**9, seed=0, point="s", batch_draws=2**5)
    np.testing.assert_array_equal(first.first, second.first)
    np.testing.assert_array_equal(first.total, second.total)


@pytest.mark.parametrize(
    ("groups", "draws", "message"),
    [
        ((normal("a", 1.0),), 100, "power of two"),
        ((normal("a", 0.0),), 128, "without an uncertain source"),
        (
            (
                Source(
                    name="a",
                    distribution=StudentT(location=0.0, scale=1.0, degrees_of_freedom=2.0),
                    error_class=RIG,
                ),
            ),
            128,
            "finite variance",
        ),
    ],
)
def test_indices_that_cannot_exist_are_refused(groups, draws, message):
    with pytest.raises(OutOfRangeError, match=message):
        indices(lambda v: v["a"], Sources(groups=groups), draws=draws)


def test_one_group_alone_has_the_whole_variance():
    found = indices(lambda values: values["x"] ** 3, Sources(groups=(normal("x", 2.0),)))
    assert found.first[0, 0] == pytest.approx(1.0, abs=0.05)
    assert found.total[0, 0] == pytest.approx(1.0, abs=0.05)
    assert found.refused == ("",)


def test_an_output_that_does_not_vary_is_refused_with_one_group_too():
    found = indices(lambda values: 0.0 * values["x"] + 3.0, Sources(groups=(normal("x", 2.0),)))
    assert np.isnan(found.first).all()
    assert "does not vary" in found.refused[0]


@pytest.mark.parametrize("deviation", [1e-200, 1e200])
def test_a_standard_deviation_without_a_square_is_refused(deviation):
    with pytest.raises(OutOfRangeError, match=r"standard deviation of x: .*1e-160"):
        Sources(groups=(normal("x", deviation),)).covariance()

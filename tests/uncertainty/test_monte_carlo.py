import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtri

from tests.uncertainty.builders import of_class, plain_random
from tradestudy.errors import OutOfRangeError, UnaffordableError
from tradestudy.uncertainty import evaluation
from tradestudy.uncertainty.distributions import Normal, Uniform
from tradestudy.uncertainty.evaluation import Outcome, alignment_with
from tradestudy.uncertainty.joint import JointNormal
from tradestudy.uncertainty.outputs import PROBABILITIES
from tradestudy.uncertainty.propagation import Sampling, propagate
from tradestudy.uncertainty.sources import CALIBRATION, NOISE, ErrorClass, Source, Sources
from tradestudy.uncertainty.streams import point_generator, scrambled_sobol

ALL = Sampling(absolute_tolerance=0.0, relative_tolerance=0.0, budget_draws=2**14)


def normal(name, deviation, error_class=ErrorClass.RIG, mean=0.0):
    return Source(name=name, distribution=Normal(mean=mean, standard_deviation=deviation), error_class=error_class)


def independent(**deviations):
    return Sources(groups=tuple(normal(name, deviation) for name, deviation in deviations.items()))


def run(model, sources, sampling=ALL, *, seed=0, point="point", inverse_depth=False):
    return propagate(model, sources, sampling, seed=seed, point=point, inverse_depth=inverse_depth)


DISTANCES = np.array([0.5, 1.0, 3.0])
STEREO = independent(yaw=3.5e-3, baseline=1e-4, left=1e-6, right=1e-6)


def stereo(v):
    """Inverse depth of a parallel rig, f = 30.5 mm, B = 0.1 m."""
    disparity = 0.0305 * 0.1 / DISTANCES + 0.0305 * np.tan(v["yaw"]) + v["left"] - v["right"]
    return Outcome(values=disparity / (0.0305 * (0.1 + v["baseline"])))


def assert_identical(first, second):
    for name in ("quantiles", "quantiles_error", "half_width", "mean", "standard_deviation", "failed"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name), err_msg=name)


def test_results_do_not_depend_on_batches_bit_for_bit():
    correlated = JointNormal(
        name="rig",
        parameters=("left", "right"),
        mean=np.zeros(2),
        covariance=np.array([[1.0, 0.9], [0.9, 1.0]]) * 1e-12,
        error_class=ErrorClass.RIG,
    )
    sources = Sources(groups=(*STEREO.groups[:2], correlated))
    reference = run(stereo, sources, ALL, inverse_depth=True)
    for batch in (1, 8, 2**9, 2**20):
        small = replace(ALL, budget_draws=2**12) if batch == 1 else ALL
        other = run(stereo, sources, replace(small, batch_draws=batch), inverse_depth=True)
        expected = run(stereo, sources, small, inverse_depth=True) if batch == 1 else reference
        assert_identical(other, expected)


def test_seed_zero_is_a_seed_and_every_seed_and_point_has_its_own_stream():
    results = [
        run(stereo, STEREO, seed=seed, point=point, inverse_depth=True).quantiles
        for seed, point in ((0, "a"), (1, "a"), (0, "b"))
    ]
    assert not np.array_equal(results[0], results[1])
    assert not np.array_equal(results[0], results[2])
    np.testing.assert_array_equal(results[0], run(stereo, STEREO, seed=0, point="a", inverse_depth=True).quantiles)


def test_a_stream_does_not_confuse_seed_replicate_and_point():
    firsts = {
        point_generator(seed=seed, point=point, replicate=replicate).random()
        for seed in (0, 1, 11)
        for replicate in (0, 1, 11)
        for point in ("", "1", "11")
    }
    assert len(firsts) == 27
    with pytest.raises(OutOfRangeError, match="zero is a valid seed"):
        point_generator(seed=-1, point="", replicate=0)


def test_sobol_points_never_reach_zero_or_one_and_are_balanced():
    balanced = scrambled_sobol(3, np.random.default_rng(0))(2**12)
    assert balanced.shape == (3, 2**12)
    assert balanced.min() > 0.0
    assert balanced.max() < 1.0
    for row in balanced:
        np.testing.assert_array_equal(np.histogram(row, bins=2**12, range=(0.0, 1.0))[0], 1)


def test_alignment_is_a_rotation_that_puts_each_response_first():
    sources = independent(a=1.0, b=2.0, c=0.5, d=1.0, e=3.0)
    weights = np.array([[1.0, -1.0, 0.0, 2.0, 0.3], [0.0, 0.5, 1.0, 2.0, 0.3]])

    def model(v):
        return Outcome(values=np.concatenate(list(v.values()), axis=1) @ weights.T)

    rotation = alignment_with([model], sources).apply(np.eye(5))
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(5), atol=1e-14)
    responses = (weights * [1.0, 2.0, 0.5, 1.0, 3.0]) @ rotation
    assert np.all(np.abs(responses[:, :2]).max(axis=1) > 1.0)
    np.testing.assert_allclose(responses[:, 2:], 0.0, atol=1e-12)


def test_alignment_changes_as_little_as_the_design_does():
    sources = independent(a=1.0, b=2.0, c=0.5, d=1.0, e=3.0)
    rng = np.random.default_rng(8)
    for _ in range(200):
        weights, step = rng.standard_normal((2, 3, 5))
        # A parameter without effect leaves a component of rounding, of either sign.
        weights[:, 0] = 1e-17 * rng.standard_normal(3)

        before, after = (
            alignment_with(
                [lambda v, w=w: Outcome(values=np.concatenate(list(v.values()), axis=1) @ w.T)], sources
            ).apply(np.eye(5))
            for w in (weights, weights + 1e-9 * step)
        )
        np.testing.assert_allclose(after, before, atol=1e-5)


def test_alignment_leaves_out_what_is_not_finite():
    sources = independent(a=1.0, b=2.0)

    def model(v):
        return Outcome(values=np.concatenate([np.where(v["a"] < 2.0, np.inf, 0.0), v["a"] + v["b"]], axis=1))

    rotation = alignment_with([model], sources).apply(np.eye(2))
    np.testing.assert_allclose(np.abs(rotation[:, 0]), np.array([1.0, 2.0]) / np.sqrt(5.0), atol=1e-14)
    assert alignment_with([lambda v: Outcome(values=v["a"] + np.inf)], sources).reflectors.size == 0


def test_linear_stereo_lies_within_three_standard_errors_of_its_closed_form():
    """Normal yaw and two normal pixel errors: inverse depth is exactly normal."""
    sources = independent(yaw=3.5e-3, left=2e-6, right=2e-6)

    def model(v):
        return Outcome(values=1.0 / DISTANCES + (v["yaw"] + (v["left"] - v["right"]) / 0.0305) / 0.1)

    mine = run(model, sources, replace(ALL, budget_draws=2**17), inverse_depth=True)
    spread = np.hypot(3.5e-3, np.sqrt(2.0) * 2e-6 / 0.0305) / 0.1
    exact = 1.0 / (1.0 / DISTANCES + spread * ndtri(1.0 - np.array(PROBABILITIES))[:, None])
    assert np.all(np.abs(mine.quantiles - exact) <= 3.0 * mine.quantiles_error + 1e-9)
    assert np.all(mine.quantiles_error < 1e-4 * exact)
    assert np.all(mine.status == "budget")
    assert np.all(np.isfinite(mine.standard_deviation))


def test_sobol_points_need_at_least_eight_times_fewer_evaluations(monkeypatch):
    """Root-mean-square error of the 95 % ends over both, against the closed form of a four-term rig."""
    spreads = {"yaw": 3e-3, "left": 1e-4, "right": 1e-4, "drift": 2e-3}
    sources = independent(**spreads)

    def model(v):
        return Outcome(values=1.0 + (v["yaw"] + v["left"] - v["right"] + v["drift"]) / 0.1)

    total = np.sqrt(sum(spread**2 for spread in spreads.values())) / 0.1
    exact = 1.0 / (1.0 + total * ndtri(1.0 - np.array([0.025, 0.975])))

    def error(draws):
        sampling = replace(ALL, replicates=32, budget_draws=32 * draws, first_draws=draws)
        one = run(model, sources, sampling, inverse_depth=True)
        # Error of a single replicate: the standard error of the mean of 32, scaled back, and its bias.
        scatter = np.sqrt(32.0) * one.quantiles_error[[0, 4], 0]
        return np.sqrt(np.mean(scatter**2 + (one.quantiles[[0, 4], 0] - exact) ** 2))

    of_sobol_points = error(2**10)
    monkeypatch.setattr(evaluation, "scrambled_sobol", plain_random)
    assert of_sobol_points < error(2**13)


def test_the_rule_stops_when_converged_and_the_stated_error_holds():
    tolerance = 1e-3
    sampling = Sampling(absolute_tolerance=tolerance, relative_tolerance=0.0, budget_draws=2**20)
    stops = []
    exact = 1.0 / (0.5 + 0.0349 * ndtri(1.0 - np.array(PROBABILITIES)))
    sources = independent(yaw=3.49e-3)
    for seed in range(20):
        mine = run(lambda v: Outcome(values=0.5 + v["yaw"] / 0.1), sources, sampling, seed=seed, inverse_depth=True)
        assert mine.status[0] == "converged"
        assert mine.draws < 2**17
        stops.append(np.max(np.abs(mine.quantiles[:, 0] - exact)))
    assert np.mean(np.array(stops) <= tolerance) >= 0.9


def test_an_unreachable_tolerance_ends_at_the_budget_and_says_so():
    sampling = Sampling(absolute_tolerance=1e-12, relative_tolerance=0.0, budget_draws=2**13)
    mine = run(stereo, STEREO, sampling, inverse_depth=True)
    assert mine.draws == 2**13
    assert list(mine.status) == ["budget"] * 3


def test_a_relative_tolerance_is_relative_to_each_quantile():
    sampling = Sampling(absolute_tolerance=0.0, relative_tolerance=1e-3, budget_draws=2**18)
    mine = run(stereo, STEREO, sampling, inverse_depth=True)
    assert np.all(mine.status == "converged")
    assert np.all(2.365 * mine.quantiles_error <= 1.0001e-3 * mine.quantiles)


BOUNDED = replace(ALL, memory_bytes=2**21, batch_draws=2**10)


def test_memory_is_bounded_whatever_the_budget_and_quantiles_stay_exact():
    run(stereo, STEREO, inverse_depth=True)  # imports are not counted
    peaks = []
    for budget in (2**15, 2**18):
        tracemalloc.start()
        mine = run(stereo, STEREO, replace(BOUNDED, budget_draws=budget), inverse_depth=True)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert mine.draws == budget
    assert mine.replicates == 128
    assert peaks[1] <= 1.1 * peaks[0]
    assert peaks[1] <= BOUNDED.memory_bytes
    roomy = run(stereo, STEREO, replace(ALL, budget_draws=2**18), inverse_depth=True)
    assert roomy.replicates == 8
    allowed = 5.0 * np.hypot(mine.quantiles_error, roomy.quantiles_error)
    assert np.all(np.abs(mine.quantiles - roomy.quantiles) <= allowed)


def test_memory_that_keeps_replicates_too_short_for_the_budget_is_named():
    mine = run(stereo, STEREO, replace(BOUNDED, memory_bytes=2**20, budget_draws=2**20), inverse_depth=True)
    assert list(mine.status) == ["memory"] * 3
    assert mine.replicates == 64
    assert mine.draws == 2**16


def test_evaluations_beyond_the_memory_are_refused_before_they_start():
    with pytest.raises(UnaffordableError, match=r"3 outputs.*1024 bytes.*memory_bytes"):
        run(stereo, STEREO, replace(ALL, memory_bytes=1024), inverse_depth=True)


UNIT = Sources(groups=(Source(name="u", distribution=Uniform(low=0.0, high=1.0), error_class=ErrorClass.RIG),))


def test_noise_calibration_and_both_are_kept_apart():
    sources = Sources(
        groups=(
            normal("yaw", 3e-3),
            normal("temperature", 2e-3, ErrorClass.SESSION),
            normal("pattern", 1e-3, ErrorClass.ELEMENT),
            normal("pixel", 4e-3, ErrorClass.MEASUREMENT),
        )
    )
    for classes, variance in ((NOISE, 16.0), (CALIBRATION, 14.0), ((*NOISE, *CALIBRATION), 30.0)):
        part = run(lambda v: Outcome(values=sum(v.values())), of_class(sources, classes))
        assert part.half_width[0] == pytest.approx(np.sqrt(variance) * 1e-3, rel=5e-3)


def test_a_part_without_sources_is_a_point_without_error():
    noise = run(stereo, of_class(STEREO, NOISE), inverse_depth=True)
    np.testing.assert_array_equal(noise.half_width, 0.0)
    np.testing.assert_allclose(noise.quantiles[2], DISTANCES, rtol=1e-12)
    assert np.all(noise.status == "converged")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"first_draws": 100}, "power of two"),
        ({"batch_draws": 3}, "power of two"),
        ({"replicates": 4}, ">= 8"),
        ({"budget_draws": 100}, "raise the budget"),
        ({"absolute_tolerance": -1.0}, ">= 0"),
        ({"relative_tolerance": np.nan}, ">= 0"),
    ],
)
def test_impossible_sampling_is_refused(change, message):
    with pytest.raises(OutOfRangeError, match=message):
        replace(ALL, **change)


def test_a_model_of_the_wrong_shape_is_refused():
    with pytest.raises(OutOfRangeError, match=r"wrong shape: \(1,\)"):
        run(lambda v: Outcome(values=v["u"][:, 0]), UNIT)

import numpy as np
import pytest
from scipy.special import ndtri

from tests.uncertainty.builders import of_class, plain_random
from tradestudy.errors import OutOfRangeError
from tradestudy.uncertainty import evaluation
from tradestudy.uncertainty.distributions import Normal, Uniform
from tradestudy.uncertainty.evaluation import Replicate, alignment_with, depth_from_inverse
from tradestudy.uncertainty.joint import JointNormal
from tradestudy.uncertainty.outputs import order_quantile
from tradestudy.uncertainty.sources import CALIBRATION, NOISE, ErrorClass, Source, Sources
from tradestudy.uncertainty.streams import point_generator, scrambled_sobol

UNIT = Sources(groups=(Source(name="u", distribution=Uniform(low=0.0, high=1.0), error_class=ErrorClass.RIG),))


def normal(name, deviation, error_class=ErrorClass.RIG, mean=0.0):
    return Source(name=name, distribution=Normal(mean=mean, standard_deviation=deviation), error_class=error_class)


def independent(**deviations):
    return Sources(groups=tuple(normal(name, deviation) for name, deviation in deviations.items()))


def drawn(model, sources, lengths=(2**11,), *, batch=2**14, seed=0, point="point", replicate=0, inverse_depth=False):
    """Outputs (outputs, draws) of one replicate, extended from one length to the next."""
    one = Replicate(
        model,
        sources,
        seed=seed,
        point=point,
        replicate=replicate,
        alignment=alignment_with([model], sources),
        inverse_depth=inverse_depth,
    )
    for length in lengths:
        one.lengthen(length, batch)
    assert one.draws == lengths[-1]
    return one.values


DISTANCES = np.array([0.5, 1.0, 3.0])
STEREO = independent(yaw=3.5e-3, baseline=1e-4, left=1e-6, right=1e-6)


def stereo(v):
    """Inverse depth of a parallel rig, f = 30.5 mm, B = 0.1 m."""
    disparity = 0.0305 * 0.1 / DISTANCES + 0.0305 * np.tan(v["yaw"]) + v["left"] - v["right"]
    return disparity / (0.0305 * (0.1 + v["baseline"]))


def test_draws_do_not_depend_on_batches_or_earlier_lengths_bit_for_bit():
    correlated = JointNormal(
        name="rig",
        parameters=("left", "right"),
        mean=np.zeros(2),
        covariance=np.array([[1.0, 0.9], [0.9, 1.0]]) * 1e-12,
        error_class=ErrorClass.RIG,
    )
    sources = Sources(groups=(*STEREO.groups[:2], correlated))
    reference = drawn(stereo, sources, inverse_depth=True)
    assert reference.shape == (3, 2**11)
    for batch, lengths in ((1, (2**9,)), (8, (2**11,)), (2**9, (2**9, 2**10, 2**11)), (2**20, (2**10, 2**11))):
        other = drawn(stereo, sources, lengths, batch=batch, inverse_depth=True)
        np.testing.assert_array_equal(other, reference[:, : lengths[-1]])


def test_seed_zero_is_a_seed_and_every_seed_point_and_replicate_has_its_own_stream():
    first, *others = (
        drawn(stereo, STEREO, (64,), seed=seed, point=point, replicate=replicate)
        for seed, point, replicate in ((0, "a", 0), (1, "a", 0), (0, "b", 0), (0, "a", 1))
    )
    assert all(np.all(other != first) for other in others)
    np.testing.assert_array_equal(first, drawn(stereo, STEREO, (64,), seed=0, point="a"))


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
        return np.concatenate(list(v.values()), axis=1) @ weights.T

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
            alignment_with([lambda v, w=w: np.concatenate(list(v.values()), axis=1) @ w.T], sources).apply(np.eye(5))
            for w in (weights, weights + 1e-9 * step)
        )
        np.testing.assert_allclose(after, before, atol=1e-5)


def test_alignment_leaves_out_what_is_not_finite():
    sources = independent(a=1.0, b=2.0)

    def model(v):
        return np.concatenate([np.where(v["a"] < 2.0, np.inf, 0.0), v["a"] + v["b"]], axis=1)

    rotation = alignment_with([model], sources).apply(np.eye(2))
    np.testing.assert_allclose(np.abs(rotation[:, 0]), np.array([1.0, 2.0]) / np.sqrt(5.0), atol=1e-14)
    assert alignment_with([lambda v: v["a"] + np.inf], sources).reflectors.size == 0


def test_sobol_points_need_at_least_eight_times_fewer_evaluations(monkeypatch):
    """Root-mean-square error of the 95 % ends over both, against the closed form of a four-term rig."""
    spreads = {"yaw": 3e-3, "left": 1e-4, "right": 1e-4, "drift": 2e-3}
    sources, probabilities = independent(**spreads), np.array([0.025, 0.975])

    def model(v):
        return 1.0 + (v["yaw"] + v["left"] - v["right"] + v["drift"]) / 0.1

    total = np.sqrt(sum(spread**2 for spread in spreads.values())) / 0.1
    exact = 1.0 / (1.0 + total * ndtri(1.0 - probabilities))

    def error(draws):
        replicates = (drawn(model, sources, (draws,), replicate=number, inverse_depth=True) for number in range(32))
        ends = [order_quantile(np.sort(values), probabilities)[:, 0] for values in replicates]
        return np.sqrt(np.mean(np.square(ends - exact)))

    of_sobol_points = error(2**10)
    monkeypatch.setattr(evaluation, "scrambled_sobol", plain_random)
    assert of_sobol_points < error(2**13)


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
        part = drawn(lambda v: sum(v.values()), of_class(sources, classes), (2**14,))
        assert np.std(part) == pytest.approx(np.sqrt(variance) * 1e-3, rel=2e-3)


def test_a_part_without_sources_is_a_point_without_error():
    noise = drawn(stereo, of_class(STEREO, NOISE), inverse_depth=True)
    np.testing.assert_array_equal(np.ptp(noise, axis=1), 0.0)
    np.testing.assert_allclose(noise[:, 0], DISTANCES, rtol=1e-12)


def test_minus_infinity_and_infinite_inverse_depth_have_no_rank():
    def lost(u, value):
        return np.where(u < 0.25, value, u)

    for value, depth in ((np.nan, False), (-np.inf, False), (np.nan, True), (-np.inf, True), (np.inf, True)):
        outputs = drawn(lambda v, value=value: lost(v["u"], value), UNIT, inverse_depth=depth)
        assert np.isnan(outputs).mean() == pytest.approx(0.25, abs=1e-3)
        assert np.isfinite(outputs).mean() == pytest.approx(0.75, abs=1e-3)
    last = drawn(lambda v: lost(v["u"], np.inf), UNIT)
    assert (last == np.inf).mean() == pytest.approx(0.25, abs=1e-3)


def test_a_model_of_the_wrong_shape_is_refused():
    with pytest.raises(OutOfRangeError, match=r"wrong shape: \(2048,\)"):
        drawn(lambda v: v["u"][:, 0], UNIT)


def test_depth_from_inverse_depth_has_its_limits():
    depth = depth_from_inverse(np.array([2.0, 0.0, -1.0, np.nan, 5e-324]))
    np.testing.assert_array_equal(depth, [0.5, np.inf, np.inf, np.nan, np.inf])

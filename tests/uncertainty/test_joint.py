import numpy as np
import pytest
from scipy import stats
from scipy.special import ndtri

from tests.uncertainty.builders import correlated_normal, of_class
from tradestudy.errors import OutOfRangeError
from tradestudy.uncertainty.distributions import Normal, StudentT, Triangular, Uniform
from tradestudy.uncertainty.joint import GaussianCopula, JointDraws, JointNormal
from tradestudy.uncertainty.sources import CALIBRATION, NOISE, ErrorClass, Source, Sources
from tradestudy.uncertainty.streams import point_generator, scrambled_sobol

RIG = ErrorClass.RIG


def scores(group, n, seed=1):
    return ndtri(scrambled_sobol(group.dimensions, point_generator(seed=seed, point="joint", replicate=0))(n))


def joint(covariance, mean=None):
    covariance = np.asarray(covariance, float)
    names = tuple("abcdef"[: covariance.shape[0]])
    mean = np.zeros(covariance.shape[0]) if mean is None else np.asarray(mean, float)
    return JointNormal(name="rig", parameters=names, mean=mean, covariance=covariance, error_class=RIG)


def test_draws_have_the_declared_covariance_across_scales():
    spread = np.array([1e-6, 3.0, 2e-3])
    correlation = np.array([[1.0, 0.6, -0.3], [0.6, 1.0, 0.2], [-0.3, 0.2, 1.0]])
    group = joint(correlation * np.outer(spread, spread), mean=[1.0, -2.0, 0.5])
    drawn = group.draw(scores(group, 2**14))
    np.testing.assert_allclose(np.corrcoef(drawn), correlation, atol=2e-3)
    np.testing.assert_allclose(np.std(drawn, axis=1), spread, rtol=2e-3)
    np.testing.assert_allclose(np.mean(drawn, axis=1), [1.0, -2.0, 0.5], atol=2e-3 * spread.max())


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_correlation_of_one_is_exact_and_takes_a_single_coordinate(sign):
    group = correlated_normal(
        name="rig",
        parameters=("mla_distance", "focal_length"),
        mean=np.zeros(2),
        standard_deviation=np.array([2e-6, 1e-6]),
        correlation=np.array([[1.0, sign], [sign, 1.0]]),
        error_class=RIG,
    )
    assert group.dimensions == 1
    distance, focal_length = group.draw(scores(group, 256))
    np.testing.assert_allclose(distance, sign * 2.0 * focal_length, rtol=1e-14)


def test_a_covariance_singular_to_rounding_is_accepted_and_its_dependence_is_exact():
    jacobian = np.array([[1.0, 0.3], [0.2, -1.0], [1.2, -0.7]])  # the third row is the sum of the others
    group = joint(jacobian @ jacobian.T)
    assert group.dimensions == 2
    first, second, third = group.draw(scores(group, 512))
    np.testing.assert_allclose(third, first + second, atol=1e-13)


def test_a_weak_direction_is_kept():
    gap = 1e-12
    group = joint([[1.0, 1.0 - gap], [1.0 - gap, 1.0]])
    assert group.dimensions == 2
    first, second = group.draw(scores(group, 2**12))
    assert np.std(first - second) == pytest.approx(np.sqrt(2.0 * gap), rel=0.01)


def test_a_constant_takes_no_coordinate():
    group = joint([[4.0, 0.0], [0.0, 0.0]], mean=[0.0, 7.0])
    assert group.dimensions == 1
    np.testing.assert_array_equal(group.draw(scores(group, 64))[1], 7.0)


def test_an_invalid_covariance_is_refused_with_its_eigenvalue_and_a_remedy():
    with pytest.raises(OutOfRangeError, match=r"positive semidefinite.*-4\.000e-01.*joint draws"):
        joint([[1.0, 0.7, -0.7], [0.7, 1.0, 0.7], [-0.7, 0.7, 1.0]])


@pytest.mark.parametrize(
    ("covariance", "message"),
    [
        ([[1.0, 0.5], [0.4, 1.0]], "not symmetric"),
        ([[1.0, np.nan], [np.nan, 1.0]], "2 entries not finite"),
        ([[-1.0, 0.0], [0.0, 1.0]], "variances >= 0"),
        ([[0.0, 0.1], [0.1, 1.0]], "no covariance with a constant"),
        ([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], "2 x 2 finite numbers"),
    ],
)
def test_impossible_covariances_are_refused(covariance, message):
    with pytest.raises(OutOfRangeError, match=message):
        joint(covariance)


def test_correlations_beyond_one_are_refused():
    with pytest.raises(OutOfRangeError, match="ones on the diagonal"):
        GaussianCopula(
            name="rig",
            parameters=("a", "b"),
            marginals=(Uniform(low=0.0, high=1.0),) * 2,
            correlation=np.array([[1.0, 1.2], [1.2, 1.0]]),
            error_class=RIG,
        )


def test_copula_keeps_marginals_and_ties_ranks():
    rho = -0.8
    group = GaussianCopula(
        name="rig",
        parameters=("bound", "peak"),
        marginals=(Uniform(low=-1.0, high=3.0), Triangular(low=0.0, mode=0.2, high=1.0)),
        correlation=np.array([[1.0, rho], [rho, 1.0]]),
        error_class=RIG,
    )
    drawn = group.draw(scores(group, 2**14))
    for row, marginal in zip(drawn, group.marginals, strict=True):
        for p in (0.01, 0.3, 0.8, 0.99):
            assert np.mean(row <= marginal.quantile(p)) == pytest.approx(p, abs=1.5e-3)
    rank_correlation = stats.spearmanr(drawn[0], drawn[1]).statistic
    assert rank_correlation == pytest.approx(6.0 / np.pi * np.arcsin(rho / 2.0), abs=2e-3)
    np.testing.assert_allclose(group.covariance, np.cov(drawn), atol=2e-3)


@pytest.mark.parametrize("rho", [-1.0, -0.3, 0.5, 0.999, 1.0])
def test_copula_of_uniforms_has_the_closed_form_covariance(rho):
    group = GaussianCopula(
        name="rig",
        parameters=("a", "b"),
        marginals=(Uniform(low=0.0, high=1.0), Uniform(low=-5.0, high=1.0)),
        correlation=np.array([[1.0, rho], [rho, 1.0]]),
        error_class=RIG,
    )
    # Pearson (1907): the correlation of two probability integrals is (6/π) asin(ρ/2).
    assert group.covariance[0, 1] == pytest.approx(6.0 * np.arcsin(rho / 2.0) / (2.0 * np.pi), rel=1e-12)
    np.testing.assert_allclose(np.diag(group.covariance), [1.0 / 12.0, 3.0], rtol=1e-12)


def test_copula_of_tied_marginals_has_a_covariance_that_can_be_drawn_from():
    group = GaussianCopula(
        name="rig",
        parameters=("a", "b", "c", "d"),
        marginals=(
            Triangular(low=0.0, mode=0.2, high=1.0),
            Triangular(low=0.0, mode=0.4, high=2.0),
            Uniform(low=-1.0, high=1.0),
            Uniform(low=2.0, high=2.0),
        ),
        correlation=np.ones((4, 4)),
        error_class=RIG,
    )
    covariance = group.covariance
    np.testing.assert_array_equal(covariance[3], 0.0)
    assert covariance[0, 1] == pytest.approx(np.sqrt(covariance[0, 0] * covariance[1, 1]), rel=1e-12)
    # Means of products of quantile functions over evenly spaced probabilities.
    p = (np.arange(200_000) + 0.5) / 200_000
    np.testing.assert_allclose(covariance, np.cov([m.quantile(p) for m in group.marginals]), atol=2e-5)
    assert (
        JointNormal(
            name="rig", parameters=group.parameters, mean=np.zeros(4), covariance=covariance, error_class=RIG
        ).dimensions
        == 2
    )


def test_copula_of_normals_has_the_covariance_of_the_joint_normal():
    deviation, rho = np.array([2.0, 0.5]), -0.6
    tied = GaussianCopula(
        name="tied",
        parameters=("a", "b"),
        marginals=tuple(Normal(mean=1.0, standard_deviation=d) for d in deviation),
        correlation=np.array([[1.0, rho], [rho, 1.0]]),
        error_class=ErrorClass.RIG,
    )
    np.testing.assert_allclose(tied.covariance, [[4.0, rho], [rho, 0.25]], rtol=1e-12)


def test_a_copula_without_variance_is_refused():
    group = GaussianCopula(
        name="rig",
        parameters=("a", "b"),
        marginals=(StudentT(location=0.0, scale=1.0, degrees_of_freedom=2.0), Normal(mean=0, standard_deviation=1)),
        correlation=np.eye(2),
        error_class=RIG,
    )
    assert group.covariance is None


def test_posterior_rows_stay_whole_and_are_taken_equally_often():
    rng = np.random.default_rng(3)
    rows = rng.normal(size=(64, 3)) @ rng.normal(size=(3, 3))
    group = JointDraws(name="posterior", parameters=("a", "b", "c"), draws=rows, error_class=RIG)
    drawn = group.draw(scores(group, 256)).T
    index = np.array([np.flatnonzero(np.all(rows == row, axis=1))[0] for row in drawn])
    np.testing.assert_array_equal(np.bincount(index, minlength=64), 4)
    np.testing.assert_allclose(group.covariance, np.cov(rows.T, bias=True))


def test_posterior_rows_that_are_not_finite_are_refused():
    with pytest.raises(OutOfRangeError, match="1 rows not finite"):
        JointDraws(name="p", parameters=("a",), draws=np.array([[1.0], [np.inf], [2.0]]), error_class=RIG)


def classed(name, error_class):
    return Source(name=name, distribution=Normal(mean=1.0, standard_deviation=0.1), error_class=error_class)


def test_sources_are_drawn_by_class_and_the_others_stay_nominal():
    sources = Sources(groups=tuple(classed(kind.name, kind) for kind in ErrorClass))
    noise = of_class(sources, NOISE)
    assert noise.dimensions == 1
    draws = noise.draw(ndtri(np.random.default_rng(0).random((1, 16))))
    assert np.ptp(draws["MEASUREMENT"]) > 0.0
    for name in ("RIG", "SESSION", "ELEMENT"):
        np.testing.assert_array_equal(draws[name], 1.0)
    assert [group.name for group in of_class(sources, CALIBRATION).active_groups] == ["RIG", "SESSION", "ELEMENT"]
    np.testing.assert_allclose(np.diag(noise.covariance()), [0.0, 0.0, 0.0, 0.01])


def test_names_must_be_unique_and_known():
    with pytest.raises(OutOfRangeError, match="more than once: yaw"):
        Sources(groups=(classed("yaw", RIG), classed("yaw", RIG)))
    with pytest.raises(OutOfRangeError, match=r"no group.*: roll \(allowed: yaw\)"):
        Sources(groups=(classed("yaw", RIG),)).only(["roll"])

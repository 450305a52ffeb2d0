"""Synthetic calibrations against closed forms and dense algebra, and what must be refused."""

import numpy as np
import pytest

from tests.calibration.radial_rig import SHARED_NAMES
from tests.calibration.random_poses import tilted_poses
from tests.calibration.rig_draws import depth_of_draws
from tests.calibration.trials import normal_priors
from tradestudy.calibration.camera_target import (
    TargetProblem,
    exact_log_posterior,
    fit_target,
    sample_target,
)
from tradestudy.calibration.corners.real_rig import observe_pair
from tradestudy.calibration.projection import move
from tradestudy.calibration.synthetic_target import (
    Priors,
    SyntheticTarget,
    faces,
    flat_grid,
    observe_target,
)
from tradestudy.errors import NotConvergedError, OutOfRangeError

PLENOPTIC_NAMES = ("mla_distance", "focal_length", "microlens_gap")
PLENOPTIC = np.array([14.773e-3, 12.5e-3, 0.568e-3])
PITCH, PIXEL = 126.5e-6, 5.5e-6


def plenoptic(parameters, points):
    """Disparity of adjacent microlenses and image of the centre, from the thin lens; shape (..., N, 3) [px]."""
    z, f, gap = (parameters[..., k, None] for k in range(3))
    a = points[..., 2]
    b = f * a / (a - f)
    disparity = PITCH * gap / (z - b) / PIXEL
    lateral = -points[..., :2] * (z / a)[..., None] / PIXEL
    return np.concatenate([disparity[..., None], lateral], axis=-1)


def plenoptic_problem(rng, *, deviations, views=12, lateral_noise=0.1):
    target = SyntheticTarget(
        points=flat_grid(4, 3, 0.01),
        poses=tilted_poses(views, (0.15, 0.5), 0.1, 0.2, rng),
        noise=np.array([0.1, lateral_noise, lateral_noise]),
        rotation_deviation=deviations[0],
        translation_deviation=deviations[1],
    )
    priors = normal_priors(PLENOPTIC_NAMES, PLENOPTIC, np.array([20e-6, 20e-6, 20e-6]))
    truth = priors.draw(rng, 1)[0]
    observed = observe_target(target, plenoptic, truth, rng)
    return truth, TargetProblem(observed=observed, target=target, model=plenoptic, priors=priors)


def stereo_problem(rng, views=10):
    centre = np.array([3050.0, 3050, 0, 0, 0, 0] * 2 + [0, 0, 0, -0.1, 0, 0])
    deviation = np.array([30.0, 30, 10, 10, 0.05, 0.2] * 2 + [np.radians(0.2)] * 3 + [1e-3] * 3)
    priors = normal_priors(SHARED_NAMES, centre, deviation)
    target = SyntheticTarget(
        points=flat_grid(5, 4, 0.04), poses=tilted_poses(views, (0.8, 2.5), 0.05, 0.3, rng), noise=np.full(4, 0.1)
    )
    truth = priors.draw(rng, 1)[0]
    observed = observe_target(target, observe_pair, truth, rng)
    return truth, TargetProblem(observed=observed, target=target, model=observe_pair, priors=priors)


def dense_covariance(problem, fit):
    """Inverse of the full Hessian of parameters and poses, by plain differences of the whitened residuals."""
    target, priors = problem.target, problem.priors
    count, views = len(priors.names), len(target.poses)

    def whitened(vector):
        poses = vector[count:].reshape(views, 6)
        seen = (problem.model(vector[:count], move(poses, target.points)) - problem.observed) / target.noise
        pose_prior = (poses - target.poses) * np.sqrt(target.pose_precision)
        prior = (vector[:count] - priors.mean) / priors.standard_deviation
        return np.concatenate([seen.ravel(), pose_prior.ravel(), prior])

    centre = np.concatenate([fit.laplace.mean, fit.poses.ravel()])
    steps = np.concatenate([1e-2 * fit.laplace.standard_deviation, np.full(6 * views, 1e-6)])
    jacobian = np.column_stack([(whitened(centre + s) - whitened(centre - s)) / 2 for s in np.diag(steps)])
    inverse = np.linalg.pinv(jacobian, rcond=1e-14)
    return ((inverse @ inverse.T) * np.outer(steps, steps))[:count, :count], whitened(centre), jacobian


@pytest.mark.parametrize("deviations", [(np.inf, np.inf), (1e-4, 2e-5)])
def test_plenoptic_covariance_equals_the_dense_inverse(deviations):
    _, problem = plenoptic_problem(np.random.default_rng(0), deviations=deviations)
    fit = fit_target(problem)
    covariance, residuals, jacobian = dense_covariance(problem, fit)
    scale = fit.laplace.standard_deviation
    np.testing.assert_allclose(
        fit.laplace.covariance / np.outer(scale, scale), covariance / np.outer(scale, scale), atol=1e-4
    )
    # at the peak the gradient of parameters and poses vanishes: a Newton step is no step
    step = np.linalg.lstsq(jacobian, residuals, rcond=1e-14)[0]
    assert np.linalg.norm(jacobian @ step) < 2e-3


def test_stereo_covariance_equals_the_dense_inverse():
    _, problem = stereo_problem(np.random.default_rng(1))
    fit = fit_target(problem)
    covariance, _, _ = dense_covariance(problem, fit)
    scale = fit.laplace.standard_deviation
    np.testing.assert_allclose(
        fit.laplace.covariance / np.outer(scale, scale), covariance / np.outer(scale, scale), atol=1e-4
    )
    correlation = fit.laplace.correlation
    yaw, right_centre = SHARED_NAMES.index("relative_rotation_y"), SHARED_NAMES.index("right_principal_point_x_px")
    assert abs(correlation[yaw, right_centre]) > 0.7


def test_array_distance_and_focal_length_err_together():
    """∂a/∂z = −((a − f)/f)², ∂a/∂f = (a/f)²: of opposite sign, so joint errors of z and f cancel in depth."""
    _, problem = plenoptic_problem(np.random.default_rng(2), deviations=(1e-3, 1e-4), lateral_noise=1e3)
    fit = fit_target(problem).laplace
    assert fit.correlation[0, 1] > 0.85
    z, f, gap = fit.mean
    a = 0.3
    gain = ((a - f) / f) ** 2
    sensitivity = np.array([-gain, (a / f) ** 2, gain * (z - f * a / (a - f)) / gap])
    joint = np.sqrt(sensitivity @ fit.covariance @ sensitivity)
    apart = np.sqrt(np.sum((sensitivity * fit.standard_deviation) ** 2))
    assert apart > 4.0 * joint


def test_known_poses_and_a_linear_camera_give_the_closed_form():
    """y = θ₀ + θ₁ Z with normal prior and noise: the conjugate posterior, in numbers of the textbook."""

    def line(parameters, points):
        return parameters[..., 0, None, None] + parameters[..., 1, None, None] * points[..., 2:]

    rng = np.random.default_rng(3)
    poses = np.zeros((6, 6))
    poses[:, 5] = np.linspace(1.0, 2.0, 6)
    target = SyntheticTarget(
        points=np.zeros((1, 3)), poses=poses, noise=np.array([0.3]), rotation_deviation=1e-9, translation_deviation=1e-9
    )
    priors = normal_priors(("offset", "slope"), np.array([0.0, 1.0]), np.array([1.0, 0.5]))
    observed = observe_target(target, line, np.array([0.4, 1.3]), rng)
    fit = fit_target(TargetProblem(observed=observed, target=target, model=line, priors=priors)).laplace
    design = np.column_stack([np.ones(6), poses[:, 5]])
    precision = design.T @ design / 0.09 + np.diag([1.0, 4.0])
    mean = np.linalg.solve(precision, design.T @ observed.ravel() / 0.09 + np.array([0.0, 4.0]))
    np.testing.assert_allclose(fit.covariance, np.linalg.inv(precision), rtol=1e-6)
    np.testing.assert_allclose(fit.mean, mean, rtol=1e-6)


def test_unseen_points_do_not_count():
    _, problem = stereo_problem(np.random.default_rng(4), views=8)
    blind = problem.observed.copy()
    blind[:, ::3] = np.nan
    kept = [k for k in range(20) if k % 3]
    fewer = SyntheticTarget(points=problem.target.points[kept], poses=problem.target.poses, noise=problem.target.noise)
    with_gaps = fit_target(
        TargetProblem(observed=blind, target=problem.target, model=observe_pair, priors=problem.priors)
    )
    without = fit_target(
        TargetProblem(observed=problem.observed[:, kept], target=fewer, model=observe_pair, priors=problem.priors)
    )
    deviation = without.laplace.standard_deviation
    np.testing.assert_allclose((with_gaps.laplace.mean - without.laplace.mean) / deviation, 0.0, atol=1e-5)
    np.testing.assert_allclose(with_gaps.laplace.correlation, without.laplace.correlation, atol=1e-6)
    np.testing.assert_allclose(with_gaps.laplace.standard_deviation, deviation, rtol=1e-6)


def test_emcee_equals_laplace_on_the_plenoptic_camera():
    truth, problem = plenoptic_problem(np.random.default_rng(5), deviations=(1e-3, 1e-4))
    fit = fit_target(problem)
    posterior = sample_target(problem, fit, rng=np.random.default_rng(0))
    assert posterior.converged, (posterior.sample.diagnostics.failures, posterior.check)
    assert posterior.check.efficiency > 0.95
    deviation = fit.laplace.standard_deviation
    draws = posterior.sample.draws
    np.testing.assert_allclose((draws.mean(axis=0) - fit.laplace.mean) / deviation, 0.0, atol=0.1)
    np.testing.assert_allclose(draws.std(axis=0) / deviation, 1.0, atol=0.07)
    np.testing.assert_allclose(np.corrcoef(draws.T), fit.laplace.correlation, atol=0.03)
    assert np.all(np.abs(truth - fit.laplace.mean) < 4.5 * deviation)


def test_bounds_of_the_prior_cut_the_posterior():
    _, problem = plenoptic_problem(np.random.default_rng(6), deviations=(1e-3, 1e-4))
    fit = fit_target(problem)
    gap = fit.laplace.mean[2] - 0.5 * fit.laplace.standard_deviation[2]
    lower = np.array([-np.inf, -np.inf, gap])
    bounded = TargetProblem(
        observed=problem.observed,
        target=problem.target,
        model=plenoptic,
        priors=Priors(
            names=PLENOPTIC_NAMES,
            mean=PLENOPTIC + np.array([0.0, 0.0, max(0.0, gap - PLENOPTIC[2] + 1e-7)]),
            standard_deviation=np.array([20e-6, 20e-6, 20e-6]),
            lower=lower,
            upper=np.full(3, np.inf),
        ),
    )
    sample = sample_target(bounded, fit_target(bounded), rng=np.random.default_rng(0), maximum_steps=300).sample
    assert sample.draws[:, 2].min() >= gap
    assert sample.draws[:, 2].min() < gap + 0.05 * fit.laplace.standard_deviation[2]


def test_exact_posterior_falls_off_as_the_laplace_fit():
    _, problem = stereo_problem(np.random.default_rng(7), views=8)
    fit = fit_target(problem)
    (vector,) = fit.laplace.draw(np.random.default_rng(0), 1)
    away, peak = exact_log_posterior(problem, fit.poses, np.stack([vector, fit.laplace.mean]))
    error = vector - fit.laplace.mean
    expected = -0.5 * error @ np.linalg.solve(fit.laplace.covariance, error)
    assert away - peak == pytest.approx(expected, rel=0.05)


def test_dropping_the_correlation_inflates_the_depth_error():
    """A calibration on sixty targets: independent errors would overstate the depth error more than tenfold at 1 m."""
    _, problem = stereo_problem(np.random.default_rng(8), views=60)
    fit = fit_target(problem).laplace
    rng = np.random.default_rng(0)
    distance = np.array([1.0])
    joint = depth_of_draws(fit.mean, fit.draw(rng, 4000), distance)
    apart = depth_of_draws(fit.mean, fit.mean + fit.standard_deviation * rng.standard_normal((4000, 18)), distance)
    assert apart.std() / joint.std() > 10.0


def test_parameters_that_nothing_determines_are_named():
    def blind(parameters, points):
        return parameters[..., :1, None] * 0.0 + parameters[..., 1, None, None] * points[..., 2:]

    poses = np.zeros((6, 6))
    poses[:, 5] = np.linspace(1.0, 2.0, 6)
    target = SyntheticTarget(
        points=np.zeros((2, 3)), poses=poses, noise=np.array([0.3]), rotation_deviation=1e-3, translation_deviation=1e-3
    )
    flat = Priors(
        names=("nothing", "slope"),
        mean=np.array([0.0, 1.0]),
        standard_deviation=np.full(2, np.inf),
        lower=np.array([-1.0, 0.0]),
        upper=np.array([1.0, 2.0]),
    )
    observed = observe_target(target, blind, np.array([0.0, 1.0]), np.random.default_rng(0))
    with pytest.raises(NotConvergedError, match="do not determine nothing"):
        fit_target(TargetProblem(observed=observed, target=target, model=blind, priors=flat))


def test_a_peak_outside_the_prior_is_refused():
    truth, problem = plenoptic_problem(np.random.default_rng(9), deviations=(1e-3, 1e-4))
    narrow = Priors(
        names=PLENOPTIC_NAMES,
        mean=truth + 50e-6,
        standard_deviation=np.full(3, np.inf),
        lower=truth + 40e-6,
        upper=truth + 60e-6,
    )
    with pytest.raises(NotConvergedError, match="lies outside its prior"):
        fit_target(TargetProblem(observed=problem.observed, target=problem.target, model=plenoptic, priors=narrow))


def test_targets_without_noise_are_refused():
    with pytest.raises(OutOfRangeError, match="positive noise"):
        SyntheticTarget(points=np.zeros((4, 3)), poses=np.zeros((1, 6)), noise=np.array([0.1, 0.0]))
    with pytest.raises(OutOfRangeError, match="positive noise"):
        SyntheticTarget(
            points=np.zeros((4, 3)), poses=np.zeros((1, 6)), noise=np.array([0.1]), translation_deviation=0.0
        )


def test_a_board_is_seen_from_its_front_alone():
    """Turned by an angle about x, a board on the axis shows its front up to a quarter turn."""
    turned = np.zeros((4, 6))
    turned[:, 0], turned[:, 5] = np.radians([0.0, 80.0, 100.0, 180.0]), 1.0
    np.testing.assert_array_equal(faces(turned), [True, True, False, False])

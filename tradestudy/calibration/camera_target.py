"""Calibration of a camera by a simulated target: observations, expected errors, and a posterior without poses."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

import numpy as np

from tradestudy.calibration.laplace import (
    CHECKED_POINTS,
    LaplaceFit,
    compare_log_posteriors,
    covariance_from_information,
)
from tradestudy.calibration.projection import move, pose_derivatives
from tradestudy.calibration.sampling import (
    MINIMUM_ENSEMBLES,
    CheckedPosterior,
    sample_posterior,
)
from tradestudy.calibration.sources import CALIBRATION
from tradestudy.calibration.synthetic_target import (
    CameraModel,
    Priors,
    SyntheticTarget,
    faces,
    flat_grid,
    observe_target,
    spread_poses,
)
from tradestudy.cameras.calibration import Calibration
from tradestudy.cameras.calibration_declaration import LEAST_CORNERS, TargetPart
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.errors import NotConvergedError, OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.uncertainty.distributions import Normal, Uniform
from tradestudy.uncertainty.joint import JointNormal
from tradestudy.uncertainty.sources import ErrorClass, Group, Source
from tradestudy.uncertainty.streams import point_generator

_RELATIVE_STEP = 1e-3  # of a prior's scale; central differences then err by 1e-6 of their change over that scale
_POINT_STEP = 1e-5  # of a point's distance
_MOST_STEPS, _MOST_POSE_STEPS = 50, 20
_SETTLED = 1e-8  # largest squared step of a converged fit, in standard deviations
_CHUNK_NUMBERS = 250_000  # residuals at a time, which fit into a processor's cache


@dataclass(frozen=True, kw_only=True)
class TargetFit:
    """Most probable parameters and poses, with a normal approximation of the parameters' posterior.

    Parameters
    ----------
    laplace : LaplaceFit
        Parameters, with poses marginalised.
    poses : array (V, 6)
        Most probable poses [rad, m].
    evaluations : int
        Number of parameter vectors at which the camera was evaluated.
    seconds : float
        Wall time.
    """

    laplace: LaplaceFit
    poses: FloatArray
    evaluations: int
    seconds: float


@dataclass(frozen=True, kw_only=True)
class TargetProblem:
    """Observations of a target by a camera, and the priors.

    Parameters
    ----------
    observed : array (V, N, C)
        Observations; NaN where a point was not visible.
    target : SyntheticTarget
        Points, nominal poses, noise.
    model : CameraModel
        The camera.
    priors : Priors
        Priors of its parameters.
    """

    observed: FloatArray
    target: SyntheticTarget
    model: CameraModel
    priors: Priors

    def residuals(self, parameters: FloatArray, poses: FloatArray) -> FloatArray:
        """Observed minus predicted in units of the noise, shape (..., V, N·C); zero where a point was not visible.

        Parameters
        ----------
        parameters : array (..., P)
            Camera parameters.
        poses : array (V, 6)
            Target poses.
        """
        return self.residuals_at(parameters, move(poses, self.target.points))

    def residuals_at(self, parameters: FloatArray, points: FloatArray) -> FloatArray:
        """Observed minus predicted for points (V, N, 3) already in the camera's frame [m], shape (..., V, N·C).

        Parameters
        ----------
        parameters : array (..., P)
            Camera parameters.
        points : array (V, N, 3)
            Target points in their poses.
        """
        predicted = self.model(parameters[..., None, :], points)
        values = np.where(np.isnan(self.observed), 0.0, (self.observed - predicted) / self.target.noise)
        return values.reshape(*values.shape[:-2], -1)


def fit_target(problem: TargetProblem) -> TargetFit:
    """Maximise the posterior over parameters and poses, and approximate it by a normal distribution.

    Gauss–Newton steps eliminate the poses view by view; central differences give the derivatives of the camera.

    Parameters
    ----------
    problem : TargetProblem
        Observations and priors; the fit starts from their means and from the nominal poses.

    Returns
    -------
    TargetFit
        Peak and covariance.

    Raises
    ------
    NotConvergedError
        The fit does not converge, leaves the bounds of the priors, or moves an observed point out of sight, or the
        observations do not determine the parameters.
    """
    begin = time.perf_counter()
    priors = problem.priors
    parameters, poses = priors.mean, problem.target.poses
    for count in range(1, _MOST_STEPS + 1):
        parameters, poses, covariance, size = _gauss_newton_step(problem, parameters, poses)
        if size < _SETTLED:
            _require_inside(priors, parameters)
            return TargetFit(
                laplace=LaplaceFit(names=priors.names, mean=parameters, covariance=covariance),
                poses=poses,
                evaluations=count * (2 * len(parameters) + 7),
                seconds=time.perf_counter() - begin,
            )
    raise NotConvergedError(
        "the calibration does not converge",
        value=f"{_MOST_STEPS} steps",
        limit="steps below 1e-4 standard deviations",
        remedy="use a larger board, bring it nearer, tilt it more, or declare smaller errors before the calibration",
    )


def expected_fit(problem: TargetProblem) -> LaplaceFit:
    """The calibration expected from a target: the normal approximation about the design, without drawn noise.

    Its covariance is the inverse of the Fisher information of all views and priors, with poses marginalised. The
    covariance of a fit to noisy views differs from it, because the fit differs from the design.

    Parameters
    ----------
    problem : TargetProblem
        What the design observes without noise, and priors with the design as means.

    Raises
    ------
    NotConvergedError
        The target does not determine the parameters.
    """
    priors = problem.priors
    _, _, covariance, _ = _gauss_newton_step(problem, priors.mean, problem.target.poses)
    return LaplaceFit(names=priors.names, mean=priors.mean, covariance=covariance)


def sample_target(
    problem: TargetProblem,
    fit: TargetFit,
    *,
    rng: np.random.Generator,
    maximum_steps: int = 20_000,
) -> CheckedPosterior:
    """Sample the posterior with the exact camera model; Laplace's approximation about the fit marginalises poses.

    Parameters
    ----------
    problem : TargetProblem
        Observations and priors.
    fit : TargetFit
        Peak of the posterior, from ``fit_target``.
    rng : numpy.random.Generator
        Random-number generator for starts and chains.
    maximum_steps : int
        Steps of each ensemble; see ``posterior.sample_posterior``.

    Returns
    -------
    CheckedPosterior
        Check ``converged`` before using it.
    """
    names = problem.priors.names
    walkers = 2 * len(names) + 2
    # The log posterior to sample: one linear step from the fit optimises each pose.
    basis, misfit = _pose_basis(problem, fit.laplace.mean, fit.poses)[0], _pose_misfit(problem, fit.poses)
    points = move(fit.poses, problem.target.points)

    def log_probability(tried: FloatArray) -> FloatArray:
        return _frozen_log_posterior(problem, points, basis, misfit, tried)

    starts = _starts_inside(problem.priors, fit.laplace, rng, MINIMUM_ENSEMBLES * walkers)
    sample = sample_posterior(
        log_probability,
        starts.reshape(MINIMUM_ENSEMBLES, walkers, -1),
        names=names,
        rng=rng,
        proposal=fit.laplace,
        maximum_steps=maximum_steps,
    )
    draws = sample.thinned(CHECKED_POINTS)
    # Derivatives move every corner six times: few draws at a time, so that large boards fit into memory.
    size = max(1, _CHUNK_NUMBERS // (6 * problem.observed.size))
    blocks = np.split(draws, range(size, len(draws), size))
    exact = np.concatenate([exact_log_posterior(problem, fit.poses, block) for block in blocks])
    return CheckedPosterior(sample=sample, check=compare_log_posteriors(exact, log_probability(draws)))


def exact_log_posterior(problem: TargetProblem, poses: FloatArray, parameters: FloatArray) -> FloatArray:
    """Log posterior with the poses refitted for these parameters (Laplace), up to a constant.

    Parameters
    ----------
    problem : TargetProblem
        Observations and priors.
    poses : array (V, 6)
        Starting values of the poses.
    parameters : array (K, P)
        Camera parameters.

    Returns
    -------
    array (K,)
        ln prior − χ²/2 − ½ ln det H, with H the Gauss–Newton Hessian of the poses.

    Raises
    ------
    NotConvergedError
        A pose does not converge.
    """
    poses = np.tile(poses, (len(parameters), 1, 1))
    log_posterior, rest = np.empty(len(parameters)), np.arange(len(parameters))
    for _ in range(_MOST_POSE_STEPS):
        tried, start = parameters[rest], poses[rest]
        residuals = np.concatenate([problem.residuals(tried, start), _pose_misfit(problem, start)], axis=-1)
        basis, factor = _pose_basis(problem, tried, start)
        inner = np.swapaxes(basis, -1, -2) @ residuals[..., None]
        with np.errstate(divide="ignore"):  # a pose that runs away does not converge
            volume = np.log(np.abs(np.diagonal(factor, axis1=-2, axis2=-1))).sum(axis=(-2, -1))
        # The value of the last step stays: the poses move so little after it that they are as good as refitted.
        log_posterior[rest] = problem.priors.log_density(tried) - 0.5 * np.sum(residuals**2, axis=(-2, -1)) - volume
        poses[rest] = start + np.linalg.solve(factor, inner)[..., 0]
        rest = rest[~np.all(np.sum(inner**2, axis=(-2, -1)) < _SETTLED, axis=-1)]
        if not rest.size:
            return log_posterior
    raise NotConvergedError(
        "the pose of a target does not converge",
        value=f"{_MOST_POSE_STEPS} steps",
        limit="steps below 1e-4 standard deviations",
        remedy="use a larger board, bring it nearer, or tilt it more, so that its corners determine its pose",
    )


def _gauss_newton_step(
    problem: TargetProblem, parameters: FloatArray, poses: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """New parameters and poses, covariance before the step, and mean squared step in standard deviations."""
    priors = problem.priors
    residuals, by_parameters = _linearise(problem, parameters, poses)
    basis, factor = _pose_basis(problem, parameters, poses)
    stacked = np.concatenate([residuals, _pose_misfit(problem, poses)], axis=-1)
    table = np.concatenate([by_parameters, np.zeros((len(poses), 6, len(parameters)))], axis=1)
    # What no pose explains: from it, the Schur complement follows without cancellation.
    free = table - basis @ (np.swapaxes(basis, -1, -2) @ table)
    information = np.einsum("vmi,vmj->ij", free, free) + np.diag(priors.precision)
    gradient = np.einsum("vmi,vm->i", free, stacked) - priors.precision * (parameters - priors.mean)
    covariance = covariance_from_information(information, priors.names)
    step = covariance @ gradient
    inner = np.einsum("vmk,vm->vk", basis, stacked - table @ step)
    pose_step = np.linalg.solve(factor, inner[..., None])[..., 0]
    size = float(step @ information @ step + np.sum(inner**2)) / (step.size + inner.size)
    return parameters + step, poses + pose_step, covariance, size


def _require_inside(priors: Priors, parameters: FloatArray) -> None:
    """Refuse a peak outside the bounds, because the posterior then ends at a bound and is not normal."""
    if np.isfinite(priors.log_density(parameters)):
        return
    outside = np.flatnonzero((parameters < priors.lower) | (parameters > priors.upper))[0]
    raise NotConvergedError(
        f"the most probable {priors.names[outside]} lies outside its prior",
        value=f"{parameters[outside]:g}",
        limit=f"{priors.lower[outside]:g} to {priors.upper[outside]:g}",
        remedy="widen the prior, or add views; at a bound, no normal approximation exists",
    )


def _frozen_log_posterior(
    problem: TargetProblem, points: FloatArray, basis: FloatArray, misfit: FloatArray, parameters: FloatArray
) -> FloatArray:
    """Log posterior, exact in the parameters; one linear step from the fit optimises each pose."""
    result = problem.priors.log_density(parameters)
    rows = np.flatnonzero(np.isfinite(result))
    size = max(1, _CHUNK_NUMBERS // problem.observed.size)
    # The last six rows belong to the priors of the poses, whose residuals do not depend on the parameters.
    split = basis.shape[1] - 6
    constant = np.einsum("vmk,vm->vk", basis[:, split:], misfit)
    for start in range(0, len(rows), size):
        chosen = rows[start : start + size]
        residuals = np.moveaxis(
            problem.residuals_at(parameters[chosen], points), -2, 0
        )  # views first: a batched product
        inner = residuals @ basis[:, :split] + constant[:, None]
        result[chosen] -= 0.5 * (np.sum(residuals**2, axis=(0, 2)) - np.sum(inner**2, axis=(0, 2)))
    return np.where(np.isnan(result), -np.inf, result)  # an observed point is not visible with these parameters


def _linearise(problem: TargetProblem, parameters: FloatArray, poses: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Residuals (V, M), and derivatives of the prediction with respect to the parameters (V, M, P)."""
    step = _RELATIVE_STEP * problem.priors.scale
    shifted = parameters + np.concatenate([np.zeros((1, len(step))), np.diag(step), -np.diag(step)])
    values = problem.residuals(shifted, poses)
    if not np.all(np.isfinite(values)):
        raise NotConvergedError(
            "the fit moves observed points out of sight",
            value=f"{int(np.sum(~np.isfinite(values[0])))} observations",
            limit="none",
            remedy="give nominal poses and prior means closer to the truth",
        )
    forward, backward = values[1 : len(step) + 1], values[len(step) + 1 :]
    derivative = (backward - forward) / (2.0 * step[:, None, None])
    return values[0], np.moveaxis(derivative, 0, -1)


def _pose_basis(problem: TargetProblem, parameters: FloatArray, poses: FloatArray) -> tuple[FloatArray, FloatArray]:
    """QR factors of the derivatives with respect to the poses (..., V, 6), with rows for their priors."""
    points = move(poses, problem.target.points)
    step = _POINT_STEP * np.linalg.norm(points, axis=-1)
    # Six shifted boards give the derivatives by all points, and by the chain rule those by all poses.
    shifts = np.multiply.outer(np.concatenate([np.eye(3), -np.eye(3)]), step)
    predicted = problem.model(parameters[..., None, :], points + np.moveaxis(shifts, 1, -1))
    by_points = (
        np.moveaxis((predicted[:3] - predicted[3:]) / (2.0 * step[..., None]), 0, -1) / problem.target.noise[:, None]
    )
    by_points = np.where(np.isnan(problem.observed)[..., None], 0.0, by_points)
    by_poses = pose_derivatives(by_points, poses, points).reshape(*poses.shape[:-1], -1, 6)
    prior = np.broadcast_to(np.diag(np.sqrt(problem.target.pose_precision)), (*poses.shape, 6))
    basis, factor = np.linalg.qr(np.concatenate([by_poses, prior], axis=-2))
    return basis, factor


def _pose_misfit(problem: TargetProblem, poses: FloatArray) -> FloatArray:
    """Nominal minus current poses in units of their standard deviation, shape (V, 6); zero where unknown."""
    misfit: FloatArray = np.sqrt(problem.target.pose_precision) * (problem.target.poses - poses)
    return misfit


def _starts_inside(priors: Priors, fit: LaplaceFit, rng: np.random.Generator, count: int) -> FloatArray:
    """Draws from the Laplace fit that lie inside the bounds of the priors."""
    starts = np.empty((0, len(priors.names)))
    for _ in range(1000):
        draws = fit.draw(rng, count)
        starts = np.concatenate([starts, draws[np.isfinite(priors.log_density(draws))]])
        if len(starts) >= count:
            return starts[:count]
    raise NotConvergedError(
        "the posterior lies almost entirely outside the bounds of the priors",
        value=f"{len(starts)} of {1000 * count} draws inside",
        limit=f">= {count}",
        remedy="widen the priors",
    )


_FEWEST_VIEWS = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class TargetToInfer:
    """A calibration from a simulated target, not yet computed.

    Parameters
    ----------
    name
        Name of the camera; with the seed, it determines the random numbers.
    camera
        The camera as designed.
    groups
        The declared errors; those that are drawn per rig are the priors.
    part
        The target.
    seed
        Seed of the study.
    """

    name: str
    camera: DepthCamera
    groups: tuple[Group, ...]
    part: TargetPart
    seed: int


def target_problem(request: TargetToInfer) -> tuple[TargetProblem, np.random.Generator]:
    """Observations of the target by a camera drawn from the declared errors, and the generator for sampling."""
    camera, priors = request.camera, _priors(request.name, request.groups)
    rng = point_generator(seed=request.seed, point=f"target/{request.name}", replicate=0)
    target = _target(request, rng)
    model = observer(camera, priors.names)
    truth = priors.draw(rng, 1)[0]
    observed, target = _on_sensor(request.name, camera, observe_target(target, model, truth, rng), target)
    return TargetProblem(observed=observed, target=target, model=model, priors=priors), rng


def planned_calibration(request: TargetToInfer, plan: int) -> Calibration:
    """The calibration expected from a target, without sampling: a joint normal about the design.

    A normal prior of the same standard deviation replaces a uniform one. This is exact where the views determine the
    parameter much better than the prior, or not at all.

    Parameters
    ----------
    request
        The target.
    plan
        Number of the random arrangement of views; a run uses 0. Declared poses have only one arrangement.

    Raises
    ------
    TradestudyError
        As for `infer_from_target`.
    """
    fit = expected_fit(planned_problem(request, plan))
    group = JointNormal(
        name=CALIBRATION,
        parameters=fit.names,
        mean=np.zeros(len(fit.names)),
        covariance=fit.covariance,
        error_class=ErrorClass.RIG,
    )
    return Calibration(groups=(group,), source="target")


def planned_problem(request: TargetToInfer, plan: int) -> TargetProblem:
    """What the camera as designed observes of the target, without noise, in one arrangement of its views.

    Raises
    ------
    TradestudyError
        Too few views show the target, or the errors cannot be priors.
    """
    camera, priors = request.camera, _as_normal(_priors(request.name, request.groups))
    target = _target(request, point_generator(seed=request.seed, point=f"target/{request.name}", replicate=plan))
    model = observer(camera, priors.names)
    observed, target = _on_sensor(request.name, camera, model(priors.mean, move(target.poses, target.points)), target)

    def on_sensor(parameters: FloatArray, points: FloatArray) -> FloatArray:
        return np.where(np.isnan(observed), np.nan, model(parameters, points))

    return TargetProblem(observed=observed, target=target, model=on_sensor, priors=priors)


def _target(request: TargetToInfer, rng: np.random.Generator) -> SyntheticTarget:
    """The board in all its poses, as declared or at random."""
    part = request.part
    if part.poses is not None:
        poses = np.array([(*pose.rotation, *pose.position) for pose in part.poses])
    else:
        assert part.views is not None  # the schema requires all three if there are no poses
        assert part.distances is not None
        assert part.tilt is not None
        near, far = part.distances
        poses = spread_poses(part.views, (near, far), part.half_field, part.tilt, rng)
    return SyntheticTarget(
        points=flat_grid(part.columns, part.rows, part.spacing),
        poses=poses,
        noise=request.camera.target_noise_px(part.corner_noise),
        rotation_deviation=part.rotation_known_to or np.inf,
        translation_deviation=part.position_known_to or np.inf,
    )


def _priors(name: str, groups: tuple[Group, ...]) -> Priors:
    """Independent priors from the errors that are drawn once per rig."""
    rows: list[tuple[str, float, float, float, float]] = []
    for group in groups:
        if group.error_class is not ErrorClass.RIG:
            continue
        distribution = group.distribution if isinstance(group, Source) else None
        match distribution:
            case Normal():
                rows.append((group.name, distribution.mean, distribution.standard_deviation, -np.inf, np.inf))
            case Uniform():
                rows.append((group.name, distribution.mean, np.inf, distribution.low, distribution.high))
            case None:
                raise OutOfRangeError(
                    f"{name}: correlated errors cannot be priors for a target",
                    value=", ".join(group.parameters),
                    limit="independent errors",
                    remedy="remove their correlations; the target determines them",
                )
            case _:
                raise OutOfRangeError(
                    f"{name}: the distribution of {group.name} cannot be a prior for a target",
                    value=type(distribution).__name__,
                    limit="normal or uniform",
                    remedy="declare only a standard_deviation or a half_width",
                )
    if not rows:
        raise OutOfRangeError(
            f"{name}: a target needs at least one error that is drawn per rig",
            remedy="declare the parameters to determine under errors",
        )
    names, *columns = zip(*rows, strict=True)
    mean, deviation, lower, upper = (np.array(column, dtype=np.float64) for column in columns)
    return Priors(names=tuple(map(str, names)), mean=mean, standard_deviation=deviation, lower=lower, upper=upper)


def _as_normal(priors: Priors) -> Priors:
    uniform = np.isinf(priors.standard_deviation)
    with np.errstate(invalid="ignore"):  # inf − inf of an unbounded normal, which is not selected
        deviation = np.where(uniform, (priors.upper - priors.lower) / math.sqrt(12.0), priors.standard_deviation)
    unbounded = np.full(len(priors.names), np.inf)
    return replace(priors, standard_deviation=deviation, lower=-unbounded, upper=unbounded)


def _on_sensor(
    name: str, camera: DepthCamera, observed: FloatArray, target: SyntheticTarget
) -> tuple[FloatArray, SyntheticTarget]:
    """Observations and target, without corners outside the sensor and without views of fewer than six corners.

    A board that is seen from behind shows no corners.
    """
    visible = camera.seen_on_sensor(observed) & faces(target.poses)[:, None, None]
    taken = np.all(np.sum(visible, axis=1) >= LEAST_CORNERS, axis=-1)
    if taken.sum() < _FEWEST_VIEWS:
        raise OutOfRangeError(
            f"{name}: the target is visible in too few views",
            value=str(int(taken.sum())),
            limit=f"at least {_FEWEST_VIEWS} with {LEAST_CORNERS} corners",
            remedy="turn the board towards the camera, use a smaller one, or place it farther away or nearer the axis",
        )
    return np.where(visible, observed, np.nan)[taken], replace(target, poses=target.poses[taken])


def observer(camera: DepthCamera, names: tuple[str, ...]) -> CameraModel:
    """A function that observes points by a camera with given errors; its last axis is components [px]."""
    pixel = camera.sensor.pixel_pitch

    def observe(parameters: FloatArray, points: FloatArray) -> FloatArray:
        errors = {name: parameters[..., k, None] for k, name in enumerate(names)}
        x, y, z = points[..., 0], points[..., 1], points[..., 2]
        components = camera.observe_target(errors, x, y, z)
        return np.stack(np.broadcast_arrays(*components), axis=-1) / pixel

    return observe

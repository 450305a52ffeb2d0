"""Calibration of a camera by a simulated target: its observations, and the calibration expected from them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tradestudy.calibration.projection import move
from tradestudy.calibration.sources import CALIBRATION
from tradestudy.calibration.target.synthetic_target import (
    CameraModel,
    Priors,
    SyntheticTarget,
    faces,
    flat_grid,
    observe_target,
    spread_poses,
)
from tradestudy.calibration.target.target_inference import TargetProblem, expected_fit
from tradestudy.cameras.calibration import Calibration
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cameras.target_declaration import LEAST_CORNERS, TargetPart
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.uncertainty.distributions import Normal, Uniform
from tradestudy.uncertainty.joint import JointNormal
from tradestudy.uncertainty.sources import ErrorClass, Group, Source
from tradestudy.uncertainty.streams import point_generator

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
    seen, target = _on_sensor(request.name, camera, observe_target(target, model, truth, rng), target)
    return TargetProblem(observed=seen, target=target, model=model, priors=priors), rng


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
    camera, priors = request.camera, _as_normal(_priors(request.name, request.groups))
    target = _target(request, point_generator(seed=request.seed, point=f"target/{request.name}", replicate=plan))
    model = observer(camera, priors.names)
    seen, target = _on_sensor(request.name, camera, model(priors.mean, move(target.poses, target.points)), target)

    def on_sensor(parameters: FloatArray, points: FloatArray) -> FloatArray:
        return np.where(np.isnan(seen), np.nan, model(parameters, points))

    fit = expected_fit(target, on_sensor, priors)
    group = JointNormal(
        name=CALIBRATION,
        parameters=fit.names,
        mean=np.zeros(len(fit.names)),
        covariance=fit.covariance,
        error_class=ErrorClass.RIG,
    )
    return Calibration(groups=(group,), source="target")


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
    seen = camera.seen_on_sensor(observed) & faces(target.poses)[:, None, None]
    taken = np.all(np.sum(seen, axis=1) >= LEAST_CORNERS, axis=-1)
    if taken.sum() < _FEWEST_VIEWS:
        raise OutOfRangeError(
            f"{name}: the target is visible in too few views",
            value=str(int(taken.sum())),
            limit=f"at least {_FEWEST_VIEWS} with {LEAST_CORNERS} corners",
            remedy="turn the board towards the camera, use a smaller one, or place it farther away or nearer the axis",
        )
    return np.where(seen, observed, np.nan)[taken], replace(target, poses=target.poses[taken])


def observer(camera: DepthCamera, names: tuple[str, ...]) -> CameraModel:
    """A function that observes points by a camera with given errors; its last axis is components [px]."""
    pixel = camera.sensor.pixel_pitch

    def observe(parameters: FloatArray, points: FloatArray) -> FloatArray:
        errors = {name: parameters[..., k, None] for k, name in enumerate(names)}
        x, y, z = points[..., 0], points[..., 1], points[..., 2]
        seen = camera.observe_target(errors, x, y, z)
        return np.stack(np.broadcast_arrays(*seen), axis=-1) / pixel

    return observe

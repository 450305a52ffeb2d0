"""Calibrations inferred: from a synthetic target shown to a camera of the study, or from the corners of a real rig."""

from __future__ import annotations

from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path

import numpy as np

from tradestudy.calibration.corners.corner_file import read_corners
from tradestudy.calibration.corners.pair_residual import sample_relative_pose
from tradestudy.calibration.corners.real_rig import RigFit, fit_rig, inverse_depth, observe_pair
from tradestudy.calibration.corners.view_blocks import SHARED_NAMES
from tradestudy.calibration.declaration import CornersPart, TargetPart
from tradestudy.calibration.posterior.laplace import LaplaceCheck
from tradestudy.calibration.posterior.sampling import PosteriorSample
from tradestudy.calibration.projection import rotation_matrix
from tradestudy.calibration.sources import group_of_draws
from tradestudy.calibration.target.synthetic_target import (
    CameraModel,
    Priors,
    SyntheticTarget,
    flat_grid,
    observe_target,
    tilted_poses,
)
from tradestudy.calibration.target.target_inference import TargetProblem, fit_target, sample_target
from tradestudy.cameras.camera import Camera
from tradestudy.cameras.exact_model import ExactModel
from tradestudy.cameras.reading import Errors, InverseDepthReading
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.uncertainty.distributions import Normal, Uniform
from tradestudy.uncertainty.error_class import ErrorClass
from tradestudy.uncertainty.joint import JointDraws
from tradestudy.uncertainty.sources import Group, Source
from tradestudy.uncertainty.streams import point_generator

MOST_DRAWS = 2**13
"""Joint draws of a posterior that are propagated, spread evenly over ensembles, steps and walkers."""
_FEWEST_CORNERS, _FEWEST_VIEWS = 6, 3
CORNER_NOISE_NAMES = tuple(f"{side}_corner_noise_{axis}_px" for side in ("left", "right") for axis in ("x", "y"))


@dataclass(frozen=True, kw_only=True, eq=False)
class InferredCalibration:
    """A calibration inferred from observations.

    Parameters
    ----------
    group
        Its joint draws, as errors about their mean, under the names of the camera's model.
    sample, check
        The chains with their verdict, and whether the poses could be marginalised as they were.
    laplace_deviation, laplace_seconds
        Standard deviations of the normal approximation beside it, in the order of the sample, and its cost [s].
    prior_deviation
        Standard deviations of the priors; infinite where flat without bounds.
    """

    group: JointDraws
    sample: PosteriorSample
    check: LaplaceCheck
    laplace_deviation: FloatArray
    laplace_seconds: float
    prior_deviation: FloatArray

    @property
    def failures(self) -> tuple[str, ...]:
        """Why it cannot be stated as converged; empty where it can."""
        efficiency = f"{self.check.efficiency:.2f} of the draws survive reweighting to poses settled anew"
        marginal = () if self.check.passed else (efficiency,)
        return (*self.sample.diagnostics.failures, *marginal)


def infer_from_target(
    name: str, camera: ExactModel, groups: tuple[Group, ...], part: TargetPart, *, seed: int
) -> InferredCalibration:
    """Show a synthetic target to a camera drawn from the declared errors, and infer its parameters by emcee.

    Parameters
    ----------
    name
        Of the camera; with the seed it says which random numbers are drawn.
    camera
        The design.
    groups
        The declared errors; those that are drawn per rig are the priors.
    part
        The target.
    seed
        Of the study.

    Raises
    ------
    OutOfRangeError
        An error per rig is not normal or uniform, or is drawn jointly with another: priors are independent.
    NotConvergedError
        The fit does not settle, or the target leaves parameters undetermined.
    """
    problem, rng = target_problem(name, camera, groups, part, seed=seed)
    names, deviation = problem.priors.names, problem.priors.standard_deviation
    fit = fit_target(problem)
    posterior = sample_target(problem, fit, rng=rng, maximum_steps=part.maximum_steps)
    return InferredCalibration(
        group=group_of_sample(names, posterior.sample),
        sample=posterior.sample,
        check=posterior.check,
        laplace_deviation=fit.laplace.standard_deviation,
        laplace_seconds=fit.seconds,
        prior_deviation=deviation,
    )


def target_problem(
    name: str, camera: ExactModel, groups: tuple[Group, ...], part: TargetPart, *, seed: int
) -> tuple[TargetProblem, np.random.Generator]:
    """What a camera drawn from the declared errors sees of the target, and the generator that goes on from there."""
    priors = _priors(name, groups)
    rng = point_generator(seed=seed, point=f"target/{name}", replicate=0)
    target = SyntheticTarget(
        points=flat_grid(part.columns, part.rows, part.spacing),
        poses=tilted_poses(part.views, (part.distances[0], part.distances[1]), part.half_field, part.tilt, rng),
        noise=camera.target_noise_px(part.corner_noise),
        rotation_deviation=part.rotation_known_to or np.inf,
        translation_deviation=part.position_known_to or np.inf,
    )
    model = _observer(camera, priors.names)
    truth = priors.draw(rng, 1)[0]
    observed, target = _on_sensor(camera, observe_target(target, model, truth, rng), target)
    return TargetProblem(observed=observed, target=target, model=model, priors=priors), rng


def group_of_sample(names: tuple[str, ...], sample: PosteriorSample) -> JointDraws:
    """Some of the draws of these parameters, as errors about their mean."""
    columns = [sample.names.index(name) for name in names]
    draws = sample.thinned(min(MOST_DRAWS, len(sample.draws)))[:, columns]
    return group_of_draws("calibration", names, draws)


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
            case _:
                raise OutOfRangeError(
                    f"{name}: {group.name} is no prior of a target calibration",
                    value="joint" if distribution is None else type(distribution).__name__,
                    limit="independent errors, normal or uniform",
                    remedy="declare its parameters apart (correlation: 0); the target finds their correlation",
                )
    if not rows:
        raise OutOfRangeError(
            f"{name}: a target calibration without an error per rig", remedy="declare what it is to determine"
        )
    names, *columns = zip(*rows, strict=True)
    mean, deviation, lower, upper = (np.array(column, dtype=np.float64) for column in columns)
    return Priors(names=tuple(map(str, names)), mean=mean, standard_deviation=deviation, lower=lower, upper=upper)


def _on_sensor(camera: ExactModel, observed: FloatArray, target: SyntheticTarget) -> tuple[FloatArray, SyntheticTarget]:
    """Corners that fall beside the sensor are not seen, and views with fewer than six are not taken."""
    seen = camera.seen_on_sensor(observed)
    taken = np.all(np.sum(seen, axis=1) >= _FEWEST_CORNERS, axis=-1)
    if taken.sum() < _FEWEST_VIEWS:
        raise OutOfRangeError(
            "a synthetic target is seen in too few views",
            value=str(int(taken.sum())),
            limit=f"at least {_FEWEST_VIEWS} with {_FEWEST_CORNERS} corners",
            remedy="show a smaller board, farther away, or nearer to the axis",
        )
    return np.where(seen, observed, np.nan)[taken], replace(target, poses=target.poses[taken])


def _observer(camera: ExactModel, names: tuple[str, ...]) -> CameraModel:
    """What a camera with given errors sees of points, as inference takes it: components [px] last."""
    pixel = camera.sensor.pixel_pitch

    def observe(parameters: FloatArray, points: FloatArray) -> FloatArray:
        errors = {name: parameters[..., k, None] for k, name in enumerate(names)}
        x, y, z = points[..., 0], points[..., 1], points[..., 2]
        seen = camera.observe_target(errors, x, y, z)
        return np.stack(np.broadcast_arrays(*seen), axis=-1) / pixel

    return observe


@dataclass(frozen=True, kw_only=True, eq=False)
class RealRig:
    """A rig calibrated from its corners.

    Parameters
    ----------
    calibration
        The posterior of its 18 parameters.
    fit
        Bundle adjustment and the left–right term.
    noise
        Noise of one corner coordinate in each picture, one group each, per measurement.
    pixels
        Columns and rows.
    """

    calibration: InferredCalibration
    fit: RigFit
    noise: tuple[Group, ...]
    pixels: tuple[int, int]

    def reading(self, distance: FloatArray, field: float, errors: Errors) -> InverseDepthReading:
        """Inverse depths by disparity in the frame of the left camera, of points on and off the axis of the pair.

        The axis runs from the middle of the baseline midway between the two optical axes; the edge lies from there
        towards the corner of the left picture.
        """
        shared = self.best
        z = np.asarray(distance, dtype=np.float64)[:, None]
        to_right = rotation_matrix(shared[12:15])
        axis = to_right[2] + np.array([0.0, 0.0, 1.0])  # the right camera's axis in the left frame, and the left one's
        corner = np.array([self.pixels[0] / 2.0 / shared[0], self.pixels[1] / 2.0 / shared[1]])
        across = -0.5 * (to_right.T @ shared[15:18])[:2] + z * (axis[:2] / axis[2] + field * corner)
        seen = observe_pair(shared, np.concatenate([across, z], axis=-1))
        size = np.array([*self.pixels, *self.pixels], dtype=np.float64)
        inside = np.all((seen >= -0.5) & (seen <= size - 0.5), axis=-1)  # NaN, behind a camera, is not inside
        rigs = shared + _columns(errors, SHARED_NAMES)[:, 0]
        inverse = inverse_depth(
            rigs, np.where(inside[:, None], seen, size / 2.0) + _columns(errors, CORNER_NOISE_NAMES)
        )
        return InverseDepthReading(inverse_depth=inverse, no_overlap=~inside, out_of_range=np.zeros((1, 1), dtype=bool))

    @property
    def best(self) -> FloatArray:
        """Mean of the posterior's shared parameters, in the order of ``SHARED_NAMES``."""
        return np.asarray(self.calibration.sample.draws[:, : len(SHARED_NAMES)].mean(axis=0))


def _columns(errors: Errors, names: tuple[str, ...]) -> FloatArray:
    """Errors (draws, 1) side by side, shape (draws, 1, names); zero where not given."""
    values = [np.asarray(errors.get(name, 0.0), dtype=np.float64).reshape(-1, 1) for name in names]
    return np.stack(np.broadcast_arrays(*values), axis=-1)


def infer_from_corners(name: str, rig: Camera, part: CornersPart, folder: Path, *, seed: int) -> RealRig:
    """Calibrate a real rig from a corner file: bundle adjustment, left–right term, posterior by emcee.

    Raises
    ------
    CornerFileError
        The file contradicts itself or the declared baseline.
    NotConvergedError
        The views do not determine the parameters.
    """
    corners = read_corners(folder / part.file)
    fit = fit_rig(corners, declared_baseline=part.declared_baseline)
    rng = point_generator(seed=seed, point=f"corners/{name}", replicate=0)
    posterior = sample_relative_pose(fit.explained, corners, rng=rng, maximum_steps=part.maximum_steps)
    deviation = np.concatenate([np.sqrt(np.diag(fit.explained.covariance)), [np.nan, np.nan]])
    calibration = InferredCalibration(
        group=group_of_sample(SHARED_NAMES, posterior.sample),
        sample=posterior.sample,
        check=posterior.check,
        laplace_deviation=deviation,
        laplace_seconds=fit.explained.seconds,
        prior_deviation=np.full(len(posterior.sample.names), np.inf),
    )
    noise = tuple(
        Source(
            name=noise_name,
            distribution=Normal(mean=0.0, standard_deviation=fit.explained.noise_px),
            error_class=ErrorClass.MEASUREMENT,
        )
        for noise_name in CORNER_NOISE_NAMES
    )
    return RealRig(calibration=calibration, fit=fit, noise=noise, pixels=(rig.sensor.columns, rig.sensor.rows))


@dataclass(frozen=True, kw_only=True, eq=False)
class TargetToInfer:
    """A calibration to be inferred from a synthetic target, as `infer_from_target` takes it."""

    name: str
    camera: ExactModel
    groups: tuple[Group, ...]
    part: TargetPart
    seed: int


@dataclass(frozen=True, kw_only=True, eq=False)
class CornersToInfer:
    """A rig to be calibrated from a corner file, as `infer_from_corners` takes it; ``content`` is its SHA-256."""

    name: str
    rig: Camera
    part: CornersPart
    folder: Path
    seed: int
    content: str

    @classmethod
    def of(cls, name: str, rig: Camera, part: CornersPart, folder: Path, *, seed: int) -> CornersToInfer:
        """As the file stands now; one that cannot be read is refused where it is read."""
        path = folder / part.file
        content = sha256(path.read_bytes()).hexdigest() if path.is_file() else ""
        return cls(name=name, rig=rig, part=part, folder=folder, seed=seed, content=content)


def infer(asked: TargetToInfer | CornersToInfer) -> InferredCalibration | RealRig:
    """Infer a calibration from whatever it is to be inferred from."""
    if isinstance(asked, CornersToInfer):
        return infer_from_corners(asked.name, asked.rig, asked.part, asked.folder, seed=asked.seed)
    return infer_from_target(asked.name, asked.camera, asked.groups, asked.part, seed=asked.seed)

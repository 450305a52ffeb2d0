"""Calibrations inferred from a simulated target or from the corners of a real rig."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from typing import cast

import numpy as np

from tradestudy.calibration.calibration_file import CalibrationDraws
from tradestudy.calibration.camera_target import TargetToInfer, fit_target, sample_target, target_problem
from tradestudy.calibration.corners.corner_file import StereoCorners, read_corners
from tradestudy.calibration.corners.pair_residual import CompressedViews, PairResidualFit, exact_log_likelihood
from tradestudy.calibration.corners.real_rig import WARP_NAMES, RigFit, fit_rig, views_with_warp, warped
from tradestudy.calibration.corners.rig_measurement import check_geometry, check_inside
from tradestudy.calibration.corners.trust import CalibrationTrust, examine
from tradestudy.calibration.corners.view_blocks import TRANSLATION, shared_names
from tradestudy.calibration.laplace import (
    CHECKED_POINTS,
    LaplaceCheck,
    LaplaceFit,
    compare_log_posteriors,
)
from tradestudy.calibration.posterior_file import rig_calibration
from tradestudy.calibration.projection import RADIAL_LENS, FreeLens
from tradestudy.calibration.sampling import MINIMUM_ENSEMBLES, CheckedPosterior, PosteriorSample, sample_posterior
from tradestudy.calibration.sources import CALIBRATION, declared_groups, group_of_draws
from tradestudy.cameras.calibrated_pair import PairGeometry
from tradestudy.cameras.calibration import Calibration
from tradestudy.cameras.calibration_declaration import CalibrationPart, CornersPart
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.declarations.lens_models import FittedLensModel
from tradestudy.errors import TradestudyError
from tradestudy.execution.executor import part_of_point, tell
from tradestudy.optics.arrays import FloatArray
from tradestudy.uncertainty.streams import point_generator

_SAMPLED, _CHAINS = 0.5, 0.27
"""Fraction of the time that sampling takes, before the check, and of sampling that the first round of steps takes."""


def posterior_names(free: Sequence[str]) -> tuple[str, ...]:
    """Names of the sampled parameters of a pair whose lenses have these free coefficients."""
    return (*shared_names(free), *WARP_NAMES, "log_noise_px", "motion_scale")


def linearised_rig(fit: RigFit) -> CompressedViews:
    """The views of a fit, linearised in the shared parameters and the warp of the board."""
    return views_with_warp(fit.explained, fit.corners, fit.warp)


def log_posterior(compressed: CompressedViews, parameters: FloatArray, *, largest_motion: float) -> FloatArray:
    """Log posterior with poses and motions marginalised, up to a constant.

    Parameters
    ----------
    compressed : CompressedViews
        The reduced views.
    parameters : array (..., P + 5)
        Parameters in the order of ``posterior_names``.
    largest_motion : float
        Upper limit of the uniform prior of the motion scale [m].

    Returns
    -------
    array (...)
        Natural logarithm; −inf beyond ``largest_motion``. The prior is flat in the shared parameters, the warp, ln σ,
        and the motion scale (A. Gelman, Bayesian Analysis 1 (2006) 515), which can therefore reach zero if there is no
        motion.
    """
    scale = parameters[..., -1]
    allowed = (scale > 0.0) & (scale <= largest_motion)
    likelihood = compressed.log_likelihood(parameters[..., :-2], np.exp(parameters[..., -2]), np.abs(scale))
    return np.where(allowed, likelihood, -np.inf)


def sample_rig(fit: RigFit, *, rng: np.random.Generator, maximum_steps: int = 20_000) -> CheckedPosterior:
    """Sample the posterior of a pair with emcee, and check its marginalisation against the exact one.

    Parameters
    ----------
    fit : RigFit
        The fit at which views are linearised and chains start.
    rng : numpy.random.Generator
        Random-number generator for starts and chains.
    maximum_steps : int
        Steps of each ensemble; see ``posterior.sample_posterior``.

    Returns
    -------
    CheckedPosterior
        Check ``converged`` before using it.
    """
    views, largest_motion = linearised_rig(fit), fit.explained.lever
    laplace = _joint_laplace(fit, views)
    walkers = 2 * len(laplace.names) + 2
    starts = laplace.draw(rng, MINIMUM_ENSEMBLES * walkers)
    # The normal approximation does not know the bounds of the scale of the motions.
    starts[:, -1] = np.minimum(np.abs(starts[:, -1]), largest_motion)
    with part_of_point(0.0, _SAMPLED):
        sample = sample_posterior(
            lambda parameters: log_posterior(views, parameters, largest_motion=largest_motion),
            starts.reshape(MINIMUM_ENSEMBLES, walkers, -1),
            names=laplace.names,
            rng=rng,
            proposal=laplace,
            maximum_steps=maximum_steps,
            chains_fraction=_CHAINS,
        )
    with part_of_point(_SAMPLED, 1.0):
        check = check_marginalisation(sample.thinned(CHECKED_POINTS), views, fit)
    return CheckedPosterior(sample=sample, check=check)


def check_marginalisation(draws: FloatArray, views: CompressedViews, fit: RigFit) -> LaplaceCheck:
    """Compare the linearised marginal posterior with that for poses refitted at each draw.

    Parameters
    ----------
    draws : array (K, P + 5)
        Posterior draws.
    views : CompressedViews
        The linearised views, with the warp.
    fit : RigFit
        The corners, and starting values of the poses.

    Returns
    -------
    LaplaceCheck
        The check of the log ratios.
    """
    noises, scales = np.exp(draws[:, -2]), draws[:, -1]
    exact = np.empty(len(draws))
    for k, (draw, noise, scale) in enumerate(zip(draws, noises, scales, strict=True)):
        exact[k] = exact_log_likelihood(
            draw[:-5],
            fit.explained.states,
            warped(fit.corners, draw[-5:-2]),
            fit.explained.lever,
            noise_px=float(noise),
            motion_scale=float(scale),
        )
        tell((k + 1) / len(draws))
    return compare_log_posteriors(exact, views.log_likelihood(draws[:, :-2], noises, scales))


def _joint_laplace(fit: RigFit, views: CompressedViews) -> LaplaceFit:
    """Normal approximation for all parameters; the number of coordinates determines the uncertainty of the noise."""
    explained, names = fit.explained, posterior_names(fit.corners.lens.free)
    covariance = np.zeros((len(names), len(names)))
    covariance[:-2, :-2] = fit.joint_covariance
    # The logarithm of a standard deviation of N numbers has the variance 1/(2 N); a corner has four coordinates.
    covariance[-2, -2] = 1.0 / (8.0 * fit.corners.corner_count)
    covariance[-1, -1] = _motion_deviation(explained, views) ** 2
    mean = np.concatenate([views.centre, [np.log(explained.noise_px), explained.motion_scale]])
    return LaplaceFit(names=names, mean=mean, covariance=covariance)


def _motion_deviation(fit: PairResidualFit, views: CompressedViews) -> float:
    """Distance above the best motion scale at which the restricted log likelihood is lower by one half [m]."""
    from scipy.optimize import brentq

    best = views.restricted_log_likelihood(fit.noise_px, fit.motion_scale)

    def excess(step: float) -> float:
        return best - 0.5 - views.restricted_log_likelihood(fit.noise_px, fit.motion_scale + step)

    # By the same rule, the step that would suffice if the six components of every motion were seen without noise.
    far = fit.motion_scale / np.sqrt(12.0 * len(fit.states.poses))
    while excess(far) < 0.0 and far < fit.lever:
        far *= 2.0
    return float(brentq(excess, 0.0, far, rtol=0.01)) if far < fit.lever else fit.lever


MOST_DRAWS = 2**13
"""Number of joint posterior draws to propagate, spread evenly over ensembles, steps and walkers."""
_CHECKED_DRAWS = 1000
_FITTED, _LOADED, _CHECKED = 0.13, 0.22, 0.9
"""Fractions of the time of a calibration from corners until it is fitted, until chains begin, and until their check."""
_FEW_VIEWS = 8  # fitted in a second


@dataclass(frozen=True, kw_only=True, eq=False)
class InferredCalibration:
    """A calibration inferred from observations.

    Parameters
    ----------
    calibration
        The part of the camera's calibration that the observations determine, with the exact model of a rig that is
        calibrated from corners. `calibration_of` replaces the priors by it.
    posterior
        The propagated draws, as saved.
    sample, check
        The chains with their diagnostics, and the check of the marginalisation over the poses.
    laplace_deviation, laplace_seconds
        Standard deviations of the normal approximation, in the order of the sample, and its computing time [s].
    prior_deviation
        Standard deviations of the priors; infinite for a flat prior without bounds.
    fit, trust
        Bundle adjustment, left–right term and corner noise, and the checks of the calibration.
    """

    calibration: Calibration
    posterior: CalibrationDraws
    sample: PosteriorSample
    check: LaplaceCheck
    laplace_deviation: FloatArray
    laplace_seconds: float
    prior_deviation: FloatArray
    fit: RigFit | None = None
    trust: CalibrationTrust | None = None

    @property
    def failures(self) -> tuple[str, ...]:
        """Why the chains count as not converged; empty if they converged."""
        efficiency = (
            f"reweighting to refitted poses leaves an effective share of {self.check.efficiency:.2f} of the draws"
        )
        marginal = () if self.check.passed else (efficiency,)
        return (*self.sample.diagnostics.failures, *marginal)


@dataclass(frozen=True, kw_only=True, eq=False)
class CornersToInfer:
    """A calibration of a rig from a corner file, not yet computed.

    Parameters
    ----------
    name, camera, part, seed
        As for `TargetToInfer`.
    folder
        Folder of the file.
    content
        SHA-256 of the file.
    """

    name: str
    camera: DepthCamera
    part: CornersPart
    folder: Path
    seed: int
    content: str

    @classmethod
    def of(cls, name: str, camera: DepthCamera, part: CornersPart, folder: Path, *, seed: int) -> CornersToInfer:
        """Build it with the current content of the file; `infer` refuses a file that cannot be read."""
        path = folder / part.file
        content = sha256(path.read_bytes()).hexdigest() if path.is_file() else ""
        return cls(name=name, camera=camera, part=part, folder=folder, seed=seed, content=content)


def to_infer(
    name: str, camera: DepthCamera, part: CalibrationPart, *, folder: Path, seed: int
) -> TargetToInfer | CornersToInfer | None:
    """The inference that a camera's calibration needs; None if it needs none.

    Parameters
    ----------
    name
        Name of the camera in its study.
    camera
        The camera as designed.
    part
        Its declared calibration.
    folder
        Folder of the files that the part names.
    seed
        Seed of the study.
    """
    if part.corners is not None:
        return CornersToInfer.of(name, camera, part.corners, folder, seed=seed)
    if part.target is None:
        return None
    groups = declared_groups(part, camera, folder)
    return TargetToInfer(name=name, camera=camera, groups=groups, part=part.target, seed=seed)


def infer(problem: TargetToInfer | CornersToInfer) -> InferredCalibration:
    """Infer a calibration from a target or from corners.

    Raises
    ------
    TradestudyError
        See `infer_from_target` and `infer_from_corners`.
    """
    return infer_from_corners(problem) if isinstance(problem, CornersToInfer) else infer_from_target(problem)


def infer_from_target(request: TargetToInfer) -> InferredCalibration:
    """Simulate a target seen by a camera drawn from the declared errors, and infer its parameters with emcee.

    Raises
    ------
    OutOfRangeError
        A prior is neither normal nor uniform, or is correlated with another.
    NotConvergedError
        The fit does not converge, or the target does not determine the parameters.
    """
    problem, rng = target_problem(request)
    fit = fit_target(problem)
    checked = sample_target(problem, fit, rng=rng, maximum_steps=request.part.max_steps)
    posterior = propagated(problem.priors.names, checked.sample)
    group = group_of_draws(CALIBRATION, posterior.names, posterior.draws)
    return InferredCalibration(
        calibration=Calibration(groups=(group,), source="target"),
        posterior=posterior,
        sample=checked.sample,
        check=checked.check,
        laplace_deviation=fit.laplace.standard_deviation,
        laplace_seconds=fit.seconds,
        prior_deviation=problem.priors.standard_deviation,
    )


def corners_of(request: CornersToInfer) -> StereoCorners:
    """The corners of a camera's file, all of them on its declared sensor.

    Raises
    ------
    CornerFileError
        The file cannot be read, or is inconsistent.
    GeometryContradictionError
        A corner lies outside the declared sensor.
    """
    rig = cast(PairGeometry, request.camera)  # the schema admits no other kind
    corners = read_corners(request.folder / request.part.file)
    check_inside(request.name, rig, np.concatenate([corners.left[corners.present], corners.right[corners.present]]))
    return corners


def infer_from_corners(request: CornersToInfer) -> InferredCalibration:
    """Calibrate a real rig from a corner file, by bundle adjustment with a left–right term, and sampling with emcee.

    Raises
    ------
    CornerFileError
        The file cannot be read, or is inconsistent.
    GeometryContradictionError
        The corners contradict the declared rig.
    NotConvergedError
        The views do not determine the parameters.
    """
    rig = cast(PairGeometry, request.camera)  # the schema admits no other kind
    corners_of(request)  # refuses corners beyond the sensor before the fit
    fit, normal = _fitted(request, few=False)
    lens, names = fit.corners.lens, normal.names
    tell(_FITTED)
    rng = point_generator(seed=request.seed, point=f"corners/{request.name}", replicate=0)
    with part_of_point(_LOADED, _CHECKED):
        checked = sample_rig(fit, rng=rng, maximum_steps=request.part.max_steps)
    draws_kept = propagated(names, checked.sample)
    posterior = replace(
        draws_kept,
        draws=with_square_size(draws_kept.draws, request.part.square_size_uncertainty, rng),
        best=checked.sample.draws[:, : len(names)].mean(axis=0),
        lens=lens,
        pixels=(rig.sensor.columns, rig.sensor.rows),
    )
    return InferredCalibration(
        calibration=rig_calibration(rig, posterior, source="corners"),
        posterior=posterior,
        sample=checked.sample,
        check=checked.check,
        laplace_deviation=np.concatenate([normal.standard_deviation, fit.warp_deviation, [np.nan, np.nan]]),
        laplace_seconds=fit.explained.seconds,
        prior_deviation=np.full(len(checked.sample.names), np.inf),
        fit=fit,
        trust=examine(fit, (rig.sensor.columns, rig.sensor.rows), others=[*map(lens_of, request.part.compared_with)]),
    )


def check_corners(request: CornersToInfer, *, few: bool) -> None:
    """Refuse corners as `infer_from_corners` does, without sampling.

    If `few`, a fit to a few views decides whether all are fitted, which takes longer and gives the verdict; a
    contradiction that few views do not show is then not found.

    Raises
    ------
    TradestudyError
        See `infer_from_corners`.
    """
    corners_of(request)
    try:
        _fitted(request, few=few)
    except TradestudyError:
        if not few:
            raise
        _fitted(request, few=False)


def _fitted(request: CornersToInfer, *, few: bool) -> tuple[RigFit, LaplaceFit]:
    """The fit to the corners and its normal approximation, which do not contradict the declared rig."""
    rig, part = cast(PairGeometry, request.camera), request.part
    fit = fit_of_file(request.folder / part.file, request.content, part.lens_model, few=few)
    normal = LaplaceFit(names=shared_names(fit.corners.lens.free), mean=fit.explained.shared, covariance=fit.covariance)
    draws = normal.draw(np.random.default_rng(0), _CHECKED_DRAWS)
    check_geometry(request.name, rig, normal.mean, draws, says="corners say", lens=fit.corners.lens)
    return fit, normal


@lru_cache(maxsize=8)
def fit_of_file(path: Path, _content: str, lens: FittedLensModel | None, *, few: bool) -> RigFit:
    """The fit to a corner file or, if ``few``, to a few of its views; designs of a sweep and the imported rig share it.

    ``_content`` is the file's SHA-256.

    Raises
    ------
    TradestudyError
        See `read_corners` and `fit_rig`.
    """
    corners = read_corners(path)
    if few:
        rows = np.unique(np.linspace(0, len(corners.views) - 1, _FEW_VIEWS).round().astype(int))
        corners = replace(
            corners,
            views=tuple(corners.views[row] for row in rows),
            **{name: getattr(corners, name)[rows] for name in ("board", "left", "right", "present")},
        )
    return fit_rig(replace(corners, lens=lens_of(lens)))


def lens_of(part: FittedLensModel | None) -> FreeLens:
    """The lens model to fit to both cameras."""
    return RADIAL_LENS if part is None else FreeLens(model=part.lens_model(), free=part.fitted)


def with_square_size(draws: FloatArray, uncertainty: float, rng: np.random.Generator) -> FloatArray:
    """Draws of a rig, shape (n, P), scaled by draws of the relative error of the board's square size.

    Parameters
    ----------
    draws
        Parameters in the order of ``shared_names``.
    uncertainty
        Relative standard deviation of the size of the squares, which corners cannot determine.
    rng
        Random-number generator.
    """
    if uncertainty == 0.0:
        return draws
    # Larger squares enlarge every length in the same ratio, and change neither angles nor images.
    scaled = draws.copy()
    scaled[:, TRANSLATION] *= 1.0 + uncertainty * rng.standard_normal((len(draws), 1))
    return scaled


def propagated(names: tuple[str, ...], sample: PosteriorSample) -> CalibrationDraws:
    """The draws of these parameters to propagate and save."""
    columns = [sample.names.index(name) for name in names]
    draws = np.ascontiguousarray(sample.thinned(min(MOST_DRAWS, len(sample.draws)))[:, columns])
    return CalibrationDraws(names=names, draws=draws, reference=draws.mean(axis=0))

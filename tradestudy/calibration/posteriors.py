"""Calibrations inferred from a simulated target or from the corners of a real rig."""

from __future__ import annotations

from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import cast

import numpy as np

from tradestudy.calibration.calibration_file import CalibrationDraws
from tradestudy.calibration.corners.corner_file import StereoCorners, read_corners
from tradestudy.calibration.corners.real_rig import RigFit, fit_rig
from tradestudy.calibration.corners.rig_geometry import check_geometry, check_inside
from tradestudy.calibration.corners.rig_posterior import sample_rig
from tradestudy.calibration.corners.trust import CalibrationTrust, examine
from tradestudy.calibration.corners.view_blocks import TRANSLATION, shared_names
from tradestudy.calibration.posterior.laplace import LaplaceCheck, LaplaceFit
from tradestudy.calibration.posterior.sampling import PosteriorSample
from tradestudy.calibration.posterior_file import rig_calibration
from tradestudy.calibration.projection import RADIAL_LENS, FreeLens
from tradestudy.calibration.sources import CALIBRATION, declared_groups, group_of_draws
from tradestudy.calibration.target.camera_target import TargetToInfer, target_problem
from tradestudy.calibration.target.target_inference import fit_target, sample_target
from tradestudy.cameras.calibration import Calibration
from tradestudy.cameras.calibration_declaration import CalibrationPart, CornersPart
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cameras.pair_geometry import PairGeometry
from tradestudy.declarations.lens_models import FittedLensModel
from tradestudy.errors import TradestudyError
from tradestudy.execution.point_progress import part_of_point, tell
from tradestudy.optics.arrays import FloatArray
from tradestudy.uncertainty.streams import point_generator

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
    found = sample_target(problem, fit, rng=rng, maximum_steps=request.part.max_steps)
    posterior = propagated(problem.priors.names, found.sample)
    group = group_of_draws(CALIBRATION, posterior.names, posterior.draws)
    return InferredCalibration(
        calibration=Calibration(groups=(group,), source="target"),
        posterior=posterior,
        sample=found.sample,
        check=found.check,
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
    fit, normal = _fitted(request, corners_of(request))
    lens, names = fit.corners.lens, normal.names
    tell(_FITTED)
    rng = point_generator(seed=request.seed, point=f"corners/{request.name}", replicate=0)
    with part_of_point(_LOADED, _CHECKED):
        found = sample_rig(fit, rng=rng, maximum_steps=request.part.max_steps)
    draws_kept = propagated(names, found.sample)
    posterior = replace(
        draws_kept,
        draws=with_square_size(draws_kept.draws, request.part.square_size_uncertainty, rng),
        best=found.sample.draws[:, : len(names)].mean(axis=0),
        lens=lens,
        pixels=(rig.sensor.columns, rig.sensor.rows),
    )
    return InferredCalibration(
        calibration=rig_calibration(rig, posterior, source="corners"),
        posterior=posterior,
        sample=found.sample,
        check=found.check,
        laplace_deviation=np.concatenate([normal.standard_deviation, fit.warp_deviation, [np.nan, np.nan]]),
        laplace_seconds=fit.explained.seconds,
        prior_deviation=np.full(len(found.sample.names), np.inf),
        fit=fit,
        trust=examine(fit, (rig.sensor.columns, rig.sensor.rows), others=[*map(lens_of, request.part.compared_with)]),
    )


def check_corners(request: CornersToInfer) -> None:
    """Refuse corners as `infer_from_corners` does, without sampling.

    A fit to a few views decides whether all are fitted, which takes longer and gives the verdict. A contradiction that
    few views do not show is left to the run.

    Raises
    ------
    TradestudyError
        See `infer_from_corners`.
    """
    corners = corners_of(request)
    rows = np.unique(np.linspace(0, len(corners.views) - 1, _FEW_VIEWS).round().astype(int))
    few = replace(
        corners,
        views=tuple(corners.views[row] for row in rows),
        **{name: getattr(corners, name)[rows] for name in ("board", "left", "right", "present")},
    )
    try:
        _fitted(request, few)
    except TradestudyError:
        _fitted(request, corners)


def _fitted(request: CornersToInfer, corners: StereoCorners) -> tuple[RigFit, LaplaceFit]:
    """The fit to the corners and its normal approximation, which do not contradict the declared rig."""
    rig, lens = cast(PairGeometry, request.camera), lens_of(request.part.lens_model)
    fit = fit_rig(replace(corners, lens=lens))
    normal = LaplaceFit(names=shared_names(lens.free), mean=fit.explained.shared, covariance=fit.covariance)
    draws = normal.draw(np.random.default_rng(0), _CHECKED_DRAWS)
    check_geometry(request.name, rig, normal.mean, draws, says="corners say", lens=lens)
    return fit, normal


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
    scaled = draws.copy()
    scaled[:, TRANSLATION] *= 1.0 + uncertainty * rng.standard_normal((len(draws), 1))
    return scaled


def propagated(names: tuple[str, ...], sample: PosteriorSample) -> CalibrationDraws:
    """The draws of these parameters to propagate and save."""
    columns = [sample.names.index(name) for name in names]
    draws = sample.thinned(min(MOST_DRAWS, len(sample.draws)))[:, columns]
    return CalibrationDraws(names=names, draws=np.ascontiguousarray(draws))

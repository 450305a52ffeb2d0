"""Depths that calibrated cameras read, beside the intervals that the program states for them: which ones cover?

A calibration is repeated with truths from the priors. The program says how far depth may be off; what the true camera
sees, and what the calibration reads of it, comes from `plain_cameras` or `plain_pair`. Intervals are compared in
inverse depth, where those that reach infinity have two ends too.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from tests.calibration import cameras, plain_cameras, plain_pair
from tests.calibration.radial_rig import SHARED_NAMES
from tests.calibration.random_poses import tilted_poses
from tests.calibration.trials import CalibrationTrial, normal_priors
from tests.data.simulate_corners import NOISE_PX, pictures, true_rig
from tradestudy.calibration.calibration_file import CalibrationDraws
from tradestudy.calibration.camera_target import fit_target, observer, sample_target
from tradestudy.calibration.corners.corner_file import StereoCorners
from tradestudy.calibration.corners.real_rig import fit_rig
from tradestudy.calibration.laplace import LaplaceFit
from tradestudy.calibration.posterior_file import posterior_of_file, rig_calibration, write_posterior
from tradestudy.calibration.posteriors import sample_rig
from tradestudy.calibration.projection import move
from tradestudy.calibration.sources import CALIBRATION, group_of_draws
from tradestudy.calibration.synthetic_target import SyntheticTarget, flat_grid
from tradestudy.cameras.calibration import Calibration
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.optics.arrays import BoolArray, FloatArray

COVERAGES = (0.6827, 0.95)
DRAWS = 2000


@dataclass(frozen=True, kw_only=True)
class DepthCase:
    """One kind of camera.

    Parameters
    ----------
    camera
        Its design.
    plain
        The same in plain numpy.
    errors
        Standard deviations of what is in error where no source says more, and of the priors of a target.
    noise
        Standard deviation of one disparity [m].
    near, far
        Distances [m]: where depth is near linear, and where more than 5 % of the readings fail, by `errors`.
    far_calibrated
        The same after a calibration on a target.
    board
        Rows and columns, spacing [m], nearest and farthest distance of a target [m].
    """

    camera: DepthCamera
    plain: plain_cameras.PlainDepth
    errors: Mapping[str, float]
    noise: float
    near: float
    far: float
    far_calibrated: float
    board: tuple[int, float, float, float]

    @property
    def deviations(self) -> FloatArray:
        """In the order of the names."""
        return np.array(list(self.errors.values()))

    def trial(self) -> CalibrationTrial:
        """A target shown to this camera in eight views, held by hand."""
        side, spacing, nearest, farthest = self.board
        names = tuple(self.errors)
        return CalibrationTrial(
            target=SyntheticTarget(
                points=flat_grid(side, side, spacing),
                poses=tilted_poses(8, (nearest, farthest), 0.1, 0.3, np.random.default_rng(0)),
                noise=self.camera.target_noise_px(0.1),
            ),
            model=observer(self.camera, names),
            priors=normal_priors(names, np.zeros(len(names)), self.deviations),
            measurement=lambda truth, draws, distances: np.empty((len(draws), len(distances))),
            distances=np.array([self.near, self.far_calibrated]),
        )


_PLENOPTIC = {"mla_distance": 5e-6, "focal_length": 5e-6, "microlens_gap": 2e-6}
CASES: Mapping[str, Callable[[], DepthCase]] = {
    "stereo": lambda: DepthCase(
        camera=cameras.stereo(),
        plain=plain_cameras.stereo,
        errors={
            "yaw": np.radians(0.2), "pitch": np.radians(0.2), "roll": np.radians(0.2), "baseline": 1e-4,
            "left_focal_length": 1e-5, "right_focal_length": 1e-5, "right_principal_point_x": 1e-5,
        },
        noise=1e-6,
        near=0.5,
        far=25.0,
        far_calibrated=600.0,
        board=(4, 0.1, 0.8, 2.5),
    ),
    "focused": lambda: DepthCase(
        camera=cameras.focused(),
        plain=plain_cameras.focused,
        errors=_PLENOPTIC,
        noise=0.55e-6,
        near=0.25,
        far=12.0,
        far_calibrated=12.0,
        board=(4, 0.02, 0.16, 0.6),
    ),
    "unfocused": lambda: DepthCase(
        camera=(camera := cameras.unfocused()),
        plain=partial(plain_cameras.unfocused, pixels_apart=camera.pixels_apart),
        errors=_PLENOPTIC,
        noise=12.65e-6,
        near=0.15,
        far=4.0,
        far_calibrated=4.0,
        board=(5, 0.02, 0.13, 0.3),
    ),
}  # fmt: skip


def by_errors(case: DepthCase, trials: int, seed: int) -> BoolArray:
    """Calibrations that are off by what is declared, without a source; shape (trials, coverages · distances)."""
    rng = np.random.default_rng(seed)
    distances = np.array([case.near, case.far])
    drawn = rng.standard_normal((2**16, len(case.errors))) * case.deviations
    stated = _read(case.camera, dict(zip(case.errors, drawn.T[..., None], strict=True)), distances, case.noise, rng)
    assert np.mean(stated[:, 1] <= 0.0) > 0.05  # far from linear
    off = dict(zip(case.errors, (rng.standard_normal((trials, len(case.errors))) * case.deviations).T, strict=True))
    believed = {name: value[:, None] for name, value in off.items()}
    read = case.plain({}, believed, distances, case.noise * rng.standard_normal((trials, 2)))
    return _covered(stated, read)


def by_target(
    case: DepthCase, rng: np.random.Generator, *, sampled: bool = False, folder: Path | None = None
) -> BoolArray:
    """One calibration on a target, by its normal approximation or by emcee; through a file where there is a folder."""
    trial = case.trial()
    truth, problem = trial.observe(rng)
    fit = fit_target(problem)
    draws = sample_target(problem, fit, rng=rng).sample.thinned(DRAWS) if sampled else fit.laplace.draw(rng, DRAWS)
    names = tuple(case.errors)
    calibration = Calibration(groups=(group_of_draws(CALIBRATION, names, draws),))
    if folder is not None:
        saved = CalibrationDraws(names=names, draws=draws, reference=draws.mean(axis=0))
        write_posterior(folder / "posterior.nc", saved)
        calibration = posterior_of_file(folder / "posterior.nc", "camera", case.camera)
    (group,) = calibration.groups
    errors = dict(zip(names, group.draw(rng.standard_normal((group.dimensions, DRAWS)))[..., None], strict=True))
    stated = _read(case.camera, errors, trial.distances, case.noise, rng)
    true, believed = (
        {name: np.full((1, 1), value) for name, value in zip(names, values, strict=True)}
        for values in (truth, draws.mean(axis=0))
    )
    read = case.plain(true, believed, trial.distances, case.noise * rng.standard_normal((1, 2)))
    return _covered(stated, read)[0, :]


def by_corners(rng: np.random.Generator, *, sampled: bool = False) -> BoolArray:
    """One calibration from the corners of eight views of a board by a rig drawn about the simulated one."""
    spread = np.array([2.0, 2.0, 5.0, 5.0, 0.01, 0.01] * 2 + [2e-3] * 3 + [2e-4] * 3)
    truth = true_rig() + spread * rng.standard_normal(18)
    fit = fit_rig(_corners(truth, rng))
    if sampled:
        posterior = sample_rig(fit, rng=rng)
        draws = posterior.sample.thinned(DRAWS)[:, :18]
    else:
        draws = LaplaceFit(names=SHARED_NAMES, mean=fit.explained.shared, covariance=fit.covariance).draw(rng, DRAWS)
    best = draws.mean(axis=0)
    saved = CalibrationDraws(names=SHARED_NAMES, draws=draws, best=best, pixels=(1024, 1024))
    camera = cameras.stereo()
    calibration = rig_calibration(camera, saved, source="corners")
    (group,), distances = calibration.groups, np.array([0.6, 500.0])
    errors = dict(zip(SHARED_NAMES, group.draw(rng.standard_normal((group.dimensions, DRAWS)))[..., None], strict=True))
    errors["pixel_noise"] = 1e-6 * rng.standard_normal((DRAWS, 2))
    assert calibration.measurement is not None
    stated = calibration.measurement(distances, 0.0, errors, None).inverse_depth
    points = np.stack([np.full(2, 0.05), np.zeros(2), distances], axis=-1)
    seen = pictures(truth, points) + 0.1 * rng.standard_normal((2, 1)) * np.array([0.5, 0.0, -0.5, 0.0])
    read = np.array([plain_pair.inverse_depth_read(best, place) for place in seen])
    return _covered(stated, read[None])[0, :]


def _corners(rig: FloatArray, rng: np.random.Generator) -> StereoCorners:
    """Eight views of a board of 6 × 5 corners, from 0.5 to 1.5 m, with the noise of the simulated file."""
    board = flat_grid(6, 5, 0.06)
    poses = tilted_poses(8, (0.5, 1.5), 0.15, 0.4, rng)
    seen = np.stack([pictures(rig, points) for points in move(poses, board)])
    seen = seen + NOISE_PX * rng.standard_normal(seen.shape)
    return StereoCorners(
        views=tuple(range(8)),
        board=np.broadcast_to(board[:, :2], (8, 30, 2)),
        left=seen[..., :2],
        right=seen[..., 2:],
        present=np.ones((8, 30), dtype=bool),
    )


def _read(
    camera: DepthCamera, errors: dict[str, FloatArray], distances: FloatArray, noise: float, rng: np.random.Generator
) -> FloatArray:
    """Inverse depths that the program reads under draws of errors and noise, shape (draws, D)."""
    drawn = noise * rng.standard_normal((len(next(iter(errors.values()))), distances.size))
    return camera.read(distances, 0.0, {**errors, "pixel_noise": drawn}).inverse_depth


def _covered(stated: FloatArray, read: FloatArray) -> np.ndarray[tuple[int, int], np.dtype[np.bool_]]:
    """Whether readings (trials, D) lie in the central intervals of the stated draws, shape (trials, coverages · D)."""
    found = []
    for coverage in COVERAGES:
        low, high = np.quantile(stated, [(1.0 - coverage) / 2.0, (1.0 + coverage) / 2.0], axis=0)
        found.append((low <= read) & (read <= high))
    return np.concatenate(found, axis=-1)

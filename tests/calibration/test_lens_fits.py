"""Fits of corners with lenses of every model: against OpenCV where it has the model, and against simulated truths."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.calibration.cameras import stereo
from tests.calibration.noisy_corners import COLUMNS, ROWS, SQUARE
from tradestudy.calibration import posteriors
from tradestudy.calibration.corners import trust
from tradestudy.calibration.corners.bundle_adjustment import fit_camera, fit_pair
from tradestudy.calibration.corners.corner_file import StereoCorners
from tradestudy.calibration.corners.real_rig import RigFit, fit_rig
from tradestudy.calibration.corners.trust import compare_lenses
from tradestudy.calibration.corners.view_blocks import board_points, shared_names
from tradestudy.calibration.posterior_file import posterior_of_file, write_posterior
from tradestudy.calibration.posteriors import infer, to_infer
from tradestudy.calibration.projection import FreeLens, move, project
from tradestudy.calibration.synthetic_target import flat_grid
from tradestudy.cameras.calibration_declaration import calibration_part
from tradestudy.cameras.parts import Lens, Sensor
from tradestudy.errors import NotConvergedError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.lens_families import (
    STARTS,
    DoubleSphere,
    ExtendedUnified,
    FieldOfView,
    KannalaBrandt,
    Omnidirectional,
)
from tradestudy.optics.lens_model import LensModel, Rational

SIZE = (640, 480)
CAMERA = np.array([310.0, 312.0, 322.0, 236.0])
WIDE = np.array([205.0, 206.0, 322.0, 236.0])
"""Models that only a wide field distinguishes: their focal length compensates for much."""
FIVE = ("k1", "k2", "p1", "p2", "k3")
EIGHT = (*FIVE, "k4", "k5", "k6")
FISHEYE = ("k1", "k2", "k3", "k4")
TRUE = {
    "five": (Rational(k1=-0.28, k2=0.09, p1=1e-3, p2=-5e-4, k3=-0.012), FIVE),
    "eight": (Rational(k1=0.9, k2=0.2, p1=1e-3, p2=-5e-4, k3=0.02, k4=1.2, k5=0.45, k6=0.05), EIGHT),
    "fisheye": (KannalaBrandt(k1=-0.03, k2=0.012, k3=-0.006, k4=0.001), FISHEYE),
    "fov": (FieldOfView(w=0.95), ("w",)),
    "omni": (Omnidirectional(xi=0.8, p1=5e-4), ("xi", "p1", "p2")),
    "double-sphere": (DoubleSphere(xi=-0.15, alpha=0.58), ("xi", "alpha")),
    "eucm": (ExtendedUnified(alpha=0.6, beta=1.1), ("alpha", "beta")),
}
POSE = np.array([0.004, -0.006, 0.003, -0.08, 1e-3, -2e-3])


def start_of(lens: LensModel, free: tuple[str, ...]) -> FreeLens:
    """What a study that names the model and the fitted coefficients starts from."""
    return FreeLens(model=type(lens)(**STARTS.get(lens.name, {})), free=free)


def camera_of(lens: LensModel) -> np.ndarray:
    return WIDE if isinstance(lens, DoubleSphere | Omnidirectional) else CAMERA


def intrinsics(lens: LensModel, free: tuple[str, ...]) -> np.ndarray:
    return np.array([*camera_of(lens), *(getattr(lens, name) for name in free)])


def shown(lens: LensModel, rng: np.random.Generator, views: int = 16) -> tuple[np.ndarray, np.ndarray]:
    """A board held all over the picture, and where it is seen whole; poses and places [px]."""
    grid = flat_grid(COLUMNS, ROWS, SQUARE)
    poses, images = [], []
    while len(poses) < views:
        z, wide = (rng.uniform(0.16, 0.4), 0.9) if camera_of(lens) is CAMERA else (rng.uniform(0.07, 0.3), 2.5)
        pose = np.array([*(0.35 * rng.standard_normal(3)), *(rng.uniform(-wide, wide, 2) * z), z])
        image = project(camera_of(lens), move(pose, grid), lens, ())
        if np.all((image > 2.0) & (image < np.array(SIZE) - 3.0)):
            poses.append(pose)
            images.append(image)
    return np.array(poses), np.array(images)


def board_like(image: np.ndarray) -> np.ndarray:
    return np.broadcast_to(flat_grid(COLUMNS, ROWS, SQUARE)[:, :2], image.shape)


@pytest.mark.parametrize("which", sorted({*TRUE} - {"eight"}))
def test_corners_without_noise_give_the_lens_back(which: str) -> None:
    lens, free = TRUE[which]
    _, image = shown(lens, np.random.default_rng(1))
    fit = fit_camera(board_like(image), image, np.ones(image.shape[:2], dtype=bool), lens=start_of(lens, free))
    assert fit.corner_rms_px < 1e-6
    np.testing.assert_allclose(fit.intrinsics[:4], camera_of(lens), rtol=1e-5)


@pytest.mark.parametrize("which", ["five", "eight", "fisheye"])
def test_fits_equal_those_of_opencv(which: str) -> None:
    """Parameters to a fiftieth of their standard deviations; OpenCV starts where the truth is."""
    lens, free = TRUE[which]
    rng = np.random.default_rng(2)
    _, image = shown(lens, rng)
    image = image + 0.1 * rng.standard_normal(image.shape)
    fit = fit_camera(board_like(image), image, np.ones(image.shape[:2], dtype=bool), lens=start_of(lens, free))
    points = [board_points(one) for one in board_like(image)]
    matrix = np.array([[310.0, 0.0, 322.0], [0.0, 312.0, 236.0], [0.0, 0.0, 1.0]])
    known = np.array([getattr(lens, name) for name in free])
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 1000, 1e-16)
    if which == "fisheye":
        flags = cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_RECOMPUTE_EXTRINSIC | cv2.CALIB_FIX_SKEW
        rms, matrix, found, *_ = cv2.fisheye.calibrate(
            [one[None] for one in points], [one[None] for one in image], SIZE, matrix, known, flags=flags,
            criteria=criteria,
        )  # fmt: skip
    else:
        flags = cv2.CALIB_USE_INTRINSIC_GUESS | (cv2.CALIB_RATIONAL_MODEL if which == "eight" else 0)
        rms, matrix, found, *_ = cv2.calibrateCamera(
            [one.astype(np.float32) for one in points], [one.astype(np.float32)[:, None] for one in image], SIZE,
            matrix, known, flags=flags, criteria=criteria,
        )  # fmt: skip
    expected = np.array([*matrix[[0, 1, 0, 1], [0, 1, 2, 2]], *found.ravel()[: len(free)]])
    deviation = np.sqrt(np.diag(fit.covariance))
    assert fit.corner_rms_px == pytest.approx(rms, rel=1e-4)
    off = fit.intrinsics - expected
    np.testing.assert_allclose(off / deviation, 0.0, atol=0.02)
    assert off @ np.linalg.solve(fit.covariance, off) < 0.05**2


@pytest.mark.parametrize("which", ["five", "fisheye", "double-sphere"])
@pytest.mark.slow
def test_fits_scatter_as_they_state(which: str) -> None:
    """100 sets of white noise: errors over stated deviations have the variance of 1 that 100 sets can show."""
    lens, free = TRUE[which]
    _, image = shown(lens, np.random.default_rng(3), views=8)
    present, start = np.ones(image.shape[:2], dtype=bool), start_of(lens, free)
    truth, scores, whole = intrinsics(lens, free), [], []
    for seed in range(100):
        noisy = image + 0.1 * np.random.default_rng([seed, 9]).standard_normal(image.shape)
        fit = fit_camera(board_like(image), noisy, present, lens=start)
        error = fit.intrinsics - truth
        scores.append(error / np.sqrt(np.diag(fit.covariance)))
        whole.append(error @ np.linalg.solve(fit.covariance, error))
    stated = 1.0 / np.sqrt(np.mean(np.square(scores), axis=0))
    assert 0.9 < np.median(stated) < 1.1
    # χ² of 100 n degrees of freedom
    assert np.mean(whole) / len(truth) == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / (100 * len(truth))))


@pytest.mark.parametrize("which", ["five", "fisheye", "omni"])
def test_pairs_find_both_lenses_and_their_pose(which: str) -> None:
    lens, free = TRUE[which]
    rng = np.random.default_rng(4)
    poses, left = shown(lens, rng)
    right = project(camera_of(lens), move(POSE, move(poses, flat_grid(COLUMNS, ROWS, SQUARE))), lens, ())
    noise = 0.1 * rng.standard_normal((2, *left.shape))
    present = np.all(np.isfinite(right), axis=-1)
    corners = StereoCorners(
        views=tuple(range(len(poses))), board=board_like(left).copy(), left=left + noise[0],
        right=np.nan_to_num(right + noise[1]), present=present, lens=start_of(lens, free),
    )  # fmt: skip
    cameras = [fit_camera(corners.board, side, present, lens=corners.lens) for side in (corners.left, corners.right)]
    fit = fit_pair(corners, *cameras)
    error = fit.shared - np.concatenate([intrinsics(lens, free)] * 2 + [POSE])
    assert error @ np.linalg.solve(fit.covariance, error) < len(error) + 4.0 * np.sqrt(2.0 * len(error))
    assert fit.noise_px == pytest.approx(0.1, rel=0.05)


def test_more_coefficients_than_the_corners_determine_are_refused_with_a_remedy() -> None:
    """Near the axis of a lens without distortion, k1 and k4 do the same, and so do the others."""
    grid, rng = flat_grid(COLUMNS, ROWS, SQUARE), np.random.default_rng(5)
    poses = np.column_stack([0.35 * rng.standard_normal((8, 3)), np.zeros((8, 2)), rng.uniform(0.9, 1.2, 8)])
    image = project(CAMERA, move(poses, grid), Rational(), ()) + 0.1 * rng.standard_normal((8, COLUMNS * ROWS, 2))
    lens = FreeLens(model=Rational(), free=EIGHT)
    with pytest.raises(NotConvergedError, match=r"fix a parameter|fewer coefficients"):
        fit_camera(board_like(image), image, np.ones(image.shape[:2], dtype=bool), lens=lens)


def seen_by_both(lens: LensModel, views: int = 12) -> StereoCorners:
    """Corners that a true pair sees, with white noise and boards that shift between the exposures."""
    rng = np.random.default_rng(8)
    poses, left = shown(lens, rng, views)
    moved = move(POSE, move(poses, flat_grid(COLUMNS, ROWS, SQUARE))) + 1e-4 * rng.standard_normal((views, 1, 3))
    right = project(camera_of(lens), moved, lens, ())
    inside = np.all((right > 0.0) & (right < np.array(SIZE) - 1.0), axis=-1)
    noise = 0.1 * rng.standard_normal((2, *left.shape))
    kept = inside.sum(axis=1) > 30
    return StereoCorners(
        views=tuple(range(int(kept.sum()))),
        board=board_like(left)[kept],
        left=(left + noise[0])[kept],
        right=np.nan_to_num(right + noise[1])[kept],
        present=inside[kept],
    )


def test_the_corners_reveal_their_lens_model(monkeypatch: pytest.MonkeyPatch) -> None:
    """Corners of a fisheye lens: fitted with two radial terms, they call for the fisheye model, and it moves depth.

    A model that cannot be fitted is named, and does not keep the others from being compared.
    """
    lens, free = TRUE["fisheye"]
    corners, z = seen_by_both(lens), np.array([0.3, 1.0])
    right, impossible = start_of(lens, free), start_of(ExtendedUnified(alpha=0.5, beta=1.0), ("alpha", "beta"))
    fitted = trust._fitted

    def refusing(fit: RigFit, lens: FreeLens, seen: FloatArray) -> object:
        if lens is impossible:
            raise NotConvergedError("the views do not determine alpha")
        return fitted(fit, lens, seen)

    monkeypatch.setattr(trust, "_fitted", refusing)
    *_, failed, called_for = compare_lenses(fit_rig(corners), z, [impossible, right]).values()
    assert failed.failure == "the views do not determine alpha"
    assert np.isnan([failed.support, *failed.depth_change]).all()
    assert not called_for.failure
    assert called_for.support > 2.0 * called_for.support_deviation
    assert np.any(np.abs(called_for.depth_change) > 3.0 * called_for.depth_change_deviation)
    found = compare_lenses(fit_rig(replace(corners, lens=right)), z, [FreeLens()])
    (not_called_for,) = found.values()
    assert not_called_for.support < -2.0 * not_called_for.support_deviation


def test_a_calibration_with_a_declared_lens_model_is_saved_and_read_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From a declaration to the depth that is read: the draws of all coefficients, and the file of them."""
    monkeypatch.setattr(posteriors, "CHECKED_POINTS", 20)  # test_relative_pose_posterior.py is about that check
    lens, free = TRUE["fisheye"]
    corners = seen_by_both(lens)
    with (tmp_path / "corners.csv").open("w") as file:
        file.write("view,corner,board_x_m,board_y_m,left_x_px,left_y_px,right_x_px,right_y_px\n")
        for view, corner in zip(*np.nonzero(corners.present), strict=True):
            row = [*corners.board[view, corner], *corners.left[view, corner], *corners.right[view, corner]]
            file.write(f"{view},{corner},{','.join(f'{value:.9g}' for value in row)}\n")
    camera = stereo(
        lens=Lens(focal_length=311.0 * 3e-6, f_number=2.8),
        sensor=Sensor(columns=SIZE[0], rows=SIZE[1], pixel_pitch=3e-6),
        baseline=0.08,
    )
    said = {"file": "corners.csv", "lens_model": {"model": "kannala-brandt"}, "max_steps": 100}
    part = calibration_part(type(camera), "stereo")(corners=said)
    asked = to_infer("rig", camera, part, folder=tmp_path, seed=0)
    assert asked is not None
    found = infer(asked)
    assert found.posterior.names == shared_names(free)
    truth = np.concatenate([intrinsics(lens, free)] * 2 + [POSE])
    off = (found.posterior.best - truth) / found.posterior.draws.std(axis=0)
    assert np.max(np.abs(off)) < 4.5
    write_posterior(tmp_path / "rig.nc", found.posterior)
    again = posterior_of_file(tmp_path / "rig.nc", "rig", camera)
    z, none = np.array([0.3, 1.0]), {}
    assert found.calibration.measurement is not None
    for field in (0.0, 0.7):
        read = [one.measurement(z, field, none, None).inverse_depth for one in (found.calibration, again)]
        np.testing.assert_allclose(read[0], 1.0 / z[None], rtol=1e-9)
        np.testing.assert_array_equal(read[1], read[0])
    errors = {"left_radial_distortion_k3": np.full((1, 1), 1e-2)}
    changed = found.calibration.measurement(z, 0.9, errors, None).inverse_depth
    assert np.all(np.abs(changed * z - 1.0) > 1e-5)


def test_fixed_coefficients_stay() -> None:
    lens = TRUE["five"][0]
    _, image = shown(lens, np.random.default_rng(6))
    held = FreeLens(model=replace(lens, k1=0.0, k2=0.0), free=("k1", "k2"))
    fit = fit_camera(board_like(image), image, np.ones(image.shape[:2], dtype=bool), lens=held)
    np.testing.assert_allclose(fit.intrinsics, intrinsics(lens, ("k1", "k2")), rtol=1e-6)


def test_a_coefficient_that_a_fit_drives_out_of_its_range_is_named_as_such() -> None:
    """The corners of a lens without distortion say nothing about w but that it is small."""
    lens, camera, rng = Rational(), np.array([800.0, 800.0, 320.0, 240.0]), np.random.default_rng(3)
    grid = flat_grid(COLUMNS, ROWS, SQUARE)
    poses = np.array([[*(0.3 * rng.standard_normal(3)), *rng.uniform(-0.05, 0.05, 2), 0.6] for _ in range(12)])
    left, right = (
        project(camera, move(relative, move(poses, grid)), lens, ()) + 0.25 * rng.standard_normal((12, len(grid), 2))
        for relative in (np.zeros(6), POSE)
    )
    corners = StereoCorners(
        views=tuple(range(12)),
        board=board_like(left),
        left=left,
        right=right,
        present=np.ones(left.shape[:2], dtype=bool),
        lens=start_of(FieldOfView(w=0.5), ("w",)),
    )
    with pytest.raises(NotConvergedError) as caught:
        fit_rig(corners)
    assert "correct the coefficient" not in str(caught.value)
    assert re.search(r"fit fewer coefficients", str(caught.value))

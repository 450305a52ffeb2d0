"""The measured rig against OpenCV, covariances against dense algebra, fits against synthetic truths."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.calibration.radial_rig import SHARED_NAMES
from tests.calibration.random_poses import tilted_poses
from tradestudy.calibration.corners.bundle_adjustment import (
    check_rig,
    fit_camera,
    fit_pair,
    marginal_information,
)
from tradestudy.calibration.corners.corner_file import CornerFileError, StereoCorners, read_corners
from tradestudy.calibration.corners.view_blocks import (
    RELATIVE,
    board_points,
    camera_blocks,
    cameras_of,
    first_intrinsics,
    pair_blocks,
)
from tradestudy.calibration.laplace import covariance_from_information
from tradestudy.calibration.projection import move, project
from tradestudy.calibration.synthetic_target import flat_grid

FILE = Path(__file__).parents[2] / "studies" / "data" / "stereo_chessboard_corners.csv"
IMAGE_SIZE = (640, 360)


@pytest.fixture(scope="module")
def rig():
    corners = read_corners(FILE)
    left = fit_camera(corners.board, corners.left, corners.present)
    right = fit_camera(corners.board, corners.right, corners.present)
    return corners, left, right, fit_pair(corners, left, right)


def opencv_views(corners):
    board = [board_points(view).astype(np.float32) for view in corners.board]
    return board, [list(side.astype(np.float32)[:, :, None]) for side in (corners.left, corners.right)]


@pytest.mark.parametrize("side", [0, 1])
def test_single_cameras_equal_opencv(rig, side):
    cv2 = pytest.importorskip("cv2")
    board, images = opencv_views(rig[0])
    flags = cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K3
    rms, camera, distortion, _, _, deviations, *_ = cv2.calibrateCameraExtended(
        board, images[side], IMAGE_SIZE, None, None, flags=flags, criteria=(3, 500, 1e-14)
    )
    fit = rig[1 + side]
    expected = np.array([camera[0, 0], camera[1, 1], camera[0, 2], camera[1, 2], *distortion.ravel()[:2]])
    # the same maximum likelihood: far closer than the 10 % that would do
    deviation = np.sqrt(np.diag(fit.covariance))
    np.testing.assert_allclose((fit.intrinsics - expected) / deviation, 0.0, atol=2e-3)
    np.testing.assert_allclose(deviation, deviations.ravel()[:6], rtol=1e-3)
    assert fit.corner_rms_px == pytest.approx(rms, rel=1e-4)


def test_the_pair_equals_opencv(rig):
    cv2 = pytest.importorskip("cv2")
    corners, left, right, pair = rig
    board, images = opencv_views(corners)

    def camera(v):
        return np.array([[v[0], 0, v[2]], [0, v[1], v[3]], [0, 0, 1.0]]), np.array([v[4], v[5], 0.0, 0.0, 0.0])

    flags = cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K3
    found = cv2.stereoCalibrateExtended(
        board, *images, *camera(left.intrinsics), *camera(right.intrinsics), IMAGE_SIZE, np.eye(3), np.zeros((3, 1)),
        flags=flags, criteria=(3, 500, 1e-14),
    )  # fmt: skip
    rms, left_camera, left_distortion, right_camera, right_distortion, rotation, translation = found[:7]
    expected = np.concatenate(
        [
            left_camera[[0, 1, 0, 1], [0, 1, 2, 2]],
            left_distortion.ravel()[:2],
            right_camera[[0, 1, 0, 1], [0, 1, 2, 2]],
            right_distortion.ravel()[:2],
            cv2.Rodrigues(rotation)[0].ravel(),
            translation.ravel(),
        ]
    )
    deviation = np.sqrt(np.diag(pair.covariance))
    np.testing.assert_allclose((pair.shared - expected) / deviation, 0.0, atol=0.02)
    assert pair.corner_rms_px == pytest.approx(rms, rel=1e-4)


def test_residuals_are_those_published_with_the_data(rig):
    _, left, right, pair = rig
    assert left.corner_rms_px == pytest.approx(0.16, abs=0.01)
    assert right.corner_rms_px == pytest.approx(0.16, abs=0.01)
    assert pair.corner_rms_px == pytest.approx(0.24, abs=0.01)
    check_rig(pair)


@pytest.mark.parametrize(
    ("turned", "centre", "says"),
    [
        ((0.0, 0.0, 0.0), (0.005, 0.1, 0.0), "not side by side.*below"),
        ((0.0, 0.0, 0.0), (0.005, 0.0, 0.1), "not side by side"),
        ((0.0, 0.0, 0.0), (-0.1, 0.0, 0.0), "exchanged"),
        ((0.0, 0.0, 180.0), (0.1, 0.0, 0.0), r"rotated .*: 180°"),
        ((10.0, -20.0, 90.0), (0.1, 0.0, 0.0), r"rotated .*: 9"),
    ],
)
def test_cameras_that_are_not_side_by_side_are_refused(rig, turned, centre, says):
    matrix = cv2.Rodrigues(np.radians(turned))[0]
    pair = replace(rig[3], shared=np.concatenate([rig[3].shared[:12], np.radians(turned), -matrix @ centre]))
    with pytest.raises(CornerFileError, match=says):
        check_rig(pair)


def test_marginal_covariance_equals_the_dense_inverse(rig):
    corners, _, _, pair = rig
    some = slice(0, 29, 5)
    few = StereoCorners(
        views=corners.views[some],
        board=corners.board[some],
        left=corners.left[some],
        right=corners.right[some],
        present=corners.present[some],
    )
    blocks = pair_blocks(pair.shared, pair.poses[some], few)
    views, rows, count = blocks.by_shared.shape
    dense = np.zeros((views * rows, count + 6 * views))
    dense[:, :count] = blocks.by_shared.reshape(-1, count)
    for view in range(views):
        block = slice(count + 6 * view, count + 6 * view + 6)
        dense[view * rows : (view + 1) * rows, block] = blocks.by_pose[view]
    scale = np.linalg.norm(dense, axis=0)
    pseudo = np.linalg.pinv(dense / scale, rcond=1e-15)
    covariance = (pseudo @ pseudo.T)[:count, :count] / np.outer(scale[:count], scale[:count])
    marginal = covariance_from_information(marginal_information(blocks), SHARED_NAMES)
    deviation = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(
        marginal / np.outer(deviation, deviation), covariance / np.outer(deviation, deviation), atol=1e-7
    )


def pair_residuals(shared, poses, corners):
    """Left corners, then right corners, seen through the camera model without derivatives."""
    seen_left = move(poses, board_points(corners.board))
    seen_right = move(shared[RELATIVE], seen_left)
    left = corners.left - project(cameras_of(shared)[0], seen_left)
    right = corners.right - project(cameras_of(shared)[1], seen_right)
    residuals = [np.where(corners.present[..., None], one, 0.0) for one in (left, right)]
    return np.concatenate(residuals, axis=1).reshape(len(poses), -1)


def test_blocks_are_the_derivatives_of_the_residuals(rig):
    corners, _, _, pair = rig
    blocks = pair_blocks(pair.shared, pair.poses, corners)
    np.testing.assert_allclose(blocks.residuals, pair_residuals(pair.shared, pair.poses, corners), atol=1e-11)
    steps = 1e-6 * np.maximum(np.abs(pair.shared), 1e-2)
    for k in range(18):
        step = steps * (np.arange(18) == k)
        difference = pair_residuals(pair.shared - step, pair.poses, corners) - pair_residuals(
            pair.shared + step, pair.poses, corners
        )
        scale = np.abs(blocks.by_shared[..., k]).max()
        np.testing.assert_allclose(difference / (2 * steps[k]), blocks.by_shared[..., k], atol=1e-6 * scale)
    for k in range(6):
        step = 1e-7 * (np.arange(6) == k)
        difference = pair_residuals(pair.shared, pair.poses - step, corners) - pair_residuals(
            pair.shared, pair.poses + step, corners
        )
        scale = np.abs(blocks.by_pose[..., k]).max()
        np.testing.assert_allclose(difference / 2e-7, blocks.by_pose[..., k], atol=1e-6 * scale)


def synthetic_camera(noise, seed):
    rng = np.random.default_rng(seed)
    truth = np.array([800.0, 805.0, 320.0, 240.0, -0.2, 0.05])
    grid = flat_grid(8, 6, 0.03)
    poses = tilted_poses(15, (0.5, 1.0), 0.15, 0.35, rng)
    image = project(truth, move(poses, grid))
    board = np.broadcast_to(grid[:, :2], image.shape)
    return truth, board, image + noise * rng.standard_normal(image.shape), np.ones(image.shape[:2], dtype=bool)


def test_closed_form_start_is_exact_without_distortion_and_noise():
    rng = np.random.default_rng(3)
    truth = np.array([800.0, 805.0, 320.0, 240.0, 0.0, 0.0])
    grid = flat_grid(8, 6, 0.03)
    image = project(truth, move(tilted_poses(8, (0.5, 1.0), 0.15, 0.35, rng), grid))
    start = first_intrinsics(np.broadcast_to(grid[:, :2], image.shape), image, np.ones(image.shape[:2], dtype=bool))
    np.testing.assert_allclose(start, truth[:4], rtol=1e-8)


def test_noiseless_fit_finds_the_truth():
    truth, board, image, present = synthetic_camera(0.0, 0)
    np.testing.assert_allclose(fit_camera(board, image, present).intrinsics, truth, rtol=1e-7)


def test_fits_scatter_as_their_covariance_says():
    scores = []
    for seed in range(12):
        truth, board, image, present = synthetic_camera(0.2, seed)
        fit = fit_camera(board, image, present)
        error = fit.intrinsics - truth
        scores.append(error @ np.linalg.solve(fit.covariance, error))
        assert fit.noise_px == pytest.approx(0.2, rel=0.09)
    # χ² of 72 degrees: standard deviation 12
    assert abs(np.sum(scores) - 72.0) < 3.3 * 12.0


def test_parallel_boards_leave_the_focal_length_open():
    grid = flat_grid(8, 6, 0.03)
    poses = np.zeros((5, 6))
    poses[:, 3:] = [[0.01 * k, -0.02 * k, 0.5 + 0.1 * k] for k in range(5)]
    image = project(np.array([800.0, 800.0, 320.0, 240.0, 0.0, 0.0]), move(poses, grid))
    image = image + 0.1 * np.random.default_rng(0).standard_normal(image.shape)
    fit = fit_camera(np.broadcast_to(grid[:, :2], image.shape), image, np.ones(image.shape[:2], dtype=bool))
    # only noise determines the tilts: the fit must not look certain
    assert np.sqrt(fit.covariance[0, 0]) > 0.2 * fit.intrinsics[0]


def test_an_open_direction_is_named():
    grid = flat_grid(8, 6, 0.03)
    poses = np.zeros((5, 6))
    poses[:, 5] = 0.5 + 0.1 * np.arange(5)
    truth = np.array([800.0, 800.0, 320.0, 240.0, 0.0, 0.0])
    image = project(truth, move(poses, grid))
    board = np.broadcast_to(grid[:, :2], image.shape)
    information = marginal_information(camera_blocks(truth, poses, board, image, np.ones(image.shape[:2], dtype=bool)))
    # boards square to the axis cannot distinguish a shift of the principal point from one of the boards
    assert np.linalg.eigvalsh(information)[0] < 1e-9 * np.linalg.eigvalsh(information)[-1]

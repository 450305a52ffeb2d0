"""The left–right term: likelihood against dense normal densities, scale against injected motions, the measured rig."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, multivariate_normal

from tests.calibration import noisy_corners
from tests.calibration.random_poses import tilted_poses
from tests.calibration.rig_draws import depth_of_draws
from tradestudy.calibration.corners.corner_file import StereoCorners
from tradestudy.calibration.corners.pair_residual import (
    ViewStates,
    compress_views,
    exact_log_likelihood,
    gyration_radius,
)
from tradestudy.calibration.corners.real_rig import fit_rig
from tradestudy.calibration.corners.view_blocks import pair_blocks, state_blocks
from tradestudy.calibration.projection import move, project, rotation_matrix
from tradestudy.calibration.synthetic_target import flat_grid

TRUTH = np.array([460, 462, 320, 180, 0.1, -0.2, 463, 461, 325, 182, 0.1, -0.15, 0.01, 0.02, 0.01, -0.094, -1e-3, 2e-3])


@pytest.fixture(scope="module")
def rig(calibrated_webcams):
    return calibrated_webcams.fit


def shaken_rig(motion, noise, rng, views=25, columns=9):
    """Corners of a board that moves between the exposures, by full rotations and translations."""
    grid = flat_grid(columns, 6, 0.024)
    poses = tilted_poses(views, (0.35, 0.6), 0.15, 0.35, rng)
    lever = np.sqrt(np.mean(np.sum(grid**2, axis=1)))
    seen_left = move(poses, grid)
    seen_right = move(TRUTH[12:], seen_left)
    centre = seen_right.mean(axis=1, keepdims=True)
    turn = rotation_matrix(motion / lever * rng.standard_normal((views, 3)))
    shaken = (seen_right - centre) @ np.swapaxes(turn, -1, -2) + centre
    shaken = shaken + motion * rng.standard_normal((views, 1, 3))
    left, right = project(TRUTH[:6], seen_left), project(TRUTH[6:12], shaken)
    return StereoCorners(
        views=tuple(range(views)),
        board=np.broadcast_to(grid[:, :2], left.shape),
        left=left + noise * rng.standard_normal(left.shape),
        right=right + noise * rng.standard_normal(right.shape),
        present=np.ones(left.shape[:2], dtype=bool),
    )


def test_the_measured_pair_is_explained(rig):
    assert rig.pair.corner_rms_px == pytest.approx(0.24, abs=0.01)
    # view means oppose each other: what one camera sees too far left, the other sees too far right
    assert rig.means.correlation < -0.99
    size = np.sqrt(np.mean(np.sum(rig.means.left**2, axis=1)))
    assert size > 5.0 * rig.pair.noise_px / np.sqrt(54)  # no noise averages to this
    explained = rig.explained
    assert explained.left_rms_px == pytest.approx(rig.left.corner_rms_px, rel=0.1)
    assert explained.right_rms_px == pytest.approx(rig.right.corner_rms_px, rel=0.1)
    assert explained.log_likelihood_gain > 200.0
    assert 0.1e-3 < explained.motion_scale < 0.5e-3  # a hand's tremor between two exposures


def spread_over_views(rig):
    """Standard deviations by the jackknife over views of the fit without the term, over those that it claims."""
    blocks = pair_blocks(rig.pair.shared, rig.pair.poses, replace(rig.corners, noise=None, heights=None))
    basis = np.linalg.qr(blocks.by_pose)[0]
    free = blocks.by_shared - basis @ (np.swapaxes(basis, -1, -2) @ blocks.by_shared)
    squares = np.einsum("vmi,vmj->vij", free, free)
    gradients = np.einsum("vmi,vm->vi", free, blocks.residuals)
    steps = np.linalg.solve(squares.sum(axis=0) - squares, (gradients.sum(axis=0) - gradients)[..., None])[..., 0]
    variance = (len(steps) - 1) * np.var(steps, axis=0)
    return np.sqrt(variance / np.diag(rig.pair.covariance))


def test_ignoring_the_term_is_overconfident(rig):
    yaw, roll, baseline = 13, 14, 15
    assert np.all(rig.explained.overconfidence[[yaw, roll, baseline]] > [1.1, 3.0, 3.0])
    # Leaving out views in turn, which knows nothing of motions, says the same of the roll.
    assert rig.explained.overconfidence[roll] == pytest.approx(spread_over_views(rig)[roll], rel=0.15)
    rng = np.random.default_rng(0)
    distances = np.array([0.3, 1.0, 3.0])

    def width(fit):
        draws = rng.multivariate_normal(fit.shared, fit.covariance, 4000, method="cholesky")
        return np.subtract(*np.quantile(depth_of_draws(fit.shared, draws, distances), [0.975, 0.025], axis=0))

    # the 95 % depth interval claimed without the term is up to four times too narrow
    assert np.all(width(rig.explained) / width(rig.pair) > [1.2, 2.5, 3.0])


def test_compressed_likelihood_equals_a_dense_normal_density():
    """Poses as very wide normal effects, motions as normal effects: one multivariate density per view."""
    rng = np.random.default_rng(5)
    corners = shaken_rig(2e-4, 0.1, rng, views=3, columns=4)
    poses = tilted_poses(3, (0.35, 0.6), 0.15, 0.35, np.random.default_rng(5))
    states = ViewStates(poses=poses, motions=2e-4 * rng.standard_normal((3, 6)))
    lever = gyration_radius(corners)
    compressed = compress_views(TRUTH, states, corners, lever)
    blocks, motion = pair_blocks(TRUTH, poses, corners), state_blocks(TRUTH, poses, corners, lever)[1][..., 6:]
    wide = 1e3 / np.linalg.norm(blocks.by_pose, axis=(0, 1))

    def dense(shared, noise, scale):
        total = 0.0
        for view in range(3):
            effects = np.hstack([blocks.by_pose[view] * wide, motion[view] * scale])
            covariance = noise**2 * np.eye(effects.shape[0]) + effects @ effects.T
            mean = blocks.by_shared[view] @ (shared - TRUTH)
            total += multivariate_normal.logpdf(blocks.residuals[view], mean, covariance)
        return total

    step = 1e-3 * rng.standard_normal(18) * np.maximum(np.abs(TRUTH), 0.1)
    cases = [(TRUTH, 0.1, 2e-4), (TRUTH + step, 0.1, 2e-4), (TRUTH, 0.15, 2e-4), (TRUTH, 0.1, 5e-4)]
    expected = np.array([dense(*case) for case in cases])
    found = np.array([compressed.log_likelihood(s, np.array(n), np.array(t)) for s, n, t in cases])
    np.testing.assert_allclose(found - found[0], expected - expected[0], rtol=1e-5, atol=1e-3)


def test_restricted_likelihood_of_scales_equals_a_dense_one():
    """Harville's: one normal density with poses and shared parameters as regressors, up to the same constant."""
    rng = np.random.default_rng(5)
    corners = shaken_rig(8e-4, 0.15, rng, views=5, columns=4)
    poses = tilted_poses(5, (0.35, 0.6), 0.15, 0.35, np.random.default_rng(5))
    states = ViewStates(poses=poses, motions=np.zeros((5, 6)))
    lever = gyration_radius(corners)
    compressed = compress_views(TRUTH, states, corners, lever)
    blocks = pair_blocks(TRUTH, poses, corners)
    motion = state_blocks(TRUTH, poses, corners, lever)[1][..., 6:]
    _, rows, _ = blocks.by_pose.shape
    regressors, moved = np.zeros((5 * rows, 30 + TRUTH.size)), np.zeros((5 * rows, 30))
    for view in range(5):
        own = slice(view * rows, (view + 1) * rows)
        regressors[own, 6 * view : 6 * view + 6], regressors[own, 30:] = blocks.by_pose[view], blocks.by_shared[view]
        moved[own, 6 * view : 6 * view + 6] = motion[view]
    residuals = blocks.residuals.ravel()

    def dense(noise, scale, stretch):
        columns = moved * scale / np.tile([stretch] * 3 + [1.0] * 3, 5)
        covariance = noise**2 * np.eye(residuals.size) + columns @ columns.T
        information = regressors.T @ np.linalg.solve(covariance, regressors)
        best = np.linalg.solve(information, regressors.T @ np.linalg.solve(covariance, residuals))
        left = residuals - regressors @ best
        volume = np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(information)[1]
        return -0.5 * (volume + left @ np.linalg.solve(covariance, left))

    places = [(0.15, 8e-4, 1.0), (0.2, 3e-4, 1.0), (0.1, 2e-3, 0.5), (0.15, 8e-4, 2.0), (0.15, 0.0, 1.0)]
    found = [compressed.restricted_likelihood(*place) for place in places]
    gains = [one.value - found[0].value for one in found]
    np.testing.assert_allclose(gains, [dense(*one) - dense(*places[0]) for one in places], atol=1e-5)
    for place, one in zip(places[:-1], found, strict=False):
        steps = np.exp(1e-4 * np.eye(3))
        slopes = [(dense(*(place * step)) - dense(*(place / step))) / 2e-4 for step in steps]
        np.testing.assert_allclose(one.gradient, slopes, rtol=1e-5, atol=1e-4)


def test_exact_and_compressed_likelihood_agree_near_the_fit(rig):
    fit = rig.explained
    compressed = compress_views(fit.shared, fit.states, rig.corners, fit.lever)
    deviation = np.sqrt(np.diag(fit.covariance))
    differences = []
    for scale in (0.0, 1e-3, 0.3):
        shared = fit.shared + scale * deviation * np.random.default_rng(2).standard_normal(18)
        exact = exact_log_likelihood(
            shared, fit.states, rig.corners, fit.lever, noise_px=fit.noise_px, motion_scale=fit.motion_scale
        )
        linear = compressed.log_likelihood(shared, np.array(fit.noise_px), np.array(fit.motion_scale))
        differences.append(exact - float(linear))
    assert abs(differences[1] - differences[0]) < 2e-2
    # far from the fit along independent directions, thousands of units down the slope, to a fraction of a percent
    drop = float(compressed.log_likelihood(shared, np.array(fit.noise_px), np.array(fit.motion_scale))) - float(
        compressed.log_likelihood(fit.shared, np.array(fit.noise_px), np.array(fit.motion_scale))
    )
    assert abs(differences[2] - differences[0]) < max(0.05, 0.05 * abs(drop))


@pytest.mark.slow
def test_injected_motion_is_found_within_its_stated_errors():
    rng = np.random.default_rng(11)
    scores_with, scores_without, scales = [], [], []
    for _ in range(4):
        fit = fit_rig(shaken_rig(3e-4, 0.1, rng))
        scales.append(fit.explained.motion_scale)
        assert fit.explained.noise_px == pytest.approx(0.1, rel=0.06)
        for scores, result in ((scores_with, fit.explained), (scores_without, fit.pair)):
            error = result.shared - TRUTH
            scores.append(error @ np.linalg.solve(result.covariance, error))
    # 4 × 25 × 6 motions: the scale is known to 1/√1200
    assert np.mean(scales) == pytest.approx(3e-4, rel=0.1)
    low, high = chi2.ppf([1e-3, 1 - 1e-3], 4 * 18)
    assert low < np.sum(scores_with) < high
    assert np.sum(scores_without) > 3.0 * high


def test_a_board_that_shifts_without_turning_is_known():
    """With one scale for both, shifts would be taken for 0.6 of what they are, and depth for that much more certain."""
    fit = fit_rig(noisy_corners.corners(25, np.random.default_rng(2), white=True, motion=2e-4)).explained
    # 75 shifts: known to 1/√150
    assert fit.motion_scale == pytest.approx(2e-4, rel=0.25)
    assert fit.motion_scale / fit.lever < 1e-3


def test_no_motion_is_found_where_there_is_none():
    fit = fit_rig(shaken_rig(0.0, 0.1, np.random.default_rng(4)))
    # 0.1 px is 0.1 mm at 460 px and 0.45 m; the mean over 54 corners knows motions to 0.014 mm
    assert fit.explained.motion_scale < 1.5e-5
    assert fit.explained.log_likelihood_gain < 3.0
    np.testing.assert_allclose(fit.explained.overconfidence, 1.0, atol=0.1)

"""How far corners are trusted: noise that neighbours share, outliers, a bent board, halves of the views."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from scipy.linalg import block_diag
from scipy.optimize import minimize

from tests.calibration import noisy_corners
from tests.calibration.known_scales import errors_and_covariance
from tradestudy.answers.calibration import calibration_group
from tradestudy.calibration.corners.corner_file import CornerFileError, read_corners
from tradestudy.calibration.corners.corner_noise import equal_noise, estimate_noise, outlier_weights
from tradestudy.calibration.corners.real_rig import fit_rig
from tradestudy.calibration.posteriors import with_square_size
from tradestudy.calibration.projection import move, project, rotation_matrix
from tradestudy.errors import UnaffordableError
from tradestudy.figures.calibration import draw_trust


@pytest.mark.slow
def test_halves_of_the_measured_views_differ_as_stated(calibrated_webcams):
    trust = calibrated_webcams.trust
    assert np.all((trust.ratio[1:] > 0.8) & (trust.ratio[1:] < 1.25))
    assert trust.ratio[0] == pytest.approx(1.16, abs=0.1)  # at 0.3 m something is left
    np.testing.assert_allclose(trust.good_to, trust.claimed * np.maximum(trust.ratio, 1.0))
    # As published of these corners: 0.54 and 0.37 along rows (with p1 p2), 0.067 to 0.246 px a coordinate.
    assert trust.neighbour_correlation[:, 0] == pytest.approx(0.49, abs=0.08)
    assert trust.view_rms.max() / trust.view_rms.min() > 3.0
    for other in trust.lenses.values():  # no model beside k1 and k2 is called for, and none moves depth by much
        assert abs(other.support) < 2.0 * other.support_deviation
        assert np.all(np.abs(other.depth_change) < 2.5 * other.depth_change_deviation)
        assert abs(other.depth_change[0]) < 0.3e-3


def test_the_report_has_what_the_figure_needs(calibrated_webcams):
    group = calibration_group({"webcams": calibrated_webcams})
    values = dict(zip(group["rig_quantity"].values, group["rig_value"].values, strict=True))
    (accuracy,) = (value for name, value in values.items() if name.startswith("accuracy") and "300 mm" in name)
    assert re.fullmatch(r"\S+ [mµ]m \(claimed: \S+ [mµ]m\)", accuracy)
    assert group["rig_residual"].shape == (1, 2, 6, 8, 2)
    assert np.nanmax(np.abs(group["rig_residual"].values)) < 0.3
    assert draw_trust(xr.DataTree.from_dict({"/calibration": group}), "webcams").svg().startswith(b"<?xml")


@pytest.mark.slow
@pytest.mark.parametrize("white", [True, False])
def test_the_fit_that_knows_the_scales_errs_as_it_states(white):
    """What the campaign of corner trust subtracts has the variance that it assumes."""
    found = [
        errors_and_covariance(noisy_corners.simulated(12, np.random.default_rng([6, k]), white=white))
        for k in range(25)
    ]
    squares = [error @ np.linalg.solve(covariance, error) for error, covariance in found]
    assert np.mean(squares) == pytest.approx(18.0, abs=3.0 * np.sqrt(2.0 * 18.0 / 25))


def test_one_wild_corner_counts_for_nothing():
    """5 px are 50 standard deviations; what is left moves nothing by a tenth of its own."""
    clean = noisy_corners.corners(8, np.random.default_rng(3), white=True, motion=0.0)
    left = clean.left.copy()
    left[2, 17, 0] += 5.0
    spoilt = fit_rig(replace(clean, left=left))
    assert spoilt.weights[2, 0, 17] == 0.0
    assert not spoilt.corners.present[2, 17]
    assert np.count_nonzero(spoilt.weights < 0.5) == 1
    fit = fit_rig(clean).explained
    moved = (spoilt.explained.shared - fit.shared) / np.sqrt(np.diag(fit.covariance))
    assert np.max(np.abs(moved)) < 0.3


def test_weights_fall_in_three_parts():
    length = np.array([*np.full(41, 0.1 * np.sqrt(2.0 * np.log(2.0))), 0.34, 0.5, 0.8, 1.1])
    weights = outlier_weights(np.stack([length, np.zeros(45)], axis=-1).reshape(1, -1), np.ones((1, 45), dtype=bool))
    np.testing.assert_allclose(weights[0, 41:], [1.0, 3.5 / 5.0, 3.5 / 8.0 / 2.0, 0.0], rtol=1e-12)


def test_whitening_makes_the_declared_covariance_white():
    rng = np.random.default_rng(0)
    board = rng.uniform(0.0, 0.2, (2, 7, 2))
    weights = np.ones((2, 2, 7))
    weights[1, 0, 3], weights[0, 1, 5] = 0.25, 0.0
    values = rng.standard_normal((2, 28))
    values.reshape(2, 2, 7, 2)[0, 1, 5] = 0.0
    noise = estimate_noise(values, rng.standard_normal((2, 28, 12)), board, weights)
    typical = np.sqrt(np.mean(noise.deviation**2))
    for view, side in ((0, 0), (0, 1), (1, 0)):
        matrix = np.zeros((7, 7))
        for i in range(7):
            for j in range(7):
                square = np.sum((board[view, i] - board[view, j]) ** 2)
                own = (1.0 - noise.share) / weights[view, side, i] if i == j and weights[view, side, i] else 0.0
                there = weights[view, side, i] * weights[view, side, j] > 0.0
                matrix[i, j] = there * noise.share / (1.0 + square / noise.length**2) + own
        known = weights[view, side] > 0.0
        whitening = noise.whitening[view, side][np.ix_(known, known)]
        covariance = matrix[np.ix_(known, known)] * noise.deviation[view] ** 2
        np.testing.assert_allclose(whitening @ covariance @ whitening.T, typical**2 * np.eye(known.sum()), atol=1e-10)
    np.testing.assert_allclose(equal_noise(weights, board).whiten(values)[0], values[0], atol=1e-14)


def test_share_and_length_maximise_a_dense_restricted_likelihood():
    """Harville's likelihood from one covariance matrix per view, whose deviation is fitted, searched without slopes."""
    rng = np.random.default_rng(7)
    views, corners, free = 12, 12, 4
    board = np.tile(np.stack(np.meshgrid(np.arange(4), np.arange(3)), -1).reshape(-1, 2) * 0.03, (views, 1, 1))
    weights = np.ones((views, 2, corners))
    weights[1, 0, 3], weights[4, 1, 5] = 0.25, 0.0
    square = np.sum((board[0][:, None] - board[0]) ** 2, axis=-1)

    def covariance(share, length, weight):
        own = np.diag((1.0 - share) / np.where(weight > 0.0, weight, 1.0))
        there = np.outer(weight > 0.0, weight > 0.0)
        return np.where(there, share / (1.0 + square / length**2) + own, np.eye(corners))

    def of_view(share, length, view):
        return block_diag(*[np.kron(covariance(share, length, one), np.eye(2)) for one in weights[view]])

    seen = np.repeat(weights.reshape(views, -1) > 0.0, 2, axis=-1)
    roots = [np.linalg.cholesky(of_view(0.7, 0.05, view)) for view in range(views)]
    residuals = seen * np.stack([root @ rng.standard_normal(4 * corners) for root in roots])
    by_view = seen[..., None] * rng.standard_normal((views, 4 * corners, free))

    def dense(place):
        share, length = 1.0 / (1.0 + np.exp(-place[0])), np.exp(place[1])
        total = 0.0
        for view in range(views):
            kept = seen[view]
            matrix, x, y = of_view(share, length, view)[np.ix_(kept, kept)], by_view[view, kept], residuals[view, kept]
            information = x.T @ np.linalg.solve(matrix, x)
            left = y - x @ np.linalg.solve(information, x.T @ np.linalg.solve(matrix, y))
            freedom = kept.sum() - free
            total += np.linalg.slogdet(matrix)[1] + np.linalg.slogdet(information)[1]
            total += freedom * np.log(left @ np.linalg.solve(matrix, left) / freedom)
        return 0.5 * total

    found = estimate_noise(residuals, by_view, board, weights)
    best = minimize(dense, [1.0, np.log(0.05)], method="Nelder-Mead")
    at = [np.log(found.share / (1.0 - found.share)), np.log(found.length)]
    assert dense(at) - best.fun < 2e-3  # a sixteenth of a standard deviation
    assert dense([0.0, np.log(0.05)]) - best.fun > 1.0


def test_a_bent_board_is_found():
    """A bowl of 0.4 mm at the radius of gyration, and a board that is flat, by the same noise."""
    flat = noisy_corners.corners(10, np.random.default_rng(5), white=True, motion=0.0)
    bent = noisy_corners.corners(10, np.random.default_rng(5), white=True, motion=0.0, bowl=0.4e-3)
    none, found = fit_rig(flat), fit_rig(bent)
    assert np.all(np.abs(none.warp) < 4.0 * none.warp_deviation)
    assert np.all(np.abs(found.warp - [0.4e-3, 0.0, 0.0]) < 4.0 * found.warp_deviation)
    assert found.warp_deviation[0] < 0.1e-3


def test_a_strong_warp_does_not_count_as_noise():
    """2 mm at the radius of gyration bend the picture by pixels; the noise that is left is the simulated one."""
    found = fit_rig(noisy_corners.corners(10, np.random.default_rng(5), white=True, bowl=2e-3))
    assert np.all(np.abs(found.warp - [2e-3, 0.0, 0.0]) < 4.0 * found.warp_deviation)
    assert found.explained.noise_px == pytest.approx(0.1, rel=0.05)
    assert found.corners.noise.share < 0.1


def test_two_rows_of_corners_are_refused():
    """A parabola across two rows raises both alike."""
    seen = noisy_corners.corners(6, np.random.default_rng(5), white=True)
    y = seen.board[..., 1]
    two = seen.present & ((y == np.unique(y)[0]) | (y == np.unique(y)[2]))
    with pytest.raises(CornerFileError, match=r"whether the board is bent.*three rows"):
        fit_rig(replace(seen, present=two))


def test_corners_without_noise_are_refused():
    seen = noisy_corners.corners(6, np.random.default_rng(5), white=True, motion=0.0)
    left, right = (project(noisy_corners.TRUTH[side], at) for side, at in _exactly_seen(seen.board))
    with pytest.raises(CornerFileError, match="fit without any error"):
        fit_rig(replace(seen, left=left, right=right))


def _exactly_seen(board):
    points = np.concatenate([board, np.zeros((*board.shape[:2], 1))], axis=-1)
    left = move(noisy_corners.shown(len(board), np.random.default_rng(3)), points)
    return (slice(6), left), (slice(6, 12), move(noisy_corners.TRUTH[12:], left))


def test_the_covariance_counts_the_warp_as_unknown():
    """Against normal equations of all unknowns at once, with derivatives by differences of the exact projection."""
    fit = fit_rig(noisy_corners.corners(6, np.random.default_rng(8), white=True))
    found, corners = fit.explained, fit.corners
    grid = corners.board[0]
    square = np.sum((grid - grid.mean(axis=0)) ** 2, axis=1)
    x, y = ((grid - grid.mean(axis=0)) / np.sqrt(square.mean())).T
    shapes = np.stack([x**2 + y**2, x**2 - y**2, 2.0 * x * y], axis=-1)

    def seen(unknown):
        shared, warp = unknown[:18], unknown[18:21]
        poses, motions = np.moveaxis(unknown[21:].reshape(6, 2, 6), 1, 0)
        left = move(poses, np.concatenate([grid, (shapes @ warp)[:, None]], axis=-1))
        right = move(shared[12:], left)
        middle = right.mean(axis=1, keepdims=True)
        turned = (right - middle) @ np.swapaxes(rotation_matrix(motions[:, :3] / found.lever), -1, -2) + middle
        right = turned + motions[:, None, 3:]
        both = [project(shared[side], at) for side, at in ((slice(6), left), (slice(6, 12), right))]
        return corners.noise.whiten(np.concatenate([one.reshape(6, -1) for one in both], axis=1)).ravel()

    states = np.stack([found.states.poses, np.zeros((6, 6))], axis=1)
    centre = np.concatenate([found.shared, fit.warp, states.ravel()])
    scale = np.concatenate([np.sqrt(np.diag(fit.joint_covariance)), np.full(72, 1e-4)])
    slopes = np.stack([(seen(centre + step) - seen(centre - step)) / 2.0 for step in np.diag(scale)], axis=-1)
    information = slopes.T @ slopes / found.noise_px**2
    motions = np.arange(93)[21:].reshape(6, 2, 6)[:, 1].ravel()
    information[motions, motions] += (scale[motions] / found.motion_scale) ** 2
    dense = np.linalg.inv(information)[:21, :21]
    np.testing.assert_allclose(fit.joint_covariance / np.outer(scale[:21], scale[:21]), dense, atol=0.02)
    assert fit.covariance.shape == (18, 18)
    given_warp = np.diag(found.covariance) / np.diag(fit.covariance)
    assert 0.5 < given_warp.min() < 0.97


def test_the_size_of_the_squares_scales_depth():
    """0.1 % of the squares is 0.3 mm at 0.3 m: baseline and depth scale with the board."""
    draws = np.broadcast_to(noisy_corners.TRUTH, (20_000, 18))
    scaled = with_square_size(draws, 1e-3, np.random.default_rng(0))
    baseline = np.linalg.norm(scaled[:, 15:18], axis=1)
    assert 0.3 * baseline.std() / baseline.mean() == pytest.approx(0.3e-3, rel=0.03)
    np.testing.assert_array_equal(scaled[:, :15], draws[:, :15])


def test_more_rows_than_can_be_fitted_are_refused_before_they_are_read(tmp_path):
    path = tmp_path / "many.csv"
    path.write_text("view\n" + "no number\n" * 50_001)
    with pytest.raises(UnaffordableError, match=r"50,001 rows .allowed: 50,000.; keep one view in 2"):
        read_corners(path)

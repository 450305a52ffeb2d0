"""Depth by generalised least squares that knows what a fit must find out: the noise and the motion of the board.

Linear about the truth, with derivatives by differences and dense covariances: nothing of the program's fit takes part.
Its errors have the covariance that it states, and follow those of a good fit closely. Their known variance therefore
takes most of the luck out of a comparison of stated with true deviations (a control variate).
"""

from __future__ import annotations

import numpy as np

from tests.calibration.noisy_corners import COLUMNS, ROWS, SQUARE, TRUTH, SimulatedCorners
from tradestudy.calibration.projection import move, project
from tradestudy.calibration.synthetic_target import flat_grid
from tradestudy.optics.arrays import FloatArray

SHARED, WARP, POSE, MOTION = slice(18), slice(18, 21), slice(21, 27), slice(27, 30)
_STEPS = np.array([1.0, 1.0, 1.0, 1.0, 1e-3, 1e-3] * 2 + [1e-4] * 15 + [1e-5] * 3)


def errors_and_covariance(seen: SimulatedCorners) -> tuple[FloatArray, FloatArray]:
    """Errors (18,) of the shared parameters, and their covariance (18, 18)."""
    information, gradient = np.zeros((21, 21)), np.zeros(21)
    pictures = zip(seen.poses, seen.corners.left, seen.corners.right, seen.covariance, strict=True)
    for pose, left, right, covariance in pictures:
        truth = np.concatenate([TRUTH, np.zeros(3), pose, np.zeros(3)])
        by = np.stack([_seen(truth + step) - _seen(truth - step) for step in np.diag(_STEPS)], axis=-1) / (2.0 * _STEPS)
        residual = np.concatenate([left.ravel(), right.ravel()]) - _seen(truth)
        noise = np.kron(np.eye(2), np.kron(covariance, np.eye(2)))
        weight = np.linalg.inv(noise + seen.motion**2 * by[:, MOTION] @ by[:, MOTION].T)
        posed = weight @ by[:, POSE]
        weight = weight - posed @ np.linalg.solve(by[:, POSE].T @ posed, posed.T)
        others = by[:, : WARP.stop]
        information += others.T @ weight @ others
        gradient += others.T @ weight @ residual
    size = 1.0 / np.sqrt(np.diag(information))
    inverse = size[:, None] * np.linalg.inv(information * np.outer(size, size)) * size
    return (inverse @ gradient)[SHARED], inverse[SHARED, SHARED]


def _seen(unknowns: FloatArray) -> FloatArray:
    """Coordinates of one view, left corners before right ones, shape (4 N,)."""
    grid = flat_grid(COLUMNS, ROWS, SQUARE)
    x, y = grid[:, 0] / SQUARE, grid[:, 1] / SQUARE
    height = np.stack([x * x + y * y, x * x - y * y, x * y], axis=-1) @ unknowns[WARP]
    left = move(unknowns[POSE], grid + np.outer(height, [0.0, 0.0, 1.0]))
    right = move(unknowns[12:18], left) + unknowns[MOTION]
    return np.concatenate([project(unknowns[:6], left).ravel(), project(unknowns[6:12], right).ravel()])

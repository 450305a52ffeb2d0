"""Corners of a rig whose noise is like that of real ones: shared by neighbours, and stronger in some views.

    python -m tests.calibration.noisy_corners [SETS] [white]

counts how often 68 % intervals of depth cover, and holds the stated against the true spread. Nothing of the noise model
of the program takes part: neighbours share noise because white noise is averaged over squares.
"""

from __future__ import annotations

import sys

import numpy as np

from tradestudy.calibration.corners.corner_file import StereoCorners
from tradestudy.calibration.corners.real_rig import fit_rig, inverse_depth, observe_pair, points_midway
from tradestudy.calibration.projection import move, project
from tradestudy.calibration.target.synthetic_target import flat_grid
from tradestudy.optics.arrays import FloatArray

TRUTH = np.array([460, 462, 320, 180, 0.1, -0.2, 463, 461, 325, 182, 0.1, -0.15, 0.01, 0.02, 0.01, -0.094, -1e-3, 2e-3])
COLUMNS, ROWS, SQUARE = 9, 6, 0.024
DISTANCES = np.array([0.3, 0.5, 1.0, 2.0, 5.0])


def shown(views: int, rng: np.random.Generator) -> FloatArray:
    """Poses of a board that fills a good part of both pictures."""
    turned = 0.35 * rng.standard_normal((views, 3))
    z = rng.uniform(0.35, 0.6, views)
    return np.column_stack([turned, rng.uniform(-0.15, 0.15, (views, 2)) * z[:, None], z])


def neighbourly(shape: tuple[int, ...], rng: np.random.Generator) -> FloatArray:
    """Noise of unit variance on the grid of corners, shape (..., 54): half white, half averaged over 3 × 3."""
    wide = rng.standard_normal((*shape, ROWS + 2, COLUMNS + 2))
    mean = sum(wide[..., i : i + ROWS, j : j + COLUMNS] for i in range(3) for j in range(3)) / 3.0
    white = rng.standard_normal((*shape, ROWS, COLUMNS))
    return (np.asarray(mean) * np.sqrt(0.8) + white * np.sqrt(0.2)).reshape(*shape, -1)


def corners(
    views: int, rng: np.random.Generator, *, white: bool = False, motion: float = 2e-4, bowl: float = 0.0
) -> StereoCorners:
    """What the true rig sees; without ``white``, views differ by a factor e^±0.35 and neighbours share noise.

    A bowl [m] bends the board; motion [m] is that of the board between the exposures.
    """
    grid = flat_grid(COLUMNS, ROWS, SQUARE)
    square = np.sum(grid**2, axis=1)
    seen_left = move(shown(views, rng), grid + bowl * np.outer(square / square.mean(), [0.0, 0.0, 1.0]))
    seen_right = move(TRUTH[12:], seen_left) + motion * rng.standard_normal((views, 1, 3))
    left, right = project(TRUTH[:6], seen_left), project(TRUTH[6:12], seen_right)
    if white:
        noise = 0.1 * rng.standard_normal((views, 4, COLUMNS * ROWS))
    else:
        noise = 0.1 * np.exp(0.35 * rng.standard_normal((views, 1, 1))) * neighbourly((views, 4), rng)
    noise = np.moveaxis(noise, 1, -1)
    return StereoCorners(
        views=tuple(range(views)),
        board=np.broadcast_to(grid[:, :2], left.shape).copy(),
        left=left + noise[..., :2],
        right=right + noise[..., 2:],
        present=np.ones(left.shape[:2], dtype=bool),
    )


def depth_scores(views: int, rng: np.random.Generator, *, white: bool = False) -> tuple[FloatArray, FloatArray]:
    """Errors of depth [m] on the axis by one calibration, and the standard deviations that it states, each (D,)."""
    found = fit_rig(corners(views, rng, white=white))
    seen = observe_pair(TRUTH, points_midway(TRUTH, DISTANCES))
    error = inverse_depth(found.explained.shared, seen) - 1.0 / DISTANCES
    step = 1e-2 * np.sqrt(np.diag(found.covariance))
    up, down = (inverse_depth(found.explained.shared + sign * np.diag(step), seen) for sign in (1.0, -1.0))
    slopes = (up - down) / (2.0 * step[:, None])
    stated = np.sqrt(np.einsum("id,ij,jd->d", slopes, found.covariance, slopes))
    return -(DISTANCES**2) * error, DISTANCES**2 * stated


def main(sets: int, *, white: bool) -> None:
    """Print coverage and spread."""
    rows = np.array([depth_scores(12, np.random.default_rng([7, k]), white=white) for k in range(sets)])
    errors, stated = rows[:, 0], rows[:, 1]
    print("distances [m]      ", DISTANCES)
    print("68 % cover         ", np.mean(np.abs(errors) < stated, axis=0))
    print("stated over spread ", np.median(stated, axis=0) / errors.std(axis=0))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 200, white="white" in sys.argv)

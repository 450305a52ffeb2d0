"""Corners of a rig whose noise is like that of real ones: shared by neighbours, and stronger in some views.

Nothing of the noise model of the program takes part: neighbours share noise because white noise is averaged over
squares.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tradestudy.calibration.corners.corner_file import StereoCorners
from tradestudy.calibration.projection import move, project
from tradestudy.calibration.synthetic_target import flat_grid
from tradestudy.optics.arrays import FloatArray

TRUTH = np.array([460, 462, 320, 180, 0.1, -0.2, 463, 461, 325, 182, 0.1, -0.15, 0.01, 0.02, 0.01, -0.094, -1e-3, 2e-3])
COLUMNS, ROWS, SQUARE = 9, 6, 0.024


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


@dataclass(frozen=True, kw_only=True)
class SimulatedCorners:
    """Corners, and what no fit knows of them.

    Parameters
    ----------
    corners
        What both cameras see.
    poses : array (V, 6)
        True poses of the board [rad, m].
    covariance : array (V, 54, 54)
        Of the noise of one coordinate of a picture between its corners [px²].
    motion
        Standard deviation of the board's translation between the exposures, per axis [m].
    """

    corners: StereoCorners
    poses: FloatArray
    covariance: FloatArray
    motion: float


def corners(
    views: int, rng: np.random.Generator, *, white: bool = False, motion: float = 2e-4, bowl: float = 0.0
) -> StereoCorners:
    """What the true rig sees; see `simulated`."""
    return simulated(views, rng, white=white, motion=motion, bowl=bowl).corners


def simulated(
    views: int, rng: np.random.Generator, *, white: bool = False, motion: float = 2e-4, bowl: float = 0.0
) -> SimulatedCorners:
    """What the true rig sees; without ``white``, views differ by a factor e^±0.35 and neighbours share noise.

    A bowl [m] bends the board; motion [m] is that of the board between the exposures.
    """
    grid = flat_grid(COLUMNS, ROWS, SQUARE)
    square = np.sum(grid**2, axis=1)
    poses = shown(views, rng)
    seen_left = move(poses, grid + bowl * np.outer(square / square.mean(), [0.0, 0.0, 1.0]))
    seen_right = move(TRUTH[12:], seen_left) + motion * rng.standard_normal((views, 1, 3))
    left, right = project(TRUTH[:6], seen_left), project(TRUTH[6:12], seen_right)
    if white:
        size = np.full((views, 1, 1), 0.1)
        noise = size * rng.standard_normal((views, 4, COLUMNS * ROWS))
    else:
        size = 0.1 * np.exp(0.35 * rng.standard_normal((views, 1, 1)))
        noise = size * neighbourly((views, 4), rng)
    noise = np.moveaxis(noise, 1, -1)
    return SimulatedCorners(
        corners=StereoCorners(
            views=tuple(range(views)),
            board=np.broadcast_to(grid[:, :2], left.shape).copy(),
            left=left + noise[..., :2],
            right=right + noise[..., 2:],
            present=np.ones(left.shape[:2], dtype=bool),
        ),
        poses=poses,
        covariance=size**2 * (np.eye(COLUMNS * ROWS) if white else _neighbourly_covariance()),
        motion=motion,
    )


def _neighbourly_covariance() -> FloatArray:
    """Covariance of `neighbourly`: two corners share as many of the nine averaged values as their squares overlap."""
    row, column = np.divmod(np.arange(COLUMNS * ROWS), COLUMNS)
    shared = np.prod([np.maximum(3 - np.abs(at[:, None] - at), 0) for at in (row, column)], axis=0)
    return np.asarray(0.8 * shared / 9.0 + 0.2 * np.eye(COLUMNS * ROWS))

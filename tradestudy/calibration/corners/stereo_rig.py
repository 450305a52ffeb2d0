"""A pair of cameras as one instrument: what it sees of points, and the depth it reads from what it saw."""

from __future__ import annotations

import numpy as np

from tradestudy.calibration.corners.view_blocks import LEFT, RELATIVE, RIGHT
from tradestudy.calibration.projection import move, project, ray_slopes, rotation_matrix
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.triangulation import depth_of_inverse, inverse_depth_on_ray


def observe_pair(shared: FloatArray, points: FloatArray) -> FloatArray:
    """Image coordinates of points in both cameras.

    Parameters
    ----------
    shared : array (..., 18)
        In the order of ``view_blocks.SHARED_NAMES`` [px, 1, rad, m].
    points : array (..., N, 3)
        Points in the left camera's frame [m].

    Returns
    -------
    array (..., N, 4)
        Left x, y and right x, y [px]; NaN for points behind the camera concerned.
    """
    left = project(shared[..., LEFT], points)
    right = project(shared[..., RIGHT], move(shared[..., RELATIVE], points))
    return np.concatenate(np.broadcast_arrays(left, right), axis=-1)


def inverse_depth(shared: FloatArray, seen: FloatArray) -> FloatArray:
    """Inverse depth of points from their coordinates in both images, by disparity only.

    The left ray Z d is Z R d in the axes of the right camera; see `inverse_depth_on_ray`. The right y coordinate takes
    no part.

    Parameters
    ----------
    shared : array (..., 18)
        In the order of ``view_blocks.SHARED_NAMES``; draws of a calibration as leading axes.
    seen : array (..., N, 4)
        Left x, y and right x, y [px].

    Returns
    -------
    array (..., N)
        1/Z in the left camera's frame [1/m]; zero or negative where the rays do not meet in front of the pair, which
        stands for infinity.
    """
    left = ray_slopes(shared[..., LEFT], seen[..., :2])
    right = ray_slopes(shared[..., RIGHT], seen[..., 2:])[..., 0]
    ray = np.concatenate([left, np.ones_like(left[..., :1])], axis=-1)
    turned = ray @ np.swapaxes(rotation_matrix(shared[..., 12:15]), -1, -2)
    moved_x, moved_z = shared[..., 15, None], shared[..., 17, None]
    return inverse_depth_on_ray(turned[..., 0], turned[..., 2], right, moved_x, moved_z)


def depth_of_draws(shared: FloatArray, draws: FloatArray, distances: FloatArray) -> FloatArray:
    """Depths read by rigs drawn from a calibration, of points on the left axis as the best rig sees them.

    Parameters
    ----------
    shared : array (18,)
        The best calibration: it says what is seen.
    draws : array (K, 18)
        Joint draws of the calibration: they say what is read.
    distances : array (D,)
        True depths [m].

    Returns
    -------
    array (K, D)
        Depths [m]; +inf where a draw sees no disparity, NaN where its distortion cannot be inverted. Calibration error
        only, no pixel noise.
    """
    points = distances[:, None] * np.array([0.0, 0.0, 1.0])
    return depth_of_inverse(inverse_depth(draws, observe_pair(shared, points)))

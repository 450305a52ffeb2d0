"""What drawn calibrations of a pair of cameras read."""

from __future__ import annotations

import numpy as np

from tradestudy.calibration.corners.real_rig import inverse_depth, observe_pair
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.triangulation import depth_of_inverse


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

"""A pair calibrated from corners in plain numpy and scipy: what it sees, and the depth that its disparity says.

It shares no code with the program: rotations by scipy, distortion by fixed-point iteration, depth by a bracketed root.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from tests.data.simulate_corners import Numbers, pictures


def inverse_depth_read(rig: Numbers, seen: Numbers) -> float:
    """The inverse depth at which a ray of the left camera is imaged in the right one's seen column [1/m].

    Parameters
    ----------
    rig
        The believed 18 parameters.
    seen
        Left x, left y, right x, right y [px]; of the last only its distortion counts.
    """
    slopes = _undistorted(rig[:6], seen[:2])
    target = _undistorted(rig[6:12], seen[2:])[0]
    turned = Rotation.from_rotvec(rig[12:15]).apply(np.array([*slopes, 1.0]))

    def off(inverse: float) -> float:
        x, _, z = turned + inverse * rig[15:18]
        return float(x / z - target)

    low, high = -5.0, 20.0
    return float(brentq(off, low, high, xtol=1e-15, rtol=1e-14))


def _undistorted(camera: Numbers, place: Numbers) -> Numbers:
    """Slopes of a ray from its place in a picture, by fixed-point iteration of the radius."""
    distorted = (place - camera[2:4]) / camera[:2]
    found = distorted.copy()
    for _ in range(200):
        r2 = float(found @ found)
        found = distorted / (1.0 + camera[4] * r2 + camera[5] * r2**2)
    return found


def depths_read(best: Numbers, rigs: Numbers, points: Numbers, noise_px: Numbers | None = None) -> Numbers:
    """Depths that believed rigs (K, 18) read of what the best one sees of points (D, 3), shape (K, D) [m].

    The noise (K, D) of disparity goes half to each side.
    """
    seen = pictures(best, points)
    noise = np.zeros((len(rigs), len(points))) if noise_px is None else noise_px
    halves = np.array([0.5, 0.0, -0.5, 0.0])
    inverse = np.array(
        [
            [inverse_depth_read(rig, place + e * halves) for place, e in zip(seen, row, strict=True)]
            for rig, row in zip(rigs, noise, strict=True)
        ]
    )
    return np.where(inverse > 0.0, 1.0 / inverse, np.inf)

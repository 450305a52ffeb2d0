"""Depth on the axis by each kind of camera in plain numpy: what a true camera sees, and what a calibration reads of it.

Written from drawings of thin lenses and pinholes, without the program. The camera that sees and the calibration that
reads take their own parameters. Everything broadcasts; a parameter that is missing has no error.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from tests.calibration.cameras import PITCH

Numbers = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Errors = Mapping[str, Numbers]
PlainDepth = Callable[[Errors, Errors, Numbers, Numbers], Numbers]
"""Takes the errors of the true camera and of its calibration (draws, 1), distances (D,) [m], and the noise of disparity
(draws, D) [m]; returns the inverse depths (draws, D) that are read [1/m]."""

_FOCAL, _BASELINE = 5.12e-3 / np.tan(np.radians(32.62)), 0.1


def _rotated(errors: Errors, vectors: Numbers, *, back: bool) -> Numbers:
    """Rays of the right camera in the axes of the rig, or back: turned by roll, then pitch, then yaw; (draws, D, 3)."""
    angles = np.stack(np.broadcast_arrays(*(np.ravel(errors.get(n, 0.0)) for n in ("yaw", "pitch", "roll"))), axis=-1)
    matrices = Rotation.from_euler("YXZ", angles * [-1.0, 1.0, 1.0]).as_matrix()  # a yaw turns z towards −x
    rotated: Numbers = np.einsum("nji,ndj->ndi" if back else "nij,ndj->ndi", matrices, vectors)
    return rotated


def stereo(true: Errors, believed: Errors, distance: Numbers, noise: Numbers) -> Numbers:
    """Two pinholes: the point midway, and where the two lines of sight cross in the plane of the baseline."""
    point = np.broadcast_to(np.stack([0 * distance, 0 * distance, distance], axis=-1), (len(noise), distance.size, 3))

    def half(errors: Errors) -> Numbers:
        return (_BASELINE + np.asarray(errors.get("baseline", 0.0))) / 2.0 * np.ones_like(noise)

    def lengths(errors: Errors) -> tuple[Numbers, Numbers]:
        return tuple(_FOCAL + np.asarray(errors.get(f"{side}_focal_length", 0.0)) for side in ("left", "right"))

    def centre(errors: Errors) -> Numbers:
        return np.asarray(errors.get("right_principal_point_x", 0.0))

    seen = half(true)
    left = lengths(true)[0] * seen / distance
    ray = _rotated(true, point - seen[..., None] * np.array([1.0, 0.0, 0.0]), back=True)
    right_x = lengths(true)[1] * ray[..., 0] / ray[..., 2] + centre(true)
    right_y = lengths(true)[1] * ray[..., 1] / ray[..., 2]
    left_slope = (left + noise / 2.0) / lengths(believed)[0]
    focal = lengths(believed)[1]
    slopes = np.broadcast_arrays(
        (right_x - noise / 2.0 - centre(believed)) / focal, right_y / focal, np.ones_like(noise)
    )
    traced = _rotated(believed, np.stack(slopes, axis=-1), back=False)
    inverse: Numbers = (left_slope - traced[..., 0] / traced[..., 2]) / (2.0 * half(believed))
    return inverse


def _lengths(errors: Errors, *values: float) -> tuple[Numbers, ...]:
    names = ("mla_distance", "focal_length", "microlens_gap")
    return tuple(value + np.asarray(errors.get(name, 0.0)) for name, value in zip(names, values, strict=True))


def focused(true: Errors, believed: Errors, distance: Numbers, noise: Numbers) -> Numbers:
    """Two microlenses of one type, √3 pitches apart, see the image that the main lens makes of the point."""
    design, apart = (14.77255e-3, 12.5e-3, 0.568093e-3), np.sqrt(3.0) * PITCH
    z, f, gap = _lengths(true, *design)
    disparity = apart * gap / (z - f * distance / (distance - f)) + noise
    z, f, gap = _lengths(believed, *design)
    inverse: Numbers = 1.0 / f - 1.0 / (z - apart * gap / disparity)
    return inverse


def unfocused(true: Errors, believed: Errors, distance: Numbers, noise: Numbers, *, pixels_apart: float) -> Numbers:
    """Rays through two parts of the pupil, as far apart as two pixels are through a microlens, meet in the image."""
    design = (12.5e-3 * 0.15 / (0.15 - 12.5e-3), 12.5e-3, 0.432e-3)
    z, f, gap = _lengths(true, *design)
    disparity = pixels_apart * z / gap * (1.0 - z * (distance - f) / (f * distance)) + noise
    z, f, gap = _lengths(believed, *design)
    inverse: Numbers = 1.0 / f - (1.0 - disparity * gap / (pixels_apart * z)) / z
    return inverse

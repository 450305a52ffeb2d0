"""Observation and triangulation by two cameras, with errors in all parameters."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.depth_measurement import Errors, value_of
from tradestudy.cameras.error_vocabulary import PIXEL_NOISE
from tradestudy.cameras.light_cones import Pose, pose_of
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.optics.lens_model import IDEAL, LensModel
from tradestudy.optics.triangulation import inverse_depth_on_ray, midpoint_depth

SIDES: Final = ("left", "right")
Ray = tuple[FloatArray, FloatArray, FloatArray]
Rotation = tuple[Ray, ...]
"""Rows of a matrix."""
Image = tuple[FloatArray, FloatArray, FloatArray, FloatArray]
"""Coordinates on both sensors, upright, from their centres [m]: left x, left y, right x, right y."""


@dataclass(frozen=True, kw_only=True)
class Pair:
    """The geometry of two cameras as designed.

    Parameters
    ----------
    baseline
        Distance between the two centres of projection [m].
    principal_distance
        Distance from the centres of projection to the sensors [m].
    convergence_angle
        Angle between the optical axes [rad]; 0: parallel; positive: they meet in front.
    triangulation
        ``disparity`` measures along the baseline; ``midpoint`` takes the middle of the shortest segment between the two
        lines of sight. They agree unless the rays are skew.
    distortion
        Lens model of both cameras.
    """

    baseline: float
    principal_distance: float
    convergence_angle: float
    triangulation: Literal["disparity", "midpoint"]
    distortion: LensModel = IDEAL


def pair_observation(pair: Pair, errors: Errors, x: ArrayLike, y: ArrayLike, z: ArrayLike) -> Image:
    """The images of a point in a pair that deviates from its design by ``errors``.

    Parameters
    ----------
    pair
        The design.
    errors
        True minus designed values, by the names of `STEREO_ERRORS`, without pixel noise.
    x, y, z
        The point [m], from the middle of the baseline: right, down, along the axis.

    Returns
    -------
    Image
        Exact; NaN for a point outside the valid field of the lens of a camera.
    """
    x, y, z = (np.asarray(value, dtype=np.float64) for value in (x, y, z))
    t = pair.convergence_angle / 2.0
    half, direction = _half_baseline(pair, errors)
    towards_left, towards_right = (
        (x + sign * half * direction[0], y + sign * half * direction[1], z + sign * half * direction[2])
        for sign in (1.0, -1.0)
    )
    # The transpose of the rotation of a camera's rays turns the frame of the pair into that of the camera.
    rotation = tuple(zip(*_right_rotation(errors, t), strict=True))
    image = []
    for side, (a, b, c) in zip(SIDES, (_yaw(towards_left, t), _turn(rotation, towards_right)), strict=True):
        u, v = _distortion(pair, errors, side).image(a, b, c)
        seen = pair.distortion.sees(a, b, c)
        u, v = np.where(seen, u, np.nan), np.where(seen, v, np.nan)
        principal_distance, on_x, on_y = _interior(pair, errors, side)
        image += [principal_distance * u + on_x, principal_distance * v + on_y]
    return image[0], image[1], image[2], image[3]


def pair_inverse_depth(pair: Pair, errors: Errors, image: Image) -> tuple[FloatArray, BoolArray]:
    """The inverse depth that a calibration with ``errors`` computes from an image.

    The rays of both image points are traced back through the pair as calibrated. ``disparity`` compares them along the
    baseline by `inverse_depth_on_ray`; ``midpoint`` takes the middle of the shortest segment between them.

    Parameters
    ----------
    pair
        The design, with its triangulation.
    errors
        Calibrated minus designed values, by the names of `STEREO_ERRORS`; half the noise is added in the left picture
        and subtracted in the right one.
    image
        From `pair_observation`.

    Returns
    -------
    inverse_depth
        [1/m] from the middle of the baseline along the axis of the design; zero or negative for rays that do not meet
        in front.
    valid
        False where the calibrated distortion has no inverse, or a principal distance or the baseline is not positive.
    """
    t = pair.convergence_angle / 2.0
    half, direction = _half_baseline(pair, errors)
    noise = value_of(errors, PIXEL_NOISE) / 2.0
    rays, valid = [], np.asarray(half > 0.0)
    for side, u, v, moved in (("left", image[0], image[1], noise), ("right", image[2], image[3], -noise)):
        principal_distance, on_x, on_y = _interior(pair, errors, side)
        valid = valid & (principal_distance > 0.0)
        inverse_distance = 1.0 / np.where(principal_distance > 0.0, principal_distance, np.nan)
        x, y = (u - on_x + moved) * inverse_distance, (v - on_y) * inverse_distance
        ray = _distortion(pair, errors, side).ray(x, y)
        valid = valid & ~(np.isnan(ray[0]) & np.isfinite(x) & np.isfinite(y))
        rays.append(ray)
    left, right = _yaw(rays[0], -t), _turn(_right_rotation(errors, t), rays[1])
    if pair.triangulation == "midpoint":
        return _midpoint_inverse(left, right, half, direction), valid
    # The right camera sees the left one at twice half the baseline, in the opposite direction.
    slope = right[0] / right[2]
    from_left = inverse_depth_on_ray(
        left[0] / left[2], 1.0, slope, -2.0 * half * direction[0], -2.0 * half * direction[2]
    )
    inverse = from_left / (1.0 - from_left * (half * direction[2]))
    return np.where((left[2] <= 0.0) | (right[2] <= 0.0), 0.0, inverse), valid


def pair_poses(pair: Pair, errors: Errors) -> tuple[Pose, Pose]:
    """Poses of the left and right camera of a pair that deviates from its design by one value of each error."""
    t = pair.convergence_angle / 2.0
    half, direction = _half_baseline(pair, errors)
    axes = [_yaw((row[0], row[1], row[2]), -t) for row in np.eye(3)]
    rotations = (tuple(zip(*axes, strict=True)), _right_rotation(errors, t))
    left, right = (
        pose_of(sign * half * np.stack(direction), np.array(rotation, dtype=np.float64))
        for sign, rotation in zip((-1.0, 1.0), rotations, strict=True)
    )
    return left, right


def pair_interior(pair: Pair, errors: Errors, side: str) -> tuple[float, tuple[float, float], LensModel]:
    """Principal distance [m], principal point [m] and lens model of one camera for one value of each error."""
    principal_distance, x, y = (float(one) for one in _interior(pair, errors, side))
    return principal_distance, (x, y), _distortion(pair, errors, side)


def _interior(pair: Pair, errors: Errors, side: str) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Principal distance and principal point of one camera [m], with its own errors and its share of common ones."""
    principal_distance = (
        pair.principal_distance + value_of(errors, "focal_length") + value_of(errors, f"{side}_focal_length")
    )
    apart = (-0.5 if side == "left" else 0.5) * value_of(errors, "principal_point")
    on_x = value_of(errors, f"{side}_principal_point_x") + apart
    return principal_distance, on_x, value_of(errors, f"{side}_principal_point_y")


def _distortion(pair: Pair, errors: Errors, side: str) -> LensModel:
    """Lens model of one camera."""
    names = (f"{side}_distortion_k1", f"{side}_distortion_k2")
    if errors.keys().isdisjoint(names):  # as in most rigs; a shortcut saves time in every measurement
        return pair.distortion
    return pair.distortion.with_radial_error(value_of(errors, names[0]), value_of(errors, names[1]))


def _half_baseline(pair: Pair, errors: Errors) -> tuple[FloatArray, Ray]:
    """Half the baseline, and its direction as a unit vector."""
    half = (pair.baseline + value_of(errors, "baseline")) / 2.0
    down, along = np.tan(value_of(errors, "baseline_direction_y")), np.tan(value_of(errors, "baseline_direction_z"))
    length = np.sqrt(1.0 + down * down + along * along)
    return half, (1.0 / length, down / length, along / length)


def _yaw(ray: Ray, angle: float) -> Ray:
    """Rotate about the vertical; a positive angle rotates z towards −x."""
    if angle == 0.0:
        return ray
    x, y, z = ray
    c, s = math.cos(angle), math.sin(angle)
    return c * x - s * z, y, s * x + c * z


def _turn(rotation: Rotation, ray: Ray) -> Ray:
    """The rotated ray."""
    x, y, z = ray
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation
    return xx * x + xy * y + xz * z, yx * x + yy * y + yz * z, zx * x + zy * y + zz * z


def _right_rotation(errors: Errors, convergence: float) -> Rotation:
    """Rotate rays of the right camera into the frame of the pair: half the convergence, then roll, pitch and yaw.

    Roll rotates about z, pitch about x and yaw as `_yaw` does. There is one matrix per draw, for all distances.
    """
    (cr, sr), (cp, sp), (cy, sy) = (_cos_sin(value_of(errors, name)) for name in ("roll", "pitch", "yaw"))
    rows = (
        (cy * cr - sy * sp * sr, -cy * sr - sy * sp * cr, -sy * cp),
        (cp * sr, cp * cr, -sp),
        (sy * cr + cy * sp * sr, cy * sp * cr - sy * sr, cy * cp),
    )
    if convergence == 0.0:
        return rows
    ct, st = math.cos(convergence), math.sin(convergence)
    return tuple((x * ct + z * st, y, z * ct - x * st) for x, y, z in rows)


def _cos_sin(angle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Cosine and sine from the tangent of half the angle, which NumPy computes four times faster than either."""
    h = np.tan(0.5 * angle)
    scale = 1.0 / (1.0 + h * h)
    return (1.0 - h * h) * scale, 2.0 * h * scale


def _midpoint_inverse(left: Ray, right: Ray, half: FloatArray, direction: Ray) -> FloatArray:
    """Inverse of the depth by the midpoint rule; zero where the rays do not meet in front."""
    centre = [half * n for n in direction]
    components = np.broadcast_arrays(*left, *right, *centre)
    rays = [np.stack(components[3 * k : 3 * k + 3], axis=-1) for k in range(3)]
    depth = midpoint_depth(rays[0], rays[1], -rays[2], rays[2])
    return np.asarray(1.0 / depth)

"""Two cameras at the ends of a baseline, every parameter in error: what they see, and which inverse depth they read."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.reading import Errors, value_of
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.optics.radial_distortion import distort, undistort
from tradestudy.optics.triangulation import inverse_depth_on_ray, midpoint_depth

SIDES: Final = ("left", "right")
Ray = tuple[FloatArray, FloatArray, FloatArray]
Image = tuple[FloatArray, FloatArray, FloatArray, FloatArray]
"""Coordinates on both sensors, upright, from their centres [m]: left x, left y, right x, right y."""


@dataclass(frozen=True, kw_only=True)
class Pair:
    """The geometry of two cameras as designed.

    Parameters
    ----------
    baseline
        Distance of the two centres of projection [m].
    principal_distance
        From the centres of projection to the sensors [m].
    convergence_angle
        Between the optical axes [rad]; 0 is parallel, positive meets in front.
    triangulation
        ``disparity`` measures along the baseline; ``midpoint`` takes the middle of the shortest segment between the two
        lines of sight. They agree unless the rays are skew.
    """

    baseline: float
    principal_distance: float
    convergence_angle: float
    triangulation: Literal["disparity", "midpoint"]


def pair_observation(pair: Pair, errors: Errors, x: ArrayLike, y: ArrayLike, z: ArrayLike) -> Image:
    """Where a pair that deviates from its design by ``errors`` images a point.

    Parameters
    ----------
    pair
        The design.
    errors
        What the rig is less what its design says, by the names of `STEREO_ERRORS`, without pixel noise.
    x, y, z
        The point [m], from the middle of the baseline: right, down, along the axis.

    Returns
    -------
    Image
        Exact; NaN for a point behind a camera.
    """
    x, y, z = (np.asarray(value, dtype=np.float64) for value in (x, y, z))
    t = pair.convergence_angle / 2.0
    half, direction = _half_baseline(pair, errors)
    towards_left = tuple(p + half * n for p, n in zip((x, y, z), direction, strict=True))
    towards_right = tuple(p - half * n for p, n in zip((x, y, z), direction, strict=True))
    left = _yaw(_ray(towards_left), t)
    right = _yaw(_unrotate(_ray(towards_right), errors), -t)
    image = []
    for side, (a, b, c) in zip(SIDES, (left, right), strict=True):
        depth = np.where(c > 0.0, c, np.nan)
        k1, k2 = value_of(errors, f"{side}_distortion_k1"), value_of(errors, f"{side}_distortion_k2")
        u, v = distort(a / depth, b / depth, k1, k2)
        principal_distance = pair.principal_distance + value_of(errors, f"{side}_focal_length")
        image.append(principal_distance * u + value_of(errors, f"{side}_principal_point_x"))
        image.append(principal_distance * v + value_of(errors, f"{side}_principal_point_y"))
    return image[0], image[1], image[2], image[3]


def pair_inverse_depth(pair: Pair, errors: Errors, image: Image) -> tuple[FloatArray, BoolArray]:
    """The inverse depth that a calibration which is off by ``errors`` reads from a picture.

    The rays of both image points are traced back through the believed pair. ``disparity`` compares them along the
    baseline by `inverse_depth_on_ray`; ``midpoint`` takes the middle of the shortest segment between them.

    Parameters
    ----------
    pair
        The design, which says the triangulation.
    errors
        What the calibration says less what the design says, by the names of `STEREO_ERRORS`; pixel noise is added to
        the picture.
    image
        From `pair_observation`.

    Returns
    -------
    inverse_depth
        [1/m] from the middle of the baseline along the axis of the design; zero or negative for rays that do not meet
        in front.
    valid
        False where the believed distortion has no inverse, or a principal distance or the baseline is not positive.
    """
    t = pair.convergence_angle / 2.0
    half, direction = _half_baseline(pair, errors)
    rays, valid = [], np.asarray(half > 0.0)
    for side, u, v in (("left", image[0], image[1]), ("right", image[2], image[3])):
        principal_distance = pair.principal_distance + value_of(errors, f"{side}_focal_length")
        valid = valid & (principal_distance > 0.0)
        safe = np.where(principal_distance > 0.0, principal_distance, np.nan)
        x = (u + value_of(errors, f"{side}_pixel_noise") - value_of(errors, f"{side}_principal_point_x")) / safe
        y = (v - value_of(errors, f"{side}_principal_point_y")) / safe
        if f"{side}_distortion_k1" in errors or f"{side}_distortion_k2" in errors:
            k1, k2 = value_of(errors, f"{side}_distortion_k1"), value_of(errors, f"{side}_distortion_k2")
            x, y, invertible = undistort(x, y, k1, k2)
            valid = valid & invertible
        rays.append((x, y, np.ones(np.broadcast_shapes(x.shape, y.shape))))
    left, right = _yaw(rays[0], -t), _rotate(_yaw(rays[1], t), errors)
    if pair.triangulation == "midpoint":
        return _midpoint_inverse(left, right, half, direction), valid
    # From the right camera to the left one it is twice half the baseline, against its direction.
    slope = right[0] / right[2]
    from_left = inverse_depth_on_ray(
        left[0] / left[2], 1.0, slope, -2.0 * half * direction[0], -2.0 * half * direction[2]
    )
    inverse = from_left / (1.0 - from_left * half * direction[2])
    behind = (left[2] <= 0.0) | (right[2] <= 0.0)
    return np.where(behind, 0.0, inverse), valid


def _half_baseline(pair: Pair, errors: Errors) -> tuple[FloatArray, Ray]:
    """Half the baseline, and its direction as a unit vector."""
    half = (pair.baseline + value_of(errors, "baseline")) / 2.0
    down, along = np.tan(value_of(errors, "baseline_direction_y")), np.tan(value_of(errors, "baseline_direction_z"))
    length = np.sqrt(1.0 + down * down + along * along)
    return half, (1.0 / length, down / length, along / length)


def _ray(components: tuple[FloatArray, ...]) -> Ray:
    x, y, z = components
    return x, y, z


def _yaw(ray: Ray, angle: ArrayLike) -> Ray:
    """Turn about the vertical; a positive angle turns z towards −x."""
    x, y, z = ray
    c, s = np.cos(angle), np.sin(angle)
    return c * x - s * z, y, s * x + c * z


def _rotate(ray: Ray, errors: Errors) -> Ray:
    """Turn by roll about z, then pitch about x, then yaw about y."""
    x, y, z = ray
    c, s = np.cos(value_of(errors, "roll")), np.sin(value_of(errors, "roll"))
    x, y = c * x - s * y, s * x + c * y
    c, s = np.cos(value_of(errors, "pitch")), np.sin(value_of(errors, "pitch"))
    y, z = c * y - s * z, s * y + c * z
    return _yaw((x, y, z), value_of(errors, "yaw"))


def _unrotate(ray: Ray, errors: Errors) -> Ray:
    """The inverse of `_rotate`."""
    x, y, z = _yaw(ray, -value_of(errors, "yaw"))
    c, s = np.cos(value_of(errors, "pitch")), np.sin(value_of(errors, "pitch"))
    y, z = c * y + s * z, c * z - s * y
    c, s = np.cos(value_of(errors, "roll")), np.sin(value_of(errors, "roll"))
    return c * x + s * y, c * y - s * x, z


def _midpoint_inverse(left: Ray, right: Ray, half: FloatArray, direction: Ray) -> FloatArray:
    """Inverse of the depth by the midpoint rule; zero where the rays do not meet in front."""
    centre = [half * n for n in direction]
    components = np.broadcast_arrays(*left, *right, *centre)
    rays = [np.stack(components[3 * k : 3 * k + 3], axis=-1) for k in range(3)]
    depth = midpoint_depth(rays[0], rays[1], -rays[2], rays[2])
    return np.asarray(1.0 / depth)

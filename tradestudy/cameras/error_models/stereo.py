"""A stereo rig with every parameter in error: what it sees of a point, and which inverse depth is read from that."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.error_models.environment import Environment
from tradestudy.cameras.error_models.reading import (
    Errors,
    InverseDepthReading,
    require_field,
    require_known,
    value_of,
)
from tradestudy.cameras.stereo import StereoRig
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.optics.radial_distortion import distort, undistort
from tradestudy.optics.triangulation import midpoint_depth

_SIDES: Final = ("left", "right")
STEREO_ERRORS: Final[Mapping[str, str]] = {
    "baseline": "m",
    "baseline_direction_y": "rad",
    "baseline_direction_z": "rad",
    "yaw": "rad",
    "pitch": "rad",
    "roll": "rad",
    **{
        f"{side}_{name}": unit
        for side in _SIDES
        for name, unit in {
            "focal_length": "m",
            "principal_point_x": "m",
            "principal_point_y": "m",
            "distortion_k1": "1",
            "distortion_k2": "1",
            "pixel_noise": "m",
        }.items()
    },
}
"""Errors of a stereo rig with their units.

``yaw``, ``pitch``, ``roll`` turn the right camera against the left; ``baseline_direction_y`` and ``_z`` turn the line
of centres against the left camera. Principal points and pixel noise are in metres on the sensor, pixel noise along the
baseline; k₁ and k₂ refer to slopes (r over the principal distance). ``focal_length`` is the error of the principal
distance, as in any calibration in pixels."""

Ray = tuple[FloatArray, FloatArray, FloatArray]
Image = tuple[FloatArray, FloatArray, FloatArray, FloatArray]
"""Coordinates on both sensors, upright, from their centres [m]: left x, left y, right x, right y."""


def stereo_observation(rig: StereoRig, errors: Errors, x: ArrayLike, y: ArrayLike, z: ArrayLike) -> Image:
    """Where a rig that deviates from its design by ``errors`` images a point.

    Parameters
    ----------
    rig
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
    t = rig.convergence_angle / 2.0
    half, direction = _half_baseline(rig, errors)
    towards_left = tuple(p + half * n for p, n in zip((x, y, z), direction, strict=True))
    towards_right = tuple(p - half * n for p, n in zip((x, y, z), direction, strict=True))
    left = _yaw(_ray(towards_left), t)
    right = _yaw(_unrotate(_ray(towards_right), errors), -t)
    image = []
    for side, (a, b, c) in zip(_SIDES, (left, right), strict=True):
        depth = np.where(c > 0.0, c, np.nan)
        k1, k2 = value_of(errors, f"{side}_distortion_k1"), value_of(errors, f"{side}_distortion_k2")
        u, v = distort(a / depth, b / depth, k1, k2)
        principal_distance = rig.principal_distance + value_of(errors, f"{side}_focal_length")
        image.append(principal_distance * u + value_of(errors, f"{side}_principal_point_x"))
        image.append(principal_distance * v + value_of(errors, f"{side}_principal_point_y"))
    return image[0], image[1], image[2], image[3]


def stereo_inverse_depth(rig: StereoRig, errors: Errors, image: Image) -> tuple[FloatArray, BoolArray]:
    """The inverse depth that a calibration which is off by ``errors`` reads from a picture.

    The rays of both image points are traced back through the believed rig. ``disparity`` compares them along the
    baseline, ``1/Z = (l − r)/(B (n_x − r n_z))`` with l, r their slopes and n the direction of the baseline;
    ``midpoint`` takes the middle of the shortest segment between them.

    Parameters
    ----------
    rig
        The design, which says the triangulation.
    errors
        What the calibration says less what the design says, by the names of `STEREO_ERRORS`; pixel noise is added to
        the picture.
    image
        From `stereo_observation`.

    Returns
    -------
    inverse_depth
        [1/m] from the middle of the baseline along the axis of the design; zero or negative for rays that do not meet
        in front.
    valid
        False where the believed distortion has no inverse, or a principal distance or the baseline is not positive.
    """
    t = rig.convergence_angle / 2.0
    half, direction = _half_baseline(rig, errors)
    rays, valid = [], np.asarray(half > 0.0)
    for side, u, v in (("left", image[0], image[1]), ("right", image[2], image[3])):
        principal_distance = rig.principal_distance + value_of(errors, f"{side}_focal_length")
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
    if rig.triangulation == "midpoint":
        return _midpoint_inverse(left, right, half, direction), valid
    # On the left ray the right camera sees the slope r where Z (l − r) = 2h (n_x − r n_z).
    slope = right[0] / right[2]
    from_left = (left[0] / left[2] - slope) / (2.0 * half * (direction[0] - slope * direction[2]))
    return from_left / (1.0 - from_left * half * direction[2]), valid


def stereo_reading(
    rig: StereoRig, distance: FloatArray, field: float, errors: Errors, environment: Environment | None = None
) -> InverseDepthReading:
    """Inverse depths read by a rig in changed surroundings with a calibration that is off by ``errors``.

    Parameters
    ----------
    rig
        The rig as designed: what it is at calibration.
    distance
        True distances [m], shape (distances,).
    field
        Where the point lies in the view midway between the cameras: 0 on the axis, 1 in the corner of the sensor.
    errors
        By the names of `STEREO_ERRORS` and `SESSION_CHANGES`, arrays of shape (draws, 1).
    environment
        How the rig answers to its surroundings; None: not at all. Baseline and principal distance grow with the
        housing. Pressure moves the focus of a thin lens, not its principal distance, so it leaves disparity alone.

    Raises
    ------
    OutOfRangeError
        For an error that a rig does not have, or a place beyond the sensor.
    """
    require_known(errors, STEREO_ERRORS, "a stereo rig")
    require_field(field)
    c, sensor = rig.principal_distance, rig.sensor
    z = np.asarray(distance, dtype=np.float64)
    changed: dict[str, ArrayLike] = {}
    if environment is not None and "temperature_change" in errors:
        growth = environment.length_factor(errors) - 1.0
        changed = {"baseline": rig.baseline * growth, **{f"{side}_focal_length": c * growth for side in _SIDES}}
    right, down = field * sensor.width / 2.0 / c, field * sensor.height / 2.0 / c
    image = stereo_observation(rig, changed, right * z, down * z, z)
    inside = [np.abs(c) <= e / 2.0 for c, e in zip(image, (sensor.width, sensor.height) * 2, strict=True)]
    inverse, valid = stereo_inverse_depth(rig, errors, image)
    return InverseDepthReading(
        inverse_depth=inverse, no_overlap=~np.logical_and.reduce(np.broadcast_arrays(*inside)), out_of_range=~valid
    )


def _half_baseline(rig: StereoRig, errors: Errors) -> tuple[FloatArray, Ray]:
    """Half the baseline, and its direction as a unit vector."""
    half = (rig.baseline + value_of(errors, "baseline")) / 2.0
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
    *components, _ = np.broadcast_arrays(*left, *right, *centre, np.zeros((1, 1)))
    rays = [np.stack(components[3 * k : 3 * k + 3], axis=-1) for k in range(3)]
    depth = midpoint_depth(rays[0], rays[1], -rays[2], rays[2])
    return np.asarray(1.0 / depth)

"""Observation and triangulation by two cameras with errors in all parameters, as designed, calibrated or exported."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Literal, cast

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.calibrated_pair import CalibratedCamera, CalibratedPair, common_focal_length
from tradestudy.cameras.depth_measurement import (
    INTERIOR,
    NOISE_PARAMETER,
    PIXEL_NOISE,
    ErrorParameter,
    Errors,
    ErrorVocabulary,
    value_of,
)
from tradestudy.cameras.imported import ImportedCamera, ImportedRig, LensModelName, Rotation, Vector
from tradestudy.cameras.light_cones import Pose, pose_of
from tradestudy.cameras.parts import Sensor
from tradestudy.cameras.single_lens import edge_angle, place_across
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.optics.lens_model import IDEAL, LensModel
from tradestudy.optics.triangulation import inverse_depth_on_ray, midpoint_depth

SIDES: Final = ("left", "right")
_ROTATIONS: Final = ("roll", "pitch", "yaw")
Ray = tuple[FloatArray, FloatArray, FloatArray]
RotationRows = tuple[Ray, ...]
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
        if (lost := np.isnan(ray[0])).any():
            valid = valid & ~(lost & np.isfinite(x) & np.isfinite(y))
        rays.append(ray)
    turned = not errors.keys().isdisjoint(_ROTATIONS)  # by noise alone, not; this saves time in every measurement
    left, right = _yaw(rays[0], -t), _turn(_right_rotation(errors, t), rays[1]) if turned else _yaw(rays[1], t)
    if pair.triangulation == "midpoint":
        return _midpoint_inverse(left, right, half, direction), valid
    # The right camera sees the left one at twice half the baseline, in the opposite direction.
    slope = right[0] / right[2]
    from_left = inverse_depth_on_ray(
        left[0] / left[2], 1.0, slope, -2.0 * half * direction[0], -2.0 * half * direction[2]
    )
    # From the centre of the left camera to the middle of the baseline.
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
    principal_distance, x, y = (float(value) for value in _interior(pair, errors, side))
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


def _turn(rotation: RotationRows, ray: Ray) -> Ray:
    """The rotated ray."""
    x, y, z = ray
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation
    return xx * x + xy * y + xz * z, yx * x + yy * y + yz * z, zx * x + zy * y + zz * z


def _right_rotation(errors: Errors, convergence: float) -> RotationRows:
    """Rotate rays of the right camera into the frame of the pair: half the convergence, then roll, pitch and yaw.

    Roll rotates about z, pitch about x and yaw as `_yaw` does. There is one matrix per draw, for all distances.
    """
    (cr, sr), (cp, sp), (cy, sy) = (_cos_sin(value_of(errors, name)) for name in _ROTATIONS)
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


_OF_BOTH: Final[ErrorVocabulary] = {
    "baseline": ErrorParameter(
        unit="m", part="relative position", meaning="Distance between the centres of projection of the two cameras."
    ),
    "baseline_direction_y": ErrorParameter(
        unit="rad",
        part="relative position",
        meaning="Vertical angle of the baseline; if positive, the right camera lies below the left one.",
    ),
    "baseline_direction_z": ErrorParameter(
        unit="rad",
        part="relative position",
        meaning="Horizontal angle of the baseline; if positive, the right camera lies ahead of the left one.",
    ),
    "yaw": ErrorParameter(
        unit="rad",
        part="relative rotation",
        meaning="Rotation of the right camera relative to the left one, about the vertical; if positive, towards the "
        "left one.",
    ),
    "pitch": ErrorParameter(
        unit="rad",
        part="relative rotation",
        meaning="Rotation of the right camera relative to the left one, about the baseline; if positive, upwards.",
    ),
    "roll": ErrorParameter(
        unit="rad",
        part="relative rotation",
        meaning="Rotation of the right camera relative to the left one, about its own optical axis; if positive, "
        "clockwise as seen from behind.",
    ),
    "focal_length": ErrorParameter(
        unit="m",
        part=INTERIOR,
        meaning="Principal distance of both cameras, which a calibration in pixels calls the focal length.",
    ),
    "principal_point": ErrorParameter(
        unit="m",
        part=INTERIOR,
        meaning="Difference between the positions of the two principal points along the baseline, right minus left. "
        "The two principal points move in opposite directions, each by half of the error.",
    ),
}


def _of_one(side: str) -> Iterator[tuple[str, ErrorParameter]]:
    """The error parameters of a single camera."""
    yield (
        "focal_length",
        ErrorParameter(
            unit="m",
            part=INTERIOR,
            meaning=f"Principal distance of the {side} camera; this error adds to that of focal_length.",
        ),
    )
    for axis, where in (("x", "along the baseline"), ("y", "perpendicular to the baseline")):
        yield (
            f"principal_point_{axis}",
            ErrorParameter(
                unit="m",
                part=INTERIOR,
                meaning=f"Position of the principal point of the {side} camera on its sensor, {where}.",
            ),
        )
    for name in ("k1", "k2"):
        yield (
            f"distortion_{name}",
            ErrorParameter(
                unit="1",
                part=INTERIOR,
                meaning=f"Coefficient {name} of the {side} camera's lens model. The model must have the coefficients "
                "k1 and k2; if no lens model is declared, the rational one is assumed.",
            ),
        )


STEREO_ERRORS: Final[ErrorVocabulary] = {
    **_OF_BOTH,
    **{f"{side}_{name}": parameter for side in SIDES for name, parameter in _of_one(side)},
    PIXEL_NOISE: NOISE_PARAMETER,
}
"""Errors of a stereo rig in the order in which they are drawn; each picture has half of the noise."""


@dataclass(frozen=True, kw_only=True)
class View:
    """One camera of a rig.

    Parameters
    ----------
    pose
        Its pose in the frame of the rig: x along the baseline, whose middle is the origin.
    principal_distances, principal_point
        Along x and y [m]; the point from the middle of the sensor.
    distortion
        Lens model.
    relative_focal_length
        Focal length relative to that of the rig.
    """

    pose: Pose
    principal_distances: tuple[float, float]
    principal_point: tuple[float, float]
    distortion: LensModel
    relative_focal_length: float = 1.0


def views_of_design(pair: Pair, errors: Errors) -> tuple[View, ...]:
    """Both cameras of a designed pair that deviates from its design by one value of each error."""
    views = []
    for side, pose in zip(SIDES, pair_poses(pair, errors), strict=True):
        distance, point, distortion = pair_interior(pair, errors, side)
        views.append(
            View(pose=pose, principal_distances=(distance, distance), principal_point=point, distortion=distortion)
        )
    return tuple(views)


def views_of_calibration(pair: CalibratedPair, sensors: tuple[Sensor, Sensor]) -> tuple[View, ...]:
    """Both cameras of a calibrated pair in the frame of its rectified pictures.

    Each camera is turned by half the rotation R between them, into a common frame, as J.-Y. Bouguet's rectification
    does. The smallest rotation of that frame then puts its x axis along the baseline.

    Parameters
    ----------
    pair
        The calibrated pair.
    sensors
        The sensors of both cameras, whose pixels the pair counts.
    """
    from scipy.spatial.transform import Rotation

    half = Rotation.from_rotvec(pair.rotation / 2.0)  # from the left camera to the common frame
    to_right = -half.inv().apply(pair.translation)  # a point X of the left camera is at R X + t in the right one
    baseline = float(np.linalg.norm(to_right))
    across = np.cross(to_right, [1.0, 0.0, 0.0])
    sine = float(np.linalg.norm(across))
    turn = Rotation.from_rotvec(across / sine * math.atan2(sine, to_right[0]) if sine > 0.0 else np.zeros(3))
    views = []
    for side, half_turn, camera, sensor, relative in zip(
        (-1.0, 1.0),
        (half, half.inv()),
        pair.cameras,
        sensors,
        relative_focal_lengths(pair, sensors),
        strict=True,
    ):
        distances, point = camera.on_sensor(sensor)
        views.append(
            View(
                pose=pose_of(np.array([side * baseline / 2.0, 0.0, 0.0]), (turn * half_turn).as_matrix()),
                principal_distances=distances,
                principal_point=point,
                distortion=camera.lens,
                relative_focal_length=relative,
            )
        )
    return tuple(views)


def relative_focal_lengths(pair: CalibratedPair, sensors: tuple[Sensor, Sensor]) -> tuple[float, float]:
    """Focal lengths of both lenses [m], by the scale on the axis, relative to the common one on the left sensor."""
    left, right = (camera.scale for camera in pair.cameras)
    common, pitches = float(common_focal_length(left, right)), [sensor.pixel_pitch for sensor in sensors]
    return left / common, right / common * (pitches[1] / pitches[0])


_KEYS: Final = dict.fromkeys(("focal_lengths", "centre", "pixels", "coefficients"), "")


def rig_of_calibration(
    pair: CalibratedPair, pixels: tuple[int, int], right_pixels: tuple[int, int] | None = None
) -> ImportedRig:
    """The rig of a calibrated pair with pictures of these sizes."""
    from scipy.spatial.transform import Rotation as Turn

    left, right = pair.cameras
    return _rig(
        _camera("left", left, pixels),
        _camera("right", right, right_pixels or pixels),
        Turn.from_rotvec(pair.rotation).as_matrix(),
        pair.translation,
    )


def rig_of_design(pair: Pair, sensor: Sensor) -> ImportedRig:
    """The designed rig: two equal cameras with centred principal points."""
    focal_length = pair.principal_distance / sensor.pixel_pitch
    middle = ((sensor.columns - 1) / 2.0, (sensor.rows - 1) / 2.0)
    camera = CalibratedCamera(focal_lengths=(focal_length, focal_length), principal_point=middle, lens=pair.distortion)
    left, right = pair_poses(pair, {})
    to_right = np.array(right.rotation).T
    pixels = (sensor.columns, sensor.rows)
    return _rig(
        _camera("left", camera, pixels),
        _camera("right", camera, pixels),
        to_right @ np.array(left.rotation),
        to_right @ (np.array(left.centre) - np.array(right.centre)),
    )


def _camera(name: str, camera: CalibratedCamera, pixels: tuple[int, int]) -> ImportedCamera:
    return ImportedCamera(
        name=name,
        focal_lengths=camera.focal_lengths,
        centre=camera.principal_point,
        pixels=pixels,
        lens_model=cast(LensModelName, camera.lens.name),
        coefficients=camera.lens.coefficients(),
        conventions=(),
        keys=_KEYS,
    )


def _rig(left: ImportedCamera, right: ImportedCamera, rotation: FloatArray, translation: FloatArray) -> ImportedRig:
    rows: list[Vector] = [(float(row[0]), float(row[1]), float(row[2])) for row in rotation]
    turn: Rotation = (rows[0], rows[1], rows[2])
    moved: Vector = (float(translation[0]), float(translation[1]), float(translation[2]))
    keys = {"rotation": "", "translation": ""}
    return ImportedRig(left=left, right=right, rotation=turn, translation=moved, conventions=(), keys=keys)


_RIGHT_ANGLE = math.pi / 2.0


def shared_view(
    distance: ArrayLike, baseline: float, half_width: float, convergence_angle: float, lens: LensModel
) -> FloatArray:
    """Share of each picture's width at a distance that the other camera also sees; ``1 − B/W`` for parallel pinholes.

    W = 2 Z w with w half the picture's width. Zero where the views do not overlap. Converging axes and lenses with
    distortion image a plane unevenly; the share refers to the picture, not to the plane.

    Parameters
    ----------
    distance
        Z [m] from the baseline.
    baseline
        B [m].
    half_width
        Half the width of the normalised picture [1].
    convergence_angle
        Full angle between the axes [rad].
    lens
        Lens model of both cameras.
    """
    z = np.asarray(distance, dtype=np.float64)
    t = convergence_angle / 2.0
    first, last = -edge_angle(lens, -half_width, 0.0), edge_angle(lens, half_width, 0.0)

    def met(edge: float) -> FloatArray:
        """Direction from the left camera to the line in which an edge of the right camera's view meets the plane."""
        if abs(edge) >= _RIGHT_ANGLE:  # this edge never meets the plane: the view is unbounded on this side
            return np.full(z.shape, math.copysign(_RIGHT_ANGLE, edge))
        return np.arctan(baseline / z + math.tan(edge))

    low = np.maximum(max(t + first, -_RIGHT_ANGLE), met(first - t))
    high = np.minimum(min(t + last, _RIGHT_ANGLE), met(last - t))
    # Directions are clipped to the edges of the picture.
    places = place_across(
        lens, np.clip([high - t, low - t, np.full(z.shape, last), np.full(z.shape, first)], first, last)
    )[..., 0]
    return np.asarray(np.clip((places[0] - places[1]) / (places[2] - places[3]), 0.0, 1.0))

"""How both cameras of a rig see the scene: pose, interior orientation and lens model, as designed or as calibrated."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tradestudy.cameras.calibrated_pair import CalibratedCamera, CalibratedPair
from tradestudy.cameras.depth_measurement import Errors
from tradestudy.cameras.light_cones import Pose, pose_of
from tradestudy.cameras.parts import Sensor
from tradestudy.cameras.stereo.pair import SIDES, Pair, pair_interior, pair_poses
from tradestudy.optics.lens_model import LensModel


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
        Focal length relative to the mean of both cameras.
    """

    pose: Pose
    principal_distances: tuple[float, float]
    principal_point: tuple[float, float]
    distortion: LensModel
    relative_focal_length: float = 1.0


def views_of_design(pair: Pair, errors: Errors) -> tuple[View, ...]:
    """Both cameras of a designed pair that deviates from its design by one value of each error."""
    found = []
    for side, pose in zip(SIDES, pair_poses(pair, errors), strict=True):
        distance, point, distortion = pair_interior(pair, errors, side)
        found.append(
            View(pose=pose, principal_distances=(distance, distance), principal_point=point, distortion=distortion)
        )
    return tuple(found)


def views_of_calibration(pair: CalibratedPair, sensor: Sensor) -> tuple[View, ...]:
    """Both cameras of a calibrated pair in the frame of its rectified pictures.

    Each camera is turned by half the rotation R between them, into a common frame, as J.-Y. Bouguet's rectification
    does. The smallest rotation of that frame then puts its x axis along the baseline.

    Parameters
    ----------
    pair
        The calibrated pair.
    sensor
        The sensor of both cameras, whose pixels the pair counts.
    """
    from scipy.spatial.transform import Rotation

    half = Rotation.from_rotvec(pair.rotation / 2.0)  # from the left camera to the common frame
    to_right = -half.inv().apply(pair.translation)  # a point X of the left camera is at R X + t in the right one
    baseline = float(np.linalg.norm(to_right))
    across = np.cross(to_right, [1.0, 0.0, 0.0])
    sine = float(np.linalg.norm(across))
    turn = Rotation.from_rotvec(across / sine * math.atan2(sine, to_right[0]) if sine > 0.0 else np.zeros(3))
    focal_lengths = [_focal_length(camera) for camera in pair.cameras]
    views = []
    for side, own, camera, focal_length in zip(
        (-1.0, 1.0), (half, half.inv()), pair.cameras, focal_lengths, strict=True
    ):
        distances, point = camera.on_sensor(sensor)
        views.append(
            View(
                pose=pose_of(np.array([side * baseline / 2.0, 0.0, 0.0]), (turn * own).as_matrix()),
                principal_distances=distances,
                principal_point=point,
                distortion=camera.lens,
                relative_focal_length=focal_length / float(np.mean(focal_lengths)),
            )
        )
    return tuple(views)


def _focal_length(camera: CalibratedCamera) -> float:
    """Scale of the picture on the axis [px]."""
    return math.sqrt(math.prod(camera.focal_lengths)) * camera.lens.scale_on_axis

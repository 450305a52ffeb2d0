"""A stereo rig as calibration files state it: two cameras in pixels, and where the right one stands."""

from __future__ import annotations

from typing import Final

import numpy as np

from tradestudy.cameras.imported import ImportedCamera, ImportedRig, Rotation, Vector
from tradestudy.cameras.parts import Sensor
from tradestudy.cameras.stereo.pair import Pair, pair_poses
from tradestudy.optics.arrays import FloatArray

_KEYS: Final = dict.fromkeys(("focal_lengths", "centre", "pixels", "coefficients"), "")


def rig_of_shared(shared: FloatArray, pixels: tuple[int, int]) -> ImportedRig:
    """The pair of 18 parameters: two cameras, rotation vector and translation, as `calibration.projection` has them."""
    from scipy.spatial.transform import Rotation as Turn

    return _rig(
        _camera("left", shared[:6], pixels),
        _camera("right", shared[6:12], pixels),
        Turn.from_rotvec(shared[12:15]).as_matrix(),
        shared[15:18],
    )


def rig_of_design(pair: Pair, sensor: Sensor) -> ImportedRig:
    """Two equal cameras without distortion whose axes meet the middle of their pictures."""
    focal_length = pair.principal_distance / sensor.pixel_pitch
    middle = ((sensor.columns - 1) / 2.0, (sensor.rows - 1) / 2.0)
    interior = np.array([focal_length, focal_length, *middle, 0.0, 0.0])
    left, right = pair_poses(pair, {})
    to_right = np.array(right.rotation).T
    pixels = (sensor.columns, sensor.rows)
    return _rig(
        _camera("left", interior, pixels),
        _camera("right", interior, pixels),
        to_right @ np.array(left.rotation),
        to_right @ (np.array(left.centre) - np.array(right.centre)),
    )


def _camera(name: str, interior: FloatArray, pixels: tuple[int, int]) -> ImportedCamera:
    fx, fy, cx, cy, k1, k2 = (float(one) for one in interior)
    return ImportedCamera(
        name=name,
        focal_lengths=(fx, fy),
        centre=(cx, cy),
        pixels=pixels,
        lens_model="rational",
        coefficients={"k1": k1, "k2": k2},
        conventions=(),
        keys=_KEYS,
    )


def _rig(left: ImportedCamera, right: ImportedCamera, rotation: FloatArray, translation: FloatArray) -> ImportedRig:
    rows: list[Vector] = [(float(row[0]), float(row[1]), float(row[2])) for row in rotation]
    turn: Rotation = (rows[0], rows[1], rows[2])
    moved: Vector = (float(translation[0]), float(translation[1]), float(translation[2]))
    keys = {"rotation": "", "translation": ""}
    return ImportedRig(left=left, right=right, rotation=turn, translation=moved, conventions=(), keys=keys)

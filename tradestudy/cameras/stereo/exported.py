"""A stereo rig in the form of calibration files: two cameras in pixels, and their relative pose."""

from __future__ import annotations

from typing import Final, cast

import numpy as np

from tradestudy.cameras.calibrated_pair import CalibratedCamera, CalibratedPair
from tradestudy.cameras.imported import ImportedCamera, ImportedRig, LensModelName, Rotation, Vector
from tradestudy.cameras.parts import Sensor
from tradestudy.cameras.stereo.pair import Pair, pair_poses
from tradestudy.optics.arrays import FloatArray

_KEYS: Final = dict.fromkeys(("focal_lengths", "centre", "pixels", "coefficients"), "")


def rig_of_calibration(pair: CalibratedPair, pixels: tuple[int, int]) -> ImportedRig:
    """The rig of a calibrated pair."""
    from scipy.spatial.transform import Rotation as Turn

    left, right = pair.cameras
    return _rig(
        _camera("left", left, pixels),
        _camera("right", right, pixels),
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

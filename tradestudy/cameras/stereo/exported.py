"""A stereo rig in the form of calibration files: two cameras in pixels, and their relative pose."""

from __future__ import annotations

from dataclasses import replace
from typing import Final, cast

import numpy as np

from tradestudy.cameras.calibrated_pair import CalibratedPair
from tradestudy.cameras.imported import ImportedCamera, ImportedRig, LensModelName, Rotation, Vector
from tradestudy.cameras.parts import Sensor
from tradestudy.cameras.stereo.pair import Pair, pair_poses
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.lens_models.lens_model import LensModel

_KEYS: Final = dict.fromkeys(("focal_lengths", "centre", "pixels", "coefficients"), "")


def rig_of_calibration(pair: CalibratedPair, pixels: tuple[int, int]) -> ImportedRig:
    """The rig of a calibrated pair."""
    from scipy.spatial.transform import Rotation as Turn

    shared = np.array(pair.parameters)
    interiors = np.split(shared[:-6], 2)
    lenses = [
        replace(lens, **dict(zip(pair.free, map(float, interior[4:]), strict=True)))
        for lens, interior in zip(pair.lenses, interiors, strict=True)
    ]
    return _rig(
        _camera("left", interiors[0], lenses[0], pixels),
        _camera("right", interiors[1], lenses[1], pixels),
        Turn.from_rotvec(shared[-6:-3]).as_matrix(),
        shared[-3:],
    )


def rig_of_design(pair: Pair, sensor: Sensor) -> ImportedRig:
    """The designed rig: two equal cameras with centred principal points."""
    focal_length = pair.principal_distance / sensor.pixel_pitch
    middle = ((sensor.columns - 1) / 2.0, (sensor.rows - 1) / 2.0)
    interior = np.array([focal_length, focal_length, *middle])
    left, right = pair_poses(pair, {})
    to_right = np.array(right.rotation).T
    pixels = (sensor.columns, sensor.rows)
    return _rig(
        _camera("left", interior, pair.distortion, pixels),
        _camera("right", interior, pair.distortion, pixels),
        to_right @ np.array(left.rotation),
        to_right @ (np.array(left.centre) - np.array(right.centre)),
    )


def _camera(name: str, interior: FloatArray, lens: LensModel, pixels: tuple[int, int]) -> ImportedCamera:
    fx, fy, cx, cy = (float(one) for one in interior[:4])
    return ImportedCamera(
        name=name,
        focal_lengths=(fx, fy),
        centre=(cx, cy),
        pixels=pixels,
        lens_model=cast(LensModelName, lens.name),
        coefficients=lens.coefficients(),
        conventions=(),
        keys=_KEYS,
    )


def _rig(left: ImportedCamera, right: ImportedCamera, rotation: FloatArray, translation: FloatArray) -> ImportedRig:
    rows: list[Vector] = [(float(row[0]), float(row[1]), float(row[2])) for row in rotation]
    turn: Rotation = (rows[0], rows[1], rows[2])
    moved: Vector = (float(translation[0]), float(translation[1]), float(translation[2]))
    keys = {"rotation": "", "translation": ""}
    return ImportedRig(left=left, right=right, rotation=turn, translation=moved, conventions=(), keys=keys)

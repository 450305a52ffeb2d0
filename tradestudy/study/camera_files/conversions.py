"""Checked matrices of calibration files: rotations, camera matrices and rigid transforms."""

from __future__ import annotations

from typing import Final

import numpy as np

from tradestudy.cameras.imported import Rotation, Vector
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.camera_files.located import Located
from tradestudy.units import ANGLE, pretty

_ORTHOGONALITY: Final = 5e-4  # allows for files with four digits
_INEXACT: Final = 1e-5  # files with six digits stay below
_ROUNDING: Final = 1e-12


def rotation_of(value: Located, numbers: tuple[float, ...]) -> FloatArray:
    """A rotation matrix; the nearest one if it is rounded, noted in the file if that may matter.

    Raises
    ------
    CameraFileError
        It is not orthogonal, or a reflection.
    """
    matrix = np.array(numbers, dtype=np.float64).reshape(3, 3)
    error = float(np.max(np.abs(matrix @ matrix.T - np.eye(3))))
    if error > _ORTHOGONALITY:
        raise value.fail(f"not a rotation: R Rᵀ differs from 1 by {error:.2g}; at most {_ORTHOGONALITY:g} is expected")
    if np.linalg.det(matrix) < 0.0:
        raise value.fail("a reflection, not a rotation; check the signs of its rows")
    if error <= _ROUNDING:
        return matrix
    u, _, v = np.linalg.svd(matrix)
    nearest: FloatArray = u @ v
    if error > _INEXACT:
        angle = float(np.linalg.norm(matrix - nearest, 2))  # of the direction that changes most
        value.file.inexact[value.key] = (
            f"{value.key} is not exactly a rotation: R Rᵀ differs from 1 by {error:.2g}; the nearest rotation is used, "
            f"which changes directions by up to {pretty(angle, ANGLE, 2)}"
        )
    return nearest


def pinhole_of(value: Located, numbers: tuple[float, ...]) -> tuple[tuple[float, float], tuple[float, float]]:
    """Focal lengths and principal point [px] of a camera matrix (3 × 3 or the left part of 3 × 4).

    Raises
    ------
    CameraFileError
        It has skew, is not a camera matrix, or has focal lengths that are not positive.
    """
    matrix = np.array(numbers, dtype=np.float64).reshape(3, -1)[:, :3]
    if not matrix.any():
        raise value.fail("all numbers are 0: this camera was not calibrated; calibrate it, and give the new file")
    fx, skew, cx, fy, cy = matrix[0, 0], matrix[0, 1], matrix[0, 2], matrix[1, 1], matrix[1, 2]
    if not np.array_equal(matrix[[1, 2, 2, 2], [0, 0, 1, 2]], [0.0, 0.0, 0.0, 1.0]):
        raise value.fail("not a camera matrix; [fx 0 cx; 0 fy cy; 0 0 1] is expected")
    if skew != 0.0:
        raise value.fail(f"the pixels have a skew of {skew:g}; only 0 is supported")
    if not (fx > 0.0 and fy > 0.0):
        raise value.fail(f"the focal lengths are {fx:g} and {fy:g} px; positive ones are expected")
    return (float(fx), float(fy)), (float(cx), float(cy))


def rigid_of(value: Located, numbers: tuple[float, ...]) -> tuple[FloatArray, FloatArray]:
    """Rotation and translation of a 4 × 4 transform.

    Raises
    ------
    CameraFileError
        It is not a rigid motion.
    """
    matrix = np.array(numbers, dtype=np.float64).reshape(4, 4)
    if not np.array_equal(matrix[3], [0.0, 0.0, 0.0, 1.0]):
        raise value.fail("not a rigid transform; its last row must be 0 0 0 1")
    return rotation_of(value, tuple(matrix[:3, :3].ravel())), matrix[:3, 3]


def inverse(transform: FloatArray) -> FloatArray:
    """The inverse of a rigid 4 × 4 transform."""
    found: FloatArray = np.eye(4)
    found[:3, :3] = transform[:3, :3].T
    found[:3, 3] = -transform[:3, :3].T @ transform[:3, 3]
    return found


def rotation_tuple(matrix: FloatArray) -> Rotation:
    """A rotation as nested tuples."""
    a, b, c = (tuple(float(one) for one in row) for row in matrix)
    return a, b, c  # type: ignore[return-value]


def vector_tuple(vector: FloatArray) -> Vector:
    """A vector as a tuple."""
    x, y, z = (float(one) for one in vector)
    return x, y, z

"""A second translation or rotation of a pair in a calibration file, compared with the pose that is read."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from typing import Final

import numpy as np

from tradestudy.cameras.imported import Vector
from tradestudy.optics.arrays import FloatArray
from tradestudy.units import ANGLE, LENGTH, pretty

_AGREES: Final = 0.01
"""Relative difference up to which a second value, such as a nominal baseline, says the same."""
_ANGLE_AGREES: Final = 1e-3  # rad
_VECTORS: Final = {"om", "rvec", "rodrigues", "vector"}
"""Three numbers are a rotation vector only under these names; else they may be angles in any order."""
_DEGREES: Final = {"deg", "degree", "degrees"}
_LARGEST: Final = 1e6  # of the numbers of a rotation
_NOT_FINITE: Final = "a number is not finite, or too large; correct it, or remove this key"


def translation_problem(
    lengths: Sequence[float], words: Collection[str], translation: Vector, *, is_parallel: bool = False
) -> str:
    """How a translation, one of its components, or a baseline contradicts the translation that is read.

    Parameters
    ----------
    lengths
        Three components, or one of them or the baseline [m].
    words
        Words of the key.
    translation
        Translation from the first to the second camera of the files [m].
    is_parallel
        One of the two holds for rectified cameras, whose rotation is unknown: lengths and their signs are compared.
    """
    baseline, length = math.hypot(*translation), math.hypot(*lengths)
    if not math.isfinite(length):
        return _NOT_FINITE
    axis = next(("xyz".index(word[-1]) for word in words if word in ("tx", "x", "y", "z")), None)
    expected: tuple[float, ...] = translation
    if len(lengths) == 1 and axis is not None and "baseline" not in words:
        expected = (translation[axis],)
    elif abs(length - baseline) > _AGREES * baseline:
        return (
            f"{pretty(length, LENGTH)} contradicts the baseline that is read, {pretty(baseline, LENGTH)}; correct the "
            "wrong one, or its unit"
        )
    elif len(lengths) == 1:
        return ""
    along = float(np.dot(lengths, expected))
    if math.dist(lengths, expected) <= _AGREES * baseline or (is_parallel and along > 0.0):
        return ""
    opposite = ", but points the opposite way, like that of the inverse pose" if along < 0.0 else ""
    return (
        f"{_shown(lengths)} contradicts the translation that is read, {_shown(expected)} from the first to the second "
        f"camera of the files{opposite}; correct the wrong one, or remove this key if it describes something else"
    )


def _shown(lengths: Sequence[float]) -> str:
    text = ", ".join(pretty(length, LENGTH) for length in lengths)
    return text if len(lengths) == 1 else f"({text})"


def rotation_problem(numbers: Sequence[float], words: Collection[str], rotation: FloatArray) -> tuple[str, bool]:
    """How a rotation contradicts the one that is read, and whether it agrees; neither if its convention is unknown.

    Parameters
    ----------
    numbers
        A matrix, a quaternion, a rotation vector, or one or three angles [rad, or degrees if the key says so].
    words
        Words of the key.
    rotation
        Rotation from the first to the second camera of the files.
    """
    if not math.hypot(*numbers) <= _LARGEST:
        return _NOT_FINITE, False
    if _DEGREES & {*words} and len(numbers) in (1, 3):
        numbers = [math.radians(angle) for angle in numbers]
    rotations, by = [*_rotations_of(numbers, words)], _angle_of(rotation)
    angles = [_angle_of(turn) for turn in rotations]
    if rotations:
        ways = (rotation, rotation.T)
        differ, inverse = (min(float(np.linalg.norm(turn - way, 2)) for turn in rotations) for way in ways)
    elif len(numbers) in (1, 3):  # of one angle, such as the yaw, the others are unknown
        angles = [math.hypot(*numbers)]
        differ, inverse = abs(angles[0] - by) if len(numbers) == 3 else max(angles[0] - by, 0.0), math.inf
    if not angles or min(angles) == 0.0:
        return "", False
    limit = _ANGLE_AGREES + _AGREES * by
    if differ <= limit:
        return "", bool(rotations)
    is_as_large = min(abs(angle - by) for angle in angles) <= limit
    how = " the other way, like the inverse pose," if inverse <= limit else " about another axis" if is_as_large else ""
    return (
        f"a rotation by {pretty(min(angles), ANGLE)}{how} contradicts the one that is read, by {pretty(by, ANGLE)} "
        "from the first to the second camera of the files; correct the wrong one, or remove this key if it describes "
        "something else"
    ), False


def epipolar_problem(
    numbers: Sequence[float], rotation: FloatArray, translation: Vector, matrices: Sequence[FloatArray]
) -> tuple[str, bool]:
    """How an essential or fundamental matrix contradicts the pose x₂ = R x₁ + t that is read, and whether it agrees.

    The essential matrix of a pose is [t]× R, up to scale and sign. Neither is said of a matrix that belongs to no pose:
    its singular values are not s, s and 0 or, for a fundamental matrix, none is 0.

    Parameters
    ----------
    numbers
        Rows of an essential matrix E, or of a fundamental one, F = K₂⁻ᵀ E K₁⁻¹.
    rotation, translation
        R and t.
    matrices
        K₁ and K₂ for a fundamental matrix; empty for an essential one.
    """
    if not math.hypot(*numbers) <= _LARGEST**2:
        return _NOT_FINITE, False
    expected, matrix = np.cross(translation, rotation, axisb=0, axisc=0), np.array(numbers).reshape(3, 3)
    ways = (matrix, matrix.T)
    if matrices:
        ways = (matrices[1].T @ matrix @ matrices[0], matrices[1].T @ matrix.T @ matrices[0])
    large, middle, small = np.linalg.svd(ways[0], compute_uv=False)
    if large == 0.0 or small > _AGREES * large or (not matrices and middle < (1.0 - _AGREES) * large):
        return "", False
    expected, *units = (way / np.linalg.norm(way) for way in (expected, *ways))
    differ, inverse = (min(float(np.linalg.norm(unit - to)) for to in (expected, -expected)) for unit in units)
    if differ <= _ANGLE_AGREES:
        return "", True
    how = "is that of the inverse pose, and " if inverse <= _ANGLE_AGREES else ""
    return (
        f"this {'fundamental' if matrices else 'essential'} matrix {how}contradicts the pose that is read: it "
        f"differs from the matrix of that pose by {differ:.2g} of its norm; correct the wrong one, or remove this key"
    ), False


def _angle_of(rotation: FloatArray) -> float:
    return math.acos(min(max((float(np.trace(rotation)) - 1.0) / 2.0, -1.0), 1.0))


def _rotations_of(numbers: Sequence[float], words: Collection[str]) -> Iterator[FloatArray]:
    """The rotations that a matrix, a rotation vector [rad] or a quaternion, real part first or last, may mean."""
    from scipy.spatial.transform import Rotation  # heavy, and few files have one

    if len(numbers) == 9:
        yield np.array(numbers).reshape(3, 3)
    elif len(numbers) == 3 and _VECTORS & {*words}:
        yield Rotation.from_rotvec(numbers).as_matrix()
    elif len(numbers) == 4 and math.hypot(*numbers) >= 1.0 / _LARGEST:
        for order in (numbers, (*numbers[1:], numbers[0])):
            yield Rotation.from_quat(order).as_matrix()

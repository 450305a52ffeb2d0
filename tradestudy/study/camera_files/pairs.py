"""Pairs of imported cameras: their matrices, checked for exchange, wrong units and wrong lens models."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Final, cast

import numpy as np

from tradestudy.calibration.projection import LARGEST_ROLL, roll
from tradestudy.cameras.imported import (
    PICTURE_SIZE,
    RIGHT_SIZE,
    Convention,
    ImportedCamera,
    ImportedParts,
    ImportedPlenoptic,
    ImportedRig,
    LensModelName,
    Rotation,
    Vector,
    size_words,
)
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.lens_families import FAMILIES
from tradestudy.study.camera_files.located import PIXEL_ORIGIN, Located
from tradestudy.units import ANGLE, FRACTION, LENGTH, pretty
from tradestudy.wording import listed

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
    # The orthogonal factor of the polar decomposition, which is a rotation because the determinant is positive.
    u, _, v = np.linalg.svd(matrix)
    nearest: FloatArray = u @ v
    if error > _INEXACT:
        angle = float(np.linalg.norm(matrix - nearest, 2))  # of the direction that changes most
        value.file.inexact[value.key] = (
            f"{value.key} is not exactly a rotation: R Rᵀ differs from 1 by {error:.2g}; the nearest rotation is used, "
            f"which changes directions by up to {pretty(angle, ANGLE, 2)}"
        )
    return nearest


def pinhole_of(value: Located, numbers: tuple[float, ...]) -> tuple[float, float, float, float]:
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
    return pinhole(value, float(fx), float(fy), float(cx), float(cy))


def pinhole(value: Located, fx: float, fy: float, cx: float, cy: float) -> tuple[float, float, float, float]:
    """Focal lengths and principal point [px]; refused unless the focal lengths are positive."""
    if not (fx > 0.0 and fy > 0.0):
        raise value.fail(f"the focal lengths are {fx:g} and {fy:g} px; positive ones are expected")
    return fx, fy, cx, cy


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
    inverted: FloatArray = np.eye(4)
    inverted[:3, :3] = transform[:3, :3].T
    inverted[:3, 3] = -transform[:3, :3].T @ transform[:3, 3]
    return inverted


_SHORTEST, _LONGEST = 5e-4, 20.0  # baselines [m]; beyond these, the unit of length is certainly wrong
_USUAL_FROM, _USUAL_TO = 1e-2, 2.5  # beyond these, it is probably wrong; T in squares of a board is 1 to 10
_UNITS: Final = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
UNUSUAL_BASELINE: Final = "baseline"
"""Name of the convention that states that another unit of length would give a usual baseline."""
UNUSUAL_NOISE: Final = "corner noise"
"""Name of the convention that states that corners scatter more about a fit than those of any detector."""
FOLDING_LENS: Final = "part of the picture without direction"
"""Name of the convention that states that the lens model of a camera does not reach the edges of its picture."""
EXCHANGED_NAMES: Final = "names of the cameras"
"""Name of the convention that states that the names left and right contradict the geometry of a pair."""
UNUSUAL_SIGN: Final = "sign of the projection"
"""Name of the convention that states that the signs of a pair's projection matrices are not those of ROS."""
UNUSUAL_MATRIX: Final = "camera matrix"
"""Name of the convention that states that a camera matrix does not fit the picture."""
INEXACT_ROTATION: Final = "inexact rotation"
"""Name of the convention that states which matrices of the files the nearest rotation replaces."""
OFF_CENTRE: Final = "principal point"
"""Name of the convention that states that a principal point lies far from the middle of the picture."""
_SHORTEST_LENS, _LONGEST_LENS = 0.1, 100.0  # focal length over the wider side of the picture: 157° to 0.6° across
_LARGEST_ASPECT = 1.25  # of pixels
_FARTHEST_CENTRE: Final = 0.12
"""Distance of usual principal points from the middle of the picture, along each side and divided by it.

Those of whole sensors lie within 0.05. Exchanged sides move it by 0.125 (5 : 4) and 0.17 (4 : 3) or more; a size of
another resolution by 0.125 (4/3 times the right one) and 0.25 (twice).
"""
_ORDER, _UPPER = "order of cameras", "is upper"
_QUARTER: Final = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
_PLACES: Final = 65  # points along each side of a picture at which directions are computed
_LEAST_FOCAL_PX, _MOST_PX = 1e-12, 1e9  # between which directions do not overflow
_LARGEST_TANGENTIAL: Final = 0.05
"""p1 and p2 of real lenses are below 0.01; 0.05 would shift a slope of 1 by a tenth."""


def paired(
    first: ImportedCamera,
    second: ImportedCamera,
    rotation: FloatArray,
    translation: FloatArray,
    *,
    metre: float,
    where: tuple[Located, Located],
    exchanged: str,
    otherwise: str = "",
    conventions: tuple[Convention, ...],
) -> ImportedRig:
    """The pair of two cameras.

    Parameters
    ----------
    first, second
        Left and right, or upper and lower.
    rotation, translation
        From the first camera to the second one, ``x₂ = R x₁ + t`` [m].
    metre
        Unit of length of the files [m].
    where
        Where the files give these two.
    exchanged
        What to do if the second camera lies to the left of the first one, or above it.
    otherwise
        What else than the unit of length may explain an unusual baseline.
    conventions
        Conventions of the files.

    Raises
    ------
    CameraFileError
        The cameras are at one place, one behind the other or exchanged; one is rolled against the other, or looks
        backwards; or the baseline indicates a wrong unit of length.
    """
    at = where[1]
    x, y, z = (float(component) for component in translation)
    baseline = float(np.linalg.norm(translation))
    if not baseline > 0.0:
        raise at.fail("both cameras are at the same place; a baseline is expected")
    if problem := baseline_problem(baseline, _by_units(baseline, metre)):
        raise at.fail(problem)
    _check_orientation(rotation, second.name, first.name, where[0])
    if abs(z) >= max(abs(x), abs(y)):
        raise at.fail("the cameras are one behind the other; a pair side by side is expected")
    is_vertical = abs(y) > abs(x)
    if (y if is_vertical else x) > 0.0:
        side = "above" if is_vertical else "to the left of"
        raise at.fail(f"{second.name} lies {pretty(baseline, LENGTH)} {side} {first.name}; {exchanged}")
    key = at.key
    sides = (_UPPER, "lower: both pictures are rotated by 90°") if is_vertical else ("is left", "right")
    conventions = (
        *conventions,
        Convention(name=_ORDER, says=f"{first.name} {sides[0]}, {second.name} {sides[1]}", key=key),
    )
    if not is_usual(baseline) and (says := _by_units(baseline, metre)):
        conventions = (*conventions, Convention(name=UNUSUAL_BASELINE, says=says + otherwise, key=key))
    pair = (first, second)
    doubts = {name: "; ".join(filter(None, map(words, pair))) for name, words in _DOUBTS.items()}
    couples = zip(pair, pair[::-1], strict=True)
    centres = {camera.name: (camera.centre, camera.pixels or other.pixels) for camera, other in couples}
    doubts[OFF_CENTRE] = off_centre(centres)
    if not is_vertical and _side_in(first.name) == "right" and _side_in(second.name) == "left":
        doubts[EXCHANGED_NAMES] = f"by the geometry, {first.name} is the left camera, and {second.name} the right one"
    for name, says in doubts.items():
        if says:
            conventions = (*conventions, Convention(name=name, says=says, key=key))
    sizes = [size_convention(camera, is_vertical) for camera in pair if camera.pixels is not None]
    conventions = (*conventions, *sizes[:1])
    if len(sizes) == 2 and sizes[0].says != sizes[1].says:
        conventions = (*conventions, replace(sizes[1], name=RIGHT_SIZE))
    if is_vertical:
        first, second = _turned(first, at), _turned(second, at)
        rotation, translation = _QUARTER @ rotation @ _QUARTER.T, _QUARTER @ translation
    return ImportedRig(
        left=first,
        right=second,
        rotation=cast(Rotation, tuple(map(tuple, rotation.tolist()))),
        translation=cast(Vector, tuple(translation.tolist())),
        conventions=conventions,
        keys={"rotation": where[0].key, "translation": key},
    )


def _side_in(name: str) -> str:
    """The side that the name of a camera contains, such as ``stereo/left``; empty if none or both."""
    sides = [side for side in ("left", "right") if side in name.lower()]
    return sides[0] if len(sides) == 1 else ""


def size_convention(
    camera: ImportedCamera | ImportedPlenoptic | ImportedParts, is_vertical: bool = False
) -> Convention:
    """The size of a camera's pictures, which the calibration requires."""
    assert camera.pixels is not None
    says = size_words(camera.pixels)
    if is_vertical:
        says += f", rotated to {size_words(camera.pixels[::-1])}"
    return Convention(name=PICTURE_SIZE, says=says, key=camera.keys["pixels"])


def is_usual(baseline: float) -> bool:
    """Whether a baseline [m] is as long as those of most rigs."""
    return _USUAL_FROM <= baseline <= _USUAL_TO


def baseline_problem(baseline: float, by_other_units: str = "") -> str:
    """Why a baseline [m] shows that the unit of length is wrong; empty if it does not."""
    if _SHORTEST <= baseline <= _LONGEST:
        return ""
    expected = f"{pretty(_SHORTEST, LENGTH)} to {pretty(_LONGEST, LENGTH)}"
    return f"the baseline would be {by_other_units or pretty(baseline, LENGTH)}; {expected} is expected"


def _by_units(baseline: float, metre: float) -> str:
    """A baseline [m] and its usual values in units of length other than this one [m]; empty if it has none."""
    by_unit = {name: baseline / metre * unit for name, unit in _UNITS.items() if not math.isclose(unit, metre)}
    fitting = [
        f"{pretty(length, LENGTH)} with length_unit: {name}"
        for name, length in by_unit.items()
        if _USUAL_FROM <= length <= _USUAL_TO
    ]
    return f"{pretty(baseline, LENGTH)}, but {' or '.join(fitting)} beside from:" if fitting else ""


def _check_orientation(rotation: FloatArray, second: str, first: str, at: Located) -> None:
    """Refuse cameras with axes 90° or more apart, or with disparity along different axes of their pictures."""
    if rotation[2, 2] <= 0.0:
        angle = np.degrees(np.arccos(np.clip(rotation[2, 2], -1.0, 1.0)))
        raise at.fail(
            f"the axes of {second} and {first} are {angle:.0f}° apart; cameras that look the same way, with axes less "
            "than 90° apart, are expected"
        )
    if (turned := abs(roll(rotation))) > LARGEST_ROLL:
        raise at.fail(
            f"{second} is rotated by {np.degrees(turned):.0f}° about its viewing axis relative to {first}; turn its "
            "pictures upright and calibrate again, so that the rows of both are parallel"
        )


_DECLARE_FISHEYE: Final = "name the model equidistant in the file"


def checked_camera(
    name: str,
    pinhole: tuple[float, float, float, float],
    lens_model: LensModelName,
    coefficients: Mapping[str, float],
    *,
    matrix: Located,
    lens: Located,
    size: Located | tuple[Located, Located] | None,
    pixels: tuple[int, int] | None = None,
    says: str = "",
    named: Located | None = None,
    conventions: tuple[Convention, ...] = (),
    fisheye: str | None = None,
) -> ImportedCamera:
    """One camera of a file, refused if its values cannot belong to a camera with its lens model.

    Parameters
    ----------
    name
        Name of the camera.
    pinhole
        Focal lengths and principal point, f_x, f_y, c_x, c_y [px].
    lens_model, coefficients
        Family of the lens and its coefficients.
    matrix, lens
        Where the file gives the pinhole and the coefficients.
    size, pixels
        Where the file gives columns and rows of the pictures; if it does not, those that the study gives.
    says, named
        The lens model in the words of the format, and where the file names it; empty if it names none.
    conventions
        Further conventions of the file.
    fisheye
        How to declare a fisheye lens, if not as in most files; empty if the study declares that the lens is none.

    Raises
    ------
    CameraFileError
        A focal length, the principal point or a coefficient lies outside its range, or a fisheye lens is labelled as
        a pinhole.
    """
    if not (min(map(abs, pinhole[:2])) >= _LEAST_FOCAL_PX and max(map(abs, pinhole)) <= _MOST_PX):
        shown = ", ".join(f"{value:g}" for value in pinhole)
        raise matrix.fail(
            f"focal lengths and principal point of {shown} px belong to no camera (allowed: focal lengths of "
            f"{_LEAST_FOCAL_PX:g} px or more, nothing beyond {_MOST_PX:g} px); correct them"
        )
    if lens_model in FAMILIES:
        try:
            FAMILIES[lens_model](**coefficients)
        except OutOfRangeError as error:
            raise lens.fail(str(error)) from None
    for coefficient in ("p1", "p2") if lens_model == "rational" and fisheye != "" else ():
        shift = coefficients.get(coefficient, 0.0)
        if abs(shift) > _LARGEST_TANGENTIAL:
            raise lens.fail(
                f"{coefficient} = {shift:g} is too large for tangential distortion (below {_LARGEST_TANGENTIAL:g}); "
                f"the coefficients are probably k1 to k4 of a fisheye lens: {fisheye or _DECLARE_FISHEYE}"
            )
    if size is not None:
        width, height = size.pair() if isinstance(size, Located) else size
        pixels = (width.count(), height.count())
    return ImportedCamera(
        name=name,
        focal_lengths=pinhole[:2],
        centre=pinhole[2:],
        pixels=pixels,
        lens_model=lens_model,
        coefficients=coefficients,
        conventions=(
            Convention(name="origin of pixels", says=PIXEL_ORIGIN, key=matrix.key),
            *((Convention(name="lens model", says=says, key=(named or lens).key),) if says else ()),
            *conventions,
        ),
        keys={
            "focal_lengths": matrix.key,
            "centre": matrix.key,
            "pixels": (size if isinstance(size, Located) else (size or (matrix,))[0]).key,
            "coefficients": lens.key,
        },
    )


def _folding(camera: ImportedCamera) -> str:
    """The part of a picture beyond the angle at which its lens model folds, in words; empty if there is none."""
    if camera.pixels is None or camera.lens_model not in FAMILIES:  # a model of mrcal that covers the whole picture
        return ""
    lens = FAMILIES[camera.lens_model](**camera.coefficients)
    steps = (np.arange(_PLACES) + 0.5) / _PLACES
    places = np.stack(np.meshgrid(*(count * steps - 0.5 for count in camera.pixels)), axis=-1)
    directions = lens.unproject((places - camera.centre) / camera.focal_lengths)
    missing = float(np.mean(np.isnan(directions).any(axis=-1)))
    if missing == 0.0:
        return ""
    ends = pretty(float(lens.valid_field), ANGLE)
    return f"{pretty(missing, FRACTION, 2)} of the picture of {camera.name}, whose lens model folds {ends} off the axis"


def unusual_matrix(camera: ImportedCamera) -> str:
    """Focal lengths that no usual camera has, in words; empty if there are none."""
    (fx, fy), doubts = camera.focal_lengths, []
    if not 1.0 / _LARGEST_ASPECT <= fx / fy <= _LARGEST_ASPECT:
        doubts.append(f"focal lengths of {fx:g} and {fy:g} px mean pixels that are not square")
    if camera.pixels is not None:
        columns, rows = camera.pixels
        if not _SHORTEST_LENS <= max(fx, fy) / max(columns, rows) <= _LONGEST_LENS:
            doubts.append(f"a focal length of {fx:g} px is unusual for a picture of {columns} × {rows} px")
    return f"{camera.name}: {', and '.join(doubts)}" if doubts else ""


def off_centre(cameras: Mapping[str, tuple[tuple[float, float], tuple[int, int] | None]]) -> str:
    """How far the principal points [px] of cameras are from the middle of their pictures, with the likely cause.

    In words, those alike together. Left out are cameras whose point is at most 12 % of the width and of the height
    away, or whose picture has an unknown size.
    """
    alike: dict[str, dict[str, str]] = {}
    for name, (centre, pixels) in cameras.items():
        if pixels is None or _is_central(centre, pixels):
            continue
        (x, y), (columns, rows) = centre, pixels
        is_inside = -0.5 <= x <= columns - 0.5 and -0.5 <= y <= rows - 0.5
        place = "far from the middle of" if is_inside else "outside"
        cause = "the size may be that of another resolution, or the picture be cropped"
        if _is_central(centre, pixels[::-1]):
            cause = "width and height are probably exchanged"
        where = (
            f"{place} the picture of {columns} × {rows} px, whose middle is "
            f"({(columns - 1) / 2:g}, {(rows - 1) / 2:g}) px; {cause}"
        )
        alike.setdefault(where, {})[name] = f"({x:g}, {y:g})"
    return "; ".join(
        f"{listed(list(points))}: the principal {_points(list(dict.fromkeys(points.values())))} {where}"
        for where, points in alike.items()
    )


def _points(distinct: list[str]) -> str:
    return f"point {distinct[0]} px lies" if len(distinct) == 1 else f"points {listed(distinct)} px lie"


def _is_central(centre: tuple[float, float], pixels: tuple[int, int]) -> bool:
    return all(abs(at - (count - 1) / 2) <= _FARTHEST_CENTRE * count for at, count in zip(centre, pixels, strict=True))


_DOUBTS: Final[Mapping[str, Callable[[ImportedCamera], str]]] = {
    FOLDING_LENS: _folding,
    UNUSUAL_MATRIX: unusual_matrix,
}
"""What may be wrong with one camera of a pair, in words, by the name of its convention."""


def _turned(camera: ImportedCamera, at: Located) -> ImportedCamera:
    """A camera with its pictures rotated by 90°, so that down becomes right.

    Radial coefficients stay; (p2, p1) and (s1, s3), (s2, s4) rotate with the picture.
    """
    if camera.pixels is None:
        raise at.fail(
            "a vertical pair needs the size of its pictures, which the file does not state; give "
            "sensor: {pixels: [1280, 720]}, columns and rows as taken"
        )
    if any(camera.coefficients.get(name, 0.0) for name in ("tau_x", "tau_y")):
        raise at.fail("a vertical pair with a tilted sensor (tau_x, tau_y) is not supported")
    columns, rows = camera.pixels
    (fx, fy), (cx, cy), old = camera.focal_lengths, camera.centre, camera.coefficients
    turned = dict(old)
    for across, down in (("p2", "p1"), ("s1", "s3"), ("s2", "s4")):
        if across in old or down in old:
            turned[across], turned[down] = old.get(down, 0.0), -old.get(across, 0.0)
    return replace(
        camera, focal_lengths=(fy, fx), centre=(cy, columns - 1 - cx), pixels=(rows, columns), coefficients=turned
    )


def as_filed(rig: ImportedRig, is_reversed: bool = False) -> ImportedRig:
    """The pair as its files give it: a vertical one with its pictures as taken, not rotated to a horizontal one.

    Parameters
    ----------
    rig
        A pair from `paired`.
    is_reversed
        Whether the files give the right camera first; the result then leads from right to left.
    """
    rotation, translation, cameras = np.array(rig.rotation), np.array(rig.translation), (rig.left, rig.right)
    if any(entry.name == _ORDER and entry.says.startswith(f"{rig.left.name} {_UPPER}") for entry in rig.conventions):
        rotation, translation = _QUARTER.T @ rotation @ _QUARTER, _QUARTER.T @ translation
        cameras = _turned_back(rig.left), _turned_back(rig.right)
    if is_reversed:
        rotation, translation, cameras = rotation.T, -rotation.T @ translation, cameras[::-1]
    return replace(
        rig,
        left=cameras[0],
        right=cameras[1],
        rotation=cast(Rotation, tuple(map(tuple, rotation.tolist()))),
        translation=cast(Vector, tuple(translation.tolist())),
    )


def _turned_back(camera: ImportedCamera) -> ImportedCamera:
    """Focal lengths, principal point and size from before `_turned`."""
    assert camera.pixels is not None  # or `_turned` would have refused it
    (fx, fy), (cx, cy), (columns, rows) = camera.focal_lengths, camera.centre, camera.pixels
    return replace(camera, focal_lengths=(fy, fx), centre=(rows - 1 - cy, cx), pixels=(rows, columns))

"""OpenCV FileStorage (YAML, XML, JSON): one camera, a stereo calibration, or two cameras and their extrinsics."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from tradestudy.cameras.imported import Convention, Imported, ImportedCamera, ImportedRig, LensModelName
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.camera_files.conversions import pinhole_of, rotation_of
from tradestudy.study.camera_files.located import CameraFile, Located
from tradestudy.study.camera_files.pairs import check_lens, paired
from tradestudy.study.camera_files.request import (
    Format,
    Request,
    coefficients_of,
    origin_of_pixels,
    shortest_coefficients,
)
from tradestudy.study.document import ListEntry, MappingEntry

_ORDER: Final = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tau_x", "tau_y")
_ORDER_FISHEYE: Final = ("k1", "k2", "k3", "k4")
_MATRIX: Final = ("camera_matrix", "cameraMatrix", "Camera_Matrix", "CameraMatrix", "intrinsic_matrix", "K", "M")
_DISTORTION: Final = (
    "distortion_coefficients", "distCoeffs", "Distortion_Coefficients", "DistortionCoefficients", "dist_coeffs", "D",
)  # fmt: skip
_SIDES: Final = (("1", "left", "Left", "L"), ("2", "right", "Right", "R"))
_ROTATION, _TRANSLATION = ("R", "rotation", "rotation_matrix"), ("T", "translation", "translation_vector")


def recognises(file: CameraFile) -> bool:
    """Whether a file has OpenCV's header, tags or form of matrices."""
    if file.syntax in ("opencv-yaml", "opencv-xml"):
        return True
    root = file.root
    return isinstance(root, MappingEntry) and any(
        isinstance(member.entry, MappingEntry) and member.entry.members.keys() >= {"rows", "cols", "dt", "data"}
        for member in root.members.values()
    )


def read(files: Sequence[CameraFile], request: Request) -> Imported:
    """One camera from one file; a pair from a stereo calibration, or from two camera files and one of extrinsics.

    Raises
    ------
    CameraFileError
        A value is missing, invalid or inconsistent.
    """
    tops = [file.top for file in files]
    pairs = [top for top in tops if top.find(*_names(_MATRIX, 0)) is not None]
    alone = [top for top in tops if top not in pairs and top.find(*_MATRIX) is not None]
    if not pairs and len(alone) == 1 and len(tops) == 1:
        return _camera(alone[0], "camera", _MATRIX, _DISTORTION, request)
    extrinsic = next((top for top in tops if top.find(*_TRANSLATION) is not None), None)
    if extrinsic is None:
        raise tops[-1].fail(
            "two cameras need R and T; give a stereo calibration, or two camera files and one with R and T"
        )
    if request.pictures == "rectified":
        return _rectified(pairs[0] if pairs else extrinsic, extrinsic, request)
    if pairs:
        _refuse_one_distortion(pairs[0])
        first, second = (
            _camera(pairs[0], f"camera {side + 1}", _names(_MATRIX, side), _names(_DISTORTION, side), request)
            for side in (0, 1)
        )
    elif len(alone) == 2:
        first, second = (_camera(top, top.file.path.stem, _MATRIX, _DISTORTION, request) for top in alone)
    else:
        raise extrinsic.fail(
            "R and T are given without the two cameras: their keys are M1 and M2, or camera_matrix, cameraMatrix or K "
            "followed by 1 and 2, _left and _right, or _L and _R (distortion: D1 and D2, or likewise "
            f"distortion_coefficients or distCoeffs){_given(extrinsic)}; rename the keys, or list all files: "
            "from: [left.yml, right.yml, extrinsics.yml]"
        )
    turn, moved = extrinsic.need(*_ROTATION), extrinsic.need(*_TRANSLATION)
    metre, unit = request.metres(moved)
    undistorted = Convention(name="distortion", says="none is given", key=moved.key)
    lenses = () if first.coefficients or second.coefficients else (undistorted,)
    return paired(
        first,
        second,
        rotation_of(turn, _matrix(turn, 9)),
        np.array(_matrix(moved, 3)) * metre,
        metre=metre,
        where=(turn, moved),
        conventions=(*_conventions(moved, "raw: as taken, before rectification"), unit, *lenses),
    )


def _refuse_one_distortion(top: Located) -> None:
    """Refuse a pair in which only one camera has distortion coefficients: the other's key may be misspelt."""
    given = [top.find(*_names(_DISTORTION, side)) for side in (0, 1)]
    for side, own in enumerate(given):
        other = given[1 - side]
        if own is None and other is not None:
            raise other.fail(
                f"camera {2 - side} has distortion coefficients, but camera {side + 1} has none under any of the known "
                "keys, such as D1 and D2; rename its key, or write zeros for a lens without distortion"
            )


def _given(top: Located) -> str:
    """The first keys of a file, for a message."""
    names = top.names()
    return f", but the file has {', '.join(names[:8])}{', …' if len(names) > 8 else ''}" if names else ""


def _conventions(moved: Located, pictures: str) -> tuple[Convention, ...]:
    return (
        Convention(name="format", says="OpenCV FileStorage", key=moved.key),
        Convention(
            name="direction of transforms",
            says="first to second camera, x₂ = R x₁ + T, as by stereoCalibrate",
            key=moved.key,
        ),
        Convention(name="pictures", says=pictures, key=moved.key),
    )


def _names(names: Sequence[str], side: int) -> tuple[str, ...]:
    """Names of a matrix for one of two cameras."""
    ends = _SIDES[side]
    return tuple(one for name in names for end in ends for one in (f"{name}{end}", f"{name}_{end}", f"{end}_{name}"))


def _camera(
    top: Located, name: str, matrices: Sequence[str], distortions: Sequence[str], request: Request
) -> ImportedCamera:
    """One camera of a file, under any of its possible keys."""
    matrix = top.need(*matrices)
    focal_lengths, centre = pinhole_of(matrix, _matrix(matrix, 9))
    distortion = top.find(*distortions)
    model, coefficients = ("rational", {}) if distortion is None else _lens(top, distortion, request)
    size = _size(top)
    keys = {"focal_lengths": matrix.key, "centre": matrix.key}
    camera = ImportedCamera(
        name=name,
        focal_lengths=focal_lengths,
        centre=centre,
        pixels=None if size is None else (size[0].count(), size[1].count()),
        lens_model=model,
        coefficients=coefficients,
        conventions=(
            origin_of_pixels(matrix),
            Convention(name="lens model", says=_LENS_WORDS[model], key=(distortion or matrix).key),
        ),
        keys={**keys, "pixels": "" if size is None else size[0].key, "coefficients": (distortion or matrix).key},
    )
    return check_lens(camera, distortion or matrix)


_LENS_WORDS: Final = {"rational": "pinhole, OpenCV's order k1 k2 p1 p2 k3 …", "kannala-brandt": "fisheye, k1 to k4"}


def _lens(top: Located, distortion: Located, request: Request) -> tuple[LensModelName, Mapping[str, float]]:
    numbers = _matrix(distortion, 4, 5, 8, 12, 14)
    flag = top.find("fisheye_model", "fisheye")
    if request.lens_model == "fisheye" or (flag is not None and flag.text().lower() in ("1", "true")):
        if len(numbers) != 4:
            raise distortion.fail(f"{len(numbers)} coefficients are given; a fisheye lens has 4")
        return "kannala-brandt", dict(zip(_ORDER_FISHEYE, numbers, strict=True))
    return "rational", dict(zip(_ORDER, numbers, strict=False))


def _size(top: Located) -> tuple[Located, Located] | None:
    """Columns and rows, in any form that programs based on OpenCV write."""
    for across, down in (("image_width", "image_height"), ("image_Width", "image_Height"), ("width", "height")):
        if top.has(across, down):
            return top.need(across), top.need(down)
    both = top.find("image_size", "imageSize", "img_size", "Image_Size", "size")
    if both is None:
        return None
    if isinstance(both.entry, ListEntry):
        items = tuple(both.items())
        if len(items) != 2:
            raise both.fail(f"{len(items)} values are given; width and height are expected")
        return items[0], items[1]
    return both.need("width"), both.need("height")


def _matrix(value: Located, *counts: int) -> tuple[float, ...]:
    """All numbers of a matrix, row by row."""
    if isinstance(value.entry, ListEntry):
        return value.numbers(*counts)
    sizes = value.find("sizes")  # of a list in the form of OpenCV 5
    extents = [*sizes.items()] if sizes is not None else [value.need("rows"), value.need("cols")]
    numbers = value.need("data").numbers(*counts)
    if math.prod(extent.count() for extent in extents) != len(numbers):
        announced = " × ".join(extent.text() for extent in extents)
        raise value.fail(f"{announced} elements are declared, but {len(numbers)} are given")
    return numbers


def _rectified(pair: Located, extrinsic: Located, request: Request) -> Imported:
    """The rectified pair, from its projection matrices: equal focal lengths, no distortion, parallel axes."""
    holder = pair if pair.find("P1") is not None else extrinsic
    if holder.find("P1") is None:
        raise holder.fail("rectified pictures need P1 and P2 from stereoRectify; add them to the file")
    cameras = []
    for side, name in enumerate(("P1", "P2")):
        value = holder.need(name)
        focal_lengths, centre = pinhole_of(value, _matrix(value, 12))
        size = _size(pair)
        cameras.append(
            ImportedCamera(
                name=f"camera {side + 1}",
                focal_lengths=focal_lengths,
                centre=centre,
                pixels=None if size is None else (size[0].count(), size[1].count()),
                lens_model="rational",
                coefficients={},
                conventions=(origin_of_pixels(value),),
                keys={
                    "focal_lengths": value.key,
                    "centre": value.key,
                    "pixels": "" if size is None else size[0].key,
                    "coefficients": value.key,
                },
            )
        )
    value = holder.need("P2")
    metre, unit = request.metres(value)
    return paired(
        cameras[0],
        cameras[1],
        np.eye(3),
        translation_of_projection(value, _matrix(value, 12)) * metre,
        metre=metre,
        where=(value, value),
        conventions=(*_conventions(value, "rectified, by P1 and P2"), unit),
    )


def translation_of_projection(value: Located, numbers: tuple[float, ...]) -> FloatArray:
    """Position of the first rectified camera in the frame of the second one, from P = [K, K t].

    Raises
    ------
    CameraFileError
        P contains no baseline, or the cameras are not side by side.
    """
    matrix = np.array(numbers, dtype=np.float64).reshape(3, 4)
    (fx, fy), _ = pinhole_of(value, numbers)
    if matrix[0, 3] == 0.0 and matrix[1, 3] == 0.0:
        raise value.fail(
            "P[3] and P[7] are both 0, so the second camera has no baseline; use the camera_info of a pair that was "
            "calibrated together"
        )
    if matrix[2, 3] != 0.0:
        raise value.fail("P[11] is not 0; rectified cameras are side by side")
    with np.errstate(over="ignore"):
        moved: FloatArray = np.array([matrix[0, 3] / fx, matrix[1, 3] / fy, 0.0])
    if not np.all(np.isfinite(moved)):
        raise value.fail(f"P[3] and P[7], {matrix[0, 3]:g} and {matrix[1, 3]:g}, are too large for the focal length")
    return moved


def write(rig: ImportedRig, stem: str) -> Mapping[str, str]:
    """A stereo calibration in YAML, in metres."""
    lines = ["%YAML:1.0", "---", "# lengths in metres: import with length_unit: m"]
    if rig.left.pixels is not None:
        lines += [f"image_width: {rig.left.pixels[0]}", f"image_height: {rig.left.pixels[1]}"]
    fisheye = [camera.lens_model == "kannala-brandt" for camera in (rig.left, rig.right)]
    if all(fisheye):
        lines.append("fisheye_model: 1")
    matrices: dict[str, tuple[tuple[int, int], Sequence[float]]] = {}
    for side, camera in (("1", rig.left), ("2", rig.right)):
        (fx, fy), (cx, cy) = camera.focal_lengths, camera.centre
        matrices[f"M{side}"] = ((3, 3), (fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0))
        if all(fisheye):
            lens = coefficients_of(camera, _ORDER_FISHEYE, of="kannala-brandt")
        else:
            lens = shortest_coefficients(camera, _ORDER, (5, 8, 12, 14))
        matrices[f"D{side}"] = ((1, len(lens)), lens)
    matrices["R"] = ((3, 3), [one for row in rig.rotation for one in row])
    matrices["T"] = ((3, 1), rig.translation)
    for name, ((rows, columns), values) in matrices.items():
        data = ", ".join(map(repr, values))
        lines += [f"{name}: !!opencv-matrix", f"   rows: {rows}", f"   cols: {columns}", "   dt: d"]
        lines.append(f"   data: [ {data} ]")
    return {f"{stem}-opencv.yml": "\n".join(lines) + "\n"}


FORMAT: Final = Format(
    name="OpenCV FileStorage",
    word="opencv",
    options=("length_unit", "pictures", "lens_model"),
    recognises=recognises,
    read=read,
    write=write,
)

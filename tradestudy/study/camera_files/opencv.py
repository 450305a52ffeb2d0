"""OpenCV FileStorage (YAML, XML, JSON): one camera, a stereo calibration, or two cameras and their extrinsics."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from tradestudy.cameras.imported import Convention, Imported, ImportedCamera, ImportedRig, LensModelName
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.camera_files.located import (
    CameraFile,
    Format,
    Located,
    Request,
    UnsupportedLensError,
    coefficients_of,
    shortest_coefficients,
)
from tradestudy.study.camera_files.pairs import checked_camera, paired, pinhole_of, rotation_of
from tradestudy.study.document import Entry, ListEntry, MappingEntry, ScalarEntry

_ORDER: Final = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tau_x", "tau_y")
_ORDER_FISHEYE: Final = ("k1", "k2", "k3", "k4")
_MATRIX: Final = (
    "camera_matrix", "cameraMatrix", "Camera_Matrix", "CameraMatrix", "intrinsic_matrix", "intrinsics", "K", "M", "mtx",
    "cam_mtx",
)  # fmt: skip
_DISTORTION: Final = (
    "distortion_coefficients", "distCoeffs", "Distortion_Coefficients", "DistortionCoefficients", "dist_coeffs",
    "distortion_coeffs", "distortion", "dist", "dist_coeff", "distCoeff", "D",
)  # fmt: skip
_FISHEYE_NAMES: Final = ("fisheye", "equidistant", "kannala_brandt", "kannala_brandt4")
_PINHOLE_NAMES: Final = ("pinhole", "perspective", "plumb_bob", "radtan", "rational_polynomial", "brown_conrady")
_WIDE: Final = 0.75  # slope of a corner of the picture, above which a fisheye lens and a pinhole differ by much
_SIDES: Final = (("1", "left", "Left", "L", "l", "LEFT"), ("2", "right", "Right", "R", "r", "RIGHT"))
_SIZE: Final = ("image_size", "imageSize", "img_size", "Image_Size", "size", "Size")
_ROTATION: Final = ("R", "rotation", "rotation_matrix", "rotationMatrix", "Rot", "rot")
_TRANSLATION: Final = ("T", "translation", "translation_vector", "translationVector", "Trans", "trans")


def recognises(file: CameraFile) -> bool:
    """Whether a file has OpenCV's header, tags or form of matrices."""
    if file.syntax in ("opencv-yaml", "opencv-xml"):
        return True
    root = file.root
    return isinstance(root, MappingEntry) and any(
        isinstance(member.entry, MappingEntry) and member.entry.members.keys() >= {"rows", "cols", "dt", "data"}
        for member in root.members.values()
    )


def _recognises_lists(file: CameraFile) -> bool:
    """Whether a file has a matrix of 9 numbers as a list, under any of the keys that OpenCV's files have."""
    names = (*_MATRIX, *_names(_MATRIX, 0), *_names(_MATRIX, 1), *_ROTATION)
    tops = [file.top, *filter(None, (_side(file.top, side) for side in (0, 1)))]
    return any((value := top.find(key)) is not None and _is_square(value.entry) for top in tops for key in names)


def _is_square(entry: Entry) -> bool:
    items = entry.items if isinstance(entry, ListEntry) else ()
    return len(items) == 9 or (
        len(items) == 3 and all(isinstance(row, ListEntry) and len(row.items) == 3 for row in items)
    )


def _side(top: Located, side: int) -> Located | None:
    """The mapping of one camera of a pair, such as ``left`` or ``camera1``."""
    names = (name for end in _SIDES[side] for name in (end, f"cam{end}", f"camera{end}", f"camera_{end}"))
    parts = (top.find(key) for key in names)
    return next((part for part in parts if part is not None and any(part.has(key) for key in _MATRIX)), None)


def read(files: Sequence[CameraFile], request: Request) -> Imported:
    """One camera from one file; a pair from a stereo calibration, or from two camera files and one of extrinsics.

    Raises
    ------
    CameraFileError
        A value is missing, invalid or inconsistent.
    """
    tops = [file.top for file in files]
    pairs = [top for top in tops if top.find(*_names(_MATRIX, 0)) is not None or _side(top, 0) is not None]
    for top in tops:
        # Of cameras numbered from 0, camera 1 would be taken for the first.
        zero = top.find(*(f"{name}{gap}0" for name in _MATRIX for gap in ("", "_")))
        if zero is not None and top.find(*_names(_MATRIX, 1)) is None:
            raise zero.fail("the cameras are numbered 0 and 1; number them 1 and 2, as in K1, D1, K2, D2")
    alone = [top for top in tops if top not in pairs and top.find(*_MATRIX) is not None]
    if not pairs and len(alone) == 1 and len(tops) == 1:
        return _camera(alone[0], "camera", _MATRIX, _DISTORTION, request)
    moving = [top for top in tops if top.find(*_TRANSLATION) is not None]
    if len(moving) > 1:
        raise (
            moving[1]
            .need(*_TRANSLATION)
            .fail(
                "two files contain T; only one, from the first camera to the second, is expected. If each file gives "
                "the pose of its own camera, as R₁, T₁ and R₂, T₂, replace them by R = R₂ R₁ᵀ and T = T₂ − R T₁ in one "
                "file"
            )
        )
    extrinsic = next(iter(moving), None)
    if extrinsic is None:
        if not pairs and not alone and request.pictures == "raw":
            raise tops[0].fail(
                "no camera matrix is given under any of the known keys, such as camera_matrix, or M1 and M2 of a pair"
                f"{_given(tops[0])}; write fx, fy, cx and cy as a matrix, and the distortion as "
                "distortion_coefficients, or D1 and D2"
            )
        raise tops[-1].fail(
            "two cameras need R and T; give a stereo calibration, or two camera files and one with R and T"
        )
    if request.pictures == "rectified":
        if request.lens_model:
            raise extrinsic.fail("lens_model does not apply to rectified pictures, which have no distortion; remove it")
        return _rectified(pairs[0] if pairs else extrinsic, extrinsic, request)
    if pairs:
        _refuse_one_distortion(pairs[0])
        first, second = (_one_of_pair(pairs[0], side, request) for side in (0, 1))
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
    if not (first.coefficients or second.coefficients):
        # A file with R and T alone has no camera whose distortion might have an unknown name.
        _refuse_vectors([top for top in tops if top is not extrinsic or top in pairs])
    undistorted = Convention(name="distortion", says="none is given", key=moved.key)
    lenses = () if first.coefficients or second.coefficients else (undistorted,)
    return _in_order(
        (first, second),
        _rotation(turn, extrinsic),
        np.array(matrix_of(moved, 3)) * metre,
        request,
        metre=metre,
        where=(turn, moved),
        conventions=(*_conventions(moved, "raw: as taken, before rectification"), unit, *lenses),
    )


def _one_of_pair(top: Located, side: int, request: Request) -> ImportedCamera:
    name, inner = f"camera {side + 1}", _side(top, side)
    if inner is not None:
        return _camera(inner, name, _MATRIX, _DISTORTION, request)
    return _camera(top, name, _names(_MATRIX, side), _names(_DISTORTION, side), request, side)


def _rotation(turn: Located, extrinsic: Located) -> FloatArray:
    """A rotation matrix, or the rotation vector that the calibration of ZED cameras writes."""
    numbers = matrix_of(turn)
    if extrinsic.has("K_LEFT", "K_RIGHT") and len(numbers) == 3:
        from scipy.spatial.transform import Rotation

        return Rotation.from_rotvec(numbers).as_matrix()
    return rotation_of(turn, matrix_of(turn, 9))


def _in_order(
    cameras: tuple[ImportedCamera, ImportedCamera],
    rotation: FloatArray,
    translation: FloatArray,
    request: Request,
    *,
    metre: float,
    where: tuple[Located, Located],
    conventions: tuple[Convention, ...],
) -> ImportedRig:
    """The pair with the left camera first, which is the first of the file unless ``pair`` says otherwise."""
    aliases = [(camera.name, *ends) for camera, ends in zip(cameras, _SIDES, strict=True)]
    order = [next((side for side in (0, 1) if name in aliases[side]), -1) for name in request.pair or ("1", "2")]
    if order not in ([0, 1], [1, 0]):
        raise where[1].fail("pair: the cameras of an OpenCV calibration are 1 and 2; [1, 2] or [2, 1] is expected")
    exchanged = (
        "R and T of OpenCV lead from the first to the second camera, x₂ = R x₁ + T. If the first camera is the right "
        "one, give pair: [2, 1] beside from:; if R and T lead from the second to the first, replace them by Rᵀ and "
        "−Rᵀ T in the file"
    )
    if order == [1, 0]:
        rotation, translation = rotation.T, -rotation.T @ translation
        exchanged = f"so pair: [{', '.join(request.pair)}] contradicts R and T; remove it"
    first, second = (cameras[side] for side in order)
    return paired(
        first,
        second,
        rotation,
        translation,
        metre=metre,
        where=where,
        exchanged=exchanged,
        otherwise="; or, if T counts squares of the board, multiply T by their side",
        conventions=conventions,
    )


def _refuse_one_distortion(top: Located) -> None:
    """Refuse a pair in which only one camera has distortion coefficients: the other's key may be misspelt."""
    distortions = [top.find(*_names(_DISTORTION, side)) for side in (0, 1)]
    for side, distortion in enumerate(distortions):
        other = distortions[1 - side]
        if distortion is None and other is not None:
            raise other.fail(
                f"camera {2 - side} has distortion coefficients, but camera {side + 1} has none under any of the known "
                "keys, such as D1 and D2; rename its key, or write zeros for a lens without distortion"
            )


def _refuse_vectors(tops: Sequence[Located]) -> None:
    """Refuse vectors as long as distortion, under any name, in the files of cameras of which no distortion was read."""
    for value in (unused for top in tops for unused in top.file.unused()):
        extents = filter(None, (value.find("rows"), value.find("cols")))
        if "1" in [extent.text() for extent in extents] and len(matrix_of(value)) in (5, 8, 12, 14):
            raise value.fail(
                f"no distortion was read, but {value.last} is as long as distortion; rename it, such as D1 or "
                "distortion_coefficients, or remove it"
            )


def _given(top: Located) -> str:
    """The first keys of a file, for a message."""
    names = top.names()
    return f", but the file has {', '.join(names[:8])}{', …' if len(names) > 8 else ''}" if names else ""


def _conventions(moved: Located, pictures: str) -> tuple[Convention, ...]:
    return (
        Convention(name="format", says=FORMAT.name if recognises(moved.file) else LISTS.name, key=moved.key),
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
    return tuple(key for name in names for end in ends for key in (f"{name}{end}", f"{name}_{end}", f"{end}_{name}"))


def _camera(
    top: Located,
    name: str,
    matrices: Sequence[str],
    distortions: Sequence[str],
    request: Request,
    side: int | None = None,
) -> ImportedCamera:
    """One camera of a file, under any of its possible keys."""
    matrix = top.need(*matrices)
    pinhole = fx, fy, cx, cy = pinhole_of(matrix, matrix_of(matrix, 9))
    distortion, size = top.find(*distortions), _size(top, side)
    pixels = request.pixels if size is None else (size[0].count(), size[1].count())
    across, down = (cx, cy) if pixels is None else (max(cx, pixels[0] - cx), max(cy, pixels[1] - cy))
    kind = _stated_kind(top, request, side)
    if distortion is None and kind == "fisheye":
        raise top.fail(
            "a fisheye lens is declared, but no distortion coefficients are given under any of the known keys, such as "
            "distortion_coefficients, or D1 and D2 of a pair; rename their key, or write zeros"
        )
    slope = math.hypot(across / fx, down / fy)
    model, coefficients = ("rational", {}) if distortion is None else _lens(distortion, slope, kind)
    return checked_camera(
        name,
        pinhole,
        model,
        coefficients,
        matrix=matrix,
        lens=distortion or matrix,
        size=size,
        pixels=pixels,
        says=_LENS_WORDS[model],
        fisheye="" if request.lens_model == "pinhole" else "give lens_model: fisheye beside from:",
    )


_LENS_WORDS: Final = {"rational": "pinhole, OpenCV's order k1 k2 p1 p2 k3 …", "kannala-brandt": "fisheye, k1 to k4"}


def _lens(distortion: Located, slope: float, kind: str) -> tuple[LensModelName, Mapping[str, float]]:
    """Lens model and coefficients; ``slope`` is that of the farthest corner of the picture, by a pinhole."""
    numbers = matrix_of(distortion, 4, 5, 8, 12, 14)
    if not kind and len(numbers) == 4 and slope > _WIDE:
        raise distortion.fail(
            "4 coefficients are k1 to k4 of a fisheye lens, or k1 k2 p1 p2 of a pinhole; in a picture as wide as this "
            "(focal length, principal point), depth depends on which; give lens_model: fisheye or lens_model: pinhole "
            "beside from:"
        )
    if kind == "fisheye":
        if any(numbers[4:]):
            raise distortion.fail(f"{len(numbers)} coefficients are given; a fisheye lens has 4")
        return "kannala-brandt", dict(zip(_ORDER_FISHEYE, numbers, strict=False))
    return "rational", dict(zip(_ORDER, numbers, strict=False))


def _stated_kind(top: Located, request: Request, side: int | None) -> str:
    """``fisheye`` or ``pinhole``, as the study or the file says of one of two cameras, or of all; else empty."""
    said = ""

    def own(*names: str) -> tuple[str, ...]:
        return names if side is None else (*names, *_names(names, side))

    if (flag := top.find(*own("fisheye_model", "fisheye"))) is not None:
        said = "fisheye" if flag.flag(_FISHEYE_NAMES, _PINHOLE_NAMES) else "pinhole"
    names = own("distortion_model", "camera_model", "lens_model", "model_type", "calibration_model")
    if (kind := top.find("type")) is not None and isinstance(kind.entry, ScalarEntry):  # may also be that of a file
        names = (*names, "type") if kind.entry.text.lower() in _FISHEYE_NAMES else names
    if (named := next(filter(None, map(top.find, names)), None)) is not None:
        model = named.text().lower()
        if model not in (*_FISHEYE_NAMES, *_PINHOLE_NAMES):
            raise named.fail(
                f"the lens model '{named.text()[:40]}' is unknown; write fisheye if the coefficients are k1 to k4, or "
                "pinhole if they are k1 k2 p1 p2 k3 …; remove this key if it names the camera"
            )
        kind_named = "fisheye" if model in _FISHEYE_NAMES else "pinhole"
        # "pinhole" also names the camera without its distortion.
        if flag is not None and said != kind_named and model != "pinhole":
            raise named.fail(f"'{model[:40]}' contradicts {flag.last}: {flag.text()}; correct one")
        if flag is None and model == "pinhole":
            return request.lens_model or "pinhole"
        said = said or kind_named
    if (stated := flag or named) is not None:
        request.refuse_other_lens(stated, said)
    return request.lens_model or said


def _size(top: Located, side: int | None = None) -> tuple[Located, Located] | None:
    """Columns and rows, in any form that programs based on OpenCV write: of both cameras, or else of that of a side."""
    for across, down in (("image_width", "image_height"), ("image_Width", "image_Height"), ("width", "height")):
        if top.has(across, down):
            return top.need(across), top.need(down)
    size = top.find(*_SIZE)
    if size is None and side is not None:
        size = top.find(*_names(_SIZE, side))
        width, height = (top.find(*_names((extent, f"image_{extent}"), side)) for extent in ("width", "height"))
        if size is None and width is not None and height is not None:
            return width, height
    if size is None:
        return None
    data = size.find("data")  # of a matrix with both numbers
    if isinstance(size.entry, ListEntry) or data is not None:
        size.use_matrix()
        return (data or size).pair()
    return size.need("width"), size.need("height")


def matrix_of(value: Located, *counts: int) -> tuple[float, ...]:
    """All numbers of a matrix, row by row."""
    if isinstance(value.entry, ListEntry):
        return value.numbers(*counts)
    sizes = value.find("sizes")  # of a list in the form of OpenCV 5
    if sizes is None:
        extents = [value.need("rows"), value.need("cols")]
    else:  # OpenCV writes the only extent of a vector in XML without a list
        extents = [*sizes.items()] if isinstance(sizes.entry, ListEntry) else [sizes]
    numbers = value.need("data").numbers(*counts)
    if math.prod(extent.count() for extent in extents) != len(numbers):
        announced = " × ".join(extent.text() for extent in extents)
        raise value.fail(f"{announced} elements are declared, but {len(numbers)} are given")
    value.use_matrix()
    return numbers


def _rectified(pair: Located, extrinsic: Located, request: Request) -> Imported:
    """The rectified pair, from its projection matrices: equal focal lengths, no distortion, parallel axes."""
    holder = pair if pair.find("P1") is not None else extrinsic
    size = _size(pair) or _size(extrinsic)
    if holder.find("P1") is None:
        raise holder.fail("rectified pictures need P1 and P2 from stereoRectify; add them to the file")
    cameras = []
    for side, key in enumerate(("P1", "P2")):
        value = holder.need(key)
        cameras.append(
            checked_camera(
                f"camera {side + 1}",
                pinhole_of(value, matrix_of(value, 12)),
                "rational",
                {},
                matrix=value,
                lens=value,
                size=size,
                pixels=request.pixels,
            )
        )
    value = holder.need("P2")
    metre, unit = request.metres(value)
    placed = [translation_of_projection(holder.need(key), matrix_of(holder.need(key), 12)) for key in ("P1", "P2")]
    return _in_order(
        (cameras[0], cameras[1]),
        np.eye(3),
        (placed[1] - placed[0]) * metre,
        request,
        metre=metre,
        where=(value, value),
        conventions=(*_conventions(value, "rectified, by P1 and P2"), unit),
    )


def translation_of_projection(value: Located, numbers: tuple[float, ...]) -> FloatArray:
    """Position t of the origin in the frame of a rectified camera, from P = [K, K t].

    Raises
    ------
    CameraFileError
        P is not a projection matrix, or too large.
    """
    matrix = np.array(numbers, dtype=np.float64).reshape(3, 4)
    fx, fy, cx, cy = pinhole_of(value, numbers)
    along = matrix[2, 3]
    with np.errstate(over="ignore", invalid="ignore"):
        moved: FloatArray = np.array([(matrix[0, 3] - cx * along) / fx, (matrix[1, 3] - cy * along) / fy, along])
    if not np.all(np.isfinite(moved)):
        raise value.fail(f"P[3] and P[7], {matrix[0, 3]:g} and {matrix[1, 3]:g}, are too large for the focal length")
    return moved


def write(rig: ImportedRig, stem: str) -> Mapping[str, str]:
    """A stereo calibration in YAML, in metres."""
    if rig.left.pixels != rig.right.pixels:
        raise UnsupportedLensError(["pictures of two sizes"])
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
            lens = coefficients_of(camera, _ORDER_FISHEYE, model="kannala-brandt")
        else:
            lens = shortest_coefficients(camera, _ORDER, (5, 8, 12, 14))
        matrices[f"D{side}"] = ((1, len(lens)), lens)
    matrices["R"] = ((3, 3), [number for row in rig.rotation for number in row])
    matrices["T"] = ((3, 1), rig.translation)
    for key, ((rows, columns), values) in matrices.items():
        data = ", ".join(map(repr, values))
        lines += [f"{key}: !!opencv-matrix", f"   rows: {rows}", f"   cols: {columns}", "   dt: d"]
        lines.append(f"   data: [ {data} ]")
    return {f"{stem}-opencv.yml": "\n".join(lines) + "\n"}


FORMAT: Final = Format(
    name="OpenCV FileStorage",
    word="opencv",
    options=("length_unit", "pair", "pixels", "pictures", "lens_model"),
    recognises=recognises,
    read=read,
    signs=("camera_matrix", "distortion_coefficients", "M1", "K1", "D1", "R", "T"),
    is_general=True,
    write=write,
)
LISTS: Final = Format(
    name="lists of matrices (JSON, YAML, npz, mat)",
    options=FORMAT.options,
    recognises=_recognises_lists,
    read=read,
    is_general=True,
)

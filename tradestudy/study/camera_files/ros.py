"""ROS ``camera_info``: YAML files of camera_calibration and camera_info_manager, and messages printed as YAML."""

from __future__ import annotations

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
from tradestudy.study.camera_files.opencv import translation_of_projection
from tradestudy.study.camera_files.pairs import UNUSUAL_SIGN, checked_camera, paired, pinhole_of, rotation_of
from tradestudy.study.document import ListEntry

_MODELS: Final[dict[str, tuple[LensModelName, tuple[str, ...]]]] = {
    "plumb_bob": ("rational", ("k1", "k2", "p1", "p2", "k3")),
    "rational_polynomial": (
        "rational",
        ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tau_x", "tau_y"),
    ),
    "equidistant": ("kannala-brandt", ("k1", "k2", "k3", "k4")),
}
_COUNTS: Final = (4, 5, 8, 12, 14)
"""Lengths of D; numbers beyond those of the model must be 0."""
_MATRIX, _DISTORTION = ("camera_matrix", "K", "k"), ("distortion_coefficients", "D", "d")
_RECTIFICATION, _PROJECTION = ("rectification_matrix", "R", "r"), ("projection_matrix", "P", "p")


def recognises(file: CameraFile) -> bool:
    """Whether a file has a distortion model and a projection matrix."""
    top = file.top
    return top.has("distortion_model") and top.find(*_PROJECTION) is not None


def _refuse_part_of_the_sensor(top: Located) -> None:
    """Refuse binning and regions of interest, because K and P describe the whole sensor at full resolution."""
    for key in ("binning_x", "binning_y"):
        if (binning := top.find(key)) is not None and binning.number() > 1.0:
            raise binning.fail("the pictures are binned; give the camera_info of the binned pictures, without binning")
    if (roi := top.find("roi")) is None:
        return
    whole = {"width": top.need("image_width", "width"), "height": top.need("image_height", "height")}
    for key in ("x_offset", "y_offset", "width", "height"):
        part = roi.find(key)
        if part is not None and part.number() not in (0.0, whole[key].number() if key in whole else 0.0):
            raise part.fail("the pictures show only a region of interest; give the camera_info of this region alone")


def read(files: Sequence[CameraFile], request: Request) -> Imported:
    """One camera, or the left and the right one of a pair.

    Rectifying rotations and P give the pair: ``x₂ = R₂ᵀ R₁ x₁ + R₂ᵀ (t₂ − t₁)``, where ``P = K′ [1, t]`` gives each t,
    ``(P[3]/f′, P[7]/f′, 0)`` for a camera at the depth of the origin.

    Raises
    ------
    CameraFileError
        A value is missing or invalid, or the pair has no baseline.
    """
    tops = [file.top for file in files]
    if request.pictures == "rectified" and request.lens_model:
        raise tops[0].fail("lens_model does not apply to rectified pictures, which have no distortion; remove it")
    for top in tops:
        _refuse_part_of_the_sensor(top)
    if len(tops) == 1:
        return _camera(tops[0], request)
    if len(tops) != 2:
        raise tops[-1].fail(f"{len(tops)} files are given; camera_info of one camera or of a pair is expected")
    projections = [top.need(*_PROJECTION) for top in tops]
    projection = projections[1]
    moved = _between(projections)
    metre, unit = request.metres(projection, stated="m", why="the definition of ROS messages (REP 103)")
    first, second = (_camera(top, request) for top in tops)
    turns = [_rectification(top) for top in tops]
    where = tops[1].find(*_RECTIFICATION) or projection
    rotation, translation = np.eye(3), moved * metre
    if request.pictures == "raw":
        rotation, translation = turns[1].T @ turns[0], turns[1].T @ (moved * metre)
    conventions = (
        Convention(name="format", says="ROS camera_info", key=projection.key),
        Convention(
            name="direction of transforms",
            says="from the difference of P[3] = −f′B, rectified to raw by the rectification matrices",
            key=projection.key,
        ),
        Convention(name="pictures", says=_pictures(request, first, second, turns), key=projection.key),
        unit,
        *_unset_rotations(tops),
        *_unusual_sign(projections),
    )
    return paired(
        first,
        second,
        rotation,
        translation,
        metre=metre,
        where=(where, projection),
        exchanged=_exchanged(projections, first, second),
        conventions=conventions,
    )


def _offset(projection: Located) -> float:
    """P[3], or P[7] if P[3] is 0: 0 for the first camera of a pair, −f′B for the second one."""
    numbers = _numbers(projection, 12)
    return numbers[3] or numbers[7]


def _between(projections: list[Located]) -> FloatArray:
    """Position of the first rectified camera in the frame of the second one, both relative to a common origin."""
    first, second = (translation_of_projection(projection, _numbers(projection, 12)) for projection in projections)
    moved: FloatArray = second - first
    if moved.any():
        return moved
    if not second.any():
        raise projections[1].fail(
            "P[3] and P[7] are both 0, so the second camera has no baseline; use the camera_info of a pair that was "
            "calibrated together"
        )
    raise projections[1].fail(
        f"P[3] is {_offset(projections[1]):g} in both files, so both cameras are at the same place; P[3] of the left "
        "camera should be 0, and that of the right one −f′B: correct it, or give the files of two different cameras"
    )


def _exchanged(projections: list[Located], first: ImportedCamera, second: ImportedCamera) -> str:
    """What to do about a second camera that P places to the left of the first one."""
    before, after = map(_offset, projections)
    if before == 0.0:
        return (
            f"its P[3] is {after:g}, but ROS defines P[3] = −f′B for the right camera. If {second.name} is the right "
            f"camera, the sign is wrong: write {-after:g}; if it is the left one, list it first in from:"
        )
    return f"P[3] is {before:g} for {first.name} and {after:g} for {second.name}; list {second.name} first in from:"


def _unusual_sign(projections: list[Located]) -> tuple[Convention, ...]:
    """The doubt about a pair whose right camera is at the origin, where ROS places the left one."""
    before, after = map(_offset, projections)
    if after != 0.0 or before <= 0.0:
        return ()
    says = f"P[3] is {before:g} for the left camera and 0 for the right one; ROS defines 0 for the left and −f′B"
    return (Convention(name=UNUSUAL_SIGN, says=f"{says} for the right camera", key=projections[0].key),)


def _unset_rotations(tops: list[Located]) -> tuple[Convention, ...]:
    unset = [top.find(*_RECTIFICATION) for top in tops if _is_unset(top)]
    key = next((value.key for value in unset if value is not None), "")
    says = "all 0, which means unset: the cameras are taken to be parallel"
    return (Convention(name="rectification", says=says, key=key, is_assumed=True),) if key else ()


def _is_unset(top: Located) -> bool:
    """Whether the rectifying rotation is all 0, the initial value of the message."""
    value = top.find(*_RECTIFICATION)
    return value is not None and not any(_numbers(value, 9))


def _pictures(request: Request, first: ImportedCamera, second: ImportedCamera, turns: list[np.ndarray]) -> str:
    if request.pictures == "rectified":
        return "rectified, by P"
    plain = not any([*first.coefficients.values(), *second.coefficients.values()])
    if plain and all(np.array_equal(turn, np.eye(3)) for turn in turns):
        return "raw, but already rectified: without distortion or rotation"
    return "raw: as taken, before rectification, by K, D, R"


def _camera(top: Located, request: Request) -> ImportedCamera:
    """One camera: the raw one by K and D, or the rectified one by P."""
    is_rectified = request.pictures == "rectified"
    matrix = top.need(*(_PROJECTION if is_rectified else _MATRIX))
    pinhole = pinhole_of(matrix, _numbers(matrix, 12 if is_rectified else 9))
    distortion = top.need(*_DISTORTION)
    model, coefficients = ("rational", {}) if is_rectified else _lens(top, distortion, request)
    named = top.find("camera_name")
    return checked_camera(
        top.file.path.stem if named is None else named.text(),
        pinhole,
        model,
        coefficients,
        matrix=matrix,
        lens=distortion,
        size=(top.need("image_width", "width"), top.need("image_height", "height")),
        says="none: rectified" if is_rectified else model,
        fisheye="" if request.lens_model == "pinhole" else None,
    )


def _lens(top: Located, distortion: Located, request: Request) -> tuple[LensModelName, dict[str, float]]:
    named = top.find("distortion_model")
    stated = "" if named is None else named.text()
    lens_name = "equidistant" if (stated or request.lens_model) == "fisheye" else stated
    numbers = _numbers(distortion)
    if not lens_name:
        if not any(numbers):
            return "rational", {}
        what = f"no distortion model is named, but D has {len(numbers)} coefficients; name one of {', '.join(_MODELS)}"
        raise (named or distortion).fail(what)
    if lens_name not in _MODELS:
        assert named is not None
        raise named.fail(f"the distortion model '{lens_name[:40]}' is unknown; one of {', '.join(_MODELS)} is expected")
    model, names = _MODELS[lens_name]
    if named is not None and stated:
        request.refuse_other_lens(named, "pinhole" if model == "rational" else "fisheye")
    if not numbers:
        return model, {}
    if len(numbers) not in _COUNTS or any(numbers[len(names) :]):
        raise distortion.fail(f"{len(numbers)} coefficients are given; {lens_name} has {len(names)}")
    return model, dict(zip(names, numbers, strict=False))


def _rectification(top: Located) -> np.ndarray:
    value = top.find(*_RECTIFICATION)
    return np.eye(3) if value is None or _is_unset(top) else rotation_of(value, _numbers(value, 9))


def _numbers(value: Located, *counts: int) -> tuple[float, ...]:
    """A matrix in the form of files or of messages."""
    numbers = (value if isinstance(value.entry, ListEntry) else value.need("data")).numbers(*counts)
    value.use_matrix()
    return numbers


def write(rig: ImportedRig, stem: str) -> Mapping[str, str]:
    """Two files of camera_info, rectified along the baseline with the mean focal length and principal point."""
    if rig.left.pixels != rig.right.pixels:
        raise UnsupportedLensError(["pictures of two sizes"])
    turns = _rectifying(rig)
    focal_length = float(np.mean([*rig.left.focal_lengths, *rig.right.focal_lengths]))
    centre = np.mean([rig.left.centre, rig.right.centre], axis=0)
    baseline = float(np.linalg.norm(rig.translation))
    files = {}
    for side, camera, turn, moved in (("left", rig.left, turns[0], 0.0), ("right", rig.right, turns[1], -baseline)):
        if camera.pixels is None:
            raise UnsupportedLensError(["a camera without the size of its pictures"])
        (fx, fy), (cx, cy) = camera.focal_lengths, camera.centre
        f, (x, y) = focal_length, (float(coordinate) for coordinate in centre)
        model, lens = _written_lens(camera)
        matrices = {
            "camera_matrix": (3, 3, [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]),
            "distortion_coefficients": (1, len(lens), [*lens]),
            "rectification_matrix": (3, 3, [float(number) for number in turn.ravel()]),
            "projection_matrix": (3, 4, [f, 0.0, x, f * moved, 0.0, f, y, 0.0, 0.0, 0.0, 1.0, 0.0]),
        }
        lines = [f"image_width: {camera.pixels[0]}", f"image_height: {camera.pixels[1]}", f"camera_name: {side}"]
        lines.append(f"distortion_model: {model}")
        for key, (rows, columns, values) in matrices.items():
            lines += [f"{key}:", f"  rows: {rows}", f"  cols: {columns}", f"  data: {values}"]
        files[f"{stem}-{side}.yaml"] = "\n".join(lines) + "\n"
    return files


def _rectifying(rig: ImportedRig) -> tuple[FloatArray, FloatArray]:
    """Rotations of both cameras to a frame along the baseline, across it, and along the mean optical axis."""
    rotation, translation = np.array(rig.rotation), np.array(rig.translation)
    across = -translation / np.linalg.norm(translation)
    between = np.array([0.0, 0.0, 1.0]) + rotation[:, 2]
    down = np.cross(between, across)
    down = down / np.linalg.norm(down)
    right = np.stack([across, down, np.cross(across, down)])
    return right @ rotation, right


def _written_lens(camera: ImportedCamera) -> tuple[str, tuple[float, ...]]:
    if camera.lens_model == "kannala-brandt":
        return "equidistant", coefficients_of(camera, _MODELS["equidistant"][1], model="kannala-brandt")
    lens = shortest_coefficients(camera, _MODELS["rational_polynomial"][1][:8], (5, 8))
    return ("plumb_bob" if len(lens) == 5 else "rational_polynomial"), lens


FORMAT: Final = Format(
    name="ROS camera_info",
    word="ros",
    options=("length_unit", "pictures", "lens_model"),
    recognises=recognises,
    read=read,
    write=write,
)

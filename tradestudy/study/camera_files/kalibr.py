"""Kalibr ``camchain``: any number of cameras in a chain, each with its transform from the previous one."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

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
    other_cameras,
)
from tradestudy.study.camera_files.pairs import checked_camera, inverse, paired, pinhole, rigid_of

_OWN: Final[dict[str, tuple[LensModelName, tuple[str, ...]]]] = {
    "pinhole": ("rational", ()),
    "omni": ("omni", ("xi",)),
    "ds": ("double-sphere", ("xi", "alpha")),
    "eucm": ("eucm", ("alpha", "beta")),
}
"""Camera models with the parameters that precede the focal lengths in ``intrinsics``."""
_DISTORTION: Final[dict[str, tuple[LensModelName, tuple[str, ...]]]] = {
    "radtan": ("rational", ("k1", "k2", "p1", "p2")),
    "equidistant": ("kannala-brandt", ("k1", "k2", "k3", "k4")),
    "fov": ("fov", ("w",)),
}
_WITH: Final = {"pinhole": ("radtan", "equidistant", "fov", "none"), "omni": ("radtan", "none")}
_CAMERA: Final = re.compile("cam[0-9]{1,6}")
_TRANSFORM: Final = "T_cn_cnm1"
_TO_BODY, _FROM_BODY = "T_imu_cam", "T_cam_imu"
"""Transforms of every camera into the frame of the inertial sensor and out of it, as OpenVINS and Kalibr write them."""


_Relation = tuple[FloatArray, FloatArray, Located]
_AGREES_IN_BASELINE: Final = 0.01
_AGREES_IN_ANGLE: Final = 1e-3  # rad


def recognises(file: CameraFile) -> bool:
    """Whether a file has cameras cam0, cam1 … with camera models."""
    first = file.top.find("cam0")
    return first is not None and first.has("camera_model", "intrinsics")


def read(files: Sequence[CameraFile], request: Request) -> Imported:
    """One camera, or two of a chain: those with the lowest numbers unless ``pair`` names others.

    ``T_cn_cnm1`` maps points of camera n − 1 into camera n; transforms of a longer chain are multiplied. A file without
    it, such as one of OpenVINS, relates each camera to the inertial sensor: by ``T_imu_cam`` or ``T_cam_imu``.

    Raises
    ------
    CameraFileError
        A value is missing or invalid, a model is unknown, or the chain does not connect the two cameras.
    """
    top = files[0].top
    cameras = [name for name in top.names() if _CAMERA.fullmatch(name) and top.need(name).has("camera_model")]
    names = tuple(sorted(cameras, key=_number))
    for name in request.pair:
        if name not in names:
            raise top.fail(f"pair: no camera is called '{name}'; known: {', '.join(names)}")
    pair = request.pair or names[:2]
    if len(pair) == 1:
        return _camera(top.need(pair[0]), request)
    first, second = pair
    if first == second:
        raise top.fail(f"pair: {first} occurs twice; two cameras are expected")
    # A file may relate the cameras in several ways, which must agree.
    is_chain = any(top.need(name).find(_TRANSFORM) is not None for name in (first, second))
    relations = [*([_between(top, names, pair)] if is_chain else []), *_by_body(top, first, second)]
    # Without any, this fails at the transform that is missing.
    relations = relations or [_between(top, names, pair)]
    rotation, translation, where = relations[0]
    for relation in relations[1:]:
        _refuse_contradiction(relations[0], relation)
    metre, unit = request.metres(where, stated="m", why="the definition of Kalibr's camchain")
    conventions = (
        Convention(name="format", says="Kalibr camchain", key=where.key),
        Convention(
            name="direction of transforms",
            says=_DIRECTIONS[where.last],
            key=where.key,
        ),
        Convention(name="pictures", says="raw: as taken, before rectification", key=where.key),
        unit,
        *other_cameras({name: top.need(name) for name in names}, pair),
    )
    left, right = (_camera(top.need(name), request) for name in (first, second))
    return paired(
        left,
        right,
        rotation,
        translation * metre,
        metre=metre,
        where=(where, where),
        exchanged=f"left and right are exchanged; give pair: [{second}, {first}] beside from:",
        conventions=conventions,
    )


_DIRECTIONS: Final = {
    _TRANSFORM: "T_cn_cnm1 maps camera n − 1 into camera n, x_n = R x_(n−1) + t",
    _TO_BODY: "T_imu_cam maps the camera into the inertial sensor",
    _FROM_BODY: "T_cam_imu maps the inertial sensor into the camera",
}


def _by_body(top: Located, first: str, second: str) -> Iterator[_Relation]:
    """Rotations and translations by way of the inertial sensor."""
    for key in (_TO_BODY, _FROM_BODY):
        values = [top.need(name).find(key) for name in (first, second)]
        if values[0] is None or values[1] is None:
            continue
        steps = [_transform(value) for value in values if value is not None]
        total = inverse(steps[1]) @ steps[0] if key == _TO_BODY else steps[1] @ inverse(steps[0])
        if np.array_equal(steps[0], steps[1]):
            raise values[1].fail(f"{key} is the same for {first} and {second}, so both are at one place; correct it")
        yield total[:3, :3], total[:3, 3], values[1]


def _refuse_contradiction(used: _Relation, other: _Relation) -> None:
    """Refuse a second relation of two cameras that differs by more than 1 mrad, or 1 % of the baseline."""
    baseline, moved = (float(np.linalg.norm(vector)) for vector in (used[1], other[1] - used[1]))
    turned = float(np.linalg.norm(other[0] - used[0], 2))
    if moved > _AGREES_IN_BASELINE * baseline or turned > _AGREES_IN_ANGLE:
        raise other[2].fail(
            f"by {other[2].last}, the second camera is {moved:.3g} (of a baseline of {baseline:.3g}) and "
            f"{np.degrees(turned):.2g}° from where {used[2].last} places it; remove the wrong transforms"
        )


def _transform(value: Located) -> FloatArray:
    step: FloatArray = np.eye(4)
    step[:3, :3], step[:3, 3] = rigid_of(value, value.numbers(16))
    return step


def _number(camera: str) -> int:
    return int(camera.removeprefix("cam"))


def _between(top: Located, names: Sequence[str], pair: Sequence[str]) -> tuple[FloatArray, FloatArray, Located]:
    """Rotation and translation from the first camera of a pair to the second, along the chain by camera numbers."""
    low, high = sorted(pair, key=_number)
    links = names[names.index(low) : names.index(high) + 1]
    total: FloatArray = np.eye(4)
    for previous, current in itertools.pairwise(links):
        where = top.need(current).need(_TRANSFORM)
        if _number(previous) != _number(current) - 1:
            lacking = f"cam{_number(current) - 1}, which the file lacks; give the whole chain"
            raise where.fail(f"{_TRANSFORM} of {current} leads from {lacking}")
        total = _transform(where) @ total
    rotation, translation = total[:3, :3], total[:3, 3]
    if pair[0] == high:
        rotation, translation = rotation.T, -rotation.T @ translation
    return rotation, translation, where


def _camera(value: Located, request: Request) -> ImportedCamera:
    """One camera of the chain."""
    named, intrinsics = value.need("camera_model"), value.need("intrinsics")
    camera_model = named.text()
    if camera_model not in _OWN:
        raise named.fail(f"the camera model '{camera_model[:40]}' is unknown; one of {', '.join(_OWN)} is expected")
    if request.lens_model and camera_model != "pinhole":
        raise named.fail(
            f"the camera model {camera_model} includes its own lens model; remove lens_model: {request.lens_model}"
        )
    model, leading = _OWN[camera_model]
    numbers = intrinsics.numbers(len(leading) + 4)
    projection, coefficients = pinhole(intrinsics, *numbers[len(leading) :]), dict(zip(leading, numbers, strict=False))
    distortion_model, distortion = value.find("distortion_model"), value.find("distortion_coeffs")
    lens, names = _distortion(value, camera_model, request)
    if lens is None and distortion is not None and any(distortion.numbers()):
        possible = [kind for kind in _WITH.get(camera_model, ()) if kind != "none"]
        remedy = f"name their model there, {' or '.join(possible)}, or " if possible else ""
        raise distortion.fail(
            f"coefficients are given, but distortion_model is {'missing' if distortion_model is None else 'none'}; "
            f"{remedy}write zeros"
        )
    if lens is not None:
        model = lens if camera_model == "pinhole" else model
        distortion = value.need("distortion_coeffs")
        numbers = distortion.numbers()
        if len(numbers) < len(names) or any(numbers[len(names) :]):
            raise distortion.fail(f"{len(numbers)} numbers are given; {len(names)} are expected")
        coefficients |= dict(zip(names, numbers, strict=False))
    return checked_camera(
        value.last,
        projection,
        model,
        coefficients,
        matrix=intrinsics,
        lens=intrinsics if leading or distortion is None else distortion,
        size=value.need("resolution"),
        says=model,
        named=distortion_model or named,
        fisheye="" if request.lens_model == "pinhole" else None,
    )


def _distortion(value: Located, camera: str, request: Request) -> tuple[LensModelName | None, tuple[str, ...]]:
    """Lens model and coefficient names of ``distortion_model``; None without distortion."""
    named = value.find("distortion_model")
    model = "none" if named is None else named.text()
    if named is None and request.lens_model == "fisheye":
        model = "equidistant"
    if named is not None and model not in (possible := _WITH.get(camera, ("none",))):
        raise named.fail(
            f"the distortion model '{model[:40]}' cannot be combined with the camera model {camera}; one of "
            f"{', '.join(possible)} is expected"
        )
    if named is not None:
        request.refuse_other_lens(named, "fisheye" if model in ("equidistant", "fov") else "pinhole")
    return (None, ()) if model == "none" else _DISTORTION[model]


def write(rig: ImportedRig, stem: str) -> Mapping[str, str]:
    """A chain of two cameras, in metres."""
    cameras = []
    for camera in (rig.left, rig.right):
        if camera.pixels is None:
            raise UnsupportedLensError(["a camera without the size of its pictures"])
        model, leading, distortion = _written_lens(camera)
        cameras.append(
            {
                "camera_model": model,
                "intrinsics": [*leading, *camera.focal_lengths, *camera.centre],
                **distortion,
                "resolution": [*camera.pixels],
            }
        )
    rows = [[*row, moved] for row, moved in zip(rig.rotation, rig.translation, strict=True)]
    cameras[1][_TRANSFORM] = [*rows, [0.0, 0.0, 0.0, 1.0]]
    lines = [
        line
        for number, keys in enumerate(cameras)
        for line in (f"cam{number}:", *(f"  {key}: {value}" for key, value in keys.items()))
    ]
    return {f"{stem}-camchain.yaml": "\n".join(lines) + "\n"}


def _written_lens(camera: ImportedCamera) -> tuple[str, tuple[float, ...], dict[str, Any]]:
    """Camera model, the parameters before the focal lengths, and the distortion."""
    for name, (model, leading) in _OWN.items():
        if model == camera.lens_model and name != "pinhole":
            names = (*leading, *_DISTORTION["radtan"][1]) if name == "omni" else leading
            values = coefficients_of(camera, names, model=model)
            lens: dict[str, Any] = {"distortion_model": "none", "distortion_coeffs": []}
            if name == "omni":
                lens = {"distortion_model": "radtan", "distortion_coeffs": [*values[1:]]}
            return name, values[: len(leading)], lens
    for name, (model, names) in _DISTORTION.items():
        if model == camera.lens_model:
            coefficients = [*coefficients_of(camera, names, model=model)]
            return "pinhole", (), {"distortion_model": name, "distortion_coeffs": coefficients}
    raise UnsupportedLensError([f"the lens model {camera.lens_model}"])


FORMAT: Final = Format(
    name="Kalibr camchain",
    word="kalibr",
    options=("length_unit", "pair", "lens_model"),
    whole="a camchain contains all its cameras",
    recognises=recognises,
    read=read,
    write=write,
)

"""Kalibr ``camchain``: any number of cameras in a chain, each with its transform from the previous one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from tradestudy.cameras.imported import Convention, Imported, ImportedCamera, ImportedRig, LensModelName
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.camera_files.conversions import rigid_of
from tradestudy.study.camera_files.located import CameraFile, Located
from tradestudy.study.camera_files.pairs import check_lens, paired
from tradestudy.study.camera_files.request import (
    Format,
    Request,
    UnsupportedLensError,
    coefficients_of,
    origin_of_pixels,
)

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
_TRANSFORM: Final = "T_cn_cnm1"


def recognises(file: CameraFile) -> bool:
    """Whether a file has cameras cam0, cam1 … with camera models."""
    first = file.top.find("cam0")
    return first is not None and first.has("camera_model", "intrinsics")


def read(files: Sequence[CameraFile], request: Request) -> Imported:
    """One camera, or two of a chain: the first two unless ``pair`` names others.

    ``T_cn_cnm1`` maps points of camera n − 1 into camera n; transforms of a longer chain are multiplied.

    Raises
    ------
    CameraFileError
        A value is missing or invalid, a model is unknown, or the chain does not connect the two cameras.
    """
    if len(files) != 1:
        raise files[1].top.fail("a camchain contains all its cameras; give one file")
    top = files[0].top
    names = tuple(name for name in top.names() if top.need(name).has("camera_model"))
    for name in request.pair:
        if name not in names:
            raise top.fail(f"pair: no camera is called '{name}'; known: {', '.join(names)}")
    pair = request.pair or names[:2]
    if len(pair) == 1:
        return _camera(top.need(pair[0]), request)
    first, second = pair
    rotation, translation, where = _between(top, names, first, second)
    metre, unit = request.metres(where, stated="m", why="the definition of Kalibr's camchain")
    conventions = (
        Convention(name="format", says="Kalibr camchain", key=where.key),
        Convention(
            name="direction of transforms",
            says="T_cn_cnm1 maps camera n − 1 into camera n, x_n = R x_(n−1) + t",
            key=where.key,
        ),
        Convention(name="pictures", says="raw: as taken, before rectification", key=where.key),
        unit,
    )
    left, right = (_camera(top.need(name), request) for name in (first, second))
    return paired(
        left, right, rotation, translation * metre, metre=metre, where=(where, where), conventions=conventions
    )


def _between(top: Located, names: tuple[str, ...], first: str, second: str) -> tuple[FloatArray, FloatArray, Located]:
    """Rotation and translation from one camera of the chain to another."""
    low, high = sorted((names.index(first), names.index(second)))
    if low == high:
        raise top.fail(f"pair: {first} occurs twice; two cameras are expected")
    total = np.eye(4)
    for name in names[low + 1 : high + 1]:
        value = top.need(name).need(_TRANSFORM)
        step = np.eye(4)
        step[:3, :3], step[:3, 3] = rigid_of(value, value.numbers(16))
        total = step @ total
    where = top.need(names[high]).need(_TRANSFORM)
    rotation, translation = total[:3, :3], total[:3, 3]
    if names.index(first) > names.index(second):
        rotation, translation = rotation.T, -rotation.T @ translation
    return rotation, translation, where


def _camera(value: Located, request: Request) -> ImportedCamera:
    """One camera of the chain."""
    named, intrinsics = value.need("camera_model"), value.need("intrinsics")
    name = named.text()
    if name not in _OWN:
        raise named.fail(f"the camera model '{name[:40]}' is unknown; one of {', '.join(_OWN)} is expected")
    model, own = _OWN[name]
    numbers = intrinsics.numbers(len(own) + 4)
    fx, fy, cx, cy = numbers[len(own) :]
    if not (fx > 0.0 and fy > 0.0):
        raise intrinsics.fail(f"the focal lengths are {fx:g} and {fy:g} px; positive ones are expected")
    coefficients = dict(zip(own, numbers, strict=False))
    distortion_model, distortion = value.find("distortion_model"), value.find("distortion_coeffs")
    lens, names = _distortion(value, name, request)
    if lens is not None and distortion is not None:
        model = lens if name == "pinhole" else model
        coefficients |= dict(zip(names, distortion.numbers(len(names)), strict=True))
    size = value.need("resolution")
    width, height = _both(size)
    camera = ImportedCamera(
        name=value.last,
        focal_lengths=(fx, fy),
        centre=(cx, cy),
        pixels=(width.count(), height.count()),
        lens_model=model,
        coefficients=coefficients,
        conventions=(
            origin_of_pixels(intrinsics),
            Convention(name="lens model", says=model, key=(distortion_model or named).key),
        ),
        keys={
            "focal_lengths": intrinsics.key,
            "centre": intrinsics.key,
            "pixels": size.key,
            "coefficients": (distortion or intrinsics).key,
        },
    )
    return check_lens(camera, intrinsics if own or distortion is None else distortion)


def _distortion(value: Located, camera: str, request: Request) -> tuple[LensModelName | None, tuple[str, ...]]:
    """Lens model and coefficient names of ``distortion_model``; None without distortion."""
    named = value.find("distortion_model")
    name = "none" if named is None else named.text()
    if request.lens_model == "fisheye" and camera == "pinhole":
        name = "equidistant"
    if named is not None and name not in (known := _WITH.get(camera, ("none",))):
        raise named.fail(
            f"the distortion model '{name[:40]}' cannot be combined with the camera model {camera}; one of "
            f"{', '.join(known)} is expected"
        )
    return (None, ()) if name == "none" else _DISTORTION[name]


def _both(value: Located) -> tuple[Located, Located]:
    items = tuple(value.items())
    if len(items) != 2:
        raise value.fail(f"{len(items)} values are given; width and height are expected")
    return items[0], items[1]


def write(rig: ImportedRig, stem: str) -> Mapping[str, str]:
    """A chain of two cameras, in metres."""
    cameras = []
    for camera in (rig.left, rig.right):
        if camera.pixels is None:
            raise UnsupportedLensError(["a camera without the size of its pictures"])
        model, own, distortion = _written_lens(camera)
        cameras.append(
            {
                "camera_model": model,
                "intrinsics": [*own, *camera.focal_lengths, *camera.centre],
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
    for name, (model, own) in _OWN.items():
        if model == camera.lens_model and name != "pinhole":
            names = (*own, *_DISTORTION["radtan"][1]) if name == "omni" else own
            values = coefficients_of(camera, names, of=model)
            lens: dict[str, Any] = {"distortion_model": "none", "distortion_coeffs": []}
            if name == "omni":
                lens = {"distortion_model": "radtan", "distortion_coeffs": [*values[1:]]}
            return name, values[: len(own)], lens
    for name, (model, names) in _DISTORTION.items():
        if model == camera.lens_model:
            coefficients = [*coefficients_of(camera, names, of=model)]
            return "pinhole", (), {"distortion_model": name, "distortion_coeffs": coefficients}
    raise UnsupportedLensError([f"the lens model {camera.lens_model}"])


FORMAT: Final = Format(
    name="Kalibr camchain",
    word="kalibr",
    options=("length_unit", "pair", "lens_model"),
    recognises=recognises,
    read=read,
    write=write,
)

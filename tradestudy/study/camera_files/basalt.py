"""Basalt calibration as JSON: cameras with their poses relative to the inertial sensor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from tradestudy.cameras.imported import Imported, ImportedCamera, LensModelName
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.camera_files.located import CameraFile, Format, Located, Request, other_cameras
from tradestudy.study.camera_files.pairs import inverse
from tradestudy.study.camera_files.rigs import (
    FISHEYE,
    RADTAN,
    Definition,
    chosen,
    given,
    keyed,
    rig,
    transform_of,
    unknown,
)

_DEFINED: Final = Definition(
    format="Basalt calibration", direction="T_imu_cam maps a camera into the inertial sensor", unit="m"
)
_MODELS: Final[Mapping[str, tuple[LensModelName, tuple[str, ...]]]] = {
    "pinhole": ("rational", ()),
    "pinhole-radtan8": ("rational", (*RADTAN, "k4", "k5", "k6")),
    "kb4": ("kannala-brandt", FISHEYE),
    "ds": ("double-sphere", ("xi", "alpha")),
    "eucm": ("eucm", ("alpha", "beta")),
    "ucm": ("eucm", ("alpha",)),  # with beta = 1
    "fov": ("fov", ("w",)),
}
_UNIT_QUATERNION: Final = 1e-3


def read(files: Sequence[CameraFile], request: Request) -> Imported:
    """One camera, or two: the first ones unless ``pair`` names others, as cam0, cam1 …

    Raises
    ------
    CameraFileError
        A value is missing or invalid, or a model is unknown.
    """
    top = files[0].top.need("value0")
    values, sizes, poses = ([*top.need(key).items()] for key in ("intrinsics", "resolution", "T_imu_cam"))
    if not len(values) == len(sizes) == len(poses) >= 1:
        raise top.fail(
            f"{len(values)} intrinsics, {len(sizes)} resolutions and {len(poses)} poses are given; equally many are "
            "expected"
        )
    top.set_aside(*({*top.names()} - {"intrinsics", "resolution", "T_imu_cam"}))
    names = [f"cam{index}" for index in range(len(values))]
    if len(values) == 1:
        return _camera(names[0], values[0], sizes[0], request)
    pair = chosen(names, request, top)
    first, second = (names.index(name) for name in pair)
    for parts in (sizes, poses):
        other_cameras(dict(zip(names, parts, strict=True)), pair)
    return rig(
        _camera(pair[0], values[first], sizes[first], request),
        _camera(pair[1], values[second], sizes[second], request),
        inverse(_pose(poses[second])) @ _pose(poses[first]),
        defined=_DEFINED,
        where=poses[second],
        request=request,
        others=other_cameras(dict(zip(names, values, strict=True)), pair),
    )


def _pose(value: Located) -> FloatArray:
    from scipy.spatial.transform import Rotation

    moved, turned = (
        [value.need(f"{kind}{axis}").number() for axis in axes] for kind, axes in (("p", "xyz"), ("q", "xyzw"))
    )
    if abs(sum(component**2 for component in turned) - 1.0) > _UNIT_QUATERNION:
        raise value.fail("qx, qy, qz and qw are not a rotation: their squares must add to 1")
    return transform_of(Rotation.from_quat(turned).as_matrix(), moved)


def _camera(name: str, value: Located, size: Located, request: Request) -> ImportedCamera:
    named, inner = value.need("camera_type"), value.need("intrinsics")
    kind = named.text()
    if kind not in _MODELS:
        raise unknown(named, tuple(_MODELS))
    model, names = _MODELS[kind]
    for key in names:
        inner.need(key)
    inner.set_aside("rpmax")
    coefficients = given(inner, names) | ({"beta": 1.0} if kind == "ucm" else {})
    return keyed(name, inner, model, coefficients, size=size, request=request, says=kind)


FORMAT: Final = Format(
    name="Basalt calibration",
    options=("length_unit", "pair"),
    whole="the file contains all cameras",
    signs=("value0", "T_imu_cam", "camera_type"),
    recognises=lambda file: (value := file.top.find("value0")) is not None and value.has("T_imu_cam", "intrinsics"),
    read=read,
)

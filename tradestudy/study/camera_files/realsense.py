"""RealSense intrinsics and extrinsics as JSON: streams by name, and transforms from one to another."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Final

from tradestudy.cameras.imported import Imported, ImportedCamera, LensModelName
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.camera_files.located import CameraFile, Format, Located, Request, other_cameras
from tradestudy.study.camera_files.pairs import inverse, rotation_of
from tradestudy.study.camera_files.rigs import (
    FISHEYE,
    RADTAN,
    Definition,
    chosen,
    keyed,
    only,
    rig,
    transform_of,
    unknown,
)
from tradestudy.study.document import ListEntry

_DEFINED: Final = Definition(
    format="RealSense intrinsics",
    direction="extrinsics_A_to_B map A into B; the rotation is stored by columns, as librealsense does",
    unit="m",
)
_MODELS: Final[Mapping[str, tuple[LensModelName, tuple[str, ...]]]] = {
    "none": ("rational", ()),
    "brownconrady": ("rational", RADTAN),
    "modifiedbrownconrady": ("rational", RADTAN),
    "inversebrownconrady": ("rational", ()),
    "kannalabrandt4": ("kannala-brandt", FISHEYE),
    "ftheta": ("fov", ("w",)),
}
"""Lens models by the letters of their names."""
_DIFFERENT: Final = {
    "modified": "its tangential distortion acts after the radial one, which no model here does; only zeros are read",
    "inverse": "its coefficients undistort pictures, which no model here does; only zeros are read",
}


def read(files: Sequence[CameraFile], request: Request) -> Imported:
    """One stream, or two with the extrinsics between them.

    Raises
    ------
    CameraFileError
        A value is missing or invalid, a model is unknown, or no extrinsics connect the two streams.
    """
    top = files[0].top
    if top.has("ppx"):
        return _camera("camera", top, request)
    streams = {stream: top.need(stream) for stream in _streams(top)}
    if len(streams) == 1:
        return next(_camera(stream, value, request) for stream, value in streams.items())
    first, second = pair = chosen(tuple(streams), request, top)
    ways = {name: top.find(f"extrinsics_{name}") for name in (f"{first}_to_{second}", f"{second}_to_{first}")}
    steps = [_transform(value) for value in ways.values() if value is not None]
    if not steps:
        raise top.fail(f"the key extrinsics_{first}_to_{second} is missing; or give two other streams as pair: [A, B]")
    forth, back = ways.values()
    where = forth or back
    assert where is not None
    return rig(
        _camera(first, streams[first], request),
        _camera(second, streams[second], request),
        steps[0] if forth is not None else inverse(steps[0]),
        defined=_DEFINED,
        where=where,
        request=request,
        others=other_cameras(streams, pair),
    )


def _streams(top: Located) -> list[str]:
    return [key for key in top.names() if (value := top.find(key)) is not None and value.has("ppx", "ppy")]


def _transform(value: Located) -> FloatArray:
    turn, moved = value.need("rotation"), value.need("translation")
    value.set_aside("note")
    if any(isinstance(item.entry, ListEntry) for item in turn.items()):
        raise turn.fail("one list of 9 numbers, by columns, is expected; write it as librealsense gives it")
    rotation = rotation_of(turn, turn.numbers(9))
    return transform_of(rotation.T, moved.numbers(3))


def _camera(name: str, value: Located, request: Request) -> ImportedCamera:
    named, lens = value.need("model"), value.need("coeffs")
    letters = re.sub("[^a-z0-9]", "", named.text().lower()).removeprefix("distortion")
    if letters not in _MODELS:
        raise unknown(named, tuple(_MODELS))
    model, names = _MODELS[letters]
    numbers = lens.numbers(4, 5)
    shifts = numbers[2:4] if letters.startswith("modified") else numbers if letters.startswith("inverse") else ()
    if any(shifts):
        raise lens.fail(f"{named.text()}: {next(why for part, why in _DIFFERENT.items() if letters.startswith(part))}")
    return keyed(
        name, value, model, only(names, numbers, lens), lens=lens, keys=("fx", "fy", "ppx", "ppy"),
        size=(value.need("width"), value.need("height")), request=request, says=named.text(),
    )  # fmt: skip


FORMAT: Final = Format(
    name="RealSense intrinsics",
    options=("length_unit", "pair"),
    whole="the file contains all streams",
    signs=("ppx", "ppy", "coeffs"),
    recognises=lambda file: file.top.has("ppx", "ppy") or bool(_streams(file.top)),
    read=read,
)

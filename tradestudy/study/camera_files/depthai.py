"""The calibration of DepthAI devices (OAK) as JSON: cameras by socket, lengths in centimetres."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from tradestudy.cameras.imported import Convention, Imported, ImportedCamera
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.camera_files.located import CameraFile, Format, Located, Request, other_cameras
from tradestudy.study.camera_files.pairs import checked_camera, inverse, paired, pinhole_of, rotation_of

_ORDER: Final = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tau_x", "tau_y")
_PERSPECTIVE, _FISHEYE = "0", "1"


def read(files: Sequence[CameraFile], request: Request) -> Imported:
    """The stereo pair of a device, or the two sockets that ``pair`` names.

    The extrinsics of a camera lead from it to another one, ``x_to = R x_from + t``.

    Raises
    ------
    CameraFileError
        A value is missing or invalid, or no transform connects the two cameras.
    """
    top = files[0].top
    cameras = _by_socket(top.need("cameraData"))
    left, right = request.pair or _stereo_pair(top, cameras)
    for socket in (left, right):
        if socket not in cameras:
            raise top.fail(f"there is no camera at socket {socket}; known: {', '.join(cameras)}")
    specified = top.find("stereoUseSpecTranslation")
    is_specified = specified is not None and specified.flag()
    rotation, translation, where, kind = _between(cameras, left, right, is_specified=is_specified)
    metre, unit = request.metres(where, stated="cm", why="the definition of DepthAI calibrations")
    conventions = (
        Convention(name="format", says="DepthAI calibration", key=where.key),
        Convention(
            name="direction of transforms", says="extrinsics lead from a camera to toCameraSocket", key=where.key
        ),
        Convention(name="pictures", says="raw: as taken, before rectification", key=where.key),
        Convention(name="translation", says=kind, key=where.key),
        unit,
        *other_cameras(cameras, (left, right)),
    )
    return paired(
        _camera(left, cameras[left]),
        _camera(right, cameras[right]),
        rotation,
        translation * metre,
        metre=metre,
        where=(where, where),
        exchanged=f"left and right are exchanged; give pair: ['{right}', '{left}'] beside from:",
        conventions=conventions,
    )


def _by_socket(data: Located) -> dict[str, Located]:
    """Cameras by the number of their socket."""
    cameras = {}
    for pair in data.items():
        items = tuple(pair.items())
        if len(items) != 2:
            raise pair.fail("a socket and its camera are expected")
        cameras[items[0].text()] = items[1]
    return cameras


def _stereo_pair(top: Located, cameras: dict[str, Located]) -> tuple[str, str]:
    named = top.find("stereoRectificationData")
    left, right = (None if named is None else named.find(f"{side}CameraSocket") for side in ("left", "right"))
    if left is not None and right is not None and {left.text(), right.text()} <= cameras.keys():
        return left.text(), right.text()
    raise top.fail(
        f"the file names no stereo pair; give pair: [left socket, right socket], in quotes, from {', '.join(cameras)}"
    )


def _between(
    cameras: dict[str, Located], left: str, right: str, *, is_specified: bool
) -> tuple[FloatArray, FloatArray, Located, str]:
    """Rotation and translation [cm] from left to right by the extrinsics, with the translation's origin.

    Both chains of extrinsics lead to a common camera: one of the two, or another one to which both are related.
    """
    chains = [_chain(cameras, socket) for socket in (left, right)]
    reached = [socket for socket in chains[0] if socket in chains[1]]
    if left == right:
        raise cameras[left].fail(f"pair: the socket {left} occurs twice; two cameras are expected")
    if not reached:
        raise cameras[left].fail(f"no chain of extrinsics connects the sockets {left} and {right}")
    totals, kinds, where = [], list[str](), cameras[left]
    for chain in chains:
        total = np.eye(4)
        for socket in chain[: chain.index(reached[0])]:
            extrinsics = cameras[socket].need("extrinsics")
            turn, (where, kind) = extrinsics.need("rotationMatrix"), _translation(extrinsics, is_specified=is_specified)
            step = np.eye(4)
            step[:3, :3] = rotation_of(turn, turn.numbers(9))
            step[:3, 3] = [where.need(axis).number() for axis in ("x", "y", "z")]
            total, kinds = step @ total, [*kinds, kind]
        totals.append(total)
    between = inverse(totals[1]) @ totals[0]
    return between[:3, :3], between[:3, 3], where, " and ".join(dict.fromkeys(kinds))


def _chain(cameras: dict[str, Located], first: str) -> list[str]:
    """The sockets to which the extrinsics of a camera lead, itself first; the last one refers to no other camera."""
    sockets = [first]
    while True:
        extrinsics = cameras[sockets[-1]].find("extrinsics")
        parent = None if extrinsics is None else extrinsics.find("toCameraSocket")
        if parent is None or parent.text() not in cameras or parent.text() in sockets:
            return sockets
        sockets.append(parent.text())


def _translation(extrinsics: Located, *, is_specified: bool) -> tuple[Located, str]:
    """The measured translation, unless the device uses the specified one or none was measured."""
    measured, specified = extrinsics.find("translation"), extrinsics.find("specTranslation")
    if is_specified and specified is not None:
        return specified, "specified (specTranslation), as stereoUseSpecTranslation says"
    if measured is not None and any(measured.need(axis).number() for axis in ("x", "y", "z")):
        return measured, "measured (translation)"
    if specified is not None:
        return specified, "specified (specTranslation); none was measured"
    raise extrinsics.fail("neither translation nor specTranslation is given")


def _camera(socket: str, value: Located) -> ImportedCamera:
    matrix, distortion = value.need("intrinsicMatrix"), value.need("distortionCoeff")
    kind = value.find("cameraType")
    number = _PERSPECTIVE if kind is None else kind.text()
    if number not in (_PERSPECTIVE, _FISHEYE):
        assert kind is not None
        raise kind.fail(f"the camera type {number[:20]} is unknown; 0 (perspective) or 1 (fisheye) is expected")
    numbers = distortion.numbers(4, 5, 8, 12, 14)
    names = ("k1", "k2", "k3", "k4") if number == _FISHEYE else _ORDER
    if number == _FISHEYE and any(numbers[4:]):
        raise distortion.fail("a fisheye lens has 4 coefficients; the others must be 0")
    return checked_camera(
        socket,
        pinhole_of(matrix, matrix.numbers(9)),
        "kannala-brandt" if number == _FISHEYE else "rational",
        dict(zip(names, numbers, strict=False)),
        matrix=matrix,
        lens=distortion,
        size=(value.need("width"), value.need("height")),
        says="fisheye" if number == _FISHEYE else "perspective",
        fisheye="set cameraType to 1 in the file",
    )


FORMAT: Final = Format(
    name="DepthAI calibration",
    options=("length_unit", "pair"),
    whole="the file of a device contains all its cameras",
    recognises=lambda file: file.top.has("cameraData"),
    read=read,
)

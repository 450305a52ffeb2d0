"""The calibration of DepthAI devices (OAK) as JSON: cameras by socket, lengths in centimetres."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from tradestudy.cameras.imported import Convention, Imported, ImportedCamera
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.camera_files.conversions import pinhole_of, rotation_of
from tradestudy.study.camera_files.located import CameraFile, Located
from tradestudy.study.camera_files.pairs import check_lens, paired
from tradestudy.study.camera_files.request import Format, Request, origin_of_pixels

_ORDER: Final = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tau_x", "tau_y")
_PERSPECTIVE, _FISHEYE = "0", "1"
_NOBODY: Final = "-1"


def recognises(file: CameraFile) -> bool:
    """Whether a file has the key cameraData."""
    return file.top.has("cameraData")


def read(files: Sequence[CameraFile], request: Request) -> Imported:
    """The stereo pair of a device, or the two sockets that ``pair`` names.

    The extrinsics of a camera lead from it to another one, ``x_to = R x_from + t``.

    Raises
    ------
    CameraFileError
        A value is missing or invalid, or no transform connects the two cameras.
    """
    if len(files) != 1:
        raise files[1].top.fail("the file of a device contains all its cameras; give one file")
    top = files[0].top
    cameras = _by_socket(top.need("cameraData"))
    left, right = request.pair or _stereo_pair(top, cameras)
    for socket in (left, right):
        if socket not in cameras:
            raise top.fail(f"there is no camera at socket {socket}; known: {', '.join(cameras)}")
    rotation, translation, where, kind = _between(cameras, left, right)
    metre, unit = request.metres(where, stated="cm", why="the definition of DepthAI calibrations")
    conventions = (
        Convention(name="format", says="DepthAI calibration", key=where.key),
        Convention(
            name="direction of transforms", says="extrinsics lead from a camera to toCameraSocket", key=where.key
        ),
        Convention(name="pictures", says="raw: as taken, before rectification", key=where.key),
        Convention(name="translation", says=kind, key=where.key),
        unit,
    )
    return paired(
        _camera(left, cameras[left]),
        _camera(right, cameras[right]),
        rotation,
        translation * metre,
        metre=metre,
        where=(where, where),
        conventions=conventions,
    )


def _by_socket(data: Located) -> dict[str, Located]:
    """Cameras by the number of their socket."""
    found = {}
    for pair in data.items():
        items = tuple(pair.items())
        if len(items) != 2:
            raise pair.fail("a socket and its camera are expected")
        found[items[0].text()] = items[1]
    return found


def _stereo_pair(top: Located, cameras: dict[str, Located]) -> tuple[str, str]:
    named = top.find("stereoRectificationData")
    left, right = (None if named is None else named.find(f"{side}CameraSocket") for side in ("left", "right"))
    if left is not None and right is not None and {left.text(), right.text()} <= cameras.keys():
        return left.text(), right.text()
    raise top.fail(
        f"the file names no stereo pair; give pair: [left socket, right socket], in quotes, from {', '.join(cameras)}"
    )


def _between(cameras: dict[str, Located], left: str, right: str) -> tuple[FloatArray, FloatArray, Located, str]:
    """Rotation and translation [cm] from left to right along the chain of extrinsics, with the translation's origin."""
    for first, last in ((left, right), (right, left)):
        steps = _chain(cameras, first, last)
        if not steps:
            continue
        total, kinds = np.eye(4), list[str]()
        for extrinsics in steps:
            turn, (moved, kind) = extrinsics.need("rotationMatrix"), _translation(extrinsics)
            step = np.eye(4)
            step[:3, :3] = rotation_of(turn, turn.numbers(9))
            step[:3, 3] = [moved.need(axis).number() for axis in ("x", "y", "z")]
            total, kinds = step @ total, [*kinds, kind]
        rotation, translation = total[:3, :3], total[:3, 3]
        if first == right:
            rotation, translation = rotation.T, -rotation.T @ translation
        return rotation, translation, _translation(steps[-1])[0], " and ".join(dict.fromkeys(kinds))
    raise cameras[left].fail(f"no chain of extrinsics connects the sockets {left} and {right}")


def _chain(cameras: dict[str, Located], first: str, last: str) -> list[Located]:
    """Extrinsics from one camera to another, in order; empty if they do not connect."""
    steps: list[Located] = []
    here = first
    while here != last:
        extrinsics = cameras[here].find("extrinsics") if here in cameras else None
        there = None if extrinsics is None else extrinsics.find("toCameraSocket")
        if extrinsics is None or there is None or there.text() == _NOBODY or len(steps) > len(cameras):
            return []
        steps.append(extrinsics)
        here = there.text()
    return steps


def _translation(extrinsics: Located) -> tuple[Located, str]:
    """The measured translation, else the specified one."""
    measured, specified = extrinsics.find("translation"), extrinsics.find("specTranslation")
    if measured is not None and any(measured.need(axis).number() for axis in ("x", "y", "z")):
        return measured, "measured (translation)"
    if specified is not None:
        return specified, "specified (specTranslation); none was measured"
    raise extrinsics.fail("neither translation nor specTranslation is given")


def _camera(socket: str, value: Located) -> ImportedCamera:
    matrix, distortion = value.need("intrinsicMatrix"), value.need("distortionCoeff")
    focal_lengths, centre = pinhole_of(matrix, matrix.numbers(9))
    kind = value.find("cameraType")
    number = _PERSPECTIVE if kind is None else kind.text()
    if number not in (_PERSPECTIVE, _FISHEYE):
        assert kind is not None
        raise kind.fail(f"the camera type {number[:20]} is unknown; 0 (perspective) or 1 (fisheye) is expected")
    numbers = distortion.numbers(4, 5, 8, 12, 14)
    names = ("k1", "k2", "k3", "k4") if number == _FISHEYE else _ORDER
    if number == _FISHEYE and any(numbers[4:]):
        raise distortion.fail("a fisheye lens has 4 coefficients; the others must be 0")
    width, height = value.need("width"), value.need("height")
    camera = ImportedCamera(
        name=socket,
        focal_lengths=focal_lengths,
        centre=centre,
        pixels=(width.count(), height.count()),
        lens_model="kannala-brandt" if number == _FISHEYE else "rational",
        coefficients=dict(zip(names, numbers, strict=False)),
        conventions=(
            origin_of_pixels(matrix),
            Convention(name="lens model", says="fisheye" if number == _FISHEYE else "perspective", key=distortion.key),
        ),
        keys={
            "focal_lengths": matrix.key,
            "centre": matrix.key,
            "pixels": width.key,
            "coefficients": distortion.key,
        },
    )
    return check_lens(camera, distortion)


FORMAT: Final = Format(name="DepthAI calibration", options=("length_unit", "pair"), recognises=recognises, read=read)

"""ZED ``SN….conf``: the two cameras of a device at several resolutions, as Stereolabs calibrates it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from tradestudy.cameras.imported import Imported, ImportedCamera
from tradestudy.study.camera_files.located import CameraFile, Format, Located, Request, other_cameras
from tradestudy.study.camera_files.rigs import RADTAN, Definition, given, keyed, rig, transform_of

_DEFINED: Final = Definition(
    format="ZED calibration",
    direction="the rotation vector (RX, CV, RZ) and −(Baseline, TY, TZ) lead from the left to the right camera",
    unit="mm",
)
_SIZES: Final[Mapping[str, tuple[int, int]]] = {
    "4K": (3840, 2160),
    "2K": (2208, 1242),
    "FHD1200": (1920, 1200),
    "FHD": (1920, 1080),
    "HD": (1280, 720),
    "SVGA": (960, 600),
    "VGA": (672, 376),
}


def read(files: Sequence[CameraFile], request: Request) -> Imported:
    """The pair at the resolution of the study's pictures, or at the only one of the file.

    Raises
    ------
    CameraFileError
        A value is missing or invalid, or the file has several resolutions and the study does not choose one.
    """
    from scipy.spatial.transform import Rotation

    top = files[0].top
    keys = {resolution: f"LEFT_CAM_{resolution}" for resolution in _SIZES}
    cameras = {resolution: top.need(key) for resolution, key in keys.items() if top.has(key)}
    fitting = [resolution for resolution in cameras if request.pixels in (None, _SIZES[resolution])]
    if len(fitting) != 1:
        sizes = ", ".join(f"[{columns}, {rows}]" for columns, rows in (_SIZES[resolution] for resolution in cameras))
        raise top.fail(f"the size of the pictures is needed; give sensor: {{pixels: …}}, one of {sizes}")
    resolution = fitting[0]
    stereo, (left, right) = top.need("STEREO"), (top.need(f"{side}_CAM_{resolution}") for side in ("LEFT", "RIGHT"))
    turned = [stereo.need(f"{axis}_{resolution}").number() for axis in ("RX", "CV", "RZ")]
    moved = [stereo.need("Baseline", "BaseLine").number()]
    moved += [stereo.need(f"{axis}_{resolution}", axis).number() for axis in ("TY", "TZ")]
    for key in stereo.names():
        if key.rpartition("_")[2] in _SIZES and key.rpartition("_")[2] != resolution:
            stereo.set_aside(key)
    rights = {size: value for size in cameras if (value := top.find(f"RIGHT_CAM_{size}")) is not None}
    return rig(
        _camera(left, _SIZES[resolution], request),
        _camera(right, _SIZES[resolution], request),
        transform_of(Rotation.from_rotvec(turned).as_matrix(), -np.array(moved)),
        defined=_DEFINED,
        where=stereo,
        request=request,
        exchanged="Baseline is negative; correct its sign in the file",
        # Both sides have the same resolutions, so that one side's remark is enough.
        others=tuple(convention for side in (cameras, rights) for convention in other_cameras(side, (resolution,)))[:1],
    )


def _camera(value: Located, pixels: tuple[int, int], request: Request) -> ImportedCamera:
    names = (*RADTAN, "k4", "k5", "k6")  # the last three in files of newer devices
    request = replace(request, pixels=pixels)
    says = "pinhole, k1 k2 p1 p2 k3 …"
    return keyed(value.last, value, "rational", given(value, names), size=None, request=request, says=says)


FORMAT: Final = Format(
    name="ZED calibration",
    options=("length_unit", "pixels"),
    whole="the file of a device contains both cameras",
    signs=("LEFT_CAM_HD", "RIGHT_CAM_HD", "STEREO"),
    recognises=lambda file: file.top.has("STEREO") and any(file.top.has(f"LEFT_CAM_{name}") for name in _SIZES),
    read=read,
)

"""KITTI: ``calib_cam_to_cam`` with raw and rectified cameras, and the rectified cameras of the odometry benchmark."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from tradestudy.cameras.imported import Imported, ImportedCamera
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.camera_files.located import CameraFile, Format, Located, Request, other_cameras
from tradestudy.study.camera_files.opencv import translation_of_projection
from tradestudy.study.camera_files.pairs import checked_camera, inverse, pinhole_of, rotation_of
from tradestudy.study.camera_files.rigs import RADTAN, RAW, Definition, chosen, only, rig, transform_of

_RAW_KEYS, _RECTIFIED_KEYS = ("S_", "K_", "D_", "R_", "T_"), ("S_rect_", "R_rect_", "P_rect_")


def read(files: Sequence[CameraFile], request: Request) -> Imported:
    """Two cameras: raw ones by K, D, R and T if the file has them, else rectified ones by their projections.

    ``x_i = R_i x₀ + T_i`` leads from the reference to raw camera i; ``P = K′ [1, t]`` gives each rectified camera.

    Raises
    ------
    CameraFileError
        A value is missing or invalid, or the two cameras are not in the file.
    """
    top = files[0].top
    prefix = "P_rect_" if any(key.startswith("P_rect_") for key in top.names()) else "P"
    names = [key.removeprefix(prefix) for key in top.names() if key.startswith(prefix)]
    first, second = pair = chosen(names, request, top)
    lacking = [f"{key}{number}" for number in pair for key in _RAW_KEYS if not top.has(f"{key}{number}")]
    is_raw = request.pictures == "raw" and not lacking
    others = other_cameras({number: top.need(f"{prefix}{number}") for number in names}, pair)
    top.set_aside(*(f"{key}{number}" for key in (*_RAW_KEYS, *_RECTIFIED_KEYS) for number in names))
    (left, start), (right, end) = ((_raw if is_raw else _rectified)(top, number, prefix, request) for number in pair)
    why = f"; the file has no {', '.join(lacking)}" if lacking and prefix == "P_rect_" else ""
    return rig(
        left,
        right,
        end @ inverse(start),
        defined=Definition(
            format="KITTI calibration",
            direction="R and T lead from camera 00 to each camera" if is_raw else "P = K′ [1, t], from camera 00",
            unit="m",
            pictures=RAW if is_raw else f"rectified, by {prefix}{first} and {prefix}{second}{why}",
        ),
        where=top.need(f"T_{second}" if is_raw else f"{prefix}{second}"),
        request=request,
        exchanged=f"left and right are exchanged; give pair: ['{second}', '{first}'] beside from:",
        others=others,
    )


def _raw(top: Located, number: str, _prefix: str, _request: Request) -> tuple[ImportedCamera, FloatArray]:
    matrix, lens, turned, moved = (top.need(f"{key}{number}") for key in _RAW_KEYS[1:])
    camera = checked_camera(
        f"camera {number}",
        pinhole_of(matrix, matrix.numbers(9)),
        "rational",
        only(RADTAN, lens.numbers(5), lens),
        matrix=matrix,
        lens=lens,
        size=top.need(f"S_{number}"),
        says="pinhole, k1 k2 p1 p2 k3",
    )
    return camera, transform_of(rotation_of(turned, turned.numbers(9)), moved.numbers(3))


def _rectified(top: Located, number: str, prefix: str, request: Request) -> tuple[ImportedCamera, FloatArray]:
    value = top.need(f"{prefix}{number}")
    numbers = value.numbers(12)
    camera = checked_camera(
        f"camera {number}",
        pinhole_of(value, numbers),
        "rational",
        {},
        matrix=value,
        lens=value,
        size=top.find(f"S_rect_{number}"),
        pixels=request.pixels,
    )
    return camera, transform_of(np.eye(3), translation_of_projection(value, numbers))


FORMAT: Final = Format(
    name="KITTI calibration",
    options=("length_unit", "pair", "pixels", "pictures"),
    whole="the file contains all cameras",
    signs=("K_02", "P_rect_02", "P0", "P1"),
    recognises=lambda file: (
        file.syntax == "assignments" and (file.top.has("P0", "P1") or any("P_rect_" in key for key in file.top.names()))
    ),
    read=read,
)

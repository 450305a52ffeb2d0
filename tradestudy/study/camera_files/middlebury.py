"""Middlebury ``calib.txt``: a rectified pair with its baseline in millimetres."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from tradestudy.cameras.imported import Imported
from tradestudy.study.camera_files.located import CameraFile, Format, Request
from tradestudy.study.camera_files.pairs import checked_camera, pinhole_of
from tradestudy.study.camera_files.rigs import Definition, rig, transform_of

_DEFINED: Final = Definition(
    format="Middlebury calibration",
    direction="cam1 lies to the right of cam0 by the baseline",
    unit="mm",
    pictures="rectified, as the format defines",
)
_AGREES: Final = 0.01  # px, for files with two decimals


def read(files: Sequence[CameraFile], request: Request) -> Imported:
    """The rectified pair: depth is ``f B / (d + doffs)``, with ``doffs`` the difference of the principal points.

    Raises
    ------
    CameraFileError
        A value is missing or invalid, or ``doffs`` contradicts the principal points.
    """
    top = files[0].top
    size, cameras = (top.need("width"), top.need("height")), []
    for key in ("cam0", "cam1"):
        matrix = top.need(key)
        pinhole = pinhole_of(matrix, matrix.numbers(9))
        cameras.append(checked_camera(key, pinhole, "rational", {}, matrix=matrix, lens=matrix, size=size))
    offset, apart = top.need("doffs"), cameras[1].centre[0] - cameras[0].centre[0]
    if abs(offset.number() - apart) > _AGREES:
        raise offset.fail(f"the principal points are {apart:g} px apart, but doffs is {offset.number():g}; correct one")
    top.set_aside("ndisp", "isint", "vmin", "vmax", "dyavg", "dymax")
    baseline = top.need("baseline")
    return rig(
        cameras[0],
        cameras[1],
        transform_of(np.eye(3), [-baseline.number(), 0.0, 0.0]),
        defined=_DEFINED,
        where=baseline,
        request=request,
        exchanged="the baseline is negative; correct its sign in the file",
    )


FORMAT: Final = Format(
    name="Middlebury calibration",
    options=("length_unit", "pictures"),
    whole="the file contains both cameras",
    signs=("cam0", "cam1", "doffs", "baseline"),
    recognises=lambda file: file.syntax == "assignments" and file.top.has("cam0", "cam1", "baseline"),
    read=read,
)

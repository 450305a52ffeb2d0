"""MATLAB: stereoParameters through ``toStruct``, and ``Calib_Results_stereo`` of the toolbox of Bouguet."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from tradestudy.cameras.imported import Convention, Imported, ImportedCamera
from tradestudy.study.camera_files.located import CameraFile, Format, Located, Request
from tradestudy.study.camera_files.pairs import checked_camera, pinhole, pinhole_of, rotation_of
from tradestudy.study.camera_files.rigs import RADTAN, Definition, only, rig, transform_of

_EXCHANGED: Final = "left and right are exchanged; calibrate with the left camera as the first one"
_LENS: Final = "pinhole, k1 k2 p1 p2 k3"


def _parameters(file: CameraFile) -> Located | None:
    """The structure of a stereo calibration, whatever its variable is called."""
    values = (file.top.find(key) for key in file.top.names())
    return next((value for value in values if value is not None and value.has("CameraParameters1")), None)


def read_parameters(files: Sequence[CameraFile], request: Request) -> Imported:
    """The pair of ``toStruct(stereoParams)``: matrices are transposed, ``x₂ᵀ = x₁ᵀ R + t``, and pixels count from 1.

    Raises
    ------
    CameraFileError
        A value is missing or invalid.
    """
    value = _parameters(files[0])
    assert value is not None  # or it was not recognised
    cameras = [value.need(f"CameraParameters{side}") for side in (1, 2)]
    turn, moved = value.need("RotationOfCamera2"), value.need("TranslationOfCamera2")
    unit, other = (camera.need("WorldUnits") for camera in cameras)
    if unit.text() != other.text():
        raise other.fail(
            f"'{other.text()[:40]}' is not the unit of the first camera, '{unit.text()[:40]}'; correct one"
        )
    value.set_aside()
    first, second = (_camera(f"camera {side}", camera) for side, camera in enumerate(cameras, 1))
    says = "the file counts pixels from 1; 1 was subtracted from the principal points"
    return rig(
        first,
        second,
        transform_of(rotation_of(turn, turn.numbers(9)).T, moved.numbers(3)),
        defined=Definition(
            format="MATLAB stereoParameters",
            direction="x₂ᵀ = x₁ᵀ R + t, the transposed matrices of MATLAB",
            unit=unit.text(),
            by="WorldUnits of the file",
        ),
        where=moved,
        request=request,
        exchanged=_EXCHANGED,
        others=(Convention(name="first pixel", says=says, key=cameras[0].key),),
    )


def _camera(name: str, value: Located) -> ImportedCamera:
    matrix, radial, tangential = (
        value.find("IntrinsicMatrix"),
        value.need("RadialDistortion"),
        value.need("TangentialDistortion"),
    )
    is_transposed = matrix is not None
    matrix = matrix or value.need("K")
    numbers = np.reshape(matrix.numbers(9), (3, 3))
    fx, fy, cx, cy = pinhole_of(matrix, tuple((numbers.T if is_transposed else numbers).ravel().tolist()))
    height, width = value.need("ImageSize").pair()
    k, p = radial.numbers(2, 3), tangential.numbers(2)
    value.set_aside()
    return checked_camera(
        name,
        pinhole(matrix, fx, fy, cx - 1.0, cy - 1.0),
        "rational",
        dict(zip(RADTAN, (*k[:2], *p, *k[2:]), strict=False)),
        matrix=matrix,
        lens=radial,
        size=(width, height),
        says=_LENS,
    )


def read_results(files: Sequence[CameraFile], request: Request) -> Imported:
    """The pair of the toolbox of Bouguet, ``x_right = R(om) x_left + T``; pixels count from 0, as in OpenCV.

    Raises
    ------
    CameraFileError
        A value is missing or invalid.
    """
    from scipy.spatial.transform import Rotation

    top = files[0].top
    moved = top.need("T")
    matrix: Mapping[str, ImportedCamera] = {side: _toolbox_camera(top, side, request) for side in ("left", "right")}
    turned = Rotation.from_rotvec(top.need("om").numbers(3)).as_matrix()
    kept = {"T", "om", "nx", "ny", *(f"{key}_{side}" for key in ("fc", "cc", "kc", "alpha_c") for side in matrix)}
    top.set_aside(*({*top.names()} - kept))
    return rig(
        matrix["left"],
        matrix["right"],
        transform_of(turned, moved.numbers(3)),
        defined=Definition(format="Calib_Results_stereo", direction="from left to right, x_right = R(om) x_left + T"),
        where=moved,
        request=request,
        exchanged=_EXCHANGED,
    )


def _toolbox_camera(top: Located, side: str, request: Request) -> ImportedCamera:
    focal, centre, lens, skew = (top.find(f"{key}_{side}") for key in ("fc", "cc", "kc", "alpha_c"))
    focal, centre, lens = (
        focal or top.need(f"fc_{side}"),
        centre or top.need(f"cc_{side}"),
        lens or top.need(f"kc_{side}"),
    )
    if skew is not None and not math.isclose(skew.number(), 0.0, abs_tol=1e-12):
        raise skew.fail(f"the pixels have a skew of {skew.number():g}; only 0 is supported")
    return checked_camera(
        f"camera {side}",
        pinhole(focal, *focal.numbers(2), *centre.numbers(2)),
        "rational",
        only(RADTAN, lens.numbers(5), lens),
        matrix=focal,
        lens=lens,
        size=(top.need("nx"), top.need("ny")) if top.has("nx", "ny") else None,
        pixels=request.pixels,
        says=_LENS,
    )


PARAMETERS: Final = Format(
    name="MATLAB stereoParameters",
    options=("length_unit",),
    whole="the file contains both cameras",
    signs=("CameraParameters1", "RotationOfCamera2", "TranslationOfCamera2"),
    recognises=lambda file: _parameters(file) is not None,
    read=read_parameters,
)
RESULTS: Final = Format(
    name="Calib_Results_stereo",
    options=("length_unit", "pixels"),
    whole="the file contains both cameras",
    signs=("fc_left", "cc_left", "kc_left", "om"),
    recognises=lambda file: file.top.has("fc_left", "fc_right"),
    read=read_results,
)

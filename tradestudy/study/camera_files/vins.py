"""VINS-Fusion and camodocal: one file for each camera, and one with the poses of the cameras on the body."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from tradestudy.cameras.imported import Imported, ImportedCamera, LensModelName
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.camera_files.located import CameraFile, Format, Located, Request
from tradestudy.study.camera_files.opencv import matrix_of
from tradestudy.study.camera_files.pairs import inverse, rigid_of
from tradestudy.study.camera_files.rigs import FISHEYE, Definition, given, keyed, rig, transform_of, unknown

_DEFINED: Final = Definition(
    format="camodocal camera", direction="body_T_cam leads from a camera to the body, x_body = T x_cam", unit="m"
)
_PINHOLE, _MEI, _BRANDT = ("fx", "fy", "cx", "cy"), ("gamma1", "gamma2", "u0", "v0"), ("mu", "mv", "u0", "v0")
_RADTAN: Final = ("k1", "k2", "p1", "p2")
_MODELS: Final[Mapping[str, tuple[LensModelName, tuple[str, ...], tuple[str, ...]]]] = {
    "PINHOLE": ("rational", _PINHOLE, _RADTAN),
    "PINHOLE_FULL": ("rational", _PINHOLE, (*_RADTAN, "k3", "k4", "k5", "k6")),
    "MEI": ("omni", _MEI, _RADTAN),
    "KANNALA_BRANDT": ("kannala-brandt", _BRANDT, ()),
}
"""Lens model, keys of focal lengths and principal point, and coefficients under distortion_parameters."""


def read(files: Sequence[CameraFile], request: Request) -> Imported:
    """One camera; or two, and the file with ``body_T_cam0`` and ``body_T_cam1``, in any order.

    Raises
    ------
    CameraFileError
        A value is missing or invalid, a model is unknown, or a file of the pair is missing.
    """
    bodies = [file.top for file in files if file.top.has("body_T_cam0")]
    cameras = [file.top for file in files if file.top.has("model_type")]
    if len(files) == len(cameras) == 1:
        return _camera(cameras[0], request)
    if len(files) != 3 or len(bodies) != 1 or len(cameras) != 2:
        raise files[0].top.fail(
            "a pair needs the files of both cameras, cam0 first, and the one with body_T_cam0 and body_T_cam1; list "
            "them: from: [cam0.yaml, cam1.yaml, vins.yaml]"
        )
    body = bodies[0]
    told = [None if (named := body.find(f"cam{key}_calib")) is None else named.text() for key in (0, 1)]
    if [top.file.name for top in cameras] == told[::-1]:
        cameras.reverse()
    first, second = (_pose(body.need(f"body_T_cam{key}")) for key in (0, 1))
    body.set_aside(*({*body.names()} - {"image_width", "image_height"}))
    return rig(
        _camera(cameras[0], request),
        _camera(cameras[1], request),
        inverse(second) @ first,
        defined=_DEFINED,
        where=body.need("body_T_cam1"),
        request=request,
        exchanged="left and right are exchanged; exchange body_T_cam0 and body_T_cam1, and the files of the cameras",
    )


def _pose(value: Located) -> FloatArray:
    return transform_of(*rigid_of(value, matrix_of(value, 16)))


def _camera(top: Located, request: Request) -> ImportedCamera:
    named, projection = top.need("model_type"), top.need("projection_parameters")
    if named.text() not in _MODELS:
        raise unknown(named, tuple(_MODELS))
    model, keys, names = _MODELS[named.text()]
    distortion, mirror = top.find("distortion_parameters"), top.find("mirror_parameters")
    coefficients = {} if distortion is None else given(distortion, names)
    if model == "omni":
        coefficients["xi"] = (mirror or top.need("mirror_parameters")).need("xi").number()
    if model == "kannala-brandt":
        coefficients = given(projection, FISHEYE, ("k2", "k3", "k4", "k5"))
    elif not coefficients:
        raise top.fail("the key distortion_parameters is missing; write zeros for a lens without distortion")
    top.set_aside("camera_name")
    size = (top.need("image_width"), top.need("image_height"))
    return keyed(
        top.file.path.stem, projection, model, coefficients, lens=distortion, keys=keys, size=size, request=request,
        says=named.text(),
    )  # fmt: skip


FORMAT: Final = Format(
    name="camodocal camera",
    options=("length_unit",),
    signs=("model_type", "projection_parameters", "distortion_parameters", "body_T_cam0"),
    recognises=lambda file: file.top.has("model_type", "projection_parameters") or file.top.has("body_T_cam0"),
    read=read,
)
